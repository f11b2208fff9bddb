"""Least squares of whitened rows, joint by joint, with a Gaussian prior on what is sought.

    minimise  sum_j |A_j x - b_j|^2 / s_j^2 + |(x - mean) / sd|^2

The scale s_j states by how much a joint's rows scatter more or less than their stated covariance.
It has a prior itself, as if COVARIANCE_ROWS rows had shown a scale of one. The reason is that a log
of seconds cannot measure its own noise, while one of minutes can.

    s_j^2 = (COVARIANCE_ROWS + |A_j x - b_j|^2) / (COVARIANCE_ROWS + m_j)

The logarithm of the evidence compares fits of the same rows with other columns. The scales are
integrated out, and x by Laplace's method:

    - 1/2 sum_j (COVARIANCE_ROWS + m_j) log(COVARIANCE_ROWS + |A_j x - b_j|^2)
    - 1/2 |(x - mean) / sd|^2 - 1/2 log det(1 + sd A^T A sd),    A of rows A_j / s_j
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import lstsq, solve_triangular

from wrenchsight.models.identification.base_parameters import triangular_factor
from wrenchsight.models.numerics.arrays import Array

COVARIANCE_ROWS = 30.0  # rows, what the stated covariance is worth
_NUM_PASSES = 5  # of solution and scales in turns
_MIN_PIVOT_SHARE = 1e-9  # of the largest entry of R: less, and a value is not determined
_LEAST_LENGTH = 1e-300  # of a column of zeros, for a division


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

    Raises:
        ValueError: numbers that are not finite, sds that are not positive, or a value that neither
            rows nor prior determine.
    """
    k = len(prior_sd)
    if any(joint_rows.shape[1] != k + 1 for joint_rows in rows) or prior_mean.shape != (k,):
        raise ValueError(f"least squares: expected {k} columns and the right side")
    if not (prior_sd > 0.0).all() or not all(np.isfinite(joint_rows).all() for joint_rows in rows):
        raise ValueError("least squares: expected finite rows and positive sds of the prior")
    # From here on x is y = (x - mean) / unit, with the prior's sd for a unit; where that is
    # infinite, a column of length one.
    length = np.sqrt(sum((joint_rows[:, :-1] ** 2).sum(axis=0) for joint_rows in rows))
    unit = np.where(np.isfinite(prior_sd), prior_sd, 1.0 / np.maximum(length, _LEAST_LENGTH))
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
    # In turns the solution, and the scale of each joint.
    counts = np.array([len(joint_rows) for joint_rows in rows])
    prior_rows = np.column_stack([np.diag(has_prior), np.zeros(k)])
    scale = np.ones(len(rows))
    for _ in range(_NUM_PASSES):
        scaled = [factor / s for factor, s in zip(factors, scale, strict=True)]
        stacked = np.vstack([*scaled, prior_rows])
        y = lstsq(stacked[:, :-1], stacked[:, -1])[0]
        errors = np.array([np.sum((factor[:, :-1] @ y - factor[:, -1]) ** 2) for factor in factors])
        scale = np.sqrt((COVARIANCE_ROWS + errors) / (COVARIANCE_ROWS + counts))
    # The information of y is R^T R, and its covariance R^-1 R^-T.
    R = triangular_factor(stacked[:, :-1])
    if np.abs(np.diag(R)).min() < _MIN_PIVOT_SHARE * np.abs(R).max():
        raise ValueError("least squares: neither rows nor prior determine a value")
    covariance_root = solve_triangular(R, np.eye(k)) * unit[:, None]
    log_evidence = np.nan
    if has_prior.all():
        log_evidence = -0.5 * float(
            np.sum((COVARIANCE_ROWS + counts) * np.log(COVARIANCE_ROWS + errors)) + y @ y
        )
        log_evidence -= float(np.log(np.abs(np.diag(R))).sum())
    return PriorFit(
        values=prior_mean + unit * y,
        covariance=covariance_root @ covariance_root.T,
        scale=scale,
        log_evidence=log_evidence,
    )
