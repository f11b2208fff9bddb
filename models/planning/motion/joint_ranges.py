"""Narrower joint limits from a task or a scenario."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.robot import Robot


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
