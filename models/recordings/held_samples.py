"""Samples that hold the last value of a slower source, as in a log at 100 Hz of one at 10 Hz.

An SDK that is read faster than it updates gives each value several times, of all signals or of the
currents alone. Such a log has steps where the robot has none: its positions jump, its currents are
late by half a period of the source.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.recordings.log_words import KEEP_EVERY
from wrenchsight.models.recordings.recording import Recording, concatenated

MIN_CHANGES = 20  # of a signal, from which its rhythm shows
REGULAR_SHARE = 0.8  # of the changes that follow the last one by the period
PERIOD_TOLERANCE = 0.15  # of the period, by which two clocks drift and jitter
EXACT_ROWS = 4  # rows of a period, below which it is kept to the row
# A joint that turns slowly and evenly changes by one step of its encoder at a time, too.
LEAST_STEPS = 2.5  # of a column's resolution, of a change that is no encoder's single step
STEPPING_SHARE = 0.5  # of the changes that must be more than one joint's single step
_SIGNAL_WORDS = {"q": "positions", "v": "velocities", "current": "currents", "tau_J": "torques"}


class HeldSignals(NamedTuple):
    """Signals of which each value is held for `num_rows` rows, by their names in `Recording`."""

    names: tuple[str, ...]
    num_rows: int

    @property
    def words(self) -> str:
        """The signals in words."""
        words = [_SIGNAL_WORDS[name] for name in self.names]
        return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"

    def remedy(self, is_described: bool = False) -> str:
        """What to do, also for a log that is read by a description."""
        key = f"keep_every: {self.num_rows}"
        if is_described:
            return f"keep one row of each {self.num_rows}: set {key} in the description"
        return f"keep one row of each {self.num_rows}: add --log-format {KEEP_EVERY}{self.num_rows}"

    def notice(self, rate: float, is_described: bool) -> str:
        """What is found, and what to do.

        Args:
            rate: rows a second.
            is_described: as `remedy`.
        """
        return (
            f"each value of the {self.words} is repeated for {self.num_rows} rows: their source "
            f"gives {rate / self.num_rows:.3g} samples a second, the log {rate:.4g}; "
            f"{self.remedy(is_described)}"
        )


def held_signals(part: Recording, names: Sequence[str]) -> HeldSignals | None:
    """The signals that hold each value for the largest number of rows; None where none does.

    Args:
        part: the first samples of a log, as logged.
        names: signals of the log, of q, v, current and tau_J.
    """
    periods: dict[str, int] = {}
    for name in names:
        signal = getattr(part, name)
        if signal is not None and signal.size:
            periods[name] = _period(signal)
    longest = max(periods.values(), default=1)
    if longest < 2:
        return None
    alike = [name for name, period in periods.items() if period == longest]
    return HeldSignals(tuple(alike), longest)


def _period(x: Array) -> int:
    """Rows for which a signal (T, n) holds each value; 1 where it is new in each row."""
    change = np.abs(np.diff(x, axis=0))
    rows = np.flatnonzero((change > 0.0).any(axis=1))
    if len(rows) < MIN_CHANGES:
        return 1
    spacing = np.diff(rows)
    period = round(float(np.median(spacing)))
    if period < 2:
        return 1
    tolerance = PERIOD_TOLERANCE * period if period >= EXACT_ROWS else 0.0
    is_regular = np.abs(spacing - period) <= max(tolerance, float(period >= EXACT_ROWS))
    if float(np.mean(is_regular)) < REGULAR_SHARE:
        return 1
    changed = change[rows]
    resolution = np.where(changed > 0.0, changed, np.inf).min(axis=0)
    is_several = (changed > 0.0).sum(axis=1) > 1
    is_stepping = is_several | (changed > LEAST_STEPS * resolution).any(axis=1)
    return period if float(np.mean(is_stepping)) >= STEPPING_SHARE else 1


class RowThinning:
    """Keeps one row of each `num_rows` of a log that comes in parts.

    It is the first row of each value of the held signals. Where these do not change, as at rest, or
    none is held, it is the row after `num_rows`.

    Args:
        num_rows: of which one is kept; 1: all are.
        names: held signals, by their names in `Recording`.
    """

    def __init__(self, num_rows: int, names: tuple[str, ...] = ()) -> None:
        self._num_rows, self._names = num_rows, names
        self._since = 0  # rows since the last one that was kept
        self._last: Recording | None = None  # the last row

    def kept(self, chunk: Recording) -> Recording:
        """The rows of the next chunk that are kept."""
        if self._num_rows < 2 or not chunk.num_samples:
            return chunk
        is_new = self._is_new(chunk)
        # A value that comes early or late by less than half a period is still the next one.
        shortest = max(1, self._num_rows // 2) if self._names else self._num_rows
        longest = self._num_rows + (self._num_rows // 2 if self._names else 0)
        is_kept = np.zeros(chunk.num_samples, bool)
        for k in range(chunk.num_samples):
            self._since += 1
            is_first = self._last is None and k == 0
            is_next = bool(is_new[k]) and self._since >= shortest
            if is_first or is_next or self._since >= longest:
                is_kept[k] = True
                self._since = 0
        self._last = chunk[-1:]
        return chunk[is_kept]

    def _is_new(self, chunk: Recording) -> Flags:
        """(T,) rows whose held signals differ from those of the row before."""
        part = chunk if self._last is None else concatenated([self._last, chunk])
        is_new = np.zeros(part.num_samples, bool)
        for name in self._names:
            is_new[1:] |= (np.diff(getattr(part, name), axis=0) != 0.0).any(axis=1)
        if not self._names:
            is_new[:] = True
        return is_new[-chunk.num_samples :]
