"""The reading of a log by each method: the posterior compiled, the others by singular values.

A pseudo-inverse is F = H tau_ext. With J = U diag(s) V^T it is H = U diag(g) V^T, where g is

    inverse      1 / s
    damped       s / (s^2 + damping^2)
    truncated    1 / s, or 0 where s is at most a share `truncation` of the largest
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.estimation.wrench_kernels import (
    CONDITION,
    FORCE_SD,
    HAS_FULL_RANK,
    MAX_NUMBER,
    NUM_QUALITY,
    STICTION_FORCE,
    posterior_rows,
)
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.numerics.row_blocks import in_row_blocks
from wrenchsight.models.rigid_body.conditioning import MACHINE_EPSILON, condition_numbers_of

METHODS = ("inverse", "force_only", "bayesian", "damped", "truncated")

_BLOCK_SAMPLES = 1024  # that are worth a thread: some 5 ms
_MIN_SINGULAR_VALUE = 1e-15  # m or rad


class WrenchConstants(NamedTuple):
    """The constants of `WrenchReconstruction`.

    Attributes:
        method: of METHODS.
        whitening: (n, n) W, lower triangular, with W Sigma W^T = 1.
        torque_covariance: (n, n) Sigma, in units of the samples' sds.
        prior_sd: (6,) N m and N, of the reading.
        live_prior_sd: (6,) N m and N, prior with which the force sd of `valid` is computed.
        damping, truncation: of the methods of these names.
        usual_sd: (n,) N m, which balances the weights of `force_only`; None: it does not.
    """

    method: str
    whitening: Array
    torque_covariance: Array
    prior_sd: Array
    live_prior_sd: Array
    damping: float
    truncation: float
    usual_sd: Array | None


class TorqueSamples(NamedTuple):
    """External torques with their uncertainty.

    Attributes:
        J: (N, 6, n) as tau_ext saw it.
        tau_ext: (N, n) N m.
        sd: (N, n) N m, positive, of its errors.
        stiction: (N, n) N m, the part of them that is stiction.
    """

    J: Array
    tau_ext: Array
    sd: Array
    stiction: Array


class WrenchLog(NamedTuple):
    """The readings of N samples.

    Attributes:
        wrench: (N, 6) N m and N, rotation first.
        covariance: (N, 6, 6).
        quality: (N, NUM_QUALITY) of `wrench_kernels`.
    """

    wrench: Array
    covariance: Array
    quality: Array


def reconstruct_log(
    constants: WrenchConstants, J_now: Array, J: Array, tau_ext: Array, sd: Array, stiction: Array
) -> WrenchLog:
    """The readings of N samples, by threads.

    Args:
        constants: of `WrenchReconstruction`.
        J_now: (N, 6, n) of the samples, for the condition numbers, which are NaN where it has no
            rows.
        J, tau_ext, sd, stiction: of N samples, as TorqueSamples.
    """
    N, samples = len(J), (J, tau_ext, sd, stiction)
    log = WrenchLog(np.empty((N, 6)), np.empty((N, 6, 6)), np.empty((N, NUM_QUALITY)))
    if N <= _BLOCK_SAMPLES:  # whole: a tick hands over no rows of arrays
        _read_block(constants, J_now, samples, log)
        return log

    def read(rows: slice) -> None:
        out = WrenchLog._make(signal[rows] for signal in log)
        part = J[rows], tau_ext[rows], sd[rows], stiction[rows]
        _read_block(constants, J_now[rows], part, out)

    in_row_blocks(read, N, _BLOCK_SAMPLES)
    return log


def _read_block(
    constants: WrenchConstants,
    J_now: Array,
    samples: tuple[Array, Array, Array, Array],
    out: WrenchLog,
) -> None:
    """Writes the readings of N samples.

    Args:
        constants, J_now: as `reconstruct_log`.
        samples: fields of TorqueSamples, in their order.
        out: written.
    """
    condition = np.empty(len(J_now))
    if len(J_now):
        condition_numbers_of(J_now, condition)
    if constants.method == "bayesian" or (
        constants.method == "force_only" and constants.usual_sd is None
    ):
        posterior_rows(
            constants.whitening,
            constants.prior_sd,
            constants.live_prior_sd,
            condition,
            *samples,
            *out,
        )
    else:
        _read_by_singular_values(constants, TorqueSamples(*samples), out)
        out.quality[:, CONDITION] = np.nan
        if len(J_now):
            out.quality[:, CONDITION] = np.where(np.isnan(condition), np.inf, condition)


class _Inversion(NamedTuple):
    """A reading by a gain, before it is known to be a number.

    Attributes:
        wrench: (N, 6).
        covariance: (N, 6, 6).
        force_covariance: (N, 3, 3) of the plain inverse, or with the live prior: that of `valid`.
        force_gain: (N, 3, n) from tau_ext, of the same.
        has_full_rank: (N,) whether J has it, or the method does not need it.
    """

    wrench: Array
    covariance: Array
    force_covariance: Array
    force_gain: Array
    has_full_rank: Flags


def _read_by_singular_values(
    constants: WrenchConstants, samples: TorqueSamples, out: WrenchLog
) -> None:
    """Writes the readings of N samples by a pseudo-inverse, or by balanced weights.

    A sample that is not finite, or whose reading is beyond MAX_NUMBER, has the prior for its
    reading. Its force sd is NaN and inf: in neither case it is valid.

    Args:
        constants: method, covariances and priors.
        samples: N.
        out: written, but for the condition numbers: NaN.
    """
    quality = out.quality
    out.wrench[:], out.covariance[:] = 0.0, np.diag(constants.prior_sd**2)
    quality[:, [CONDITION, FORCE_SD]] = np.nan
    quality[:, STICTION_FORCE], quality[:, HAS_FULL_RANK] = 0.0, 1.0
    total = samples.J.sum(axis=(1, 2)) + samples.tau_ext.sum(axis=1) + samples.sd.sum(axis=1)
    is_finite = np.isfinite(total)
    samples = TorqueSamples._make(_flagged(is_finite, *samples))
    invert = _balanced if constants.method == "force_only" else _pseudo_inverse
    with np.errstate(over="ignore", invalid="ignore"):
        reading = invert(constants, samples)
        variances = np.diagonal(reading.covariance, axis1=1, axis2=2)
        sizes = np.abs(reading.wrench).sum(axis=1) + variances.sum(axis=1)
        from_stiction = reading.force_gain * samples.stiction[:, np.newaxis]
    quality[is_finite, FORCE_SD] = np.inf
    quality[is_finite, HAS_FULL_RANK] = reading.has_full_rank
    is_small = sizes < MAX_NUMBER
    wrench, covariance, force_covariance, from_stiction = _flagged(
        is_small, reading.wrench, reading.covariance, reading.force_covariance, from_stiction
    )
    [rows] = _flagged(is_small, *_flagged(is_finite, np.arange(len(quality))))
    out.wrench[rows], out.covariance[rows] = wrench, covariance
    # Both at once: a call of numpy's eigenvalues takes as long as those of a hundred matrices.
    largest_sds = _largest_sd(np.concatenate([force_covariance, _squared(from_stiction)]))
    quality[rows, FORCE_SD] = largest_sds[: len(rows)]
    quality[rows, STICTION_FORCE] = np.sqrt(3.0) * largest_sds[len(rows) :]


def _flagged(flags: Flags, *signals: NDArray[Any]) -> tuple[NDArray[Any], ...]:
    """The rows of signals (N, ...) whose flags (N,) are set; where all are, the signals."""
    return signals if flags.all() else tuple(signal[flags] for signal in signals)


def _pseudo_inverse(constants: WrenchConstants, samples: TorqueSamples) -> _Inversion:
    """Readings F = H tau_ext by H = U diag(g) V^T; `valid` rests on those of the plain inverse.

    With J = U diag(s) V^T (N, 6, n), g is 1 / s (inverse), s / (s^2 + damping^2) (damped), or 1 / s
    down to `truncation` of the largest s and 0 below (truncated). Singular values within rounding
    of zero are not seen: along their directions of the wrench the covariance of the plain inverse
    is very large, the largest joint error over the least singular value that would be seen.

    Args:
        constants: method, damping or truncation, torque covariance.
        samples: N finite ones.
    """
    J, tau_ext, sd = samples.J, samples.tau_ext, samples.sd
    U, s, VT = np.linalg.svd(J)
    largest = s[:, :1]
    # What rounding of a matrix of this size leaves, as numpy's matrix_rank has it.
    floor = np.maximum(max(J.shape[1:]) * MACHINE_EPSILON * largest, _MIN_SINGULAR_VALUE)
    is_seen = s > floor
    plain_g = np.divide(1.0, s, out=np.zeros_like(s), where=is_seen)
    if constants.method == "damped":
        damped_square = s**2 + constants.damping**2
        g = np.divide(s, damped_square, out=np.zeros_like(s), where=damped_square > 0.0)
    elif constants.method == "truncated":
        g = np.where(s > constants.truncation * largest, plain_g, 0.0)
    else:
        g = plain_g
    count = s.shape[1]  # of singular values, the lesser of 6 and n

    def gain(g: Array) -> Array:
        """H (N, 6, n) of g (N, count)."""
        return np.asarray((U[:, :, :count] * g[:, np.newaxis]) @ VT[:, :count])

    plain_H = gain(plain_g)
    H = plain_H if constants.method == "inverse" else gain(g)
    plain = _propagated(constants, plain_H, sd)
    if count < 6 or not is_seen.all():
        # Along a direction that the arm does not feel the wrench is unknown, by (N, 6, 6).
        noise = np.max(np.diagonal(constants.torque_covariance) * sd**2, axis=1)
        is_unseen = np.ones((len(J), 6), np.bool_)
        is_unseen[:, :count] = ~is_seen
        unseen_sd = is_unseen * np.sqrt(noise)[:, np.newaxis] / floor
        plain = plain + _squared(U * unseen_sd[:, np.newaxis])
    return _Inversion(
        wrench=_times(H, tau_ext),
        covariance=plain if constants.method == "inverse" else _propagated(constants, H, sd),
        force_covariance=plain[:, 3:, 3:],
        force_gain=plain_H[:, 3:],
        has_full_rank=is_seen.all(axis=1) if count == 6 else np.zeros(len(J), np.bool_),
    )


def _balanced(constants: WrenchConstants, samples: TorqueSamples) -> _Inversion:
    """Readings of a point force, weighted by the geometric means of sds and usual sds.

    With these weights w, A = J_force diag(1 / w) W^T = U diag(s) V^T, and p the sd of the force's
    prior, the gain of the posterior and the share of the force that it does not show are

        H = U diag(p^2 s / (1 + p^2 s^2)) V^T W diag(1 / w)
        1 - H J_force^T = U diag(1 / (1 + p^2 s^2)) U^T

    The covariance is that of the sample's errors through H, plus that of the prior's share. It is
    not the inverse of the information in these weights.

    Args:
        constants: with usual sds (n,), both priors, whitening W and torque covariance.
        samples: N finite ones.
    """
    J, tau_ext, sd = samples.J, samples.tau_ext, samples.sd
    weight = np.sqrt(sd * np.asarray(constants.usual_sd))
    A = (J[:, 3:] / weight[:, np.newaxis]) @ constants.whitening.T
    U, s, VT = np.linalg.svd(A)
    count = s.shape[1]  # of singular values, the lesser of 3 and n

    def reading(force_sd: float) -> tuple[Array, Array]:
        """The gain (N, 3, n), and the covariance (N, 3, 3), with a prior of this sd."""
        g = force_sd**2 * s / (1.0 + (force_sd * s) ** 2)
        H = (U[:, :, :count] * g[:, np.newaxis]) @ VT[:, :count] @ constants.whitening
        H /= weight[:, np.newaxis]
        unseen_sd = np.full((len(J), 3), force_sd)
        unseen_sd[:, :count] /= 1.0 + (force_sd * s) ** 2
        return H, _propagated(constants, H, sd) + _squared(U * unseen_sd[:, np.newaxis])

    # Sds of all axes, rotation first; those of the force are equal.
    live_force_sd, prior_force_sd = constants.live_prior_sd[3], constants.prior_sd[3]
    force_gain, force_covariance = reading(live_force_sd)
    H, covariance = reading(prior_force_sd)
    # Of a point force the moment and its covariance are zero.
    wrench, full_covariance = np.zeros((len(J), 6)), np.zeros((len(J), 6, 6))
    wrench[:, 3:], full_covariance[:, 3:, 3:] = _times(H, tau_ext), covariance
    return _Inversion(
        wrench=wrench,
        covariance=full_covariance,
        force_covariance=force_covariance,
        force_gain=force_gain,
        has_full_rank=np.ones(len(J), np.bool_),  # the prior needs none
    )


def _propagated(constants: WrenchConstants, H: Array, sd: Array) -> Array:
    """H diag(sd) Sigma diag(sd) H^T (N, ., .) of gains H (N, ., n): the errors' covariance."""
    scaled = H * sd[:, np.newaxis]
    covariance = scaled @ constants.torque_covariance @ np.swapaxes(scaled, 1, 2)
    return 0.5 * (covariance + np.swapaxes(covariance, 1, 2))


def _squared(matrices: Array) -> Array:
    """X X^T of matrices X (N, i, j)."""
    squares = matrices @ np.swapaxes(matrices, 1, 2)
    return 0.5 * (squares + np.swapaxes(squares, 1, 2))


def _times(matrices: Array, vectors: Array) -> Array:
    """(N, i), the products of matrices (N, i, j) with vectors (N, j)."""
    return np.asarray((matrices @ vectors[..., np.newaxis])[..., 0])


def _largest_sd(covariance: Array) -> Array:
    """(N,), roots of the largest eigenvalues of covariances (N, 3, 3)."""
    return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(covariance)[:, -1], 0.0)))
