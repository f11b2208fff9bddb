"""Live samples on a uniform time grid, one by one: the rule of `models.recordings.resampling`.

It gives the very numbers that `resample_chunks` gives, at a tenth of the cost of chunks of one.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

from wrenchsight.models.arrays import Array
from wrenchsight.models.recordings.resampling import DROPOUT_STEPS, ROUNDING, UNIFORM_TOLERANCE


class GridSample(NamedTuple):
    """A sample of the grid.

    Attributes:
        t: s.
        x: (k,) its numbers.
        dropout: whether it was bridged, or lacks a number.
    """

    t: float
    x: Array
    dropout: bool


class SampleGrid:
    """Carries the last sample and the grid from one sample to the next.

    Args:
        step: h, s.
    """

    def __init__(self, step: float) -> None:
        self._step = step
        self._last: GridSample | None = None
        self._is_uniform = True
        self._origin = 0.0
        self._next = 1

    def take(self, sample: GridSample) -> Iterator[GridSample]:
        """The grid's samples up to the next one of the stream, whose time must be later."""
        last, self._last = self._last, sample
        if last is None:
            yield sample
            return
        h, step = self._step, sample.t - last.t
        if self._is_uniform:
            if abs(step - h) <= UNIFORM_TOLERANCE * h:
                yield sample
                return
            self._is_uniform, self._origin = False, last.t
        end = sample.t + ROUNDING * h
        last_point = math.floor((end - self._origin) / h) + 1
        for k in range(self._next, last_point + 1):
            t = self._origin + h * k
            if t > end:
                break
            self._next += 1
            weight = (t - last.t) / step
            offset = min(t - last.t, sample.t - t)
            bridged = step > DROPOUT_STEPS * h and offset > UNIFORM_TOLERANCE * h
            dropout = bridged or sample.dropout or (last.dropout and weight < 1.0)
            # At the sample itself, what the last one lacked does not count.
            x = last.x + weight * (sample.x - last.x) if weight < 1.0 else sample.x
            yield GridSample(t, x, dropout)
