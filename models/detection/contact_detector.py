"""Contact and misfit along a log or tick by tick: `contact_statistic` for one estimator."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrenchsight.models.detection.contact_statistic import (
    CHANGE,
    CHANGE_LEVEL,
    CONTACT,
    FITTED_LOAD,
    FITTED_SPEED,
    JOLT_POLE,
    LARGEST_RELEASE,
    LINK,
    MEAN_LEVEL,
    MEAN_RELEASE,
    MEAN_SCALE,
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
    RELEASE,
    REST,
    SAMPLE_LEVEL,
    SAMPLE_RELEASE,
    SCALE,
    STATISTIC,
    UNKNOWN_MOMENT,
    USUAL_JOLT,
    WINDOW,
    ArmSamples,
    TorqueWhite,
    detect_log,
    state_rows,
)
from wrenchsight.models.estimation.estimator import EstimateBatch, WrenchEstimator
from wrenchsight.models.estimation.torque_error_stage import TorqueError, TorqueErrorStage
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.friction.friction_law import FrictionLaw
from wrenchsight.models.identification.contact_noise import ContactNoise
from wrenchsight.models.identification.torque_error_model import (
    NUM_FEATURES,
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
    """What the readings right after each of N samples say; see `contact_statistic`.

    Attributes:
        statistic: (N,) in units of the level above which contact begins; 0 where the model states
            no torque error.
        contact: (N,).
        misfit: (N,) a contact that no force at E explains.
        link: (N,) the link, 1 to n, whose contact explains a misfit; 0 where there is none or the
            joints cannot tell.
        rest: (N,) no joint has moved for REST_TIME.
        out_of_range: (N,) a joint faster or more loaded than the motion the model was fitted on.
    """

    statistic: Array
    contact: Flags
    misfit: Flags
    link: NDArray[np.int8]
    rest: Flags
    out_of_range: Flags

    def without(self, unknown: Flags) -> "Detection":
        """The same, without contact where a sample (N,) may not be used."""
        contact, misfit = self.contact & ~unknown, self.misfit & ~unknown
        link = np.where(unknown, 0, self.link).astype(np.int8)
        return self._replace(contact=contact, misfit=misfit, link=link)

    def rows(self, rows: slice | Flags) -> "Detection":
        """Of some of the samples."""
        columns: Any = (column[rows] for column in self)
        return Detection(*columns)

    @staticmethod
    def joined(parts: "Sequence[Detection]") -> "Detection":
        """One after another."""
        if len(parts) == 1:
            return parts[0]
        columns: Any = zip(*parts, strict=True)
        return Detection(*(np.concatenate(column) for column in columns))

    @classmethod
    def of(cls, out: Array) -> "Detection":
        """From what the kernel wrote, (N, NUM_OUT) or more columns than are read."""
        return cls(
            statistic=out[:, STATISTIC].copy(),
            contact=out[:, CONTACT] == 1.0,
            misfit=out[:, MISFIT] == 1.0,
            link=out[:, LINK].astype(np.int8),
            rest=out[:, REST] == 1.0,
            out_of_range=out[:, OUT_OF_RANGE] == 1.0,
        )


class ContactDetector:
    """Contact and misfit of what one estimator reads.

    With a model without a torque error no contact is found: only rest and range are reported. One
    without `contact_noise` is taken as Gaussian.

    Args:
        stage: of the estimator, whose torque error it is.
        noise: of the model: how its whitened torque is distributed.
        chain: with the model's inertias.
        reconstruction: whose method and moment prior say what a contact at E is.
        time_step: s.
        config: the stated rate.
        reads_present_torque: whether the observer's reading rests on the same sample's torque.

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
        config = config if config is not None else ContactDetectionConfig()
        rate = config.false_alarms_per_hour
        if not LEAST_RATE <= rate <= LARGEST_RATE:
            raise ValueError(
                f"false_alarms_per_hour must be {LEAST_RATE:g} to {LARGEST_RATE:g}, not {rate}"
            )
        self.config = config
        self.stage, self._noise, self._reconstruction = stage, noise, reconstruction
        self.chain = chain
        self.time_step = time_step
        self.reads_present_torque = reads_present_torque
        error, rates = stage.error, stage.rates
        self.knows_error = not isinstance(error, ConstantTorqueError)
        self.num_joints = n = error.num_joints
        joints = np.empty((NUM_JOINT_ROWS, n))
        joints[JOLT_POLE] = np.exp(-rates * time_step)
        for row, fitted in ((FITTED_SPEED, error.fitted_speed), (FITTED_LOAD, error.fitted_load)):
            joints[row] = np.where(fitted > 0.0, fitted, np.inf)
        correlation_time = np.maximum(error.correlation_time, 1.0 / rates)
        if noise is None:
            joints[USUAL_JOLT] = np.inf
            # Of an exponentially correlated error through a low-pass.
            joints[MEAN_SCALE] = np.sqrt(correlation_time / (correlation_time + WINDOW))
            joints[CHANGE:] = 0.0
        else:
            # White noise of speed reads as a jolt that shrinks with the root of the period.
            finer = np.sqrt(max(noise.time_step / time_step, 1.0))
            joints[USUAL_JOLT] = finer * np.asarray(noise.usual_jolt)
            joints[MEAN_SCALE] = noise.mean_scale
            joints[CHANGE:] = 0.0
            if noise.change_sd:
                # A change is as quick as the observer lets it be: of correlation time 1 / K_0.
                quicker = 2.0 * rates / (rates + error.K_0)
                joints[CHANGE:] = quicker * np.transpose(noise.change_sd) ** 2
                joints[CHANGE + NUM_FEATURES] /= finer**2
        settings = np.empty(NUM_SETTINGS)
        settings[PERIOD] = time_step
        settings[MOMENT_SD] = _moment_sd(reconstruction)
        settings[SCALE] = error.scale
        settings[PRESENT] = float(reads_present_torque)
        levels = SAMPLE_LEVEL, MEAN_LEVEL, POWER_LEVEL
        tails = _tails(noise, n, float(correlation_time.min()))
        change = noise.change if noise is not None and noise.change_sd else None
        rates_per_hour = 0.5 * rate, 0.5 * rate, max(rate, MISFIT_RATE)
        for level, tail, own_rate in zip(levels, tails, rates_per_hour, strict=True):
            settings[level] = tail.level_at(own_rate) if self.knows_error else np.inf
        settings[MISFIT_LEVEL] = settings[POWER_LEVEL]
        if noise is not None and noise.misfit is not None and self.knows_error:
            settings[MISFIT_LEVEL] = OTHER_DAYS * noise.misfit.level_at(max(rate, MISFIT_RATE))
        settings[CHANGE_LEVEL] = np.inf
        if change is not None and self.knows_error:
            settings[CHANGE_LEVEL] = np.sqrt(change.level_at(0.5 * rate))
        for release, level, tail in zip(
            (SAMPLE_RELEASE, MEAN_RELEASE), levels, tails, strict=False
        ):
            often = min(tail.level, LARGEST_RELEASE * settings[level])
            settings[release] = max(RELEASE * settings[level], often)
        if noise is not None:
            settings[[MEAN_LEVEL, MEAN_RELEASE]] *= OTHER_DAYS
        self.settings = settings
        self._tables = stage.table, joints, upper_whitening(error.correlation)

    @classmethod
    def of(
        cls, estimator: WrenchEstimator, config: ContactDetectionConfig | None = None
    ) -> "ContactDetector":
        """Returns the detector that goes with an estimator."""
        return cls(
            estimator.error,
            estimator.model.contact_noise,
            estimator.chain,
            estimator.config.reconstruction,
            estimator.observer.time_step,
            config,
            estimator.observer.reads_present_torque,
        )

    def retuned(self, friction: FrictionLaw, K_0: ArrayLike | None) -> "ContactDetector":
        """Returns the detector with friction and an observer that were changed while they run."""
        stage = self.stage.retuned(friction, K_0)
        noise, chain, config = self._noise, self.chain, self.config
        reads = self.reads_present_torque
        return ContactDetector(
            stage, noise, chain, self._reconstruction, self.time_step, config, reads
        )

    @property
    def levels(self) -> tuple[float, float, float, float]:
        """Of the lengths `sample`, `mean`, `power` and `change`; infinite: not looked at."""
        of = [SAMPLE_LEVEL, MEAN_LEVEL, POWER_LEVEL, CHANGE_LEVEL]
        sample, mean, power, change = self.settings[of].tolist()
        return sample, mean, power, change

    def initial_state(self) -> Array:
        """Returns the (rows, n) state before the first sample."""
        state = np.zeros((state_rows(self.num_joints), self.num_joints))
        state[:NUM_UNKNOWN] = np.nan
        return state

    def run(self, state: Array, batch: EstimateBatch) -> Detection:
        """Takes what the estimator read of N samples; `state` of `initial_state` is changed."""
        samples = ArmSamples(
            batch.torque_error,
            batch.v,
            batch.transmitted,
            batch.momentum,
            batch.tau_ext,
            batch.fresh,
        )
        return Detection.of(self.judge(state, samples))

    def judge(self, state: Array, samples: ArmSamples) -> Array:
        """(N, NUM_OUT) as `detect_tick` writes it."""
        nothing = np.empty((0, self.num_joints))
        white = TorqueWhite(nothing, nothing, nothing, np.empty(0))
        return self._log(self.settings, state, samples, white)

    def whiten(self, state: Array, samples: ArmSamples) -> tuple[TorqueWhite, Array]:
        """What `detect_log` leaves for what learns, and `judge` where no level is ever reached."""
        settings = self.settings.copy()
        settings[[SAMPLE_LEVEL, MEAN_LEVEL, POWER_LEVEL, CHANGE_LEVEL]] = np.inf
        z, mean, change = np.empty((3, *samples.v.shape))
        white = TorqueWhite(z, mean, change, np.empty(len(samples.v)))
        return white, self._log(settings, state, samples, white)

    def _log(self, settings: Array, state: Array, samples: ArmSamples, white: TorqueWhite) -> Array:
        out = np.empty((len(samples.v), NUM_OUT))
        table, joints, upper = self._tables
        error, fresh = TorqueError(*contiguous(*samples.error)), np.asarray(samples.fresh, bool)
        v, transmitted, momentum, tau_ext = contiguous(
            samples.v, samples.transmitted, samples.momentum, samples.tau_ext
        )
        own = ArmSamples(error, v, transmitted, momentum, tau_ext, fresh)
        detect_log((table, joints, settings, upper), state, own, out, white)
        return out


def upper_whitening(R: Array) -> Array:
    """U (n, n), upper triangular, with U R U^T = 1."""
    flipped = np.linalg.cholesky(R[::-1, ::-1])
    return np.ascontiguousarray(np.linalg.inv(flipped)[::-1, ::-1])


def _tails(
    noise: ContactNoise | None, num_joints: int, correlation_time: float
) -> tuple[ExceedanceTail, ExceedanceTail, ExceedanceTail]:
    """Of sample, mean and power; Gaussian where nothing was learnt."""
    quick = gaussian_tail(num_joints, correlation_time)
    slow = gaussian_tail(num_joints, correlation_time + WINDOW)
    if noise is None:
        return quick, slow, quick
    return noise.sample or quick, noise.mean or slow, noise.power or quick


def _moment_sd(reconstruction: WrenchReconstructionConfig) -> float:
    """N m of a contact at E, beforehand."""
    if reconstruction.method == "force_only":
        return 0.0
    if reconstruction.method == "bayesian" and reconstruction.prior_moment_sd is not None:
        return min(reconstruction.prior_moment_sd, UNKNOWN_MOMENT)
    return UNKNOWN_MOMENT


class Reader(Protocol):
    """What reads successive samples: `ContactEstimator`, or a `TrackedEstimator`."""

    def run(self, q: Array, v: Array, current: Array) -> tuple[EstimateBatch, Detection]:
        """Takes the next samples, (N, n) each: rad, rad/s and A."""
        ...

    def restart(self) -> None:
        """The next sample does not follow the last one."""
        ...


class ContactEstimator:
    """Reads one arm, sample by sample or chunk by chunk, from one thread; the result is the same.

    Args:
        estimator: that reads.
        detection: when a reading is contact.
    """

    def __init__(
        self, estimator: WrenchEstimator, detection: ContactDetectionConfig | None = None
    ) -> None:
        self._estimator = estimator
        self._detector = ContactDetector.of(estimator, detection)
        self.restart()

    def restart(self) -> None:
        """As the protocol."""
        self._state = self._estimator.initial_state()
        self._detector_state = self._detector.initial_state()

    def run(self, q: Array, v: Array, current: Array) -> tuple[EstimateBatch, Detection]:
        """As the protocol."""
        batch = self._estimator.run(self._state, q, v, current)
        return batch, self._detector.run(self._detector_state, batch)
