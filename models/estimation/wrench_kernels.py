"""Kernels of the wrench reconstruction: one sample, or a log; the theory is in `wrench`."""

from typing import NamedTuple

import numpy as np

from wrenchsight.models.estimation.invalid import Findings, InvalidCodes, invalid_reasons
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.numerics.row_blocks import in_row_blocks
from wrenchsight.models.numerics.small_matrices import (
    factorise,
    invert_transposed,
    largest_eigenvalue_3x3,
    orthogonalise_rows,
)
from wrenchsight.models.rigid_body.conditioning import condition_numbers_of

METHODS = ("inverse", "force_only", "bayesian", "damped", "truncated")
_INVERSE, FORCE_ONLY, BAYESIAN, _DAMPED, _TRUNCATED = range(5)

# Entries of WrenchConstants.settings.
_METHOD, _FORCE_SD, _MOMENT_SD, _DAMPING, _TRUNCATION, _MAX_FORCE_SD = range(6)
_VALID_FORCE_SD, _VALID_MOMENT_SD, _MAX_STICTION_FORCE, NUM_SETTINGS = range(6, 10)

# Entries of a reading's quality, see WrenchOut.
CONDITION, FORCE_SD, STICTION_FORCE, HAS_FULL_RANK, NUM_QUALITY = range(5)

# Rows of the scratch array of a sample, (WORK_ROWS, max(n, 6)).
_WHITE, _FACTOR, _INVERSE_FACTOR, _TURNED, _TURN, _MATRIX, _PLAIN = range(0, 42, 6)
_SCRATCH, _FROM_STICTION, _VECTOR = 42, 48, 51
_WEIGHTS_ROW = _VECTOR + 3
WORK_ROWS = _VECTOR + 4
_GRAM = _MATRIX  # of the posterior; the other methods keep their matrix there
_BLOCK_SAMPLES = 1024  # that are worth a thread: some 5 ms
_WELL_CONDITIONED = 1e9  # up to which elimination gives what singular values give
_MAX_NUMBER = 1e60  # N, N m and their squares; more counts as not finite


class WrenchConstants(NamedTuple):
    """The constants of `WrenchReconstruction`.

    Attributes:
        whitening: (n, n) W, lower triangular, with W Sigma W^T = 1.
        covariance: (n, n) Sigma of the torque.
        settings: (NUM_SETTINGS,) method, prior and limits.
        usual_sd: (n,) N m, which balances the weights of `force_only`; (0,): none.
    """

    whitening: Array
    covariance: Array
    settings: Array
    usual_sd: Array


class TorqueSample(NamedTuple):
    """External torque of one sample with its uncertainty; of N samples with a first axis.

    Attributes:
        J: (6, n) as tau_ext saw it.
        tau_ext: (n,) N m.
        sd: (n,) N m, positive, of its errors.
        stiction: (n,) N m, the part of it that is stiction.
    """

    J: Array
    tau_ext: Array
    sd: Array
    stiction: Array


class WrenchOut(NamedTuple):
    """A reading of one sample, written; of N samples with a first axis.

    Attributes:
        wrench: (6,).
        covariance: (6, 6).
        quality: (NUM_QUALITY,) condition number; N, largest principal sd of the force, NaN where
            the torques are not finite; N, force that stiction alone may look like; 1 where J has
            full rank or the method does not need it, else 0.
    """

    wrench: Array
    covariance: Array
    quality: Array


@kernel
def _is_readable(table: WrenchConstants, sample: TorqueSample, out: WrenchOut) -> bool:
    """Whether all that is known of a sample is finite; if not, writes the prior for its reading."""
    quality = out.quality
    quality[FORCE_SD], quality[STICTION_FORCE], quality[HAS_FULL_RANK] = np.nan, 0.0, 1.0
    total = 0.0
    for j in range(sample.sd.shape[0]):
        total += sample.tau_ext[j] + sample.sd[j]
        for i in range(6):
            total += sample.J[i, j]
    if np.isfinite(total):
        return True
    _prior_only(table.settings, out.wrench, out.covariance)
    return False


@kernel
def _rate(
    table: WrenchConstants, sample: TorqueSample, out: WrenchOut, has_full_rank: bool, work: Array
) -> None:
    """Writes the quality of a reading from the covariances that its method has left in `work`."""
    quality, total = out.quality, 0.0
    quality[HAS_FULL_RANK] = 1.0 if has_full_rank else 0.0
    for i in range(6):
        total += abs(out.wrench[i]) + out.covariance[i, i]
    if not total < _MAX_NUMBER:
        _prior_only(table.settings, out.wrench, out.covariance)
        quality[FORCE_SD] = np.inf
        return
    variance = largest_eigenvalue_3x3(work[_PLAIN + 3 : _PLAIN + 6, 3:])
    quality[FORCE_SD] = np.sqrt(max(variance, 0.0))
    if _has_stiction(sample.stiction):
        variance = largest_eigenvalue_3x3(work[_FROM_STICTION : _FROM_STICTION + 3, :])
        quality[STICTION_FORCE] = np.sqrt(3.0 * max(variance, 0.0))


@kernel
def quality_limits(settings: Array) -> tuple[float, float]:
    """N, largest principal force sd and largest force of stiction of a valid reading."""
    return settings[_MAX_FORCE_SD], settings[_MAX_STICTION_FORCE]


@kernel
def reconstruction_reasons(table: WrenchConstants, quality: Array) -> int:
    """The reasons why the reading of a fresh sample is not valid, from its quality alone."""
    max_force_sd, max_stiction_force = quality_limits(table.settings)
    return invalid_reasons(
        Findings(
            is_fresh=True,
            is_missing=False,
            fault=0,
            is_corrected=True,
            has_reading=not np.isnan(quality[FORCE_SD]),
            has_full_rank=quality[HAS_FULL_RANK] == 1.0,
            force_sd=quality[FORCE_SD],
            stiction_force=quality[STICTION_FORCE],
            max_force_sd=max_force_sd,
            max_stiction_force=max_stiction_force,
            is_explained=True,
            is_believed=True,
            keeps_pace=True,
        )
    )


@kernel
def _prior_only(settings: Array, wrench: Array, covariance: Array) -> None:
    """Writes the prior in place of a reading: zero, with the prior's covariance."""
    for i in range(6):
        wrench[i] = 0.0
        for j in range(6):
            covariance[i, j] = 0.0
        prior_sd = settings[_MOMENT_SD] if i < 3 else settings[_FORCE_SD]
        covariance[i, i] = prior_sd * prior_sd


@kernel
def whiten(table: WrenchConstants, J: Array, tau_ext: Array, sd: Array, work: Array) -> None:
    """Writes the whitened Jacobian A = J W^T, A A^T and A W tau_ext; W whitens the torque noise.

    Args:
        table: `WrenchReconstruction.table`.
        J: (6, n).
        tau_ext, sd: (n,) N m.
        work: A in its first six rows, A A^T in those of the gram (lower triangle), A W tau_ext in
            the last vector row but one.
    """
    n = J.shape[1]
    white_tau, gram = work[_VECTOR], work[_GRAM : _GRAM + 6]
    for j in range(n):
        total = 0.0
        for k in range(j + 1):
            total += table.whitening[j, k] * (tau_ext[k] / sd[k])
        white_tau[j] = total
    for i in range(6):
        scaled = work[_VECTOR + 1]
        for k in range(n):
            scaled[k] = J[i, k] / sd[k]
        dot = 0.0
        for j in range(n):
            total = 0.0
            for k in range(j + 1):
                total += table.whitening[j, k] * scaled[k]
            work[_WHITE + i, j] = total
            dot += total * white_tau[j]
        work[_VECTOR + 2, i] = dot
        for j in range(i + 1):
            total = 0.0
            for k in range(n):
                total += work[_WHITE + i, k] * work[_WHITE + j, k]
            gram[i, j] = total


@kernel
def _posterior_covariance(
    moment_sd: float, force_sd: float, first_row: int, covariance: Array, work: Array
) -> None:
    """Writes rows `first_row`.. of (gram + P^-1)^-1, both triangles; P has these sds.

    With the wrench in units of its prior sds, x = S^-1 F, cov(x) = (1 + S gram S)^-1. Every pivot
    of that matrix's factorisation is at least 1, however large or small the prior and however
    singular J; rounding cannot push one below.
    """
    gram = work[_GRAM : _GRAM + 6]
    L = work[_FACTOR : _FACTOR + 6]
    R = work[_INVERSE_FACTOR : _INVERSE_FACTOR + 6]
    for i in range(6):
        scale_i = moment_sd if i < 3 else force_sd
        for j in range(i + 1):
            scale_j = moment_sd if j < 3 else force_sd
            L[i, j] = scale_i * scale_j * gram[i, j] + (1.0 if i == j else 0.0)
    factorise(L, R)
    for i in range(first_row, 6):
        scale_i = moment_sd if i < 3 else force_sd
        for j in range(i + 1):
            scale_j = moment_sd if j < 3 else force_sd
            total = 0.0
            for k in range(i, 6):
                total += R[k, i] * R[k, j]
            covariance[i, j] = scale_i * scale_j * total
            covariance[j, i] = covariance[i, j]


@kernel
def _posterior(table: WrenchConstants, sample: TorqueSample, out: WrenchOut, work: Array) -> None:
    """Writes the Gaussian posterior; leaves in `work` the covariances that `valid` needs."""
    sd, wrench, covariance = sample.sd, out.wrench, out.covariance
    n = sd.shape[0]
    settings = table.settings
    whiten(table, sample.J, sample.tau_ext, sd, work)
    moment_sd, force_sd = settings[_MOMENT_SD], settings[_FORCE_SD]
    _posterior_covariance(moment_sd, force_sd, 0, covariance, work)
    # F = S R^T R S A W tau, by the factor: the covariance would lose what cancels in it.
    R = work[_INVERSE_FACTOR : _INVERSE_FACTOR + 6]
    y = work[_VECTOR + 1]
    for i in range(6):
        total = 0.0
        for j in range(i + 1):
            total += R[i, j] * work[_VECTOR + 2, j] * (moment_sd if j < 3 else force_sd)
        y[i] = total
    for i in range(6):
        total = 0.0
        for k in range(i, 6):
            total += R[k, i] * y[k]
        wrench[i] = total * (moment_sd if i < 3 else force_sd)
    plain = work[_PLAIN : _PLAIN + 6]
    moment_sd, force_sd = settings[_VALID_MOMENT_SD], settings[_VALID_FORCE_SD]
    if moment_sd == settings[_MOMENT_SD] and force_sd == settings[_FORCE_SD]:
        for i in range(6):
            for j in range(6):
                plain[i, j] = covariance[i, j]
    else:
        _posterior_covariance(moment_sd, force_sd, 3, plain, work)
    if not _has_stiction(sample.stiction):
        return
    gain = work[_SCRATCH : _SCRATCH + 3]  # of the force from white torque, then from torque
    for i in range(3):
        white = work[_VECTOR + 1]
        for k in range(n):
            total = 0.0
            for j in range(6):
                total += plain[3 + i, j] * work[_WHITE + j, k]
            white[k] = total
        for k in range(n):
            total = 0.0
            for j in range(k, n):
                total += white[j] * table.whitening[j, k]
            gain[i, k] = total / sd[k]
    _stiction_covariance(gain, sample.stiction, work)


@kernel
def _balanced(table: WrenchConstants, sample: TorqueSample, out: WrenchOut, work: Array) -> None:
    """As `_posterior` for a point force, weighted by the geometric means of sds and usual sds.

    The covariance is that of the sample's errors through the gain, plus the share of the force's
    prior that the joints do not show. It is not the inverse of the information in these weights.
    """
    sd, wrench, covariance = sample.sd, out.wrench, out.covariance
    n = sd.shape[0]
    settings, usual = table.settings, table.usual_sd
    weights, product = work[_WEIGHTS_ROW, :n], work[_TURNED : _TURNED + 6]
    for k in range(n):
        weights[k] = np.sqrt(sd[k] * usual[k])
    whiten(table, sample.J, sample.tau_ext, weights, work)
    unseen, plain = work[_TURN : _TURN + 6], work[_PLAIN : _PLAIN + 6]
    gain, white = work[_SCRATCH : _SCRATCH + 6], work[_VECTOR, :n]
    R = work[_INVERSE_FACTOR : _INVERSE_FACTOR + 6]
    for i in range(6):
        wrench[i] = 0.0
        for k in range(n):
            gain[i, k] = 0.0
    for turn in range(2):  # first with the prior of `valid`, then the reading
        force_sd = settings[_VALID_FORCE_SD] if turn == 0 else settings[_FORCE_SD]
        _posterior_covariance(0.0, force_sd, 3, unseen, work)
        for k in range(n):  # R^T R S A by the factor, as in `_posterior`
            for i in range(3, 6):
                gain[i, k] = 0.0
                for j in range(3, i + 1):
                    gain[i, k] += R[i, j] * work[_WHITE + j, k]
            for i in range(3, 6):
                total = 0.0
                for j in range(i, 6):
                    total += R[j, i] * gain[j, k]
                gain[i, k] = force_sd * force_sd * total
        for i in range(3, 6):
            for k in range(n):
                white[k] = gain[i, k]
            for k in range(n):
                total = 0.0
                for j in range(k, n):
                    total += white[j] * table.whitening[j, k]
                gain[i, k] = total / weights[k]
        _propagated(table, gain, sd, product, covariance)
        for i in range(3, 6):
            for j in range(3, 6):
                for k in range(3, 6):
                    covariance[i, j] += unseen[i, k] / force_sd * (unseen[j, k] / force_sd)
        if turn == 0:
            for i in range(6):
                for j in range(6):
                    plain[i, j] = covariance[i, j]
            if _has_stiction(sample.stiction):
                _stiction_covariance(gain[3:], sample.stiction, work)
    for i in range(3, 6):
        for k in range(n):
            wrench[i] += gain[i, k] * sample.tau_ext[k]


@kernel
def _has_stiction(stiction: Array) -> bool:
    """Whether any joint has stiction; without it its covariance need not be computed."""
    total = 0.0
    for part in stiction:
        total += abs(part)
    return total != 0.0


@kernel
def _stiction_covariance(gain: Array, stiction: Array, work: Array) -> None:
    """Writes the covariance (3, 3) of the force that stiction alone causes, by a gain (3, n)."""
    for i in range(3):
        for j in range(i + 1):
            total = 0.0
            for k in range(stiction.shape[0]):
                total += gain[i, k] * gain[j, k] * stiction[k] * stiction[k]
            work[_FROM_STICTION + i, j] = total
            work[_FROM_STICTION + j, i] = total


@kernel
def _pseudo_inverse(
    table: WrenchConstants, sample: TorqueSample, out: WrenchOut, work: Array
) -> bool:
    """Writes a reading by singular values: inverse, damped, truncated.

    Leaves in `work` the covariances of the plain inverse, which `valid` needs. Returns whether J
    has full rank.
    """
    J, tau_ext, sd, stiction = sample
    wrench, covariance = out.wrench, out.covariance
    n = J.shape[1]
    settings = table.settings
    method = int(settings[_METHOD])
    B = work[_TURNED : _TURNED + 6]  # Q J, orthogonal rows
    Q = work[_TURN : _TURN + 6]
    H = work[_MATRIX : _MATRIX + 6]  # wrench = H tau_ext
    plain = work[_PLAIN : _PLAIN + 6]
    product = work[_SCRATCH : _SCRATCH + 6]
    s, gain = work[_VECTOR], work[_VECTOR + 1]
    if method == _INVERSE and n == 6 and _eliminated(table, sample, out, work):
        return True
    orthogonalise_rows(J, B, Q)
    largest, smallest, noise = 0.0, np.inf, 0.0
    for i in range(6):
        total = 0.0
        for j in range(n):
            total += B[i, j] * B[i, j]
        s[i] = np.sqrt(total)
        largest = max(largest, s[i])
        smallest = min(smallest, s[i])
    for j in range(n):
        noise = max(noise, table.covariance[j, j] * sd[j] * sd[j])
    # Below this a singular value is rounding: the direction is not seen at all.
    floor = max(max(6, n) * 2.2e-16 * largest, 1e-15)
    for turn in range(2):  # the plain inverse first, then that of the method
        for i in range(6):
            gain[i] = 1.0 / s[i] if s[i] > floor else 0.0
            if turn == 1 and method == _DAMPED:
                gain[i] = s[i] / (s[i] * s[i] + settings[_DAMPING] * settings[_DAMPING])
            elif turn == 1 and method == _TRUNCATED and s[i] <= settings[_TRUNCATION] * largest:
                gain[i] = 0.0
        for i in range(6):
            for j in range(n):
                total = 0.0
                for m in range(6):
                    if gain[m] > 0.0:
                        total += Q[m, i] * (gain[m] / s[m]) * B[m, j]
                H[i, j] = total
        _propagated(table, H, sd, product, covariance)
        for i in range(6):
            for j in range(i + 1):
                for m in range(6):
                    if s[m] <= floor and (turn == 0 or method == _INVERSE):
                        covariance[i, j] += noise / (floor * floor) * Q[m, i] * Q[m, j]
                covariance[j, i] = covariance[i, j]
                if turn == 0:
                    plain[i, j] = covariance[i, j]
                    plain[j, i] = covariance[i, j]
        if turn == 0 and _has_stiction(stiction):
            _stiction_covariance(H[3:], stiction, work)
    for i in range(6):
        total = 0.0
        for j in range(n):
            total += H[i, j] * tau_ext[j]
        wrench[i] = total
    return bool(smallest > floor)


@kernel
def _eliminated(table: WrenchConstants, sample: TorqueSample, out: WrenchOut, work: Array) -> bool:
    """Writes the reading of a square J that is far from singular; returns whether it is.

    Elimination is several times as fast as singular values, to the same rounding. As
    `_pseudo_inverse` it leaves the covariances for `valid` in `work`.
    """
    B, H = work[_TURNED : _TURNED + 6], work[_MATRIX : _MATRIX + 6]
    if not invert_transposed(sample.J, B, H):
        return False
    size, inverse = 0.0, 0.0  # squares of Frobenius norms: bounds of the singular values
    for i in range(6):
        for j in range(6):
            size += sample.J[i, j] * sample.J[i, j]
            inverse += H[i, j] * H[i, j]
    if not (size * inverse < _WELL_CONDITIONED * _WELL_CONDITIONED and inverse < 1e24):
        return False
    plain, covariance = work[_PLAIN : _PLAIN + 6], out.covariance
    _propagated(table, H, sample.sd, work[_SCRATCH : _SCRATCH + 6], covariance)
    for i in range(6):
        total = 0.0
        for j in range(6):
            plain[i, j] = covariance[i, j]
            total += H[i, j] * sample.tau_ext[j]
        out.wrench[i] = total
    if _has_stiction(sample.stiction):
        _stiction_covariance(H[3:], sample.stiction, work)
    return True


@kernel
def _propagated(
    table: WrenchConstants, H: Array, sd: Array, product: Array, covariance: Array
) -> None:
    """Writes the covariance (6, 6) of H (6, n) times torques with errors of these sds (n,)."""
    n = sd.shape[0]
    for i in range(6):
        for j in range(n):
            total = 0.0
            for k in range(n):
                total += H[i, k] * sd[k] * table.covariance[k, j]
            product[i, j] = total * sd[j]
        for j in range(i + 1):
            total = 0.0
            for k in range(n):
                total += product[i, k] * H[j, k]
            covariance[i, j] = total
            covariance[j, i] = total


def reconstruct_log(
    table: WrenchConstants,
    J_now: Array,
    J: Array,
    tau_ext: Array,
    sd: Array,
    stiction: Array,
) -> WrenchOut:
    """The readings of N samples, by threads.

    Args:
        table: of WrenchReconstruction.
        J_now: (N, 6, n) of the samples, for the condition numbers, which are NaN where it has no
            rows.
        J, tau_ext, sd, stiction: as TorqueSample.
    """
    N, method = len(J), int(table.settings[_METHOD])
    out = WrenchOut(np.empty((N, 6)), np.empty((N, 6, 6)), np.empty((N, NUM_QUALITY)))
    condition = np.empty(len(J_now))
    # Each method is compiled by itself: most programs call one.
    read_rows = inverse_rows
    if method in (FORCE_ONLY, BAYESIAN):
        read_rows = (
            balanced_rows if method == FORCE_ONLY and len(table.usual_sd) else posterior_rows
        )

    if N <= _BLOCK_SAMPLES:
        if len(J_now):
            condition_numbers_of(J_now, condition)
        read_rows(*table, condition, J, tau_ext, sd, stiction, *out)
        return out

    def run(rows: slice) -> None:
        if len(J_now):
            condition_numbers_of(J_now[rows], condition[rows])
        read_rows(
            *table,
            condition[rows],
            J[rows],
            tau_ext[rows],
            sd[rows],
            stiction[rows],
            out.wrench[rows],
            out.covariance[rows],
            out.quality[rows],
        )

    in_row_blocks(run, N, _BLOCK_SAMPLES)
    return out


@kernel
def _write_condition(condition: Array, k: int, quality: Array) -> None:
    """Writes the condition number of sample k: inf where it has none, NaN if it is not wanted."""
    quality[CONDITION] = np.nan
    if condition.shape[0] > 0:
        quality[CONDITION] = np.inf if np.isnan(condition[k]) else condition[k]


@kernel(nogil=True)
def posterior_rows(
    whitening: Array,
    torque_covariance: Array,
    settings: Array,
    usual_sd: Array,
    condition: Array,
    J: Array,
    tau_ext: Array,
    sd: Array,
    stiction: Array,
    wrench: Array,
    covariance: Array,
    quality: Array,
) -> None:
    """Writes wrench, covariance and quality of N samples.

    Args:
        whitening, torque_covariance, settings, usual_sd: WrenchConstants.
        condition: (N,) of J_now, NaN where it is not finite; (0,): not wanted.
        J, tau_ext, sd, stiction: (N, ...) as TorqueSample.
        wrench, covariance, quality: (N, ...) written, as WrenchOut.
    """
    table = WrenchConstants(whitening, torque_covariance, settings, usual_sd)
    work = np.empty((WORK_ROWS, max(J.shape[2], 6)))
    for k in range(J.shape[0]):
        sample = TorqueSample(J[k], tau_ext[k], sd[k], stiction[k])
        out = WrenchOut(wrench[k], covariance[k], quality[k])
        _write_condition(condition, k, quality[k])
        if _is_readable(table, sample, out):
            _posterior(table, sample, out, work)
            _rate(table, sample, out, True, work)


@kernel(nogil=True)
def balanced_rows(
    whitening: Array,
    torque_covariance: Array,
    settings: Array,
    usual_sd: Array,
    condition: Array,
    J: Array,
    tau_ext: Array,
    sd: Array,
    stiction: Array,
    wrench: Array,
    covariance: Array,
    quality: Array,
) -> None:
    """As `posterior_rows`, of a point force weighted as `_balanced` says."""
    table = WrenchConstants(whitening, torque_covariance, settings, usual_sd)
    work = np.empty((WORK_ROWS, max(J.shape[2], 6)))
    for k in range(J.shape[0]):
        sample = TorqueSample(J[k], tau_ext[k], sd[k], stiction[k])
        out = WrenchOut(wrench[k], covariance[k], quality[k])
        _write_condition(condition, k, quality[k])
        if _is_readable(table, sample, out):
            _balanced(table, sample, out, work)
            _rate(table, sample, out, True, work)


@kernel(nogil=True)
def inverse_rows(
    whitening: Array,
    torque_covariance: Array,
    settings: Array,
    usual_sd: Array,
    condition: Array,
    J: Array,
    tau_ext: Array,
    sd: Array,
    stiction: Array,
    wrench: Array,
    covariance: Array,
    quality: Array,
) -> None:
    """As `posterior_rows`, by singular values."""
    table = WrenchConstants(whitening, torque_covariance, settings, usual_sd)
    work = np.empty((WORK_ROWS, max(J.shape[2], 6)))
    for k in range(J.shape[0]):
        sample = TorqueSample(J[k], tau_ext[k], sd[k], stiction[k])
        out = WrenchOut(wrench[k], covariance[k], quality[k])
        _write_condition(condition, k, quality[k])
        if _is_readable(table, sample, out):
            has_full_rank = _pseudo_inverse(table, sample, out, work)
            _rate(table, sample, out, has_full_rank, work)


@kernel
def reasons_log(table: WrenchConstants, quality: Array, invalid: InvalidCodes) -> None:
    """`reconstruction_reasons` for N samples; `invalid` (N,) is written."""
    for k in range(quality.shape[0]):
        invalid[k] = reconstruction_reasons(table, quality[k])
