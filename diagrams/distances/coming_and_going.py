"""Approach and departure of a tool at the ends of a path, and the floor as an obstacle."""

import math
from dataclasses import replace

import numpy as np

from wrenchsight.diagrams.distances.placement_cell import FLOOR, PlacementCell
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.planning.motion.inverse_kinematics import follow_path
from wrenchsight.models.planning.placement.placement_program import Placement
from wrenchsight.models.planning.placement.placement_task import ClearanceConfig, ObstacleConfig
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.robot_config import PoseConfig

APPROACH = 0.05  # m, that E comes and goes along its z axis at both ends of a path
_STEPS = 5  # postures of each
_SIDE, _THICKNESS = 10.0, 1.0  # m, of the floor's slab


def moved_along(robot: Robot, q: Array, direction_W: Array, distance: float) -> Array:
    """Postures (5, n) with E moved from q (n,) to `distance` m along a unit vector, unturned.

    Raises:
        InputError: out of reach, or only by a jump.
    """
    R_WE, p_WE = robot.chain.pose(q)
    offsets = np.outer(np.linspace(0.0, distance, _STEPS), direction_W)
    return follow_path(robot, R_WE, p_WE + offsets, q)


def distance_of_ends(robot: Robot, cell: PlacementCell, path: Placement) -> float:
    """Smallest distance (m) where E comes to a path and leaves it; -inf where it cannot."""
    try:
        q = np.vstack(
            [
                moved_along(robot, end, -robot.chain.pose(end)[0][:, 2], APPROACH)
                for end in (path.q[0], path.q[-1])
            ]
        )
    except InputError:
        return -math.inf
    return float(cell.distances(q, path.n_W, path.p_WM, path.quaternion).min())


def sentence_of_ends(distance: float) -> str:
    """A sentence for the user on the arm's approach to a path, by `distance_of_ends`, m."""
    if distance == -math.inf:
        return f"the arm cannot reach {1e3 * APPROACH:.0f} mm off the path's ends"
    return f"the arm overlaps itself or the floor by {-1e3 * distance:.0f} mm"


def with_floor(robot: Robot, config: ClearanceConfig) -> ClearanceConfig:
    """The clearance with the robot's floor among its obstacles, where there is one."""
    if robot.floor is None:
        return config
    pose = PoseConfig([0.0, 0.0, robot.floor - 0.5 * _THICKNESS])
    slab = ObstacleConfig(FLOOR, [_SIDE, _SIDE, _THICKNESS], pose)
    return replace(config, obstacles=[*config.obstacles, slab])
