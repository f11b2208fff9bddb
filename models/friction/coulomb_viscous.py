"""Coulomb-viscous friction with an offset: joint friction outside the near-zero interval.

tau_f opposes motion: it is positive for positive velocity and stands on the left of
M vdot + C v + G + tau_f = tau_J + tau_ext. `semi_parametric_friction` adds the network near zero
velocity.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.numerics.arrays import Array


@dataclass(frozen=True, eq=False)
class CoulombViscous:
    """tau_f = coulomb sgn(v) + viscous v + offset (Lu et al., eq. 2; the offset is ours).

    The offset is what a drive's current shows at any velocity: an amplifier's zero, a spring, or
    friction that differs between the two directions.

    Attributes:
        coulomb: (n,) N m.
        viscous: (n,) N m s/rad.
        offset: (n,) N m.

    Raises:
        ValueError: shapes that disagree, or a number that is not finite.
    """

    coulomb: Array
    viscous: Array
    offset: Array

    def __post_init__(self) -> None:
        for key in ("coulomb", "viscous", "offset"):
            value = np.array(getattr(self, key), float)
            object.__setattr__(self, key, value)
            if value.ndim != 1 or value.shape != self.coulomb.shape:
                raise ValueError(f"friction: {key} must have one value per joint, not {value}")
            if not np.all(np.isfinite(value)):
                raise ValueError(f"friction: {key} has a value that is not finite: {value}")

    @classmethod
    def zero(cls, num_joints: int) -> "CoulombViscous":
        """Returns the law of a joint without friction."""
        return cls(np.zeros(num_joints), np.zeros(num_joints), np.zeros(num_joints))

    @property
    def num_joints(self) -> int:
        """Number of joints, n."""
        return int(self.coulomb.shape[0])

    def torque(self, v: ArrayLike) -> Array:
        """Returns tau_f in N m for v ((n,) or (N, n), rad/s), same shape; sgn(0) is 0."""
        v = np.asarray(v, float)
        return np.asarray(self.offset + self.coulomb * np.sign(v) + self.viscous * v)
