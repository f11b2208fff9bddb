"""Text whose lines name each number, as a table: a line a sample, or a line a joint.

    t=0.01 q1=0.1 q2=-1.2 i1=4                      prints, logfmt
    [ID:001] PresPos:2048 PresVel:12                prints of servos
    MotorState_(q=0.1, dq=0), MotorState_(q=..      representations of Python's objects
    {'t': 0.01, 'q1': 0.1}                          and of its dictionaries
    effort,joint=elbow value=0.1,i=4 1700000000     InfluxDB's lines: tags, numbers, a stamp
    <Rob><AIPos A1="0.1" A2="5"/><IPOC>12</IPOC>    packets of KUKA's sensor interface

What a line names more than once is numbered. The first line gives the names.
"""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from typing import Final

_NUMBER: Final = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?"
_PART: Final = re.compile(
    rf"<(?P<element>\w+)>\s*(?P<content>{_NUMBER})\s*</"
    r"|<(?P<begin>\w+)"
    rf"|(?P<key>[^\W\d][\w.]*)[\"']?\s*[=:]\s*[\"']?(?P<number>{_NUMBER})(?![\w.:])i?"
    r"|(?P<tag>[^\W\d]\w*)=[\"']?(?P<word>[^\W\d][\w\-]*)"
)
_STAMP: Final = re.compile(r"\s(\d{10,19})\s*$")  # of InfluxDB's lines
_MIN_PAIRS: Final = 3  # of a line
_MIN_LINES: Final = 5
_MOST_PAIRS: Final = 1000  # of a line
_MIN_SHARE: Final = 0.8  # of the lines that must name the same


def are_key_values(lines: Sequence[str]) -> bool:
    """Whether most lines of a text name the same numbers."""
    shown = [line for line in lines if line.strip()]
    if len(shown) < _MIN_LINES:
        return False
    names = Counter(tuple(name for name, _ in _pairs(line)) for line in shown)
    most, count = names.most_common(1)[0]
    num_numbers = sum(bool(re.fullmatch(_NUMBER, value)) for _, value in _pairs(shown[-1]))
    return (
        len(most) >= _MIN_PAIRS and num_numbers >= _MIN_PAIRS and count >= _MIN_SHARE * len(shown)
    )


def table_of_pairs(parts: Iterable[str]) -> Iterator[str]:
    """The lines of a text as those of a table, below a line of names.

    Args:
        parts: of the text, each of which ends with a line.
    """
    names: list[str] = []
    for part in parts:
        if not names:  # the first part holds such lines
            rows = (_pairs(line) for line in part.splitlines())
            names = [name for name, _ in next((x for x in rows if len(x) >= _MIN_PAIRS), [])]
            yield ",".join(names) + "\n"
        lines: list[str] = []
        for line in part.splitlines():
            pairs = _pairs(line)
            values = dict(pairs)
            is_row = any(name in values for name in names)
            lines.append(",".join(values.get(name, "") for name in names) if is_row else "")
        yield "\n".join(lines) + "\n"


def _pairs(line: str) -> list[tuple[str, str]]:
    """The names in a line with their values; a name that comes again has its number behind."""
    found: list[tuple[str, str]] = []
    element = ""
    for match in _PART.finditer(line):
        if match["begin"]:
            element = f"{match['begin']}."
        elif match["element"]:
            found.append((match["element"], match["content"]))
        elif match["key"]:
            found.append((element + match["key"], match["number"]))
        else:
            found.append((match["tag"], match["word"]))
        if len(found) > _MOST_PAIRS:
            return []
    stamp = _STAMP.search(line)
    if stamp:
        found.append(("timestamp", stamp[1]))
    counts = Counter(name for name, _ in found)
    numbers: Counter[str] = Counter()
    named = []
    for name, value in found:
        numbers[name] += 1
        named.append((f"{name}_{numbers[name]}" if counts[name] > 1 else name, value))
    return named
