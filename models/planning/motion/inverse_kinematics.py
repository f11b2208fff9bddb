"""Joint positions along a path of E: one continuous branch of an arm."""

import math
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import one_thread
from wrenchsight.models.numerics.ties import first_of_least, whole_turns
from wrenchsight.models.planning.motion.branches import all_branches, is_closed_form
from wrenchsight.models.robot.robot import Robot

_MAX_JOINT_STEP = 0.35  # rad or m; a larger step of a joint between two samples is bisected
_MAX_BISECTIONS = 7  # of the path between two samples, before the step counts as a jump


@one_thread()
def follow_path(robot: Robot, R_WE: Array, p_WE: Array, q_seed: Array) -> Array:
    """Joint positions along a path of E, on the continuous branch that starts nearest to a seed.

    Between two samples the path is taken as straight in position and in rotation; where a joint
    moves far from one sample to the next, the path between them is followed too, so that a change
    of branch is an error and not a step.

    Args:
        robot: its limits count.
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
    poses = [_Pose(R, p) for R, p in zip(R_WE, p_WE, strict=True)]
    q = np.empty((len(poses), robot.num_joints))
    q[0] = _nearest_at(robot, poses[0], np.asarray(q_seed, dtype=np.float64), sample=0)
    for i in range(1, len(poses)):
        q[i] = _advance(robot, q[i - 1], poses[i - 1], poses[i], i, _MAX_BISECTIONS)
    return q


class _Pose(NamedTuple):
    """A pose of E in W: R_WE (3, 3) and p_WE (3,), m."""

    R_WE: Array
    p_WE: Array


def _nearest_at(robot: Robot, pose: _Pose, reference: Array, sample: int) -> Array:
    """`_nearest`, but with an InputError that names the sample where there is no posture."""
    q = _nearest(robot, pose.R_WE, pose.p_WE, reference)
    if q is None:
        raise _unreachable(robot, sample, pose.p_WE)
    return q


def _advance(
    robot: Robot,
    q: Array,
    start: _Pose,
    end: _Pose,
    sample: int,
    bisections_left: int,
) -> Array:
    """The solution (n,) at `end` that continues the solution q (n,) at `start`.

    Args:
        robot: as `follow_path`.
        q: (n,) reaches `start`.
        sample: index of `end` on the path, for error lines.
        bisections_left: how often the way from start to end may still be halved; after that a step
            of a joint beyond _MAX_JOINT_STEP is an error.
    """
    q_end = _nearest_at(robot, end, q, sample)
    step = np.abs(q_end - q)
    if np.max(step) <= _MAX_JOINT_STEP:
        return q_end
    if bisections_left == 0:
        joint = robot.joint_names[int(np.argmax(step))]
        raise InputError(
            "path",
            f"sample {sample}",
            f"{joint} of {robot.name} would have to jump by {np.max(step):.2f} to go on",
            "move or turn the path, or start on another branch",
        )
    rotations = Slerp([0.0, 1.0], Rotation.from_matrix(np.stack([start.R_WE, end.R_WE])))
    middle = _Pose(rotations(0.5).as_matrix(), 0.5 * (start.p_WE + end.p_WE))
    q_middle = _advance(robot, q, start, middle, sample, bisections_left - 1)
    return _advance(robot, q_middle, middle, end, sample, bisections_left - 1)


def _unreachable(robot: Robot, sample: int, p_WE: Array) -> InputError:
    position = ", ".join(f"{value:.4f}" for value in p_WE)
    return InputError(
        "path",
        f"sample {sample}",
        f"{robot.name} cannot reach ({position}) m in this orientation within its joint limits",
        "move, turn or shorten the path",
    )


def _nearest(robot: Robot, R_WE: Array, p_WE: Array, reference: Array) -> Array | None:
    """The posture within the limits that is nearest to `reference`; None where there is none.

    Of equally near ones the first in the order of `all_branches`. Where that is a search, it is one
    from `reference`; its other starts are tried where this one fails.
    """
    has_closed_form = is_closed_form(robot)
    turning = ~robot.chain.prismatic
    is_endless = turning & ~np.isfinite(robot.position_upper - robot.position_lower)
    for seeds in (None,) if has_closed_form else (reference[np.newaxis], None):
        turns_of = turning if has_closed_form else None
        postures = all_branches(
            robot, R_WE[np.newaxis], p_WE[np.newaxis], turns_of=turns_of, seeds=seeds
        )[0]
        postures -= np.where(is_endless, 2.0 * math.pi * whole_turns(postures - reference), 0.0)
        if len(postures):
            return np.asarray(
                postures[first_of_least(np.linalg.norm(postures - reference, axis=1))]
            )
    return None
