"""Checks that every log's table makes: the selected rows exist, and their values are numbers."""

from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.log_container import LogTable, RowNumbers


def rows_within(
    path: Path, rows: tuple[int, int] | None, count: int, row_words: str
) -> tuple[int, int]:
    """First and last selected row, counted from 1.

    Args:
        rows: first and last row that the description selects; None for all.
        count: number of rows of the file.
        row_words: name of the rows in error lines, such as "rows".

    Raises:
        InputError: the last row is beyond the file's.
    """
    first, last = rows or (1, count)
    if last > count:
        problem = f"has {count} {row_words}, but the description selects rows {first} to {last}"
        raise InputError(path, "", problem, "correct the rows in the description")
    return first, last


def no_words(path: Path) -> InputError:
    """The error of a file of numbers alone, whose rows hold no words."""
    return InputError(path, "", "holds no words", "name the joints in the header")


def other_words(path: Path, place: str, first: Sequence[str], others: Sequence[str]) -> InputError:
    """The error of a row whose words are not those of the first row."""
    problem = f"names {', '.join(others)[:200]}, but the first row {', '.join(first)[:200]}"
    return InputError(path, place, problem, "write the rows of other joints to another file")


def refuse_missing(
    table: LogTable,
    path: Path,
    values: Array,
    rows: RowNumbers,
    columns: Sequence[int],
    may_be_empty: Collection[int],
) -> None:
    """Refuses values that are no finite numbers, except NaN where a value may be missing.

    Args:
        table, path: for error lines.
        values: (N, k), of these rows (N,) and columns (k,) of the table.
        may_be_empty: columns of which a value may be missing.

    Raises:
        InputError: names the first such value, row by row.
    """
    is_optional = np.array([column in may_be_empty for column in columns])
    is_wrong = ~(np.isfinite(values) | (np.isnan(values) & is_optional))
    if is_wrong.any():
        wrong_rows, wrong_columns = np.nonzero(is_wrong)
        column = columns[int(wrong_columns[0])]
        name = str(column + 1) if table.names is None else table.names[column]
        place = f"{table.row_word} {rows[int(wrong_rows[0])]}, column {name}"
        problem = "is empty or not finite, expected a number"
        remedy = "correct or remove the row; a short gap is bridged"
        raise InputError(path, place, problem, remedy)
