"""Finds the table in a text: where its rows begin, what separates its cells, and its names.

Nothing is known beforehand. Each separator is tried: the one is right by which the most lines fall
into the same number of cells, most of them numbers. The line of words above these rows names the
columns. In between may stand further lines of names, of units or of types, and blank ones;
above them anything. Several lines may also begin with a label each, one of which says that it has
the names.
"""

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from wrenchsight.models.recordings.date_stamps import is_date, stamp_form
from wrenchsight.models.recordings.layouts.signal_words import column_name
from wrenchsight.models.recordings.layouts.unit_words import unit_of

MOST_HEAD_LINES: Final = 200
"""Lines of a text among which the first rows of its table are; a logger writes fewer above it."""
# What stands for a missing number, also in pandas and in databases.
NAN_CELLS: Final = ("nan", "NaN", "NAN", "-nan", "-nan(ind)", "null", "NULL", "None", "N/A", "n/a",
                    "NA", "#N/A", "<NA>", "-", ".nan", ".NaN", ".NAN")  # fmt: skip
_SEPARATORS: Final = (";", "\t", "|", ",", " ")  # the earlier one where two fit alike
# Unambiguous, so that it does not backtrack: a cell may have a hundred thousand digits.
_NUMBER: Final = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?")
_COMMENT: Final = re.compile(r"\s*(#+|//+|%(?=\s))\s*")  # begins a line; %time is a name of ROS 1
_IN_STARS: Final = re.compile(r"\*{2,}\w+\*{2,}")  # LabVIEW's end of a header, between others
_NAMES_BEHIND: Final = re.compile(  # a size, a title: double robot(1500,19) # columns: time, q[1]
    r".{0,200}?\b(?:columns|fields|variables|channels|signals|names)\s*[:=]\s*(.+)", re.IGNORECASE
)
_OTHER_SEPARATOR: Final = re.compile(r"\t|\s[;,|]|[;,|](\s|$)")  # beside blanks
_TYPE_CELLS: Final = frozenset((
    "double", "float", "float32", "float64", "real", "real32", "real64", "lreal", "int",
    "int16", "int32", "int64", "uint16", "uint32", "dint", "udint", "bool", "string",
    "integer", "single",
))  # fmt: skip
_UNIT_CELL: Final = re.compile(r"\W*[^\W\d]{0,5}([ */·^_][^\W_]{1,5}){0,2}\W*")
_LIST: Final = re.compile(r"(?:\w{1,20}\()?[\[({]\s*[-+\d.\[('\"]")
_IN_BRACKETS: Final = re.compile(r"\[[^\[\]]*\]")
_UNIT_LENGTH: Final = 20  # characters
_MOST_LEVELS: Final = 5  # lines of names, units and types above the rows
# First cells of a line that is one of several on the columns: their names, or their units.
_NAME_LABELS: Final = frozenset((
    "name", "names", "signal", "signals", "signal name", "signalname", "channel", "channels",
    "channel name", "symbol", "symbolname", "variable", "variables", "bezeichnung", "kanal",
    "x_value",
))  # fmt: skip
_UNIT_LABELS: Final = frozenset((
    "unit", "units", "einheit", "einheiten", "dimension", "y_unit_label", "unité", "unità",
))  # fmt: skip
_STEP_LABELS: Final = frozenset((
    "delta_x", "delta x", "dx", "wf_increment", "increment", "interval", "sample interval",
    "sampling interval", "sample period", "time step",
))  # fmt: skip
_TIME_NAME: Final = "Time"  # of the column whose cells above the rows are such labels
_NO_NAME: Final = " "  # where a line has the number of a column
_LEAST_LABELLED: Final = 2
_LEFT_OUT_NAMES: Final = ("", "comment", "comments", "remark")  # of a last column without cells
_LEAST_NAMED: Final = 2  # cells of a line of names above others
_LEAST_WIDE: Final = 6  # cells of a row, which a line of words above meets by no chance
_SHORT_HEADER: Final = 0.3  # of the cells of a row: a line of fewer words names no columns


class CellKind(NamedTuple):
    """What a cell holds."""

    is_number: bool = False  # also a date, or a list
    has_decimal_comma: bool = False
    has_decimal_point: bool = False
    is_word: bool = False  # else, where it is no number, it is empty


@dataclass
class TableHead:
    """The begin of a table in a text.

    Attributes:
        separator: between the cells of its rows.
        decimal_mark: of its numbers.
        names: of its columns; None where it has none.
        num_columns: cells of a row.
        skip_lines: lines before that with the names, or before the first row without names.
        num_lines: lines before the first row.
        header: text of the line of names, by which repetitions of it are known; '' for none.
        first_cells: cells of the first row.
        is_labelled: whether the names are one of several lines that begin with a label each, which
            a description does not find.
        rate_hz: rows a second by a step that is stated above them, where their time is empty; 0:
            none is.
        notices: what was recognised, one sentence each.
    """

    separator: str
    decimal_mark: str = "."
    names: tuple[str, ...] | None = None
    num_columns: int = 1
    skip_lines: int = 0
    num_lines: int = 0
    header: str = ""
    first_cells: tuple[str, ...] = ("",)
    is_labelled: bool = False
    rate_hz: float = 0.0
    notices: list[str] = field(default_factory=list)


def split_cells(text: str, separator: str) -> list[str]:
    """The cells of a line, without blanks around them; runs of blanks separate like one."""
    text = text.strip() if separator == " " else text
    try:
        cells = next(csv.reader([text], delimiter=separator, skipinitialspace=True), [""])
    except csv.Error:
        cells = text.split(separator)
    return [cell.strip() for cell in cells]


def ends_in_quotes(line: str) -> bool:
    """Whether a line ends within a quoted cell, which then goes on in the next line."""
    return line.count('"') % 2 == 1


def is_number(text: str, decimal_mark: str = ".") -> bool:
    """Whether a cell is a number, with this decimal mark."""
    if decimal_mark == ",":
        text = text.replace(".", "x").replace(",", ".")
    return _NUMBER.fullmatch(text) is not None


def cell_kind(cell: str) -> CellKind:
    """What a cell holds; a number has a decimal comma or point, or none of them."""
    if not cell or cell in NAN_CELLS:
        return CellKind()
    if is_number(cell):
        return CellKind(is_number=True, has_decimal_point="." in cell)
    if is_number(cell, ","):
        return CellKind(is_number=True, has_decimal_comma=True)
    if stamp_form(cell) is not None or is_date(cell) or _LIST.match(cell):
        return CellKind(is_number=True)
    return CellKind(is_word=True)


def table_head(
    lines: Sequence[str],
    separator: str | None = None,
    decimal_mark: str | None = None,
    header: bool | None = None,
) -> TableHead:
    """Finds the table in the first lines of a text.

    Args:
        lines: without their ends.
        separator, decimal_mark: None: recognised.
        header: whether the first line that is not blank names the columns; None: recognised, and
            lines of another kind may stand above the table.
    """
    separator = separator or _separator(lines)
    rows = [split_cells(line, separator) for line in lines]
    first_row, count = _first_row(rows, header)
    head = TableHead(separator, num_columns=count, skip_lines=first_row, num_lines=first_row)
    if header is None:
        _find_names(head, lines, rows)
    elif header:
        _take_names(head, lines, rows, next((k for k, line in enumerate(lines) if line.strip()), 0))
    first = head.num_lines
    if first < len(rows):
        shown = (cells for cells in rows[first:] if any(cells))  # blank lines may be above
        head.first_cells = tuple(next(shown, rows[first]))
    if head.names is None and header is None and any(cell_kind(c).is_word for c in rows[first]):
        # Words among the numbers of a table without names, such as of `ros2 topic echo --csv`.
        head.names, head.header = tuple(rows[first]), lines[first].strip()
        head.num_columns, head.num_lines = len(rows[first]), first + 1
        head.first_cells = tuple(rows[first + 1]) if first + 1 < len(rows) else ("",)
    if head.names is not None:
        _fit_names(head, rows[head.num_lines :])
    elif header is not None:
        head.num_columns = len(head.first_cells)
    head.decimal_mark = decimal_mark or _decimal_mark(rows[head.num_lines :])
    if decimal_mark is None and head.decimal_mark == ",":
        head.notices.append("numbers are read with decimal commas")
    return head


def _is_row(cells: Sequence[str]) -> bool:
    """Whether a line holds numbers, and no more words than these."""
    kinds = [cell_kind(cell) for cell in cells]
    num_numbers = sum(kind.is_number for kind in kinds)
    return num_numbers > 0 and num_numbers >= sum(kind.is_word for kind in kinds)


def _usual_count(rows: Sequence[Sequence[str]]) -> tuple[int, int]:
    """The number of cells that rows of numbers have, and of how many rows; (0, 0) without rows."""
    counts = Counter(len(cells) for cells in rows if _is_row(cells))
    count = max(counts, key=lambda n: n * counts[n] if n > 1 else 0, default=0)
    return count, counts[count]


def _separator(lines: Sequence[str]) -> str:
    """The separator by which the most lines fall into rows of the most cells."""
    best, largest = "", 0
    for separator in _SEPARATORS:
        if not any(separator in line for line in lines):
            continue
        table = list(lines)
        if separator == " ":  # blanks within a list separate its entries, not the cells
            table = [_IN_BRACKETS.sub("[0]", x) for x in lines if not _OTHER_SEPARATOR.search(x)]
        count, num_rows = _usual_count([split_cells(line, separator) for line in table])
        if count > 1 and count * num_rows > largest:
            best, largest = separator, count * num_rows
    if best:
        return best
    first = next((line for line in lines if line.strip()), "")  # there are no rows
    return next((mark for mark in (";", "\t", ",", "|", " ") if mark in first.strip()), ",")


def _first_row(rows: Sequence[Sequence[str]], header: bool | None) -> tuple[int, int]:
    """Index of the first row of the table, and its number of cells.

    Args:
        rows: cells of all lines.
        header: as in `table_head`: where it is stated the table begins with the first line.
    """
    if header is not None:
        shown = (k for k, cells in enumerate(rows) if any(cells)) if header else iter([0])
        first = next(shown, 0)
        return first, len(rows[first]) if first < len(rows) else 0
    count, _ = _usual_count(rows)
    have_no_label = _begin_without_word([x for x in rows if len(x) == count and _is_row(x)])
    for k, cells in enumerate(rows):
        if have_no_label and cells and cell_kind(cells[0]).is_word:  # Offset;0;0;0
            continue
        if len(cells) == count and _is_row(cells) and not _counts_columns(cells):
            return k, count
    first = next((k for k, cells in enumerate(rows) if any(cells)), 0)  # a header without rows
    return first, len(rows[first]) if rows else 0


def _begin_without_word(rows: Sequence[Sequence[str]]) -> bool:
    """Whether most rows begin with a number or an empty cell: a line with a word there is none."""
    return 2 * sum(not cell_kind(cells[0]).is_word for cells in rows) > len(rows)


def _counts_columns(cells: Sequence[str]) -> bool:
    """Whether the cells are words, and then 1, 2, 3, ..: numbers of columns without a name."""
    numbers = [cell for cell in cells if cell_kind(cell).is_number]
    num_words = sum(cell_kind(cell).is_word for cell in cells)
    counted = [str(k + 1) for k in range(len(numbers))]
    return num_words > 0 and len(numbers) > 1 and numbers == counted


def _words_of(line: str, separator: str, count: int) -> list[str]:
    """The words of a line that may name columns; by another separator where that gives `count`."""
    behind = _NAMES_BEHIND.fullmatch(line.strip())
    if behind:
        listed = [split_cells(behind[1], mark) for mark in _SEPARATORS]
        exact = next((cells for cells in listed if len(cells) == count > 1), None)
        if exact is not None:
            return exact
    text = _COMMENT.sub("", line, count=1) if _COMMENT.match(line) else line
    text = text.strip() if separator != "\t" else text.strip(" \r\n")
    ways = [split_cells(text, separator)]
    ways += [split_cells(text, mark) for mark in _SEPARATORS if mark in text]
    ways += [re.split(r"\s+(?![\[(])", text), re.split(r"[;,\t|]", text)]  # Time [s] q1 [rad]
    wanted = (count, count - 1, count + 1)
    return next((cells for n in wanted for cells in ways if len(cells) == n), ways[0])


def _find_names(head: TableHead, lines: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Finds the lines of names above the first row; above these the text is no table."""
    if _take_labelled_names(head, lines, rows):
        return
    count, first = head.num_columns, head.num_lines
    top, levels = first, 0
    broken = 0  # lines between the names and the first row: rows that lack a cell
    for k in range(first - 1, -1, -1):
        if not lines[k].strip():
            if levels:
                break
            continue
        cells = _words_of(lines[k], head.separator, count)
        if levels:  # a title of as many words is no level
            cells = split_cells(_COMMENT.sub("", lines[k], count=1), head.separator)
        if _is_row(cells) and not levels and len(cells) > 1:
            broken += 1
            continue
        fits = len(cells) == count or (abs(len(cells) - count) == 1 and count >= _LEAST_WIDE)
        is_header = fits and (not _is_row(cells) or _counts_columns(cells))
        if levels and sum(map(bool, cells)) < _LEAST_NAMED:  # a title, or the end of a preamble
            is_header = False
        if not levels and not is_header:  # the only line of names may be one of another length
            is_header = len(cells) > max(1.0, _SHORT_HEADER * count) and not _is_row(cells)
            is_header &= not _COMMENT.match(lines[k]) and not broken
        if levels and _COMMENT.match(lines[k]) and not _COMMENT.match(lines[top]):
            # Above names without a mark, marked lines are remarks (InfluxDB's #datatype), unless
            # the lower ones are units.
            is_header &= _are_units(split_cells(lines[top], head.separator))
        if not is_header or levels == _MOST_LEVELS:
            break
        top, levels = k, levels + 1
        if not fits:
            break
    head.skip_lines = top
    if levels:
        _take_names(head, lines, rows, top)
    num_above = sum(bool(line.strip()) for line in lines[: head.skip_lines])
    if num_above:
        head.notices.insert(0, f"the first {head.skip_lines} lines are no table: left out")


def _take_labelled_names(
    head: TableHead, lines: Sequence[str], rows: Sequence[Sequence[str]]
) -> bool:
    """Reads names and units from lines above the rows that begin with a label each, and a value
    of each column; whether there are such lines, one of them of names.
    """
    count, first = head.num_columns, head.num_lines
    labelled: dict[str, int] = {}  # lines by their labels
    if not _begin_without_word([x for x in rows[first:] if len(x) == count]):
        return False
    for k in range(first - 1, -1, -1):
        if not lines[k].strip() and not labelled:
            continue
        if labelled and _IN_STARS.fullmatch(lines[k].strip()):
            continue
        if len(rows[k]) != count or not cell_kind(rows[k][0]).is_word:
            break
        labelled.setdefault(rows[k][0].lower(), k)
    top = next((k for label, k in labelled.items() if label in _NAME_LABELS), None)
    if top is None or len(labelled) < _LEAST_LABELLED or _repeats(rows[top]):
        return False
    head.is_labelled = True
    head.names = (_TIME_NAME, *rows[top][1:])
    head.skip_lines, head.header = top, lines[top].strip()
    units = next((k for label, k in labelled.items() if label in _UNIT_LABELS), None)
    if units is not None:
        head.names = (_TIME_NAME, *_with_units(rows[top][1:], rows[units][1:]))
    head.notices.append(f"names are read from line {top + 1}, one of {len(labelled)} with labels")
    step = next((k for label, k in labelled.items() if label in _STEP_LABELS), None)
    if step is not None and not any(cells[0] for cells in rows[first:] if len(cells) == count):
        head.rate_hz = _rate(rows[step][1:])
    return True


def _rate(cells: Sequence[str]) -> float:
    """Rows a second by the steps in s of all columns; 0 where they differ, or are none."""
    steps = {cell.replace(",", ".") for cell in cells if cell}
    step = next(iter(steps)) if len(steps) == 1 else ""
    return 1.0 / float(step) if is_number(step) and float(step) > 0.0 else 0.0


def _take_names(
    head: TableHead, lines: Sequence[str], rows: Sequence[Sequence[str]], top: int
) -> None:
    """Reads the names from the line `top`, and the lines of names, units and types below it."""
    count = _usual_count(rows[top + 1 :])[0] or len(rows[top])
    levels: list[list[str]] = []
    units: list[str] | None = None
    end = top
    for k in range(top, min(len(lines), top + _MOST_LEVELS)):
        cells = _words_of(lines[k], head.separator, count)
        if k == top and _counts_columns(cells):
            cells = [_NO_NAME if cell_kind(cell).is_number else cell for cell in cells]
        if k > top and not any(cells):
            break
        if k > top and (_is_row(cells) or len(cells) != len(levels[0])):
            break
        if k > top and any(cell_kind(cell).is_number for cell in cells):
            break
        if k > top and units is None and _are_units(cells):
            units = cells
        elif k > top and all(not cell or cell.lower() in _TYPE_CELLS for cell in cells):
            pass
        elif k == top or _repeats(levels[-1]):
            levels.append(cells)
        elif _name_signals(cells) and not any(map(_name_signals, levels)):
            # Words on the registers above them: Time, D1000, over J1 position.
            levels = [[cell or " ".join(x) for cell, *x in zip(cells, *levels, strict=True)]]
            head.notices.append(f"the columns are called as line {k + 1} says")
        else:
            head.notices.append(f"line {k + 1}, between the names and the rows, is left out")
        end = k + 1
    head.skip_lines, head.num_lines, head.header = top, end, lines[top].strip()
    head.names = _joined_levels(levels) if len(levels) > 1 else tuple(levels[0])
    if len(levels) > 1:
        head.notices.append(f"the names stand in {len(levels)} lines, which are joined")
    if units is not None:
        head.names = _with_units(head.names, units)
        head.notices.append("units are read from the line below the header")


def _repeats(names: Sequence[str]) -> bool:
    """Whether half of the names or more repeat or lack: quantities, over those of joints."""
    return (len(names) - len({*names} - {""})) * 2 >= len(names) - 1 > 0


def _name_signals(cells: Sequence[str]) -> bool:
    """Whether half of the cells or more name a quantity of a joint."""
    return 2 * sum(bool(column_name(cell).quantity) for cell in cells) >= len(cells)


def _are_units(cells: Sequence[str]) -> bool:
    """Whether the cells of a line are the units of the columns."""
    shown = [cell for cell in cells if cell.strip("[]()- ")]
    return (
        bool(shown)
        and all(len(cell) < _UNIT_LENGTH and _UNIT_CELL.fullmatch(cell) for cell in cells)
        and 2 * sum(bool(unit_of(cell)) for cell in shown) >= len(shown)
    )


def _with_units(names: Sequence[str], units: Sequence[str]) -> tuple[str, ...]:
    """The names of columns with their units behind, as "q1 [rad]"; without where there is none."""
    return tuple(
        f"{name} [{unit.strip('[]() ')}]"
        if unit.strip("[]()- ") and f"[{unit.strip('[]() ')}]" not in name
        else name
        for name, unit in zip(names, units, strict=True)
    )


def _joined_levels(levels: Sequence[Sequence[str]]) -> tuple[str, ...]:
    """A name for each column from lines of names above each other.

    As pandas writes MultiIndexes, the first column is the index, whose name is the last one: those
    above name the levels. As spreadsheets write them, a name counts up to the next one on its
    right.
    """
    filled = [list(level) for level in levels]
    for level in filled[:-1]:
        for k in range(2, len(level)):
            level[k] = level[k] or level[k - 1]
    names = [
        " ".join(name for name in column if name.strip()) for column in zip(*filled, strict=True)
    ]
    if not any(levels[-1][1:]):
        names[0] = levels[-1][0]
    return tuple(names)


def _fit_names(head: TableHead, rows: Sequence[Sequence[str]]) -> None:
    """Adds the name of a column that the header leaves out, or drops one that the rows lack.

    Rows may end with a separator, and the names of a table may begin behind its index.
    """
    assert head.names is not None
    count = _usual_count(rows)[0] or len(head.names)
    same = [cells for cells in rows if len(cells) == count]
    if count == len(head.names) + 1:
        if all(not cells[-1] for cells in same):
            head.names = (*head.names, "")
        elif [cells[0] for cells in same[:3]] in (["0", "1", "2"], ["1", "2", "3"]):
            head.names = ("", *head.names)
    elif count == len(head.names) - 1 and head.names[-1].lower() in _LEFT_OUT_NAMES:
        head.names = head.names[:-1]
    head.num_columns = len(head.names)


def _decimal_mark(rows: Sequence[Sequence[str]]) -> str:
    """The decimal mark of rows: a comma where a cell has one, and none before it has a point."""
    for cells in rows:
        kinds = [cell_kind(cell) for cell in cells]
        if any(kind.has_decimal_comma for kind in kinds):
            return ","
        if any(kind.has_decimal_point for kind in kinds):
            return "."
    return "."
