"""Friction laws on top of others: their base class, and a law with further `friction_terms`."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.friction_law import FrictionLaw
from wrenchsight.models.friction.friction_terms import FrictionTerm
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.friction.slip_elements import SlipElements, run_friction
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
    def resting(self) -> tuple[Array, Array]:
        """That of the law below."""
        return self.law.resting

    @property
    def is_of_speed_alone(self) -> bool:
        """False: a layer needs a position, or the speeds of other joints."""
        return False

    @property
    def elements(self) -> SlipElements:
        """The slip elements of the law below."""
        return self.law.elements

    @property
    def state_rows(self) -> int:
        """Rows of the law below."""
        return self.law.state_rows

    def initial_state(self) -> Array:
        """The state of the law below."""
        return self.law.initial_state()

    def direct(self, q: Array, v: Array) -> Array:
        """That of the law below."""
        return self.law.direct(q, v)

    def run(
        self, state: Array, q: Array, v: Array, tau_J: Array, rest: Array | None = None
    ) -> Array:
        """tau_f (N, n) in N m of N samples; see `FrictionLaw`."""
        return run_friction(self, state, q, v, tau_J, rest)

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

    def direct(self, q: Array, v: Array) -> Array:
        """That of the law below, and the terms (N, n) in N m."""
        tau_f = self.law.direct(q, v)
        self._add_terms(q, v, tau_f)
        return tau_f

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
        self._add_terms(q, v, tau_f)
        return tau_f

    def _add_terms(self, q: Array, v: Array, tau_f: Array) -> None:
        for k, term in enumerate(self.terms):
            for j in range(self.num_joints):
                tau_f[:, j] += self.coefficients[j, k] * term.column(q[:, j], v[:, j])
