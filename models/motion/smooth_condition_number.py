"""The condition number without its kinks, for the last steps to an optimum.

Where the two smallest (or the two largest) singular values of J meet, the condition number has a
kink, and a good path leads right through such postures: there a solver that follows gradients stops
somewhere near the optimum; exactly where depends on its start. With p-norms in the
place of the extremes,

    |s|_2p |1/s|_2p = (sum_i s_i^2p)^1/2p (sum_i s_i^-2p)^1/2p,

there is no kink. It lies above the condition number by a factor of at most 6^(1/p).
"""

from numpy.typing import ArrayLike

from wrenchsight.models.arrays import Array
from wrenchsight.models.motion.posture_measures import (
    ConditionNumber,
    PostureMeasure,
    by_singular_values,
    check_joints,
)
from wrenchsight.models.rigid_body.serial_chain import SerialChain


class SmoothConditionNumber:
    """The condition number of J by p-norms, in m and rad; a `PostureMeasure`.

    With the singular value decomposition J = sum_i s_i u_i v_i^T, its gradient with respect to J is
    itself times sum_i (w_i - c_i) / s_i u_i v_i^T, where w_i = s_i^2p / sum s^2p and
    c_i = s_i^-2p / sum s^-2p. At a singular posture it is 1e12, with a gradient of zero.

    Args:
        chain: an arm of six joints or more.
        sharpness: p; the larger, the nearer to the condition number.

    Raises:
        InputError: the arm has fewer than six joints.
        ValueError: a sharpness below 1.
    """

    key = "jcn"
    label = "condition number of J"

    def __init__(self, chain: SerialChain, sharpness: float) -> None:
        check_joints(chain)
        if not sharpness >= 1.0:
            raise ValueError(f"sharpness must be 1 or more, not {sharpness}")
        self._chain, self._sharpness = chain, float(sharpness)

    def values(self, q: ArrayLike) -> Array:
        """The measure (...) at q (..., n)."""
        return self.values_and_gradients(q)[0]

    def values_and_gradients(self, q: ArrayLike) -> tuple[Array, Array]:
        """The measure (...) and its gradient (..., n) at q (..., n)."""
        p = self._sharpness

        def norms(s: Array) -> tuple[Array, Array]:
            # The extremes are divided out first: their 1e5th powers would overflow.
            above, below = (s / s[:, :1]) ** (2.0 * p), (s[:, -1:] / s) ** (2.0 * p)
            totals = above.sum(axis=1), below.sum(axis=1)
            values = s[:, 0] / s[:, -1] * (totals[0] * totals[1]) ** (0.5 / p)
            return values, above / totals[0][:, None] - below / totals[1][:, None]

        return by_singular_values(self._chain, q, norms)


def smoothed(chain: SerialChain, measure: PostureMeasure, sharpness: float) -> PostureMeasure:
    """A measure that has a gradient everywhere, in the place of one that has kinks."""
    if isinstance(measure, ConditionNumber):
        return SmoothConditionNumber(chain, sharpness)
    return measure
