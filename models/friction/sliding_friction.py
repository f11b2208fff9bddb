"""The part of a friction law that drifts from day to day: Coulomb, viscous and offset.

Lubricant and temperature move a joint's viscous friction by tens of per cent and its Coulomb
friction by a few, while the law's shape stays. Every friction law here is linear in these three
numbers per joint. This includes a law with a network near zero velocity, since the network is
shifted to meet the law at its edges.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.coupled_friction import CoupledFriction, joint_side
from wrenchsight.models.friction.extended_friction import LayeredFriction
from wrenchsight.models.friction.friction_law import FrictionLaw
from wrenchsight.models.friction.presliding_friction import PreslidingFriction
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.friction.slip_elements import (
    COULOMB,
    CUBIC,
    LOAD,
    SLIDING_COLUMNS,
    SLOPE_BEYOND,
    SPEED_LIMIT,
    STRIBECK,
    held_stribeck,
)
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.numerics.finite import LARGEST_INPUT, all_below


class SlidingTerm(NamedTuple):
    """A coefficient that drifts.

    Attributes:
        name: of it, as a field of CoulombViscous.
        unit: of it.
        unit_key: its unit, as the keys of metrics have it.
    """

    name: str
    unit: str
    unit_key: str


SLIDING_TERMS: tuple[SlidingTerm, ...] = (
    SlidingTerm("coulomb", "N m", "nm"),
    SlidingTerm("viscous", "N m s/rad", "nms_per_rad"),
    SlidingTerm("offset", "N m", "nm"),
)
OF_MOTION = slice(0, 2)  # of them: Coulomb and viscous friction, which only motion shows


def with_sliding(law: FrictionLaw, sliding: CoulombViscous) -> FrictionLaw:
    """Returns the law with other Coulomb, viscous and offset coefficients.

    Raises:
        TypeError: a law of another kind.
        ValueError: as the laws' constructors.
    """
    if isinstance(law, PreslidingFriction):
        velocity_law = replace(
            law.velocity_law,
            coulomb_viscous=replace(sliding, coulomb=np.zeros(law.num_joints)),
        )
        return replace(law, velocity_law=velocity_law, coulomb=sliding.coulomb)
    if isinstance(law, SemiParametricFriction):
        return replace(law, coulomb_viscous=sliding)
    if isinstance(law, LayeredFriction):
        return replace(law, law=with_sliding(law.law, sliding))
    raise TypeError(f"friction: {type(law).__name__} has no sliding part to exchange")


def sliding_columns(law: FrictionLaw, q: Array, v: Array, load: Array) -> Array:
    """Returns the derivative (N, n, 3) of tau_f along a log by each of SLIDING_TERMS.

    Args:
        law: the friction law.
        q: (N, n) rad (m), as v and load.
        v: (N, n) rad/s (m/s).
        load: (N, n) transmitted torque, N m.
    """
    coefficients = law.coulomb_viscous
    tau_f = law.torque_along(q, v, load)
    columns = []
    for term in SLIDING_TERMS:
        increased = replace(coefficients, **{term.name: getattr(coefficients, term.name) + 1.0})
        columns.append(with_sliding(law, increased).torque_along(q, v, load) - tau_f)
    return np.stack(columns, axis=2)


class SlidingLaw(NamedTuple):
    """What the torque error needs of a friction law, joint by joint, (n,) each; in numbers alone.

    The level C + S exp(-(v / v_s)^2) + l |L| is half the stiction band, for the torque L that the
    gear transmits.

    Attributes:
        coulomb, stribeck: C and S, N m.
        inverse_speed: 1 / v_s, s/rad.
        load: l, N m per N m.
        cubic: N m s^3/rad^3.
        speed_limit: rad/s, up to which the law was fitted; inf: everywhere.
        slope_beyond: N m s/rad, of the cubic part beyond it.
        viscous: N m s/rad.
        offset: N m.
        remembers: 1 where a joint keeps its slip where it stops, else 0.
    """

    coulomb: Array
    stribeck: Array
    inverse_speed: Array
    load: Array
    cubic: Array
    speed_limit: Array
    slope_beyond: Array
    viscous: Array
    offset: Array
    remembers: Array

    @classmethod
    def of(cls, law: FrictionLaw) -> "SlidingLaw":
        """The numbers of a law."""
        sliding = law.feedforward.coulomb_viscous
        has_memory = remembers(law).astype(float)
        return cls._make([*sliding_table(law).T, sliding.viscous, sliding.offset, has_memory])

    @classmethod
    def of_flat(cls, flat: Array) -> "SlidingLaw":
        """The law whose numbers stand one array after another in a vector, as `flat`."""
        return cls._make(flat.reshape(len(cls._fields), -1))

    @property
    def flat(self) -> Array:
        """(10 n,) all numbers."""
        return np.concatenate(self)

    @property
    def is_usable(self) -> bool:
        """Whether all is finite and below LARGEST_INPUT, but for speed limits, which may be inf."""
        others = self._replace(speed_limit=np.zeros_like(self.speed_limit))
        return all_below(others.flat, LARGEST_INPUT) and bool((self.speed_limit > 0.0).all())


def sliding_table(law: FrictionLaw) -> Array:
    """(n, SLIDING_COLUMNS) of `slip_elements`; without memory Coulomb friction is the level."""
    if isinstance(law, CoupledFriction):
        motor_table = sliding_table(law.law)
        sizes = (COULOMB, STRIBECK, LOAD, CUBIC, SLOPE_BEYOND)
        motor_table[:, sizes] = joint_side(law, motor_table[:, sizes])
        return motor_table
    if isinstance(law, LayeredFriction):
        return sliding_table(law.law)
    if law.state_rows > 0:
        return np.array(law.elements.table[:, :SLIDING_COLUMNS])
    columns = np.zeros((law.num_joints, SLIDING_COLUMNS))
    columns[:, COULOMB] = law.coulomb_viscous.coulomb
    columns[:, SPEED_LIMIT] = np.inf
    return columns


def remembers(law: FrictionLaw) -> Flags:
    """(n,) whether a joint keeps its slip where it stops: some element of it is elastic."""
    if isinstance(law, CoupledFriction):
        turned = np.abs(law.motor_rates[remembers(law.law)]) > 0.0
        return np.asarray(turned.any(axis=0))
    if isinstance(law, LayeredFriction):
        return remembers(law.law)
    if isinstance(law, PreslidingFriction):
        return np.asarray((law.weight * law.displacement > 0.0).any(axis=1))
    return np.zeros(law.num_joints, bool)


def dry_and_viscous(law: FrictionLaw, q: Array, v: Array, load: Array) -> tuple[Array, Array]:
    """Returns tau_f (N, n) along a log, without the offset, in two parts: dry and viscous.

    The viscous part is that of the viscous and cubic coefficients. A network near zero velocity and
    further terms are dry.
    """
    coefficients = law.coulomb_viscous
    dry_law = with_sliding(
        law,
        replace(coefficients, viscous=0.0 * coefficients.viscous, offset=0.0 * coefficients.offset),
    )
    dry = _without_cubic(dry_law).torque_along(q, v, load)
    return dry, law.torque_along(q, v, load) - dry - coefficients.offset


def stiction(law: FrictionLaw, load: Array) -> Array:
    """Returns the largest torque (N, n) in N m that each joint's friction takes at rest.

    Args:
        law: the friction law.
        load: (N, n) transmitted torque, N m.
    """
    if isinstance(law, CoupledFriction):
        motor_stiction = stiction(law.law, load @ np.linalg.inv(law.motor_rates))
        return joint_side(law, motor_stiction.T).T
    if isinstance(law, LayeredFriction):
        return stiction(law.law, load)
    if isinstance(law, PreslidingFriction):
        level = law.coulomb + held_stribeck(law.coulomb, law.stribeck)
        return np.maximum(level + law.load * np.abs(load), 0.0)
    return np.broadcast_to(np.abs(law.coulomb_viscous.coulomb), load.shape)


def _without_cubic(law: FrictionLaw) -> FrictionLaw:
    if isinstance(law, LayeredFriction):
        return replace(law, law=_without_cubic(law.law))
    if isinstance(law, PreslidingFriction):
        return replace(law, cubic=np.zeros(law.num_joints))
    return law
