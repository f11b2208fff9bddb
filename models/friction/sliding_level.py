"""Parts of a presliding law that an error model needs: the sliding level, and the slip's side."""

import numpy as np

from wrenchsight.models.friction.presliding_friction import PreslidingFriction, slip_path
from wrenchsight.models.numerics.arrays import Array


def sliding_level(law: PreslidingFriction, v: Array, load: Array) -> Array:
    """Dry friction of a joint that slides, (N, n) N m: Coulomb, Stribeck and load part.

    Args:
        v: (N, n) rad/s.
        load: (N, n) or (n,) torque that the gear transmits, N m.
    """
    stribeck = law.stribeck * np.exp(-((v / law.stribeck_velocity) ** 2))
    return np.asarray(law.coulomb + stribeck + law.load * np.abs(load))


def slip_sides(law: PreslidingFriction, v: Array, time_step: float) -> Array:
    """Side that the friction is on, (N, n) from -1 to 1, along a motion that starts relaxed.

    Args:
        v: (N, n) rad/s, whose integral is the displacement.
        time_step: s.
    """
    q = np.cumsum(v, axis=0) * time_step
    sides = np.zeros_like(q)
    for weight, displacement in zip(law.weight.T, law.displacement.T, strict=True):
        sides += weight * slip_path(displacement, q, v)
    return sides


def sliding_torque(law: PreslidingFriction, v: Array, level: Array, side: Array) -> Array:
    """tau_f (N, n) in N m for a level and a side: all parts of the law together."""
    return np.asarray(law.velocity_law.torque(v) + law.cubic * v**3 + level * side)
