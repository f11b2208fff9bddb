"""The estimator with friction tracked while, by the detector, nothing touches the arm.

    q, v -> correction (`wrenchsight.models.calibration.friction_tracking`) -+
    q, v, current -> estimator ----------------------------------------------+-> wrench -> contact
                 ^-- learns, where nothing touches the arm ------------------------------------+

tau_ext is corrected before the wrench is read. The variance V of the correction replaces the
model's allowance for drift and enters the covariance through the reading's gain. The model's torque
error was learnt from held-out logs of other days. Its sd contains a drift of up to twice that sd
already, so V^2 / (V + 4 sd^2) is added.

A zeroed payload (`wrenchsight.models.calibration.payload_zero`) is subtracted before the wrench is
read and contact is detected. Its uncertainty is in the wrench's covariance.
"""

from dataclasses import replace

import numpy as np

from wrenchsight.models.calibration.friction_tracking import FrictionTracker
from wrenchsight.models.calibration.payload_zero import PayloadZero, ZeroedPayload
from wrenchsight.models.detection.contact_detector import (
    ContactDetectionConfig,
    ContactDetector,
    Detection,
)
from wrenchsight.models.estimation.estimator import (
    Correction,
    EstimateBatch,
    WrenchEstimator,
    WrenchEstimatorConfig,
)
from wrenchsight.models.estimation.reading_gain import ReadingGain
from wrenchsight.models.estimation.wrench_prior import live_prior
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array, contiguous
from wrenchsight.models.robot.robot import Robot

CONTAINED_DRIFT = 2.0  # sds of the model's error, up to which it contains friction's drift


class TrackedEstimator:
    """An estimator of one arm that tracks its friction and detects contact.

    It takes samples or chunks, from one thread; the result is the same.

    Args:
        robot: the arm.
        model: with a torque error.
        config: configuration of the estimator, its time step filled in; method bayesian, force_only
            or inverse, and an observer that does not read the wrench itself.
        detection: settings of contact detection.
        follows_friction: whether friction is tracked. Without it the model's allowance for drift
            stays in the band; a payload can still be zeroed.

    Attributes:
        estimator: reads the corrected samples.
        tracker: tracker of friction, with `freeze`, `resume` and `reset`.
        zero: the payload that is subtracted, or None; `start_zero` and `finish_zero` determine it.

    Raises:
        ValueError: a model, method or observer that cannot be tracked.
    """

    def __init__(
        self,
        robot: Robot,
        model: IdentifiedModel,
        config: WrenchEstimatorConfig,
        detection: ContactDetectionConfig | None = None,
        follows_friction: bool = True,
    ) -> None:
        """Makes an estimator that tracks, and one that does not; arguments as the class has them.

        The one that tracks states no allowance for drift in its error, since drift is what is
        tracked. The plain one's torque is what the tracker learns from, and its error that of the
        detector, whose levels were learnt with the model's allowance for drift.

        Raises:
            ValueError: the model states no torque error.
        """
        if model.torque_error is None:
            raise ValueError("the model states no torque error: its friction cannot be tracked")
        self._tracks = follows_friction
        estimator_model = model
        if follows_friction:
            estimator_model = replace(model, torque_error=model.torque_error.with_drift(0.0))
        self.estimator = WrenchEstimator(robot, estimator_model, config)
        self._gain = ReadingGain(self.estimator)  # by which torque's errors enter the wrench
        self._plain = WrenchEstimator(robot, model, config)
        self._detector = ContactDetector.of(self._plain, detection)
        force_sd, _ = live_prior(robot.payload)
        self.tracker = FrictionTracker(
            model,
            pole=self.estimator.observer.pole,
            time_step=self.estimator.observer.time_step,
            force_sd=force_sd,
            resolution=self.estimator.resolution,
        )
        self.zero: ZeroedPayload | None = None
        self._zeroing: PayloadZero | None = None  # between `start_zero` and `finish_zero`
        self.restart()

    def restart(self) -> None:
        """Starts anew: the next sample does not follow the last one. The learnt friction stays."""
        self._state = self.estimator.initial_state()
        self._plain_state = self._plain.initial_state()
        self._detector_state = self._detector.initial_state()
        self.tracker.restart()
        observer = self.estimator.observer
        self._settling = round(observer.settling_time / observer.time_step)  # samples left

    def start_zero(self) -> None:
        """Starts zeroing: from now on the external torque is the payload's weight.

        The arm has to hold some postures; nothing else may touch it.
        """
        estimator = self._plain
        robot, error = estimator.robot, estimator.model.torque_error
        assert error is not None
        self.zero = None
        self._zeroing = PayloadZero(
            robot.payload,
            np.asarray(robot.gravity),
            estimator.observer.time_step,
            error.correlation_time,
        )

    def finish_zero(self) -> ZeroedPayload:
        """Ends zeroing: the payload estimated since `start_zero` is subtracted in all postures.

        Raises:
            ValueError: it was not started.
        """
        if self._zeroing is None:
            raise ValueError("zeroing was not started")
        self.zero, self._zeroing = self._zeroing.result(), None
        return self.zero

    def run(self, q: Array, v: Array, current: Array) -> tuple[EstimateBatch, Detection]:
        """Takes the next samples.

        Args:
            q, v: (N, n) rad and rad/s, at the observer's time step.
            current: (N, n) A.

        Returns:
            The estimates, tau_ext corrected, and contact.
        """
        q, v, current = contiguous(q, v, current)
        plain = self._plain.run(self._plain_state, q, v, current, conditions=False)
        return self.follow(q, v, current, plain)

    def follow(
        self, q: Array, v: Array, current: Array, plain: EstimateBatch
    ) -> tuple[EstimateBatch, Detection]:
        """As `run`, for samples that another estimator of model and configuration has taken.

        The samples are taken in parts, up to each step of the friction tracker: with what it has
        learnt by then the torque of a part is corrected, contact is detected in the corrected
        torque, and the part without contact teaches the tracker. The correction is friction's drift
        less the weight of a payload that was zeroed. All samples then go through the estimator that
        tracks, at once.

        Args:
            q, v, current: (N, n) rad, rad/s, A.
            plain: its estimates of the same samples, without tracking.

        Returns:
            The corrected estimates, with the variance of both corrections, and the detection.
        """
        is_missing = np.asarray(np.isnan(plain.J).any(axis=(1, 2)))
        # From the sample on at which the observer has settled.
        is_read = plain.fresh & ~is_missing & (self._settling <= np.arange(len(q)))
        self._settling -= len(q)
        correction, friction_variance = np.empty_like(q), np.empty_like(q)
        # Torque of the zeroed payload's weight, and per each of its four parameters. Zeros stand
        # for missing numbers: such a sample is neither learnt from nor valid.
        weight, columns = np.zeros_like(q), np.zeros((*q.shape, 4))
        J_seen, R_WE = np.nan_to_num(plain.J_seen), self._plain.chain.pose(np.nan_to_num(q))[0]
        if self.zero is not None:
            weight, columns = self.zero.torque(J_seen, R_WE)
        detections: list[Detection] = []
        begin = 0
        while begin < len(q):
            part = slice(begin, min(len(q), begin + self.tracker.until_step))
            begin = part.stop
            plain_part = plain.rows(part)
            friction, friction_variance[part] = self._friction_correction(q[part], v[part])
            correction[part] = friction - weight[part]
            corrected = plain_part._replace(tau_ext=plain_part.tau_ext + correction[part])
            detection = self._detector.run(self._detector_state, corrected)
            detections.append(detection)
            if self._tracks:  # from torque without the weight, but with friction's drift
                is_contact_free = is_read[part] & ~detection.contact
                self.tracker.learn(
                    plain_part.tau_ext - weight[part], plain_part.J_seen, is_contact_free
                )
            if self._zeroing is not None:  # then no weight is subtracted
                self._zeroing.add(
                    q[part],
                    v[part],
                    J=J_seen[part],
                    R_WE=R_WE[part],
                    tau_ext=corrected.tau_ext,
                    sd=plain_part.torque_sd,
                    is_valid=is_read[part],
                )
        # At the measured speeds, and counting in every sample.
        learnt = Correction(tau_correction=correction, v_planned=v, counts=np.ones(len(q)))
        batch = self.estimator.run(self._state, q, v, current, correction=learnt)
        return self._widened(batch, friction_variance, columns), Detection.joined(detections)

    def _friction_correction(self, q: Array, v: Array) -> tuple[Array, Array]:
        """What is added to tau_ext for friction's drift (N, n), N m, and its variance."""
        if self._tracks:
            return self.tracker.correction(q, v)
        return np.zeros_like(q), np.zeros_like(q)

    def _widened(self, batch: EstimateBatch, variance: Array, columns: Array) -> EstimateBatch:
        """Adds the uncertainty of the correction and of the zeroed payload.

        Of the correction's variance only the part beyond the model's error is added. `columns`
        (N, n, 4) are those of the payload's torque.
        """
        sd = batch.torque_sd
        added = variance**2 / (variance + (CONTAINED_DRIFT * sd) ** 2)
        gain = self._gain.of(batch)
        added_covariance = (gain * added[:, None, :]) @ gain.transpose(0, 2, 1)
        if self.zero is not None:
            response = gain @ columns
            added_covariance += response @ self.zero.covariance @ response.transpose(0, 2, 1)
        widened = self._gain.widened(batch, added_covariance)
        return widened._replace(torque_sd=np.sqrt(sd**2 + added))
