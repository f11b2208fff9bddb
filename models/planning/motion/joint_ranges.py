"""Ranges of the joints: narrower limits of a task or scenario, and those of random postures."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.robot import Robot

_UNLIMITED_STROKE = 2.0  # m to either side, of a sliding joint without limits: the reach of an arm


def narrowed_limits(
    robot: Robot,
    ranges: Mapping[str, Sequence[float]],
    lower: Array,
    upper: Array,
    source: str | Path,
) -> tuple[Array, Array]:
    """The limits (n,) in rad (m), each no wider than the range of its joint.

    A range beyond the limits leaves a joint with lower above upper: the caller refuses it.

    Args:
        ranges: [lower, upper] by the joint's name; deg, of sliding joints m.
        lower, upper: (n,) rad (m).
        source: the file that names them.

    Raises:
        InputError: the robot has no joint of a name, or a range is none.
    """
    lower, upper = np.array(lower, float), np.array(upper, float)
    for joint, limits in ranges.items():
        key = f"joint_ranges_deg.{joint}"
        if joint not in robot.joint_names:
            problem = f"{robot.name} has no joint of this name"
            remedy = "copy the task's file and name this robot's joints there: "
            raise InputError(source, key, problem, remedy + ", ".join(robot.joint_names))
        j = robot.joint_names.index(joint)
        unit, factor = ("m", 1.0) if robot.chain.prismatic[j] else ("deg", math.pi / 180.0)
        if len(limits) != 2 or not limits[0] < limits[1]:
            raise InputError(source, key, f"{list(limits)}, expected [lower, upper] in {unit}")
        lower[j], upper[j] = max(lower[j], factor * limits[0]), min(upper[j], factor * limits[1])
    return lower, upper


def ranges_of_postures(
    lower: Array, upper: Array, prismatic: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """The ranges (n,), rad (m), in which random postures cover all that the joints can do.

    They are the joints' limits. A joint that can turn all round has -pi to pi instead, as further
    turns repeat these; an end that a sliding joint lacks is `_UNLIMITED_STROKE` from 0, or from the
    other end where that lies beyond.

    Args:
        lower, upper: (n,) limits, rad (m), -inf and inf of joints without.
        prismatic: (n,) whether a joint slides.
    """
    turns_round = ~prismatic & (upper - lower >= 2.0 * np.pi)
    first = np.where(turns_round, -np.pi, lower)
    last = np.where(turns_round, np.pi, upper)
    return (
        np.where(np.isinf(first), np.minimum(0.0, last) - _UNLIMITED_STROKE, first),
        np.where(np.isinf(last), np.maximum(0.0, first) + _UNLIMITED_STROKE, last),
    )
