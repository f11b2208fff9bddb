"""Friction of motors that move several joints each, mapped to the joints.

    q_motor = D q,   tau_f(q, v) = D^T f(D q, D v),   load of a motor = D^-T load of the joints

with f any law of this sub-package and D = `motor_rates` of `models.robot.coupling`. Where a wrist's
last motor turns along with the joint before it, that joint has the friction of both: TX40's joint 5
moves against the friction of motors 5 and 6.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.extended_friction import LayeredFriction
from wrenchsight.models.friction.friction_law import FrictionLaw
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.friction.slip_elements import SlipElements
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.sparse_products import products


@dataclass(frozen=True, eq=False)
class CoupledFriction(LayeredFriction):
    """tau_f = D^T f(D q, D v); a `friction_law.FrictionLaw`.

    Attributes:
        law: f, one entry a motor.
        motor_rates: (n, n) D.

    Raises:
        ValueError: shapes that disagree, a D without an inverse, or a law with networks, which are
            trained on the friction of single joints.
    """

    motor_rates: Array

    def __post_init__(self) -> None:
        n = self.law.num_joints
        D = np.array(self.motor_rates, float)
        object.__setattr__(self, "motor_rates", D)
        if D.shape != (n, n) or not np.isfinite(D).all() or np.linalg.matrix_rank(D) < n:
            raise ValueError(f"friction: motor_rates must be an invertible ({n}, {n}), not {D}")
        if self.law.velocity_law.networks is not None:
            raise ValueError("friction: networks are for motors that move one joint each")

    @property
    def feedforward(self) -> SemiParametricFriction:
        """The friction of a joint that moves alone: of all motors that it turns."""
        motor_law = self.law.feedforward.coulomb_viscous
        D = self.motor_rates
        size = np.abs(D)
        return SemiParametricFriction(
            CoulombViscous(
                size.T @ motor_law.coulomb, (D**2).T @ motor_law.viscous, D.T @ motor_law.offset
            )
        )

    @property
    def velocity_law(self) -> SemiParametricFriction:
        """Zero: a joint's friction is no function of its own velocity alone."""
        return SemiParametricFriction(CoulombViscous.zero(self.num_joints))

    def sampled(self, time_step: float, resolution: ArrayLike | None = None) -> Self:
        """As `FrictionLaw.sampled`; a motor's step is that of all joints it moves together."""
        if resolution is not None:
            step = np.broadcast_to(np.asarray(resolution, float), (self.num_joints,))
            resolution = np.abs(self.motor_rates) @ step
        return replace(self, law=self.law.sampled(time_step, resolution))

    @cached_property
    def elements(self) -> SlipElements:
        """The slip elements of the law below, one row a motor.

        Raises:
            ValueError: the law below is of coupled motors itself.
        """
        below = self.law.elements
        if len(below.motor_rates):
            raise ValueError("friction: the law of a motor is not that of coupled ones")
        return SlipElements(
            below.table, self.motor_rates, np.asarray(np.linalg.inv(self.motor_rates), float)
        )

    @cached_property
    def resting(self) -> tuple[Array, Array]:
        """Offset (n,) in N m and viscous coefficient (n,) in N m s/rad of a joint moving alone."""
        return self.feedforward.resting

    def direct(self, q: Array, v: Array) -> Array:
        """D^T times that of the law below (N, n) in N m."""
        D = self.motor_rates
        return products(D.T, self.law.direct(products(D, q), products(D, v)))

    def torque_along(self, q: Array, v: Array, load: Array) -> Array:
        """tau_f (N, n) in N m along a log that starts at rest, for the joints' load L."""
        D = self.motor_rates
        tau_motor = self.law.torque_along(
            np.asarray(q, float) @ D.T,
            np.asarray(v, float) @ D.T,
            np.asarray(load, float) @ np.linalg.inv(D),
        )
        return np.asarray(tau_motor @ D)


def joint_side(law: FrictionLaw, columns: Any) -> Array:
    """Sums sizes (n, k) of a law's motors for each joint that turns them; else the sizes."""
    if isinstance(law, CoupledFriction):
        return np.asarray(np.abs(law.motor_rates).T @ columns)
    return np.asarray(columns)
