"""Joint positions along straight paths: many paths at once, each on one continuous branch.

A path starts from a posture at its midpoint, which sets the midpoint's position, the orientation
and the branch. Newton's method then carries the posture from point to point, both ways, to rounding
of the pose; a redundant arm takes the shortest step in its joints. One kernel serves one path or
thousands, so that a search can try every branch of many placements at once.
"""

import math

import numpy as np
from numba import njit, prange
from numpy.typing import ArrayLike

from models.arrays import Array, Flags
from models.rigid_body.chain_kernels import SCRATCH_COLUMNS, pose_and_jacobian
from models.rigid_body.serial_chain import SerialChain
from models.rigid_body.ties import whole_turns

_REACHED = 1e-11  # m and rad of the pose
_MAX_STEPS = 12  # of Newton's method from one point to the next: it doubles the digits each time
_LONGEST_STEP = 0.5  # rad or m, of a joint in one Newton step


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


@njit(cache=True, error_model="numpy")
def quaternion_of(R, quaternion):  # type: ignore[no-untyped-def]
    """Writes the unit quaternion (w, x, y, z) of a rotation matrix; its sign is arbitrary."""
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    if trace > 0.0:
        s = 2.0 * math.sqrt(1.0 + trace)
        quaternion[0] = 0.25 * s
        quaternion[1] = (R[2, 1] - R[1, 2]) / s
        quaternion[2] = (R[0, 2] - R[2, 0]) / s
        quaternion[3] = (R[1, 0] - R[0, 1]) / s
        return
    i = 0
    if R[1, 1] > R[0, 0]:
        i = 1
    if R[2, 2] > R[i, i]:
        i = 2
    j, k = (i + 1) % 3, (i + 2) % 3
    s = 2.0 * math.sqrt(1.0 + R[i, i] - R[j, j] - R[k, k])
    quaternion[0] = (R[k, j] - R[j, k]) / s
    quaternion[1 + i] = 0.25 * s
    quaternion[1 + j] = (R[j, i] + R[i, j]) / s
    quaternion[1 + k] = (R[k, i] + R[i, k]) / s


@njit(cache=True, error_model="numpy")
def _pose_error(R, p, R_goal, p_goal, error, work):  # type: ignore[no-untyped-def]
    """Writes the rotation vector and translation in W from (R, p) to the goal; returns its size."""
    D = work[0:3]
    quaternion = work[3]
    for i in range(3):
        for j in range(3):
            D[i, j] = R_goal[i, 0] * R[j, 0] + R_goal[i, 1] * R[j, 1] + R_goal[i, 2] * R[j, 2]
    quaternion_of(D, quaternion)
    w, x, y, z = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    sine = math.sqrt(x * x + y * y + z * z)
    factor = 2.0
    if sine > 1e-8:
        factor = 2.0 * math.atan2(sine, abs(w)) / sine
    if w < 0.0:
        factor = -factor
    error[0], error[1], error[2] = factor * x, factor * y, factor * z
    total = error[0] ** 2 + error[1] ** 2 + error[2] ** 2
    for i in range(3):
        error[3 + i] = p_goal[i] - p[i]
        total += error[3 + i] ** 2
    return math.sqrt(total)


@njit(cache=True, error_model="numpy")
def _damped_step(J, error, damping, step, A):  # type: ignore[no-untyped-def]
    """step = J^T (J J^T + damping 1)^-1 error, by Cholesky; False where the matrix is singular."""
    n = J.shape[1]
    for i in range(6):
        for j in range(i + 1):
            total = damping if i == j else 0.0
            for k in range(n):
                total += J[i, k] * J[j, k]
            for k in range(j):
                total -= A[i, k] * A[j, k]
            if i == j:
                if not total > 1e-20:
                    return False
                A[i, i] = math.sqrt(total)
            else:
                A[i, j] = total / A[j, j]
    for i in range(6):
        total = error[i]
        for k in range(i):
            total -= A[i, k] * A[6, k]
        A[6, i] = total / A[i, i]
    for i in range(5, -1, -1):
        total = A[6, i]
        for k in range(i + 1, 6):
            total -= A[k, i] * A[6, k]
        A[6, i] = total / A[i, i]
    for k in range(n):
        total = 0.0
        for i in range(6):
            total += J[i, k] * A[6, i]
        step[k] = total
    return True


@njit(cache=True, error_model="numpy")
def _solve(table, R_goal, p_goal, q, max_steps, damped, space):  # type: ignore[no-untyped-def]
    """Newton's method for one pose, q (n,) in place; whether it is reached."""
    R, p, J, error, step, A, work, scratch = space
    for _ in range(max_steps):
        pose_and_jacobian(table, q, R, p, J, scratch)
        size = _pose_error(R, p, R_goal, p_goal, error, work)
        if size < _REACHED:
            return True
        if not math.isfinite(size):
            return False
        # Damping that vanishes with the error keeps the last steps Newton's own.
        damping = min(1e-2, size) ** 2 if damped else 0.0
        if not _damped_step(J, error, damping, step, A):
            return False
        largest = 0.0
        for j in range(q.shape[0]):
            largest = max(largest, abs(step[j]))
        scale = _LONGEST_STEP / largest if largest > _LONGEST_STEP else 1.0
        for j in range(q.shape[0]):
            q[j] += scale * step[j]
    pose_and_jacobian(table, q, R, p, J, scratch)
    # Far from W's origin rounding may stand above the aim; an arm's length is not.
    return bool(_pose_error(R, p, R_goal, p_goal, error, work) < 10.0 * _REACHED)


@njit(cache=True, error_model="numpy")
def _space(n):  # type: ignore[no-untyped-def]
    return (
        np.empty((3, 3)),
        np.empty(3),
        np.empty((6, n)),
        np.empty(6),
        np.empty(n),
        np.empty((7, 6)),
        np.empty((4, 4)),
        np.empty((n, SCRATCH_COLUMNS)),
    )


@njit(cache=True, error_model="numpy")
def _track(table, q_mid, n_W, path_length, max_joint_step, q, space):  # type: ignore[no-untyped-def]
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
            if not _solve(table, R_mid, p_goal, guess, _MAX_STEPS, False, space):
                return False
            for j in range(n):
                if abs(guess[j] - previous[j]) > max_joint_step:
                    return False
            q[i] = guess
    return True


@njit(cache=True, error_model="numpy", parallel=True)
def _track_batch(table, q_mid, n_W, path_length, max_joint_step, q, reached):  # type: ignore[no-untyped-def]
    N, n = q_mid.shape
    blocks = (N + 7) // 8
    for b in prange(blocks):
        space = _space(n)
        for i in range(8 * b, min(N, 8 * b + 8)):
            reached[i] = _track(table, q_mid[i], n_W[i], path_length, max_joint_step, q[i], space)


@njit(cache=True, error_model="numpy", parallel=True)
def _solve_batch(table, R_WE, p_WE, q, max_steps, reached):  # type: ignore[no-untyped-def]
    N, n = q.shape
    for b in prange((N + 7) // 8):
        space = _space(n)
        for i in range(8 * b, min(N, 8 * b + 8)):
            reached[i] = _solve(table, R_WE[i], p_WE[i], q[i], max_steps, True, space)


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
    """What a gradient by the postures of paths is by the paths themselves.

    Args:
        q: (N, k + 1, n) postures on their paths.
        by_q: (N, k + 1, n) gradient by them.
        path_length: m.

    Returns:
        (N, 9) gradient by a turn of the tool (rotation vector in W), by p_WM and by n_W, with the
        postures following by the shortest joint motion; and (N, k + 1, n) what is left of by_q for
        motions of a redundant arm that leave E where it is (zero for six joints).
    """
    by_path = np.zeros((len(q), 9))
    left = np.zeros_like(q)
    _pull_back_batch(chain.table, q, by_q, path_length, by_path, left)
    return by_path, left


@njit(cache=True, error_model="numpy", parallel=True)
def _correct_batch(table, q, n_W, p_WM, R_WE, path_length, reached):  # type: ignore[no-untyped-def]
    N, count, n = q.shape
    for i in prange(N):
        space = _space(n)
        p_goal = np.empty(3)
        good = True
        for k in range(count):
            along = (k / (count - 1) - 0.5) * path_length
            for c in range(3):
                p_goal[c] = p_WM[i, c] + along * n_W[i, c]
            good = good and _solve(table, R_WE[i], p_goal, q[i, k], _MAX_STEPS, False, space)
        reached[i] = good


@njit(cache=True, error_model="numpy", parallel=True)
def _pull_back_batch(table, q, by_q, path_length, by_path, left):  # type: ignore[no-untyped-def]
    N, count, n = q.shape
    for i in prange(N):
        R, p, J, y, step, A, _, scratch = _space(n)
        for k in range(count):
            pose_and_jacobian(table, q[i, k], R, p, J, scratch)
            for r in range(6):
                total = 0.0
                for j in range(n):
                    total += J[r, j] * by_q[i, k, j]
                y[r] = total
            if not _damped_step(J, y, 0.0, step, A):
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
