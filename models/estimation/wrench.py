"""From external joint torque to the wrench at the tool, with covariance and validity.

Measured is tau_ext = J^T F + e with torque noise e of covariance Sigma_tau. The prior of F has mean
zero and covariance P, with one force sd and one moment sd for all directions, so that it holds in
any axes. Then

    Sigma_F = (J Sigma_tau^-1 J^T + P^-1)^-1,    F = Sigma_F J Sigma_tau^-1 tau_ext

The methods are special cases of it:

    inverse     P infinite and Sigma_tau a multiple of one: F = pinv(J^T) tau_ext, the article's
                (Lu et al., eq. 22), for any number of joints
    force_only  the moment sd is zero and the force sd infinite: weighted least squares for a
                point contact at E; moment and its covariance are exactly zero
    bayesian    P as configured
    damped      common elsewhere: V diag(s/(s^2 + damping^2)) U^T, J^T = U diag(s) V^T
    truncated   the same with 1/s where s > truncation max(s) and 0 elsewhere (numpy's pinv)

Sigma_tau may change from sample to sample: with sds s_j that a torque error model states
(`models.identification.torque_error_model`) and a constant correlation R it is diag(s) R diag(s).
`force_only` then weights with the geometric means of these sds and the sds over all states.
Otherwise one joint could dominate the reading although its error exceeds its stated sd, as after a
drift of its viscous friction. The covariance is that of the sample's errors, propagated. The weight
was chosen on the UR10e's three runs, each read by a model of the others. Of the exponents 1, .75,
.5, .25 and 0 on the state's sd the middle one has the least error, by 1.2 % (90 % of a block
bootstrap: .958 to 1.023 of full weights). With models of one run each it is 1.2 % where the reading
is valid (.981 to .996). `bayesian` keeps the full model.

**Valid** depends on the arm, not on the log: its prior is known before any log is read
(`live_prior`). Two conditions have to hold. The largest principal force sd is at most TRUSTED_SHARE
of that prior's force sd. The force that stiction alone can imitate is below STICTION_SHARE of it.
That force is sqrt 3 times the largest principal sd that stiction's part of the torque error gives
through the same gain; stiction is uniform within its band. A joint at rest carries any torque
within its stiction, so a force that loads only such joints cannot be distinguished from it.

The stated covariance of `inverse`, `damped` and `truncated` is the noise propagated through their
matrix. `damped` and `truncated` also shrink the true wrench towards zero; their covariance does not
contain that bias.

Every 6-vector is rotation first: F_E_W = [mx my mz fx fy fz] at E in axes of W, exerted by the
environment on the robot; J is (6, n) with rows [angular; linear] at E in axes of W.
"""

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.estimation.invalid import InvalidCodes
from wrenchsight.models.estimation.wrench_kernels import CONDITION, reasons_log
from wrenchsight.models.estimation.wrench_methods import (
    METHODS,
    WrenchConstants,
    reconstruct_log,
)
from wrenchsight.models.estimation.wrench_prior import UNKNOWN_SD, PriorSds
from wrenchsight.models.numerics.arrays import Array, Flags, contiguous
from wrenchsight.models.observers.observer import WrenchPrior

TRUSTED_SHARE = 1.0 / 3.0  # of the live prior's force sd: largest sd of a valid reading
STICTION_SHARE = 0.16  # of the same: 8 % of the rated payload's weight, 9.8 N on an arm for 12.5 kg


@dataclass
class WrenchReconstructionConfig:
    """Method, prior and validity limits of the reconstruction.

    A prior of None comes from a rule, `live_prior` or `evidence_prior` of a log; `with_prior` sets
    it.
    """

    method: str = "bayesian"
    """inverse (eq. 22), force_only, bayesian, damped or truncated"""
    prior_force_sd: float | None = None
    """N, prior sd of the force in every direction"""
    prior_moment_sd: float | None = None
    """N m about E, prior sd of the moment"""
    max_force_sd: float | None = None
    """N, largest force sd (principal) of a valid reading; left out: a third of live_force_sd"""
    max_stiction_force: float | None = None
    """N, largest force that stiction alone may look like in a valid reading; None: 16 % of
    live_force_sd, that is 8 % of the rated payload's weight"""
    live_force_sd: float | None = None
    """N, known before any log: what `valid` rests on"""
    live_moment_sd: float | None = None
    """N m; None: `valid` rests on the prior of the reading"""
    damping: float = 0.2
    """for the method damped, on J's singular values in m and rad"""
    truncation: float = 0.05
    """least singular value of the method truncated, share of the largest"""

    @property
    def states_prior(self) -> bool:
        """Whether both prior sds are stated, so that no rule is asked for them."""
        return self.prior_force_sd is not None and self.prior_moment_sd is not None

    @property
    def reads_moments(self) -> bool:
        """Whether the method reads moments; `force_only` presupposes that there are none."""
        return self.method != "force_only"

    def with_prior(self, force_sd: float, moment_sd: float) -> "WrenchReconstructionConfig":
        """Returns a copy whose missing prior sds are these (N, N m)."""
        return self._filled(prior_force_sd=force_sd, prior_moment_sd=moment_sd)

    def with_live(self, force_sd: float, moment_sd: float) -> "WrenchReconstructionConfig":
        """Returns a copy whose missing live sds, those of `valid`, are these (N, N m)."""
        return self._filled(live_force_sd=force_sd, live_moment_sd=moment_sd)

    def _filled(self, **sds: float) -> "WrenchReconstructionConfig":
        missing: dict[str, Any] = {
            name: sd for name, sd in sds.items() if getattr(self, name) is None
        }
        return replace(self, **missing) if missing else self


class WrenchEstimate(NamedTuple):
    """A reading of the wrench; one per sample with leading axes.

    For `valid` see the module. `force_only` presupposes that there is no moment. `inverse`,
    `damped` and `truncated` have no prior and need a J of full rank. Without a live prior in the
    configuration `valid` is False where the largest principal force sd of the plain weighted
    reading exceeds prior_force_sd. `bayesian` combines prior and measurement; there the same limit
    is prior_force_sd / sqrt(2). max_force_sd replaces the limit on the force's sd. Input or a
    reading that is not finite gives a wrench of zero, the prior's covariance and False.

    Attributes:
        wrench: (..., 6) F_E_W, N m and N, rotation first.
        covariance: (..., 6, 6) of it.
        condition_number: (...) of J in m and rad, as `models.rigid_body.conditioning`; inf also
            where J is not finite.
        invalid: (...) reasons why it is not valid, see `models.estimation.invalid`.
    """

    wrench: Array
    covariance: Array
    condition_number: Array
    invalid: InvalidCodes

    @property
    def valid(self) -> Flags:
        """(...) whether there is no reason against it."""
        return np.asarray(self.invalid == 0)

    @property
    def standard_deviation(self) -> Array:
        """(..., 6) N m and N, rotation first."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1)))


def observer_prior(config: WrenchReconstructionConfig) -> WrenchPrior | None:
    """The prior of the wrench in a configuration, for an observer that reads the wrench itself.

    None for methods without a prior. Without a live prior the reading's prior stands for it.
    """
    if config.method in ("damped", "truncated"):
        return None
    moment_sd = _or_infinite(config.prior_moment_sd)
    force_sd = _or_infinite(config.prior_force_sd)
    live_moment_sd = moment_sd if config.live_moment_sd is None else config.live_moment_sd
    live_force_sd = force_sd if config.live_force_sd is None else config.live_force_sd
    if config.method == "force_only":
        moment_sd, force_sd, live_moment_sd = 0.0, np.inf, 0.0
    elif config.method == "inverse":
        moment_sd, force_sd = np.inf, np.inf
    return WrenchPrior(
        float(moment_sd), float(force_sd), float(live_moment_sd), float(live_force_sd)
    )


def _or_infinite(sd: float | None) -> float:
    return np.inf if sd is None else sd


class ValidityLimits(NamedTuple):
    """Limits of a valid reading.

    Attributes:
        max_force_sd: N, largest principal force sd.
        max_stiction_force: N, largest force that stiction alone may look like.
        force_sd, moment_sd: N and N m, prior with which that sd is computed.
    """

    max_force_sd: float
    max_stiction_force: float
    force_sd: float
    moment_sd: float

    @classmethod
    def of(cls, config: WrenchReconstructionConfig) -> "ValidityLimits":
        """The limits of a configuration."""
        _check(config)
        reading_prior = _reading_prior(config)
        prior, max_force_sd = reading_prior, config.max_force_sd
        max_stiction_force = config.max_stiction_force
        if config.live_force_sd is not None and config.live_moment_sd is not None:
            prior = _known(config.live_force_sd, config.live_moment_sd)
            if max_force_sd is None:
                max_force_sd = TRUSTED_SHARE * prior.force_sd
            if max_stiction_force is None:
                max_stiction_force = STICTION_SHARE * prior.force_sd
        if max_force_sd is None:
            max_force_sd = _known(config.prior_force_sd, None).force_sd
            if config.method == "bayesian":  # prior and measurement weigh the same
                max_force_sd /= np.sqrt(2.0)
        return cls(
            max_force_sd,
            UNKNOWN_SD if max_stiction_force is None else max_stiction_force,
            prior.force_sd,
            prior.moment_sd if config.reads_moments else 0.0,
        )


class WrenchReconstruction:
    """The reconstruction for one torque covariance and one configuration.

    Where each sample has its own sds, the torque covariance is in units of these sds.

    Args:
        config: method, priors and limits.
        torque_covariance: (n, n) Sigma_tau, N^2 m^2; where each sample has its own sds, the
            correlation.
        usual_sd: (n,) or () N m, of the errors over all states, which balances the weights of
            `force_only`; None: the sample's sds alone are the weights. Other methods leave it out.

    Attributes:
        limits: of a valid reading.
        constants: of `wrench_methods.reconstruct_log`.

    Raises:
        ValueError: an unknown method, a prior that is missing or negative, damping or truncation
            that is negative, a covariance that is not symmetric positive definite, usual sds that
            are not finite and above zero.
    """

    def __init__(
        self,
        config: WrenchReconstructionConfig,
        torque_covariance: ArrayLike,
        usual_sd: ArrayLike | None = None,
    ) -> None:
        """Checks and packs the constants of all readings; arguments as the class has them."""
        Sigma = np.array(torque_covariance, float)
        if Sigma.ndim != 2 or Sigma.shape[0] != Sigma.shape[1] or not Sigma.shape[0]:
            raise ValueError(f"torque covariance must be (n, n), not {Sigma.shape}")
        n = Sigma.shape[0]
        self.num_joints = n
        self.config = config
        self.torque_covariance = Sigma
        usual = None
        if usual_sd is not None:
            usual = np.broadcast_to(np.asarray(usual_sd, float), (n,)).copy()
            if not (np.isfinite(usual).all() and (usual > 0.0).all()):
                raise ValueError("usual_sd: expected finite numbers above zero")
        self.limits = ValidityLimits.of(config)  # which refuses a configuration that cannot be
        self.constants = WrenchConstants(
            method=config.method,
            whitening=np.ascontiguousarray(whitening_matrix(Sigma)),  # refuses another Sigma
            torque_covariance=Sigma,
            prior_sd=_by_axis(_reading_prior(config)),
            live_prior_sd=_by_axis(PriorSds(self.limits.force_sd, self.limits.moment_sd)),
            damping=config.damping,
            truncation=config.truncation,
            usual_sd=usual,
        )

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
            J: as tau_ext saw it, see `wrenchsight.models.observers.lag`.
            tau_ext: external joint torque.
            sd: as tau_ext; N m, of its errors; None: 1, so that the torque covariance is theirs.
            stiction: as tau_ext; N m, the part of sd that is stiction; None: 0.
            J_now: as J, of the sample itself, for the condition number. Without rows the condition
                numbers are NaN; they take a quarter of the time. None: J.

        Returns:
            The reading, with the leading axes of tau_ext.

        Raises:
            ValueError: shapes that disagree.
        """
        n = self.num_joints
        J_seen, tau = np.asarray(J, float), np.asarray(tau_ext, float)
        lead = tau.shape[:-1]
        if tau.shape[-1:] != (n,) or J_seen.shape != (*lead, 6, n):
            raise ValueError(
                f"J must be (..., 6, {n}) and tau_ext (..., {n}), not {J_seen.shape} and "
                f"{tau.shape}"
            )
        J_present = J_seen if J_now is None else np.asarray(J_now, float)
        error_sd = np.ones_like(tau) if sd is None else np.asarray(sd, float)
        stiction_sd = np.zeros_like(tau) if stiction is None else np.asarray(stiction, float)
        if not (
            J_present.shape in (J_seen.shape, (0, 6, n))
            and error_sd.shape == stiction_sd.shape == tau.shape
        ):
            raise ValueError("J_now must be as J, sd and stiction as tau_ext")
        # The kernels take rows alone, contiguous ones: N, but of J_now maybe none.
        N = int(np.prod(lead))
        J_present_rows, J_seen_rows = contiguous(
            J_present.reshape(-1, 6, n), J_seen.reshape(N, 6, n)
        )
        tau_rows, sd_rows, stiction_rows = contiguous(
            tau.reshape(N, n), error_sd.reshape(N, n), stiction_sd.reshape(N, n)
        )
        out = reconstruct_log(
            self.constants, J_present_rows, J_seen_rows, tau_rows, sd_rows, stiction_rows
        )
        invalid = np.empty(N, np.int64)
        limits = self.limits
        reasons_log(limits.max_force_sd, limits.max_stiction_force, out.quality, invalid)
        return WrenchEstimate(
            wrench=out.wrench.reshape(*lead, 6),
            covariance=out.covariance.reshape(*lead, 6, 6),
            condition_number=out.quality[:, CONDITION].reshape(lead),
            invalid=invalid.reshape(lead),
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
    """Returns W (n, n), lower triangular, with W Sigma W^T = 1.

    Raises:
        ValueError: Sigma is not finite, symmetric and positive definite.
    """
    if not np.all(np.isfinite(Sigma)) or not np.allclose(Sigma, Sigma.T, rtol=1e-9, atol=0.0):
        raise ValueError("torque covariance must be finite and symmetric")
    try:
        return np.asarray(np.linalg.inv(np.linalg.cholesky(Sigma)))
    except np.linalg.LinAlgError:
        raise ValueError(
            "torque covariance must be positive definite: every joint needs a torque sd above zero"
        ) from None


def _check(config: WrenchReconstructionConfig) -> None:
    """Checks a configuration.

    Raises:
        ValueError: an unknown method; a number below zero or NaN, damping or truncation that is
            infinite; method bayesian without a prior.
    """
    if config.method not in METHODS:
        raise ValueError(f"method must be one of {', '.join(METHODS)}, not {config.method!r}")
    limits_and_priors = (
        "prior_force_sd",
        "prior_moment_sd",
        "max_force_sd",
        "max_stiction_force",
        "live_force_sd",
        "live_moment_sd",
    )
    for name in limits_and_priors:
        value = getattr(config, name)
        if value is not None and not value >= 0.0:
            raise ValueError(f"{name} must be zero or more, not {value}")
    for name in ("damping", "truncation"):
        value = getattr(config, name)
        if not 0.0 <= value < np.inf:
            raise ValueError(f"{name} must be zero or more and finite, not {value}")
    if config.method == "bayesian" and None in (config.prior_force_sd, config.prior_moment_sd):
        raise ValueError("method bayesian needs prior_force_sd and prior_moment_sd")


def _reading_prior(config: WrenchReconstructionConfig) -> PriorSds:
    """The prior of a method's reading; see the module."""
    if config.method == "force_only":
        return PriorSds(UNKNOWN_SD, 0.0)
    return _known(config.prior_force_sd, config.prior_moment_sd)


def _known(force_sd: float | None, moment_sd: float | None) -> PriorSds:
    """Sds of a prior; an unknown one is UNKNOWN_SD."""
    return PriorSds(
        *(UNKNOWN_SD if sd is None else min(sd, UNKNOWN_SD) for sd in (force_sd, moment_sd))
    )


def _by_axis(prior: PriorSds) -> Array:
    """(6,) sds of a prior, rotation first."""
    return np.repeat([prior.moment_sd, prior.force_sd], 3).astype(float)
