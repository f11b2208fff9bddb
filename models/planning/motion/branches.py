"""Inverse kinematics: all postures for many poses of E at once.

A map of the workspace or a search over the free angle of a tool needs thousands. Arms of six
revolute joints whose axes EAIK can decompose are solved by it pose by pose; wrapping, polishing and
checking are done for all of them together. Every other arm is solved by damped least squares from
several starting points a pose, which finds postures but cannot promise all of them. In either case
a solution counts once forward kinematics confirms it.
"""

import itertools
import math
from functools import lru_cache
from typing import Any

import numpy as np
from eaik.pybindings.EAIK import Robot as EaikRobot
from numpy.typing import ArrayLike, NDArray

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.planning.motion.damped_least_squares import (
    ApproachSettings,
    approach,
)
from wrenchsight.models.planning.motion.path_postures import wrap_within
from wrenchsight.models.robot.robot import Robot

_POSE_TOLERANCE = 1e-9  # m and rad, of the pose that a solution reaches
_POSE_ROUNDING = 1e-13  # of that pose; not worth another step
_PARALLEL_ANGLE = 1e-8  # rad; axes nearer than this are meant to be parallel
_AT_LIMIT = 1e-10  # rad or m; what a solution exceeds a limit by in rounding
_POLISH_SETTINGS = ApproachSettings(max_steps=6, aim=_POSE_ROUNDING)
_SEARCH_SETTINGS = ApproachSettings(max_steps=100, aim=_POSE_ROUNDING)
_NUM_SEEDS = 12  # starts of a search at a pose; more find more branches, in proportionate time


def is_closed_form(robot: Robot) -> bool:
    """Whether all branches are known; otherwise a search finds some."""
    return closed_form(robot) is not None


@lru_cache(maxsize=16)
def closed_form(robot: Robot) -> Any:
    """EAIK's solver for the arm; None where it has none."""
    chain = robot.chain
    if robot.num_joints != 6 or np.any(chain.prismatic):
        return None
    # Product of exponentials at q = 0: axes H and steps P from one joint to the next, both in W.
    R, p = np.eye(3), np.zeros(3)
    axes, steps = [], []
    for R_PJ, p_PJ, axis in zip(chain.R_PJ, chain.p_PJ, chain.axis, strict=True):
        steps.append(R @ p_PJ)
        p = p + steps[-1]
        R = R @ R_PJ
        axes.append(R @ axis)
    R_WE, p_WE = chain.pose(np.zeros(6))
    steps.append(p_WE - p)
    directions = _same_directions(np.array(axes))
    try:
        solver = EaikRobot(directions.T, np.array(steps).T, R_WE, [], True)
    except RuntimeError:  # a geometry that it takes for another one, and finds impossible
        return None
    return solver if solver.has_known_decomposition() else None


def _same_directions(axes: Array) -> Array:
    """Unit axes (n, 3); axes that are parallel within rounding are made exactly parallel.

    EAIK compares with zero bit by bit: with axes 1e-13 off it takes one kind of arm for another.
    Polishing corrects the solutions' error from this.
    """
    directions = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    for i in range(1, len(directions)):
        for j in range(i):
            if np.linalg.norm(np.cross(directions[i], directions[j])) < _PARALLEL_ANGLE:
                directions[i] = math.copysign(1.0, directions[i] @ directions[j]) * directions[j]
                break
    return np.asarray(directions)


def all_branches(
    robot: Robot,
    R_WE: ArrayLike,
    p_WE: ArrayLike,
    *,
    turns_of: NDArray[np.bool_] | None = None,
    seeds: ArrayLike | None = None,
) -> Array:
    """Joint positions within the limits that bring E to each of N poses.

    Args:
        robot: of any number of joints; its limits count.
        R_WE: (N, 3, 3) rotations of E in W.
        p_WE: (N, 3) positions of E in W, m.
        turns_of: (n,) flags of the joints of which an angle and the same a full turn further on are
            two solutions where both lie within the limits. Of the other joints (None: of all) only
            the one nearest to the middle of the limits is a solution; of two at half a turn from
            it the upper. (A search leaves an angle where it has found it, within the limits.)
        seeds: (S, n) or (N, S, n) starting points for an arm that is not solved in closed form, NaN
            in rows that hold none (they start at home); None: a fixed set.

    Returns:
        (N, B, n) with B the largest number of solutions of a pose; NaN in the rows beyond a pose's
        number. Each reaches its pose within 1e-9 (m, rad). Their order is the solver's, the same
        for poses that differ by rounding.
    """
    R = np.ascontiguousarray(R_WE, dtype=np.float64).reshape(-1, 3, 3)
    p = np.ascontiguousarray(p_WE, dtype=np.float64).reshape(-1, 3)
    lower, upper = np.array(robot.position_lower), np.array(robot.position_upper)
    solver = closed_form(robot)
    # q (M, n) are solutions in the order of their poses, pose_of (M,) the index of each one's pose;
    # `approach` moves q in place.
    if solver is not None:
        q, pose_of = _from_closed_form(robot, solver, R, p)
        q = _nearest_to_middle(robot, q)
        errors = approach(robot.chain, R[pose_of], p[pose_of], q, _POLISH_SETTINGS)
        q = _nearest_to_middle(robot, q)  # an angle half a turn from it may have passed it
    else:  # each start leads to one solution or none, within the limits
        starts = np.array(_starts(robot) if seeds is None else seeds, float)
        starts = np.broadcast_to(starts, (len(p), *starts.shape[-2:]))
        pose_of = np.repeat(np.arange(len(p)), starts.shape[1])
        q = np.ascontiguousarray(starts).reshape(-1, robot.num_joints).copy()
        q[~np.all(np.isfinite(q), axis=1)] = robot.home
        errors = approach(
            robot.chain, R[pose_of], p[pose_of], q, _SEARCH_SETTINGS, limits=(lower, upper)
        )
    is_reached = errors < _POSE_TOLERANCE
    if turns_of is not None:
        q, pose_of, is_reached = _with_turns(robot, q, pose_of, is_reached, turns_of)
    is_valid = is_reached & np.all((q >= lower - _AT_LIMIT) & (q <= upper + _AT_LIMIT), axis=1)
    return _by_pose(np.clip(q[is_valid], lower, upper), pose_of[is_valid], len(p))


def _from_closed_form(
    robot: Robot, solver: object, R: Array, p: Array
) -> tuple[Array, NDArray[np.intp]]:
    """Raw solutions (M, n), and the index (M,) of the pose that each belongs to."""
    poses = np.zeros((len(p), 4, 4))
    poses[:, :3, :3], poses[:, :3, 3], poses[:, 3, 3] = R, p, 1.0
    solved = [
        np.asarray(solution.Q, dtype=np.float64).reshape(-1, robot.num_joints)
        for solution in map(solver.calculate_IK, poses)  # type: ignore[attr-defined]
    ]
    row = np.repeat(np.arange(len(p)), [len(branches) for branches in solved])
    q = np.concatenate(solved) if solved else np.empty((0, robot.num_joints))
    finite = np.all(np.isfinite(q), axis=1)
    return np.ascontiguousarray(q[finite]), row[finite]


def _starts(robot: Robot) -> Array:
    """(_NUM_SEEDS, n) postures to search from: the robot's home and others, each time the same."""
    lower = np.where(np.isfinite(robot.position_lower), robot.position_lower, -math.pi)
    upper = np.where(np.isfinite(robot.position_upper), robot.position_upper, math.pi)
    random = np.random.default_rng(0).uniform(lower, upper, (_NUM_SEEDS - 1, robot.num_joints))
    return np.vstack([robot.home, random])


def _nearest_to_middle(robot: Robot, q: Array) -> Array:
    return wrap_within(q, robot.position_lower, robot.position_upper, robot.chain.prismatic)


def _with_turns(
    robot: Robot,
    q: Array,
    row: NDArray[np.intp],
    is_reached: NDArray[np.bool_],
    turns_of: NDArray[np.bool_],
) -> tuple[Array, NDArray[np.intp], NDArray[np.bool_]]:
    """Each solution with all whole turns of its joints for which the limits may have room."""
    span = robot.position_upper - robot.position_lower
    has_turns = turns_of & ~robot.chain.prismatic & np.isfinite(span) & (span > 2.0 * math.pi)
    turns = [
        [2.0 * math.pi * k for k in range(-_turns(s), _turns(s) + 1)] if is_wide else [0.0]
        for s, is_wide in zip(span, has_turns, strict=True)
    ]
    shifts = np.array(list(itertools.product(*turns)))
    shifted = (q[:, np.newaxis] + shifts).reshape(-1, q.shape[1])
    lower, upper = robot.position_lower - _AT_LIMIT, robot.position_upper + _AT_LIMIT
    is_inside = np.all((shifted >= lower) & (shifted <= upper), axis=1)
    return (
        shifted[is_inside],
        np.repeat(row, len(shifts))[is_inside],
        np.repeat(is_reached, len(shifts))[is_inside],
    )


def _turns(span: float) -> int:
    return math.ceil(span / (4.0 * math.pi))


def _by_pose(q: Array, row: NDArray[np.intp], num_poses: int) -> Array:
    """(N, B, n) from solutions (M, n) and the poses' indices (M,), which must not fall."""
    counts = np.bincount(row, minlength=num_poses)
    first = np.concatenate([[0], np.cumsum(counts)[:-1]])
    branches = np.full((num_poses, int(counts.max(initial=0)), q.shape[1]), np.nan)
    branches[row, np.arange(len(q)) - first[row]] = q
    return branches
