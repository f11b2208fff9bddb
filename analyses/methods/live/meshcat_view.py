"""The arm as it stands and the force at its tool, in Meshcat: a page on this computer."""

import numpy as np
from pydrake.geometry import (
    Cylinder,
    Meshcat,
    MeshcatCone,
    MeshcatParams,
    MeshcatVisualizer,
    MeshcatVisualizerParams,
    Rgba,
    Role,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from wrenchsight.models.arrays import Array
from wrenchsight.models.live.reading import Reading
from wrenchsight.models.robot.robot import Robot
from wrenchsight.systems.wrench_arrows import HEAD_LENGTH, arrow_pose

METRES_PER_NEWTON = 0.005
_VALID, _NOT_VALID = Rgba(0.0, 0.6, 0.2), Rgba(0.7, 0.7, 0.7)
_ARROW = "/force"


class MeshcatView:
    """A sink that draws.

    Args:
        robot: whose arm it is.

    Attributes:
        url: of the page.
    """

    period = 1.0 / 20.0  # s

    def __init__(self, robot: Robot) -> None:
        self._meshcat = Meshcat(MeshcatParams(host="127.0.0.1"))
        self._meshcat.SetCameraPose([2.0, 1.5, 1.5], [0.0, 0.0, 0.5])
        self.url: str = self._meshcat.web_url()
        builder = DiagramBuilder()
        plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
        parts = robot.add_to_plant(plant)
        plant.Finalize()
        has_looks = scene_graph.model_inspector().NumGeometriesWithRole(Role.kIllustration) > 0
        role = Role.kIllustration if has_looks else Role.kProximity
        MeshcatVisualizer.AddToBuilder(
            builder, scene_graph, self._meshcat, MeshcatVisualizerParams(role=role)
        )
        self._diagram = builder.Build()
        self._context = self._diagram.CreateDefaultContext()
        self._plant, self._frame_E = plant, parts.frame_E
        self._own = plant.GetMyMutableContextFromRoot(self._context)
        self._instance = parts.model_instance
        self._shown: bool | None = None

    def take(self, rows: list[Array]) -> str:
        """Draws the newest of the rows."""
        if rows:
            self._draw(Reading(rows[-1]))
        return ""

    def close(self) -> str:
        """As the protocol."""
        return ""

    def _draw(self, reading: Reading) -> None:
        self._plant.SetPositions(self._own, self._instance, reading.q)
        self._diagram.ForcedPublish(self._context)
        if reading.valid is not self._shown:
            self._shown = reading.valid
            colour = _VALID if reading.valid else _NOT_VALID
            self._meshcat.SetObject(f"{_ARROW}/shaft", Cylinder(0.008, 1.0), colour)
            head = MeshcatCone(HEAD_LENGTH, 0.02, 0.02)
            self._meshcat.SetObject(f"{_ARROW}/head", head, colour)
        p_WE = self._frame_E.CalcPoseInWorld(self._own).translation()
        force = np.asarray(reading.wrench[3:]) * METRES_PER_NEWTON
        X_WA, shaft, head_scale = arrow_pose(p_WE, force)
        self._meshcat.SetTransform(_ARROW, X_WA)
        self._meshcat.SetProperty(f"{_ARROW}/shaft", "scale", [1.0, 1.0, max(shaft, 1e-6)])
        self._meshcat.SetTransform(f"{_ARROW}/shaft", RigidTransform([0.0, 0.0, 0.5 * shaft]))
        self._meshcat.SetProperty(f"{_ARROW}/head", "scale", [head_scale] * 3)
