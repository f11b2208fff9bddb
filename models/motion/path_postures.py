"""Joint positions along straight paths: many paths at once, each on one continuous branch.

A path starts from a posture at its midpoint, which sets the midpoint's position, the orientation
and the branch. Newton's method then carries the posture from point to point, both ways, to rounding
of the pose; a redundant arm takes the shortest step in its joints. One kernel serves one path or
thousands, so that a search can try every branch of many placements at once.
"""

import math

import numpy as np
from numba import prange
from numpy.typing import ArrayLike

from wrenchsight.models.arrays import Array, Flags
from wrenchsight.models.kernel import kernel
from wrenchsight.models.motion.damped_least_squares import (
    Space,
    approach_pose,
    damped_step,
    space_of,
)
from wrenchsight.models.rigid_body.chain_kernels import pose_and_jacobian
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.rigid_body.ties import whole_turns

_REACHED = 1e-11  # m and rad of the pose
_MAX_STEPS = 12  # of Newton's method from one point to the next: it doubles the digits each time


def track_paths(
    chain: SerialChain,
    q_mid: ArrayLike,
    n_W: ArrayLike,
    path_length: float,
    num_segments: int,
    max_joint_step: float = 1.0,
) -> tuple[Array, Flags]:
    """Postures along straight paths of E with a fixed orientation.

    Args:
        q_mid: (N, n) postures at the midpoints.
        n_W: (N, 3) unit directions.
        path_length: m.
        num_segments: k; a path has k + 1 points at even distances.
        max_joint_step: rad or m from one point to the next; a path that needs more is given up.

    Returns:
        q (N, k + 1, n), and (N,) whether every point was reached. Joint limits are not looked at.
    """
    q_mid = np.ascontiguousarray(q_mid, dtype=np.float64)
    n_W = np.ascontiguousarray(n_W, dtype=np.float64)
    q = np.empty((len(q_mid), num_segments + 1, chain.num_joints))
    reached = np.zeros(len(q_mid), dtype=np.bool_)
    _track_batch(chain.table, q_mid, n_W, path_length, max_joint_step, q, reached)
    return q, reached


def solve_poses(
    chain: SerialChain, R_WE: ArrayLike, p_WE: ArrayLike, q_start: ArrayLike, max_steps: int = 60
) -> tuple[Array, Flags]:
    """Postures that bring E to given poses, each searched from its own start.

    Args:
        R_WE: (N, 3, 3).
        p_WE: (N, 3) m.
        q_start: (N, n).
        max_steps: of damped Newton's method.

    Returns:
        q (N, n), and (N,) whether the pose was reached to rounding. Joint limits are not looked at,
        and angles may have made whole turns.
    """
    q = np.array(q_start, dtype=np.float64)
    reached = np.zeros(len(q), dtype=np.bool_)
    _solve_batch(
        chain.table,
        np.ascontiguousarray(R_WE, dtype=np.float64),
        np.ascontiguousarray(p_WE, dtype=np.float64),
        q,
        max_steps,
        reached,
    )
    return q, reached


def wrap_within(q: Array, lower: ArrayLike, upper: ArrayLike, prismatic: Flags) -> Array:
    """The same postures (..., n) with angles within the limits, and nearest to their middle.

    An angle that no whole turn brings within them stays outside.
    """
    lower, upper = np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64)
    middle = 0.5 * (lower + upper)
    middle = np.where(np.isfinite(middle), middle, 0.0)
    turns = whole_turns(q - middle)
    return np.asarray(q - np.where(prismatic, 0.0, 2.0 * math.pi * turns))


@kernel
def _reach(
    table: Array,
    R_goal: Array,
    p_goal: Array,
    q: Array,
    max_steps: int,
    damped: bool,
    space: Space,
) -> bool:
    """Brings q (n,), in place, to one pose, whatever its limits; whether it is reached."""
    left = approach_pose(table, q, q, R_goal, p_goal, q, max_steps, damped, False, _REACHED, space)
    # Far from W's origin rounding may stand above the aim; an arm's length is not.
    return left < 10.0 * _REACHED


@kernel
def _track(
    table: Array,
    q_mid: Array,
    n_W: Array,
    path_length: float,
    max_joint_step: float,
    q: Array,
    space: Space,
) -> bool:
    """Fills q (k + 1, n); whether every point was reached."""
    k = q.shape[0] - 1
    n = q.shape[1]
    R_mid, p_mid, p_goal = np.empty((3, 3)), np.empty(3), np.empty(3)
    pose_and_jacobian(table, q_mid, R_mid, p_mid, space[2], space[7])
    guess, before = np.empty(n), np.empty(n)
    if k % 2 == 0:
        q[k // 2] = q_mid
    for side in range(2):
        # Even k: from the middle point outwards. Odd: the first point is half a step away.
        first = k // 2 + 1 if side == 0 else (k + 1) // 2 - 1
        last = k + 1 if side == 0 else -1
        direction = 1 if side == 0 else -1
        before[:] = q_mid
        moved = 0.0
        for i in range(first, last, direction):
            along = (i / k - 0.5) * path_length
            for c in range(3):
                p_goal[c] = p_mid[c] + along * n_W[c]
            previous = q_mid if i == first else q[i - direction]
            # The joints go on as they went.
            for j in range(n):
                guess[j] = previous[j] + moved * (previous[j] - before[j])
            before[:] = previous
            moved = 2.0 if i == first and k % 2 == 1 else 1.0
            if not _reach(table, R_mid, p_goal, guess, _MAX_STEPS, False, space):
                return False
            for j in range(n):
                if abs(guess[j] - previous[j]) > max_joint_step:
                    return False
            q[i] = guess
    return True


@kernel(parallel=True)
def _track_batch(
    table: Array,
    q_mid: Array,
    n_W: Array,
    path_length: float,
    max_joint_step: float,
    q: Array,
    reached: Flags,
) -> None:
    N, n = q_mid.shape
    blocks = (N + 7) // 8
    for b in prange(blocks):
        space = space_of(n)
        for i in range(8 * b, min(N, 8 * b + 8)):
            reached[i] = _track(table, q_mid[i], n_W[i], path_length, max_joint_step, q[i], space)


@kernel(parallel=True)
def _solve_batch(
    table: Array, R_WE: Array, p_WE: Array, q: Array, max_steps: int, reached: Flags
) -> None:
    N, n = q.shape
    for b in prange((N + 7) // 8):
        space = space_of(n)
        for i in range(8 * b, min(N, 8 * b + 8)):
            reached[i] = _reach(table, R_WE[i], p_WE[i], q[i], max_steps, True, space)


def correct_paths(
    chain: SerialChain, q: Array, n_W: Array, p_WM: Array, R_WE: Array, path_length: float
) -> Flags:
    """Brings postures near the points of paths onto them, in place, each by itself.

    Args:
        q: (N, k + 1, n), changed.
        n_W, p_WM: (N, 3) directions and midpoints, m.
        R_WE: (N, 3, 3).
        path_length: m.

    Returns:
        (N,) whether every point was reached.
    """
    reached = np.zeros(len(q), dtype=np.bool_)
    _correct_batch(chain.table, q, n_W, p_WM, R_WE, path_length, reached)
    return reached


def pull_back(chain: SerialChain, q: Array, by_q: Array, path_length: float) -> tuple[Array, Array]:
    """Turns a gradient by the postures of paths into one by the paths themselves.

    Args:
        q: (N, k + 1, n) postures on their paths.
        by_q: (N, k + 1, n) gradient by them.
        path_length: m.

    Returns:
        (N, 9) gradient by a turn of the tool (rotation vector in W), by p_WM and by n_W, with the
        postures following by the shortest joint motion; and (N, k + 1, n) the part of by_q along
        motions of a redundant arm that leave E where it is (zero for six joints).
    """
    by_path = np.zeros((len(q), 9))
    left = np.zeros_like(q)
    _pull_back_batch(chain.table, q, by_q, path_length, by_path, left)
    return by_path, left


@kernel(parallel=True)
def _correct_batch(
    table: Array, q: Array, n_W: Array, p_WM: Array, R_WE: Array, path_length: float, reached: Flags
) -> None:
    N, count, n = q.shape
    for i in prange(N):
        space = space_of(n)
        p_goal = np.empty(3)
        good = True
        for k in range(count):
            along = (k / (count - 1) - 0.5) * path_length
            for c in range(3):
                p_goal[c] = p_WM[i, c] + along * n_W[i, c]
            good = good and _reach(table, R_WE[i], p_goal, q[i, k], _MAX_STEPS, False, space)
        reached[i] = good


@kernel(parallel=True)
def _pull_back_batch(
    table: Array, q: Array, by_q: Array, path_length: float, by_path: Array, left: Array
) -> None:
    N, count, n = q.shape
    for i in prange(N):
        R, p, J, y, step, A, _, scratch = space_of(n)
        for k in range(count):
            pose_and_jacobian(table, q[i, k], R, p, J, scratch)
            for r in range(6):
                total = 0.0
                for j in range(n):
                    total += J[r, j] * by_q[i, k, j]
                y[r] = total
            if not damped_step(J, y, 0.0, step, A):
                continue
            # A[6] = (J J^T)^-1 J by_q, the gradient by the pose; step = J^+ J by_q.
            along = (k / (count - 1) - 0.5) * path_length
            for r in range(3):
                by_path[i, r] += A[6, r]
                by_path[i, 3 + r] += A[6, 3 + r]
                by_path[i, 6 + r] += along * A[6, 3 + r]
            if n > 6:
                for j in range(n):
                    left[i, k, j] = by_q[i, k, j] - step[j]
