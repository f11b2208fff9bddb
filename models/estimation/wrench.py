"""From external joint torque to the wrench at the tool, and how far it can be trusted.

Measured is tau_ext = J^T F + e with torque noise e of covariance Sigma_tau; known beforehand is
that F has mean zero and covariance P (force sd and moment sd, alike in every direction, so that
it holds in any axes). Then

    Sigma_F = (J Sigma_tau^-1 J^T + P^-1)^-1,    F = Sigma_F J Sigma_tau^-1 tau_ext

One estimator, several readings of it:

    inverse     P infinite and Sigma_tau a multiple of one: F = pinv(J^T) tau_ext, the article's
                (Lu et al., eq. 22), for any number of joints
    force_only  the moment sd is zero and the force sd infinite: weighted least squares for a
                point contact at E; moment and its covariance are exactly zero
    bayesian    P as configured
    damped      what other projects use: V diag(s/(s^2 + damping^2)) U^T, J^T = U diag(s) V^T
    truncated   the same with 1/s where s > truncation max(s) and 0 elsewhere (numpy's pinv)

The stated covariance of `inverse`, `damped` and `truncated` is that of the noise passed through
their matrix. For the last two it leaves out what they lose of the true wrench: they read it
shrunk towards zero, by an amount that no covariance of the noise shows.

Every 6-vector is rotation first: F_E_W = [mx my mz fx fy fz] at E in axes of W, exerted by the
environment on the robot; J is (6, n) with rows [angular; linear] at E in axes of W.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numba import njit, prange
from numpy.typing import ArrayLike, NDArray

from models.rigid_body.bounded_minimum import bounded_minimum
from models.rigid_body.conditioning import condition_number_of, condition_numbers_of
from models.rigid_body.ties import in_order

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

METHODS = ("inverse", "force_only", "bayesian", "damped", "truncated")
_INVERSE, _FORCE_ONLY, _BAYESIAN, _DAMPED, _TRUNCATED = range(5)

STANDARD_GRAVITY = 9.80665
PRIOR_LEVER = 0.05  # m; what a tool's contact is off E, for the live rule
UNKNOWN_SD = 1e6  # N or N m; stands for infinity: no arm's wrench gets near it

# Last row of `WrenchReconstruction.table`.
_METHOD, _FORCE_SD, _MOMENT_SD, _DAMPING, _TRUNCATION, _MAX_FORCE_SD, _NUM_SETTINGS = range(7)

# Rows of the scratch array, (_NUM_ROWS, max(n, 6)).
_WHITE, _FACTOR, _INVERSE_FACTOR, _TURNED, _TURN, _MATRIX, _PLAIN = range(0, 42, 6)
_SCRATCH, _VECTOR = 42, 48
_NUM_ROWS = _VECTOR + 3
_BLOCK = 256  # samples a thread takes at a time


@dataclass
class WrenchReconstructionConfig:
    """How joint torque becomes a wrench. A prior of None is left to a rule (`live_prior`, or
    `evidence_prior` of a log), to be put in by `with_prior`.
    """

    method: str = "bayesian"  # one of METHODS
    prior_force_sd: float | None = None  # N, in every direction
    prior_moment_sd: float | None = None  # N m about E, in every direction
    max_force_sd: float | None = None  # N; worst principal force sd of a valid reading; None: below
    damping: float = 0.2  # of `damped`, on the singular values of J in m and rad
    truncation: float = 0.05  # of `truncated`, as a share of the largest singular value

    def with_prior(self, force_sd: float, moment_sd: float) -> "WrenchReconstructionConfig":
        """Returns a copy in which the sds that were None are these (N, N m)."""
        return replace(
            self,
            prior_force_sd=force_sd if self.prior_force_sd is None else self.prior_force_sd,
            prior_moment_sd=moment_sd if self.prior_moment_sd is None else self.prior_moment_sd,
        )


class WrenchEstimate(NamedTuple):
    """One reading, or one per sample.

    `valid` is False where the reading says less about the force, in its worst direction, than
    was known before measuring. For `inverse` (and `damped`, `truncated`, which only hide it) and
    `force_only` that is where the largest principal force sd of the plain weighted reading
    exceeds prior_force_sd, or J is singular; for `bayesian`, where prior and measurement are
    combined, the same point is passed when it exceeds prior_force_sd / sqrt(2). With max_force_sd
    that bound takes the place of both. Input that is not finite gives a wrench of zero, the
    prior's covariance and False.

    Attributes:
        wrench: (..., 6) F_E_W, N m and N, rotation first.
        covariance: (..., 6, 6) of it.
        condition_number: (...) of J in m and rad, as `models.rigid_body.conditioning`; inf also where J is
            not finite.
        valid: (...) bool.
    """

    wrench: Array
    covariance: Array
    condition_number: Array
    valid: Flags

    @property
    def standard_deviation(self) -> Array:
        """(..., 6) N m and N, rotation first."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1)))


def live_prior(payload: float) -> tuple[float, float]:
    """The rule for a prior where no log is at hand: (force sd in N, moment sd in N m).

    An arm rated for `payload` kg is given tasks of that size: its weight is taken as a two-sigma
    force, and the force to act PRIOR_LEVER off E.
    """
    force_sd = 0.5 * payload * STANDARD_GRAVITY
    return force_sd, PRIOR_LEVER * force_sd


class WrenchReconstruction:
    """The mathematics of this module for one torque covariance and one configuration.

    Attributes:
        table: (2 n + 1, max(n, 6)) constants that `reconstruct` reads.

    Raises:
        ValueError: an unknown method, a prior that is missing or negative, damping or truncation
            that is negative, a covariance that is not symmetric positive definite.
    """

    def __init__(self, config: WrenchReconstructionConfig, torque_covariance: ArrayLike) -> None:
        Sigma = np.array(torque_covariance, float)
        if Sigma.ndim != 2 or Sigma.shape[0] != Sigma.shape[1] or not Sigma.shape[0]:
            raise ValueError(f"torque covariance must be (n, n), not {Sigma.shape}")
        n = Sigma.shape[0]
        self.num_joints = n
        self.config = config
        self.torque_covariance = Sigma
        self.table = np.zeros((2 * n + 1, max(n, _NUM_SETTINGS)))
        self.table[:n, :n] = _whitening(Sigma)
        self.table[n : 2 * n, :n] = Sigma
        self.table[2 * n, :_NUM_SETTINGS] = _settings(config)

    def scratch(self) -> Array:
        """Returns a new work array for `reconstruct`; one per thread."""
        return np.zeros((_NUM_ROWS, max(self.num_joints, 6)))

    def reconstruct(self, J: ArrayLike, tau_ext: ArrayLike) -> WrenchEstimate:
        """Returns the reading for J ((6, n) or (N, 6, n)) and tau_ext ((n,) or (N, n), N m)."""
        n = self.num_joints
        J = np.asarray(J, float)
        tau_ext = np.asarray(tau_ext, float)
        lead = tau_ext.shape[:-1]
        if tau_ext.shape[-1:] != (n,) or J.shape != (*lead, 6, n):
            raise ValueError(
                f"J must be (..., 6, {n}) and tau_ext (..., {n}), not {J.shape} and {tau_ext.shape}"
            )
        rows = int(np.prod(lead))
        wrench, covariance = np.empty((rows, 6)), np.empty((rows, 6, 6))
        quality = np.empty((rows, 2))
        reconstruct_log(
            self.table,
            np.require(J.reshape(rows, 6, n), float, ("C", "W")),
            np.require(tau_ext.reshape(rows, n), float, ("C", "W")),
            wrench,
            covariance,
            quality,
        )
        return WrenchEstimate(
            wrench.reshape(*lead, 6),
            covariance.reshape(*lead, 6, 6),
            quality[:, 0].reshape(lead),
            (quality[:, 1] == 1.0).reshape(lead),
        )


def reconstruct_wrench(
    J: ArrayLike,
    tau_ext: ArrayLike,
    torque_covariance: ArrayLike,
    config: WrenchReconstructionConfig,
) -> WrenchEstimate:
    """Returns the reading for J ((6, n) or (N, 6, n)) and tau_ext ((n,) or (N, n), N m).

    Args:
        J: rows [angular; linear] at E in axes of W.
        tau_ext: external joint torque, positive along the motion it causes.
        torque_covariance: (n, n) Sigma_tau of the error of tau_ext, N^2 m^2, positive definite.
        config: method and prior.

    Raises:
        ValueError: as `WrenchReconstruction`, or shapes that disagree.
    """
    return WrenchReconstruction(config, torque_covariance).reconstruct(J, tau_ext)


def _whitening(Sigma: Array) -> Array:
    """Returns W (n, n), lower triangular, with W Sigma W^T = 1."""
    if not np.all(np.isfinite(Sigma)) or not np.allclose(Sigma, Sigma.T, rtol=1e-9, atol=0.0):
        raise ValueError("torque covariance must be finite and symmetric")
    try:
        return np.asarray(np.linalg.inv(np.linalg.cholesky(Sigma)))
    except np.linalg.LinAlgError:
        raise ValueError(
            "torque covariance must be positive definite: every joint needs a torque sd above zero"
        ) from None


def _settings(config: WrenchReconstructionConfig) -> list[float]:
    if config.method not in METHODS:
        raise ValueError(f"method must be one of {', '.join(METHODS)}, not {config.method!r}")
    for name in ("prior_force_sd", "prior_moment_sd", "max_force_sd"):
        value = getattr(config, name)
        if value is not None and not value >= 0.0:
            raise ValueError(f"{name} must be zero or more, not {value}")
    for name in ("damping", "truncation"):
        if not 0.0 <= getattr(config, name) < np.inf:
            raise ValueError(f"{name} must be zero or more, not {getattr(config, name)}")
    force_sd, moment_sd = config.prior_force_sd, config.prior_moment_sd
    method = METHODS.index(config.method)
    if method == _BAYESIAN and (force_sd is None or moment_sd is None):
        raise ValueError("method bayesian needs prior_force_sd and prior_moment_sd")
    known_force = UNKNOWN_SD if force_sd is None else min(force_sd, UNKNOWN_SD)
    known_moment = UNKNOWN_SD if moment_sd is None else min(moment_sd, UNKNOWN_SD)
    bound = config.max_force_sd
    if bound is None:
        bound = known_force / np.sqrt(2.0) if method == _BAYESIAN else known_force
    if method == _FORCE_ONLY:
        known_force, known_moment = UNKNOWN_SD, 0.0
    return [method, known_force, known_moment, config.damping, config.truncation, bound]


# ----------------------------------------------------------------------------------------------
# Kernels
# ----------------------------------------------------------------------------------------------


@njit(cache=True, error_model="numpy")
def reconstruct(table, J, tau_ext, wrench, covariance, quality, work):  # type: ignore[no-untyped-def]
    """Single-sample kernel of `WrenchReconstruction`.

    Args:
        table: `WrenchReconstruction.table`.
        J: (6, n).
        tau_ext: (n,).
        wrench: (6,), written.
        covariance: (6, 6), written.
        quality: (2,), written: condition number, and 1 for valid or 0.
        work: `WrenchReconstruction.scratch()`.
    """
    valid = _reading(table, J, tau_ext, wrench, covariance, work)
    condition = condition_number_of(J, work[_SCRATCH : _SCRATCH + 6])
    quality[0] = np.inf if np.isnan(condition) else condition
    quality[1] = 1.0 if valid else 0.0


@njit(cache=True, error_model="numpy")
def _reading(table, J, tau_ext, wrench, covariance, work):  # type: ignore[no-untyped-def]
    """Writes wrench and covariance and returns whether they are valid."""
    n = J.shape[1]
    settings = table[2 * n]
    total = 0.0
    for j in range(n):
        total += tau_ext[j]
        for i in range(6):
            total += J[i, j]
    if not np.isfinite(total):
        for i in range(6):
            wrench[i] = 0.0
            for j in range(6):
                covariance[i, j] = 0.0
            sd = settings[_MOMENT_SD] if i < 3 else settings[_FORCE_SD]
            covariance[i, i] = sd * sd
        return False
    method = int(settings[_METHOD])
    if method in (_FORCE_ONLY, _BAYESIAN):
        _posterior(table, J, tau_ext, wrench, covariance, work)
        seen = True
    else:
        seen = _pseudo_inverse(table, J, tau_ext, wrench, covariance, work)
    worst = largest_eigenvalue_3x3(work[_PLAIN + 3 : _PLAIN + 6, 3:])
    return seen and worst <= settings[_MAX_FORCE_SD] ** 2


@njit(cache=True, error_model="numpy")
def whiten(table, J, tau_ext, scale_moment, scale_force, work):  # type: ignore[no-untyped-def]
    """Writes B = S J W^T into the first six rows of `work` and B W tau_ext into its last row.

    W whitens the torque noise and S = diag(scale_moment, scale_force) scales the wrench.
    """
    n = J.shape[1]
    white_tau = work[_VECTOR]
    for j in range(n):
        total = 0.0
        for k in range(j + 1):
            total += table[j, k] * tau_ext[k]
        white_tau[j] = total
    for i in range(6):
        scale = scale_moment if i < 3 else scale_force
        dot = 0.0
        for j in range(n):
            total = 0.0
            for k in range(j + 1):
                total += table[j, k] * J[i, k]
            work[_WHITE + i, j] = scale * total
            dot += work[_WHITE + i, j] * white_tau[j]
        work[_VECTOR + 2, i] = dot


@njit(cache=True, error_model="numpy")
def _posterior(table, J, tau_ext, wrench, covariance, work):  # type: ignore[no-untyped-def]
    """The Gaussian posterior, with the wrench in units of its prior sd: x = S^-1 F.

    cov(x) = (1 + B B^T)^-1. Every pivot of that matrix's factorisation is at least 1, however
    large or small the prior and however singular J; rounding cannot push one below.
    """
    n = J.shape[1]
    settings = table[2 * n]
    whiten(table, J, tau_ext, settings[_MOMENT_SD], settings[_FORCE_SD], work)
    L = work[_FACTOR : _FACTOR + 6]
    R = work[_INVERSE_FACTOR : _INVERSE_FACTOR + 6]
    y = work[_VECTOR + 1]
    for i in range(6):
        for j in range(i + 1):
            total = 1.0 if i == j else 0.0
            for k in range(n):
                total += work[_WHITE + i, k] * work[_WHITE + j, k]
            L[i, j] = total
    factorise(L, R)
    for i in range(6):
        total = 0.0
        for j in range(i + 1):
            total += R[i, j] * work[_VECTOR + 2, j]
        y[i] = total
    for i in range(6):
        scale_i = settings[_MOMENT_SD] if i < 3 else settings[_FORCE_SD]
        total = 0.0
        for k in range(i, 6):
            total += R[k, i] * y[k]
        wrench[i] = scale_i * total
        for j in range(i + 1):
            scale_j = settings[_MOMENT_SD] if j < 3 else settings[_FORCE_SD]
            total = 0.0
            for k in range(i, 6):
                total += R[k, i] * R[k, j]
            covariance[i, j] = scale_i * scale_j * total
            covariance[j, i] = covariance[i, j]
            work[_PLAIN + i, j] = covariance[i, j]
            work[_PLAIN + j, i] = covariance[i, j]


@njit(cache=True, error_model="numpy")
def factorise(L, R):  # type: ignore[no-untyped-def]
    """Cholesky of a 6x6 matrix that is at least the identity, and the factor's inverse.

    Args:
        L: (6, 6+) lower triangle of the matrix; replaced by its factor.
        R: (6, 6+), written: inverse of the factor, lower triangle.
    """
    for j in range(6):
        pivot = L[j, j]
        for k in range(j):
            pivot -= L[j, k] * L[j, k]
        L[j, j] = np.sqrt(max(pivot, 1.0))
        R[j, j] = 1.0 / L[j, j]
        for i in range(j + 1, 6):
            total = L[i, j]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            L[i, j] = total * R[j, j]
    for j in range(6):
        for i in range(j + 1, 6):
            total = 0.0
            for k in range(j, i):
                total += L[i, k] * R[k, j]
            R[i, j] = -total * R[i, i]


@njit(cache=True, error_model="numpy")
def _pseudo_inverse(table, J, tau_ext, wrench, covariance, work):  # type: ignore[no-untyped-def]
    """The readings by singular values: inverse, damped, truncated.

    Leaves the plain inverse's covariance in `work`, and returns whether J has full rank.
    """
    n = J.shape[1]
    settings = table[2 * n]
    method = int(settings[_METHOD])
    B = work[_TURNED : _TURNED + 6]  # Q J, orthogonal rows
    Q = work[_TURN : _TURN + 6]
    H = work[_MATRIX : _MATRIX + 6]  # wrench = H tau_ext
    plain = work[_PLAIN : _PLAIN + 6]
    product = work[_SCRATCH : _SCRATCH + 6]
    s, gain = work[_VECTOR], work[_VECTOR + 1]
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
        noise = max(noise, table[n + j, j])
    # Below this a singular value is rounding: the direction is not seen at all.
    floor = max(max(6, n) * 2.2e-16 * largest, 1e-15)
    for turn in range(2):  # the plain inverse first, then the method's own
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
        for i in range(6):
            for j in range(n):
                total = 0.0
                for k in range(n):
                    total += H[i, k] * table[n + k, j]
                product[i, j] = total
            for j in range(i + 1):
                total = 0.0
                for k in range(n):
                    total += product[i, k] * H[j, k]
                for m in range(6):
                    if s[m] <= floor and (turn == 0 or method == _INVERSE):
                        total += noise / (floor * floor) * Q[m, i] * Q[m, j]
                covariance[i, j] = total
                covariance[j, i] = total
                if turn == 0:
                    plain[i, j] = total
                    plain[j, i] = total
    for i in range(6):
        total = 0.0
        for j in range(n):
            total += H[i, j] * tau_ext[j]
        wrench[i] = total
    return smallest > floor


@njit(cache=True, error_model="numpy")
def orthogonalise_rows(J, B, Q):  # type: ignore[no-untyped-def]
    """One-sided Jacobi: writes Q (6, 6), orthogonal, and B = Q J whose rows are orthogonal.

    Their lengths are the singular values, each with a small relative error.
    """
    n = J.shape[1]
    for i in range(6):
        for j in range(n):
            B[i, j] = J[i, j]
        for j in range(6):
            Q[i, j] = 1.0 if i == j else 0.0
    for _ in range(30):
        turned = False
        for p in range(5):
            for q in range(p + 1, 6):
                pp, qq, pq = 0.0, 0.0, 0.0
                for k in range(n):
                    pp += B[p, k] * B[p, k]
                    qq += B[q, k] * B[q, k]
                    pq += B[p, k] * B[q, k]
                if abs(pq) <= 1e-15 * np.sqrt(pp * qq):
                    continue
                turned = True
                zeta = (qq - pp) / (2.0 * pq)
                t = 1.0 / (abs(zeta) + np.sqrt(1.0 + zeta * zeta))
                if zeta < 0.0:
                    t = -t
                c = 1.0 / np.sqrt(1.0 + t * t)
                d = c * t
                for k in range(n):
                    x, y = B[p, k], B[q, k]
                    B[p, k], B[q, k] = c * x - d * y, d * x + c * y
                for k in range(6):
                    x, y = Q[p, k], Q[q, k]
                    Q[p, k], Q[q, k] = c * x - d * y, d * x + c * y
        if not turned:
            break


@njit(cache=True, error_model="numpy")
def largest_eigenvalue_3x3(A):  # type: ignore[no-untyped-def]
    """Largest eigenvalue of a symmetric 3x3 matrix, in closed form (Smith, 1961)."""
    mean = (A[0, 0] + A[1, 1] + A[2, 2]) / 3.0
    off = A[0, 1] ** 2 + A[0, 2] ** 2 + A[1, 2] ** 2
    a, b, c = A[0, 0] - mean, A[1, 1] - mean, A[2, 2] - mean
    size = np.sqrt((a * a + b * b + c * c + 2.0 * off) / 6.0)
    if not size > 0.0:
        return mean
    a, b, c = a / size, b / size, c / size
    d, e, f = A[0, 1] / size, A[0, 2] / size, A[1, 2] / size
    half_det = 0.5 * (a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e))
    return mean + 2.0 * size * np.cos(np.arccos(min(max(half_det, -1.0), 1.0)) / 3.0)


@njit(cache=True, error_model="numpy", parallel=True)
def reconstruct_log(table, J, tau_ext, wrench, covariance, quality):  # type: ignore[no-untyped-def]
    """`reconstruct` for N samples, in parallel."""
    N = J.shape[0]
    for block in prange((N + _BLOCK - 1) // _BLOCK):
        start, stop = block * _BLOCK, min(N, (block + 1) * _BLOCK)
        work = np.zeros((_NUM_ROWS, max(J.shape[2], 6)))
        conditions = np.empty(stop - start)
        condition_numbers_of(J[start:stop], conditions)
        for k in range(start, stop):
            valid = _reading(table, J[k], tau_ext[k], wrench[k], covariance[k], work)
            condition = conditions[k - start]
            quality[k, 0] = np.inf if np.isnan(condition) else condition
            quality[k, 1] = 1.0 if valid else 0.0


# ----------------------------------------------------------------------------------------------
# A prior from the log itself
# ----------------------------------------------------------------------------------------------

FORCE_SD_RANGE = (1.0, 1e4)  # N
MOMENT_SD_RANGE = (0.01, 1e3)  # N m
NOISE_SCALE_RANGE = (1e-3, 1e3)
EVIDENCE_SAMPLES = 2000


def evidence_prior(
    J: ArrayLike, tau_ext: ArrayLike, torque_covariance: ArrayLike
) -> tuple[float, float]:
    """The rule for a log's prior: the force sd (N) and moment sd (N m) that explain it best.

    They maximise the marginal likelihood sum_k log N(tau_k; 0, J_k^T P J_k + Sigma_tau) over at
    most EVIDENCE_SAMPLES samples, evenly spread over the log, within FORCE_SD_RANGE and
    MOMENT_SD_RANGE: a log without contact gives the lower bounds. Nothing is drawn at random. No
    sensor is needed: this is the size of the task as the torques show it.

    Args:
        J: (N, 6, n) at E in axes of W, rows [angular; linear].
        tau_ext: (N, n) N m.
        torque_covariance: (n, n) N^2 m^2.

    Raises:
        ValueError: no sample is finite, or shapes disagree.
    """
    force_sd, moment_sd, _ = _most_evident(J, tau_ext, torque_covariance, (1.0, 1.0))
    return force_sd, moment_sd


def evidence_prior_and_noise(
    J: ArrayLike, tau_ext: ArrayLike, torque_covariance: ArrayLike
) -> tuple[float, float, float]:
    """As `evidence_prior`, where only the shape of Sigma_tau is known.

    Torque that no wrench explains (with more joints than 6, or over many configurations) tells the
    noise from the wrench.

    Returns:
        Force sd (N), moment sd (N m), and the factor, within NOISE_SCALE_RANGE, by which the
        torque sds of `torque_covariance` are to be multiplied.
    """
    return _most_evident(J, tau_ext, torque_covariance, NOISE_SCALE_RANGE)


def _most_evident(
    J: ArrayLike, tau_ext: ArrayLike, torque_covariance: ArrayLike, scales: tuple[float, float]
) -> tuple[float, float, float]:
    J, tau_ext = np.asarray(J, float), np.asarray(tau_ext, float)
    Sigma = np.asarray(torque_covariance, float)
    if J.ndim != 3 or J.shape[1] != 6 or tau_ext.shape != (J.shape[0], J.shape[2]):
        raise ValueError(
            f"J must be (N, 6, n) and tau_ext (N, n), not {J.shape} and {tau_ext.shape}"
        )
    finite = np.flatnonzero(np.isfinite(tau_ext).all(axis=1) & np.isfinite(J).all(axis=(1, 2)))
    if finite.size == 0:
        raise ValueError("evidence_prior: no sample is finite")
    count = min(finite.size, EVIDENCE_SAMPLES)
    chosen = finite[np.linspace(0, finite.size - 1, count).round().astype(int)]
    W = _whitening(Sigma)
    B = J[chosen] @ W.T
    white_tau = tau_ext[chosen] @ W.T
    gram = np.ascontiguousarray(B @ B.transpose(0, 2, 1))
    seen = np.ascontiguousarray((B @ white_tau[..., None])[..., 0])
    power = float(np.mean(np.sum(white_tau**2, axis=1)))
    n = tau_ext.shape[1]

    def cost(log_sds: Array) -> tuple[float, Array]:
        """Minus the mean log likelihood, up to a constant; noise scale c: J / c, tau_ext / c.

        And its gradient by the logarithms of force_sd, moment_sd and c.
        """
        force_sd, moment_sd, c = np.exp(log_sds)
        fit, by_moment, by_force, by_weight = _log_evidence(
            gram, seen, moment_sd / c, force_sd / c, 1.0 / c
        )
        by_c = n - power / c**2 + by_moment + by_force + by_weight
        return float(0.5 * power / c**2 + n * np.log(c) - fit), np.array(
            [-by_force, -by_moment, by_c]
        )

    bounds = np.log(np.array([FORCE_SD_RANGE, MOMENT_SD_RANGE, scales]))
    # The surface can have several tops (a wrench explained as force or as moment) and flat plains
    # where a sd does not matter: climb from the best points of a coarse grid.
    axes = [np.linspace(low, high, 9 if low < high else 1) for low, high in bounds]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    starts = grid[in_order([cost(point)[0] for point in grid])[:4]]
    found, _ = bounded_minimum(cost, list(starts), bounds)
    force_sd, moment_sd, scale = np.exp(found)
    return float(force_sd), float(moment_sd), float(scale)


@njit(cache=True, error_model="numpy")
def _log_evidence(gram, seen, moment_sd, force_sd, weight):  # type: ignore[no-untyped-def]
    """What depends on the sds in the mean log likelihood of a sample; `weight` scales `seen`.

    By the matrix determinant and inversion lemmas only the 6x6 matrix A = 1 + S gram S appears:
    2 log N = -log det A + |A^-1/2 S seen|^2 + constant. With y = A^-1 S seen its derivative by the
    logarithm of a scale S_i is y_i^2 - 1 + (A^-1)_ii.

    Returns:
        It, and its derivatives by the logarithms of moment_sd, force_sd and weight.
    """
    L, R = np.zeros((6, 6)), np.zeros((6, 6))
    half, y = np.empty(6), np.empty(6)
    total, by_moment, by_force, by_weight = 0.0, 0.0, 0.0, 0.0
    for k in range(gram.shape[0]):
        for i in range(6):
            scale_i = moment_sd if i < 3 else force_sd
            for j in range(i + 1):
                scale_j = moment_sd if j < 3 else force_sd
                L[i, j] = scale_i * scale_j * gram[k, i, j] + (1.0 if i == j else 0.0)
        factorise(L, R)
        for i in range(6):
            half[i] = 0.0
            for j in range(i + 1):
                half[i] += R[i, j] * seen[k, j] * (moment_sd if j < 3 else force_sd)
            half[i] *= weight
            total += 0.5 * half[i] * half[i] - np.log(L[i, i])
            by_weight += half[i] * half[i]
        for i in range(6):
            y[i], inverse = 0.0, 0.0
            for j in range(i, 6):
                y[i] += R[j, i] * half[j]
                inverse += R[j, i] * R[j, i]
            if i < 3:
                by_moment += y[i] * y[i] - 1.0 + inverse
            else:
                by_force += y[i] * y[i] - 1.0 + inverse
    count = gram.shape[0]
    return total / count, by_moment / count, by_force / count, by_weight / count
