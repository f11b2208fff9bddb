"""Forces at the tool as arrows in Meshcat."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.geometry import Cylinder, Meshcat, MeshcatCone, Rgba
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import Context, EventStatus, LeafSystem

from wrenchsight.models.numerics.arrays import Array

HEAD_LENGTH = 0.045  # m
MIN_ARROW_LENGTH = 1e-4  # m; shorter arrows have no direction to show
MESHCAT_PATH = "/forces"


@dataclass(frozen=True)
class ArrowStyle:
    """How an arrow looks. Two arrows at one point: a thin one inside a wide, translucent one."""

    rgb: tuple[float, float, float]
    opacity: float = 1.0
    shaft_radius: float = 0.005  # m
    head_radius: float = 0.014  # m


class WrenchArrows(LeafSystem):
    """Draws the force part of wrenches as arrows from E, one style each.

                +--------------+
      terms --> |              |
      <name> -> | WrenchArrows |   (draws into Meshcat)
      <name> -> |              |
                +--------------+

    Inputs:     terms   RigidBodyTerms (abstract): p_WE
                <name>  (6,) a wrench at E in axes of W, rotation first, N m and N; one port per
                        entry of `styles`
    Output:     none; at its frames it sets the arrows /forces/<name>, and while Meshcat records,
                records them
    State:      none

    A force that is no finite number has no arrow, and where E's place is not known the arrows stay
    as they are: a picture ends no simulation.

    Args:
        meshcat: to draw into.
        styles: styles of each arrow, by the name of its port.
        fps: frames a second.
        metres_per_newton: m/N.

    Raises:
        ValueError: fps is not positive.
    """

    def __init__(
        self,
        meshcat: Meshcat,
        styles: Mapping[str, ArrowStyle],
        fps: float,
        metres_per_newton: float,
    ) -> None:
        LeafSystem.__init__(self)
        if not 0.0 < fps < np.inf:  # NaN neither
            raise ValueError(f"wrench arrows: fps must be positive, not {fps:g}")
        self._meshcat = meshcat
        self._scale = metres_per_newton
        self._terms = self.DeclareAbstractInputPort("terms", AbstractValue.Make(object()))
        self._wrenches = {name: self.DeclareVectorInputPort(name, 6) for name in styles}
        for name, style in styles.items():
            rgba = Rgba(*style.rgb, style.opacity)
            # Unit sizes along z; the frames stretch and place them.
            shaft = Cylinder(style.shaft_radius, 1.0)
            head = MeshcatCone(HEAD_LENGTH, style.head_radius, style.head_radius)
            meshcat.SetObject(f"{MESHCAT_PATH}/{name}/shaft", shaft, rgba)
            meshcat.SetObject(f"{MESHCAT_PATH}/{name}/head", head, rgba)
        self.DeclarePeriodicPublishEvent(1.0 / fps, 0.0, self._draw)
        self.DeclareForcedPublishEvent(self._draw)

    def _draw(self, context: Context) -> EventStatus:
        p_WE = self._terms.Eval(context).p_WE
        t = context.get_time()
        if not np.isfinite(p_WE).all():
            return EventStatus.DidNothing()
        for name, port in self._wrenches.items():
            self._draw_arrow(
                f"{MESHCAT_PATH}/{name}", p_WE, self._scale * port.Eval(context)[3:], t
            )
        return EventStatus.Succeeded()

    def _draw_arrow(self, path: str, p_WE: Array, arrow: Array, t: float) -> None:
        X_WA, shaft, head = arrow_pose(p_WE, arrow)
        self._meshcat.SetTransform(path, X_WA, t)
        # A transform takes a scale that was set before with it.
        self._meshcat.SetTransform(f"{path}/shaft", RigidTransform([0.0, 0.0, 0.5 * shaft]), t)
        self._meshcat.SetProperty(f"{path}/shaft", "scale", [1.0, 1.0, max(shaft, 1e-6)], t)
        # The cone's tip is its origin, and it opens along z.
        tip = RigidTransform(
            RotationMatrix.MakeXRotation(np.pi), [0.0, 0.0, float(shaft + head * HEAD_LENGTH)]
        )
        self._meshcat.SetTransform(f"{path}/head", tip, t)
        self._meshcat.SetProperty(f"{path}/head", "scale", [head, head, head], t)


def arrow_pose(p_WE: Array, arrow: Array) -> tuple[RigidTransform, float, float]:
    """How an arrow from p_WE by `arrow` (m, axes of W) is made of a shaft and a head along z.

    Returns:
        The pose of the arrow's frame, its z along the arrow; the shaft's length, m; the head's
        scale, at most 1: short arrows have small heads.
    """
    # Of a force that is not finite, or too large for its square, it is none below infinity.
    with np.errstate(over="ignore", invalid="ignore"):
        length = float(np.linalg.norm(arrow))
    if not MIN_ARROW_LENGTH <= length < np.inf:
        return RigidTransform(p_WE), 0.0, 1e-6
    head = min(1.0, 0.6 * length / HEAD_LENGTH)
    R_WA = RotationMatrix.MakeFromOneVector(arrow, 2)
    return RigidTransform(R_WA, p_WE), length - head * HEAD_LENGTH, head
