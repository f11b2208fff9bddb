"""The estimator read at any time: between two ticks it says what it said at the last one."""

import numpy as np
import pytest
from block_ticks import take_tick
from played_logs import add_log
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput
from sample_models import knowing_model

from wrenchsight.diagrams.estimator import add_estimator_to_ports
from wrenchsight.models.detection.contact_detector import ContactDetectionConfig
from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.observers.kalman_observer import KalmanObserverConfig
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.systems.wrench_estimator import WrenchEstimatorSystem

T, N, ROWS = 1e-3, 6, 1500
PERIODS = (0.1, 1.0 / 30.0, 0.05, 0.0007)  # s, of those who read
MODELS = {
    "plain": IdentifiedModel.nominal,
    "torque error": lambda sts: knowing_model(sts, 5.0, 4.0),
}
CONFIGS = {
    "momentum": WrenchEstimatorConfig(
        MomentumObserverConfig([20.0], T), WrenchReconstructionConfig(max_force_sd=1e3)
    ),
    "present torque": WrenchEstimatorConfig(MomentumObserverConfig([20.0], T, "trapezoidal")),
    "kalman": WrenchEstimatorConfig(KalmanObserverConfig(time_step=T)),
    "unchecked": WrenchEstimatorConfig(MomentumObserverConfig([20.0], T), check_samples=False),
}


@pytest.fixture(scope="module")
def log(sts):
    t = np.arange(ROWS)[:, None] * T
    rate = np.linspace(1.0, 2.0, N)
    q = sts.home + 0.3 * (1.0 - np.cos(rate * t))
    v = 0.3 * rate * np.sin(rate * t)
    # Gravity alone, and what disturbs it: most readings are valid.
    torque = np.array([sts.chain.gravity_torque(row) for row in q])
    current = sts.current_sign * torque / sts.torque_per_ampere
    return q, v, current + 0.02 * np.sin(5.0 * rate * t)


def simulator_of(robot, model, config, log, fused):
    """A simulator whose estimator reads the log, and the estimator."""
    builder = DiagramBuilder()
    ports = add_log(builder, log, T)
    detection = ContactDetectionConfig() if model.torque_error is not None else None
    estimator = add_estimator_to_ports(
        builder, robot, model, config, **ports, fused=fused, detection=detection
    )
    names = ["tau_ext", "wrench", "covariance", "condition_number", "valid", "fault"]
    if detection is not None:
        names += ["contact_statistic", "contact", "misfit", "rest", "out_of_range"]
    periods = (T, *PERIODS)
    logs = {
        name: [LogVectorOutput(estimator.GetOutputPort(name), builder, p) for p in periods]
        for name in names
    }
    return Simulator(builder.Build()), estimator, logs


def last_ticks(times):
    """Row of the last tick at or before each time; ticks are at k T as Drake rounds it."""
    return np.searchsorted(np.arange(ROWS) * T, times, side="right") - 1


@pytest.mark.parametrize("fused", [False, True], ids=["stages", "fused"])
@pytest.mark.parametrize("config", CONFIGS)
@pytest.mark.parametrize("model", MODELS)
def test_a_logger_of_any_period_reads_the_last_ticks(sts, log, model, config, fused):
    simulator, _, logs = simulator_of(sts, MODELS[model](sts), CONFIGS[config], log, fused)
    simulator.AdvanceTo((ROWS - 1.5) * T)
    for name, (each, *others) in logs.items():
        every = each.FindLog(simulator.get_context()).data().T
        for other in others:
            seen = other.FindLog(simulator.get_context())
            rows = last_ticks(seen.sample_times())
            np.testing.assert_array_equal(seen.data().T, every[rows], err_msg=name)
    tau_ext = logs["tau_ext"][0].FindLog(simulator.get_context()).data().T
    estimator = WrenchEstimator(sts, MODELS[model](sts), CONFIGS[config])
    batch = estimator.run(estimator.initial_state(), *log)
    np.testing.assert_allclose(tau_ext, batch.tau_ext[: len(tau_ext)], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("fused", [False, True], ids=["stages", "fused"])
def test_advancing_and_evaluating_reads_the_last_tick(sts, log, fused):
    model, config = MODELS["plain"](sts), CONFIGS["momentum"]
    simulator, estimator, _ = simulator_of(sts, model, config, log, fused)
    wrench_estimator = WrenchEstimator(sts, model, config)
    batch = wrench_estimator.run(wrench_estimator.initial_state(), *log)
    context = simulator.get_context()
    for k in range(1, 29):
        simulator.AdvanceTo(k * 0.05)
        row = int(last_ticks(context.get_time()))
        at = estimator.GetMyContextFromRoot(context)
        wrench = estimator.GetOutputPort("wrench").Eval(at)
        np.testing.assert_allclose(wrench, batch.wrench[row], rtol=0.0, atol=1e-9)
        assert estimator.GetOutputPort("valid").Eval(at)[0] == batch.valid[row]
        assert estimator.GetOutputPort("fault").Eval(at)[0] == 0.0
    assert batch.valid[200:].all()


@pytest.mark.parametrize("config", ["momentum", "unchecked"])
def test_the_motor_torque_between_ticks_is_that_of_the_last(sts, log, config):
    """Of an impossible current it is NaN where samples are checked."""
    block = WrenchEstimatorSystem(
        WrenchEstimator(sts, IdentifiedModel.nominal(sts), CONFIGS[config])
    )
    context = block.CreateDefaultContext()
    q, v, current = log
    for k in range(4):
        sample = current[k].copy()
        if k == 2:
            sample[3] = 1e6
        for name, value in (("q", q[k]), ("v", v[k]), ("current", sample)):
            block.GetInputPort(name).FixValue(context, value)
        context.SetTime(k * T)
        port = block.GetOutputPort("tau_J")
        at = port.Eval(context).copy()
        assert np.isnan(at[3]) == (k == 2 and config == "momentum")
        take_tick(block, context)
        context.SetTime((k + 0.5) * T)
        block.GetInputPort("current").FixValue(context, np.zeros(N))  # of nobody's tick
        np.testing.assert_array_equal(port.Eval(context), at)
