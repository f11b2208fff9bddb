"""Text tables with lists in their cells (`"[0.1, 0.2]"`), unfolded into a column for each entry.

pandas, bagpy and numpy write arrays so. A column NAME of lists of k entries becomes the columns
NAME.1..NAME.k, as `parquet_table` has them. Rows keep their line numbers.
"""

import csv
import io
import re
import tempfile
from collections.abc import Sequence
from itertools import chain
from pathlib import Path
from typing import Final

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.limited_file import opened

# Without runs of blanks that two parts could share, as a cell may have a hundred thousand.
_BEGIN: Final = re.compile(r"(?:\w{1,20}\()?[\[({]")
_LIST: Final = re.compile(_BEGIN.pattern + r"(.*)[\])}]\)?", re.DOTALL)
_MOST_ENTRIES: Final = 4096  # of a list


class UnfoldedFile:
    """A text table without lists on the disk; it is removed with this object.

    Args:
        path: path of a table that has lists, as `has_lists` says.
        separator: separator of its cells.
        names: of its columns.
        num_lines: lines before the first row.

    Attributes:
        path: path of the table with a column for each entry.

    Raises:
        InputError: a list has another length than the first row's.
    """

    num_added_lines = 0
    """As a `PlainCopy` has them."""

    def __init__(self, path: Path, separator: str, names: Sequence[str], num_lines: int) -> None:
        """Writes the table; its lines keep their numbers, so that errors name those of the log.

        A row of several lines (a cell may have line breaks) becomes the last of them, after blank
        ones; the header becomes the line before the first row, whatever stands between.

        Args:
            path: of the table with lists; it has a row.
            separator: of its cells, and of the new table's.
            names: of its columns.
            num_lines: lines before the first row; blank lines take their place, but for the header.
        """
        self._folder = tempfile.TemporaryDirectory(prefix="wrenchsight", ignore_cleanup_errors=True)
        self.path = Path(self._folder.name) / path.name
        with opened(path, "a log") as raw, self.path.open("w", encoding="utf-8") as target:
            lines = (line.decode("utf-8", "replace").lstrip("\ufeff") for line in raw)
            header = list(names)
            for _ in range(num_lines):
                next(lines, None)
            target.write("\n" * (num_lines - 1))
            # Its lines count from the first row on.
            reader = csv.reader(lines, delimiter=separator, skipinitialspace=True)
            try:
                first_cells = next((cells for cells in reader if cells), [])
                # How wide its lists are decides the names of the columns.
                widths = [_width(entries(cell)) for cell in first_cells]
                num_written = reader.line_num - 1  # lines of the first row but its last one
                if first_cells:
                    target.write(_line(_names(header, widths), separator, num_written + 1))
                # After each row as many lines are written as the reader has read.
                for cells in chain([first_cells] if first_cells else [], reader):
                    lists = [entries(cell) for cell in cells]
                    _check_widths(path, num_lines + reader.line_num, header, lists, widths)
                    flat: list[str] = []
                    for cell, row in zip(cells, lists, strict=True):
                        flat += [cell] if row is None else row
                    num_new = reader.line_num - num_written
                    num_written = reader.line_num
                    target.write(_line(flat, separator, num_new) if cells else "\n" * num_new)
            except csv.Error as error:
                place = f"line {num_lines + reader.line_num}"
                problem = f"cannot be read ({error})"
                raise InputError(path, place, problem, "correct or remove the line") from error


def has_lists(cells: Sequence[str]) -> bool:
    """Whether a cell of a row begins a list."""
    return any(_BEGIN.match(cell.strip(' \t"')) for cell in cells)


def entries(cell: str) -> list[str] | None:
    """The entries of a list in a cell; None: the cell is no list."""
    match = _LIST.fullmatch(cell.strip())
    if match is None:
        return None
    content = re.sub(r"[\[\](){}]", " ", match[1])
    return [entry.strip("'\"") for entry in re.split(r"[,;\s]+", content) if entry]


def _width(row: list[str] | None) -> int | None:
    """Number of entries of a list; None: a single value."""
    return None if row is None else len(row)


def _names(header: Sequence[str], widths: Sequence[int | None]) -> list[str]:
    """A name for each entry of the columns' lists; columns beyond `widths` hold single values."""
    names: list[str] = []
    for k, name in enumerate(header):
        width = widths[k] if k < len(widths) else None
        names += [name] if width is None else [f"{name}.{e + 1}" for e in range(width)]
    return names


def _line(cells: Sequence[str], separator: str, num_lines: int) -> str:
    """Cells on the last of `num_lines` lines; those before it are blank."""
    one_line = [cell.replace("\n", " ") for cell in cells]
    text = io.StringIO()
    csv.writer(text, delimiter=separator, lineterminator="\n").writerow(one_line)
    return "\n" * (num_lines - 1) + text.getvalue()


def _check_widths(
    path: Path,
    line: int,
    header: Sequence[str],
    rows: Sequence[list[str] | None],
    widths: Sequence[int | None],
) -> None:
    """Refuses a row whose lists have other lengths than the first row's, or too many entries.

    A row with other numbers of cells than the first is left to who reads the table.
    """
    for k, (row, width) in enumerate(zip(rows, widths, strict=False)):
        count = _width(row)
        if count == width and (count is None or count <= _MOST_ENTRIES):
            continue
        name = header[k] if k < len(header) else str(k + 1)
        content = "no list" if row is None else f"a list of {count} entries"
        expected = "a single value" if width is None else f"{min(width, _MOST_ENTRIES)}"
        problem = f"holds {content}, expected {expected} as in the first row"
        raise InputError(path, f"line {line}, column {name}", problem, "correct or remove the row")
