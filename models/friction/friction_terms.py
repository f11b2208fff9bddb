"""Registry of further friction terms, which any law can carry.

A term is one number a joint, its coefficient, times a function of the joint's position and
velocity. Fit and estimator use the same compiled function, so that what is fitted is what is run.
With a term registered here, `identify --friction` knows the laws "<law>+<term>", model.yaml stores
the coefficients, and every estimator runs them.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numba import njit

from wrenchsight.models.numerics.arrays import Array


@dataclass(frozen=True)
class FrictionTerm:
    """A friction term.

    Attributes:
        name: name of the term and its coefficient; the key in model.yaml.
        basis: `numba.njit` of (q, v) in rad and rad/s (m and m/s), floats: torque in N m for a
            coefficient of one, positive where it opposes positive motion.
        laws: laws of `friction_structure.STRUCTURES` on top of which it can be fitted.
        least, most: bounds of the coefficient, in a fit that is restricted to physical robots.
    """

    name: str
    basis: Any
    laws: tuple[str, ...] = ("presliding",)
    least: float = -np.inf
    most: float = np.inf

    def column(self, q: Array, v: Array) -> Array:
        """The torque (N,) in N m of one joint along a log, (N,) each, for a coefficient of one."""
        torque = np.empty(len(q))
        _column_kernel(self.basis)(np.ascontiguousarray(q), np.ascontiguousarray(v), torque)
        return torque


TERMS: list[FrictionTerm] = []
"""The registered terms. To add one: one line here, or one `TERMS.append` in another program."""


def term_of(name: str) -> FrictionTerm | None:
    """Returns the registered term of this name; None if there is none."""
    return next((term for term in TERMS if term.name == name), None)


@cache
def _column_kernel(basis: Any) -> Any:
    @njit(error_model="numpy")
    def column(q: Array, v: Array, out: Array) -> None:
        for k in range(q.shape[0]):
            out[k] = basis(q[k], v[k])

    return column
