"""The wrench along a log, each sample read with what comes before and after it: no lag.

The model is that of `models.observers.kalman_observer`, but the slow part of the torque error is a
state, too: z = [p, F, x, beta], and of each sample its distribution given the whole log is read,
forward by a Kalman filter and backward by the adjoint of it (modified Bryson-Frazier, Bierman 1973,
which asks for no inverse of a covariance):

    lambda, Lambda <- A^T lambda, A^T Lambda A                            over a period
    lambda <- (1 - K H)^T lambda - H^T S^-1 e                             over a measurement
    Lambda <- (1 - K H)^T Lambda (1 - K H) + H^T S^-1 H
    z_smoothed = z - P lambda,    P_smoothed = P - P Lambda P             z, P before it

beta, the friction's drift, is what a log of some length tells apart from a force: by how it
follows speed. It is thought to last DRIFT_TIME.

An error in proportion to what is read lasts as long as that: torques per ampere that are off, and
friction that grows with the load, against each joint's motion. No log tells such an error from
another force. So it is not estimated, but counts in the covariance (a "considered" parameter;
Schmidt, "Application of state-space methods to navigation problems", 1966): of each joint j by
itself, with the torque tau = J^T F that is read of it,

    Sigma_F += sum_j a_j a_j^T + b_j b_j^T    a_j, b_j: what the smoother makes of scale tau_j and
                                              of beyond_load |tau_j| against the motion
    Sigma_F += scale^2 F F^T                  of all joints alike

A force that begins or ends is no walk: where the log makes it likely, F changes at once
(`wrenchsight.models.observers.force_changes`).

A forward-backward first-order filter has no lag either, but no sd of its own: what the filter makes
of the torque's error depends on how that is spread over frequencies, which the model above says.

A log streams: a sample is read when LOOK_AHEAD after it has been seen, or the log's end. What comes
later says nothing of it any more, but for its share in beta.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.estimation.estimator import EstimateBatch, WrenchEstimator
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.observers.force_changes import IntervalSmoother, ProportionalError
from wrenchsight.models.observers.kalman_observer import KalmanObserver, KalmanObserverConfig
from wrenchsight.models.observers.observer import NUM_SIGNALS

DRIFT_TIME = 600.0  # s
LOOK_AHEAD, MOST_AHEAD = 10.0, 16384  # s, samples: what bounds the memory
PASS = 8192  # samples that are read backward at a time, beside those ahead


class _Kept(NamedTuple):
    """N samples that are not read yet: (N, NUM_SIGNALS, n), and their causal reading."""

    signals: Array
    batch: EstimateBatch


class WrenchSmoother:
    """Smooths a log that comes in parts.

        smoother = WrenchSmoother(estimator)
        for q, v, current in parts:
            ready = smoother.take(q, v, current)      # of samples before; may be none
        rest = smoother.finish()

    together are the log's samples, one by one. Of what a batch holds, wrench, covariance and
    tau_ext = J^T F are smoothed; valid is the estimator's own, as it says what can be read at all.

    Args:
        estimator: whose model, prior and samples these are; any observer. Its bandwidth, or the
            default, is the smoother's.

    Raises:
        ValueError: the estimator's method has no prior.
    """

    def __init__(self, estimator: WrenchEstimator) -> None:
        self._estimator = estimator
        own = estimator.config.observer
        bandwidth_hz = getattr(own, "bandwidth_hz", KalmanObserverConfig().bandwidth_hz)
        n, step = estimator.num_joints, estimator.observer.time_step
        samples = "trapezoidal" if estimator.observer.reads_present_torque else "held"
        config = KalmanObserverConfig(bandwidth_hz, step, samples)
        self._ahead = min(int(np.ceil(LOOK_AHEAD / step)), MOST_AHEAD)
        self._state = estimator.initial_state()
        error = estimator.model.torque_error
        self._scale = 0.0 if error is None else error.scale
        table = KalmanObserver(config, n).informed(estimator.knowledge).table
        proportional = None if error is None else ProportionalError(error.scale, error.beyond_load)
        kept = float(np.exp(-step / DRIFT_TIME))
        self._smoother = IntervalSmoother(table, n, kept, proportional)
        self._kept: list[_Kept] = []

    def take(self, q: ArrayLike, v: ArrayLike, current: ArrayLike) -> EstimateBatch:
        """Takes (N, n) samples, as `WrenchEstimator.run`; returns the samples that are read."""
        q, v, current = (np.asarray(x, float) for x in (q, v, current))
        ready = []
        for start in range(0, len(q), PASS):
            part = slice(start, start + PASS)
            signals = np.empty((len(q[part]), NUM_SIGNALS, self._estimator.num_joints))
            batch = self._estimator.run(self._state, q[part], v[part], current[part], seen=signals)
            self._kept.append(_Kept(signals, batch))
            if sum(len(own.signals) for own in self._kept) >= PASS + self._ahead:
                ready.append(self._read(self._ahead))
        return EstimateBatch.joined(ready) if ready else self._nothing()

    def finish(self) -> EstimateBatch:
        """Returns the samples that are left."""
        return self._read(0) if self._kept else self._nothing()

    def _nothing(self) -> EstimateBatch:
        empty = np.zeros((0, self._estimator.num_joints))
        return self._estimator.run(self._estimator.initial_state(), empty, empty, empty)

    def _read(self, ahead: int) -> EstimateBatch:
        """Reads all that is kept but the last `ahead` samples, and lets go of it."""
        signals = np.concatenate([own.signals for own in self._kept])
        batch = EstimateBatch.joined([own.batch for own in self._kept])
        ready = len(signals) - ahead
        wrench, covariance = self._smoother.read(signals, batch.J, ready)
        if self._scale:
            covariance += self._scale**2 * wrench[:, :, None] * wrench[:, None, :]
        left = slice(ready, None)
        self._kept = [_Kept(signals[left].copy(), batch.rows(left))] if ahead else []
        causal = batch.rows(slice(0, ready))
        tau_ext = np.einsum("kai,ka->ki", causal.J, wrench)
        finite = np.isfinite(tau_ext).all(axis=1)
        return causal._replace(
            tau_ext=np.where(finite[:, None], tau_ext, 0.0), wrench=wrench, covariance=covariance
        )


def smoothed_estimate(
    estimator: WrenchEstimator, q: ArrayLike, v: ArrayLike, current: ArrayLike
) -> EstimateBatch:
    """Reads a whole log, each sample with all others; arguments as `WrenchEstimator.run`.

    Raises:
        ValueError: shapes that disagree; a method without a prior.
    """
    smoother = WrenchSmoother(estimator)
    return EstimateBatch.joined([smoother.take(q, v, current), smoother.finish()])
