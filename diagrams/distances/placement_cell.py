"""The cell in which a path is placed: robot, tool, obstacles, and a workpiece under the path.

A plant with SceneGraph computes the distances. These pairs count:

- links of the robot, and the tool, with two joints or more between them; where it is two, as in a
  wrist, not those that are nearer than the clearance in the home posture already;
- links and obstacles, without the link that is welded to the world; the link that turns on it
  stands over the obstacle `floor` by its mounting, and is left out there;
- links and workpiece, without the shape of the tool whose surface E lies on: it is meant to touch.
"""

from collections.abc import Sequence
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff
from pydrake.geometry import (
    Box,
    CollisionFilterDeclaration,
    GeometrySet,
    ProximityProperties,
)
from pydrake.math import RigidTransform
from pydrake.multibody.inverse_kinematics import MinimumDistanceLowerBoundConstraint
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import SpatialInertia, UnitInertia

from wrenchsight.diagrams.distances.arm_shapes import ArmShapes
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.planning.placement.placement_program import (
    PathPenalty,
    PlacementBatch,
    quaternion_from,
    rotation_of,
)
from wrenchsight.models.planning.placement.placement_task import ClearanceConfig, ObstacleConfig
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.robot_config import pose_of

_TOUCHING = 1e-3  # m from E within which a shape of the tool counts as the one that works
_INFLUENCE = 0.04  # m beyond the distance to keep, where the smooth margin begins to fall
_ROUND = ((1, 1), (-1, 1), (-1, -1), (1, -1))  # the corners of a face
FLOOR = "floor"  # the name of the obstacle that the robot stands on
# m that margins require beyond the distance, for what happens between the points; distances are
# exact to some micrometres.
PAD = 1e-3


class ClosestBodies(NamedTuple):
    """The two bodies that come nearest to each other along a path.

    Attributes:
        distance: m.
        posture: index of the posture.
        first, second: names; empty where no pair is within 1 m.
    """

    distance: float
    posture: int
    first: str
    second: str


class PlacementCell:
    """Distances between all shapes in the cell, for postures along a placed path.

    Args:
        robot: the arm with its tool; its collision shapes count.
        config: distance to keep, obstacles, workpiece.

    Attributes:
        notices: sentences for the user: missing shapes, and pairs that are left out.
    """

    def __init__(self, robot: Robot, config: ClearanceConfig) -> None:
        self._config = config
        self._shapes = shapes = ArmShapes(robot, lambda plant: _add_surroundings(plant, config))
        self.notices = tuple(_filter(robot, config, shapes))
        self._constraint = MinimumDistanceLowerBoundConstraint(
            shapes.plant, config.distance + PAD, shapes.context, None, _INFLUENCE
        )
        self._upper = float(self._constraint.upper_bound()[0])

    def margins_and_gradients(
        self, q: Array, n_W: Array, p_WM: Array, quaternion: Array
    ) -> tuple[Array, Array]:
        """Smooth margins (k + 1,) and their gradients (k + 1, n + 10) by q_i, n_W, p_WM, Q.

        A margin is 0 or more where the clearance is kept.
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
            gradient_row = np.asarray(ExtractGradient(value))
            gradients[i] = -gradient_row[0] if gradient_row.size else 0.0
        return margins, gradients

    def penalties(self, batch: PlacementBatch) -> PathPenalty:
        """Squared deficits of the margins, for `PlacementDescent`."""
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
        return PathPenalty(penalty, by_q, by_path)

    def deficit(self, q: Array, n_W: Array, p_WM: Array, quaternion: Array) -> float:
        """Distance that the worst of postures q (N, n) lacks, m; or 0."""
        smallest = float(np.min(self.distances(q, n_W, p_WM, quaternion)))
        return max(0.0, self._config.distance - smallest)

    def distances(self, q: Array, n_W: Array, p_WM: Array, quaternion: Array) -> Array:
        """(N,) the smallest distance of any pair at each posture q (N, n), m; at most 1 m."""
        pose = self._workpiece_pose(n_W, p_WM, quaternion)
        smallest = []
        for row in q:
            distances = [pair.distance for pair in self._shapes.pairs(row, 1.0, pose)]
            smallest.append(min(distances, default=1.0))
        return np.array(smallest)

    def closest(self, q: Array, n_W: Array, p_WM: Array, quaternion: Array) -> ClosestBodies:
        """The two bodies that come nearest to each other along a path."""
        index = int(np.argmin(self.distances(q, n_W, p_WM, quaternion)))
        pairs = self._shapes.pairs(q[index], 1.0, self._workpiece_pose(n_W, p_WM, quaternion))
        if not pairs:
            return ClosestBodies(1.0, index, "", "")
        pair = min(pairs, key=lambda p: float(p.distance))
        return ClosestBodies(
            distance=float(pair.distance),
            posture=index,
            first=self._shapes.name(pair.id_A),
            second=self._shapes.name(pair.id_B),
        )

    def _workpiece_pose(self, n_W: Array, p_WM: Array, quaternion: Array) -> Array:
        if self._config.workpiece is None:
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
    """Gradients of the workpiece's quaternion by n_W (4, 3) and by Q (4, 4) of any length."""
    R = workpiece_rotation(n_W, Q)
    _, y, z = R.T
    S = quaternion_from(R)
    size = float(np.linalg.norm(Q))
    unit = Q / size
    # A turn d of the tool turns z by d x z; the workpiece by z x dz + (dx . y) z.
    by_turn_z = -_cross_matrix(z)
    # x follows z so as to stay perpendicular: dx . y = ((n . -) parts) / |n - (n.z) z|.
    n_across = n_W - (n_W @ z) * z
    length = float(np.linalg.norm(n_across))
    dx_y_by_n = y / length
    dx_y_by_z = -(n_W @ z) * y / length
    turn_by_n = np.outer(z, dx_y_by_n)
    turn_by_z = _cross_matrix(z) + np.outer(z, dx_y_by_z)
    Q_matrix = _left_matrix(S)
    by_n = Q_matrix @ turn_by_n
    # dQ -> turn of the tool in W: d = 2 Im(dQ conj(Q)); _left_matrix(Q) is its inverse up to 4.
    turn_by_Q = 4.0 * _left_matrix(unit).T / size
    by_Q = Q_matrix @ turn_by_z @ by_turn_z @ turn_by_Q
    return by_n, by_Q


def _cross_matrix(v: Array) -> Array:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def _add_surroundings(plant: MultibodyPlant, config: ClearanceConfig) -> None:
    world, no_properties = plant.world_body(), ProximityProperties()
    for obstacle in config.obstacles:
        X_WO, shape = pose_of(obstacle.pose), Box(*obstacle.size)
        plant.RegisterCollisionGeometry(world, X_WO, shape, obstacle.name, no_properties)
    if config.workpiece is not None:
        size = config.workpiece.size
        inertia = SpatialInertia(1.0, np.zeros(3), UnitInertia(1.0, 1.0, 1.0))
        body = plant.AddRigidBody("workpiece", plant.AddModelInstance("workpiece"), inertia)
        X_PG = RigidTransform([0.0, 0.0, -0.5 * size[2]])
        plant.RegisterCollisionGeometry(body, X_PG, Box(*size), "workpiece", no_properties)


def _filter(robot: Robot, config: ClearanceConfig, shapes: ArmShapes) -> list[str]:
    """Filters out the pairs that do not count; returns sentences for the user."""
    plant, level = shapes.plant, shapes.level

    def leave_out(first: Sequence[Any], second: Sequence[Any]) -> None:
        if first and second:
            declaration = CollisionFilterDeclaration().ExcludeBetween(
                GeometrySet(first), GeometrySet(second)
            )
            shapes.filters.Apply(declaration)

    notices = []
    bodies = [plant.get_body(i) for i in plant.GetBodyIndices(shapes.parts.model_instance)]
    shapes_of = {body.name(): plant.GetCollisionGeometriesForBody(body) for body in bodies}
    if not any(shapes_of.values()):
        notices.append(
            f"{robot.name} has no collision shapes: clearance of its links is not checked"
        )
    if robot.unusable_collisions:
        notices.append(
            f"no usable collision shape for {', '.join(robot.unusable_collisions)}: "
            "clearance from these is not checked"
        )
    if config.workpiece is not None:
        workpiece_shapes = plant.GetCollisionGeometriesForBody(plant.GetBodyByName("workpiece"))
        world = plant.world_body().index()
        # The workpiece may lie on an obstacle, such as a table.
        leave_out(
            workpiece_shapes,
            [shape for shape, body in shapes.body.items() if body.index() == world],
        )
        leave_out(_working_shapes(shapes), workpiece_shapes)
    floor = [shape for shape in shapes.body if shapes.name(shape) == FLOOR]
    for body in bodies:
        if level[body.index()] == 1:  # turns on the link that stands on the floor
            leave_out(floor, shapes_of[body.name()])
    bare_arm = ArmShapes(robot)
    near = {
        frozenset((bare_arm.name(pair.id_A), bare_arm.name(pair.id_B)))
        for pair in bare_arm.pairs(robot.home, max(config.distance, 1e-6))
    }
    for first_body, second_body in combinations(bodies, 2):
        num_joints_between = abs(level[first_body.index()] - level[second_body.index()])
        first, second = first_body.name(), second_body.name()
        if num_joints_between > 2 or not (shapes_of[first] and shapes_of[second]):
            continue
        if num_joints_between == 2:
            if frozenset((first, second)) not in near:
                continue
            notices.append(
                f"{first} and {second} are nearer than {1e3 * config.distance:g} mm at home, "
                "two joints apart by construction: their distance is not checked"
            )
        leave_out(shapes_of[first], shapes_of[second])
    return notices


def _working_shapes(shapes: ArmShapes) -> list[Any]:
    """Shapes fixed to E whose surface E lies on."""
    plant, frame_E = shapes.plant, shapes.parts.frame_E
    context = plant.CreateDefaultContext()
    X_WE = frame_E.CalcPoseInWorld(context)
    welded = {body.index() for body in plant.GetBodiesWeldedTo(frame_E.body())}
    working = []
    for shape, body in shapes.body.items():
        if body.index() in welded:
            X_WG = body.EvalPoseInWorld(context) @ shapes.inspector.GetPoseInFrame(shape)
            p_GE = X_WG.inverse() @ X_WE.translation()
            if abs(_surface_distance(shapes.inspector.GetShape(shape), p_GE)) < _TOUCHING:
                working.append(shape)
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
