"""Tasks in one compiled loop against the closed loop that Drake simulates."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from wrenchsight.analyses.experiments.setups.path_runs.task_runs import task_scenario
from wrenchsight.analyses.methods.simulate import air_pass
from wrenchsight.analyses.methods.simulate.air_pass import record_air_pass
from wrenchsight.analyses.methods.simulate.fast_runs import is_free, run_free, sensed
from wrenchsight.diagrams.closed_loop import LogRequest, make_closed_loop
from wrenchsight.diagrams.scenario import load_scenario
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.planning.motion.paths import JointTrajectory
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.truth.true_robot import with_truth_named
from wrenchsight.models.truth.worlds import draw_world
from wrenchsight.systems.force_torque_sensor import ForceTorqueSensorConfig


@pytest.fixture(scope="module", params=["own", "hard"])
def robot(request):
    return draw_world(0, 0).robot(with_truth_named(Robot.load("sts_sre4_600"), request.param))


def test_it_is_the_closed_loop_tick_by_tick(robot):
    """A pushed arm, every mechanism on, for 1.2 s, pushed from .5 s on."""
    scenario = task_scenario("FrictionAtReversal", 3, 8.0)
    push = replace(scenario.wrench[0], start=0.5)
    scenario = replace(scenario, duration=1.2, wrench=[push])
    assert is_free(scenario)
    model = IdentifiedModel.nominal(robot)
    loop = make_closed_loop(
        scenario, robot, model, log=LogRequest(also=("tau_f_true",)), estimator=None
    )
    simulator = Simulator(loop.diagram)
    simulator.AdvanceTo(scenario.duration)
    t, signals = loop.logged(simulator.get_context())
    found_t, result = run_free(scenario, robot, model)
    np.testing.assert_allclose(found_t, t, atol=1e-12)
    assert np.abs(signals["wrench_true"][:, 3:]).max() > 5.0
    # Encoders and currents are rounded: a step of theirs may fall the other way now and then.
    for name, size in (
        ("q", 2e-6),
        ("v", 1e-6),
        ("current", 3e-3),
        ("tau_f_true", 1e-3),
        ("wrench_true", 1e-9),
        # The sensor's, which Drake finds from the reaction at the tool's mount.
        ("ft_wrench", 1e-3),
    ):
        np.testing.assert_allclose(result[name], signals[name], atol=size, err_msg=name)


def test_an_air_pass_is_the_closed_loops(robot, monkeypatch):
    """The motion is not the scenario's own; .3 s of it from the lead on."""
    scenario = load_scenario("PolishingSensorless")
    t = np.linspace(0.0, 0.3, 31)
    q = robot.home + 0.01 * np.outer(t**2, np.ones(6))
    motion = JointTrajectory.from_positions(t, q)
    fast = record_air_pass(scenario, robot, motion, 3)
    monkeypatch.setattr(air_pass, "is_free", lambda scenario: False)
    slow = record_air_pass(scenario, robot, motion, 3)
    np.testing.assert_allclose(fast.t, slow.t, atol=1e-12)
    assert np.ptp(slow.q, axis=0).min() > 2e-4  # even joint 6, which its friction holds back
    for name, size in (("q", 2e-6), ("v", 1e-6), ("current", 3e-3)):  # see above
        np.testing.assert_allclose(getattr(fast, name), getattr(slow, name), atol=size)


def test_a_sensor_that_is_ideal_is_a_tick_late():
    wrench = np.random.default_rng(0).normal(size=(50, 6))
    read = sensed(wrench, ForceTorqueSensorConfig(), 1e-3, 0)
    np.testing.assert_array_equal(read[1:], wrench[:-1])
    noisy = sensed(wrench, ForceTorqueSensorConfig(force_noise_sd=0.1), 1e-3, 0)
    np.testing.assert_array_equal(noisy[:, :3], read[:, :3])
    assert 0.05 < (noisy - read)[1:, 3:].std() < 0.15  # 147 draws of sd 0.1


def test_scenarios_with_contact_or_other_friction_need_drake():
    plain = task_scenario("FrictionAtReversal", 0, 8.0)
    assert is_free(plain)
    assert not is_free(replace(plain, floor=True))
    assert not is_free(replace(plain, friction="none"))
    assert not is_free(load_scenario("Polishing"))
