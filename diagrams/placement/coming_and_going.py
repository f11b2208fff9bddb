"""Approach and departure of a tool at the ends of a placed path."""

import math

import numpy as np

from wrenchsight.diagrams.distances.moved_along import moved_along
from wrenchsight.diagrams.placement.placement_cell import PlacementCell
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.planning.placement.placements import Placement
from wrenchsight.models.robot.robot import Robot

APPROACH_DISTANCE = 0.05  # m, that E comes and goes along its z axis at both ends of a path


def distance_of_ends(robot: Robot, cell: PlacementCell, path: Placement) -> float:
    """Least slack (m) where E comes to a path and leaves it; -inf where it cannot."""
    try:
        q = np.vstack(
            [
                moved_along(robot, end, -robot.chain.pose(end)[0][:, 2], APPROACH_DISTANCE)
                for end in (path.q[0], path.q[-1])
            ]
        )
    except InputError:
        return -math.inf
    worst = cell.worst(q, path)
    return math.inf if worst is None else worst.slack


def sentence_of_ends(distance: float) -> str:
    """A sentence for the user on the arm's approach to a path, by `distance_of_ends`, m."""
    if distance == -math.inf:
        return f"the arm cannot reach {1e3 * APPROACH_DISTANCE:.0f} mm off the path's ends"
    lack = -1e3 * distance
    return f"the arm is nearer by {lack:.0f} mm to itself or its surroundings than it may be"
