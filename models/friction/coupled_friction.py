"""Friction of motors that move several joints each, mapped to the joints.

    q_motor = D q,   tau_f(q, v) = D^T f(D q, D v),   load of a motor = D^-T load of the joints

with f any law of this sub-package and D = `motor_rates` of `models.robot.coupling`. Where a wrist's
last motor turns along with the joint before it, that joint has the friction of both: TX40's joint 5
moves against the friction of motors 5 and 6.
"""

from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any, Self

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from wrenchsight.models.friction.extended_friction import LayeredFriction
from wrenchsight.models.friction.friction_law import FrictionLaw
from wrenchsight.models.friction.slip_elements import FrictionKernels
from wrenchsight.models.friction.velocity_friction import (
    CoulombViscous,
    SemiParametricFriction,
    friction_torque,
)
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import kernel

_VELOCITY_COLUMNS = 7  # of the velocity law's table, which has no networks here


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

    @property
    def kernels(self) -> FrictionKernels:
        """The kernels of the law below, between the maps to the motors and back."""
        return _kernels(self.law.kernels, self.law.state_rows > 0)

    @cached_property
    def slip_table(self) -> Array:
        """(n, ...) table of the law below, table of its velocity law, D and its inverse."""
        D = self.motor_rates
        parts = [self.law.slip_table, self.law.velocity_law.table, D, np.linalg.inv(D)]
        return np.ascontiguousarray(np.hstack(parts))

    def torque_along(self, q: Array, v: Array, load: Array) -> Array:
        """tau_f (N, n) in N m along a log that starts at rest, for the joints' load L."""
        D = self.motor_rates
        tau_motor = self.law.torque_along(
            np.asarray(q, float) @ D.T,
            np.asarray(v, float) @ D.T,
            np.asarray(load, float) @ np.linalg.inv(D),
        )
        return np.asarray(tau_motor @ D)


@cache
def _kernels(law_kernels: FrictionKernels, has_state: bool) -> FrictionKernels:
    """The composed kernels; `extended_friction` states which of them are cached on disk."""
    add_law_torque, update_law = law_kernels.add_torque, law_kernels.update

    @njit(error_model="numpy")
    def add_torque(table: Array, state: Array, q: Array, v: Array, tau_f: Array) -> None:
        n = table.shape[0]
        slip_columns = table.shape[1] - 2 * n - _VELOCITY_COLUMNS
        D = table[:, table.shape[1] - 2 * n : table.shape[1] - n]
        motor = np.zeros((3, n))
        product(D, q, motor[0])
        product(D, v, motor[1])
        friction_torque(
            np.ascontiguousarray(table[:, slip_columns : slip_columns + _VELOCITY_COLUMNS]),
            motor[1],
            motor[2],
        )
        if has_state:
            add_law_torque(
                np.ascontiguousarray(table[:, :slip_columns]), state, motor[0], motor[1], motor[2]
            )
        add_transposed_product(D, motor[2], tau_f)

    @njit(error_model="numpy")
    def update(table: Array, state: Array, q: Array, v: Array, transmitted: Array) -> None:
        if has_state:
            n = table.shape[0]
            slip_columns = table.shape[1] - 2 * n - _VELOCITY_COLUMNS
            D = table[:, table.shape[1] - 2 * n : table.shape[1] - n]
            motor = np.zeros((3, n))
            product(D, q, motor[0])
            product(D, v, motor[1])
            add_transposed_product(table[:, table.shape[1] - n :], transmitted, motor[2])
            update_law(
                np.ascontiguousarray(table[:, :slip_columns]), state, motor[0], motor[1], motor[2]
            )

    return FrictionKernels(add_torque, update, law_kernels)


@kernel
def product(A: Array, x: Array, Ax: Array) -> None:
    """Writes A x into Ax; a NaN in x spoils only the rows that it belongs to."""
    for i in range(A.shape[0]):
        total = 0.0
        for k in range(A.shape[1]):
            if A[i, k] != 0.0:
                total += A[i, k] * x[k]
        Ax[i] = total


@kernel
def add_transposed_product(A: Array, x: Array, total: Array) -> None:
    """Adds A^T x to `total`; NaN as in `product`."""
    for i in range(A.shape[0]):
        for k in range(A.shape[1]):
            if A[i, k] != 0.0:
                total[k] += A[i, k] * x[i]


def joint_side(law: FrictionLaw, columns: Any) -> Array:
    """Sums sizes (n, k) of a law's motors for each joint that turns them; else the sizes."""
    if isinstance(law, CoupledFriction):
        return np.asarray(np.abs(law.motor_rates).T @ columns)
    return np.asarray(columns)
