from dataclasses import replace

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.analysis import Simulator

from wrenchsight.diagrams.closed_loop import make_closed_loop
from wrenchsight.diagrams.machining import (
    longest_duration,
    make_machining_path,
    posture_problem,
    with_planned_force,
)
from wrenchsight.diagrams.scenario import load_scenario
from wrenchsight.diagrams.workpiece import pose_of_workpiece
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.estimation.wrench_prior import live_prior
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.machining.machining_phases import Fault, Phase
from wrenchsight.models.robot.robot_config import PoseConfig

SHORT = {
    "standoff": 0.006,
    "search": 0.003,
    "rise": 0.3,
    "settle": 0.1,
    "release": 0.2,
    "lift": 0.01,
}


def model_of(robot):
    """Slow friction is known, as slow passes show it; ripple, load and curvature are not."""
    law = CoulombViscous(robot.truth.stiction, robot.truth.viscous, np.zeros(6))
    return replace(IdentifiedModel.nominal(robot), friction=SemiParametricFriction(law))


def short(name, one_way=0.7, **phases):
    scenario = load_scenario(name)
    machining = scenario.machining
    machining = replace(
        machining, one_way=one_way, phases=replace(machining.phases, **(SHORT | phases))
    )
    return replace(scenario, machining=machining)


def run(scenario, robot, plan=None, duration=None):
    plan = plan or make_machining_path(scenario, robot)
    loop = make_closed_loop(scenario, robot, model_of(robot), motion=plan)
    simulator = Simulator(loop.diagram)
    simulator.AdvanceTo(duration or longest_duration(plan, scenario.machining.phases))
    t, signals = loop.logged(simulator.get_context())
    R_WE, _ = robot.chain.pose(signals["q"])
    signals["normal"] = np.sum(-R_WE[:, :, 2] * signals["wrench_true"][:, 3:], axis=1)
    return t, signals


def energy_fed(robot, signals):
    """(T,) J: work of contact and cutting on the arm. A force acts up to the next tick."""
    V = np.einsum("tij,tj->ti", robot.chain.jacobian(signals["q"]), signals["v"])
    power = np.sum(signals["wrench_true"][:-1] * V[1:], axis=1)
    return np.concatenate([[0.0], np.cumsum(1e-3 * power)])


@pytest.fixture(scope="module", params=["Polishing", "Grinding"])
def a_pass(request, sts):
    return request.param, run(short(request.param), sts)


@pytest.mark.slow
def test_a_pass_works_and_lifts(a_pass):
    _, (_t, signals) = a_pass
    phases = signals["phase"][:, 0]
    order = phases[np.concatenate([[True], np.diff(phases) != 0])]
    np.testing.assert_array_equal(order, list(Phase)[: Phase.DONE + 1])
    assert signals["fault"][-1, 0] == Fault.NONE
    work = phases == Phase.WORK
    # Twenty times faster than in the experiments: 3.6 N on the plate, 5.7 N on the blade, and
    # contact all the time, 33 N and 15 N at least.
    assert signals["normal"][work].min() > 5.0
    error = (signals["normal"] - signals["force_setpoint"][:, 0])[work]
    assert np.sqrt(np.mean(error**2)) < 10.0
    assert np.all(signals["normal"][phases >= Phase.DONE] == 0.0)


@pytest.mark.slow
def test_the_sensor_measures_the_contact(a_pass):
    """Mount reaction against contact results: two ways to one force."""
    _, (_t, signals) = a_pass
    work = signals["phase"][:, 0] == Phase.WORK
    error = (signals["ft_wrench"] - signals["wrench_true"])[work, 3:]
    smooth = np.apply_along_axis(lambda x: np.convolve(x, np.ones(101) / 101, "valid"), 0, error)
    # Filter and unbalance average out over five turns of the spindle.
    assert np.abs(np.median(smooth, axis=0)).max() < 1.0


@pytest.mark.slow
def test_contact_feeds_no_energy_into_the_arm(a_pass, sts):
    name, (_, signals) = a_pass
    energy = energy_fed(sts, signals)
    # What comes back is the elastic energy of the contact at most, F^2 / 2 k: under 60 N 9 mJ with
    # the plate's 2e5 N/m, 26 mJ with the blade's patch of 7e4 N/m or more.
    rise = np.max(energy - np.minimum.accumulate(energy))
    assert rise < (0.015 if name == "Polishing" else 0.03)
    # Friction and cutting take about .3 times 40 N over .54 m.
    assert energy[-1] < -3.0


def shifted(plate, p_W, height, tilt):
    """The plate turned by `tilt` about its own x and y through a point, and `height` m higher."""
    X_WP = pose_of_workpiece(plate)
    p_P = X_WP.inverse() @ p_W
    X_WP = (
        X_WP
        @ RigidTransform(np.add(p_P, [0.0, 0.0, height]))
        @ RigidTransform(RollPitchYaw(*tilt, 0.0), np.zeros(3))
        @ RigidTransform(-p_P)
    )
    rpy = RollPitchYaw(X_WP.rotation()).vector().tolist()
    return replace(plate, pose=PoseConfig(X_WP.translation().tolist(), rpy))


@pytest.mark.slow
def test_touch_downs_stay_gentle(sts):
    """Fifty of them: the plate stands higher, lower or tilted, the tool comes down faster."""
    rng = np.random.default_rng(6)
    scenario = short("Polishing", standoff=0.004, search=0.0035)
    plan = make_machining_path(scenario, sts)
    most = []
    for k in range(50):
        height, speed = rng.uniform(-0.0015, 0.0015), rng.uniform(0.01, 0.025)
        tilt = rng.uniform(-0.05, 0.05, 2)
        moved = replace(
            scenario,
            seed=k,
            workpiece=shifted(scenario.workpiece, plan.path.p_WS[0], height, tilt),
            machining=replace(
                scenario.machining,
                phases=replace(scenario.machining.phases, approach_speed=speed),
            ),
        )
        _, signals = run(moved, sts, plan, duration=0.0075 / speed + 0.1)
        phase = signals["phase"][:, 0]
        assert np.any(phase == Phase.TOUCH)
        most.append(np.max(signals["normal"] - signals["force_setpoint"][:, 0]))
    # 25 mm/s against 2e5 N/m and the arm's 7 kg along the normal: v sqrt(k m) = 30 N, and what the
    # sensor's lag adds; 32 N, 20 N in the middle of them.
    assert max(most) < 40.0
    assert np.median(most) < 25.0


@pytest.mark.slow
def test_the_prior_of_a_reading_holds_the_planned_force(sts):
    """Else it pulls a force of 60 N towards zero, as the rated payload weighs 39 N."""
    plan = make_machining_path(load_scenario("Grinding"), sts)
    assert plan.setpoint.max() == pytest.approx(60.0, abs=0.1)
    live = live_prior(sts.payload)
    wide = with_planned_force(WrenchReconstructionConfig(), sts, plan)
    assert (wide.prior_force_sd, wide.prior_moment_sd) == (plan.setpoint.max(), live.moment_sd)
    gentle = replace(plan, setpoint=0.1 * plan.setpoint)
    assert with_planned_force(WrenchReconstructionConfig(), sts, gentle).prior_force_sd == (
        live.force_sd
    )
    stated = WrenchReconstructionConfig(prior_force_sd=7.0, prior_moment_sd=1.0)
    assert with_planned_force(stated, sts, plan) == stated


def test_ranges_beyond_a_joints_limits_are_refused(sts):
    """Named by the joint, not by a sample of the path that no posture reaches."""
    scenario = load_scenario("Polishing")
    name = sts.joint_names[0]
    beyond = np.degrees(sts.position_upper[0]) + np.array([1.0, 10.0])
    machining = replace(scenario.machining, joint_ranges_deg={name: beyond.tolist()})
    with pytest.raises(InputError, match=f"joint_ranges_deg: leave {name} .* no range"):
        make_machining_path(replace(scenario, machining=machining), sts)


def small_arm(serial_robot, limit):
    """A sliding joint below five that turn; each moves by `limit` either way, rad or m."""
    axes = ["0 0 1", "0 1 0", "0 1 0", "0 0 1", "0 1 0"]
    turning = [("revolute", axis, "0 0 0.2") for axis in axes]
    return serial_robot([("prismatic", "1 0 0", "0 0 0"), *turning], limit, home=[0.0] * 6)


def test_margins_are_kept_from_the_limits_of_joints_that_turn(serial_robot):
    """A margin in degrees means nothing in metres."""
    robot, machining = small_arm(serial_robot, 0.5), load_scenario("Polishing").machining
    problem = posture_problem(robot, None, replace(machining, joint_ranges_deg={}), "scenario")
    margin = np.radians([0.0, 5.0, 5.0, 5.0, 5.0, 5.0])
    # To the rounding of a sum.
    np.testing.assert_allclose(problem.upper, 0.5 - margin, rtol=1e-14)
    np.testing.assert_allclose(problem.lower, margin - 0.5, rtol=1e-14)


def test_a_joint_without_a_range_beside_the_margin_is_named(serial_robot):
    """It is the robot's own range, and no setting of the scenario, that is too small."""
    robot, machining = small_arm(serial_robot, 0.05), load_scenario("Polishing").machining
    without_ranges = replace(machining, joint_ranges_deg={})
    with pytest.raises(InputError, match=r"j1 of chain turns by 5\.73 deg.*keeps 5 deg") as error:
        posture_problem(robot, None, without_ranges, "scenario")
    assert "joint_ranges_deg" not in str(error.value)


def test_a_workpiece_that_is_not_there_is_reported(sts):
    scenario = short("Polishing")
    plan = make_machining_path(scenario, sts)
    away = shifted(scenario.workpiece, plan.path.p_WS[0], -0.05, [0.0, 0.0])
    _, signals = run(replace(scenario, workpiece=away), sts, plan, duration=2.2)
    assert signals["fault"][-1, 0] == Fault.NOTHING_TOUCHED
    assert signals["phase"][-1, 0] == Phase.DONE
    assert np.all(signals["normal"] == 0.0)
