"""What every log's table checks of the rows and values that are wanted of it."""

from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.log_container import LogTable, RowNumbers


def rows_within(
    path: Path, rows: tuple[int, int] | None, count: int, counted: str
) -> tuple[int, int]:
    """First and last row that are wanted, counted from 1.

    Args:
        rows: as stated; None for all.
        count: of the file.
        counted: what it has `count` of, such as "rows".

    Raises:
        InputError: the last row is beyond the file's.
    """
    first, last = rows or (1, count)
    if last > count:
        problem = f"has {count} {counted}, but rows {first} to {last} are wanted"
        raise InputError(path, "", problem, "correct the rows in the description")
    return first, last


def refuse_missing(
    table: LogTable,
    path: Path,
    values: Array,
    rows: RowNumbers,
    columns: Sequence[int],
    may_be_empty: Collection[int],
) -> None:
    """Refuses values that are no finite numbers, but for NaN where a value may be missing.

    Args:
        values: (N, k), of these rows (N,) and columns (k,) of the table.

    Raises:
        InputError: it names the first such value, row by row.
    """
    optional = np.array([column in may_be_empty for column in columns])
    wrong = ~(np.isfinite(values) | (np.isnan(values) & optional))
    if wrong.any():
        assert table.names is not None
        i, k = (int(places[0]) for places in np.nonzero(wrong))
        problem = "is empty or not finite, expected a number"
        remedy = "correct or remove the row; a short gap is bridged"
        raise InputError(
            path, f"{table.row_word} {rows[i]}, column {table.names[columns[k]]}", problem, remedy
        )
