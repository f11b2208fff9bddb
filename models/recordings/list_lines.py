"""Text whose lines are lists of numbers without a header, as a table.

    0 1426777123.25 [ok] (-0 -89.95) [ok] (0.16 0.05)      YARP's ports
    #state: (135.89, array([-0.0, -89.954]))               prints of Python, a line a quantity
    #torque: (135.89, array([-1.677, -44.311]))
    q: [0.1, -1.2], tau: [3.4, 5.6]

A column is called by the words before its list, with the number of its entry behind; a list without
words `list_1` and so on. Of the numbers outside of lists, one that grows evenly is the time, one
that counts is a count. Lines of several kinds give rows of their own where each has a time, else
one row together.
"""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

_NUMBER: Final = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?"
_ITEM: Final = re.compile(
    r"\[(?P<code>\d{1,6})\](?=\s*[\[(])"  # [2210][0.1,-1.2]: the kind of a message
    rf"|[\[(]\s*(?P<list>{_NUMBER}(?:(?:\s*[,;]\s*|\s+){_NUMBER})+)\s*,?\s*[\])]"
    r"|(?P<constructor>[^\W\d][\w.]*)(?=\(\s*[\[(])"  # array([..
    r"|(?P<word>[^\W\d][\w.]*)"
    rf"|(?P<number>{_NUMBER})(?![\w.])"
)
_TIME: Final = "time"
_CODE: Final = "message_"
_MIN_LINES: Final = 10
_MIN_SHARE: Final = 0.8  # of the lines that are of the kinds that repeat
_MOST_KINDS: Final = 8
_MOST_ITEMS: Final = 200  # of a line
_MOST_JOINED_LINES: Final = 16  # that an open bracket holds together
_LONGEST_LINE: Final = 1 << 13  # characters of a line, or of lines that a bracket joins
_ORDERS: Final = {  # what lists hold in the order of a program, by the word before each
    # YARP's stateExt
    "ok": (
        "joint position [deg]", "joint velocity [deg/s]", "joint acceleration [deg/s^2]",
        "motor position [deg]", "motor velocity [deg/s]", "motor acceleration [deg/s^2]",
        "torque [N m]", "pwm", "current [A]", "control mode", "interaction mode",
    ),
}  # fmt: skip
_MIN_ORDERED: Final = 9  # lists of such an order


class _Item(NamedTuple):
    """A list, or a number outside of lists, and the words before it."""

    words: str
    is_list: bool
    numbers: tuple[str, ...]


_Kind = tuple[tuple[str, bool, int], ...]
"""Of a line: the words before each item, whether it is a list, and its length."""


def are_list_lines(lines: Sequence[str]) -> bool:
    """Whether a text without a header is lines of lists; the last line may be cut off."""
    joined = [line for line in _joined(lines) if line.strip()]
    items = [_items(line) for line in joined]
    first = next((k for k, line in enumerate(items) if _has_list(line)), len(items))
    if first == len(items):
        return False
    if any(re.search(r"[,;\t|]", line) for line in joined[:first]):
        return False  # names above the lists: a table with lists in its cells
    if first and len(joined[first - 1].split()) == len(items[first]):
        return False
    shown = items[first:]
    kinds = _kinds(shown)
    return len(shown) >= _MIN_LINES and 0 < len(kinds) <= _MOST_KINDS and (
        sum(_kind(line) in kinds for line in shown) >= _MIN_SHARE * len(shown)
    )  # fmt: skip


def table_of_list_lines(parts: Iterable[str]) -> Iterator[str]:
    """The lines of a text as those of a table, below a line of names.

    Args:
        parts: of the text, each of which ends with a line; the first shows the kinds of lines.
    """
    kinds: list[_Kind] = []  # of lines
    names: dict[_Kind, list[str]] = {}
    columns: list[str] = []
    cells: dict[str, str] = {}
    rest: list[str] = []  # lines of a bracket that is still open
    for part in parts:
        given = part.splitlines()
        if not columns:
            head = [_items(line) for line in _joined(given) if line.strip()]
            kinds = _kinds(head)
            names = _names(kinds, head)
            columns = list(dict.fromkeys(name for kind in kinds for name in names[kind]))
            yield ",".join(f'"{name}"' for name in columns) + "\n"
        lines: list[str] = []
        for line in given:
            rest.append(line)
            text = " ".join(rest)
            if _is_open(text) and len(rest) < _MOST_JOINED_LINES:
                lines.append("")
                continue
            rest = []
            items = _items(text)
            kind = _kind(items)
            if kind not in names:
                lines.append("")
                continue
            numbers = [number for item in items for number in item.numbers]
            cells |= dict(zip(names[kind], numbers, strict=True))
            is_row = all(_TIME in x for x in names.values()) or kind == kinds[-1]
            lines.append(",".join(cells.get(name, "") for name in columns) if is_row else "")
            cells = {} if is_row else cells
        yield "\n".join(lines) + "\n"


def _is_open(text: str) -> bool:
    """Whether a bracket of a text is not closed in it."""
    num_open = text.count("[") + text.count("(") - text.count("]") - text.count(")")
    return num_open > 0 and len(text) < _LONGEST_LINE


def _joined(lines: Sequence[str]) -> list[str]:
    """The lines, those that an open bracket holds together as one: NumPy breaks long arrays."""
    joined: list[str] = []
    rest: list[str] = []
    for line in lines:
        rest.append(line)
        text = " ".join(rest)
        if not _is_open(text) or len(rest) == _MOST_JOINED_LINES:
            joined.append(text)
            rest = []
    return joined


def _items(line: str) -> list[_Item]:
    """The lists of a line and the numbers outside of them, with the words before each."""
    found: list[_Item] = []
    words: list[str] = []
    if len(line) > _LONGEST_LINE:
        return found
    for match in _ITEM.finditer(line):
        if match["word"]:
            words.append(match["word"])
        elif match["code"]:
            words.append(f"{_CODE}{match['code']}")
        elif match["list"]:
            numbers = tuple(re.findall(_NUMBER, match["list"]))
            # The only words of a line may stand before its time: they are of its list, too.
            if not words and len(found) == 1 and not found[0].is_list:
                words = [found[0].words]
            found.append(_Item("_".join(words), is_list=True, numbers=numbers))
            words = []
        elif match["number"]:
            found.append(_Item("_".join(words), is_list=False, numbers=(match["number"],)))
            words = []
        if len(found) > _MOST_ITEMS:
            return []
    return found


def _has_list(items: Sequence[_Item]) -> bool:
    return any(item.is_list for item in items)


def _has_words(items: Sequence[_Item]) -> bool:
    return bool(items) and all(item.words for item in items)


def _is_of_lists(kind: _Kind) -> bool:
    return any(is_list for _, is_list, _ in kind)


def _kind(items: Sequence[_Item]) -> _Kind:
    return tuple((item.words, item.is_list, len(item.numbers)) for item in items)


def _kinds(lines: Sequence[Sequence[_Item]]) -> list[_Kind]:
    """The kinds of lines that come again, in their order: with a list, or a number with words."""
    counts = Counter(_kind(line) for line in lines if _has_list(line) or _has_words(line))
    most = max((count for kind, count in counts.items() if _is_of_lists(kind)), default=0)
    return [kind for kind, count in counts.items() if 2 * count >= most > 1]


def _names(kinds: Sequence[_Kind], lines: Sequence[Sequence[_Item]]) -> dict[_Kind, list[str]]:
    """The names of the columns that each kind of line fills."""
    names: dict[_Kind, list[str]] = {}
    for kind in kinds:
        same = [line for line in lines if _kind(line) == kind]
        lists = [words for words, is_list, _ in kind if is_list]
        ordered = _ORDERS.get(lists[0], ()) if len({*lists}) == 1 else ()
        counts = Counter(lists)
        seen: Counter[str] = Counter()
        names[kind] = []
        has_time = False
        for place, (words, is_list, length) in enumerate(kind):
            if not is_list:
                name = _name_of_numbers([float(line[place].numbers[0]) for line in same], has_time)
                has_time |= name == _TIME
                names[kind].append(name or words or f"number_{place + 1}")
                continue
            seen[words] += 1
            name = f"{words}_{seen[words]}" if words and counts[words] > 1 else words
            name = name or f"list_{seen[words]}"
            if len(lists) >= _MIN_ORDERED and seen[words] <= len(ordered):
                name = ordered[seen[words] - 1]
            entries = [line[place].numbers for line in same]
            if not has_time and words.startswith(_CODE) and _begin_with_time(entries):
                has_time = True
                names[kind].append(_TIME)
                length -= 1
            names[kind] += [f"{name}.{k + 1}" for k in range(length)]
    return names


def _begin_with_time(lists: Sequence[Sequence[str]]) -> bool:
    """Whether the first entries are whole numbers that grow, as of a clock, and others are not."""
    first = [entries[0] for entries in lists]
    is_whole = all(number.isdecimal() for number in first)
    return (
        is_whole
        and not all(number.lstrip("-").isdecimal() for entries in lists for number in entries)
        and _name_of_numbers([float(number) for number in first], has_time=False) == _TIME
    )


def _name_of_numbers(numbers: Sequence[float], has_time: bool) -> str:
    """What numbers outside of lists are by their values in line after line; '' for neither."""
    steps = [later - earlier for earlier, later in pairwise(numbers)]
    if not steps or min(steps) < 0.0 or max(steps) == 0.0:
        return ""
    is_count = all(step == 1.0 for step in steps)
    return "count" if is_count else "" if has_time else _TIME
