"""Choice among candidates of equal cost by a rule, not by the last bit of a sum.

Turning the wrist over, mirroring a posture or walking a path backwards often changes no measure at
all. Such candidates' costs then differ by rounding alone, and which of them is the smallest depends
on the processor. So costs within a tolerance of each other count as equal here, and of equals the
first in the order of the candidates is taken: an order that comes from how they were made, as the
branches of the inverse kinematics or the points of a grid, and not from their costs.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrenchsight.models.numerics.arrays import Array

# relative: a million times the rounding of sums and solvers, too little to matter
TIE_TOLERANCE = 1e-9
_HALF_TURN = 1e-9  # of a turn


def first_of_least(
    costs: ArrayLike, axis: int = -1, tolerance: float = TIE_TOLERANCE
) -> NDArray[np.intp]:
    """Index of the first cost (along `axis`) that no other beats by more than a tolerance.

    Args:
        costs: any shape; infinite ones are never chosen where there are others. No NaN.
        axis: along which to choose.
        tolerance: relative to the smallest cost's size.
    """
    costs = np.asarray(costs, dtype=np.float64)
    smallest = np.min(costs, axis=axis, keepdims=True)
    upper = smallest + tolerance * np.where(np.isfinite(smallest), np.abs(smallest), 0.0)
    return np.asarray(np.argmax(costs <= upper, axis=axis))


def in_order(costs: ArrayLike, tolerance: float = TIE_TOLERANCE) -> NDArray[np.intp]:
    """Indices of costs (N,) from the smallest to the largest, equal ones in their own order.

    Equal are neighbours in that order that differ by less than the tolerance, relative to the
    larger one's size.
    """
    costs = np.asarray(costs, dtype=np.float64)
    order = np.argsort(costs, kind="stable")
    ordered = costs[order]
    size = np.where(np.isfinite(ordered), np.abs(ordered), 0.0)
    with np.errstate(invalid="ignore"):  # inf - inf: equal
        apart = ordered[1:] - ordered[:-1] > tolerance * size[1:]
    group = np.concatenate([[0], np.cumsum(apart)])[: len(order)]
    return np.asarray(order[np.lexsort((order, group))])


def better(cost: float, than: float, tolerance: float = TIE_TOLERANCE) -> bool:
    """Whether a cost is smaller than another by more than the tolerance."""
    return cost < than - tolerance * (abs(than) if math.isfinite(than) else 0.0)


def beyond_rounding(error: float, rounding: float) -> float:
    """An error, or 0 where it is no more than rounding, which differs between machines."""
    return float(error) if error > rounding else 0.0


def whole_turns(angle: ArrayLike) -> Array:
    """Whole turns (...) in angles (...) in rad: the remainder lies within (-pi, pi].

    Half a turn back, to within 1e-9 of a turn, counts as half a turn forward: which of the two an
    inverse kinematics states is a matter of its rounding.
    """
    return np.ceil(np.asarray(angle, dtype=np.float64) / (2.0 * math.pi) - 0.5 - _HALF_TURN)
