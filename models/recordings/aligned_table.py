"""Tables whose signals are not sampled together, put on the rows of the positions.

    time, q1, i1          Time, q1, Time, i1
    0.000, 0.1,           0.000, 0.1, 0.003, 5
    0.003, , 5            0.010, 0.2, 0.013, 6
    0.010, 0.2,

PlotJuggler writes a row for each message and leaves the other cells empty; TwinCAT Scope, LabVIEW
and others write a time for each signal. Each signal is interpolated linearly between its own
samples; in gaps, and outside of them, its numbers are missing.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.layouts.time_names import clock_numbers
from wrenchsight.models.recordings.log_container import LogTable, RowNumbers, TableOfTable
from wrenchsight.models.recordings.recording_format import ColumnLayout, Signal

_BLOCK_ROWS: Final = 1 << 16
_LONGEST_BRIDGE: Final = 0.1  # s, longest step of a signal that is interpolated, or
_BRIDGED_STEPS: Final = 3.0  # median steps, whichever is longer
_COMPLETE_SHARE: Final = 0.5  # of a signal's samples: where fewer rows are complete, it has its own
_MIN_SAMPLES: Final = 10  # of each signal
_SAME_STEP: Final = 0.1  # of a step, by which clocks of one moment differ
_MOST_NUMBERS: Final = 1 << 28  # of a table, which is read whole


def aligned(table: LogTable, layout: ColumnLayout, path: Path) -> LogTable:
    """The table, or one on the rows of the positions where its signals have rows of their own.

    Args:
        table: with `layout`, whose time it has.
        path: of the log, for error lines.
    """
    time, position = layout.signal("t"), layout.signal("q")
    if time is None or position is None:
        return table
    columns = sorted({
        c for s in layout.signals if not s.may_be_empty and s.name != "t" for c in s.columns
    })  # fmt: skip
    clock_of = _clocks_of(table.names or (), time, columns)
    others = sorted({*clock_of.values()})
    used = sorted({*columns, *time.columns, *others})
    values, _ = next(table.blocks(used, None, used), (np.empty((0, len(used))), None))
    place = {column: k for k, column in enumerate(used)}
    t = _seconds(values, time, place)
    if np.isfinite(t).sum() < _MIN_SAMPLES:  # too few to tell; whoever reads the table says so
        return table
    if others and not _agree(values[:, [place[c] for c in others]] * time.scale[0], t):
        notice = "signals have clocks of their own: they are interpolated at that of the positions"
    elif _is_sparse(values[:, [place[c] for c in columns]]):
        clock_of = {}
        notice = "signals have rows of their own: they are interpolated at those of the positions"
    else:
        return table
    return AlignedTable(table, time, position.columns[0], clock_of, path, notice)


class AlignedTable(TableOfTable):
    """A table on the rows of its positions; implements `LogTable`.

    Args:
        table: whose signals are not sampled together.
        time: its time, at which the samples are.
        position: the column whose numbers show which rows are samples.
        clock_of: the column of the clock by the column of a signal; others have that of `time`.
        path: of the log, for error lines.
        notice: what is done.
    """

    def __init__(
        self,
        table: LogTable,
        time: Signal,
        position: int,
        clock_of: Mapping[int, int],
        path: Path,
        notice: str,
    ) -> None:
        super().__init__(table, notice)
        self._time, self._position, self._clock_of, self._path = time, position, clock_of, path

    def blocks(
        self,
        columns: list[int],
        rows: tuple[int, int] | None = None,
        may_be_empty: Collection[int] = (),
    ) -> Iterator[tuple[Array, RowNumbers]]:
        """As the protocol; the table is read whole."""
        clocks = {self._clock_of[c] for c in columns if c in self._clock_of}
        used = sorted({*columns, *self._time.columns, self._position, *clocks})
        place = {column: k for k, column in enumerate(used)}
        parts, numbers = [], []
        for part, part_numbers in self.table.blocks(used, rows, used):
            parts.append(part)
            numbers.append(part_numbers)
            if sum(map(len, parts)) * len(used) > _MOST_NUMBERS:
                problem = "has signals with rows or clocks of their own, and is too large for that"
                raise InputError(self._path, "", problem, "write a row for each sample")
        if not parts:
            return
        values, row_numbers = np.concatenate(parts), np.concatenate(numbers)
        t = _seconds(values, self._time, place)
        own_clock = self._clock_of.get(self._position)
        if own_clock is not None:
            t = values[:, place[own_clock]] * self._time.scale[0]
        is_sample = np.isfinite(t) & np.isfinite(values[:, place[self._position]])
        at = t[is_sample]
        result = np.empty((len(at), len(columns)))
        for i, column in enumerate(columns):
            x = values[:, place[column]]
            if column in self._time.columns:
                result[:, i] = x[is_sample]
                continue
            clock = self._clock_of.get(column)
            own_t = t if clock is None else values[:, place[clock]] * self._time.scale[0]
            result[:, i] = _interpolated(at, own_t, x)
        (first_time, *_) = self._time.columns  # the only one where signals have own clocks
        if own_clock is not None and first_time in columns:
            result[:, columns.index(first_time)] = at / self._time.scale[0]
        sample_numbers = row_numbers[is_sample]
        for begin in range(0, len(at), _BLOCK_ROWS):
            part_of = slice(begin, begin + _BLOCK_ROWS)
            self.progress = min(1.0, (begin + _BLOCK_ROWS) / len(at))
            yield result[part_of], sample_numbers[part_of]


def _clocks_of(names: Sequence[str], time: Signal, columns: Sequence[int]) -> dict[int, int]:
    """The clock of each column: the nearest one on its left; empty where all have one clock.

    Args:
        names: of all columns.
        time: the log's time.
        columns: of the signals.
    """
    clocks = sorted({*clock_numbers(names), *time.columns}) if len(time.columns) == 1 else []
    clock_of: dict[int, int] = {}
    for column in columns:
        left = [clock for clock in clocks if clock < column]
        if left:
            clock_of[column] = left[-1]
    return clock_of if len({*clock_of.values()}) > 1 else {}


def _seconds(values: Array, time: Signal, place: Mapping[int, int]) -> Array:
    """(N,) s of the log's time."""
    return np.asarray(values[:, [place[c] for c in time.columns]] @ time.scale)


def _agree(clocks: Array, t: Array) -> bool:
    """Whether clocks (N, k) show the same moments as the time (N,), or count from another begin."""
    step = float(np.nanmedian(np.diff(t))) if len(t) > 1 else 0.0
    difference = clocks - t[:, None]
    is_there = np.isfinite(difference)
    if not is_there.any():
        return False
    if not is_there.all() and (is_there.any(axis=1) != is_there.all(axis=1)).any():
        return False
    spread = np.nanmax(difference, axis=0) - np.nanmin(difference, axis=0)
    offset = np.abs(np.nanmedian(difference, axis=0))
    is_other_begin = offset > np.nanmax(t) - np.nanmin(t)
    is_same = (offset <= _SAME_STEP * step) | is_other_begin
    return bool((is_same & (spread <= _SAME_STEP * step)).all())


def _is_sparse(values: Array) -> bool:
    """Whether the columns (N, k) have rows of their own: few rows are complete."""
    is_there = np.isfinite(values)
    counts = is_there.sum(axis=0)
    if not len(counts) or counts.min() < _MIN_SAMPLES:
        return False
    return bool(is_there.all(axis=1).sum() < _COMPLETE_SHARE * counts.min())


def _interpolated(at: Array, t: Array, x: Array) -> Array:
    """(N,) a signal x at times `at`, linear between its samples at t; NaN in gaps and outside."""
    is_there = np.isfinite(t) & np.isfinite(x)
    own_t, own_x = t[is_there], x[is_there]
    if len(own_t) < 2:
        return np.full(len(at), np.nan)
    is_later = np.concatenate([[True], own_t[1:] > np.maximum.accumulate(own_t)[:-1]])
    own_t, own_x = own_t[is_later], own_x[is_later]
    result = np.interp(at, own_t, own_x, np.nan, np.nan)
    right = np.clip(np.searchsorted(own_t, at, side="left"), 1, len(own_t) - 1)
    steps = own_t[right] - own_t[right - 1]
    longest = max(_LONGEST_BRIDGE, _BRIDGED_STEPS * float(np.median(np.diff(own_t))))
    result[(steps > longest) & (own_t[right] != at)] = np.nan
    return np.asarray(result)
