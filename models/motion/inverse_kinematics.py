"""Joint positions along a path of E: one continuous branch of an arm, in closed form for a 6R arm.

Arms of six revolute joints whose axes EAIK can decompose are solved in closed form. Every other arm
is solved by damped least squares from several starting points, which finds branches but cannot
promise all of them. Whatever the source, a solution counts once forward kinematics confirms it.
"""

import math
from functools import lru_cache
from typing import Any

import numpy as np
from eaik.pybindings.EAIK import Robot as EaikRobot
from scipy.spatial.transform import Rotation, Slerp

from wrenchsight.models.arrays import Array
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.motion.damped_least_squares import approach_pose, space_of
from wrenchsight.models.rigid_body.ties import in_order, whole_turns
from wrenchsight.models.robot.robot import Robot

_TOLERANCE = 1e-9  # m and rad, of the pose that a solution reaches
_ROUNDING = 1e-12  # of that pose; not worth another step
_PARALLEL = 1e-8  # rad; axes nearer than this are meant to be parallel
_SAME = 1e-6  # rad or m; by which a solution may exceed a limit
_STEP = 0.35  # rad or m; a larger step of a joint between two samples is looked into
_BISECTIONS = 7  # of the path between two samples, before the step counts as a jump
_NUMERIC_SEEDS = 24


def follow_path(robot: Robot, R_WE: Array, p_WE: Array, q_seed: Array) -> Array:
    """Joint positions along a path of E, on the continuous branch that starts nearest to a seed.

    Between two samples the path is taken as straight in position and in rotation; where a joint
    moves far from one sample to the next, the path between them is followed too, so that a change
    of branch is an error and not a step.

    Args:
        R_WE: (N, 3, 3) or (3, 3) for a fixed orientation.
        p_WE: (N, 3) m.
        q_seed: (n,) the branch is the one nearest to it at the first sample.

    Returns:
        (N, n).

    Raises:
        InputError: a sample cannot be reached within the limits, or only by a jump; the line names
            the first such sample.
    """
    p_WE = np.atleast_2d(np.asarray(p_WE, dtype=np.float64))
    R_WE = np.broadcast_to(np.asarray(R_WE, dtype=np.float64), (len(p_WE), 3, 3))
    q = np.empty((len(p_WE), robot.num_joints))
    q[0] = _first(robot, R_WE[0], p_WE[0], np.asarray(q_seed, dtype=np.float64))
    for i in range(1, len(q)):
        start, end = (R_WE[i - 1], p_WE[i - 1]), (R_WE[i], p_WE[i])
        q[i] = _advance(robot, q[i - 1], start, end, i, _BISECTIONS)
    return q


def _first(robot: Robot, R_WE: Array, p_WE: Array, q_seed: Array) -> Array:
    q = _nearest(robot, R_WE, p_WE, q_seed)
    if q is None:
        raise _unreachable(robot, 0, p_WE)
    return q


def _advance(
    robot: Robot,
    q: Array,
    start: tuple[Array, Array],
    end: tuple[Array, Array],
    sample: int,
    bisections: int,
) -> Array:
    """The solution at `end` that continues `q`, which is one at `start`."""
    found = _nearest(robot, *end, q)
    if found is None:
        raise _unreachable(robot, sample, end[1])
    step = np.abs(found - q)
    if np.max(step) <= _STEP:
        return found
    if bisections == 0:
        joint = robot.joint_names[int(np.argmax(step))]
        raise InputError(
            "path",
            f"sample {sample}",
            f"{joint} of {robot.name} would have to jump by {np.max(step):.2f} to go on",
            "move or turn the path, or start on another branch",
        )
    rotations = Slerp([0.0, 1.0], Rotation.from_matrix(np.stack([start[0], end[0]])))
    middle = (rotations(0.5).as_matrix(), 0.5 * (start[1] + end[1]))
    q = _advance(robot, q, start, middle, sample, bisections - 1)
    return _advance(robot, q, middle, end, sample, bisections - 1)


def _unreachable(robot: Robot, sample: int, p_WE: Array) -> InputError:
    place = ", ".join(f"{value:.4f}" for value in p_WE)
    return InputError(
        "path",
        f"sample {sample}",
        f"{robot.name} cannot reach ({place}) m in this orientation within its joint limits",
        "move, turn or shorten the path",
    )


def _nearest(robot: Robot, R_WE: Array, p_WE: Array, reference: Array) -> Array | None:
    """The confirmed solution within the limits that is nearest to `reference`; None: there is none.

    In closed form it is chosen among all branches; of equally near ones the solver's first.
    Otherwise it is what the search finds from `reference`, or from its other starting points.
    """
    solver = closed_form(robot)
    if solver is None:
        for seed in (reference, *search_starts(robot, _NUMERIC_SEEDS)):
            q = _polish(robot, seed, R_WE, p_WE, num_steps=200, limited=True)
            if _reaches(robot, q, R_WE, p_WE):
                return q
        return None
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = R_WE, p_WE
    raw = np.asarray(solver.calculate_IK(pose).Q, dtype=np.float64).reshape(-1, robot.num_joints)
    wrapped = [_within_limits(robot, q, reference) for q in raw[np.all(np.isfinite(raw), axis=1)]]
    within_limits = [q for q in wrapped if q is not None]
    distances = [float(np.linalg.norm(q - reference)) for q in within_limits]
    for q in (within_limits[i] for i in in_order(distances)):
        polished = _polish(robot, q, R_WE, p_WE, num_steps=4, limited=False)
        within = _within_limits(robot, polished, reference)
        if within is not None and _reaches(robot, within, R_WE, p_WE):
            return within
    return None


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
    """Unit axes (n, 3), those that are parallel but for rounding made exactly so.

    EAIK looks at its zeros bit by bit: with axes 1e-13 off it takes one kind of arm for another.
    Polishing corrects what the solutions lose by this.
    """
    same = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    for i in range(1, len(same)):
        for j in range(i):
            if np.linalg.norm(np.cross(same[i], same[j])) < _PARALLEL:
                same[i] = math.copysign(1.0, same[i] @ same[j]) * same[j]
                break
    return np.asarray(same)


def search_starts(robot: Robot, count: int) -> Array:
    """(count, n) postures to search from: the robot's home and others, each time the same."""
    lower = np.where(np.isfinite(robot.position_lower), robot.position_lower, -math.pi)
    upper = np.where(np.isfinite(robot.position_upper), robot.position_upper, math.pi)
    random = np.random.default_rng(0).uniform(lower, upper, (count - 1, robot.num_joints))
    return np.vstack([robot.home, random])


def _polish(
    robot: Robot, q: Array, R_WE: Array, p_WE: Array, num_steps: int, limited: bool
) -> Array:
    """q (n,) after damped least squares; see `damped_least_squares`."""
    q = np.array(q, dtype=np.float64)
    _approach(robot, q, R_WE, p_WE, num_steps, limited)
    return q


def _approach(
    robot: Robot, q: Array, R_WE: Array, p_WE: Array, num_steps: int, limited: bool
) -> float:
    """Moves q in place; returns the remaining error, rad and m."""
    return approach_pose(
        robot.chain.table,
        np.array(robot.position_lower),
        np.array(robot.position_upper),
        np.array(R_WE, dtype=np.float64),
        np.array(p_WE, dtype=np.float64),
        q,
        num_steps,
        True,
        limited,
        _ROUNDING,
        space_of(robot.num_joints),
    )


def _reaches(robot: Robot, q: Array, R_WE: Array, p_WE: Array) -> bool:
    return _approach(robot, q.copy(), R_WE, p_WE, 0, False) < _TOLERANCE


def _within_limits(robot: Robot, q: Array, reference: Array) -> Array | None:
    """The angles modulo a turn, within the limits and nearest to `reference`; None if none are."""
    lower, upper = robot.position_lower, robot.position_upper
    turn = np.where(robot.chain.prismatic, 0.0, 2.0 * math.pi)
    q = q - turn * whole_turns(q - reference)
    # The nearest turn may lie just outside the limits, the one before it within.
    q = np.where(q > upper + _SAME, q - turn, q)
    q = np.where(q < lower - _SAME, q + turn, q)
    if np.any(q > upper + _SAME) or np.any(q < lower - _SAME):
        return None
    return np.clip(q, lower, upper)
