"""A model that knows its own error reads the same as a log, as stages and as one block."""

from copy import copy
from dataclasses import replace

import numpy as np
import pytest
from played_logs import played
from sample_models import knowing_model

from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.estimation.wrench_methods import METHODS
from wrenchsight.models.identification.torque_error_model import TORQUE_ERROR_ROWS
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.systems.torque_error import TorqueErrorSystem

T, N, ROWS = 1e-3, 6, 300


@pytest.fixture(scope="module")
def model(sts):
    return knowing_model(sts, 5.0, 4.0)


@pytest.fixture(scope="module")
def log(sts):
    """A motion that rests, starts and turns round, with two holes."""
    rng = np.random.default_rng(11)
    t = np.maximum(np.arange(ROWS)[:, None] * T - 0.05, 0.0)
    rate = rng.uniform(5.0, 20.0, N)
    q = sts.home + 0.1 * (1.0 - np.cos(rate * t))
    v = 0.1 * rate * np.sin(rate * t)
    current = 0.5 * np.sin(3.0 * rate * t) + 0.05 * rng.normal(size=(ROWS, N))
    q[150:152, 2] = np.nan
    current[200, 1] = np.inf
    return q, v, current


def test_ports(sts, model):
    estimator = WrenchEstimator(sts, model, WrenchEstimatorConfig())
    system = TorqueErrorSystem(estimator.error, T)
    names = [system.get_input_port(i).get_name() for i in range(system.num_input_ports())]
    assert names == ["terms", "tau_J", "tau_f", "pole", "sliding", "added_sd"]
    assert system.GetOutputPort("torque_error").size() == (3 + 6 + TORQUE_ERROR_ROWS) * N
    for late in ("tau_J", "tau_f"):
        port = system.GetInputPort(late).get_index()
        assert not system.HasDirectFeedthrough(int(port), 0)


@pytest.mark.parametrize("fused", [False, True])
@pytest.mark.parametrize("method", METHODS)
def test_diagram_and_log_read_the_same(sts, model, log, method, fused):
    configuration = WrenchEstimatorConfig(
        MomentumObserverConfig([20.0], T), WrenchReconstructionConfig(method)
    )
    estimator = WrenchEstimator(sts, model, configuration)
    batch = estimator.run(estimator.initial_state(), *log)
    outputs = played(sts, model, configuration, log, fused=fused)
    expected = {
        "tau_ext": batch.tau_ext,
        "wrench": batch.wrench,
        "covariance": batch.covariance.reshape(ROWS, 36),
        "condition_number": batch.condition_number[:, None],
        "valid": batch.valid[:, None],
    }
    for name, values in expected.items():
        # The same kernels; a covariance of 1e8 leaves 1e-12 of itself to rounding.
        scale = max(1.0, float(np.abs(values[np.isfinite(values)]).max()))
        np.testing.assert_allclose(
            outputs[name], values, rtol=0.0, atol=1e-12 * scale, err_msg=name
        )
    assert np.ptp(batch.torque_sd[:, 0]) > 0.1  # the error does follow the motion


@pytest.mark.parametrize("fused", [False, True])
def test_the_load_that_is_read_widens_the_band_alike(sts, model, log, fused):
    configuration = WrenchEstimatorConfig(MomentumObserverConfig([20.0], T))
    error = replace(model.torque_error, read_load=0.2, resting_only=1.0)
    loaded = replace(model, torque_error=error)
    estimator, plain = (
        WrenchEstimator(sts, known_model, configuration) for known_model in (loaded, model)
    )
    batch = estimator.run(estimator.initial_state(), *log)
    outputs = played(sts, loaded, configuration, log, fused=fused)
    scale = float(np.abs(batch.covariance).max())
    np.testing.assert_allclose(
        outputs["covariance"], batch.covariance.reshape(ROWS, 36), rtol=0.0, atol=1e-12 * scale
    )
    assert not np.allclose(batch.covariance, plain.run(plain.initial_state(), *log).covariance)


def test_a_point_force_is_weighted_by_the_models_usual_errors_too(sts, model, log):
    configuration = WrenchEstimatorConfig(
        MomentumObserverConfig([20.0], T), WrenchReconstructionConfig("force_only")
    )
    usual = np.sqrt(np.diag(model.residual_covariance))
    other = usual * np.where(np.arange(N) == 2, 9.0, 1.0)
    first, second = (
        one.run(one.initial_state(), *log)
        for one in (
            WrenchEstimator(sts, known_model, configuration)
            for known_model in (model, replace(model, residual_covariance=np.diag(other**2)))
        )
    )
    assert np.abs(first.wrench - second.wrench).max() > 0.1
    np.testing.assert_array_equal(first.torque_sd, second.torque_sd)


def test_the_encoders_step_comes_from_robot_yaml_unless_the_configuration_says_it(sts, model, log):
    with_step = copy(sts)
    with_step.position_resolution = np.full(N, 2e-4)
    stated = WrenchEstimatorConfig(position_resolution=[2e-4] * N)
    by_robot, by_configuration, by_model = (
        one.run(one.initial_state(), *log).torque_sd
        for one in (
            WrenchEstimator(with_step, model, WrenchEstimatorConfig()),
            WrenchEstimator(sts, model, stated),
            WrenchEstimator(sts, model, WrenchEstimatorConfig()),
        )
    )
    np.testing.assert_array_equal(by_robot, by_configuration)
    assert not np.array_equal(by_robot, by_model)
