"""The cell of a placement: arm, path, floor, obstacles and a workpiece under the path.

One plant holds them all. The distances that must be kept are those of
`diagrams.distances.clearance.Clearance`; of the tool only what E touches may meet the workpiece.
"""

from collections.abc import Iterator
from functools import cached_property
from typing import Any

import numpy as np
from pydrake.geometry import Box, ProximityProperties
from pydrake.math import RigidTransform
from pydrake.multibody.inverse_kinematics import (
    DistanceConstraint,
    MinimumDistanceLowerBoundConstraint,
)
from pydrake.multibody.plant import MultibodyPlant

from wrenchsight.diagrams.distances.clearance import (
    DISTANCE_ROUNDING,
    Clearance,
    ClosestPair,
)
from wrenchsight.diagrams.placement.placement_plant import (
    PlacementPlant,
    add_path,
    path_pose,
    path_rotation,
)
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.planning.placement.placement_task import (
    WORKPIECE,
    ClearanceConfig,
    ObstacleConfig,
)
from wrenchsight.models.planning.placement.placements import Placement
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.robot_config import pose_of

# m beyond the distance to keep, where a pair begins to count in the program
_INFLUENCE_DISTANCE = 0.04
_SMALL_PAD = 0.1  # of what a pair must keep that keeps less than the distance
_DISTANCE_ROUNDING = 1e-12  # m
_MAX_DISTANCE = 1.0  # m, beyond which no distance is stated
_FACE_CORNERS = ((1, 1), (-1, 1), (-1, -1), (1, -1))  # the corners of a face


class PlacementCell:
    """Distances between all shapes in the cell, for a placed path.

    Args:
        robot: the arm with its tool; its collision shapes count.
        config: distance to keep, obstacles, workpiece. The robot's floor counts, too.

    Attributes:
        clearance: the distances.
        parts: indices of the plant's positions.
        notices: sentences for the user: missing shapes, and pairs that keep less.
    """

    def __init__(self, robot: Robot, config: ClearanceConfig) -> None:
        self._config = config
        self.clearance = Clearance(
            robot,
            config.distance,
            robot.floor,
            obstacles=config.obstacles,
            add=self._add,
            tip_only=True,
        )
        self._shapes = self.clearance.shapes
        self.parts = PlacementPlant(self._shapes.plant, self._shapes.parts)
        self.notices = tuple(_notices(robot, self.clearance))

    def _add(self, plant: MultibodyPlant) -> None:
        path, _ = add_path(plant)
        if self._config.workpiece is not None:
            size = self._config.workpiece.size
            X_PG = RigidTransform([0.0, 0.0, -0.5 * size[2]])
            box, properties = Box(*size), ProximityProperties()
            plant.RegisterCollisionGeometry(path, X_PG, box, WORKPIECE, properties)

    @cached_property
    def _small(self) -> dict[tuple[Any, Any], float]:
        return self.clearance.small_requirements()

    def new_context(self) -> Any:
        """A context in which those pairs count that must keep the whole distance."""
        return self._shapes.new_context([*self.clearance.left_out(), *self._small])

    def constraints(self, context: Any) -> Iterator[tuple[str, Any]]:
        """Constraints on the plant's positions with their names, for a context of `new_context`."""
        plant, distance = self._shapes.plant, self._config.distance
        yield (
            "clearance",
            MinimumDistanceLowerBoundConstraint(
                plant, distance + DISTANCE_ROUNDING, context, None, _INFLUENCE_DISTANCE
            ),
        )
        for pair, required in self._small.items():
            names = " and ".join(self._shapes.name(shape) for shape in pair)
            lower = (1.0 + _SMALL_PAD) * required
            constraint = DistanceConstraint(plant, pair, context, lower, np.inf)
            yield f"clearance of {names}", constraint

    def closest(self, placement: Placement) -> ClosestPair | None:
        """The pair with the least slack along a placed path; None where nothing is near."""
        return self.worst(placement.q, placement)

    def worst(self, q: Array, placement: Placement) -> ClosestPair | None:
        """The pair with the least slack over postures q (N, n), the workpiece under a path."""
        return self.clearance.worst(
            q, self._config.distance + _INFLUENCE_DISTANCE, path_pose(placement)
        )

    def deficit(self, placement: Placement) -> float:
        """m, that the worst pair along a placed path lacks; 0 where all keep what they must."""
        pair = self.closest(placement)
        return 0.0 if pair is None else max(0.0, -pair.slack)

    def smallest_distance(self, q: Array, placement: Placement) -> float:
        """m, of pairs that must keep the whole distance, over postures q (N, n); at most 1 m."""
        pose = path_pose(placement)
        least = self._config.distance - _DISTANCE_ROUNDING
        pairs = (pair for row in q for pair in self.clearance.slacks(row, _MAX_DISTANCE, pose))
        return min(
            (pair.distance for pair in pairs if pair.distance - pair.slack >= least),
            default=_MAX_DISTANCE,
        )


def workpiece_corners(config: ClearanceConfig, placement: Placement) -> Array:
    """(8, 3) corners of the workpiece in W, m: the upper face's four, then the lower face's."""
    assert config.workpiece is not None
    length, width, thickness = config.workpiece.size
    corners = [
        [0.5 * sx * length, 0.5 * sy * width, z]
        for z in (0.0, -thickness)
        for sx, sy in _FACE_CORNERS
    ]
    R_WP = path_rotation(placement.n_W, placement.R_WE)
    return np.asarray(placement.p_WM + np.array(corners) @ R_WP.T)


def obstacle_corners(obstacle: ObstacleConfig) -> Array:
    """(8, 3) corners of an obstacle in W, m, in the order of `workpiece_corners`."""
    x, y, z = 0.5 * np.array(obstacle.size)
    corners = [[sx * x, sy * y, sz * z] for sz in (1, -1) for sx, sy in _FACE_CORNERS]
    X_WO = pose_of(obstacle.pose)
    return np.asarray(X_WO.translation() + np.array(corners) @ X_WO.rotation().matrix().T)


def _notices(robot: Robot, clearance: Clearance) -> Iterator[str]:
    if not clearance.has_shapes:
        yield f"{robot.name} has no collision shapes: clearance of its links is not checked"
    if robot.unusable_collisions:
        yield (
            f"no usable collision shape for {', '.join(robot.unusable_collisions)}: "
            "clearance from these is not checked"
        )
    for pair, required in clearance.near_at_home:
        yield (
            f"{pair} are near each other at home by construction: they keep {1e3 * required:.1f} mm"
        )
    for pair in clearance.overlapping:
        yield f"{pair} overlap at home already: their distance is not checked"
    yield from clearance.coarse_notes()
    for (link, obstacle), depth in clearance.base_in_obstacles(robot).items():
        yield (
            f"{link}, which stands still, reaches {1e3 * depth:.0f} mm into {obstacle}, which is "
            "not checked: is the obstacle where it should be?"
        )
