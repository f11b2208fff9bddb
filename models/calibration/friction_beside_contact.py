"""Friction refresh beside contact: today's coefficients from a log in which something touches.

Where a drift of friction is larger than a detector's thresholds, the detector takes it for a
contact, or a contact for none. A force at the tool explains any drift of the arm's first joints;
yet forces come and go, and drift stays. So the log is cut into segments of SEGMENT_TIME s, each in
one of these states, and friction's coefficients x and the states are found together:

    free          residual = A x + e,              covariance C
    touched at E  residual = A x - J^T F + e,      covariance C + J^T P J
    elsewhere     residual = A x + tau + e,        covariance C + diag(J^T P J)

with e of `models.calibration.residual_noise`. F is a wrench at E that wanders within FORCE_TIME.
Its covariance P is the live prior's, times the square of one of FORCE_SHARES: a state for each, as
beside the full prior alone a force of some newtons would be likelier as "free". tau has the size
that the full prior's F has, but of each joint by itself: a contact on another link, or a drive that
does not do what its current says.

States are sampled (Gibbs), one segment after the other, x integrated out: both are normal given the
states. Mean and covariance of x are those over the samples, and hence hold which segments are free,
too. The chain begins with all segments touched.

Only a sliding joint speaks of its Coulomb and viscous friction (`ResidualRows.drift`): one at rest
holds any torque of its stiction band. A tool that slides for the whole log leaves no segment free,
and then x hardly leaves its prior.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from wrenchsight.models.calibration.friction_refresh import FrictionDrift, FrictionRefresh
from wrenchsight.models.calibration.residual_noise import (
    NUM_DRIFTS,
    ResidualRows,
    drift_columns,
)
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.numerics.arrays import Array, Flags

SEGMENT_TIME = 0.5  # s
FORCE_TIME = 1.0  # s
FORCE_SHARES = (1.0, 0.25)  # of the live prior's sds
FREE_PROBABILITY, ELSEWHERE_PROBABILITY = 0.5, 0.02  # of a segment before the log
SURELY_FREE = 0.9  # of a segment, from which its rows count as contact-free
FIRST_SWEEPS, SWEEPS = 10, 20  # over all segments: before samples count, and that count
# States of a segment: free; touched at E, a state for each of FORCE_SHARES; touched elsewhere.
_FREE_STATE, _TOUCHED_STATE = 0, 1  # touched by the first of FORCE_SHARES
_LEAST_PRIOR_SD = 1e-12  # N m, N m s/rad: of a coefficient that the prior holds, for a division


@dataclass(frozen=True, eq=False)
class RefreshBesideContact:
    """Friction of a touched log.

    Attributes:
        refresh: today's coefficients.
        is_free: (m,) rows of segments that are free for sure.
    """

    refresh: FrictionRefresh
    is_free: Flags


class _Segments(NamedTuple):
    """What segments say of the k coefficients x, for each of their K states.

    log p = constant + x^T projection - x^T information x / 2. Of S segments, or of one without S.

    Attributes:
        information: (S, K, k, k) A^T C^-1 A.
        projection: (S, K, k) A^T C^-1 residual.
        constant: (S, K) log of prior and likelihood at x = 0, up to a constant.
    """

    information: Array
    projection: Array
    constant: Array

    @classmethod
    def stacked(cls, segments: "Sequence[_Segments]") -> "_Segments":
        """Several segments of one each as one with the axis S."""
        return cls(
            information=np.array([segment.information for segment in segments]),
            projection=np.array([segment.projection for segment in segments]),
            constant=np.array([segment.constant for segment in segments]),
        )


def refresh_beside_contact(
    rows: ResidualRows,
    J: Array,
    law: CoulombViscous,
    force_sd: float,
    moment_sd: float,
    drift: FrictionDrift | None = None,
) -> RefreshBesideContact:
    """Estimates the coefficients of today from rows in which something may touch the arm.

    The samples' seed is fixed: the same rows give the same coefficients.

    Args:
        rows: m rows of the known model's residual.
        J: (m, 6, n) rows [angular; linear] at E, in axes of W.
        law: that model's coefficients.
        force_sd, moment_sd: of the wrench's prior, N and N m.
        drift: the prior; None: the default of FrictionDrift.

    Returns:
        The coefficients with the covariance of each joint's three (those between joints are left
        out) and a `scale` of one, which is not estimated here; and the rows that are free.
    """
    wrench_variance = np.repeat([moment_sd**2, force_sd**2], 3)  # in the order of J's rows
    segment_of_row = np.floor((rows.t - rows.t[0]) / SEGMENT_TIME).astype(int)
    segment_masks = [segment_of_row == segment for segment in np.unique(segment_of_row)]
    segments = _Segments.stacked(
        [
            _segment(rows[is_in_segment], J[is_in_segment], wrench_variance)
            for is_in_segment in segment_masks
        ]
    )
    n = rows.num_joints
    prior = (drift or FrictionDrift()).deviation(rows, law)
    mean, covariance, free_share = _sampled(segments, prior.ravel())
    by_joint, joints = covariance.reshape(n, NUM_DRIFTS, n, NUM_DRIFTS), np.arange(n)
    refresh = FrictionRefresh(
        model_law=law,
        change=mean.reshape(n, NUM_DRIFTS),
        covariance=by_joint[joints, :, joints],  # (n, 3, 3)
        prior_deviation=prior,
        scale=np.ones(n),
    )
    is_free = np.zeros(len(rows.t), bool)
    for is_in_segment, share in zip(segment_masks, free_share, strict=True):
        is_free |= is_in_segment & (share > SURELY_FREE)
    return RefreshBesideContact(refresh, is_free)


def _segment(rows: ResidualRows, J: Array, wrench_variance: Array) -> _Segments:
    """Likelihood of one segment's residual, as a function of the drift x (k,), in each of K states.

    The states, in this order: nothing touches the arm (_FREE_STATE); a force of each of
    FORCE_SHARES of the prior acts at E (_TOUCHED_STATE and on); a force that each joint feels for
    itself, as anywhere else on the arm. Residual, columns and covariances go joint after joint, the
    m rows of each together.

    Args:
        rows: m rows of the segment.
        J: (m, 6, n) at E.
        wrench_variance: (6,) of P, moment first.
    """
    m, n = rows.residual.shape
    # What x explains, and what is left without a contact.
    residual = rows.residual.T.ravel()
    columns, noise = np.zeros((m * n, NUM_DRIFTS * n)), np.zeros((m * n, m * n))
    drift = rows.drift
    for j in range(n):
        joint_rows = slice(j * m, (j + 1) * m)
        columns[joint_rows, drift_columns(j)] = drift[:, j]
        noise[joint_rows, joint_rows] = rows.covariance(j)
    # What a contact adds to the covariance: a wrench at E, or each joint's torque by itself.
    time_correlation = np.tile(np.exp(-np.abs(rows.t[:, None] - rows.t) / FORCE_TIME), (n, n))
    levers = J.transpose(1, 2, 0).reshape(6, n * m)
    shared = np.einsum("ai,a,aj->ij", levers, wrench_variance, levers) * time_correlation
    elsewhere = shared * np.kron(np.eye(n), np.ones((m, m)))  # each joint's block alone
    # Probability beforehand and covariance of each state: places _FREE_STATE, _TOUCHED_STATE on.
    each_touched = (1.0 - FREE_PROBABILITY - ELSEWHERE_PROBABILITY) / len(FORCE_SHARES)
    states = [
        (FREE_PROBABILITY, noise),
        *((each_touched, noise + share**2 * shared) for share in FORCE_SHARES),
        (ELSEWHERE_PROBABILITY, noise + elsewhere),
    ]
    k = columns.shape[1]
    information, projection = np.empty((len(states), k, k)), np.empty((len(states), k))
    constant = np.log([probability for probability, _ in states])
    for state, (_, covariance) in enumerate(states):
        factor = cho_factor(covariance, lower=True)
        weighted = cho_solve(factor, residual)
        information[state] = columns.T @ cho_solve(factor, columns)
        projection[state] = columns.T @ weighted
        constant[state] -= np.log(np.diag(factor[0])).sum() + 0.5 * residual @ weighted
    return _Segments(information, projection, constant)


def _sampled(segments: _Segments, prior_sd: Array) -> tuple[Array, Array, Array]:
    """Mean and covariance of the drift x, by Gibbs sampling of the segments' states.

    In each sweep the state of one segment after another is drawn, given those of all others, with x
    integrated out. The first sweeps are left out.

    Args:
        segments: S segments in K states.
        prior_sd: (k,) of x, whose prior mean is zero.

    Returns:
        Mean (k,), covariance (k, k), and the share (S,) of sweeps in which a segment was free.
    """
    rng = np.random.default_rng(0)
    num_segments, num_states = segments.constant.shape
    all_segments = np.arange(num_segments)
    states = np.full(num_segments, _TOUCHED_STATE, dtype=np.intp)
    prior = np.diag(1.0 / np.maximum(prior_sd, _LEAST_PRIOR_SD) ** 2)
    means: list[Array] = []
    covariances: list[Array] = []
    num_free = np.zeros(num_segments)
    for sweep in range(FIRST_SWEEPS + SWEEPS):
        # Of prior and all segments in their states; kept up to date as these are drawn.
        information = prior + segments.information[all_segments, states].sum(axis=0)
        projection = segments.projection[all_segments, states].sum(axis=0)
        for s in rng.permutation(num_segments):
            information -= segments.information[s, states[s]]
            projection -= segments.projection[s, states[s]]
            log_weight = segments.constant[s] + _log_evidence(
                information + segments.information[s], projection + segments.projection[s]
            )
            probability = np.exp(log_weight - log_weight.max())
            states[s] = rng.choice(num_states, p=probability / probability.sum())
            information += segments.information[s, states[s]]
            projection += segments.projection[s, states[s]]
        if sweep >= FIRST_SWEEPS:
            covariances.append(np.linalg.inv(information))
            means.append(covariances[-1] @ projection)
            num_free += states == _FREE_STATE
    mean = np.mean(means, axis=0)
    spread = np.array(means) - mean
    covariance = np.mean(covariances, axis=0) + spread.T @ spread / len(means)
    return mean, covariance, num_free / SWEEPS


def _log_evidence(information: Array, projection: Array) -> NDArray[np.float64]:
    """(K,) log of the integral over x, up to a constant, of (K, k, k) and (K, k)."""
    factors = np.linalg.cholesky(information)
    y = np.linalg.solve(factors, projection[:, :, None])[:, :, 0]
    log_determinants = np.log(np.diagonal(factors, axis1=1, axis2=2)).sum(axis=1)
    return np.asarray(0.5 * (y * y).sum(axis=1) - log_determinants)
