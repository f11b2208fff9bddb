from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from wrenchsight.diagrams.closed_loop import (
    LogRequest,
    LoopEstimator,
    make_closed_loop,
    setpoint_at,
)
from wrenchsight.diagrams.machining import make_machining_path
from wrenchsight.diagrams.scenario import (
    ForceSetpoint,
    HoldMotion,
    JointSineMotion,
    LineMotion,
    PlateConfig,
    Scenario,
    load_scenario,
    make_trajectory,
)
from wrenchsight.models.control.wrench_script import WrenchStep
from wrenchsight.models.estimation.estimator import WrenchEstimatorConfig
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.robot.robot_config import PoseConfig
from wrenchsight.systems.force_torque_sensor import ForceTorqueSensorConfig
from wrenchsight.systems.impedance_controller import ForceControlConfig, ImpedanceConfig
from wrenchsight.systems.joint_tracking_controller import JointTrackingConfig

QUIET = Scenario(friction="none", current_noise=False)
DOWN = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]


def run(scenario, robot, model=None, also_log=()):
    loop = make_closed_loop(
        scenario, robot, model or IdentifiedModel.nominal(robot), log=LogRequest(also=also_log)
    )
    simulator = Simulator(loop.diagram)
    simulator.AdvanceTo(scenario.duration)
    return loop.logged(simulator.get_context())


def friction_model(robot):
    law = CoulombViscous(robot.truth.coulomb, robot.truth.viscous, np.zeros(6))
    return replace(IdentifiedModel.nominal(robot), friction=SemiParametricFriction(law))


def test_default_runs_and_logs_every_tick(sts):
    t, signals = run(replace(load_scenario("Default"), duration=0.3), sts, also_log=["tau_f_true"])
    np.testing.assert_allclose(t, np.arange(301) * 1e-3, atol=1e-12)
    sizes = {name: signal.shape[1] for name, signal in signals.items()}
    assert sizes == {
        "reference": 18,
        "tau_command": 6,
        "q": 6,
        "v": 6,
        "current": 6,
        "tau_ext_true": 6,
        "wrench_true": 6,
        "ft_wrench": 6,
        "tau_f_true": 6,
        "tau_ext": 6,
        "wrench": 6,
        "covariance": 36,
        "condition_number": 1,
        "valid": 1,
        "invalid": 1,
    }
    assert all(np.all(np.isfinite(signal)) for signal in signals.values())


def test_one_of_everything_touches_and_presses(sts):
    _, signals = run(replace(load_scenario("OneOfEverything"), duration=1.4), sts)
    assert {"pose_error", "force_setpoint", "ft_wrench"} <= signals.keys()
    assert all(np.all(np.isfinite(signal)) for signal in signals.values())
    # It stands still and presses: stiction leaves some newtons until the integral has worked.
    assert signals["wrench_true"][-1, 5] == pytest.approx(signals["force_setpoint"][-1, 0], abs=6)
    # The sensor lags by its filter, 4 ms, and a tick; noise of 0.2 N and 60 Hz out of 500 Hz.
    late = signals["ft_wrench"][1200:] - signals["wrench_true"][1200:]
    assert np.abs(late[:, 3:]).max() < 0.5
    # No chatter: the velocity does not change its sign from tick to tick.
    v = signals["v"][-200:]
    assert np.abs(np.diff(v, axis=0)).max() < 5e-3


def test_the_same_seed_gives_the_same_run(sts):
    scenario = replace(load_scenario("Default"), duration=0.1)
    first, again = (run(scenario, sts)[1] for _ in range(2))
    other = run(replace(scenario, seed=1), sts)[1]
    for name in first:
        np.testing.assert_array_equal(first[name], again[name])
    assert not np.array_equal(first["current"], other["current"])


def test_tracks_a_motion_with_the_exact_model(sts):
    motion = JointSineMotion(amplitude=[0.3], frequency=[0.5], ramp=0.5)
    _, signals = run(replace(QUIET, motion=motion, duration=1.5), sts)
    error = signals["q"] - signals["reference"][:, :6]
    # The plant moves at the velocity of the tick's end: T/2 times the acceleration (10 rad/s^2)
    # too fast, which feedback turns into kd / kp of it, 1.7e-4 rad.
    assert np.abs(error).max() < 2e-4
    assert np.ptp(signals["q"], axis=0).min() > 0.4


def test_friction_feedforward_helps_against_friction(sts):
    motion = JointSineMotion(amplitude=[0.3], frequency=[0.5], ramp=0.5)
    gains = JointTrackingConfig(kp=[400.0], kd=[40.0])
    scenario = replace(
        QUIET, motion=motion, duration=1.0, friction="coulomb_viscous", controller=gains
    )
    errors = []
    for model in (None, friction_model(sts)):
        _, signals = run(scenario, sts, model)
        errors.append(np.sqrt(np.mean((signals["q"] - signals["reference"][:, :6]) ** 2)))
    assert errors[1] < 0.1 * errors[0]


@pytest.mark.parametrize("feedback", ["sensor", "estimate"])
def test_force_control_holds_its_set_point_on_a_plate(sts, feedback):
    """The whole loop, without friction: 30 N along the plate's normal while E slides along it."""
    motion = LineMotion([0, 1, 0], [0.35, 0, 0.3], DOWN, 0.1, 1.5, 1, start=0.8)
    scenario = replace(
        QUIET,
        motion=motion,
        duration=2.3,
        controller=ImpedanceConfig(
            stiffness=np.array([4000.0, 4000, 4000, 200, 200, 200]),
            force=ForceControlConfig(proportional=0.2, integral=15.0),
        ),
        feedback=feedback,
        force_setpoint=ForceSetpoint(value=30.0, rise=0.3),
        force_torque_sensor=ForceTorqueSensorConfig() if feedback == "sensor" else None,
        workpiece=PlateConfig(PoseConfig([0.35, 0, 0.3]), friction=0.2),
    )
    scenario.estimator.reconstruction.method = "inverse"
    _, signals = run(scenario, sts)
    normal = signals["wrench_true"][:, 5]
    moving = slice(1200, 2200)
    assert np.abs(normal[moving] - 30.0).max() < 0.5
    # Coulomb friction against the motion along +y.
    np.testing.assert_allclose(signals["wrench_true"][moving, 4], -0.2 * normal[moving], rtol=0.03)
    # The estimate reads the contact, and so does the tool's pose error: friction over stiffness.
    np.testing.assert_allclose(
        signals["wrench"][2000, 3:], signals["wrench_true"][2000, 3:], atol=0.5
    )
    assert np.abs(signals["pose_error"][moving, 3:5]).max() < 4e-3


def test_a_soft_arm_yields_to_a_push_by_force_over_stiffness(sts):
    controller = ImpedanceConfig(
        stiffness=np.array([500.0, 500, 500, 50, 50, 50]),
        damping=np.array([120.0, 120, 120, 2, 2, 2]),
    )
    push = WrenchStep(force=[3.0, -2.0, 4.0], moment=[0.1, 0.0, 0.0])
    scenario = replace(
        QUIET, motion=HoldMotion(), controller=controller, duration=3.0, wrench=[push]
    )
    _, signals = run(scenario, sts)
    expected = np.array([0.1, 0, 0, 3.0, -2.0, 4.0]) / [50, 50, 50, 500, 500, 500]
    np.testing.assert_allclose(signals["pose_error"][-1], expected, atol=2e-4)


def test_setpoint():
    setpoint = ForceSetpoint(value=20.0, start=1.0, rise=0.5, amplitude=4.0, frequency=0.25)
    t = np.array([0.0, 1.0, 1.25, 2.0, 4.0])
    expected = [0, 0, 0.5 * (20 + 4 * np.sin(np.pi / 8)), 24.0, 16.0]
    np.testing.assert_allclose(setpoint_at(setpoint, t), expected, atol=1e-12)


def test_damping_that_would_chatter_is_refused(sts):
    controller = ImpedanceConfig(damping=np.array([250.0, 250, 250, 20, 20, 20]))
    with pytest.raises(InputError, match="expected at most 1"):
        make_closed_loop(replace(QUIET, controller=controller), sts, IdentifiedModel.nominal(sts))


def test_an_estimate_of_the_present_torque_is_not_fed_back(sts):
    """Force control would command a torque that depends on itself."""
    observer = MomentumObserverConfig(torque_samples="trapezoidal")
    scenario = Scenario(
        controller=ImpedanceConfig(force=ForceControlConfig()),
        feedback="estimate",
        estimator=WrenchEstimatorConfig(observer),
    )
    with pytest.raises(InputError, match=r"estimator\.observer: reads the present torque"):
        make_closed_loop(scenario, sts, IdentifiedModel.nominal(sts))


def test_a_model_of_another_robot_is_refused(ur10e, sts):
    with pytest.raises(InputError, match="ur10e"):
        make_closed_loop(QUIET, sts, IdentifiedModel.nominal(ur10e))


def test_a_loop_whose_cell_takes_forces_runs_without_any(sts):
    scenario = replace(QUIET, duration=0.05)
    _, alone = run(scenario, sts)
    _, signals = run(replace(scenario, applied_spatial_force=True), sts)
    for name, values in alone.items():
        np.testing.assert_array_equal(signals[name], values)


def test_logging_fewer_signals_does_not_change_the_others(sts):
    scenario = replace(load_scenario("Default"), duration=0.1)
    _, everything = run(scenario, sts)
    wanted = ("current", "q")
    loop = make_closed_loop(
        scenario, sts, IdentifiedModel.nominal(sts), log=LogRequest(only=wanted)
    )
    simulator = Simulator(loop.diagram)
    simulator.AdvanceTo(scenario.duration)
    _, signals = loop.logged(simulator.get_context())
    assert tuple(signals) == wanted
    for name in wanted:
        np.testing.assert_array_equal(signals[name], everything[name])


def test_the_estimator_may_know_something_else_than_the_controller(sts):
    """A tracking loop does not see the estimate: the motion stays, what is read does not."""
    scenario = Scenario(controller=JointTrackingConfig(), duration=0.1)
    model, other = IdentifiedModel.nominal(sts), friction_model(sts)
    logs = []
    for reads in (None, other):
        loop = make_closed_loop(scenario, sts, model, estimator=LoopEstimator(model=reads))
        simulator = Simulator(loop.diagram)
        simulator.AdvanceTo(scenario.duration)
        logs.append(loop.logged(simulator.get_context())[1])
    for name in ("q", "tau_command"):
        np.testing.assert_array_equal(logs[1][name], logs[0][name])
    difference = logs[1]["tau_ext"] - logs[0]["tau_ext"]
    assert np.abs(difference).max() > 0.1


def test_without_the_estimator_the_motion_is_the_same(sts):
    """A tracking loop does not see the estimate, so that not one bit of the motion may change."""
    scenario = Scenario(controller=JointTrackingConfig(), duration=0.1)
    model = IdentifiedModel.nominal(sts)
    logs = []
    for estimator in (LoopEstimator(), None):
        loop = make_closed_loop(scenario, sts, model, estimator=estimator)
        assert (loop.estimator is None) == (estimator is None)
        simulator = Simulator(loop.diagram)
        simulator.AdvanceTo(scenario.duration)
        logs.append(loop.logged(simulator.get_context())[1])
    full, plain = logs
    estimates = {"tau_ext", "wrench", "covariance", "condition_number", "valid", "invalid"}
    assert set(full) - set(plain) == estimates
    for name, signal in plain.items():
        np.testing.assert_array_equal(signal, full[name])
    assert np.ptp(plain["current"], axis=0).all()


def test_a_controller_that_needs_the_estimator_is_refused_without_it(ur10e, sts):
    scenario = replace(QUIET, controller=ImpedanceConfig())
    with pytest.raises(ValueError, match="need the estimator"):
        make_closed_loop(scenario, sts, IdentifiedModel.nominal(sts), estimator=None)
    with pytest.raises(InputError, match="ur10e"):
        make_closed_loop(
            Scenario(controller=JointTrackingConfig()),
            sts,
            IdentifiedModel.nominal(ur10e),
            estimator=None,
        )


def test_a_motion_that_is_not_of_the_scenarios_kind_is_refused(sts):
    model, polishing = IdentifiedModel.nominal(sts), load_scenario("Polishing")
    trajectory = make_trajectory(QUIET, sts)
    with pytest.raises(ValueError, match="machining scenario needs a machining path"):
        make_closed_loop(polishing, sts, model, motion=trajectory)
    with pytest.raises(ValueError, match="machining path needs a machining scenario"):
        make_closed_loop(QUIET, sts, model, motion=make_machining_path(polishing, sts))
