"""Fast logs against the cell that Drake simulates, tick by tick."""

import dataclasses

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from wrenchsight.analyses.methods.simulate.simulated_logs import TRACKING_CONFIG, drive_servo
from wrenchsight.diagrams.closed_loop import LogRequest, make_closed_loop
from wrenchsight.diagrams.scenario import Scenario
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.planning.motion.paths import JointTrajectory
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.truth import free_arm
from wrenchsight.models.truth.free_arm import simulate_free_arm
from wrenchsight.models.truth.true_joints import TrueJoints
from wrenchsight.models.truth.true_robot import with_truth_named


@pytest.fixture(scope="module")
def robot():
    return with_truth_named(Robot.load("sts_sre4_600"), "hard")


def swing(robot, duration=0.6, amplitude=0.3):
    t = np.linspace(0.0, duration, 61)
    w, n = 2 * np.pi / duration, robot.num_joints
    home = np.asarray(robot.home)
    shape = amplitude * np.ones(n)
    q = home + shape * (1 - np.cos(w * t))[:, None] / 2
    v = shape * w * np.sin(w * t)[:, None] / 2
    return JointTrajectory(t, q, v, shape * w**2 * np.cos(w * t)[:, None] / 2)


def both(arm, seed=5):
    """Signals of the cell in Drake and of the fast log, by name, and the same times."""
    motion, model = swing(arm), IdentifiedModel.nominal(arm)
    scenario = Scenario(
        robot=arm.name, duration=motion.duration, seed=seed, controller=TRACKING_CONFIG
    )
    loop = make_closed_loop(
        scenario, arm, model, motion=motion, estimator=None,
        log=LogRequest(also=("tau_f_true", "tau_J_true", "state")),
    )  # fmt: skip
    simulator = Simulator(loop.diagram)
    simulator.AdvanceTo(motion.duration)
    t, signals = loop.logged(simulator.get_context())
    fast = simulate_free_arm(arm, motion, drive_servo(arm, model), seed=seed)
    np.testing.assert_allclose(fast.t, t, atol=1e-12)
    q, v = np.split(signals["state"], 2, axis=1)
    yield from (
        *((name, getattr(fast, name), signals[name]) for name in ("q", "v", "current")),
        *((name, getattr(fast, name), signals[name]) for name in ("tau_f_true", "tau_J_true")),
        ("q_true", fast.q_true, q),
        ("v_true", fast.v_true, v),
    )


@pytest.mark.parametrize("truth", ["own", "plain", "coupled"])
def test_it_is_the_cell_of_drake_tick_by_tick(robot, sts, coupled_wrist, truth):
    """To 1e-12 of each signal, over 600 ticks with sticking, sliding and turning round.

    The encoders round nothing here: in the last bit of a step two roundings would part.
    """
    mechanisms = dataclasses.replace(robot.config.simulated_truth.mechanisms, encoder=None)
    truth_config = dataclasses.replace(robot.config.simulated_truth, mechanisms=mechanisms)
    arm = {"own": robot.with_truth(truth_config), "plain": sts, "coupled": coupled_wrist}[truth]
    for name, simulated, true in both(arm):
        step = arm.current_resolution.max() if name == "current" else 0.0  # as above
        size = 1e-12 * np.abs(true).max() + 1.001 * step
        np.testing.assert_allclose(simulated, true, rtol=0.0, atol=size, err_msg=name)
        if name == "current":
            assert (simulated != true).mean() < 0.01
        if name == "v_true":
            assert np.ptp(np.sign(true), axis=0).min() > 0


def test_with_encoders_that_round_it_is_the_cell_to_their_steps(robot):
    """Every mechanism on: a step of theirs may fall the other way now and then."""
    sizes = {"q": 2e-6, "v": 1e-6, "current": 3e-3, "tau_f_true": 1e-3, "tau_J_true": 1e-3}
    sizes |= {"q_true": 1e-8, "v_true": 1e-6}
    for name, simulated, true in both(robot):
        np.testing.assert_allclose(simulated, true, atol=sizes[name], err_msg=name)


def test_the_same_seed_gives_the_same_log_and_another_another(robot):
    servo = drive_servo(robot, IdentifiedModel.nominal(robot))
    first, again, other = (simulate_free_arm(robot, swing(robot), servo, seed=s) for s in (1, 1, 2))
    for field in dataclasses.fields(first):
        np.testing.assert_array_equal(getattr(first, field.name), getattr(again, field.name))
    assert np.any(first.current != other.current)
    thinned = simulate_free_arm(robot, swing(robot), servo, seed=1, every=10)
    np.testing.assert_array_equal(thinned.current, first.current[::10])


def test_a_log_is_the_same_in_parts_and_without_what_nobody_asked_for(robot, monkeypatch):
    servo = drive_servo(robot, IdentifiedModel.nominal(robot))
    log = simulate_free_arm(robot, swing(robot), servo, seed=1, every=3)
    monkeypatch.setattr(free_arm, "_CHUNK_TICKS", 97)
    parts = simulate_free_arm(robot, swing(robot), servo, seed=1, every=3, whole=False)
    for field in dataclasses.fields(log):
        simulated, expected = getattr(parts, field.name), getattr(log, field.name)
        if field.name in ("q_true", "v_true", "tau_J_true", "rise"):
            assert simulated.shape == (0, robot.num_joints)
            assert expected.shape == (len(log.t), robot.num_joints)
        else:
            np.testing.assert_array_equal(simulated, expected)


def test_the_encoders_start_where_the_motion_does(robot):
    log = simulate_free_arm(robot, swing(robot), drive_servo(robot, IdentifiedModel.nominal(robot)))
    np.testing.assert_allclose(log.q[0], robot.home, atol=1e-6)  # the encoder's step
    assert np.abs(log.q_true[0] - robot.home).max() > 5e-4  # the gears are bent


@pytest.mark.parametrize("name", ["sts_sre4_600", "ur10e"])
def test_a_long_rest_stays_at_rest(name):
    """Numerically stable at 1 ms: nothing rings or drifts where nothing is asked to move."""
    arm = Robot.load(name)
    t, n = np.array([0.0, 10.0]), arm.num_joints
    home, zero = np.tile(arm.home, (2, 1)), np.zeros((2, n))
    servo = drive_servo(arm, IdentifiedModel.nominal(arm))
    log = simulate_free_arm(arm, JointTrajectory(t, home, zero, zero), servo)
    assert np.abs(log.q[1000:] - arm.home).max() < 5e-4
    assert np.abs(log.v_true[2000:]).max() < 5e-3  # the encoders' noise through a stiff drive


def test_a_warm_arm_needs_less(robot):
    servo = drive_servo(robot, IdentifiedModel.nominal(robot))
    work = []
    for rise in (0.0, 20.0):
        log = simulate_free_arm(robot, swing(robot), servo, start_rise=np.full(6, rise))
        work.append(float((log.tau_f_true * log.v_true).sum()))
    assert work[1] < 0.97 * work[0]


def test_friction_at_steady_speed_is_the_stated_curve(robot):
    """Where only a past makes the difference: springs that are not yet bent, the warming joint."""
    truth = robot.config.simulated_truth
    mechanisms = dataclasses.replace(
        truth.mechanisms,
        wander=None,
        ripple=None,
        motor=dataclasses.replace(truth.mechanisms.motor, cogging_amplitude=[]),
        day=3,
    )
    friction = dataclasses.replace(truth.friction, ripple_amplitude=[])
    arm = robot.with_truth(dataclasses.replace(truth, friction=friction, mechanisms=mechanisms))
    servo = drive_servo(arm, IdentifiedModel.nominal(arm))
    log = simulate_free_arm(arm, swing(arm, 4.0), servo)
    joints = TrueJoints.of(arm, 1e-3)
    expected = joints.sliding_torque(log.v_true, log.tau_J_true - log.tau_f_true)
    # The same way for .1 s already: the last spring gives way after 1.2 mrad.
    moving = np.zeros(log.v_true.shape, dtype=bool)
    moving[100:] = log.v_true[100:] * log.v_true[:-100] > 0.05**2
    assert moving.sum(axis=0).min() > 200
    for i in range(6):
        part = moving[:, i]
        # On its way a spring lags the falling and rising level by its reach: 1 % at this motion.
        np.testing.assert_allclose(log.tau_f_true[part, i], expected[part, i], rtol=0.02)
    driven = (log.v_true * (log.tau_J_true - log.tau_f_true))[moving] > 0.0
    assert 0.1 < driven.mean() < 0.9  # loads that drive the motion, and that it drives
