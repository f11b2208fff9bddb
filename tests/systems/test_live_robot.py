"""A live source in a diagram, against the estimator on the same samples."""

import time
from dataclasses import replace

import numpy as np
import pytest
from played_logs import moving_log
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput
from sample_models import knowing_model

from wrenchsight.diagrams.estimator import add_estimator_to_ports
from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.live.samples import EventKind, Sample, StreamEvent
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.systems.live_robot import LiveRobot

H = 0.002
CONFIG = WrenchEstimatorConfig(MomentumObserverConfig(time_step=H))


class Played:
    """A source that has its samples already, some at each call."""

    step, rate = H, 0.0

    def __init__(self, items):
        self.items = list(items)

    def read(self, timeout):
        if not self.items:
            time.sleep(timeout)
        part, self.items = self.items[:7], self.items[7:]
        return part

    def close(self):
        pass


@pytest.fixture(scope="module")
def log(ur10e):
    return moving_log(ur10e, H, 300)


def samples(log):
    ticks = enumerate(zip(*log, strict=True))
    return [Sample(5.0 + H * k, 0.0, *signals) for k, signals in ticks]


def simulated(robot, model, items, ticks):
    builder = DiagramBuilder()
    live = builder.AddSystem(LiveRobot(Played(items), robot, H, timeout=0.01))
    ports = {name: live.GetOutputPort(name) for name in ("q", "v", "current")}
    estimator = add_estimator_to_ports(builder, robot, model, CONFIG, **ports)
    names = ("wrench", "valid", "covariance")
    sinks = [LogVectorOutput(estimator.GetOutputPort(name), builder, H) for name in names]
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo((ticks - 0.5) * H)
    return live, [sink.FindLog(simulator.get_context()).data().T for sink in sinks]


def test_a_diagram_reads_a_live_robot_as_the_estimator_reads_its_log(ur10e, log):
    model = knowing_model(ur10e, 3.0, 5.0)
    live, (wrench, valid, covariance) = simulated(ur10e, model, samples(log), 300)
    estimator = WrenchEstimator(ur10e, model, CONFIG)
    batch = estimator.run(estimator.initial_state(), *log)
    # The grid's interpolation on steps that are off by rounding is the identity to 1e-12.
    np.testing.assert_allclose(wrench, batch.wrench, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(covariance, batch.covariance.reshape(300, 36), rtol=1e-7, atol=1e-9)
    np.testing.assert_array_equal(valid[:, 0] == 1.0, batch.valid)
    assert not live.events


def test_missing_samples_give_readings_that_are_not_valid(ur10e, log):
    model = knowing_model(ur10e, 3.0, 5.0)
    items = samples(log)
    items[250:] = [replace(sample, running=False) for sample in items[250:]]
    items.insert(100, StreamEvent(EventKind.RECIPE, "stranger", 0.0))
    items.insert(100, items[99])
    live, (wrench, valid, _) = simulated(ur10e, model, items, 320)
    assert np.isfinite(wrench).all()
    assert not valid[250:].any()  # a robot that does not run; then no sample at all
    assert {event.kind for event in live.events} == {EventKind.RECIPE, EventKind.DOUBLED}


def test_a_time_step_that_is_none_is_refused(ur10e):
    with pytest.raises(ValueError, match="time_step"):
        LiveRobot(Played([]), ur10e, 0.0)
