"""Friction refresh beside contact: today's coefficients from a log that is mostly touched.

Where a drift of friction is larger than a detector's thresholds, the detector takes it for a
contact without end, and no stretch counts as contact-free. A force at the tool explains any drift
of the arm's first joints; yet forces come and go, and drift stays. So the log is cut into segments
of SEGMENT_TIME s, each touched or free, and friction's coefficients x and the segments are found
together:

    free       residual = A x + e,              covariance C
    touched    residual = A x - J^T F + e,      covariance C + J^T P J

with e of `models.calibration.residual_noise`, and F a wrench at E of the live prior's covariance P
that wanders within FORCE_TIME. Each step fits x by least squares, in which a segment counts with
the inverse covariance of both, by its probability of being free; then each segment's probability
follows from both likelihoods, with the uncertainty of x in them. It begins with all segments
touched: what no wrench at E explains (a moment beyond its prior), and what lasts over the forces.

Only a sliding joint speaks of its Coulomb and viscous friction (`ResidualRows.drift`): one at rest
holds any torque of its stiction band. A tool that slides for the whole log leaves no segment free,
and then x hardly leaves its prior.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from wrenchsight.models.calibration.friction_refresh import FrictionDrift, FrictionRefresh
from wrenchsight.models.calibration.residual_noise import ResidualRows
from wrenchsight.models.friction.velocity_friction import CoulombViscous
from wrenchsight.models.numerics.arrays import Array, Flags

SEGMENT_TIME = 1.0  # s
FORCE_TIME = 1.0  # s
MAX_STEPS = 12
PROBABILITY_TOLERANCE = 1e-3  # change of a probability, below which the steps end
PRIOR_FREE_PROBABILITY = 0.5  # probability of a segment before the log
SURELY_FREE = 0.9  # of a segment, from which its rows count as contact-free
LARGEST_LOG_ODDS = 30.0


@dataclass(frozen=True, eq=False)
class RefreshBesideContact:
    """Friction of a touched log.

    Attributes:
        refresh: today's coefficients.
        is_free: (m,) rows of segments that are free for sure.
    """

    refresh: FrictionRefresh
    is_free: Flags


class _Segment:
    """Rows of one segment, joint after joint: residual, columns and both covariances.

    Args:
        rows: rows of the segment.
        J: (k, 6, n) at E.
        wrench_variance: (6,) of P.
    """

    def __init__(self, rows: ResidualRows, J: Array, wrench_variance: Array) -> None:
        k, n = rows.residual.shape
        self.residual = rows.residual.T.ravel()
        self.columns = np.zeros((k * n, 3 * n))
        self.free = np.zeros((k * n, k * n))
        drift = rows.drift
        for j in range(n):
            part = slice(j * k, (j + 1) * k)
            self.columns[part, 3 * j : 3 * j + 3] = drift[:, j]
            self.free[part, part] = rows.covariance(j)
        lasting = np.exp(-np.abs(rows.t[:, None] - rows.t) / FORCE_TIME)
        levers = J.transpose(1, 2, 0).reshape(6, n * k)
        shared = np.einsum("ai,a,aj->ij", levers, wrench_variance, levers)
        self.touched = self.free + shared * np.tile(lasting, (n, n))
        self._factors = [cho_factor(C, lower=True) for C in (self.free, self.touched)]
        self.information = [self.columns.T @ cho_solve(f, self.columns) for f in self._factors]
        self.projection = [self.columns.T @ cho_solve(f, self.residual) for f in self._factors]

    def log_odds(self, values: Array, covariance: Array) -> float:
        """Logarithm of the odds of free against touched, for x of these values."""
        rest = self.residual - self.columns @ values
        spread = self.columns @ covariance @ self.columns.T
        costs = []
        for C in (self.free, self.touched):
            factor = cho_factor(C + spread, lower=True)
            log_determinant = 2.0 * np.log(np.diag(factor[0])).sum()
            costs.append(0.5 * (log_determinant + rest @ cho_solve(factor, rest)))
        odds = costs[1] - costs[0] + np.log(PRIOR_FREE_PROBABILITY / (1.0 - PRIOR_FREE_PROBABILITY))
        return float(np.clip(odds, -LARGEST_LOG_ODDS, LARGEST_LOG_ODDS))


def refresh_beside_contact(
    rows: ResidualRows,
    J: Array,
    law: CoulombViscous,
    wrench_sd: tuple[float, float],
    drift: FrictionDrift | None = None,
) -> RefreshBesideContact:
    """Estimates the coefficients of today from rows in which something may touch the arm.

    Args:
        rows: the known model's residual.
        J: (m, 6, n) rows [angular; linear] at E.
        law: that model's coefficients.
        wrench_sd: standard deviations of the force and of the moment, N and N m.
        drift: the prior.
    """
    force_sd, moment_sd = wrench_sd
    variance = np.repeat([moment_sd**2, force_sd**2], 3)
    numbers = np.floor((rows.t - rows.t[0]) / SEGMENT_TIME).astype(int)
    parts = [numbers == number for number in np.unique(numbers)]
    segments = [_Segment(rows[part], J[part], variance) for part in parts]
    prior = (drift or FrictionDrift()).deviation(rows, law)
    free = np.zeros(len(segments))
    for _ in range(MAX_STEPS):
        information, projection = np.diag(1.0 / np.maximum(prior.ravel(), 1e-12) ** 2), 0.0
        for segment, share in zip(segments, free, strict=True):
            for weight, which in ((share, 0), (1.0 - share, 1)):
                information = information + weight * segment.information[which]
                projection = projection + weight * segment.projection[which]
        covariance = np.asarray(np.linalg.inv(information), float)
        values = np.asarray(covariance @ projection, float)
        odds = np.array([segment.log_odds(values, covariance) for segment in segments])
        before, free = free, 1.0 / (1.0 + np.exp(-odds))
        if np.abs(free - before).max() < PROBABILITY_TOLERANCE:
            break
    n = rows.num_joints
    refresh = FrictionRefresh(
        model_law=law,
        change=values.reshape(n, 3),
        standard_deviation=np.sqrt(np.diag(covariance)).reshape(n, 3),
        prior_deviation=prior,
        scale=np.ones(n),
    )
    is_free = np.zeros(len(rows.t), bool)
    for part, share in zip(parts, free, strict=True):
        is_free |= part & (share > SURELY_FREE)
    return RefreshBesideContact(refresh, is_free)
