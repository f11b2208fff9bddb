"""Joint positions along straight paths: many paths at once, each on one continuous branch.

A path starts from a posture at its midpoint, which sets the midpoint's position, the orientation
and the branch. Newton's method then carries the posture from point to point, both ways, to rounding
of the pose; a redundant arm takes the shortest step in its joints. All paths go at once, so that a
search can try every branch of many placements.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.numerics.ties import whole_turns
from wrenchsight.models.planning.motion.damped_least_squares import (
    ApproachSettings,
    approach,
)
from wrenchsight.models.rigid_body.serial_chain import SerialChain

_POSE_AIM = 1e-11  # m and rad of the pose
# Far from W's origin rounding may stand above the aim; an arm's length is not.
_POSE_TOLERANCE = 10.0 * _POSE_AIM
# From one point to the next: Newton's method doubles the digits each time.
_NEXT_POINT = ApproachSettings(max_steps=12, aim=_POSE_AIM, damped=False)
# from a start that may lie far off
_FAR_START_SETTINGS = ApproachSettings(max_steps=60, aim=_POSE_AIM)


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
        chain: of the arm, with six joints or more.
        q_mid: (N, n) postures at the midpoints.
        n_W: (N, 3) unit directions.
        path_length: m.
        num_segments: k; a path has k + 1 points at even distances.
        max_joint_step: rad or m from one point to the next; a path that needs more is given up.

    Returns:
        q (N, k + 1, n), and (N,) whether every point was reached; where not, the points from the
        first failure outwards hold no numbers of use. Joint limits are not checked.
    """
    q_mid, n_W = np.asarray(q_mid, dtype=np.float64), np.asarray(n_W, dtype=np.float64)
    k = num_segments
    R_WE, p_WM = chain.pose(q_mid)
    q = np.empty((len(q_mid), k + 1, chain.num_joints))
    is_reached = np.ones(len(q_mid), dtype=np.bool_)
    q[:, k // 2] = q_mid  # of an odd k replaced below
    # Even k: from the middle point outwards. Odd: the first point is half a step away.
    for side in (range(k // 2 + 1, k + 1), range((k + 1) // 2 - 1, -1, -1)):
        # Postures (N, n) at the last two points of a side; `step_ratio` is the length of the next
        # step by that of the last, 0 before the first.
        last_but_one, previous, step_ratio = q_mid, q_mid, 0.0
        for i in side:
            rows = np.flatnonzero(is_reached)  # of the paths that go on, on this side or the other
            # The joints continue their last step.
            q_point = previous[rows] + step_ratio * (previous[rows] - last_but_one[rows])
            goal = p_WM[rows] + (i / k - 0.5) * path_length * n_W[rows]
            errors = approach(chain, R_WE[rows], goal, q_point, _NEXT_POINT)  # moves q_point
            step = np.abs(q_point - previous[rows])
            is_reached[rows] = (errors < _POSE_TOLERANCE) & np.all(step <= max_joint_step, axis=1)
            last_but_one, previous = previous, previous.copy()
            previous[rows] = q[rows, i] = q_point
            # Of an odd k the first step is half as long as the next.
            step_ratio = 2.0 if i == side[0] and k % 2 == 1 else 1.0
    return q, is_reached


def solve_poses(
    chain: SerialChain, R_WE: ArrayLike, p_WE: ArrayLike, q_start: ArrayLike
) -> tuple[Array, Flags]:
    """Postures that bring E to given poses, each searched from its own start.

    Args:
        R_WE: (N, 3, 3).
        p_WE: (N, 3) m.
        q_start: (N, n).

    Returns:
        q (N, n), and (N,) whether the pose was reached to rounding. Joint limits are not checked,
        and angles may have made whole turns.
    """
    q = np.array(q_start, dtype=np.float64)
    return q, approach(chain, R_WE, p_WE, q, _FAR_START_SETTINGS) < _POSE_TOLERANCE


def wrap_within(q: Array, lower: ArrayLike, upper: ArrayLike, prismatic: Flags) -> Array:
    """The same postures (..., n) with angles within the limits, and nearest to their middle.

    An angle that no whole turn brings within them stays outside.
    """
    lower, upper = np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64)
    with np.errstate(invalid="ignore"):  # inf - inf
        middle = 0.5 * (lower + upper)
    middle = np.where(np.isfinite(middle), middle, 0.0)
    turns = whole_turns(q - middle)
    return np.asarray(q - np.where(prismatic, 0.0, 2.0 * math.pi * turns))


def correct_paths(
    chain: SerialChain, q: Array, n_W: Array, p_WM: Array, R_WE: Array, path_length: float
) -> Flags:
    """Moves postures near the points of paths onto them, in place, each by itself.

    Args:
        q: (N, k + 1, n), changed.
        n_W, p_WM: (N, 3) directions and midpoints, m.
        R_WE: (N, 3, 3).
        path_length: m.

    Returns:
        (N,) whether every point was reached.
    """
    along = path_length * (np.linspace(0.0, 1.0, q.shape[1]) - 0.5)[:, np.newaxis]
    p_WE = p_WM[:, np.newaxis] + along * n_W[:, np.newaxis]
    R = np.broadcast_to(R_WE[:, np.newaxis], (*q.shape[:2], 3, 3)).reshape(-1, 3, 3)
    flat = q.reshape(-1, q.shape[2])
    errors = approach(chain, R, p_WE.reshape(-1, 3), flat, _NEXT_POINT)
    q[:] = flat.reshape(q.shape)
    return np.asarray((errors < _POSE_TOLERANCE).reshape(q.shape[:2]).all(axis=1))
