"""Contact and misfit along a log or tick by tick: `contact_statistic` for one estimator.

The detector sets the levels and runs the kernels. The rule when a contact begins and when it ends
is `contact_decision`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrenchsight.models.detection.contact_decision import MAX_RELEASE_SHARE, RELEASE_SHARE
from wrenchsight.models.detection.contact_statistic import (
    CHANGE,
    CHANGE_LEVEL,
    CONTACT,
    FITTED_LOAD,
    FITTED_SPEED,
    JUMP_POLE,
    JUMP_SHARE,
    LINK,
    MEAN_LEVEL,
    MEAN_RELEASE,
    MEAN_SCALE,
    MEAN_TIME,
    MISFIT,
    MISFIT_LEVEL,
    MOMENT_SD,
    NUM_JOINT_ROWS,
    NUM_OUT,
    NUM_SETTINGS,
    NUM_UNKNOWN,
    OUT_OF_RANGE,
    PERIOD,
    POWER_LEVEL,
    PRESENT,
    REST,
    SAMPLE_LEVEL,
    SAMPLE_RELEASE,
    SCALE,
    STATISTIC,
    UNKNOWN_MOMENT,
    USUAL_JUMP,
    ArmSamples,
    DetectorTables,
    TorqueWhite,
    detect_log,
    state_rows,
)
from wrenchsight.models.estimation.estimator import EstimateBatch, WrenchEstimator
from wrenchsight.models.estimation.torque_error_stage import TorqueError, TorqueErrorStage
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.friction.friction_law import FrictionLaw
from wrenchsight.models.friction.sliding_friction import SlidingLaw
from wrenchsight.models.identification.contact_noise import ContactNoise
from wrenchsight.models.identification.torque_error_model import (
    ConstantTorqueError,
)
from wrenchsight.models.numerics.arrays import Array, Flags, contiguous
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.signals.exceedance_tail import ExceedanceTail, gaussian_tail

LEAST_RATE, LARGEST_RATE = 1e-3, 1e3  # false alarms an hour
OTHER_DAYS = 1.15  # times the level of the mean: see `contact_statistic`
MISFIT_RATE = 36.0  # an hour, of contact: one in a hundred contacts at E that last a second


@dataclass
class ContactDetectionConfig:
    """When a reading counts as contact."""

    false_alarms_per_hour: float = 1.0
    """How often contact may be reported where nothing touches the arm."""


class Detection(NamedTuple):
    """Contact, misfit and link right after each of N samples; see `contact_statistic`.

    Attributes:
        statistic: (N,) in units of the level above which contact begins; 0 where the model states
            no torque error.
        contact: (N,).
        misfit: (N,) a contact that no force at E explains.
        link: (N,) the link, 1 to n, whose contact explains a misfit; 0: none, or unknown.
        rest: (N,) no joint has moved for REST_TIME; a column of the wrench table.
        out_of_range: (N,) a joint is faster or more loaded than in the fitted motion.
    """

    statistic: Array
    contact: Flags
    misfit: Flags
    link: NDArray[np.int8]
    rest: Flags
    out_of_range: Flags

    def without(self, unknown: Flags) -> "Detection":
        """Returns a copy without contact at the samples of `unknown` (N,)."""
        contact, misfit = self.contact & ~unknown, self.misfit & ~unknown
        link = np.where(unknown, 0, self.link).astype(np.int8)
        return self._replace(contact=contact, misfit=misfit, link=link)

    def rows(self, rows: slice | Flags) -> "Detection":
        """Returns the detection of some samples."""
        return Detection._make(column[rows] for column in self)

    @staticmethod
    def joined(parts: "Sequence[Detection]") -> "Detection":
        """Returns the parts, one after another, as one."""
        if len(parts) == 1:
            return parts[0]
        columns: Any = zip(*parts, strict=True)
        return Detection._make(np.concatenate(column) for column in columns)

    @classmethod
    def of(cls, out: Array) -> "Detection":
        """Returns the detection of a kernel's output (N, NUM_OUT or more)."""
        return cls(
            statistic=out[:, STATISTIC].copy(),
            contact=out[:, CONTACT] == 1.0,
            misfit=out[:, MISFIT] == 1.0,
            link=out[:, LINK].astype(np.int8),
            rest=out[:, REST] == 1.0,
            out_of_range=out[:, OUT_OF_RANGE] == 1.0,
        )


class DetectionLevels(NamedTuple):
    """Levels of the norms of `contact_statistic`, in units of the torque error's sd."""

    sample: float
    mean: float
    power: float
    change: float


class ContactDetector:
    """Detector of contact and misfit in the estimates of one estimator.

    A model without a torque error detects no contact; rest and range alone are reported. A model
    without `contact_noise` counts as Gaussian.

    Args:
        stage: torque error of the estimator.
        noise: distribution of the model's whitened torque.
        chain: with the model's inertias.
        reconstruction: its method and moment prior define a contact at E.
        time_step: s.
        config: the stated rate.
        reads_present_torque: whether a sample's tau_ext depends on the motor torque of that sample;
            otherwise on that of the samples before alone. A jump of torque counts accordingly.

    Raises:
        ValueError: a rate beyond LEAST_RATE to LARGEST_RATE.
    """

    def __init__(
        self,
        stage: TorqueErrorStage,
        noise: ContactNoise | None,
        chain: SerialChain,
        reconstruction: WrenchReconstructionConfig,
        time_step: float,
        config: ContactDetectionConfig | None = None,
        reads_present_torque: bool = False,
    ) -> None:
        """Computes the levels from the stated rate of false alarms; arguments as the class has
        them.

        `settings` and `_tables` are what the kernels read; the state is the caller's.

        Raises:
            ValueError: a rate of false alarms out of range.
        """
        config = config if config is not None else ContactDetectionConfig()
        rate = config.false_alarms_per_hour
        if not LEAST_RATE <= rate <= LARGEST_RATE:
            raise ValueError(
                f"false_alarms_per_hour must be {LEAST_RATE:g} to {LARGEST_RATE:g}, not {rate}"
            )
        self.config, self.stage, self.chain, self.time_step = config, stage, chain, time_step
        self._noise, self._reconstruction = noise, reconstruction
        self.reads_present_torque = reads_present_torque
        self.knows_error = not isinstance(stage.error, ConstantTorqueError)
        self.num_joints = stage.error.num_joints
        # s, of each joint: behind an observer of gain K_0 no error is quicker than 1 / K_0.
        observer_gain = stage.rates
        correlation_time = np.maximum(stage.error.correlation_time, 1.0 / observer_gain)
        self.settings = _settings(
            stage,
            noise,
            shortest_correlation_time=float(correlation_time.min()),
            moment_sd=_moment_sd(reconstruction),
            false_alarms_per_hour=rate,
            time_step=time_step,
            reads_present_torque=reads_present_torque,
        )
        self._tables = DetectorTables(
            error=stage.table,
            joints=_joint_rows(stage, noise, correlation_time, time_step),
            settings=self.settings,
            # U of y = U z: makes the joints' correlated errors independent, each of sd 1.
            white=upper_whitening(stage.error.correlation),
        )

    @classmethod
    def of(
        cls, estimator: WrenchEstimator, config: ContactDetectionConfig | None = None
    ) -> "ContactDetector":
        """Returns the detector that goes with an estimator."""
        return cls(
            stage=estimator.error,
            noise=estimator.model.contact_noise,
            chain=estimator.chain,
            reconstruction=estimator.config.reconstruction,
            time_step=estimator.observer.time_step,
            config=config,
            reads_present_torque=estimator.observer.reads_present_torque,
        )

    def retuned(
        self, friction: FrictionLaw | SlidingLaw, K_0: ArrayLike | None
    ) -> "ContactDetector":
        """Returns the detector with friction and an observer that were changed while they run."""
        return ContactDetector(
            stage=self.stage.retuned(friction, K_0),
            noise=self._noise,
            chain=self.chain,
            reconstruction=self._reconstruction,
            time_step=self.time_step,
            config=self.config,
            reads_present_torque=self.reads_present_torque,
        )

    @property
    def levels(self) -> DetectionLevels:
        """Levels of the norms; infinite where a norm is not in use."""
        return DetectionLevels(
            sample=self.settings.item(SAMPLE_LEVEL),
            mean=self.settings.item(MEAN_LEVEL),
            power=self.settings.item(POWER_LEVEL),
            change=self.settings.item(CHANGE_LEVEL),
        )

    def initial_state(self) -> Array:
        """Returns the (rows, n) state before the first sample."""
        state = np.zeros((state_rows(self.num_joints), self.num_joints))
        state[:NUM_UNKNOWN] = np.nan
        return state

    def run(self, state: Array, batch: EstimateBatch) -> Detection:
        """Detects contact at the N samples of a batch.

        Args:
            state: of `initial_state`, changed.
            batch: of the estimator, with all its fields.
        """
        samples = ArmSamples(
            error=batch.torque_error,
            v=batch.v,
            transmitted=batch.transmitted,
            momentum=batch.momentum,
            tau_ext=batch.tau_ext,
            fresh=batch.fresh,
        )
        return Detection.of(self.judge(state, samples))

    def judge(self, state: Array, samples: ArmSamples) -> Array:
        """Returns the output (N, NUM_OUT) of `detect_tick` at N samples; `state` is changed."""
        no_rows = np.empty((0, self.num_joints))
        white = TorqueWhite(no_rows, no_rows, no_rows, np.empty(0))
        return self._log(self._tables, state, samples, white)

    def whiten(self, state: Array, samples: ArmSamples) -> tuple[TorqueWhite, Array]:
        """Returns the whitened torque of N samples, and the output of `judge` without contact.

        The levels are infinite, so that no contact begins; `state` is changed.
        """
        settings = self.settings.copy()
        settings[[SAMPLE_LEVEL, MEAN_LEVEL, POWER_LEVEL, CHANGE_LEVEL]] = np.inf
        z, mean, change = np.empty((3, *samples.v.shape))
        white = TorqueWhite(z, mean, change, np.empty(len(samples.v)))
        return white, self._log(self._tables._replace(settings=settings), state, samples, white)

    def _log(
        self, tables: DetectorTables, state: Array, samples: ArmSamples, white: TorqueWhite
    ) -> Array:
        """Runs `detect_log` on contiguous copies of N samples; returns its (N, NUM_OUT) output."""
        out = np.empty((len(samples.v), NUM_OUT))
        error, fresh = TorqueError(*contiguous(*samples.error)), np.asarray(samples.fresh, bool)
        v, transmitted, momentum, tau_ext = contiguous(
            samples.v, samples.transmitted, samples.momentum, samples.tau_ext
        )
        contiguous_samples = ArmSamples(error, v, transmitted, momentum, tau_ext, fresh)
        detect_log(tables, state, contiguous_samples, out, white)
        return out


def upper_whitening(R: Array) -> Array:
    """U (n, n), upper triangular, with U R U^T = 1."""
    flipped = np.linalg.cholesky(R[::-1, ::-1])
    return np.ascontiguousarray(np.linalg.inv(flipped)[::-1, ::-1])


def _joint_rows(
    stage: TorqueErrorStage, noise: ContactNoise | None, correlation_time: Array, time_step: float
) -> Array:
    """(NUM_JOINT_ROWS, n): the table `joints` of `detect_tick`.

    Rows: pole of the torque jump, speed and load up to which the model was fitted (inf: any), usual
    torque jump, scale of the mean, and from CHANGE on the coefficients of a change's variance.

    Args:
        stage: torque error of the estimator; its `rates` (n,) 1/s are the observer's gains K_0.
        noise: of the model's whitened torque; None: Gaussian, and jumps and changes do not count.
        correlation_time: (n,) s, of the errors behind the observer.
        time_step: s.
    """
    error, observer_gain = stage.error, stage.rates
    joints = np.empty((NUM_JOINT_ROWS, error.num_joints))
    joints[JUMP_POLE] = np.exp(-observer_gain * time_step)
    # A model that does not state how fast or loaded its logs were has zeros there.
    for row, fitted in ((FITTED_SPEED, error.fitted_speed), (FITTED_LOAD, error.fitted_load)):
        joints[row] = np.where(fitted > 0.0, fitted, np.inf)
    joints[CHANGE:] = 0.0
    if noise is None:
        joints[USUAL_JUMP] = np.inf
        # Sd of an exponentially correlated error of sd 1 behind a low-pass of MEAN_TIME.
        joints[MEAN_SCALE] = np.sqrt(correlation_time / (correlation_time + MEAN_TIME))
        return joints
    # White noise of speed acts as a torque jump that shrinks with the root of the period.
    jump_factor = np.sqrt(max(noise.time_step / time_step, 1.0))
    joints[USUAL_JUMP] = jump_factor * np.asarray(noise.usual_jolt)
    joints[MEAN_SCALE] = noise.mean_scale
    if noise.change_sd:
        # In the fit's readings a change was as quick as their observer let it be, T = 1 / K_0. This
        # gain K passes the share K T / (1 + K T) of its variance, that of the fit passed 1 / 2.
        change_factor = 2.0 * observer_gain / (observer_gain + error.K_0)
        joints[CHANGE:] = change_factor * np.transpose(noise.change_sd) ** 2
        # The share of the torque jump's square, which white noise has made larger.
        joints[JUMP_SHARE] /= jump_factor**2
    return joints


def _settings(
    stage: TorqueErrorStage,
    noise: ContactNoise | None,
    *,
    shortest_correlation_time: float,
    moment_sd: float,
    false_alarms_per_hour: float,
    time_step: float,
    reads_present_torque: bool,
) -> Array:
    """(NUM_SETTINGS,): the levels and constants of `detect_tick`.

    A level is what a norm exceeds at the stated rate of false alarms, by the tail that the noise
    has; one that a log of another day may reach is OTHER_DAYS times as high.

    A model that states no torque error has infinite levels: it detects no contact.

    Args:
        stage: torque error of the estimator.
        noise: of the model's whitened torque; None: Gaussian.
        shortest_correlation_time: s, of the errors behind the observer.
        moment_sd: N m, prior of the moment of a contact at E.
        false_alarms_per_hour: stated rate; each of the two norms that begin a contact has half.
        time_step: s.
        reads_present_torque: as of the detector.
    """
    error, half_rate = stage.error, 0.5 * false_alarms_per_hour
    misfit_rate = max(false_alarms_per_hour, MISFIT_RATE)
    tails = _tails(noise, error.num_joints, shortest_correlation_time)
    settings = np.empty(NUM_SETTINGS)
    settings[PERIOD] = time_step
    settings[MOMENT_SD] = moment_sd
    settings[SCALE] = error.scale
    settings[PRESENT] = float(reads_present_torque)
    settings[[SAMPLE_LEVEL, MEAN_LEVEL, POWER_LEVEL, CHANGE_LEVEL]] = np.inf
    knows_error = not isinstance(error, ConstantTorqueError)
    if knows_error:
        settings[SAMPLE_LEVEL] = tails.sample.level_at(half_rate)
        settings[MEAN_LEVEL] = tails.mean.level_at(half_rate)
        settings[POWER_LEVEL] = tails.power.level_at(misfit_rate)
        if noise is not None and noise.change is not None and noise.change_sd:
            # Its tail is that of the square |U c|^2, the others' of the norms themselves.
            settings[CHANGE_LEVEL] = np.sqrt(noise.change.level_at(half_rate))
    settings[MISFIT_LEVEL] = settings[POWER_LEVEL]  # of a model without its own: D <= |y|^2
    if noise is not None and noise.misfit is not None and knows_error:
        settings[MISFIT_LEVEL] = OTHER_DAYS * noise.misfit.level_at(misfit_rate)
    # Before OTHER_DAYS widens level and release of the mean: the tail that bounds the release is
    # that of the fit's days.
    settings[SAMPLE_RELEASE] = _release_level(settings[SAMPLE_LEVEL], tails.sample)
    settings[MEAN_RELEASE] = _release_level(settings[MEAN_LEVEL], tails.mean)
    if noise is not None:
        settings[[MEAN_LEVEL, MEAN_RELEASE]] *= OTHER_DAYS
    return settings


class _Tails(NamedTuple):
    """Tails of the norms without contact, see `contact_statistic`."""

    sample: ExceedanceTail
    mean: ExceedanceTail
    power: ExceedanceTail


def _tails(noise: ContactNoise | None, num_joints: int, correlation_time: float) -> _Tails:
    """The model's tails; Gaussian ones in place of those that were not learnt."""
    quick = gaussian_tail(num_joints, correlation_time)
    slow = gaussian_tail(num_joints, correlation_time + MEAN_TIME)
    if noise is None:
        return _Tails(quick, slow, quick)
    return _Tails(noise.sample or quick, noise.mean or slow, noise.power or quick)


def _release_level(level: float, tail: ExceedanceTail) -> float:
    """The level below which contact ends: RELEASE_SHARE of `level`, or what noise often reaches."""
    often_reached = min(tail.level, MAX_RELEASE_SHARE * level)
    return max(RELEASE_SHARE * level, often_reached)


def _moment_sd(reconstruction: WrenchReconstructionConfig) -> float:
    """N m, prior sd of the moment of a contact at E."""
    if reconstruction.method == "force_only":
        return 0.0
    if reconstruction.method == "bayesian" and reconstruction.prior_moment_sd is not None:
        return min(reconstruction.prior_moment_sd, UNKNOWN_MOMENT)
    return UNKNOWN_MOMENT


class Reader(Protocol):
    """Reader of successive samples: a `ContactEstimator` or a `TrackedEstimator`."""

    def run(self, q: Array, v: Array, current: Array) -> tuple[EstimateBatch, Detection]:
        """Takes the next samples, (N, n) each: rad, rad/s and A."""
        ...

    def restart(self) -> None:
        """Starts anew: the next sample does not follow the last one."""
        ...


class ContactEstimator:
    """An estimator of one arm with its contact detector.

    It takes samples or chunks, from one thread; the result is the same.

    Args:
        estimator: of the samples.
        detection: configuration of the detector.
    """

    def __init__(
        self, estimator: WrenchEstimator, detection: ContactDetectionConfig | None = None
    ) -> None:
        self._estimator = estimator
        self._detector = ContactDetector.of(estimator, detection)
        self.restart()

    def restart(self) -> None:
        """Starts anew: the next sample does not follow the last one."""
        self._state = self._estimator.initial_state()
        self._detector_state = self._detector.initial_state()

    def run(self, q: Array, v: Array, current: Array) -> tuple[EstimateBatch, Detection]:
        """Takes the next samples, (N, n) each: rad, rad/s and A."""
        batch = self._estimator.run(self._state, q, v, current)
        return batch, self._detector.run(self._detector_state, batch)
