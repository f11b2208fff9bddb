"""The step of the encoders, as a log shows it."""

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.numerics.arrays import Array

_LARGEST = 1e-2  # rad (m); a log whose smallest change is larger jumps, it does not round
_SMALLEST = 1e-9  # below, it is the rounding of a float64, and no encoder's
_FEWEST = 50  # changes that must show the step
_SHARE = 0.99  # of them that must be multiples of it
_TOLERANCE = 0.02  # of a step: numbers in a text file are rounded themselves


def position_resolution(q: ArrayLike) -> Array:
    """(n,) the step that all positions q (N, n) are multiples of; 0 where there is none.

    Positions that were interpolated or filtered show no step: samples must be those of the log, not
    resampled. A joint that hardly moves has the largest step of the others.
    """
    q = np.asarray(q, float)
    changes = np.abs(np.diff(q, axis=0))
    steps = np.array([_step(changes[:, j]) for j in range(q.shape[1])])
    largest = float(np.nanmax(steps, initial=0.0))
    return np.where(np.isnan(steps), largest, steps)


def _step(changes: Array) -> float:
    """NaN for too few changes."""
    moved = changes[np.isfinite(changes) & (changes > _SMALLEST)]
    if len(moved) < _FEWEST:
        return float("nan")
    smallest = float(moved.min())
    # A joint that moves fast may never change by a single step.
    for parts in (1, 2, 3):
        step = _refined(moved, smallest / parts)
        multiples = moved / step
        even = np.abs(multiples - np.round(multiples)) <= _TOLERANCE
        # If the step is wrong, changes fall anywhere between its multiples: 4 % of them near one.
        if step <= _LARGEST and float(np.mean(even)) >= _SHARE:
            return step
    return 0.0


def _refined(moved: Array, step: float) -> float:
    """The step from ever larger changes, each known in multiples by the ones before."""
    for limit in (3.0, 10.0, 30.0, 100.0, 300.0, 1000.0):
        near = moved[moved < limit * step]
        if len(near):
            count = np.maximum(np.round(near / step), 1.0)
            step = float((near @ count) / (count @ count))
    return step
