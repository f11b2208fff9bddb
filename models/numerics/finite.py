"""Whether numbers are finite, at the cost of one kernel call."""

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import kernel

LARGEST_INPUT = 1e9  # SI; no arm's signal is as large, and the square of more is of no use


@kernel
def all_below(values: Array, bound: float) -> bool:
    """Whether all of (N,) are finite, and smaller than `bound` in magnitude."""
    is_below = True
    for k in range(values.shape[0]):
        is_below = is_below and abs(values[k]) < bound
    return is_below
