"""The collision shapes of an arm and of its surroundings, and their distances."""

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pydrake.geometry import Role
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.systems.framework import DiagramBuilder

from wrenchsight.models.robot.robot import Robot


class ArmShapes:
    """A plant with SceneGraph for distances at postures; meshes count as convex hulls.

    Collision filters (`filters`) must be applied before the first call of `pairs`.

    Args:
        robot: the arm with its tool.
        add: adds what stands around it to the plant.

    Attributes:
        plant: finalized; the robot's positions come first.
        parts: the robot in it.
        body: of each shape, by its geometry id.
        level: number of joints between the world and each body, by its index.
        tool: the robot's tool; without one the body that E lies on.
    """

    def __init__(
        self, robot: Robot, add: Callable[[MultibodyPlant], None] = lambda plant: None
    ) -> None:
        builder = DiagramBuilder()
        plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
        self.plant, self.parts = plant, robot.add_to_plant(plant, hulls=True)
        add(plant)
        plant.Finalize()
        self.diagram = builder.Build()  # owns plant and context
        self.filters = scene_graph.collision_filter_manager()
        self.inspector = scene_graph.model_inspector()
        self.body = {
            geometry: plant.GetBodyFromFrameId(self.inspector.GetFrameId(geometry))
            for geometry in self.inspector.GetAllGeometryIds(Role.kProximity)
        }
        self.level = {body.index(): 0 for body in plant.GetBodiesWeldedTo(plant.world_body())}
        for j, joint in enumerate(self.parts.joints):
            for body in plant.GetBodiesWeldedTo(joint.child_body()):
                self.level[body.index()] = j + 1
        weld = self.parts.tool_weld
        joint = None if weld is None else plant.get_joint(weld)
        self.tool = self.parts.frame_E.body() if joint is None else joint.child_body()
        self.order = [joint.position_start() for joint in self.parts.joints]

    @cached_property
    def context(self) -> Any:
        """The plant's context, made at its first use."""
        self._root = self.diagram.CreateDefaultContext()
        return self.plant.GetMyMutableContextFromRoot(self._root)

    def name(self, geometry: Any) -> str:
        """Name of a shape's link; of a shape that is fixed to the world, its own name."""
        body = self.body[geometry]
        if body.index() == self.plant.world_body().index():
            return str(self.inspector.GetName(geometry)).split("::")[-1]
        return str(body.name())

    def pairs(self, q: ArrayLike, influence: float, pose: ArrayLike = ()) -> list[Any]:
        """Pairs of shapes within `influence` (m), the arm at q (n,).

        Args:
            pose: (7,) quaternion and position of a body that floats, where there is one.
        """
        positions = np.zeros(self.plant.num_positions())
        positions[len(positions) - len(np.asarray(pose)) :] = pose
        positions[self.order] = np.asarray(q, np.float64)
        self.plant.SetPositions(self.context, positions)
        query = self.plant.get_geometry_query_input_port().Eval(self.context)
        return list(query.ComputeSignedDistancePairwiseClosestPoints(influence))
