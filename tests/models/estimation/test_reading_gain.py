"""The gain of a reading: what a change of tau_ext does to the wrench, by the estimator itself."""

from dataclasses import replace

import numpy as np
import pytest
from sample_models import sample_torque_error

from wrenchsight.models.estimation.estimator import (
    Correction,
    WrenchEstimator,
    WrenchEstimatorConfig,
)
from wrenchsight.models.estimation.reading_gain import ReadingGain
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.observers.kalman_observer import KalmanObserverConfig
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig

T, ROWS = 0.01, 80


def estimator_of(sts, method, **changes):
    model = replace(
        IdentifiedModel.nominal(sts),
        torque_error=sample_torque_error(),
        residual_covariance=np.diag([1.0, 0.8, 0.5, 0.3, 0.2, 0.1]),
    )
    reading = WrenchReconstructionConfig(method, **changes)
    config = WrenchEstimatorConfig(MomentumObserverConfig([20.0], T), reading)
    return WrenchEstimator(sts, model, config)


def read(estimator, sts, correction):
    t = T * np.arange(ROWS)[:, None]
    q = sts.home + 0.2 * np.sin(t + np.arange(6))
    v = 0.2 * np.cos(t + np.arange(6))
    tau = sts.chain.inverse_dynamics(q, v, np.zeros_like(q))
    taught = Correction(np.tile(correction, (ROWS, 1)), v, np.ones(ROWS))
    current = tau / (sts.torque_per_ampere * sts.current_sign)
    return estimator.run(estimator.initial_state(), q, v, current, correction=taught)


@pytest.mark.parametrize("method", ["bayesian", "force_only", "inverse"])
def test_a_change_of_torque_changes_the_wrench_by_the_gain(sts, method):
    estimator = estimator_of(sts, method)
    change = np.array([1.0, -2.0, 0.5, 0.3, -0.2, 0.1])
    before, after = read(estimator, sts, 0.0 * change), read(estimator, sts, change)
    gain = ReadingGain(estimator).of(before)
    np.testing.assert_allclose(
        (after.wrench - before.wrench)[20:], (gain @ change)[20:], rtol=1e-5, atol=1e-6
    )


def test_a_too_uncertain_force_is_not_valid(sts):
    estimator = estimator_of(sts, "bayesian", max_force_sd=30.0)
    batch = read(estimator, sts, np.zeros(6))
    gain = ReadingGain(estimator)
    batch = batch._replace(invalid=np.zeros(ROWS, np.int64))
    added = np.tile(np.diag([0.0, 0.0, 0.0, 20.0**2, 20.0**2, 20.0**2]), (ROWS, 1, 1))
    wider = gain.widened(batch, added)
    np.testing.assert_allclose(wider.covariance, batch.covariance + added)
    assert wider.valid.all()  # 20 N in each direction, though the trace is that of 35 N
    added[:10, 3, 3] = 31.0**2
    assert not gain.widened(batch, added).valid[:10].any()
    assert gain.widened(batch, added).valid[10:].all()


def test_a_reading_without_a_gain_is_refused(sts):
    with pytest.raises(ValueError, match="truncated has no prior"):
        ReadingGain(estimator_of(sts, "truncated"))
    with pytest.raises(ValueError, match="states no torque error"):
        ReadingGain(WrenchEstimator(sts, IdentifiedModel.nominal(sts)))
    estimator = estimator_of(sts, "bayesian")
    kalman = replace(estimator.config, observer=KalmanObserverConfig(time_step=T))
    with pytest.raises(ValueError, match="reads the wrench itself"):
        ReadingGain(WrenchEstimator(sts, estimator.model, kalman))
