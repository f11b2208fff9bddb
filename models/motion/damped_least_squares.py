"""Kernels that bring E to a pose from a posture nearby: damped least squares, to rounding.

The step is J^T (J J^T + damping 1)^-1 error (Wampler, 1986). The damping is the square of the error
and vanishes with it, so that the last steps are Newton's own.
"""

import math

import numpy as np
from numba import prange

from wrenchsight.models.arrays import Array
from wrenchsight.models.kernel import kernel
from wrenchsight.models.rigid_body.chain_kernels import SCRATCH_COLUMNS, pose_and_jacobian
from wrenchsight.models.rigid_body.rotations import rotation_vector
from wrenchsight.models.rigid_body.small_matrices import factorise_in_place, solve_factorised

Space = tuple[Array, Array, Array, Array, Array, Array, Array, Array]
"""Scratch of the kernels: R (3, 3), p (3,), J (6, n), error (6,), step (n,), a matrix (7, 6),
a rotation (3, 3), and the chain's."""

_LARGEST_DAMPING = 1e-4
_LONGEST_STEP = 0.5  # rad or m, of a joint in one step
_SAME = 1e-15  # rad or m; a shorter step changes nothing
_SINGULAR = 1e-20  # least pivot of the matrix
_BLOCK = 8  # postures that a thread takes at a time


@kernel
def space_of(n: int) -> Space:
    """Scratch for a chain of n joints."""
    return (
        np.empty((3, 3)),
        np.empty(3),
        np.empty((6, n)),
        np.empty(6),
        np.empty(n),
        np.empty((7, 6)),
        np.empty((3, 3)),
        np.empty((n, SCRATCH_COLUMNS)),
    )


@kernel
def pose_error(
    R: Array, p: Array, R_goal: Array, p_goal: Array, error: Array, turn: Array
) -> float:
    """Writes the rotation vector and translation (6,) in W from (R, p) to the goal.

    Args:
        turn: (3, 3) scratch.

    Returns:
        Its length, of rad and m.
    """
    for i in range(3):
        for k in range(3):
            turn[i, k] = R_goal[i, 0] * R[k, 0] + R_goal[i, 1] * R[k, 1] + R_goal[i, 2] * R[k, 2]
        error[3 + i] = p_goal[i] - p[i]
    rotation_vector(turn, error)
    total = 0.0
    for i in range(6):
        total += error[i] * error[i]
    return math.sqrt(total)


@kernel
def damped_step(J: Array, error: Array, damping: float, step: Array, A: Array) -> bool:
    """step = J^T y of y = (J J^T + damping 1)^-1 error; False where the matrix is singular.

    Args:
        A: (7, 6) scratch; its last row is y afterwards.
    """
    n = J.shape[1]
    for i in range(6):
        for j in range(i + 1):
            total = damping if i == j else 0.0
            for k in range(n):
                total += J[i, k] * J[j, k]
            A[i, j] = total
        A[6, i] = error[i]
    if not factorise_in_place(A, 6, _SINGULAR):
        return False
    solve_factorised(A, 6, A[6])
    for k in range(n):
        total = 0.0
        for i in range(6):
            total += J[i, k] * A[6, i]
        step[k] = total
    return True


@kernel
def approach_pose(
    table: Array,
    lower: Array,
    upper: Array,
    R_goal: Array,
    p_goal: Array,
    q: Array,
    max_steps: int,
    damped: bool,
    limited: bool,
    aim: float,
    space: Space,
) -> float:
    """Moves q (n,) in place until the error is below `aim` or the steps are used up.

    Args:
        table: of SerialChain.
        lower, upper: (n,) limits that each step keeps to where `limited`; else not read.
        damped: False takes Newton's steps from the start.

    Returns:
        The remaining error, of rad and m; inf where the chain is singular without damping, NaN
        where the goal is not finite.
    """
    R, p, J, error, step, A, turn, scratch = space
    pose_and_jacobian(table, q, R, p, J, scratch)
    size = pose_error(R, p, R_goal, p_goal, error, turn)
    for _ in range(max_steps):
        if size < aim or not math.isfinite(size):
            break
        damping = min(_LARGEST_DAMPING, size * size) if damped else 0.0
        if not damped_step(J, error, damping, step, A):
            return math.inf
        largest = 0.0
        for j in range(q.shape[0]):
            largest = max(largest, abs(step[j]))
        if largest < _SAME:
            break
        scale = _LONGEST_STEP / largest if largest > _LONGEST_STEP else 1.0
        for j in range(q.shape[0]):
            q[j] += scale * step[j]
            if limited:
                q[j] = min(max(q[j], lower[j]), upper[j])
        pose_and_jacobian(table, q, R, p, J, scratch)
        size = pose_error(R, p, R_goal, p_goal, error, turn)
    return size


@kernel(parallel=True)
def approach_poses(
    table: Array,
    lower: Array,
    upper: Array,
    R_goal: Array,
    p_goal: Array,
    q: Array,
    max_steps: int,
    damped: bool,
    limited: bool,
    aim: float,
    left: Array,
) -> None:
    """`approach_pose` for many: q (M, n) towards R_goal (M, 3, 3), p_goal (M, 3); errors `left`."""
    M, n = q.shape
    for b in prange((M + _BLOCK - 1) // _BLOCK):
        space = space_of(n)
        for m in range(b * _BLOCK, min(M, (b + 1) * _BLOCK)):
            left[m] = approach_pose(
                table,
                lower,
                upper,
                R_goal[m],
                p_goal[m],
                q[m],
                max_steps,
                damped,
                limited,
                aim,
                space,
            )
