"""MotorCurrentSensor."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, LogVectorOutput

from wrenchsight.models.signals.gaussian_noise import gaussian_noise
from wrenchsight.systems.motor_current_sensor import MotorCurrentSensor

TIME_STEP = 1e-3


def reading(sensor, context, current_true):
    sensor.GetInputPort("current_true").FixValue(context, np.asarray(current_true, float))
    return sensor.GetOutputPort("current").Eval(context)


def draws(seed, tick, size):
    noise = np.empty(size)
    gaussian_noise(seed, tick, noise)
    return noise


def record(sensor, source, duration):
    """Rows (N, n) of the true and of the reported current, one a tick."""
    builder = DiagramBuilder()
    builder.AddSystem(source)
    builder.AddSystem(sensor)
    builder.Connect(source.get_output_port(0), sensor.GetInputPort("current_true"))
    logs = [
        LogVectorOutput(port, builder, sensor.time_step)
        for port in (source.get_output_port(0), sensor.GetOutputPort("current"))
    ]
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(duration)
    return [log.FindLog(simulator.get_context()).data().T for log in logs]


def test_ports():
    sensor = MotorCurrentSensor(2, TIME_STEP)
    assert sensor.get_input_port().get_name() == "current_true"
    assert sensor.GetOutputPort("current").size() == sensor.num_joints == 2
    assert sensor.time_step == TIME_STEP


def test_an_ideal_sensor_reads_the_present_current():
    sensor = MotorCurrentSensor(2, TIME_STEP)
    context = sensor.CreateDefaultContext()
    np.testing.assert_array_equal(reading(sensor, context, [1.25, -3.0]), [1.25, -3.0])
    np.testing.assert_array_equal(reading(sensor, context, [2.0, 5.0]), [2.0, 5.0])


def test_noise_and_resolution():
    sensor = MotorCurrentSensor(2, TIME_STEP, noise_sd=[0.1, 0.2], resolution=[0.0, 0.25], seed=3)
    context = sensor.CreateDefaultContext()
    for tick in range(3):
        context.SetTime((tick + 0.5) * TIME_STEP)
        noisy = 1.0 + draws(3, tick, 2) * [0.1, 0.2]
        expected = [noisy[0], 0.25 * np.round(noisy[1] / 0.25)]
        np.testing.assert_allclose(reading(sensor, context, [1.0, 1.0]), expected, atol=1e-15)


def test_noise_has_its_standard_deviation_and_repeats_by_seed():
    def run(seed):
        sensor = MotorCurrentSensor(2, TIME_STEP, noise_sd=[0.1, 0.02], seed=seed)
        return record(sensor, ConstantVectorSource([1.0, 2.0]), 4.0)[1]

    first = run(7)
    np.testing.assert_allclose(first.mean(axis=0), [1.0, 2.0], rtol=0.0, atol=0.1 * 5 / 63.0)
    np.testing.assert_allclose(first.std(axis=0), [0.1, 0.02], rtol=5 / np.sqrt(2 * 4000))
    np.testing.assert_array_equal(first, run(7))
    assert not np.array_equal(first, run(8))


def test_parameters_change_through_the_context():
    sensor = MotorCurrentSensor(1, TIME_STEP, bandwidth=5.0, noise_sd=1.0, resolution=0.5, seed=4)
    context = sensor.CreateDefaultContext()
    context.SetDiscreteState(0, [0.0])
    for index, value in enumerate((np.inf, 0.25, 0.0)):
        context.get_mutable_numeric_parameter(index).SetFromVector([value])
    expected = 1.1 + 0.25 * draws(4, 0, 1)
    np.testing.assert_allclose(reading(sensor, context, [1.1]), expected, atol=1e-15)


def test_a_broken_current_is_reported_and_forgotten():
    sensor = MotorCurrentSensor(2, TIME_STEP, bandwidth=30.0)
    simulator = Simulator(sensor)
    context = simulator.get_mutable_context()
    rows = []
    for k, current_true in enumerate([[1.0, 1.0], [2.0, np.nan], [2.0, 2.0]]):
        rows.append(reading(sensor, context, current_true))
        simulator.AdvanceTo((k + 1) * TIME_STEP)  # at the next tick, before its update
    a = np.exp(-2.0 * np.pi * 30.0 * TIME_STEP)
    np.testing.assert_array_equal(rows[1], [2.0 - a, np.nan])
    # The joint that was broken lags as if the tick had not been.
    np.testing.assert_allclose(rows[2], [2.0 - a * a, 2.0 - a], rtol=0.0, atol=1e-15)


@pytest.mark.parametrize(
    "arguments",
    [{"bandwidth": 0.0}, {"bandwidth": -1.0}, {"noise_sd": -0.1}, {"resolution": [0.1, np.nan]}],
)
def test_bad_arguments(arguments):
    with pytest.raises(ValueError, match="out of range"):
        MotorCurrentSensor(2, TIME_STEP, **arguments)


@pytest.mark.parametrize("seed", [-1, 2**63])
def test_a_seed_that_no_kernel_takes_is_refused(seed):
    with pytest.raises(ValueError, match="seed of the noise"):
        MotorCurrentSensor(2, TIME_STEP, noise_sd=0.1, seed=seed)


@pytest.mark.parametrize("time_step", [0.0, -TIME_STEP, np.nan, np.inf])
def test_a_period_that_is_none_is_refused(time_step):
    with pytest.raises(ValueError, match="current sensor: time_step must be positive"):
        MotorCurrentSensor(2, time_step)


def test_a_parameter_of_the_context_that_is_none_is_refused():
    sensor = MotorCurrentSensor(2, TIME_STEP, bandwidth=30.0)
    context = sensor.CreateDefaultContext()
    sensor.get_input_port().FixValue(context, np.ones(2))
    context.get_mutable_numeric_parameter(0).SetAtIndex(0, np.nan)
    with pytest.raises(ValueError, match=r"bandwidth .* is out of range"):
        sensor.get_output_port().Eval(context)
