"""What may happen to an arm in a log: motion, force, contact, load, and what has changed."""

from dataclasses import dataclass, field

import numpy as np

from wrenchsight.models.numerics.arrays import Array

FOOT_RADIUS = 0.003  # m, radius of a flat tool's feet


@dataclass(frozen=True, eq=False)
class Tool:
    """What touches a plane.

    Attributes:
        shape: "ball", or "flat": on three feet.
        radius: m, of the ball, or of the circle on which the feet stand.
        reach: m, from E along its z axis to the centre of the ball, or to the feet's ends.
    """

    shape: str
    radius: float
    reach: float

    @property
    def length(self) -> float:
        """From E to what touches, m."""
        return self.reach + (self.radius if self.shape == "ball" else 0.0)

    def balls(self) -> list[tuple[float, Array]]:
        """Radius in m and centre (3,) in E of the balls that touch."""
        if self.shape == "ball":
            return [(self.radius, np.array([0.0, 0.0, self.reach]))]
        angles = 2.0 * np.pi * np.arange(3) / 3.0
        x, y = self.radius * np.cos(angles), self.radius * np.sin(angles)
        return [(FOOT_RADIUS, np.array([x[k], y[k], self.reach - FOOT_RADIUS])) for k in range(3)]


@dataclass(frozen=True, eq=False)
class MujocoScene:
    """What happens to the arm in a log; N control steps.

    Attributes:
        q, v, vdot: (N, n) motion that is asked for.
        wrench: (N, 6) on E in axes of W, rotation first; None: none is applied.
        push: (N,) N, force that is asked for against a plane; None: there is no plane.
        plane_point, plane_normal: (3,) in W, of the plane; the normal points to the arm.
        plane_friction: coefficient of sliding friction at the touch.
        tool: that touches the plane; None: nothing does.
        load: mass in kg and centre of mass (3,) in E of a payload; None: there is none.
        coulomb_factor, viscous_factor: of the friction that the arm was identified with.
        ripple: (n,) N m, amplitude of a torque over the position.
        ripple_periods: periods of it, per turn.
        stiffness: N m/rad of each joint's gear; infinite: rigid.
    """

    q: Array
    v: Array
    vdot: Array
    wrench: Array | None = None
    push: Array | None = None
    plane_point: Array = field(default_factory=lambda: np.zeros(3))
    plane_normal: Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    plane_friction: float = 0.3
    tool: Tool | None = None
    load: tuple[float, Array] | None = None
    coulomb_factor: float = 1.0
    viscous_factor: float = 1.0
    ripple: Array | None = None
    ripple_periods: float = 50.0
    stiffness: float = np.inf
