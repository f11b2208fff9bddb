"""The estimator with friction that is followed while the arm moves, gated by the contact detector.

    q, v -> correction (`wrenchsight.models.calibration.friction_tracking`) -+
    q, v, current -> estimator ----------------------------------------------+-> wrench -> contact
                 ^-- learns, where nothing touches the arm ------------------------------------+

tau_ext is corrected before the wrench is read. The model's allowance for drift is replaced by the
variance V of the correction, passed on through the reading's own gain. The model's torque error
was learnt from logs held out, whose friction was another day's: of V it holds what is less than
its own variance already, so V^2 / (V + sd^2) is added.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from wrenchsight.models.arrays import Array
from wrenchsight.models.calibration.friction_tracking import FrictionTracker, FrictionTrackingConfig
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
from wrenchsight.models.estimation.wrench import TRUSTED_SHARE, known_of_wrench, live_prior
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.robot.robot import Robot

_LEAST, _LARGEST = 1e-9, 1e9  # N or N m, for a prior of zero and an infinite one


class TrackedEstimator:
    """Reads one arm, sample by sample or chunk by chunk, from one thread; the result is the same.

    Args:
        robot: the arm.
        model: with a torque error.
        config: of the estimator, its time step filled in; method bayesian, force_only or inverse,
            and an observer that does not read the wrench itself.
        detection: of contact.
        tracking: of friction.

    Attributes:
        tracker: with `freeze`, `resume`, `reset` and what has been learnt.

    Raises:
        ValueError: a model, method or observer that cannot be tracked.
    """

    def __init__(
        self,
        robot: Robot,
        model: IdentifiedModel,
        config: WrenchEstimatorConfig,
        detection: ContactDetectionConfig | None = None,
        tracking: FrictionTrackingConfig | None = None,
    ) -> None:
        if model.torque_error is None:
            raise ValueError("the model states no torque error: its friction cannot be tracked")
        without = replace(model, torque_error=model.torque_error.with_drift(0.0))
        self._estimator = own = WrenchEstimator(robot, without, config)
        if own.observer.kernels.wrench is not None:
            raise ValueError("the observer reads the wrench itself: friction cannot be tracked")
        known = known_of_wrench(own.config.reconstruction)
        if known is None:
            method = own.config.reconstruction.method
            raise ValueError(f"friction is not tracked under the method {method}")
        sds = np.repeat([known.moment_sd, known.force_sd], 3)
        self._precision = np.clip(sds, _LEAST, _LARGEST) ** -2.0
        self._correlation = np.linalg.inv(model.torque_error.correlation)
        balanced = own.config.reconstruction.method == "force_only"
        self._usual_sd = np.sqrt(np.diag(model.residual_covariance)) if balanced else None
        force_sd, _ = live_prior(robot.payload)
        limit = own.config.reconstruction.max_force_sd
        self._max_force_sd = TRUSTED_SHARE * force_sd if limit is None else limit
        self._state = own.initial_state()
        # The levels of contact were learnt with the model's own allowance for drift.
        self._plain = WrenchEstimator(robot, model, config)
        self._plain_state = self._plain.initial_state()
        self._detector = ContactDetector.of(self._plain, detection)
        self._detector_state = self._detector.initial_state()
        self.tracker = FrictionTracker(
            *(model, own.observer.pole, own.observer.time_step, force_sd),
            own.resolution,
            tracking,
        )
        self._settling = round(own.observer.settling_time / own.observer.time_step)

    def run(self, q: Array, v: Array, current: Array) -> tuple[EstimateBatch, Detection]:
        """Takes the next samples.

        Args:
            q, v: (N, n) rad and rad/s, at the observer's time step.
            current: (N, n) A.

        Returns:
            What is read, tau_ext corrected, and contact.
        """
        q, v, current = (np.require(x, float, ("C", "W")) for x in (q, v, current))
        plain = self._plain.run(self._plain_state, q, v, current, conditions=False)
        missing = np.asarray(np.isnan(plain.J).any(axis=(1, 2)))
        read = plain.fresh & ~missing & (self._settling <= np.arange(len(q)))
        self._settling -= len(q)
        q_read, v_read = (np.where(missing[:, None], np.nan, x) for x in (q, v))
        correction, variance = np.empty_like(q), np.empty_like(q)
        parts: list[Detection] = []
        begin = 0
        while begin < len(q):
            rows = slice(begin, min(len(q), begin + self.tracker.until_step))
            begin = rows.stop
            kept: Any = (x[rows] if len(x) else x for x in plain)
            own = EstimateBatch(*kept)
            correction[rows], variance[rows] = self.tracker.correction(q[rows], v[rows])
            better = own._replace(tau_ext=own.tau_ext + correction[rows])
            found = self._detector.run(self._detector_state, q_read[rows], v_read[rows], better)
            parts.append(found)
            self.tracker.learn(own.tau_ext, own.J_seen, read[rows] & ~found.contact)
        taught = Taught(correction, v, np.ones(len(q)))
        batch = self._estimator.run(self._state, q, v, current, taught=taught)
        columns: Any = zip(*parts, strict=True)
        return self._widened(batch, variance), Detection(*(np.concatenate(x) for x in columns))

    def _widened(self, batch: EstimateBatch, variance: Array) -> EstimateBatch:
        """The batch with the part of the correction's variance that its model does not hold."""
        sd, J = batch.torque_sd, np.nan_to_num(batch.J_seen)
        added = variance**2 / (variance + sd**2)
        weights = sd if self._usual_sd is None else np.sqrt(sd * self._usual_sd)
        JW = (J / weights[:, None, :]) @ self._correlation / weights[:, None, :]
        information = JW @ J.transpose(0, 2, 1) + np.diag(self._precision)
        gain = np.linalg.solve(information, JW)
        more = (gain * added[:, None, :]) @ gain.transpose(0, 2, 1)
        worst = np.linalg.eigvalsh(more[:, 3:, 3:])[:, -1]
        return batch._replace(
            covariance=batch.covariance + more,
            torque_sd=np.sqrt(sd**2 + added),
            valid=batch.valid & (worst <= self._max_force_sd**2),
        )
