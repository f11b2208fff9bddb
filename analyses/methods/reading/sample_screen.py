"""A log's samples checked against what the joints can do, before the log is resampled.

Interpolation would spread one absurd sample over its neighbours, where it is no longer noticed.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from wrenchsight.models.arrays import Array
from wrenchsight.models.observers.sample_check import BEYOND, LESS, SampleCheck
from wrenchsight.models.recordings.recording import Recording, place_of
from wrenchsight.models.robot.robot import Robot

FAULT = "sample fault"
"""Signal of `Recording.extra`: 1 where a sample is missing because it is impossible; resampled,
above 0 wherever such a sample would have counted."""


class SampleScreen:
    """Passes a log on chunk by chunk, with NaN and a drop-out in place of impossible samples.

    Args:
        robot: whose limits count.
    """

    def __init__(self, robot: Robot) -> None:
        self._check = SampleCheck(robot, jitter=True)
        self._state = self._check.initial_state()
        self._last: float | None = None
        self._count = 0
        self._first = ""

    @property
    def notices(self) -> tuple[str, ...]:
        """What was left out, in one sentence; none where nothing was."""
        if not self._count:
            return ()
        samples = "1 sample is" if self._count == 1 else f"{self._count} samples are"
        return (
            f"{samples} beyond what the joints can do and left out as missing (the first in "
            f"{self._first})",
        )

    def screened(self, chunks: Iterable[Recording]) -> Iterator[Recording]:
        """Yields the same chunks without their impossible samples."""
        for chunk in chunks:
            before = chunk.t[0] if self._last is None else self._last
            period = np.diff(chunk.t, prepend=before)
            self._last = float(chunk.t[-1])
            # Time that stands still or runs backwards is refused later, with its line.
            (q, v, current), codes = self._check.run(
                self._state, chunk.q, chunk.v, chunk.current, np.maximum(period, 1e-9)
            )
            wrong = _lost(chunk.q, q) | _lost(chunk.v, v) | _lost(chunk.current, current)
            if wrong.any() and not self._count:
                self._first = place_of(chunk, int(np.argmax(wrong)))
            self._count += int(wrong.sum())
            fault = np.where(wrong, np.where(codes & BEYOND, 1.0, LESS), 0.0)
            yield replace(
                chunk,
                q=q,
                v=v,
                current=current,
                dropout=chunk.dropout | wrong,
                extra={**chunk.extra, FAULT: fault},
            )


def _lost(before: Array, after: Array) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """(N,) which samples lack a number that they had."""
    return np.asarray((np.isnan(after) & ~np.isnan(before)).any(axis=1))
