"""The estimator read at any time: between two ticks it says what it said at the last one."""

from contextlib import nullcontext

import numpy as np
import pytest
from block_ticks import take_tick
from played_logs import add_log
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem, ValueProducer
from pydrake.systems.primitives import LogVectorOutput
from sample_models import knowing_model

from wrenchsight.diagrams.estimator import add_estimator_to_ports
from wrenchsight.models.detection.contact_detector import ContactDetectionConfig
from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.observers.kalman_observer import KalmanObserverConfig
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.systems.sampled_block import SampledBlock, stepping_with_plant
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


class _Plant(LeafSystem):
    """x <- x + u at each tick. How often it solves for that, from state and input, is counted."""

    def __init__(self) -> None:
        LeafSystem.__init__(self)
        self.num_solved = 0
        self._u = self.DeclareVectorInputPort("u", 1)
        self.DeclareDiscreteState(1)
        self._solved = self.DeclareCacheEntry(
            "solved",
            ValueProducer(AbstractValue.Make(0.0).Clone, self._solve),
            {self.xd_ticket(), self._u.ticket()},
        )
        self.DeclareVectorOutputPort("x", 1, self._calc_x, {self.xd_ticket()})
        self.DeclareVectorOutputPort("solved", 1, self._calc_solved, {self._solved.ticket()})
        self.DeclarePeriodicDiscreteUpdateEvent(T, 0.0, self._step)

    def _solve(self, context, value):
        self.num_solved += 1
        x = context.get_discrete_state(0).value()
        value.set_value(float(x[0] + self._u.Eval(context)[0]))

    def _calc_x(self, context, output):
        output.SetFromVector(context.get_discrete_state(0).value())

    def _calc_solved(self, context, output):
        output.SetFromVector([self._solved.Eval(context)])

    def _step(self, context, discrete):
        discrete.set_value(0, [self._solved.Eval(context)])


class _Counter(SampledBlock):
    """u = 1 + x of the last tick. It remembers what the plant has solved, as of a contact."""

    def __init__(self) -> None:
        SampledBlock.__init__(self, period=T, initial_memory=np.zeros(1))
        self._x = self.DeclareVectorInputPort("x", 1)
        self._solved = self.DeclareVectorInputPort("solved", 1)
        self.declare_held_output("u", 1, self._calc_u, {self._x.ticket()})

    def take_sample(self, context, memory):
        memory[:] = self._solved.Eval(context)
        return [1.0 + self._x.Eval(context)]

    def _calc_u(self, context, output):
        output.SetFromVector(1.0 + self._x.Eval(context))


@pytest.mark.parametrize("with_plant", [False, True])
def test_a_block_that_steps_with_its_plant_lets_it_solve_once_a_tick(with_plant):
    """An update before the plant's step changes its input, if not in value, and it solves again."""
    builder = DiagramBuilder()
    plant = builder.AddSystem(_Plant())
    with stepping_with_plant() if with_plant else nullcontext():
        block = builder.AddSystem(_Counter())
    for name in ("x", "solved"):
        builder.Connect(plant.GetOutputPort(name), block.GetInputPort(name))
    builder.Connect(block.GetOutputPort("u"), plant.GetInputPort("u"))
    simulator = Simulator(builder.Build())
    simulator.Initialize()
    simulator.AdvanceTo(9.5 * T)
    x = plant.GetMyContextFromRoot(simulator.get_context()).get_discrete_state(0).value()
    assert x[0] == 2.0**10 - 1.0  # x <- 2 x + 1, ten times, in either phase
    assert plant.num_solved == (10 if with_plant else 20)


def test_an_update_that_is_forced_late_in_a_period_is_held_until_the_next_tick() -> None:
    block = _Counter()
    context = block.CreateDefaultContext()
    block.GetInputPort("x").FixValue(context, [1.0])
    block.GetInputPort("solved").FixValue(context, [0.0])
    context.SetTime(0.6 * T)
    take_tick(block, context)
    block.GetInputPort("x").FixValue(context, [5.0])
    output = block.GetOutputPort("u")
    for time, expected in ((0.99 * T, 2.0), (T, 6.0)):
        context.SetTime(time)
        assert output.Eval(context)[0] == expected


class _Remembering(SampledBlock):
    """Its output is its memory, the number of ticks before the sample."""

    def __init__(self) -> None:
        SampledBlock.__init__(self, period=T, initial_memory=np.zeros(1))
        self.declare_held_output("count", 1, self._calc_count, set())

    def take_sample(self, context, memory):
        count = memory.copy()
        memory += 1.0
        return [count]

    def _calc_count(self, context, output):
        output.SetFromVector(self.memory(context))


def test_a_time_that_is_set_back_computes_with_the_memory_of_the_last_tick() -> None:
    block = _Remembering()
    context = block.CreateDefaultContext()
    output = block.GetOutputPort("count")
    for k in range(3):
        context.SetTime(k * T)
        assert output.Eval(context)[0] == k  # ahead of the update: the memory before the sample
        take_tick(block, context)
        assert output.Eval(context)[0] == k  # held
    context.SetTime(1.5 * T)
    assert output.Eval(context)[0] == 3.0
