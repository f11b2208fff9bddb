"""The plant of a placement: the arm, and the path as a body that floats.

Bodies beside the arm, all without a joint of their own:

    path    its x axis is the path's direction n, its origin the midpoint m; a workpiece is fixed to
            it, with its outward normal along z
    held    the rotation of E that is kept along the whole path; its origin stays at W's

Positions of the plant are the arm's and (quaternion, position) of both bodies.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import SpatialInertia, UnitInertia

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.planning.placement.placements import Placement, quaternion_from
from wrenchsight.models.robot.robot import Robot

PATH, HELD = "path", "held_rotation"  # names of the two bodies


def add_path(plant: MultibodyPlant) -> tuple[Any, Any]:
    """Adds the two bodies to a plant that is not finalized yet; they weigh nothing that matters."""
    inertia = SpatialInertia(1.0, np.zeros(3), UnitInertia(1.0, 1.0, 1.0))
    instance = plant.AddModelInstance("placement")
    return tuple(plant.AddRigidBody(name, instance, inertia) for name in (PATH, HELD))


def path_rotation(n_W: Array, R_WE: Array) -> Array:
    """(3, 3) rotation of the path's body in W: x along the path, z against E's z axis.

    Where n is not perpendicular to E's z axis, z is what is left of it across the path.
    """
    z = -R_WE[:, 2]
    z = z - (n_W @ z) * n_W
    if np.linalg.norm(z) < 1e-6:  # along E's z axis: any
        z = R_WE[:, 0] - (n_W @ R_WE[:, 0]) * n_W
    z = z / np.linalg.norm(z)
    return np.column_stack([n_W, np.cross(z, n_W), z])


def path_pose(placement: Placement) -> Array:
    """(7,) quaternion and position (m) of the path's body in W."""
    R_WP = path_rotation(placement.n_W, placement.R_WE)
    return np.concatenate([quaternion_from(R_WP), placement.p_WM])


class PlacementPlant:
    """Indices of the positions of a finalized plant that holds an arm and the bodies of `add_path`.

    Attributes:
        plant: as given.
        frame_E: frame E of the arm in it.
        path, held: frames of the two bodies.

    Args:
        parts: parts of the arm, see `Robot.add_to_plant`.
    """

    def __init__(self, plant: MultibodyPlant, parts: Any) -> None:
        self.plant, self.frame_E = plant, parts.frame_E
        bodies = [plant.GetBodyByName(name) for name in (PATH, HELD)]
        self.path, self.held = (body.body_frame() for body in bodies)
        self._starts = [body.floating_positions_start() for body in bodies]
        self._joints = [joint.position_start() for joint in parts.joints]

    def positions(self, q: Sequence[Any], path: Sequence[Any], held: Sequence[Any]) -> NDArray[Any]:
        """The plant's positions, of numbers or of variables.

        Args:
            q: (n,) of the arm.
            path, held: (7,) quaternion and position of the two bodies.
        """
        values = np.empty(self.plant.num_positions(), dtype=np.asarray(q).dtype)
        values[self._joints] = q
        for start, pose in zip(self._starts, (path, held), strict=True):
            values[start : start + 7] = pose
        return values


def plain_plant(robot: Robot) -> PlacementPlant:
    """The plant of a placement without shapes, for a program without distances."""
    plant = MultibodyPlant(0.0)
    parts = robot.add_to_plant(plant)
    add_path(plant)
    plant.Finalize()
    return PlacementPlant(plant, parts)
