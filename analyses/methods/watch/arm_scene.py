"""The arm as it stands, for viewers: the shapes of its links, and where these are."""

from typing import Any, NamedTuple

from pydrake.geometry import Rgba, Role
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.robot import Robot

METRES_PER_NEWTON = 0.005  # of the force's arrow
VALID_COLOUR, NOT_VALID_COLOUR = Rgba(0.0, 0.6, 0.2), Rgba(0.7, 0.7, 0.7)  # of it
_GREY_COLOUR = Rgba(0.6, 0.6, 0.6, 1.0)


class LinkShape(NamedTuple):
    """A shape of a link.

    Attributes:
        link: its name.
        shape: a `pydrake.geometry.Shape`.
        X_LS: its pose in the link.
        rgba: its colour.
    """

    link: str
    shape: Any
    X_LS: RigidTransform
    rgba: Rgba


class ArmScene:
    """An arm whose links are moved.

    Attributes:
        shapes: what its links look like; where its files do not state, what they collide with.
    """

    def __init__(self, robot: Robot) -> None:
        # A plant of the arm alone, never simulated: step 0, and a context that `placed` moves.
        builder = DiagramBuilder()
        self._plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
        parts = robot.add_to_plant(self._plant)
        self._plant.Finalize()
        self._diagram = builder.Build()
        self._context = self._diagram.CreateDefaultContext()
        self._plant_context = self._plant.GetMyMutableContextFromRoot(self._context)
        self._instance, self._frame_E = parts.model_instance, parts.frame_E
        self._bodies = [self._plant.get_body(i) for i in self._plant.GetBodyIndices(self._instance)]
        # What links look like is one role of shapes in Drake, what they collide with another; only
        # the first has colours.
        inspector = scene_graph.model_inspector()
        has_looks = inspector.NumGeometriesWithRole(Role.kIllustration) > 0
        role = Role.kIllustration if has_looks else Role.kProximity
        self.shapes = [  # in axes of their links, whose poses `placed` gives by name
            LinkShape(
                body.name(),
                inspector.GetShape(geometry),
                inspector.GetPoseInFrame(geometry),
                inspector.GetProperties(geometry, role).GetPropertyOrDefault(
                    "phong", "diffuse", _GREY_COLOUR
                ),
            )
            for body in self._bodies
            for geometry in inspector.GetGeometries(
                self._plant.GetBodyFrameIdOrThrow(body.index()), role
            )
        ]

    def placed(self, q: Array) -> tuple[dict[str, RigidTransform], Array]:
        """The poses of the links in W by name, and E's position p_WE (3,), at q (n,)."""
        self._plant.SetPositions(self._plant_context, self._instance, q)
        poses = {
            body.name(): self._plant.EvalBodyPoseInWorld(self._plant_context, body)
            for body in self._bodies
        }
        return poses, self._frame_E.CalcPoseInWorld(self._plant_context).translation()
