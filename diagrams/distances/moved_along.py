"""Postures in which E moves along a straight line, to a surface or off it."""

import numpy as np

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.planning.motion.inverse_kinematics import follow_path
from wrenchsight.models.robot.robot import Robot

_NUM_POSTURES = 5  # postures


def moved_along(robot: Robot, q: Array, direction_W: Array, distance: float) -> Array:
    """Postures (5, n) with E moved from q (n,) to `distance` m along a unit vector, unturned.

    Raises:
        InputError: out of reach, or only by a jump.
    """
    R_WE, p_WE = robot.chain.pose(q)
    offsets = np.outer(np.linspace(0.0, distance, _NUM_POSTURES), direction_W)
    return follow_path(robot, R_WE, p_WE + offsets, q)
