"""Kernels of the wrench's Gaussian posterior, one sample after another; the theory is in `wrench`.

With W the whitening of the torque noise, A = J diag(1 / sd) W^T and y = W (tau_ext / sd), the
observed torque is y = A^T F + noise of covariance 1. The prior is F = P x with P = diag(prior_sd)
and x of covariance 1. So

    B = 1 + P A A^T P = L L^T,        R = L^-1
    Cov(F) = P R^T R P,               F = P R^T R P A y

Every pivot of B's factorisation is at least 1, however large or small the prior and however
singular J; rounding cannot push one below. F follows from the factor: the covariance would lose
what cancels in it.

numpy on whole logs takes 4.8 times as long, numba's linear algebra 5.5 times and eight seconds
more to compile (`tests/benchmarks/bench_small_matrices.py`).
"""

import numpy as np

from wrenchsight.models.estimation.invalid import Findings, InvalidCodes, invalid_reasons
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.numerics.small_matrices import factorise, largest_eigenvalue_3x3

# Entries of a reading's quality.
(
    CONDITION,  # condition number; NaN: not wanted
    FORCE_SD,  # N, largest principal sd of the force; NaN where the torques are not finite
    STICTION_FORCE,  # N, that stiction alone may look like
    HAS_FULL_RANK,  # 1 where J has it or the method does not need it, else 0
    NUM_QUALITY,
) = range(5)

MAX_NUMBER = 1e60  # N, N m and their squares; more counts as not finite


@kernel(nogil=True)
def posterior_rows(
    whitening: Array,
    prior_sd: Array,
    live_prior_sd: Array,
    condition: Array,
    J: Array,
    tau_ext: Array,
    sd: Array,
    stiction: Array,
    wrench: Array,
    covariance: Array,
    quality: Array,
) -> None:
    """Reads N samples with a prior; where one is not finite, the prior is its reading.

    A sample's reading that is not made of numbers below MAX_NUMBER is replaced by the prior, too;
    its force sd is then infinite, so that it is not valid.

    Args:
        whitening: (n, n) W, lower triangular.
        prior_sd: (6,) N m and N, of the reading.
        live_prior_sd: (6,) N m and N, of the force sd and the gain that `valid` rests on.
        condition: (N,) condition numbers, NaN where J is not finite; (0,): not wanted.
        J: (N, 6, n) as tau_ext saw it.
        tau_ext: (N, n) N m.
        sd: (N, n) N m, positive, of its errors.
        stiction: (N, n) N m, the part of them that is stiction.
        wrench, covariance: (N, 6) and (N, 6, 6), written.
        quality: (N, NUM_QUALITY), written: condition number, the force's largest principal sd and
            the force that stiction may hide (N), with the live prior; 1 for full rank. The sd is
            NaN where a sample is not finite.
    """
    n = J.shape[2]
    # Work space; y, A, R as the module has them, of one sample after another.
    A, y = np.empty((6, n)), np.empty(n)
    Ay, AAT, RPAy = np.empty(6), np.empty((6, 6)), np.empty(6)
    L, R, gain = np.empty((6, 6)), np.zeros((6, 6)), np.empty((3, n))
    white_gain = np.empty(n)
    by_live_prior = np.empty((6, 6))  # covariance
    force_covariance, stiction_covariance = np.empty((3, 3)), np.empty((3, 3))
    is_same_prior = True
    for i in range(6):
        is_same_prior = is_same_prior and prior_sd[i] == live_prior_sd[i]
    for k in range(J.shape[0]):
        quality[k, CONDITION] = np.nan
        if condition.shape[0] > 0:
            quality[k, CONDITION] = np.inf if np.isnan(condition[k]) else condition[k]
        quality[k, FORCE_SD], quality[k, STICTION_FORCE] = np.nan, 0.0
        quality[k, HAS_FULL_RANK] = 1.0  # the prior needs none
        if not _are_finite(J[k], tau_ext[k], sd[k]):
            _write_prior(prior_sd, wrench[k], covariance[k])
            continue
        _whiten(whitening, J[k], tau_ext[k], sd[k], A, y)
        _project(A, y, AAT, Ay)
        _factorise_information(AAT, prior_sd, L, R)
        _write_mean(R, prior_sd, Ay, RPAy, wrench[k])
        _write_covariance(R, prior_sd, covariance[k])
        # What `valid` rests on is computed with the live prior; R is that prior's from here on.
        live_covariance = covariance[k]
        if not is_same_prior:
            live_covariance = by_live_prior
            _factorise_information(AAT, live_prior_sd, L, R)
            _write_covariance(R, live_prior_sd, live_covariance)
        if not _are_small(wrench[k], covariance[k]):
            _write_prior(prior_sd, wrench[k], covariance[k])
            quality[k, FORCE_SD] = np.inf
            continue
        # The largest principal sd of the force, and the force that stiction looks like.
        for i in range(3):
            for j in range(3):
                force_covariance[i, j] = live_covariance[3 + i, 3 + j]
        force_variance = largest_eigenvalue_3x3(force_covariance)
        quality[k, FORCE_SD] = np.sqrt(max(force_variance, 0.0))
        if not _are_zero(stiction[k]):
            # By the live prior's gain, whatever the reading's is.
            _write_force_gain(live_covariance, A, whitening, sd[k], white_gain, gain)
            _propagate(gain, stiction[k], stiction_covariance)
            stiction_variance = largest_eigenvalue_3x3(stiction_covariance)
            # Of a uniform distribution the bound is sqrt(3) sds.
            quality[k, STICTION_FORCE] = np.sqrt(3.0 * max(stiction_variance, 0.0))


@kernel(inline="always")
def _are_finite(J: Array, tau_ext: Array, sd: Array) -> bool:
    """Whether all that is known of a sample is finite."""
    total = 0.0
    for j in range(sd.shape[0]):
        total += tau_ext[j] + sd[j]
        for i in range(6):
            total += J[i, j]
    return bool(np.isfinite(total))


@kernel(inline="always")
def _are_small(wrench: Array, covariance: Array) -> bool:
    """Whether a reading is made of numbers below MAX_NUMBER."""
    total = 0.0
    for i in range(6):
        total += abs(wrench[i]) + covariance[i, i]
    return total < MAX_NUMBER


@kernel(inline="always")
def _are_zero(values: Array) -> bool:
    """Whether all values (n,) are zero."""
    total = 0.0
    for value in values:
        total += abs(value)
    return total == 0.0


@kernel
def _write_prior(prior_sd: Array, wrench: Array, covariance: Array) -> None:
    """Writes the prior in place of a reading: zero, with the prior's covariance."""
    for i in range(6):
        wrench[i] = 0.0
        for j in range(6):
            covariance[i, j] = 0.0
        covariance[i, i] = prior_sd[i] * prior_sd[i]


@kernel
def _whiten(whitening: Array, J: Array, tau_ext: Array, sd: Array, A: Array, y: Array) -> None:
    """Writes A = J diag(1 / sd) W^T (6, n) and y = W (tau_ext / sd) (n,); W is lower triangular."""
    for j in range(sd.shape[0]):
        y[j] = 0.0
        for k in range(j + 1):
            y[j] += whitening[j, k] * (tau_ext[k] / sd[k])
        for i in range(6):
            A[i, j] = 0.0
            for k in range(j + 1):
                A[i, j] += whitening[j, k] * (J[i, k] / sd[k])


@kernel(inline="always")
def _project(A: Array, y: Array, AAT: Array, Ay: Array) -> None:
    """Writes A A^T (6, 6), its lower triangle, and A y (6,)."""
    for i in range(6):
        Ay[i] = 0.0
        for k in range(A.shape[1]):
            Ay[i] += A[i, k] * y[k]
        for j in range(i + 1):
            AAT[i, j] = 0.0
            for k in range(A.shape[1]):
                AAT[i, j] += A[i, k] * A[j, k]


@kernel
def _factorise_information(AAT: Array, prior_sd: Array, L: Array, R: Array) -> None:
    """Writes L and R = L^-1 (6, 6), lower triangular, with L L^T = B = 1 + P A A^T P."""
    for i in range(6):
        for j in range(i + 1):
            L[i, j] = prior_sd[i] * prior_sd[j] * AAT[i, j] + (1.0 if i == j else 0.0)
    factorise(L, R)


@kernel(inline="always")
def _write_mean(R: Array, prior_sd: Array, Ay: Array, RPAy: Array, wrench: Array) -> None:
    """Writes RPAy = R P A y and F = P R^T R P A y (6,)."""
    for i in range(6):
        RPAy[i] = 0.0
        for j in range(i + 1):
            RPAy[i] += R[i, j] * prior_sd[j] * Ay[j]
    for i in range(6):
        wrench[i] = 0.0
        for k in range(i, 6):
            wrench[i] += R[k, i] * RPAy[k]
        wrench[i] *= prior_sd[i]


@kernel
def _write_covariance(R: Array, prior_sd: Array, covariance: Array) -> None:
    """Writes Cov(F) = P R^T R P (6, 6)."""
    for i in range(6):
        for j in range(i + 1):
            total = 0.0
            for k in range(i, 6):
                total += R[k, i] * R[k, j]
            covariance[i, j] = prior_sd[i] * prior_sd[j] * total
            covariance[j, i] = covariance[i, j]


@kernel
def _write_force_gain(
    live_covariance: Array,
    A: Array,
    whitening: Array,
    sd: Array,
    white_gain: Array,
    gain: Array,
) -> None:
    """Writes the gain (3, n) of the force: the last rows of Cov(F) A W diag(1 / sd).

    `white_gain` (n,) is overwritten with that of the last component, from white torque.
    """
    n = sd.shape[0]
    for i in range(3):
        for k in range(n):
            white_gain[k] = 0.0
            for j in range(6):
                white_gain[k] += live_covariance[3 + i, j] * A[j, k]
        for k in range(n):
            gain[i, k] = 0.0
            for j in range(k, n):
                gain[i, k] += white_gain[j] * whitening[j, k]
            gain[i, k] /= sd[k]


@kernel(inline="always")
def _propagate(gain: Array, sd: Array, covariance: Array) -> None:
    """Writes the covariance (3, 3) of gain (3, n) times independent torques of these sds (n,)."""
    for i in range(3):
        for j in range(3):
            covariance[i, j] = 0.0
            for k in range(sd.shape[0]):
                covariance[i, j] += gain[i, k] * gain[j, k] * sd[k] * sd[k]


@kernel
def reasons_log(
    max_force_sd: float, max_stiction_force: float, quality: Array, invalid: InvalidCodes
) -> None:
    """Writes why readings of fresh samples are not valid, from their quality alone.

    Args:
        max_force_sd, max_stiction_force: N, of a valid reading.
        quality: (N, NUM_QUALITY).
        invalid: (N,), written: the reasons, a sum.
    """
    for k in range(quality.shape[0]):
        invalid[k] = invalid_reasons(
            Findings(
                is_fresh=True,
                is_missing=False,
                fault=0,
                is_corrected=True,
                has_reading=not np.isnan(quality[k, FORCE_SD]),
                has_full_rank=quality[k, HAS_FULL_RANK] == 1.0,
                force_sd=quality[k, FORCE_SD],
                stiction_force=quality[k, STICTION_FORCE],
                max_force_sd=max_force_sd,
                max_stiction_force=max_stiction_force,
                is_explained=True,
                is_believed=True,
                keeps_pace=True,
            )
        )
