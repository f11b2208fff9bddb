"""The condition number without its kinks, for the last steps to an optimum.

Where the two smallest (or the two largest) singular values of J meet, the condition number has a
kink, and a good path leads right through such postures: there a solver that follows gradients stops
somewhere near the optimum; exactly where depends on its start. With p-norms in the
place of the extremes,

    |s|_2p |1/s|_2p = (sum_i s_i^2p)^1/2p (sum_i s_i^-2p)^1/2p,

there is no kink. It lies above the condition number by a factor of at most 6^(1/p).
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.arrays import Array
from wrenchsight.models.kernel import kernel
from wrenchsight.models.motion.posture_measures import (
    ConditionNumber,
    PostureMeasure,
    check_joints,
    contract,
)
from wrenchsight.models.rigid_body.chain_kernels import SCRATCH_COLUMNS, pose_and_jacobian
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.rigid_body.small_matrices import orthogonalise_rows

_UNREADABLE = 1e12  # stands for infinity, where a solver needs a number


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
        q = np.asarray(q, dtype=np.float64)
        rows = np.ascontiguousarray(q.reshape(-1, self._chain.num_joints))
        values, gradients = np.empty(len(rows)), np.empty(rows.shape)
        _rows(self._chain.table, self._sharpness, rows, values, gradients)
        return values.reshape(q.shape[:-1]), gradients.reshape(q.shape)


def smoothed(chain: SerialChain, measure: PostureMeasure, sharpness: float) -> PostureMeasure:
    """A measure that has a gradient everywhere, in the place of one that has kinks."""
    if isinstance(measure, ConditionNumber):
        return SmoothConditionNumber(chain, sharpness)
    return measure


@kernel
def _rows(table: Array, sharpness: float, q: Array, values: Array, gradients: Array) -> None:
    n = q.shape[1]
    scratch = np.empty((n, SCRATCH_COLUMNS))
    J, B, G = np.empty((6, n)), np.empty((6, n)), np.empty((6, n))
    Q, R_WE, p_WE = np.empty((6, 6)), np.empty((3, 3)), np.empty(3)
    squares, share = np.empty(6), np.empty(6)
    for k in range(q.shape[0]):
        pose_and_jacobian(table, q[k], R_WE, p_WE, J, scratch)
        orthogonalise_rows(J, B, Q)
        largest, smallest = 0.0, math.inf
        for m in range(6):
            squares[m] = 0.0
            for j in range(n):
                squares[m] += B[m, j] * B[m, j]
            largest, smallest = max(largest, squares[m]), min(smallest, squares[m])
        gradients[k] = 0.0
        values[k] = _UNREADABLE
        if not smallest > 0.0 or not math.sqrt(largest / smallest) < _UNREADABLE:
            continue
        # The extremes are divided out first: their 1e5th powers would overflow.
        above, below = 0.0, 0.0
        for m in range(6):
            above += (squares[m] / largest) ** sharpness
            below += (smallest / squares[m]) ** sharpness
        value = math.sqrt(largest / smallest) * (above * below) ** (0.5 / sharpness)
        values[k] = value
        for m in range(6):
            share[m] = (squares[m] / largest) ** sharpness / above
            share[m] -= (smallest / squares[m]) ** sharpness / below
        for i in range(6):
            for j in range(n):
                total = 0.0
                for m in range(6):
                    total += share[m] / squares[m] * Q[m, i] * B[m, j]
                G[i, j] = value * total
        contract(J, G, gradients[k])
