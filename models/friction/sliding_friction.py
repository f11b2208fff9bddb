"""The part of a friction law that drifts from day to day: Coulomb, viscous and offset.

Lubricant and temperature move a joint's viscous friction by tens of per cent and its Coulomb
friction by a few, while the law's shape stays. Every friction law here is linear in these three
numbers per joint, also with a network near zero velocity, which is shifted to meet the law at its
edges.
"""

from dataclasses import replace

import numpy as np

from wrenchsight.models.arrays import Array
from wrenchsight.models.friction.coupled_friction import CoupledFriction, joint_side
from wrenchsight.models.friction.extended_friction import LayeredFriction
from wrenchsight.models.friction.friction_law import FrictionLaw
from wrenchsight.models.friction.presliding_friction import PreslidingFriction
from wrenchsight.models.friction.slip_elements import (
    BEYOND,
    COULOMB,
    CUBIC,
    LOAD,
    SLIDING_COLUMNS,
    SPEED_LIMIT,
    STRIBECK,
    held_stribeck,
)
from wrenchsight.models.friction.velocity_friction import CoulombViscous, SemiParametricFriction

TERMS = ("coulomb", "viscous", "offset")
UNITS = ("N m", "N m s/rad", "N m")
UNIT_KEYS = ("nm", "nms_per_rad", "nm")  # as the keys of metrics have them


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
    """Returns what one unit more of each coefficient adds to tau_f along a log: (N, n, 3).

    Args:
        law: the friction law.
        q: (N, n) rad (m), as v and load.
        v: (N, n) rad/s (m/s).
        load: (N, n) transmitted torque, N m.
    """
    here = law.coulomb_viscous
    before = law.torque_along(q, v, load)
    columns = []
    for term in TERMS:
        more = replace(here, **{term: getattr(here, term) + 1.0})
        columns.append(with_sliding(law, more).torque_along(q, v, load) - before)
    return np.stack(columns, axis=2)


def sliding_table(law: FrictionLaw) -> Array:
    """(n, SLIDING_COLUMNS) of `slip_elements`; without memory Coulomb friction is the level."""
    if isinstance(law, CoupledFriction):
        own = sliding_table(law.law)
        sizes = (COULOMB, STRIBECK, LOAD, CUBIC, BEYOND)
        own[:, sizes] = joint_side(law, own[:, sizes])
        return own
    if isinstance(law, LayeredFriction):
        return sliding_table(law.law)
    if law.state_rows > 0:
        return np.array(law.slip_table[:, :SLIDING_COLUMNS])
    columns = np.zeros((law.num_joints, SLIDING_COLUMNS))
    columns[:, COULOMB] = law.coulomb_viscous.coulomb
    columns[:, SPEED_LIMIT] = np.inf
    return columns


def dry_and_viscous(law: FrictionLaw, q: Array, v: Array, load: Array) -> tuple[Array, Array]:
    """Returns tau_f (N, n) along a log in two parts: without the offset, viscous and cubic
    coefficients, and what these two add. A network near zero velocity and further terms are dry.
    """
    here = law.coulomb_viscous
    bare = with_sliding(law, replace(here, viscous=0.0 * here.viscous, offset=0.0 * here.offset))
    dry = _without_cubic(bare).torque_along(q, v, load)
    return dry, law.torque_along(q, v, load) - dry - here.offset


def stiction(law: FrictionLaw, load: Array) -> Array:
    """Returns the largest torque (N, n) in N m that each joint's friction takes at rest.

    Args:
        law: the friction law.
        load: (N, n) transmitted torque, N m.
    """
    if isinstance(law, CoupledFriction):
        at_motors = stiction(law.law, load @ np.linalg.inv(law.motor_rates))
        return joint_side(law, at_motors.T).T
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
