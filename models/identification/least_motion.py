"""The least motion of a joint that shows its friction and inertia: what `identify` requires."""

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.numerics.arrays import Array

LEAST_TRAVEL, LEAST_SLIDE = 0.05, 0.02  # rad, and m of a joint that slides, peak to peak
LEAST_SPEED = 0.01  # rad/s or m/s


def moves(
    q: Array, v: Array, prismatic: NDArray[np.bool_], factor: float = 1.0
) -> NDArray[np.bool_]:
    """(n,) the joints that move over samples (T, n), enough to show friction and inertia.

    Args:
        q, v: rad and rad/s, or m and m/s.
        prismatic: (n,) which joints slide.
        factor: of the least travel and speed; above 1 for a plan, of which a log shows less.
    """
    least = factor * np.where(prismatic, LEAST_SLIDE, LEAST_TRAVEL)
    if not len(q):
        return np.zeros(len(prismatic), bool)
    speed = np.abs(v).max(axis=0)
    return np.asarray((np.ptp(q, axis=0) >= least) & (speed >= factor * LEAST_SPEED))
