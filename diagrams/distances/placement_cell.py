"""The cell in which a path is placed: robot, tool, obstacles, and a workpiece under the path.

A plant with SceneGraph answers how near they come to each other. Which pairs count:

- links of the robot, and the tool, with two joints or more between them; where it is two, as in a
  wrist, not those that are nearer than the clearance in the home posture already;
- links against obstacles, but for what the robot stands on (the link that is welded to the world);
  what turns on that stands over the obstacle `floor` as it is mounted, and is left out there;
- links against the workpiece, but for the shape of the tool whose surface E lies on, which is meant
  to touch it.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff
from pydrake.geometry import Box, CollisionFilterDeclaration, GeometrySet, Role
from pydrake.math import RigidTransform
from pydrake.multibody.inverse_kinematics import MinimumDistanceLowerBoundConstraint
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import SpatialInertia, UnitInertia
from pydrake.systems.framework import DiagramBuilder

from wrenchsight.models.arrays import Array
from wrenchsight.models.placement.placement_program import (
    PlacementBatch,
    quaternion_from,
    rotation_of,
)
from wrenchsight.models.placement.placement_task import ClearanceConfig, ObstacleConfig
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.robot_config import pose_of

_TOUCHING = 1e-3  # m from E within which a shape of the tool counts as the one that works
_INFLUENCE = 0.04  # m beyond the distance to keep, where the smooth margin begins to fall
_ROUND = ((1, 1), (-1, 1), (-1, -1), (1, -1))  # the corners of a face
FLOOR = "floor"  # the name of the obstacle that the robot stands on
# m that margins require beyond the distance, for what happens between the points; distances are
# exact to some micrometres.
PAD = 1e-3


@dataclass(frozen=True)
class _Parts:
    """A plant with SceneGraph, its context, and where the workpiece's pose stands in q."""

    diagram: Any
    plant: MultibodyPlant
    context: Any
    diagram_context: Any
    workpiece: bool


class PlacementCell:
    """Distances between all that stands in the cell, for postures along a placed path.

    Args:
        robot: the arm with its tool; its collision shapes count.
        config: distance to keep, obstacles, workpiece.

    Attributes:
        notices: sentences for the user: what has no shape, which pairs are left out.
    """

    def __init__(self, robot: Robot, config: ClearanceConfig) -> None:
        self._robot, self._config = robot, config
        self._parts, self.notices = _build(robot, config)
        self._constraint = MinimumDistanceLowerBoundConstraint(
            self._parts.plant, config.distance + PAD, self._parts.context, None, _INFLUENCE
        )
        self._upper = float(self._constraint.upper_bound()[0])

    def margins_and_gradients(
        self, q: Array, n_W: Array, p_WM: Array, quaternion: Array
    ) -> tuple[Array, Array]:
        """Smooth margins (k + 1,), 0 or more where the clearance is kept, and their gradients
        (k + 1, n + 10) by q_i, n_W, p_WM, quaternion.
        """
        n = q.shape[1]
        pose = self._workpiece_pose(n_W, p_WM, quaternion)
        gradient = np.zeros((n + len(pose), n + 10))
        gradient[:n, :n] = np.eye(n)
        if len(pose):
            gradient[n : n + 4, n : n + 3], gradient[n : n + 4, n + 6 :] = _turned_by(
                n_W, quaternion
            )
            gradient[n + 4 :, n + 3 : n + 6] = np.eye(3)
        margins, gradients = np.empty(len(q)), np.empty((len(q), n + 10))
        for i, row in enumerate(q):
            x = InitializeAutoDiff(np.concatenate([row, pose])[:, np.newaxis], gradient)[:, 0]
            value = self._constraint.Eval(x)
            margins[i] = self._upper - float(ExtractValue(value).item())
            by = np.asarray(ExtractGradient(value))
            gradients[i] = -by[0] if by.size else 0.0
        return margins, gradients

    def penalties(self, batch: PlacementBatch) -> tuple[Array, Array, Array]:
        """Squared deficits of the margins, as `PlacementDescent` takes penalties."""
        n = batch.q.shape[2]
        penalty = np.zeros(len(batch))
        by_q, by_path = np.zeros_like(batch.q), np.zeros((len(batch), 9))
        for i in range(len(batch)):
            Q = quaternion_from(batch.R_WE[i])
            margins, gradients = self.margins_and_gradients(
                batch.q[i], batch.n_W[i], batch.p_WM[i], Q
            )
            deficit = np.minimum(margins, 0.0)
            penalty[i] = 1e-3 * np.sum(deficit**2)
            weighted = 2e-3 * deficit[:, np.newaxis] * gradients
            by_q[i] = weighted[:, :n]
            shared = np.sum(weighted[:, n:], axis=0)
            by_path[i, 6:], by_path[i, 3:6] = shared[:3], shared[3:6]
            # A turn d of the tool, in W, moves its quaternion by (0, d) Q / 2.
            by_path[i, :3] = _left_matrix(Q).T @ shared[6:]
        return penalty, by_q, by_path

    def deficit(self, q: Array, n_W: Array, p_WM: Array, quaternion: Array) -> float:
        """By how much the worst of postures q (N, n) misses the distance to keep, m; or 0."""
        smallest = float(np.min(self.distances(q, n_W, p_WM, quaternion)))
        return max(0.0, self._config.distance - smallest)

    def distances(self, q: Array, n_W: Array, p_WM: Array, quaternion: Array) -> Array:
        """(N,) the smallest distance of any pair at each posture q (N, n), m; at most 1 m."""
        parts = self._parts
        pose = self._workpiece_pose(n_W, p_WM, quaternion)
        port = parts.plant.get_geometry_query_input_port()
        smallest = np.ones(len(q))
        for i, row in enumerate(q):
            parts.plant.SetPositions(parts.context, np.concatenate([row, pose]))
            query = port.Eval(parts.context)
            pairs = query.ComputeSignedDistancePairwiseClosestPoints(1.0)
            smallest[i] = min((pair.distance for pair in pairs), default=1.0)
        return smallest

    def closest(
        self, q: Array, n_W: Array, p_WM: Array, quaternion: Array
    ) -> tuple[float, int, str, str]:
        """Smallest distance, m, the index of its posture and the names of the two bodies."""
        index = int(np.argmin(self.distances(q, n_W, p_WM, quaternion)))
        parts = self._parts
        pose = self._workpiece_pose(n_W, p_WM, quaternion)
        parts.plant.SetPositions(parts.context, np.concatenate([q[index], pose]))
        query = parts.plant.get_geometry_query_input_port().Eval(parts.context)
        pairs = query.ComputeSignedDistancePairwiseClosestPoints(1.0)
        if not pairs:
            return 1.0, index, "", ""
        pair = min(pairs, key=lambda p: float(p.distance))
        inspector = query.inspector()
        names = [
            _body_name(parts.plant, inspector, geometry) for geometry in (pair.id_A, pair.id_B)
        ]
        return float(pair.distance), index, names[0], names[1]

    def _workpiece_pose(self, n_W: Array, p_WM: Array, quaternion: Array) -> Array:
        if not self._parts.workpiece:
            return np.empty(0)
        R = workpiece_rotation(n_W, quaternion)
        return np.concatenate([quaternion_from(R), p_WM])


def workpiece_rotation(n_W: Array, quaternion: Array) -> Array:
    """(3, 3) rotation of the workpiece in W: x along the path, z against the tool's z axis."""
    z = -rotation_of(quaternion)[:, 2]
    x = n_W - (n_W @ z) * z
    x = x / np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def workpiece_corners(config: ClearanceConfig, n_W: Array, p_WM: Array, quaternion: Array) -> Array:
    """(8, 3) corners of the workpiece in W, m: the upper face's four, then the lower face's."""
    assert config.workpiece is not None
    length, width, thickness = config.workpiece.size
    corners = [
        [0.5 * sx * length, 0.5 * sy * width, z] for z in (0.0, -thickness) for sx, sy in _ROUND
    ]
    return np.asarray(p_WM + np.array(corners) @ workpiece_rotation(n_W, quaternion).T)


def obstacle_corners(obstacle: ObstacleConfig) -> Array:
    """(8, 3) corners of an obstacle in W, m, in the order of `workpiece_corners`."""
    x, y, z = 0.5 * np.array(obstacle.size)
    corners = [[sx * x, sy * y, sz * z] for sz in (1, -1) for sx, sy in _ROUND]
    X_WO = pose_of(obstacle.pose)
    return np.asarray(X_WO.translation() + np.array(corners) @ X_WO.rotation().matrix().T)


def _left_matrix(Q: Array) -> Array:
    """(4, 3) from a turn in W to the change of the quaternion Q."""
    w, x, y, z = Q
    return 0.5 * np.array([[-x, -y, -z], [w, z, -y], [-z, w, x], [y, -x, w]])


def _turned_by(n_W: Array, Q: Array) -> tuple[Array, Array]:
    """Gradient of the workpiece's quaternion by n_W (4, 3) and by Q (4, 4), Q any length."""
    R = workpiece_rotation(n_W, Q)
    _, y, z = R.T
    S = quaternion_from(R)
    size = float(np.linalg.norm(Q))
    unit = Q / size
    # A turn d of the tool turns z by d x z; the workpiece by z x dz + (dx . y) z.
    by_turn_z = -_cross_matrix(z)
    # x follows z so as to stay perpendicular: dx . y = ((n . -) parts) / |n - (n.z) z|.
    along = n_W - (n_W @ z) * z
    length = float(np.linalg.norm(along))
    dx_y_by_n = y / length
    dx_y_by_z = -(n_W @ z) * y / length
    turn_by_n = np.outer(z, dx_y_by_n)
    turn_by_z = _cross_matrix(z) + np.outer(z, dx_y_by_z)
    left = _left_matrix(S)
    by_n = left @ turn_by_n
    # dQ -> turn of the tool in W: d = 2 Im(dQ conj(Q)); _left_matrix(Q) is its inverse up to 4.
    turn_by_Q = 4.0 * _left_matrix(unit).T / size
    by_Q = left @ turn_by_z @ by_turn_z @ turn_by_Q
    return by_n, by_Q


def _cross_matrix(v: Array) -> Array:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def _build(robot: Robot, config: ClearanceConfig) -> tuple[_Parts, tuple[str, ...]]:
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlant(MultibodyPlantConfig(time_step=1e-3), builder)
    robot_parts = robot.add_to_plant(plant, hulls=True)
    world = plant.world_body()
    for obstacle in config.obstacles:
        plant.RegisterCollisionGeometry(
            world, pose_of(obstacle.pose), Box(*obstacle.size), obstacle.name, _properties()
        )
    if config.workpiece is not None:
        size = config.workpiece.size
        body = plant.AddRigidBody(
            "workpiece",
            plant.AddModelInstance("workpiece"),
            SpatialInertia(1.0, np.zeros(3), UnitInertia(1.0, 1.0, 1.0)),
        )
        plant.RegisterCollisionGeometry(
            body,
            RigidTransform([0.0, 0.0, -0.5 * size[2]]),
            Box(*size),
            "workpiece",
            _properties(),
        )
    plant.Finalize()
    notices = _filter(robot, config, plant, scene_graph, robot_parts)
    diagram = builder.Build()
    diagram_context = diagram.CreateDefaultContext()
    context = plant.GetMyMutableContextFromRoot(diagram_context)
    parts = _Parts(diagram, plant, context, diagram_context, config.workpiece is not None)
    return parts, tuple(notices)


def _properties() -> Any:
    from pydrake.geometry import ProximityProperties

    return ProximityProperties()


def _body_name(plant: MultibodyPlant, inspector: Any, geometry: Any) -> str:
    body = plant.GetBodyFromFrameId(inspector.GetFrameId(geometry))
    if body.index() == plant.world_body().index():
        return str(inspector.GetName(geometry)).split("::")[-1]
    return str(body.name())


def _filter(
    robot: Robot, config: ClearanceConfig, plant: MultibodyPlant, scene_graph: Any, parts: Any
) -> list[str]:
    """Leaves out the pairs that do not count; returns sentences about it."""
    notices = []
    filters = scene_graph.collision_filter_manager()
    bodies = [plant.get_body(index) for index in plant.GetBodyIndices(parts.model_instance)]
    shapes = {body.name(): plant.GetCollisionGeometriesForBody(body) for body in bodies}
    moving = [body for body in bodies if shapes[body.name()]]
    if not moving:
        notices.append(f"{robot.name} has no collision shapes: only the tool's place is looked at")
    if robot.unusable_collisions:
        notices.append(
            "collision shapes cannot be used, so that no clearance is claimed: "
            + ", ".join(robot.unusable_collisions)
        )
    inspector = scene_graph.model_inspector()
    if config.workpiece is not None:
        board = plant.GetCollisionGeometriesForBody(plant.GetBodyByName("workpiece"))
        fixed = [
            geometry
            for geometry in inspector.GetAllGeometryIds(Role.kProximity)
            if plant.GetBodyFromFrameId(inspector.GetFrameId(geometry)).index()
            == plant.world_body().index()
        ]
        if fixed:  # the workpiece lies on a table or is held over it
            filters.Apply(
                CollisionFilterDeclaration().ExcludeBetween(GeometrySet(board), GeometrySet(fixed))
            )
        working = _working_shapes(plant, parts, inspector)
        if working:
            filters.Apply(
                CollisionFilterDeclaration().ExcludeBetween(
                    GeometrySet(working), GeometrySet(board)
                )
            )
    level = _levels(plant, parts)
    floor = [
        geometry
        for geometry in inspector.GetAllGeometryIds(Role.kProximity)
        if _body_name(plant, inspector, geometry) == FLOOR
    ]
    first = [shapes[body.name()] for body in moving if level[body.index()] == 1]
    if floor and first:
        filters.Apply(
            CollisionFilterDeclaration().ExcludeBetween(
                GeometrySet(floor), GeometrySet([shape for own in first for shape in own])
            )
        )
    near = _near_at_home(robot, config.distance)
    for i, first in enumerate(bodies):
        for second in bodies[i + 1 :]:
            apart = abs(level[first.index()] - level[second.index()])
            if apart > 2 or not (shapes[first.name()] and shapes[second.name()]):
                continue
            if apart == 2:
                if (first.name(), second.name()) not in near:
                    continue
                notices.append(
                    f"{first.name()} and {second.name()} are nearer than "
                    f"{1e3 * config.distance:g} mm at home, two joints apart: by construction, "
                    "not looked at"
                )
            filters.Apply(
                CollisionFilterDeclaration().ExcludeBetween(
                    GeometrySet(shapes[first.name()]), GeometrySet(shapes[second.name()])
                )
            )
    return notices


def _levels(plant: MultibodyPlant, parts: Any) -> dict[Any, int]:
    """How many joints lie below each body of the robot, by its index."""
    level = {body.index(): 0 for body in plant.GetBodiesWeldedTo(plant.world_body())}
    for number, joint in enumerate(parts.joints):
        for body in plant.GetBodiesWeldedTo(joint.child_body()):
            level[body.index()] = number + 1
    return level


def _working_shapes(plant: MultibodyPlant, parts: Any, inspector: Any) -> list[Any]:
    """Shapes fixed to E whose surface E lies on."""
    context = plant.CreateDefaultContext()
    tool = parts.frame_E.body()
    welded = {body.index() for body in plant.GetBodiesWeldedTo(tool)}
    X_WE = parts.frame_E.CalcPoseInWorld(context)
    working = []
    for index in welded:
        body = plant.get_body(index)
        X_WB = body.EvalPoseInWorld(context)
        for geometry in plant.GetCollisionGeometriesForBody(body):
            X_WG = X_WB @ inspector.GetPoseInFrame(geometry)
            p_GE = X_WG.inverse() @ X_WE.translation()
            if abs(_surface_distance(inspector.GetShape(geometry), p_GE)) < _TOUCHING:
                working.append(geometry)
    return working


def _surface_distance(shape: Any, p: Array) -> float:
    """Signed distance of a point from a shape's surface, roughly; inf where it is not known."""
    kind = type(shape).__name__
    if kind == "Sphere":
        return float(np.linalg.norm(p) - shape.radius())
    if kind in ("Cylinder", "Capsule"):
        radial = float(np.hypot(p[0], p[1])) - shape.radius()
        axial = abs(float(p[2])) - 0.5 * shape.length()
        return float(max(radial, axial))
    if kind == "Box":
        return float(np.max(np.abs(p) - 0.5 * np.asarray(shape.size())))
    return float("inf")


def _near_at_home(robot: Robot, distance: float) -> set[tuple[str, str]]:
    """Names, either way round, of the robot's bodies that are nearer than this at home."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlant(MultibodyPlantConfig(time_step=1e-3), builder)
    parts = robot.add_to_plant(plant, hulls=True)
    plant.Finalize()
    diagram = builder.Build()
    root = diagram.CreateDefaultContext()
    context = plant.GetMyMutableContextFromRoot(root)
    plant.SetPositions(context, parts.model_instance, robot.home)
    query = plant.get_geometry_query_input_port().Eval(context)
    inspector = query.inspector()
    found = set()
    for pair in query.ComputeSignedDistancePairwiseClosestPoints(max(distance, 1e-6)):
        a, b = (_body_name(plant, inspector, geometry) for geometry in (pair.id_A, pair.id_B))
        found |= {(a, b), (b, a)}
    return found
