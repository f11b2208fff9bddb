"""What every log's table checks of the rows and values that are wanted of it."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.arrays import Array, Flags
from wrenchsight.models.files.input_error import InputError


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
        raise InputError(
            path,
            "",
            f"has {count} {counted}, but rows {first} to {last} are wanted",
            "correct the rows in the description",
        )
    return first, last


def first_missing(values: Array, may_be_empty: Flags) -> tuple[int, int] | None:
    """Row and column (from 0) of the first value that is no finite number, row by row.

    Args:
        values: (N, k).
        may_be_empty: (k,) columns in which NaN stands for a value that is missing.
    """
    wrong = ~(np.isfinite(values) | (np.isnan(values) & may_be_empty))
    if not wrong.any():
        return None
    places: tuple[NDArray[np.int64], ...] = np.nonzero(wrong)
    return int(places[0][0]), int(places[1][0])
