"""The least squares of an identification, restricted to physical robots.

A link's ten inertial parameters belong to some distribution of mass exactly if its pseudo-inertia

    [ tr(I)/2 1 - I   h ]
    [       h^T       m ],    h = m c, I about the same point,

is positive semidefinite (Wensing, Kim and Slotine, IEEE Robotics and Automation Letters 3(1),
2018): positive mass, positive principal moments, and the triangle inequality in one. Minimised is

    |A x - b|^2 + |(x - prior) / spread|^2

with A, b the weighted rows, reduced to a triangle (QR) so that the size of the semidefinite program
does not depend on the logs' length. The second term is a Gaussian prior about the values of the
robot's files. Its sd is one spread, which is as much as a link's whole mass. It decides what the
data do not determine, and is negligible beside thousands of rows in units of their sd. Friction and
rotor inertia, which few files state, have almost no prior.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from pydrake.solvers import ClarabelSolver, MathematicalProgram

from wrenchsight.models.friction.friction_structure import LARGEST_LOAD, FrictionStructure
from wrenchsight.models.friction.friction_terms import term_of
from wrenchsight.models.identification.base_parameters import triangular_factor
from wrenchsight.models.identification.torque_regression import (
    NUM_INERTIAL,
    ParameterColumns,
    parameter_columns,
)
from wrenchsight.models.numerics.arrays import Array

MIN_EIGENVALUE = 1e-4  # least eigenvalue of a scaled pseudo-inertia: inside, whatever rounding does
DRIVE_PRIOR = 1e-3  # weight of the prior on rotor inertia and friction
# Places in a tensor of Ixx, Ixy, Iyy, Ixz, Iyz, Izz, the last six of the ten parameters.
TENSOR_PLACES = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))


@dataclass(frozen=True, eq=False)
class ConsistentFit:
    """Solution of the program.

    Attributes:
        x: all parameters.
        least_eigenvalue: (n,) of each link's pseudo-inertia, scaled to mass and size of its prior.
    """

    x: Array
    least_eigenvalue: Array


def pseudo_inertia(parameters: Array) -> Array:
    """Returns the (4, 4) pseudo-inertia of m, m c (3), Ixx, Ixy, Iyy, Ixz, Iyz, Izz."""
    return np.asarray(np.einsum("kij,k->ij", _BASIS, np.asarray(parameters, float)))


def least_eigenvalues(inertial: Array, spread: Array) -> Array:
    """Least eigenvalue (n,) of the pseudo-inertia of each link (n, 10), scaled by its spread."""
    return np.array(
        [
            np.linalg.eigvalsh(_scaling(s) @ pseudo_inertia(parameters) @ _scaling(s))[0]
            for parameters, s in zip(inertial, spread, strict=True)
        ]
    )


def fit_consistent(
    A: Array,
    b: Array,
    prior: Array,
    spread: Array,
    structure: FrictionStructure,
    v_max: Array,
) -> ConsistentFit:
    """Solves the semidefinite program.

    Args:
        A: (m, p) rows of the regression, in units of the residual's sd.
        b: (m,) torque, likewise.
        prior: (p,) `models.identification.torque_regression.parameter_prior`.
        spread: (p,) likewise.
        structure: friction terms behind the inertial parameters.
        v_max: (n,) rad/s, up to where friction must oppose motion.

    Raises:
        ValueError: the solver finds no solution.
    """
    p = A.shape[1]
    columns = parameter_columns([len(terms) for terms in structure.terms])
    # Sought is y of x = prior + spread y: the prior is then |weight y|^2.
    reduced = triangular_factor(np.column_stack([A * spread, b - A @ prior]))
    weight = np.full(p, DRIVE_PRIOR)
    weight[columns.inertial] = 1.0
    rows = np.vstack([reduced[:, :-1], np.diag(weight)])
    right = np.concatenate([reduced[:, -1], np.zeros(p)])
    program = MathematicalProgram()
    y = program.NewContinuousVariables(p, "y")
    # |rows y - right| and not its square: a cone keeps A's conditioning, a square squares it. It is
    # divided by |right|, as the solver's tolerances are for numbers about one.
    length = np.linalg.norm(right)
    program.AddL2NormCostUsingConicConstraint(rows / length, -right / length, y)
    for link_columns in columns.inertial:
        F = _scaled_pseudo_inertia(prior[link_columns], spread[link_columns])
        program.AddLinearMatrixInequalityConstraint([(f + f.T) / 2 for f in F], y[link_columns])
    for bound in _friction_bounds(structure, columns, v_max):
        at_prior = float(bound.weights @ prior)
        program.AddLinearConstraint(
            (bound.weights * spread)[None],
            [bound.least - at_prior],
            [bound.most - at_prior],
            y,
        )
    solver = ClarabelSolver()
    result = solver.Solve(program)
    if not result.is_success():
        raise ValueError(f"the consistent fit has no solution: {result.get_solution_result()}")
    x = prior + spread * result.GetSolution(y)
    eigenvalues = least_eigenvalues(x[columns.inertial], spread[columns.inertial])
    return ConsistentFit(x=x, least_eigenvalue=eigenvalues)


def _scaled_pseudo_inertia(prior: Array, spread: Array) -> list[Array]:
    """F (4, 4), of which F[0] + sum y_k F[k + 1] must be semidefinite for prior + spread y.

    It is a link's pseudo-inertia, scaled to mass and size of its prior, less MIN_EIGENVALUE.

    Args:
        prior, spread: (10,) of the link.
    """
    S = _scaling(spread)
    at_prior = S @ pseudo_inertia(prior) @ S - MIN_EIGENVALUE * np.eye(4)
    return [at_prior, *(S @ _BASIS[k] @ S * spread[k] for k in range(NUM_INERTIAL))]


class _Bound(NamedTuple):
    """least <= weights @ x <= most, of all parameters x (p,)."""

    weights: Array
    least: float
    most: float


def _friction_bounds(
    structure: FrictionStructure, columns: ParameterColumns, v_max: Array
) -> list[_Bound]:
    """Bounds on rotor inertia, and on friction so that it takes energy out of motion.

    Friction opposes motion from standstill (Coulomb with Stribeck) up to v_max (viscous with
    cubic), both zero or more.

    Args:
        structure: friction terms of each joint.
        columns: their places in x, and the rotors'.
        v_max: (n,) rad/s, up to where friction must oppose motion.
    """
    bounds: list[_Bound] = []
    for j, terms in enumerate(structure.terms):
        place = dict(zip(terms, columns.friction[j], strict=True))  # in x

        def weights_of(**weights: float) -> Array:
            """(p,) weights of terms; terms that the joint has not are left out."""
            out = np.zeros(columns.torque)
            for term, weight in weights.items():
                if term in place:  # noqa: B023  # called within this turn of the loop
                    out[place[term]] = weight  # noqa: B023
            return out

        rotor = np.zeros(columns.torque)
        rotor[columns.rotor[j]] = 1.0
        at_least_zero = [rotor, weights_of(coulomb=1.0), weights_of(viscous=1.0)]
        if "stribeck" in terms:
            at_least_zero.append(weights_of(coulomb=1.0, stribeck=1.0))
        bounds += [_Bound(weights, 0.0, np.inf) for weights in at_least_zero]
        if "load" in terms:
            bounds.append(_Bound(weights_of(load=1.0), 0.0, LARGEST_LOAD))
        if "cubic" in terms:
            at_v_max = weights_of(viscous=1.0, cubic=float(v_max[j]) ** 2)
            bounds.append(_Bound(at_v_max, 0.0, np.inf))
        for registered_term in map(term_of, terms):
            if registered_term is not None:
                weights = weights_of(**{registered_term.name: 1.0})
                bounds.append(_Bound(weights, registered_term.least, registered_term.most))
    return bounds


def _scaling(spread: Array) -> Array:
    """Makes a pseudo-inertia dimensionless: sqrt of its spread's mass, and length."""
    size = np.sqrt(spread[4] / spread[0])
    return np.asarray(np.diag([1.0 / size] * 3 + [1.0]) / np.sqrt(spread[0]))


def _basis() -> Array:
    out = np.zeros((NUM_INERTIAL, 4, 4))
    out[0, 3, 3] = 1.0
    for k in range(3):
        out[1 + k, k, 3] = out[1 + k, 3, k] = 1.0
    for k, (i, j) in enumerate(TENSOR_PLACES):
        inertia = np.zeros((3, 3))
        inertia[i, j] = inertia[j, i] = 1.0
        out[4 + k, :3, :3] = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    return out


_BASIS = _basis()


def unphysical_links(inertial: Array, names: Sequence[str]) -> list[str]:
    """Names of the links (n, 10) whose pseudo-inertia is not positive definite."""
    return [
        name
        for name, parameters in zip(names, inertial, strict=True)
        if np.linalg.eigvalsh(pseudo_inertia(parameters))[0] <= 0.0
    ]
