"""Workpieces in the cell: their pose, their exact surface, their contact geometry."""

import math
from typing import Any

import numpy as np
from pydrake.common import MemoryFile
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddContactMaterial,
    AddRigidHydroelasticProperties,
    Box,
    Cylinder,
    InMemoryMesh,
    Mesh,
    ProximityProperties,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant

from wrenchsight.diagrams.scenario import BladeConfig, PlateConfig
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.machining.process_variations import WorkpieceContact
from wrenchsight.models.planning.motion.workpieces import Plate, Surface, mesh
from wrenchsight.models.planning.placement.placement_task import WORKPIECE
from wrenchsight.models.robot.robot_config import pose_of

_PLATE_COLOUR = np.array([0.62, 0.68, 0.72, 1.0])
_STAND_COLOUR = np.array([0.42, 0.45, 0.48, 1.0])
_BLADE_COLOUR = np.array([0.36, 0.50, 0.60, 1.0])
_POST_RADIUS = 0.03  # m
_TIP_RESOLUTION = 1.0  # of the tip's radius: some twenty faces a patch, as smooth as a hundred


def surface_of(workpiece: PlateConfig | BladeConfig) -> Surface:
    """The exact surface, in the workpiece's frame P.

    Raises:
        InputError: a dimension out of range.
    """
    if isinstance(workpiece, PlateConfig):
        return Plate(workpiece.size[0], workpiece.size[1])
    return workpiece.surface()


def pose_of_workpiece(workpiece: PlateConfig | BladeConfig) -> RigidTransform:
    """X_WP; of a plate P lies in the middle of its top face."""
    return pose_of(workpiece.pose)


def process_contact(
    workpiece: PlateConfig | BladeConfig, ends: tuple[list[float], list[float]]
) -> WorkpieceContact:
    """The contact law and the pose of a workpiece, for the machining process.

    Args:
        ends: (u, v) where the path begins and ends.
    """
    X_WP = pose_of_workpiece(workpiece)
    u, v = np.transpose(ends)
    p_PS = surface_of(workpiece).at(u, v).p
    # A point of a plate is a spring; a ball of modulus E on a rigid surface presses by pi E d^2.
    is_spring = isinstance(workpiece, PlateConfig)
    return WorkpieceContact(
        workpiece.stiffness if isinstance(workpiece, PlateConfig) else math.pi * workpiece.modulus,
        1.0 if is_spring else 2.0,
        workpiece.friction,
        np.array(X_WP.rotation().matrix()),
        np.array(X_WP.translation()),
        p_PS @ X_WP.rotation().matrix().T + X_WP.translation(),
    )


def contact_material(stiffness: float, dissipation: float, friction: float) -> ProximityProperties:
    """The material of one of two equal bodies that meet with this stiffness, N/m."""
    properties = ProximityProperties()
    AddContactMaterial(
        dissipation=dissipation,
        point_stiffness=2.0 * stiffness,
        friction=CoulombFriction(friction, friction),
        properties=properties,
    )
    return properties


def soft_tip(blade: BladeConfig, radius: float) -> ProximityProperties:
    """The material of a ball that yields to the blade: contact is a patch, and smooth."""
    properties = _patch_material(blade)
    AddCompliantHydroelasticProperties(_TIP_RESOLUTION * radius, blade.modulus, properties)
    return properties


def add_workpiece(plant: MultibodyPlant, workpiece: PlateConfig | BladeConfig) -> None:
    """Fixes a workpiece in the world, see `add_plate` and `add_blade`."""
    if isinstance(workpiece, BladeConfig):
        add_blade(plant, workpiece)
    else:
        add_plate(plant, workpiece)


def add_plate(plant: MultibodyPlant, plate: PlateConfig) -> None:
    """Fixes a plate in the world: a box that is drawn and touched, on a post that is only drawn."""
    X_WP = pose_of_workpiece(plate)
    X_WG = X_WP @ RigidTransform([0.0, 0.0, -0.5 * plate.size[2]])
    body, shape = plant.world_body(), Box(*plate.size)
    material = contact_material(plate.stiffness, plate.dissipation, plate.friction)
    plant.RegisterCollisionGeometry(body, X_WG, shape, WORKPIECE, material)
    plant.RegisterVisualGeometry(body, X_WG, shape, WORKPIECE, _PLATE_COLOUR)
    # The post, only drawn, ends below the plate, however that is tilted.
    x, y, z_bottom = (X_WP @ RigidTransform([0.0, 0.0, -plate.size[2]])).translation()
    upright = max(0.2, float(X_WP.rotation().matrix()[2, 2]))
    _add_post(plant, x, y, float(z_bottom) - _POST_RADIUS * math.sqrt(1.0 / upright**2 - 1.0))


def add_blade(plant: MultibodyPlant, blade: BladeConfig) -> None:
    """Fixes a blade in the world: a rigid surface of triangles, drawn and touched.

    Raises:
        InputError: a mesh size that is not positive, or a dimension out of range.
    """
    if not blade.mesh_size > 0.0:
        raise InputError("workpiece", "mesh_size", f"{blade.mesh_size:g} m, expected more than 0")
    surface, X_WP = surface_of(blade), pose_of_workpiece(blade)
    count = [
        int(np.clip(math.ceil(length / blade.mesh_size), 8, 600))
        for length in (2.1 * blade.root_chord, blade.span)
    ]
    shape = _mesh(surface, count[0] + 1, count[1] + 1)
    properties = _patch_material(blade)
    AddRigidHydroelasticProperties(properties)
    body = plant.world_body()
    plant.RegisterCollisionGeometry(body, X_WP, shape, WORKPIECE, properties)
    plant.RegisterVisualGeometry(body, X_WP, _mesh(surface, 121, 41), WORKPIECE, _BLADE_COLOUR)
    points = mesh(surface, 121, 41)[0] @ X_WP.rotation().matrix().T + X_WP.translation()
    x, y, _ = points.mean(axis=0)
    is_over_post = np.hypot(points[:, 0] - x, points[:, 1] - y) < _POST_RADIUS
    if is_over_post.any():
        _add_post(plant, x, y, float(points[is_over_post, 2].min()))


def _add_post(plant: MultibodyPlant, x: float, y: float, height: float) -> None:
    """Adds the post that a workpiece stands on, as a picture."""
    if height > 0.02:
        X_WC = RigidTransform([x, y, 0.5 * height])
        post = Cylinder(_POST_RADIUS, height)
        plant.RegisterVisualGeometry(plant.world_body(), X_WC, post, "stand", _STAND_COLOUR)


def _patch_material(blade: BladeConfig) -> Any:
    properties = ProximityProperties()
    AddContactMaterial(
        dissipation=blade.dissipation,
        friction=CoulombFriction(blade.friction, blade.friction),
        properties=properties,
    )
    return properties


def _mesh(surface: Surface, num_u: int, num_v: int) -> Mesh:
    vertices, triangles = mesh(surface, num_u, num_v)
    lines = [f"v {x:.9f} {y:.9f} {z:.9f}" for x, y, z in vertices]
    lines += [f"f {a} {b} {c}" for a, b, c in triangles + 1]
    return Mesh(InMemoryMesh(mesh_file=MemoryFile("\n".join(lines) + "\n", ".obj", "workpiece")))
