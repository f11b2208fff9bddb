"""The gain of the reading at each sample: wrench = gain tau_ext.

Of `wrenchsight.models.estimation.wrench`, with the torque error's sds s and correlation R of the
sample and J as the observer saw it:

    gain = (J W J^T + P^-1)^-1 J W,    W = (diag(s) R diag(s))^-1

`force_only` weights with the geometric means of s and the sds over all states. A correction of
tau_ext changes the wrench by gain times it. A further covariance V of the torque adds
gain V gain^T to that of the wrench.
"""

import numpy as np

from wrenchsight.models.estimation.estimator import EstimateBatch, WrenchEstimator
from wrenchsight.models.estimation.invalid import FRICTION_DRIFT
from wrenchsight.models.estimation.wrench import TRUSTED_SHARE, observer_prior
from wrenchsight.models.estimation.wrench_prior import live_prior
from wrenchsight.models.numerics.arrays import Array

_MIN_SD, _MAX_SD = 1e-9, 1e9  # N or N m, sds in place of zero and infinity


class ReadingGain:
    """The gain of one estimator, whose model has a torque error.

    Args:
        estimator: method bayesian, force_only or inverse, and an observer that does not read the
            wrench itself.

    Raises:
        ValueError: another method, observer or model.
    """

    def __init__(self, estimator: WrenchEstimator) -> None:
        reconstruction, model = estimator.config.reconstruction, estimator.model
        if model.torque_error is None:
            raise ValueError("the model states no torque error")
        if estimator.observer.reads_wrench:
            raise ValueError("the observer reads the wrench itself")
        prior = observer_prior(reconstruction)
        if prior is None:
            raise ValueError(f"the method {reconstruction.method} has no prior")
        sds = np.repeat([prior.moment_sd, prior.force_sd], 3)
        self._precision = np.diag(np.clip(sds, _MIN_SD, _MAX_SD) ** -2.0)
        self._correlation = np.linalg.inv(model.torque_error.correlation)
        balanced = reconstruction.method == "force_only"
        self._usual_sd = np.sqrt(np.diag(model.residual_covariance)) if balanced else None
        limit = reconstruction.max_force_sd
        force_sd, _ = live_prior(estimator.robot.payload)
        self._max_force_sd = TRUSTED_SHARE * force_sd if limit is None else limit

    def of(self, batch: EstimateBatch) -> Array:
        """Returns the gain (N, 6, n) of N samples; zero where J is missing."""
        sd, J = batch.torque_sd, np.nan_to_num(batch.J_seen)
        weights = sd if self._usual_sd is None else np.sqrt(sd * self._usual_sd)
        JW = (J / weights[:, None, :]) @ self._correlation / weights[:, None, :]
        return np.asarray(np.linalg.solve(JW @ J.transpose(0, 2, 1) + self._precision, JW))

    def widened(self, batch: EstimateBatch, added: Array) -> EstimateBatch:
        """Adds a covariance (N, 6, 6) to the wrench's.

        A reading is not valid where the added covariance alone exceeds the limit of the force's sd.
        """
        force, limit = added[:, 3:, 3:], self._max_force_sd**2
        exceeds = ~np.asarray(np.trace(force, axis1=1, axis2=2) <= limit)
        doubtful = np.flatnonzero(exceeds)
        if len(doubtful):
            exceeds[doubtful] = ~(np.linalg.eigvalsh(force[doubtful])[:, -1] <= limit)
        return batch._replace(covariance=batch.covariance + added).marked(FRICTION_DRIFT, exceeds)
