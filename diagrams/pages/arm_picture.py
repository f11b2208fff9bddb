"""Pictures of an arm in given postures: kinematics only, nothing is simulated."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from pydrake.geometry import Meshcat, MeshcatVisualizer, MeshcatVisualizerParams, Role
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.robot import Robot


class ArmPicture:
    """Shows a robot in a Meshcat; publishes into its animation if one is being made.

    Args:
        fps: frames a second that an animation keeps.
    """

    def __init__(self, robot: Robot, meshcat: Meshcat, fps: float = 30.0) -> None:
        builder = DiagramBuilder()
        plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
        parts = robot.add_to_plant(plant)
        plant.Finalize()
        MeshcatVisualizer.AddToBuilder(
            builder,
            scene_graph,
            meshcat,
            MeshcatVisualizerParams(
                role=Role.kIllustration, prefix="arm", publish_period=1.0 / fps
            ),
        )
        self._diagram = builder.Build()
        self._context = self._diagram.CreateDefaultContext()
        self._plant = plant
        self._plant_context = plant.GetMyMutableContextFromRoot(self._context)
        self._order = [joint.position_start() for joint in parts.joints]

    def show(self, q: ArrayLike, time: float = 0.0) -> None:
        """Draws the arm at q (n,), as the frame of `time` (s) of an animation."""
        self._context.SetTime(time)
        positions = np.array(self._plant.GetPositions(self._plant_context))
        positions[self._order] = np.asarray(q, np.float64)
        self._plant.SetPositions(self._plant_context, positions)
        self._diagram.ForcedPublish(self._context)


def colour_scale(values: ArrayLike, low: float, high: float) -> Array:
    """Colours (..., 3) of values between low (dark) and high (bright), by their logarithm."""
    from matplotlib import colormaps

    x = np.clip(np.asarray(values, np.float64), low, high)
    part = np.log(x / low) / max(float(np.log(high / low)), 1e-12)
    return np.asarray(colormaps["viridis"](part), dtype=np.float64)[..., :3]


def scale_legend(label: str, low: float, high: float, num_steps: int = 5) -> dict[str, Array]:
    """Names and colours that explain `colour_scale`."""
    stops: Sequence[float] = np.geomspace(low, high, num_steps).tolist()
    return {f"{label} {stop:.3g}": colour_scale(stop, low, high) for stop in stops}
