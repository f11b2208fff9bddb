"""The arm as it stands and the force at its tool, in Meshcat: a page on this computer."""

import numpy as np
from pydrake.geometry import Cylinder, Meshcat, MeshcatCone, MeshcatParams
from pydrake.math import RigidTransform

from wrenchsight.analyses.methods.watch.arm_scene import (
    METRES_PER_NEWTON,
    NOT_VALID_COLOUR,
    VALID_COLOUR,
    ArmScene,
)
from wrenchsight.models.live.reading import Reading
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.robot import Robot
from wrenchsight.systems.wrench_arrows import HEAD_LENGTH, arrow_pose

_ARROW, _ARM = "/force", "/arm"


class MeshcatView:
    """A sink that draws.

    Attributes:
        url: url of the page.
    """

    period = 1.0 / 20.0  # s

    def __init__(self, robot: Robot) -> None:
        self._meshcat = Meshcat(MeshcatParams(host="127.0.0.1"))
        self._meshcat.SetCameraPose([2.0, 1.5, 1.5], [0.0, 0.0, 0.5])
        self.url: str = self._meshcat.web_url()
        self._scene = ArmScene(robot)
        for k, (link, shape, X_LS, rgba) in enumerate(self._scene.shapes):
            path = f"{_ARM}/{link}/{k}"
            self._meshcat.SetObject(path, shape, rgba)
            self._meshcat.SetTransform(path, X_LS)
        self._shown: bool | None = None

    def take(self, rows: list[Array]) -> str:
        """Draws the newest of the rows."""
        if rows:
            self._draw(Reading(rows[-1]))
        return ""

    def close(self) -> str:
        """As the protocol. Meshcat also ends in the thread that made it."""
        del self._meshcat
        return ""

    def _draw(self, reading: Reading) -> None:
        poses, p_WE = self._scene.placed(reading.q)
        for link, X_WL in poses.items():
            self._meshcat.SetTransform(f"{_ARM}/{link}", X_WL)
        if reading.valid is not self._shown:
            self._shown = reading.valid
            colour = VALID_COLOUR if reading.valid else NOT_VALID_COLOUR
            self._meshcat.SetObject(f"{_ARROW}/shaft", Cylinder(0.008, 1.0), colour)
            head = MeshcatCone(HEAD_LENGTH, 0.02, 0.02)
            self._meshcat.SetObject(f"{_ARROW}/head", head, colour)
        force = np.asarray(reading.wrench[3:]) * METRES_PER_NEWTON
        X_WA, shaft, head_scale = arrow_pose(p_WE, force)
        self._meshcat.SetTransform(_ARROW, X_WA)
        # A transform takes a scale that was set before with it: both in one matrix.
        scale = np.diag([1.0, 1.0, max(shaft, 1e-6), 1.0])
        self._meshcat.SetTransform(f"{_ARROW}/shaft", _raised(0.5 * shaft) @ scale)
        # The cone's tip is its origin, and it opens along z.
        turn = np.diag([head_scale, -head_scale, -head_scale, 1.0])
        tip = shaft + head_scale * HEAD_LENGTH
        self._meshcat.SetTransform(f"{_ARROW}/head", _raised(tip) @ turn)


def _raised(height: float) -> Array:
    return np.asarray(RigidTransform([0.0, 0.0, height]).GetAsMatrix4())
