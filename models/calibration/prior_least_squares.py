"""Least squares of whitened rows, joint by joint, with a Gaussian prior on what is sought.

    minimise  sum_j |A_j x - b_j|^2 / s_j^2 + |(x - mean) / sd|^2

The scale s_j states by how much a joint's rows scatter more or less than their stated covariance.
It has a prior itself, as if COVARIANCE_ROWS rows had shown a scale of one. The reason is that a log
of seconds cannot measure its own noise, while one of minutes can.

    s_j^2 = (COVARIANCE_ROWS + |A_j x - b_j|^2) / (COVARIANCE_ROWS + m_j)

The logarithm of the evidence compares fits of the same rows with other columns. The scales are
integrated out, and x by Laplace's method:

    -1/2 sum_j (COVARIANCE_ROWS + m_j) log(COVARIANCE_ROWS + |A_j x - b_j|^2) - 1/2 |(x - mean) /
    sd|^2 -1/2 log det(1 + sd A^T A sd)
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import lstsq, solve_triangular

from wrenchsight.models.identification.base_parameters import triangular_factor
from wrenchsight.models.numerics.arrays import Array

COVARIANCE_ROWS = 30.0  # rows, what the stated covariance is worth
_NUM_PASSES = 5


@dataclass(frozen=True, eq=False)
class PriorFit:
    """Solution of the least squares.

    Attributes:
        values: (k,).
        covariance: (k, k), the prior included.
        scale: (n,) s_j.
        log_evidence: up to a constant of the rows' right sides; NaN with an infinite prior.
    """

    values: Array
    covariance: Array
    scale: Array
    log_evidence: float

    @property
    def standard_deviation(self) -> Array:
        """(k,) of the values."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


def fit_with_prior(rows: Sequence[Array], prior_sd: Array, prior_mean: Array) -> PriorFit:
    """Solves the least squares of this module.

    Args:
        rows: rows of each joint (m_j, k + 1), whitened: the columns A_j, then b_j.
        prior_sd: (k,) positive; infinite where nothing is known.
        prior_mean: (k,).

    Returns:
        Values (k,), covariance (k, k), `scale` of each joint's errors over their stated sd, and the
        log evidence up to a constant of the rows; NaN where a prior is infinite.

    Raises:
        ValueError: numbers that are not finite, sds that are not positive, or a value that neither
            rows nor prior determine.
    """
    k = len(prior_sd)
    if any(joint_rows.shape[1] != k + 1 for joint_rows in rows) or prior_mean.shape != (k,):
        raise ValueError(f"least squares: expected {k} columns and the right side")
    if not (prior_sd > 0.0).all() or not all(np.isfinite(joint_rows).all() for joint_rows in rows):
        raise ValueError("least squares: expected finite rows and positive sds of the prior")
    # From here on x is in units of the prior's sd, or of the columns' length where it is infinite.
    reach = np.sqrt(sum((joint_rows[:, :-1] ** 2).sum(axis=0) for joint_rows in rows))
    unit = np.where(np.isfinite(prior_sd), prior_sd, 1.0 / np.maximum(reach, 1e-300))
    has_prior = np.isfinite(prior_sd).astype(float)
    # Of each joint's rows the triangular factor of [A_j unit, b_j - A_j mean]: the same least
    # squares in k + 1 rows.
    factors = []
    for joint_rows in rows:
        shifted = np.column_stack(
            [
                joint_rows[:, :-1] * unit,
                joint_rows[:, -1] - joint_rows[:, :-1] @ prior_mean,
            ]
        )
        factors.append(triangular_factor(shifted))
    # In turns the solution, and the factor of each joint's errors over their stated sd.
    counts = np.array([len(joint_rows) for joint_rows in rows])
    scale = np.ones(len(rows))
    for _ in range(_NUM_PASSES):
        stacked = np.vstack(
            [
                *(R / s for R, s in zip(factors, scale, strict=True)),
                np.column_stack([np.diag(has_prior), np.zeros(k)]),
            ]
        )
        y = lstsq(stacked[:, :-1], stacked[:, -1])[0]
        errors = np.array([np.sum((R[:, :-1] @ y - R[:, -1]) ** 2) for R in factors])
        scale = np.sqrt((COVARIANCE_ROWS + errors) / (COVARIANCE_ROWS + counts))
    R = triangular_factor(stacked[:, :-1])  # the posterior's information is R^T R
    if np.abs(np.diag(R)).min() < 1e-9 * np.abs(R).max():
        raise ValueError("least squares: neither rows nor prior determine a value")
    spread = solve_triangular(R, np.eye(k)) * unit[:, None]
    evidence = np.nan
    if has_prior.all():
        evidence = -0.5 * float(
            np.sum((COVARIANCE_ROWS + counts) * np.log(COVARIANCE_ROWS + errors)) + y @ y
        )
        evidence -= float(np.log(np.abs(np.diag(R))).sum())
    return PriorFit(prior_mean + unit * y, spread @ spread.T, scale, evidence)
