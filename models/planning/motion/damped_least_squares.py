"""Inverse kinematics from postures nearby: damped least squares, to rounding.

The step is J^T (J J^T + damping 1)^-1 error (Wampler, 1986). The damping is the square of the error
and vanishes with it, so that the last steps are Newton's own.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import prange
from numpy.typing import ArrayLike

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.numerics.small_matrices import factorise_in_place, solve_factorised
from wrenchsight.models.rigid_body.chain_kernels import SCRATCH_COLUMNS, pose_and_jacobian
from wrenchsight.models.rigid_body.rotations import rotation_vector
from wrenchsight.models.rigid_body.serial_chain import SerialChain

_MAX_DAMPING = 1e-4  # in m^2 and rad^2; far from the goal a step is then short where J is singular
_MAX_STEP = 0.5  # rad or m, of a joint in one step
_MIN_STEP = 1e-15  # rad or m; a shorter step changes nothing
_MIN_PIVOT = 1e-20  # least pivot of J J^T + damping 1; below it the step is rounding
_BLOCK_POSTURES = 8  # postures that a thread takes at a time


@kernel
def goal_minus_pose(R: Array, p: Array, R_goal: Array, p_goal: Array, error: Array) -> float:
    """Writes the rotation vector and translation (6,) in W from (R, p) to the goal.

    Returns:
        Its length, of rad and m.
    """
    turn = np.empty((3, 3))  # R_goal R^T
    for i in range(3):
        for k in range(3):
            turn[i, k] = R_goal[i, 0] * R[k, 0] + R_goal[i, 1] * R[k, 1] + R_goal[i, 2] * R[k, 2]
        error[3 + i] = p_goal[i] - p[i]
    rotation_vector(turn, error)
    return math.sqrt(np.sum(error * error))


@kernel
def damped_step(J: Array, error: Array, damping: float, step: Array) -> bool:
    """Writes step = J^T y with y = (J J^T + damping 1)^-1 error.

    Returns:
        False where the matrix is singular.
    """
    matrix, y = np.empty((6, 6)), error.copy()
    for i in range(6):
        for j in range(i + 1):
            matrix[i, j] = damping if i == j else 0.0
            for k in range(J.shape[1]):
                matrix[i, j] += J[i, k] * J[j, k]
    if not factorise_in_place(matrix, 6, _MIN_PIVOT):
        return False
    solve_factorised(matrix, 6, y)
    for k in range(J.shape[1]):
        step[k] = 0.0
        for i in range(6):
            step[k] += J[i, k] * y[i]
    return True


class ApproachSettings(NamedTuple):
    """Settings of `approach`.

    Attributes:
        max_steps: largest number of steps of each posture.
        aim: rad and m, error below which a posture is left.
        damped: False takes Newton's steps from the start.
    """

    max_steps: int
    aim: float
    damped: bool = True


def approach(
    chain: SerialChain,
    R_WE: ArrayLike,
    p_WE: ArrayLike,
    q: Array,
    settings: ApproachSettings,
    limits: tuple[Array, Array] | None = None,
) -> Array:
    """Moves each q (M, n) in place towards its pose until its error is below the aim.

    Args:
        chain: of the arm.
        R_WE, p_WE: (M, 3, 3), and (M, 3) in m.
        q: (M, n), contiguous, changed.
        settings: aim, largest number of steps, and whether these are damped.
        limits: lower and upper (n,), within which each step ends; None: anywhere.

    Returns:
        (M,) the remaining errors, rad and m; inf where the chain is singular without damping, NaN
        where the goal is not finite.
    """
    errors, no_limit = np.empty(len(q)), np.full(chain.num_joints, np.inf)
    lower, upper = (-no_limit, no_limit) if limits is None else limits
    R = np.ascontiguousarray(R_WE, dtype=np.float64)
    p = np.ascontiguousarray(p_WE, dtype=np.float64)
    bounds = _Bounds(np.array(lower), np.array(upper))
    _approach(chain.table, _Goals(R, p), bounds, settings, q, errors)
    return errors


class _Goals(NamedTuple):
    """Poses of E in W to reach: R (M, 3, 3) and p (M, 3), m."""

    R: Array
    p: Array


class _Bounds(NamedTuple):
    """Bounds (n,) of the joints, rad or m."""

    lower: Array
    upper: Array


@kernel(parallel=True)
def _approach(
    table: Array,
    goals: _Goals,
    bounds: _Bounds,
    settings: ApproachSettings,
    q: Array,
    errors: Array,
) -> None:
    """Writes q (M, n) and the remaining errors (M,), as `approach`."""
    M = q.shape[0]
    for block in prange((M + _BLOCK_POSTURES - 1) // _BLOCK_POSTURES):
        for m in range(block * _BLOCK_POSTURES, min(M, (block + 1) * _BLOCK_POSTURES)):
            errors[m] = _approach_one(table, goals.R[m], goals.p[m], bounds, settings, q[m])


@kernel
def _approach_one(
    table: Array,
    R_goal: Array,
    p_goal: Array,
    bounds: _Bounds,
    settings: ApproachSettings,
    q: Array,
) -> float:
    """Moves one q (n,) in place towards its pose; returns the remaining error, as `approach`.

    Args:
        table: SerialChain.table.
        R_goal, p_goal: (3, 3), and (3,) in m, pose of E in W.
        bounds: each step ends within them.
        settings: after `max_steps`, or below `aim`, the search ends.
    """
    n = q.shape[0]
    R, p, J, links = np.empty((3, 3)), np.empty(3), np.empty((6, n)), np.empty((n, SCRATCH_COLUMNS))
    error, step = np.empty(6), np.empty(n)
    pose_and_jacobian(table, q, R, p, J, links)
    error_size = goal_minus_pose(R, p, R_goal, p_goal, error)
    for _ in range(settings.max_steps):
        if error_size < settings.aim or not math.isfinite(error_size):
            break
        damping = min(_MAX_DAMPING, error_size * error_size) if settings.damped else 0.0
        if not damped_step(J, error, damping, step):
            return math.inf
        largest_step = np.max(np.abs(step))
        if largest_step < _MIN_STEP:
            break
        step *= min(1.0, _MAX_STEP / largest_step)
        q[:] = np.minimum(np.maximum(q + step, bounds.lower), bounds.upper)
        pose_and_jacobian(table, q, R, p, J, links)
        error_size = goal_minus_pose(R, p, R_goal, p_goal, error)
    return float(error_size)
