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

Sigma_tau may change from sample to sample: with sds s_j that a torque error model states
(`models.identification.torque_error_model`) and a constant correlation R it is diag(s) R diag(s).

**Valid** is a statement about the arm, not about the log: with what is known of a force before any
log is read (`live_prior`), the reading's largest principal force sd is at most TRUSTED_SHARE of
that prior's, and what stiction alone may feign, even within its band, stays below PHANTOM_SHARE of
it: sqrt 3 times the largest principal sd that stiction's part of the torque error gives through the
same gain. A joint at rest carries any torque within its stiction; a force that only such joints see
cannot be told from it.

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

from models.rigid_body.conditioning import condition_number_of, condition_numbers_of
from models.rigid_body.small_matrices import factorise, largest_eigenvalue_3x3, orthogonalise_rows

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

METHODS = ("inverse", "force_only", "bayesian", "damped", "truncated")
_INVERSE, _FORCE_ONLY, _BAYESIAN, _DAMPED, _TRUNCATED = range(5)

STANDARD_GRAVITY = 9.80665
PRIOR_LEVER = 0.05  # m; what a tool's contact is off E, for the live rule
UNKNOWN_SD = 1e6  # N or N m; stands for infinity: no arm's wrench gets near it
TRUSTED_SHARE = 1.0 / 3.0  # of the live prior's force sd: largest sd of a valid reading
PHANTOM_SHARE = 0.16  # of the same: 8 % of the rated payload's weight, 9.8 N on an arm for 12.5 kg

# Last row of `WrenchReconstruction.table`.
_METHOD, _FORCE_SD, _MOMENT_SD, _DAMPING, _TRUNCATION, _MAX_FORCE_SD = range(6)
_VALID_FORCE_SD, _VALID_MOMENT_SD, _MAX_PHANTOM, _NUM_SETTINGS = range(6, 10)

# Rows of the scratch array of `reconstruct`, (WORK_ROWS, max(n, 6)).
_WHITE, _FACTOR, _INVERSE_FACTOR, _TURNED, _TURN, _MATRIX, _PLAIN = range(0, 42, 6)
_SCRATCH, _FEIGNED, _VECTOR = 42, 48, 51
_SD, _STICTION = _VECTOR + 3, _VECTOR + 4
WORK_ROWS = _VECTOR + 5
_GRAM = _MATRIX  # of the posterior; the other methods keep their matrix there
_BLOCK = 256  # samples a thread takes at a time
_LARGEST = 1e60  # N, N m and their squares; more is as good as not finite


@dataclass
class WrenchReconstructionConfig:
    """How joint torque becomes a wrench. A prior of None is left to a rule (`live_prior`, or
    `evidence_prior` of a log), to be put in by `with_prior`.
    """

    method: str = "bayesian"  # one of METHODS
    prior_force_sd: float | None = None  # N, in every direction
    prior_moment_sd: float | None = None  # N m about E, in every direction
    max_force_sd: float | None = None  # N; worst principal force sd of a valid reading; None: above
    max_phantom: float | None = None  # N that stiction alone may feign in a valid one; None: above
    live_force_sd: float | None = None  # N, known before any log: what `valid` rests on
    live_moment_sd: float | None = None  # N m; None: `valid` rests on the prior of the reading
    damping: float = 0.2  # of `damped`, on the singular values of J in m and rad
    truncation: float = 0.05  # of `truncated`, as a share of the largest singular value

    def with_prior(self, force_sd: float, moment_sd: float) -> "WrenchReconstructionConfig":
        """Returns a copy in which the sds that were None are these (N, N m)."""
        return replace(
            self,
            prior_force_sd=force_sd if self.prior_force_sd is None else self.prior_force_sd,
            prior_moment_sd=moment_sd if self.prior_moment_sd is None else self.prior_moment_sd,
        )

    def with_live(self, force_sd: float, moment_sd: float) -> "WrenchReconstructionConfig":
        """Returns a copy in which what `valid` rests on, where it was None, is this (N, N m)."""
        return replace(
            self,
            live_force_sd=force_sd if self.live_force_sd is None else self.live_force_sd,
            live_moment_sd=moment_sd if self.live_moment_sd is None else self.live_moment_sd,
        )


class WrenchEstimate(NamedTuple):
    """One reading, or one per sample.

    `valid`: see the module. `force_only` knows that there is no moment, `inverse` (and `damped`,
    `truncated`, which only hide it) knows nothing beforehand and needs a J of full rank. Without a
    live prior in the configuration `valid` is False where the reading says less about the force,
    in its worst direction, than its own prior: where the largest principal force sd of the plain
    weighted reading exceeds prior_force_sd; for `bayesian`, where prior and measurement are
    combined, the same point is passed when it exceeds prior_force_sd / sqrt(2). With max_force_sd
    that bound takes the place of all. Input that is not finite, or whose reading is not,
    gives a wrench of zero, the prior's covariance and False.

    Attributes:
        wrench: (..., 6) F_E_W, N m and N, rotation first.
        covariance: (..., 6, 6) of it.
        condition_number: (...) of J in m and rad, as `models.rigid_body.conditioning`; inf also
            where J is not finite.
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

    With sds of each sample, the torque covariance is that of the errors in units of these sds.

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
        self.table[:n, :n] = whitening_matrix(Sigma)
        self.table[n : 2 * n, :n] = Sigma
        self.table[2 * n, :_NUM_SETTINGS] = _settings(config)

    def scratch(self) -> Array:
        """Returns a new work array for `reconstruct`; one per thread."""
        return np.zeros((WORK_ROWS, max(self.num_joints, 6)))

    def reconstruct(
        self,
        J: ArrayLike,
        tau_ext: ArrayLike,
        sd: ArrayLike | None = None,
        stiction: ArrayLike | None = None,
        J_now: ArrayLike | None = None,
    ) -> WrenchEstimate:
        """Returns the reading for J ((6, n) or (N, 6, n)) and tau_ext ((n,) or (N, n), N m).

        Args:
            J: as tau_ext saw it, see `models.observers.lag`.
            tau_ext: external joint torque.
            sd: as tau_ext; N m, of its errors; None: 1, so that the torque covariance is theirs.
            stiction: as tau_ext; the part of sd that is stiction; None: 0.
            J_now: as J, of the very sample, whose condition number is stated; None: J.
        """
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
        own = np.require(J.reshape(rows, 6, n), float, ("C", "W"))
        now = J if J_now is None else np.asarray(J_now, float)
        sd = np.ones_like(tau_ext) if sd is None else np.asarray(sd, float)
        held = np.zeros_like(tau_ext) if stiction is None else np.asarray(stiction, float)
        if not (now.shape == J.shape and sd.shape == held.shape == tau_ext.shape):
            raise ValueError("J_now must be as J, sd and stiction as tau_ext")
        reconstruct_log(
            self.table,
            np.require(now.reshape(rows, 6, n), float, ("C", "W")),
            own,
            np.require(tau_ext.reshape(rows, n), float, ("C", "W")),
            np.require(sd.reshape(rows, n), float, ("C", "W")),
            np.require(held.reshape(rows, n), float, ("C", "W")),
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


def whitening_matrix(Sigma: Array) -> Array:
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
    names = ("prior_force_sd", "prior_moment_sd", "max_force_sd", "max_phantom")
    for name in (*names, "live_force_sd", "live_moment_sd"):
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
    phantom = UNKNOWN_SD if config.max_phantom is None else config.max_phantom
    if method == _FORCE_ONLY:
        known_force, known_moment = UNKNOWN_SD, 0.0
    valid_force, valid_moment = known_force, known_moment
    if config.live_force_sd is not None and config.live_moment_sd is not None:
        valid_force = min(config.live_force_sd, UNKNOWN_SD)
        valid_moment = 0.0 if method == _FORCE_ONLY else min(config.live_moment_sd, UNKNOWN_SD)
        if config.max_force_sd is None:
            bound = TRUSTED_SHARE * valid_force
        if config.max_phantom is None:
            phantom = PHANTOM_SHARE * valid_force
    return [
        *(method, known_force, known_moment, config.damping, config.truncation, bound),
        *(valid_force, valid_moment, phantom),
    ]


# ----------------------------------------------------------------------------------------------
# Kernels
# ----------------------------------------------------------------------------------------------


@njit(cache=True, error_model="numpy")
def reconstruct(table, J, tau_ext, wrench, covariance, quality, work):  # type: ignore[no-untyped-def]
    """Single-sample kernel of `WrenchReconstruction`, of errors whose covariance is constant.

    Args:
        table: `WrenchReconstruction.table`.
        J: (6, n).
        tau_ext: (n,).
        wrench: (6,), written.
        covariance: (6, 6), written.
        quality: (2,), written: condition number, and 1 for valid or 0.
        work: `WrenchReconstruction.scratch()`.
    """
    n = J.shape[1]
    sd, stiction = work[_SD, :n], work[_STICTION, :n]
    for j in range(n):
        sd[j], stiction[j] = 1.0, 0.0
    reconstruct_with(table, J, J, tau_ext, sd, stiction, wrench, covariance, quality, work)


@njit(cache=True, error_model="numpy")
def reconstruct_with(  # type: ignore[no-untyped-def]
    table, J_now, J, tau_ext, sd, stiction, wrench, covariance, quality, work
):
    """As `reconstruct`, of errors with sds of this sample.

    Args:
        J_now: (6, n) of the sample, for the condition number.
        J: (6, n) as tau_ext saw it.
        sd: (n,) N m, positive.
        stiction: (n,) N m, the part of it that is stiction.
    """
    valid = _reading(table, J, tau_ext, sd, stiction, wrench, covariance, work)
    condition = condition_number_of(J_now, work[_SCRATCH : _SCRATCH + 6])
    quality[0] = np.inf if np.isnan(condition) else condition
    quality[1] = 1.0 if valid else 0.0


@njit(cache=True, error_model="numpy")
def _reading(table, J, tau_ext, sd, stiction, wrench, covariance, work):  # type: ignore[no-untyped-def]
    """Writes wrench and covariance and returns whether they are valid."""
    n = J.shape[1]
    settings = table[2 * n]
    total = 0.0
    for j in range(n):
        total += tau_ext[j] + sd[j]
        for i in range(6):
            total += J[i, j]
    if not np.isfinite(total):
        _nothing(settings, wrench, covariance)
        return False
    method = int(settings[_METHOD])
    if method in (_FORCE_ONLY, _BAYESIAN):
        _posterior(table, J, tau_ext, sd, stiction, wrench, covariance, work)
        seen = True
    else:
        seen = _pseudo_inverse(table, J, tau_ext, sd, stiction, wrench, covariance, work)
    total = 0.0
    for i in range(6):
        total += abs(wrench[i]) + covariance[i, i]
    if not total < _LARGEST:
        _nothing(settings, wrench, covariance)
        return False
    worst = largest_eigenvalue_3x3(work[_PLAIN + 3 : _PLAIN + 6, 3:])
    feigned = 3.0 * largest_eigenvalue_3x3(work[_FEIGNED : _FEIGNED + 3])
    return seen and worst <= settings[_MAX_FORCE_SD] ** 2 and feigned <= settings[_MAX_PHANTOM] ** 2


@njit(cache=True, error_model="numpy")
def _nothing(settings, wrench, covariance):  # type: ignore[no-untyped-def]
    """Writes what is known where nothing is read: zero, within the prior."""
    for i in range(6):
        wrench[i] = 0.0
        for j in range(6):
            covariance[i, j] = 0.0
        known = settings[_MOMENT_SD] if i < 3 else settings[_FORCE_SD]
        covariance[i, i] = known * known


@njit(cache=True, error_model="numpy")
def whiten(table, J, tau_ext, sd, work):  # type: ignore[no-untyped-def]
    """Writes A = J W^T into the first six rows of `work`, A A^T into those of the gram (lower
    triangle), and A W tau_ext into its last row; W whitens the torque noise.
    """
    n = J.shape[1]
    white_tau, gram = work[_VECTOR], work[_GRAM : _GRAM + 6]
    for j in range(n):
        total = 0.0
        for k in range(j + 1):
            total += table[j, k] * (tau_ext[k] / sd[k])
        white_tau[j] = total
    for i in range(6):
        scaled = work[_VECTOR + 1]
        for k in range(n):
            scaled[k] = J[i, k] / sd[k]
        dot = 0.0
        for j in range(n):
            total = 0.0
            for k in range(j + 1):
                total += table[j, k] * scaled[k]
            work[_WHITE + i, j] = total
            dot += total * white_tau[j]
        work[_VECTOR + 2, i] = dot
        for j in range(i + 1):
            total = 0.0
            for k in range(n):
                total += work[_WHITE + i, k] * work[_WHITE + j, k]
            gram[i, j] = total


@njit(cache=True, error_model="numpy")
def _posterior_covariance(moment_sd, force_sd, first, covariance, work):  # type: ignore[no-untyped-def]
    """Rows `first`.. of (gram + P^-1)^-1 into `covariance`, both triangles; P of these sds.

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
    for i in range(first, 6):
        scale_i = moment_sd if i < 3 else force_sd
        for j in range(i + 1):
            scale_j = moment_sd if j < 3 else force_sd
            total = 0.0
            for k in range(i, 6):
                total += R[k, i] * R[k, j]
            covariance[i, j] = scale_i * scale_j * total
            covariance[j, i] = covariance[i, j]


@njit(cache=True, error_model="numpy")
def _posterior(table, J, tau_ext, sd, stiction, wrench, covariance, work):  # type: ignore[no-untyped-def]
    """The Gaussian posterior; leaves in `work` what `valid` rests on."""
    n = J.shape[1]
    settings = table[2 * n]
    whiten(table, J, tau_ext, sd, work)
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
                total += white[j] * table[j, k]
            gain[i, k] = total / sd[k]
    _feign(gain, stiction, work)


@njit(cache=True, error_model="numpy")
def _feign(gain, stiction, work):  # type: ignore[no-untyped-def]
    """Covariance (3, 3) of the force that stiction alone gives through a gain (3, n)."""
    for i in range(3):
        for j in range(i + 1):
            total = 0.0
            for k in range(stiction.shape[0]):
                total += gain[i, k] * gain[j, k] * stiction[k] * stiction[k]
            work[_FEIGNED + i, j] = total
            work[_FEIGNED + j, i] = total


@njit(cache=True, error_model="numpy")
def _pseudo_inverse(table, J, tau_ext, sd, stiction, wrench, covariance, work):  # type: ignore[no-untyped-def]
    """The readings by singular values: inverse, damped, truncated.

    Leaves in `work` what `valid` rests on, of the plain inverse; returns whether J has full rank.
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
        noise = max(noise, table[n + j, j] * sd[j] * sd[j])
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
                    total += H[i, k] * sd[k] * table[n + k, j]
                product[i, j] = total * sd[j]
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
        if turn == 0:
            _feign(H[3:], stiction, work)
    for i in range(6):
        total = 0.0
        for j in range(n):
            total += H[i, j] * tau_ext[j]
        wrench[i] = total
    return smallest > floor


@njit(cache=True, error_model="numpy", parallel=True)
def reconstruct_log(  # type: ignore[no-untyped-def]
    table, J_now, J, tau_ext, sd, stiction, wrench, covariance, quality
):
    """`reconstruct_with` for N samples, in parallel."""
    N = J.shape[0]
    for block in prange((N + _BLOCK - 1) // _BLOCK):
        start, stop = block * _BLOCK, min(N, (block + 1) * _BLOCK)
        work = np.zeros((WORK_ROWS, max(J.shape[2], 6)))
        conditions = np.empty(stop - start)
        condition_numbers_of(J_now[start:stop], conditions)
        for k in range(start, stop):
            valid = _reading(
                table, J[k], tau_ext[k], sd[k], stiction[k], wrench[k], covariance[k], work
            )
            condition = conditions[k - start]
            quality[k, 0] = np.inf if np.isnan(condition) else condition
            quality[k, 1] = 1.0 if valid else 0.0
