import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wrenchsight.analyses.methods.simulate.simulate_settings import SimulateSettings
from wrenchsight.analyses.methods.simulate.simulation import (
    known_model,
    simulate,
    simulate_scenario,
)
from wrenchsight.analyses.output.result_marker import visible_files
from wrenchsight.diagrams.distances.clearance import ClosestPair
from wrenchsight.diagrams.distances.machining_way import Overlap
from wrenchsight.diagrams.scenario import HoldMotion, JointSineMotion, Scenario, load_scenario
from wrenchsight.models.control.wrench_script import WrenchStep
from wrenchsight.models.estimation.estimator import WrenchEstimator
from wrenchsight.models.files.configuration import save_configuration
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.machining.machining_phases import Fault, Phase
from wrenchsight.models.planning.excitation.fourier_trajectory import FourierTrajectory
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.truth_config import SimulatedTruthConfig
from wrenchsight.models.truth.true_joints import TrueJoints
from wrenchsight.systems.joint_tracking_controller import JointTrackingConfig


def run(out, **settings):
    """The command without its page."""
    return simulate_scenario(SimulateSettings(record=False, **settings), out)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """One run of a bundled scenario, shortened, with everything that it writes."""
    out = tmp_path_factory.mktemp("simulation") / "out"
    steps = []
    settings = SimulateSettings(duration_s=0.5, graph=True)
    result = simulate_scenario(settings, out, lambda share, message: steps.append((share, message)))
    return result, out, steps


def test_the_command_writes_all_its_files(written):
    result, out, steps = written
    names = {name for name, _ in visible_files(out)}
    drawing = "diagram.svg" if "diagram.svg" in names else "diagram.dot"
    assert names == {
        "metrics.json",
        "config.yaml",
        "scenario.yaml",
        "log.csv",
        "recording.html",
        "figures/wrench.png",
        drawing,
    }
    assert {str(path.relative_to(out)) for path in result.files} == names
    fractions = [fraction for fraction, _ in steps]
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
    assert result.real_time_factor > 0
    assert any("--model" in notice for notice in result.notices)


def test_metrics_file_is_the_result(written):
    result, out, _ = written
    metrics = json.loads((out / "metrics.json").read_text())
    assert metrics["num_samples"] == 501
    error = result.wrench - result.wrench_true
    assert metrics["rmse_fz_n"] == pytest.approx(np.sqrt(np.mean(error[:, 5] ** 2)))
    assert metrics["rmse_mx_nm"] == pytest.approx(np.sqrt(np.mean(error[:, 0] ** 2)))
    sensor = result.ft_wrench - result.wrench_true
    assert metrics["sensor"]["max_error_fy_n"] == pytest.approx(np.abs(sensor[:, 4]).max())
    tracking = result.q - result.reference[:, :6]
    expected = np.sqrt(np.mean(tracking**2, axis=0))
    np.testing.assert_allclose(metrics["tracking_rmse_rad"], expected)
    assert not any("time" in key for key in metrics)  # nothing of the machine's speed


def test_the_written_log_can_be_estimated(written):
    result, out, _ = written
    sts = Robot.load("sts_sre4_600")
    log = read_recording(out / "log.csv", robot=sts)
    np.testing.assert_array_equal(log.q, result.q)
    np.testing.assert_array_equal(log.current, result.current)
    np.testing.assert_array_equal(
        log.extra["wrench_true"], result.wrench_true[:, [3, 4, 5, 0, 1, 2]]
    )
    model = known_model(sts, result.scenario)
    estimator = WrenchEstimator(sts, model, result.scenario.estimator)
    batch = estimator.run(estimator.initial_state(), log.q, log.v, log.current)
    np.testing.assert_allclose(batch.wrench, result.wrench, atol=1e-9)
    np.testing.assert_allclose(batch.covariance, result.covariance, atol=1e-9)


def test_its_scenario_file_runs_again_to_the_same_metrics(written, tmp_path):
    _, out, _ = written
    run(tmp_path, scenario=f"{out / 'scenario.yaml'}:Default")
    again = (tmp_path / "metrics.json").read_bytes()
    assert again == (out / "metrics.json").read_bytes()
    assert not (tmp_path / "recording.html").exists()


def test_figure_shows_truth_estimate_band_and_sensor(written):
    result, _, _ = written
    figure = result.figure()
    assert len(figure.axes) == 6
    assert figure.axes[0].get_ylabel() == "f$_x$ [N]"
    labels = {text.get_text() for text in figure.legends[0].get_texts()}
    assert labels == {"true", "estimated", "95 % band", "sensor", "not valid"}
    figure.clear()


def test_the_estimate_follows_the_applied_wrench(sts):
    """Noise-free, with the true model: within 0.1 N and 0.02 N m."""
    result = simulate(replace(load_scenario("ConstantWrench"), duration=1.0), sts)
    error = np.abs(result.wrench[-1] - result.wrench_true[-1])
    np.testing.assert_array_equal(result.wrench_true[-1], [0.5, 1.5, 1.0, -3, 0, 25])
    assert error[3:].max() < 0.1
    assert error[:3].max() < 0.02
    assert result.ft_wrench is None
    assert result.pose_error is None
    with pytest.raises(ValueError, match="controls no force"):
        result.pressing_force()


def test_impedance_run_has_its_signals(sts):
    result = simulate(replace(load_scenario("OneOfEverything"), duration=0.3), sts)
    assert result.pose_error.shape == (301, 6)
    assert result.force_setpoint.shape == (301,)
    np.testing.assert_array_equal(result.pressing_force(), result.wrench_true[:, 5])
    assert {"pose_rmse_m", "force_control_rmse_n"} <= result.metrics().keys()


def test_another_robot_with_a_model_from_a_file(ur10e, tmp_path):
    model = replace(IdentifiedModel.nominal(ur10e), residual_covariance=np.diag(np.full(6, 0.01)))
    model.save(tmp_path / "model.yaml")
    model = str(tmp_path / "model.yaml")
    result = run(
        tmp_path / "out", scenario="ConstantWrench", robot="ur10e", model=model, duration_s=0.6
    )
    assert result.robot.name == "ur10e"
    assert not any("--model" in notice for notice in result.notices)
    np.testing.assert_allclose(result.wrench[-1], result.wrench_true[-1], atol=0.1)


def test_a_robot_without_a_tool_runs_without_the_sensor(tmp_path):
    result = run(tmp_path, robot="ur10e", duration_s=0.1)
    assert result.ft_wrench is None
    assert any("no tool" in notice for notice in result.notices)
    with pytest.raises(InputError, match="feeds back a sensor"):
        run(tmp_path, scenario="OneOfEverything", robot="ur10e", duration_s=0.1)


def test_a_station_with_a_free_body_runs(tmp_path):
    station = Path(__file__).parents[4] / "examples" / "station" / "station.yaml"
    result = run(tmp_path, scenario=str(station), duration_s=0.1)
    assert result.t[-1] == pytest.approx(0.1)


def test_quick_is_short(tmp_path):
    result = run(tmp_path, scenario="ConstantWrench", quick=True)
    assert result.t[-1] == pytest.approx(1.0)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["Polishing", "GrindingSensorless"])
def test_a_machining_scenario_runs_to_its_end(tmp_path, name):
    result = run(tmp_path / "out", scenario=name, quick=True)
    assert result.fault == Fault.NONE
    assert result.phase[-1] == Phase.DONE
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text())["machining"]
    assert metrics["fault"] == "none"
    # There and back in a second each.
    assert metrics["work_s"] == pytest.approx(2.0, abs=0.01)
    # Fifteen times faster than the experiments.
    assert metrics["normal_force_rmse_n"] < 20.0
    assert metrics["max_normal_force_n"] < 100.0


def test_known_model_is_exact_where_the_law_can_be(sts):
    assert not known_model(sts, Scenario(friction="none")).friction.torque(np.ones(6)).any()
    # Stiction equal to Coulomb, no load, no ripple: a Coulomb-viscous joint at any velocity.
    for motion in (JointSineMotion(), HoldMotion()):
        law = known_model(sts, Scenario(friction="coulomb_viscous", motion=motion)).friction
        expected = sts.truth.coulomb + sts.truth.viscous * 0.5
        np.testing.assert_allclose(law.torque(np.full(6, 0.5)), expected, rtol=1e-9)


def test_known_model_fits_the_true_curve_over_the_motion(sts):
    motion = JointSineMotion(amplitude=[0.3], frequency=[0.3])
    scenario = Scenario(friction="full", motion=motion, duration=10.0)
    law = known_model(sts, scenario).friction
    v = np.linspace(0.05, 0.5, 50)[:, None] * np.ones(6)
    truth = TrueJoints.of(sts, 1e-3).sliding_torque(v, sts.chain.gravity_torque(sts.home))
    error = np.abs(law.torque(v) - truth).mean(axis=0)
    without = np.abs(sts.truth.coulomb + sts.truth.viscous * v - truth).mean(axis=0)
    assert np.all(error < 0.6 * without)
    assert np.all(law.coulomb_viscous.viscous >= 0)


def test_a_motion_that_diverges_is_one_line(sts):
    scenario = Scenario(
        duration=1.0,
        friction="none",
        motion=JointSineMotion(),
        controller=JointTrackingConfig(kp=[4e6], kd=[1.0]),
        wrench=[WrenchStep(force=[1e6, 1e6, 1e6], moment=[1e6, 0, 0])],
    )
    with pytest.raises(InputError, match=r"diverges before 0\.1 s") as error:
        simulate(scenario, sts)
    assert "\n" not in str(error.value)


def test_unknown_scenario_leaves_nothing(tmp_path):
    with pytest.raises(InputError, match="there is no scenario"):
        run(tmp_path / "out", scenario="Everything")
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_machining_without_a_sensor_uses_the_correction_of_an_air_pass(sts):
    scenario = load_scenario("PolishingSensorless")
    machining = replace(scenario.machining, one_way=4.0)
    scenario = replace(scenario, machining=machining)
    result = simulate(scenario, sts)
    assert result.fault == Fault.NONE
    # Valid is what the plan calls steady: at work, and not at the ends and the turn.
    assert np.all(result.phase[result.valid] == Phase.WORK)
    assert 0.2 < result.valid.mean() < 0.5
    metrics = result.metrics()
    direction = -sts.chain.pose(result.q)[0][:, :, 2]
    pushed, read = (
        np.sum(force[:, 3:] * direction, axis=1) for force in (result.wrench_true, result.wrench)
    )
    # Four times faster than in the study's fastest feed, where it is .3 N.
    assert np.sqrt(np.mean((read - pushed)[result.valid] ** 2)) < 4.0
    for axis in ("fx", "fy", "fz"):
        assert metrics["valid"][f"max_error_{axis}_n"] <= metrics[f"max_error_{axis}_n"]
    untaught = simulate(replace(scenario, machining=replace(machining, air_pass=0.0)), sts)
    assert untaught.valid.mean() > 0.9  # it does not know what it does not know


@pytest.mark.long
def test_a_pass_after_an_air_pass_states_the_vibration_of_the_tool(sts):
    scenario = load_scenario("Grinding")
    machining = replace(scenario.machining, one_way=1.0, passes=1)
    result = simulate(replace(scenario, machining=machining), sts)
    vibration = result.metrics()["machining"]["tool_vibration_m_per_s"]
    assert 0.0 < vibration < 0.1
    assert vibration == np.median(result.tool_vibration[result.phase == Phase.WORK])


@pytest.mark.long
def test_a_collision_of_the_planned_pass_is_noted(sts, monkeypatch):
    scenario = load_scenario("Polishing")
    machining = replace(scenario.machining, one_way=2.0, ramp=0.5, air_pass=0.0)
    scenario = replace(scenario, machining=machining, duration=0.02)

    def at_the_lift(robot, plan, phases, workpiece):
        assert (robot, phases, workpiece) == (sts, machining.phases, scenario.workpiece)
        return (Overlap("lift", ClosestPair("link_3", "workpiece", -0.012, -0.012, 0.0)),)

    monkeypatch.setattr("wrenchsight.analyses.methods.simulate.simulation.overlaps", at_the_lift)
    (notice,) = [text for text in simulate(scenario, sts).notices if "overlaps" in text]
    assert notice.startswith("the lift overlaps: link_3 and workpiece by 12 mm")


def test_the_motion_that_excite_found_is_run_and_nothing_touches_the_arm(sts, tmp_path):
    t = np.arange(0.0, 1.0, 0.001)
    sine, cosine = [[0.2, -0.1]] * 6, [[-0.2, 0.2]] * 6
    motion = FourierTrajectory(1.0, sts.home, np.array(sine), np.array(cosine))
    path = tmp_path / "trajectory.yaml"
    save_configuration(motion.coefficients(sts.name), path)
    result = run(tmp_path / "out", robot=sts.name, motion=str(path), duration_s=0.3)
    assert result.scenario.wrench == [] and result.scenario.workpiece is None
    assert np.abs(result.wrench_true).max() == 0.0
    planned = motion.sample(result.t)[0]
    assert np.ptp(planned, axis=0).min() > 0.1 and t[-1] > result.t[-1]
    # A servo that lags behind dry friction as it starts, rad; the motion spans at least 0.1.
    np.testing.assert_allclose(result.q, planned, atol=0.03)
    save_configuration(motion.coefficients("another"), path)
    with pytest.raises(InputError, match="made for 'another', not for 'sts_sre4_600'"):
        run(tmp_path / "b", robot=sts.name, motion=str(path))


def test_a_failure_of_linear_algebra_is_not_blamed_on_the_scenario(tmp_path, monkeypatch):
    """It is a ValueError for numpy, as that of a block which refuses its parameters is."""

    def fails(*_, **__):
        raise np.linalg.LinAlgError("Singular matrix")

    monkeypatch.setattr("wrenchsight.analyses.methods.simulate.simulation.simulate", fails)
    with pytest.raises(np.linalg.LinAlgError, match="Singular matrix"):
        run(tmp_path / "out")


def test_an_arm_without_masses_moves_with_those_that_its_truth_assumes(tmp_path):
    robot = Robot.load("ur5e")
    text = (robot.source.parent / robot.config.urdf).read_text()
    urdf = re.sub(r"<inertial>.*?</inertial>", "", text, flags=re.DOTALL)
    (tmp_path / "arm.urdf").write_text(urdf)
    truth = replace(robot.config.simulated_truth, link_masses=[4.0, 8.0, 2.3, 1.2, 1.2, 0.2])
    for name, its_truth in (("bare", SimulatedTruthConfig()), ("heavy", truth)):
        config = replace(robot.config, urdf=tmp_path / "arm.urdf", simulated_truth=its_truth)
        save_configuration(config, tmp_path / f"{name}.yaml")
    result = run(tmp_path / "out", robot=str(tmp_path / "heavy.yaml"), duration_s=0.1)
    assert np.isfinite(result.q).all()
    holding = np.abs(result.robot.chain.gravity_torque(result.q)).max(axis=0)
    assert holding[1] > 10.0  # N m at the shoulder
    with pytest.raises(InputError, match="or state link_masses, kg, under simulated_truth"):
        run(tmp_path / "refused", robot=str(tmp_path / "bare.yaml"), duration_s=0.1)
