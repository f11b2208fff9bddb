"""The resolution of a log's joint positions: the step of the encoders."""

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.numerics.arrays import Array

_MAX_STEP = 1e-2  # rad (m); larger changes are jumps, no rounding
_MIN_STEP = 1e-9  # rad (m); smaller changes are the rounding of a float64, no encoder's step
_MIN_CHANGES = 50  # changes from which a step is found
_MULTIPLES_SHARE = 0.99  # of the changes that must be multiples of the step
_STEP_TOLERANCE = 0.02  # of a step: numbers in a text file are rounded themselves


def position_resolution(q: ArrayLike) -> Array:
    """(n,) the step of which all positions q (N, n) are multiples; 0 where there is none.

    Interpolated or filtered positions show no step: samples must be those of the log, not
    resampled. A joint that hardly moves is given the largest step of the other joints.
    """
    q = np.asarray(q, float)
    changes = np.abs(np.diff(q, axis=0))
    steps = np.array([_step(changes[:, j]) for j in range(q.shape[1])])
    largest = float(np.nanmax(steps, initial=0.0))
    return np.where(np.isnan(steps), largest, steps)


def _step(changes: Array) -> float:
    """The step of a joint; 0 if it has none, NaN if there are too few changes."""
    moved = changes[np.isfinite(changes) & (changes > _MIN_STEP)]
    if len(moved) < _MIN_CHANGES:
        return float("nan")
    smallest = float(moved.min())
    # A joint that moves fast may never change by a single step.
    for parts in (1, 2, 3):
        step = _refined(moved, smallest / parts)
        multiples = moved / step
        is_multiple = np.abs(multiples - np.round(multiples)) <= _STEP_TOLERANCE
        # Of a wrong step only 4 % of the changes are near a multiple.
        if step <= _MAX_STEP and float(np.mean(is_multiple)) >= _MULTIPLES_SHARE:
            return step
    return 0.0


def _refined(moved: Array, step: float) -> float:
    """The step refined by ever larger changes, whose multiples the step so far gives."""
    for limit in (3.0, 10.0, 30.0, 100.0, 300.0, 1000.0):
        near = moved[moved < limit * step]
        if len(near):
            count = np.maximum(np.round(near / step), 1.0)
            step = float((near @ count) / (count @ count))
    return step
