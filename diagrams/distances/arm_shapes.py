"""The collision shapes of an arm and of its surroundings, and their distances."""

from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pydrake.geometry import CollisionFilterDeclaration, GeometryId, GeometrySet, Role
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import BodyIndex, Joint
from pydrake.systems.framework import DiagramBuilder

from wrenchsight.models.robot.robot import Robot


class ArmShapes:
    """A plant with SceneGraph for distances at postures; meshes count as convex hulls.

    Args:
        robot: the arm with its tool.
        add: adds what stands around it to the plant, which has the arm and is not finalized.

    Attributes:
        plant: finalized.
        parts: the robot in it.
        diagram: plant and scene graph, which Drake deletes with it.
        inspector: of the scene graph: shapes, their names and poses in their bodies.
        body: body of each collision shape, by its geometry id; in the order of the ids, which is
            the same in every run.
        level: number of the robot's joints between the world and each body, by the body's index:
            0 of what stands still; a body that floats has none.
        tool: the robot's tool; without one the body that E lies on.
        position_indices: index of each of the robot's joints among the plant's positions.
    """

    def __init__(
        self, robot: Robot, add: Callable[[MultibodyPlant], None] = lambda plant: None
    ) -> None:
        builder = DiagramBuilder()
        plant, self._scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
        # Hulls: distances of meshes are those of their convex hulls.
        self.parts = parts = robot.add_to_plant(plant, hulls=True)
        add(plant)
        plant.Finalize()
        self.plant = plant
        self.diagram = builder.Build()
        self.inspector = self._scene_graph.model_inspector()
        shapes = sorted(self.inspector.GetAllGeometryIds(Role.kProximity), key=GeometryId.get_value)
        self.body = {
            shape: plant.GetBodyFromFrameId(self.inspector.GetFrameId(shape)) for shape in shapes
        }
        self.level = _levels(plant, parts.joints)
        self.tool = parts.tool_body(plant)
        self.position_indices = [joint.position_start() for joint in parts.joints]
        # Index of the pose of the body that floats among the plant's positions: 7 numbers,
        # quaternion and position. None: no body floats.
        self._floating_start = _start_of_floating_pose(plant)
        # Contexts of the diagram, kept alive: `new_context` gives away the plant's parts of them,
        # which Drake deletes with the whole.
        self._diagram_contexts: list[Any] = []

    @cached_property
    def context(self) -> Any:
        """The plant's context, made at its first use."""
        return self.new_context()

    def new_context(self, left_out: Iterable[tuple[Any, Any]] = ()) -> Any:
        """Another context of the plant, in which some pairs of shapes do not count."""
        root = self.diagram.CreateDefaultContext()
        self._diagram_contexts.append(root)
        filters = self._scene_graph.collision_filter_manager(
            self._scene_graph.GetMyMutableContextFromRoot(root)
        )
        for pair in left_out:
            filters.Apply(_without(pair))
        return self.plant.GetMyMutableContextFromRoot(root)

    def name(self, geometry: Any) -> str:
        """Name of a shape's link; of a shape that is none of the robot's, its own name."""
        body = self.body[geometry]
        if body.model_instance() != self.parts.model_instance:
            return str(self.inspector.GetName(geometry)).split("::")[-1]
        return str(body.name())

    def pairs(self, q: ArrayLike, influence: float, pose: ArrayLike = ()) -> list[Any]:
        """Pairs of shapes within `influence` (m), the arm at q (n,), where `context` is then left.

        Args:
            pose: (7,) quaternion and position of the first body that floats, where there is one.
        """
        query = self._query(q, pose)
        return list(query.ComputeSignedDistancePairwiseClosestPoints(influence))

    def distance(self, q: ArrayLike, first: Any, second: Any) -> float:
        """m, of two shapes, the arm at q (n,); also of two that stand still."""
        query = self._query(q)
        return float(query.ComputeSignedDistancePairClosestPoints(first, second).distance)

    def _query(self, q: ArrayLike, pose: ArrayLike = ()) -> Any:
        positions = self.plant.GetDefaultPositions()
        if len(np.asarray(pose)):
            start = self._floating_start
            assert start is not None, "a pose needs a body that floats"
            positions[start : start + 7] = pose
        positions[self.position_indices] = np.asarray(q, np.float64)
        self.plant.SetPositions(self.context, positions)
        return self.plant.get_geometry_query_input_port().Eval(self.context)


def _levels(plant: MultibodyPlant, joints: Sequence[Joint]) -> dict[BodyIndex, int]:
    """`ArmShapes.level`: what is welded to the child of joint j moves with it, and has j + 1."""
    level = {body.index(): 0 for body in plant.GetBodiesWeldedTo(plant.world_body())}
    for j, joint in enumerate(joints):
        for body in plant.GetBodiesWeldedTo(joint.child_body()):
            level[body.index()] = j + 1
    return level


def _start_of_floating_pose(plant: MultibodyPlant) -> int | None:
    """Index of the first floating body's pose among the positions; None: none floats.

    Of several bodies that float it is the one that was added first: the others stay where they are
    by default.
    """
    floating = [plant.get_body(index) for index in plant.GetFloatingBaseBodies()]
    return min((body.floating_positions_start() for body in floating), default=None)


def _without(pair: tuple[Any, Any]) -> Any:
    """The declaration that leaves a pair of shapes out of all distances."""
    first, second = (GeometrySet(shape) for shape in pair)
    return CollisionFilterDeclaration().ExcludeBetween(first, second)
