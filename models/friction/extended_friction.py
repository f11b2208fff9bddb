"""Friction laws on top of others: their base class, and a law with further `friction_terms`."""

from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any, Self

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from wrenchsight.models.friction.friction_law import FrictionLaw
from wrenchsight.models.friction.friction_terms import FrictionTerm
from wrenchsight.models.friction.slip_elements import FrictionKernels
from wrenchsight.models.friction.velocity_friction import CoulombViscous, SemiParametricFriction
from wrenchsight.models.numerics.arrays import Array


@dataclass(frozen=True, eq=False)
class LayeredFriction:
    """A friction law on top of another one; what it does not override is that of the law below.

    Attributes:
        law: below.
    """

    law: FrictionLaw

    @property
    def num_joints(self) -> int:
        """Number of joints, n."""
        return self.law.num_joints

    @property
    def coulomb_viscous(self) -> CoulombViscous:
        """The coefficients of the law below."""
        return self.law.coulomb_viscous

    @property
    def feedforward(self) -> SemiParametricFriction:
        """The feed-forward of the law below: a layer needs a position."""
        return self.law.feedforward

    @property
    def velocity_law(self) -> SemiParametricFriction:
        """The velocity law of the law below."""
        return self.law.velocity_law

    def sampled(self, time_step: float, resolution: ArrayLike | None = None) -> Self:
        """As `FrictionLaw.sampled`: the same layer on the sampled law below."""
        return replace(self, law=self.law.sampled(time_step, resolution))

    @property
    def state_rows(self) -> int:
        """Rows of the law below; one at least, so that the layer's kernels are called."""
        return max(1, self.law.state_rows)

    def initial_state(self) -> Array:
        """The state of the law below; a row of zeros if it has none."""
        state = self.law.initial_state()
        return state if len(state) else np.zeros((1, self.num_joints))

    @property
    def parameters(self) -> dict[str, Array]:
        """The parameters of the law below."""
        return self.law.parameters

    def with_parameters(self, values: dict[str, Array]) -> Self:
        """Returns the layer on the law below with other parameters."""
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
        coefficients = np.array(self.coefficients, float)
        object.__setattr__(self, "coefficients", coefficients)
        if not self.terms or coefficients.shape != (self.law.num_joints, len(self.terms)):
            expected = f"({self.law.num_joints}, {len(self.terms)})"
            raise ValueError(f"friction: coefficients must be {expected}, not {coefficients.shape}")
        if not np.isfinite(coefficients).all():
            raise ValueError(f"friction: a coefficient is not finite: {coefficients}")

    @property
    def kernels(self) -> FrictionKernels:
        """The kernels of the law below, and the terms after them."""
        has_state = self.law.state_rows > 0
        return _kernels(self.law.kernels, tuple(term.basis for term in self.terms), has_state)

    @cached_property
    def slip_table(self) -> Array:
        """The table of the law below, then the coefficients."""
        return np.ascontiguousarray(np.hstack([self.law.slip_table, self.coefficients]))

    @property
    def parameters(self) -> dict[str, Array]:
        """The parameters of the law below, and `terms` (n, T)."""
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
def _kernels(
    law_kernels: FrictionKernels, bases: tuple[Any, ...], has_state: bool
) -> FrictionKernels:
    """The composed kernels.

    They belong to no file, so that numba caches no copy of them on disk. A tick that calls them is
    cached: see `wrenchsight.models.estimation.kernel_choice`.
    """
    num_terms = len(bases)
    add_law_torque, update_law = law_kernels.add_torque, law_kernels.update
    terms_torque = _total(bases)

    @njit(error_model="numpy")
    def add_torque(table: Array, state: Array, q: Array, v: Array, tau_f: Array) -> None:
        slip_columns = table.shape[1] - num_terms
        if has_state:
            add_law_torque(np.ascontiguousarray(table[:, :slip_columns]), state, q, v, tau_f)
        for i in range(table.shape[0]):
            tau_f[i] += terms_torque(table[i, slip_columns:], q[i], v[i])

    @njit(error_model="numpy")
    def update(table: Array, state: Array, q: Array, v: Array, transmitted: Array) -> None:
        if has_state:
            slip_columns = table.shape[1] - num_terms
            update_law(np.ascontiguousarray(table[:, :slip_columns]), state, q, v, transmitted)

    return FrictionKernels(add_torque, update, (*law_kernels, *bases))


def _total(bases: tuple[Any, ...]) -> Any:
    """The compiled sum of coefficient times basis; each sum calls that of the first terms."""
    last_basis, k = bases[-1], len(bases) - 1
    if k == 0:
        return njit(error_model="numpy")(lambda c, q, v: c[0] * last_basis(q, v))
    sum_of_first = _total(bases[:-1])
    return njit(error_model="numpy")(
        lambda c, q, v: sum_of_first(c, q, v) + c[k] * last_basis(q, v)
    )
