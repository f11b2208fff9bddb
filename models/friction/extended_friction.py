"""Friction laws on top of others; here, with further terms of `friction_terms`."""

from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any, Self

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from wrenchsight.models.arrays import Array
from wrenchsight.models.friction.friction_law import FrictionLaw
from wrenchsight.models.friction.friction_terms import FrictionTerm
from wrenchsight.models.friction.slip_elements import FrictionKernels
from wrenchsight.models.friction.velocity_friction import CoulombViscous, SemiParametricFriction


@dataclass(frozen=True, eq=False)
class LayeredFriction:
    """A friction law on top of another one; what is not a layer's own is that of the law below.

    Attributes:
        law: below.
    """

    law: FrictionLaw

    @property
    def num_joints(self) -> int:
        """How many joints, n."""
        return self.law.num_joints

    @property
    def coulomb_viscous(self) -> CoulombViscous:
        """The coefficients of the law below."""
        return self.law.coulomb_viscous

    @property
    def feedforward(self) -> SemiParametricFriction:
        """That of the law below: a layer needs a position."""
        return self.law.feedforward

    @property
    def velocity_law(self) -> SemiParametricFriction:
        """That of the law below."""
        return self.law.velocity_law

    def sampled(self, time_step: float, resolution: ArrayLike | None = None) -> Self:
        """The same on the law below for such positions."""
        return replace(self, law=self.law.sampled(time_step, resolution))

    @property
    def state_rows(self) -> int:
        """Rows of the law below; one at least, so that its kernels are called."""
        return max(1, self.law.state_rows)

    def initial_state(self) -> Array:
        """That of the law below; a row of zeros if it has none."""
        own = self.law.initial_state()
        return own if len(own) else np.zeros((1, self.num_joints))

    @property
    def parameters(self) -> dict[str, Array]:
        """Those of the law below."""
        return self.law.parameters

    def with_parameters(self, values: dict[str, Array]) -> Self:
        """Returns the law with other parameters below."""
        return replace(self, law=self.law.with_parameters(values))


@dataclass(frozen=True, eq=False)
class ExtendedFriction(LayeredFriction):
    """tau_f = law + sum_k coefficient_k basis_k(q, v); a `friction_law.FrictionLaw`.

    Attributes:
        terms: T of them, one at least.
        coefficients: (n, T).

    Raises:
        ValueError: shapes that disagree, or a coefficient that is not finite.
    """

    terms: tuple[FrictionTerm, ...]
    coefficients: Array

    def __post_init__(self) -> None:
        given = np.array(self.coefficients, float)
        object.__setattr__(self, "coefficients", given)
        if not self.terms or given.shape != (self.law.num_joints, len(self.terms)):
            expected = f"({self.law.num_joints}, {len(self.terms)})"
            raise ValueError(f"friction: coefficients must be {expected}, not {given.shape}")
        if not np.isfinite(given).all():
            raise ValueError(f"friction: a coefficient is not finite: {given}")

    @property
    def kernels(self) -> FrictionKernels:
        """Those of the law below, and the terms after them."""
        remembers = self.law.state_rows > 0
        return _kernels(self.law.kernels, tuple(term.basis for term in self.terms), remembers)

    @cached_property
    def slip_table(self) -> Array:
        """The table of the law below, then the coefficients."""
        return np.ascontiguousarray(np.hstack([self.law.slip_table, self.coefficients]))

    @property
    def parameters(self) -> dict[str, Array]:
        """Those of the law below, and `terms` (n, T)."""
        return {**super().parameters, "terms": self.coefficients}

    def with_parameters(self, values: dict[str, Array]) -> Self:
        """Returns the law with other parameters."""
        return replace(super().with_parameters(values), coefficients=values["terms"])

    def torque_along(self, q: Array, v: Array, load: Array) -> Array:
        """tau_f (N, n) in N m along a log that starts at rest, for the transmitted torque L."""
        tau_f = np.array(self.law.torque_along(q, v, load))
        for k, term in enumerate(self.terms):
            for j in range(self.num_joints):
                tau_f[:, j] += self.coefficients[j, k] * term.column(q[:, j], v[:, j])
        return tau_f


@cache
def _kernels(below: FrictionKernels, bases: tuple[Any, ...], remembers: bool) -> FrictionKernels:
    """The composed kernels. They belong to no file, so that numba keeps no copy of them on disk; a
    tick that calls them is kept, see `wrenchsight.models.estimation.kernel_choice`."""
    count = len(bases)
    add_below, update_below = below.add_torque, below.update
    total = _total(bases)

    @njit(error_model="numpy")
    def add_torque(table: Array, state: Array, q: Array, v: Array, tau_f: Array) -> None:
        own = table.shape[1] - count
        if remembers:
            add_below(np.ascontiguousarray(table[:, :own]), state, q, v, tau_f)
        for i in range(table.shape[0]):
            tau_f[i] += total(table[i, own:], q[i], v[i])

    @njit(error_model="numpy")
    def update(table: Array, state: Array, q: Array, v: Array, transmitted: Array) -> None:
        if remembers:
            own = table.shape[1] - count
            update_below(np.ascontiguousarray(table[:, :own]), state, q, v, transmitted)

    return FrictionKernels(add_torque, update, (*below, *bases))


def _total(bases: tuple[Any, ...]) -> Any:
    """The compiled sum of coefficient times basis, one function calling the one before."""
    last, k = bases[-1], len(bases) - 1
    if k == 0:
        return njit(error_model="numpy")(lambda c, q, v: c[0] * last(q, v))
    before = _total(bases[:-1])
    return njit(error_model="numpy")(lambda c, q, v: before(c, q, v) + c[k] * last(q, v))
