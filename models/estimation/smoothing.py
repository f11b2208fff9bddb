"""The wrench along a log, smoothed: each sample estimated from the whole log.

The model is that of `models.observers.kalman_observer`, with the slow part of the torque error as a
further state: z = [p, F, x, beta]. A Kalman filter runs forward and its adjoint backward (modified
Bryson-Frazier, Bierman 1973, which needs no inverse of a covariance). They give the distribution of
each sample given the whole log:

    lambda, Lambda <- A^T lambda, A^T Lambda A                            over a period
    lambda <- (1 - K H)^T lambda - H^T S^-1 e                             over a measurement
    Lambda <- (1 - K H)^T Lambda (1 - K H) + H^T S^-1 H
    z_smoothed = z - P lambda,    P_smoothed = P - P Lambda P             z, P before it

beta is the friction's drift. It follows speed, which distinguishes it from a force in a log of some
length. Its correlation time is DRIFT_TIME.

An error in proportion to the torque lasts as long: torques per ampere that are off, and friction
that grows with the load, against each joint's motion. No log distinguishes such an error from
another force. It is not estimated, but enters the covariance (a "considered" parameter; Schmidt,
"Application of state-space methods to navigation problems", 1966). For each joint j, with its
torque tau = J^T F,

    Sigma_F += sum_j a_j a_j^T + b_j b_j^T    a_j, b_j: the smoother's response to scale tau_j and
                                              to beyond_load |tau_j| against the motion
    Sigma_F += scale^2 F F^T                  common to all joints

A force that begins or ends is no random walk: where the log makes it likely, F jumps
(`wrenchsight.models.observers.force_changes`). A force that changes fast and often is neither. The
covariance holds what smoothing leaves out of it (`wrenchsight.models.estimation.smoothing_error`),
up to the stated bandwidth; beyond it no reading is valid.

A forward-backward first-order filter has no lag either, but states no sd: its error depends on the
spectrum of the torque's error, which the model above describes.

A log streams: a sample is smoothed once LOOK_AHEAD of later samples, or the log's end, has arrived.
Samples beyond that hardly change it, but for their share in beta.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.estimation.estimator import EstimateBatch, WrenchEstimator
from wrenchsight.models.estimation.invalid import LAGGING
from wrenchsight.models.estimation.smoothing_error import MissingForce
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.observers.force_changes import IntervalSmoother, ProportionalError
from wrenchsight.models.observers.kalman_observer import KalmanObserver, KalmanObserverConfig
from wrenchsight.models.observers.observer import NUM_SIGNALS

DRIFT_TIME = 600.0  # s
LOOK_AHEAD, MOST_AHEAD = 10.0, 16384  # s, samples; the latter bounds the memory
PASS_SAMPLES = 8192  # samples smoothed at a time, beside the later ones


class _PendingSamples(NamedTuple):
    """N samples that are not smoothed yet.

    Attributes:
        signals: (N, NUM_SIGNALS, n), rows as in `wrenchsight.models.observers.observer`.
        batch: their causal estimates.
    """

    signals: Array
    batch: EstimateBatch


class WrenchSmoother:
    """Smoother of a log that comes in parts.

        smoother = WrenchSmoother(estimator)
        for q, v, current in parts:
            estimates = smoother.take(q, v, current)      # of earlier samples; may be none
        last_estimates = smoother.finish()

    Together these are the estimates of all samples, in order. In a batch wrench, covariance and
    tau_ext = J^T F are smoothed. `invalid` is the estimator's.

    Args:
        estimator: its model, prior and samples are smoothed. The observer may be any; its
            bandwidth, or the default, is the smoother's.

    Raises:
        ValueError: the estimator's method has no prior.
    """

    def __init__(self, estimator: WrenchEstimator) -> None:
        self._estimator = estimator
        observer_config = estimator.config.observer
        bandwidth_hz = getattr(observer_config, "bandwidth_hz", KalmanObserverConfig().bandwidth_hz)
        n, step = estimator.num_joints, estimator.observer.time_step
        samples = "trapezoidal" if estimator.observer.reads_present_torque else "held"
        config = KalmanObserverConfig(bandwidth_hz, step, samples)
        self._look_ahead = min(int(np.ceil(LOOK_AHEAD / step)), MOST_AHEAD)
        self._state = estimator.initial_state()
        error = estimator.model.torque_error
        self._scale = 0.0 if error is None else error.scale
        table = KalmanObserver(config, n).informed(estimator.knowledge).table
        proportional = None if error is None else ProportionalError(error.scale, error.beyond_load)
        drift_pole = float(np.exp(-step / DRIFT_TIME))
        self._smoother = IntervalSmoother(table, n, drift_pole, proportional)
        self._pending: list[_PendingSamples] = []
        pole = estimator.observer.pole
        self._missing_force: MissingForce | None = None
        if pole is not None and error is not None:
            bandwidth = estimator.config.force_bandwidth_hz
            self._missing_force = MissingForce(float(np.min(pole)), step, bandwidth)

    def take(self, q: ArrayLike, v: ArrayLike, current: ArrayLike) -> EstimateBatch:
        """Takes (N, n) samples, as `WrenchEstimator.run`; returns the smoothed estimates."""
        q, v, current = np.asarray(q, float), np.asarray(v, float), np.asarray(current, float)
        smoothed = []
        for start in range(0, len(q), PASS_SAMPLES):
            part = slice(start, start + PASS_SAMPLES)
            signals = np.empty((len(q[part]), NUM_SIGNALS, self._estimator.num_joints))
            batch = self._estimator.run(
                self._state, q[part], v[part], current[part], signals=signals
            )
            self._pending.append(_PendingSamples(signals, batch))
            if (
                sum(len(samples.signals) for samples in self._pending)
                >= PASS_SAMPLES + self._look_ahead
            ):
                smoothed.append(self._smooth(self._look_ahead))
        return EstimateBatch.joined(smoothed) if smoothed else self._empty_batch()

    def finish(self) -> EstimateBatch:
        """Returns the smoothed estimates of the last samples."""
        return self._smooth(0) if self._pending else self._empty_batch()

    def _empty_batch(self) -> EstimateBatch:
        empty = np.zeros((0, self._estimator.num_joints))
        return self._estimator.run(self._estimator.initial_state(), empty, empty, empty)

    def _smooth(self, num_pending: int) -> EstimateBatch:
        """Smooths all pending samples but the last `num_pending`, which stay pending.

        These count for the others, too. Of the causal reading all stays but tau_ext, wrench and
        covariance; the latter gains the error of the scale and what smoothing misses of a force
        (`_missing_force`), as far as the log has shown it. A reading that only lags counts there:
        the force that it is late for is what is missing.
        """
        signals = np.concatenate([samples.signals for samples in self._pending])
        batch = EstimateBatch.joined([samples.batch for samples in self._pending])
        num_smoothed = len(signals) - num_pending
        causal = batch.rows(slice(0, num_smoothed))
        # By all signals, of which the first are the smoothed samples'.
        wrench, covariance = self._smoother.read(signals, batch.J, num_smoothed)
        if self._scale:
            covariance += self._scale**2 * wrench[:, :, None] * wrench[:, None, :]
        if self._missing_force is not None:
            covariance += self._missing_force.covariance(
                causal.wrench,
                wrench,
                np.diagonal(covariance, axis1=1, axis2=2),
                np.asarray((causal.invalid & ~LAGGING) == 0),
            )
        later = slice(num_smoothed, None)
        self._pending = []
        if num_pending:
            self._pending = [_PendingSamples(signals[later].copy(), batch.rows(later))]
        tau_ext = np.einsum("kai,ka->ki", causal.J, wrench)
        finite = np.isfinite(tau_ext).all(axis=1)  # J of a missing sample is not
        return causal._replace(
            tau_ext=np.where(finite[:, None], tau_ext, 0.0), wrench=wrench, covariance=covariance
        )


def smoothed_estimate(
    estimator: WrenchEstimator, q: ArrayLike, v: ArrayLike, current: ArrayLike
) -> EstimateBatch:
    """Smooths a whole log; arguments as `WrenchEstimator.run`.

    Raises:
        ValueError: shapes that disagree; a method without a prior.
    """
    smoother = WrenchSmoother(estimator)
    return EstimateBatch.joined([smoother.take(q, v, current), smoother.finish()])
