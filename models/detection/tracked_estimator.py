"""The estimator with friction that is followed while the arm moves, gated by the contact detector.

    q, v -> correction (`wrenchsight.models.calibration.friction_tracking`) -+
    q, v, current -> estimator ----------------------------------------------+-> wrench -> contact
                 ^-- learns, where nothing touches the arm ------------------------------------+

tau_ext is corrected before the wrench is read. The model's allowance for drift is replaced by the
variance V of the correction, passed on through the reading's own gain. The model's torque error
was learnt from logs held out, whose friction was another day's: its sd holds such a drift already
as far as it is less than twice that sd, so V^2 / (V + 4 sd^2) is added.

A payload that was zeroed (`wrenchsight.models.calibration.payload_zero`) is taken off before the
wrench is read and contact is looked for, and what is unknown of it is in the wrench's covariance.
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
    EstimateBatch,
    Taught,
    WrenchEstimator,
    WrenchEstimatorConfig,
)
from wrenchsight.models.estimation.reading_gain import ReadingGain
from wrenchsight.models.estimation.wrench import live_prior
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array, contiguous
from wrenchsight.models.robot.robot import Robot

HELD = 2.0  # sds of the model's own error, up to which it holds what friction drifts by


class TrackedEstimator:
    """Reads one arm, sample by sample or chunk by chunk, from one thread; the result is the same.

    Args:
        robot: the arm.
        model: with a torque error.
        config: of the estimator, its time step filled in; method bayesian, force_only or inverse,
            and an observer that does not read the wrench itself.
        detection: of contact.
        follows_friction: whether friction is followed at all; without, the model's own allowance
            for drift stays in the band, and a payload can be zeroed.

    Attributes:
        estimator: that reads what is corrected.
        tracker: with `freeze`, `resume`, `reset` and what has been learnt.
        zero: the payload that is taken off; None: none. `start_zero` and `finish_zero` find it.

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
        if model.torque_error is None:
            raise ValueError("the model states no torque error: its friction cannot be tracked")
        self._follows = follows_friction
        without = model
        if follows_friction:
            without = replace(model, torque_error=model.torque_error.with_drift(0.0))
        self.estimator = own = WrenchEstimator(robot, without, config)
        self._gain = ReadingGain(own)
        force_sd, _ = live_prior(robot.payload)
        # The levels of contact were learnt with the model's own allowance for drift.
        self._plain = WrenchEstimator(robot, model, config)
        self._detector = ContactDetector.of(self._plain, detection)
        self.tracker = FrictionTracker(
            model, own.observer.pole, own.observer.time_step, force_sd, own.resolution
        )
        self.zero: ZeroedPayload | None = None
        self._zeroing: PayloadZero | None = None
        self.restart()

    def restart(self) -> None:
        """The next sample does not follow the last one; what has been learnt stays."""
        self._state, self._plain_state = (
            self.estimator.initial_state(),
            self._plain.initial_state(),
        )
        self._detector_state = self._detector.initial_state()
        self.tracker.restart()
        observer = self.estimator.observer
        self._settling = round(observer.settling_time / observer.time_step)

    def start_zero(self) -> None:
        """From now on what is read is a payload's weight: hold postures, nothing else touching."""
        robot, own, error = self._plain.robot, self._plain, self._plain.model.torque_error
        assert error is not None
        self.zero = None
        self._zeroing = PayloadZero(
            robot.payload,
            np.asarray(robot.gravity),
            own.observer.time_step,
            error.correlation_time,
        )

    def finish_zero(self) -> ZeroedPayload:
        """Takes off what has been told since `start_zero`, in this and all other postures.

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
            What is read, tau_ext corrected, and contact.
        """
        q, v, current = contiguous(q, v, current)
        plain = self._plain.run(self._plain_state, q, v, current, conditions=False)
        return self.follow(q, v, current, plain)

    def follow(
        self, q: Array, v: Array, current: Array, plain: EstimateBatch
    ) -> tuple[EstimateBatch, Detection]:
        """As `run`, of samples that an estimator of the same model and configuration has read.

        Args:
            q, v, current: (N, n) as `run`.
            plain: what it read, without tracking.
        """
        missing = np.asarray(np.isnan(plain.J).any(axis=(1, 2)))
        read = plain.fresh & ~missing & (self._settling <= np.arange(len(q)))
        self._settling -= len(q)
        correction, variance = np.empty_like(q), np.empty_like(q)
        weight, columns = np.zeros_like(q), np.zeros((*q.shape, 4))
        J_seen, R_WE = np.nan_to_num(plain.J_seen), self._plain.chain.pose(np.nan_to_num(q))[0]
        if self.zero is not None:
            weight, columns = self.zero.torque(J_seen, R_WE)
        parts: list[Detection] = []
        begin = 0
        while begin < len(q):
            rows = slice(begin, min(len(q), begin + self.tracker.until_step))
            begin = rows.stop
            own = plain.rows(rows)
            correction[rows], variance[rows] = self._correction(q[rows], v[rows])
            correction[rows] -= weight[rows]
            better = own._replace(tau_ext=own.tau_ext + correction[rows])
            found = self._detector.run(self._detector_state, better)
            parts.append(found)
            free = read[rows] & ~found.contact
            if self._follows:
                self.tracker.learn(own.tau_ext - weight[rows], own.J_seen, free)
            if self._zeroing is not None:
                self._zeroing.add(
                    q[rows],
                    v[rows],
                    J_seen[rows],
                    R_WE[rows],
                    better.tau_ext,
                    own.torque_sd,
                    read[rows],
                )
        taught = Taught(correction, v, np.ones(len(q)))
        batch = self.estimator.run(self._state, q, v, current, taught=taught)
        return self._widened(batch, variance, columns), Detection.joined(parts)

    def _correction(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Of friction, and its variance."""
        if self._follows:
            return self.tracker.correction(q, v)
        return np.zeros_like(q), np.zeros_like(q)

    def _widened(self, batch: EstimateBatch, variance: Array, columns: Array) -> EstimateBatch:
        """The batch with the part of the correction's variance that its model does not hold, and
        what is unknown of the payload whose `columns` (N, n, 4) were taken off.
        """
        sd = batch.torque_sd
        added = variance**2 / (variance + (HELD * sd) ** 2)
        gain = self._gain.of(batch)
        more = (gain * added[:, None, :]) @ gain.transpose(0, 2, 1)
        if self.zero is not None:
            response = gain @ columns
            more += response @ self.zero.covariance @ response.transpose(0, 2, 1)
        wider = self._gain.widened(batch, more)
        return wider._replace(torque_sd=np.sqrt(sd**2 + added))
