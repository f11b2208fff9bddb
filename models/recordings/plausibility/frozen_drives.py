"""Stretches of a log in which currents or torques stand still, all of them, while joints move.

Drives whose driver fills the effort under one kind of control alone, or a topic that stopped: 0 for
a part of the log, and the last value for another one. Each of its numbers is plausible by itself.
"""

from typing import NamedTuple

import numpy as np

from wrenchsight.models.recordings.recording import Recording

LEAST_DURATION = 1.0  # s of a stretch; coarse words of a torque stay the same for shorter
LEAST_SAMPLES = 50  # in it
LEAST_TRAVEL = 0.1  # rad (m) of a joint in it
LEAST_SPEED_CHANGE = 0.05  # rad/s (m/s) of a joint in it, which needs another torque


class FrozenStretch(NamedTuple):
    """A stretch of samples, the first and last one within.

    Attributes:
        begin, end: s.
        first_row, last_row: as the log counts them.
        is_zero: whether all currents are zero in it.
    """

    begin: float
    end: float
    first_row: int
    last_row: int
    is_zero: bool

    def sentence(self) -> str:
        """When, and at what the drives stand still."""
        value = "zero" if self.is_zero else "one value"
        return f"at {value} from t = {self.begin:.6g} to {self.end:.6g} s"


class FrozenDrives:
    """Finds such stretches in successive chunks of a log.

    Attributes:
        stretches: of the chunks so far, but for one that may go on; `finish` adds that.
    """

    def __init__(self) -> None:
        self.stretches: list[FrozenStretch] = []
        self._begin: Recording | None = None  # first sample of the stretch that may go on
        self._last: Recording | None = None  # last sample of it
        self._count = 0
        self._ranges = np.zeros((4, 0))  # of it: least and largest q, least and largest v

    def feed(self, chunk: Recording) -> None:
        """Adds the next chunk, (T, n) signals without missing numbers."""
        effort = chunk.current if chunk.tau_J is None else chunk.tau_J
        changes = 1 + np.flatnonzero((effort[1:] != effort[:-1]).any(axis=1))
        bounds = np.array([0, *changes, chunk.num_samples])
        counts = np.diff(bounds)
        # Short ones count only where they may go on in another chunk.
        may_count = counts >= LEAST_SAMPLES
        may_count[[0, -1]] = True
        for first, end in zip(bounds[:-1][may_count], bounds[1:][may_count], strict=True):
            if first or not self._goes_on(chunk):
                self.finish()
            self._add(chunk, first, end)

    def _goes_on(self, chunk: Recording) -> bool:
        """Whether the first sample of a chunk has the drives' numbers of the last one."""
        if self._last is None:
            return True
        last, first = ((x.current if x.tau_J is None else x.tau_J) for x in (self._last, chunk[:1]))
        return bool(np.array_equal(last, first))

    def _add(self, chunk: Recording, first: int, end: int) -> None:
        q, v = chunk.q[first:end], chunk.v[first:end]
        ranges = np.stack([q.min(axis=0), -q.max(axis=0), v.min(axis=0), -v.max(axis=0)])
        self._ranges = ranges if self._begin is None else np.minimum(self._ranges, ranges)
        self._begin = chunk[first : first + 1] if self._begin is None else self._begin
        self._last = chunk[end - 1 : end]
        self._count += end - first

    def finish(self) -> None:
        """Ends the stretch that may go on."""
        begin, last = self._begin, self._last
        if begin is not None and last is not None:
            duration = float(last.t[0] - begin.t[0])
            travel = -(self._ranges[0] + self._ranges[1]).min(initial=0.0)
            speed_change = -(self._ranges[2] + self._ranges[3]).min(initial=0.0)
            effort = begin.current if begin.tau_J is None else begin.tau_J
            is_frozen = duration >= LEAST_DURATION and self._count >= LEAST_SAMPLES
            if is_frozen and travel > LEAST_TRAVEL and speed_change > LEAST_SPEED_CHANGE:
                self.stretches.append(
                    FrozenStretch(
                        begin=float(begin.t[0]),
                        end=float(last.t[0]),
                        first_row=_row(begin),
                        last_row=_row(last),
                        is_zero=not effort.any(),
                    )
                )
        self._begin = self._last = None
        self._count = 0

    def usable_rows(self, first_row: int, last_row: int) -> tuple[int, int] | None:
        """The longest rows between the stretches; None where there are none.

        Args:
            first_row, last_row: of the log.
        """
        bounds = [first_row - 1]
        for stretch in self.stretches:
            bounds += [stretch.first_row, stretch.last_row]
        bounds.append(last_row + 1)
        between = [
            (before + 1, after - 1) for before, after in zip(bounds[::2], bounds[1::2], strict=True)
        ]
        longest = max(between, key=lambda rows: rows[1] - rows[0])
        return longest if longest[1] > longest[0] else None


def _row(sample: Recording) -> int:
    """The row of a log that holds a sample; 0 where it is not known."""
    return 0 if sample.row is None else int(sample.row[0])
