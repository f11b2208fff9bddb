from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wrenchsight.diagrams.scenario import (
    BladeConfig,
    FourierMotion,
    HoldMotion,
    JointSineMotion,
    LineMotion,
    MachiningConfig,
    Scenario,
    bundled_scenarios,
    check_scenario,
    load_scenario,
    make_trajectory,
)
from wrenchsight.models.control.wrench_script import HandPush
from wrenchsight.models.estimation.estimator import WrenchEstimatorConfig
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.machining.machining_phases import PhasesConfig
from wrenchsight.models.machining.machining_process import ProcessConfig
from wrenchsight.models.observers.kalman_observer import KalmanObserverConfig
from wrenchsight.models.robot.robot import Robot
from wrenchsight.systems.impedance_controller import ForceControlConfig, ImpedanceConfig


@pytest.mark.parametrize("name", sorted(bundled_scenarios()))
def test_every_bundled_scenario_fits_its_robot(name):
    scenario = load_scenario(name)
    assert scenario.description
    trajectory = make_trajectory(scenario, Robot.load(scenario.robot))
    assert np.all(np.isfinite(trajectory.vdot))


def test_one_of_everything_has_everything():
    scenario = load_scenario("OneOfEverything")
    assert isinstance(scenario.controller, ImpedanceConfig)
    assert scenario.controller.force is not None
    assert scenario.workpiece is not None
    assert scenario.floor
    assert scenario.friction == "full"
    assert scenario.current_noise
    assert scenario.force_torque_sensor is not None
    assert scenario.force_torque_sensor.force_noise_sd > 0
    assert any(isinstance(segment, HandPush) for segment in scenario.wrench)


def write(folder: Path, text: str) -> str:
    path = folder / "mine.yaml"
    path.write_text(text)
    return str(path)


def test_a_file_of_ones_own(tmp_path):
    path = write(tmp_path, "Mine: {duration: 2.5, motion: !HoldMotion {q: [0.1]}}\n")
    assert load_scenario(path).duration == 2.5
    assert load_scenario(path, "Mine").motion == HoldMotion(q=[0.1])


@pytest.mark.parametrize(
    ("text", "name", "words"),
    [
        ("A: {duratoin: 1.0}", None, 'line 1.*"duratoin".*did you mean "duration"'),
        ("A: {motion: !LineMotin {}}", None, "LineMotin"),
        ("A: {}\nB: {}", None, "A, B"),
        ("A: {}", "Aa", "Aa"),
        ("A: {duration: -1.0}", None, "duration"),
        ("A: {time_step: 0.1}", None, "time_step"),
        ("A: {friction: fulll}", None, 'did you mean "full"'),
        ("A: {seed: -1}", None, "seed"),
        ("A: {feedback: ear}", None, "feedback"),
        ("A: {workpiece: {size: [1.0, 1.0]}}", None, "three numbers"),
        ("A: {workpiece: {size: [1.0, 1.0, -0.1]}}", None, "negative"),
        ("A: {workpiece: {stiffness: 0.0}}", None, "stiffness"),
        ("A: {controller: !ImpedanceConfig {force: {}}}", None, "sensor"),
        ("A: [1, 2]", None, "line 1"),
    ],
)
def test_a_wrong_scenario_is_one_line(tmp_path, text, name, words):
    path = write(tmp_path, text)
    with pytest.raises(InputError, match=words) as error:
        load_scenario(path, name)
    assert "mine.yaml" in str(error.value)
    assert "\n" not in str(error.value)


def test_unknown_bundled_name():
    with pytest.raises(InputError, match='did you mean "Default"'):
        load_scenario("Defalt")


def test_missing_file(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        load_scenario(str(tmp_path / "none.yaml"))


def test_force_control_may_feed_back_the_estimate_without_a_sensor():
    controller = ImpedanceConfig(force=ForceControlConfig())
    check_scenario(Scenario(controller=controller, feedback="estimate"))


def test_hold_stays_at_home_unless_told_otherwise(sts):
    trajectory = make_trajectory(Scenario(), sts)
    q, v, _ = trajectory.sample(1.0)
    np.testing.assert_array_equal(q, sts.home)
    np.testing.assert_array_equal(v, 0)


def test_joint_sines_are_consistent_and_start_at_rest(sts):
    motion = JointSineMotion(
        amplitude=[0.2, 0.1, 0.15, 0.3, 0.2, 0.4], frequency=[0.5], phase=[0.7], ramp=1.0
    )
    trajectory = make_trajectory(Scenario(duration=3.0, motion=motion), sts)
    q, v, vdot = trajectory.sample(0.0)
    np.testing.assert_allclose(q, sts.home, atol=1e-15)
    np.testing.assert_allclose(v, 0, atol=1e-15)
    np.testing.assert_allclose(vdot, 0, atol=1e-12)
    t, h = np.linspace(0.01, 2.9, 57), 1e-5
    before, here, after = (trajectory.sample(t + d) for d in (-h, 0.0, h))
    np.testing.assert_allclose((after[0] - before[0]) / (2 * h), here[1], atol=1e-7)
    np.testing.assert_allclose((after[1] - before[1]) / (2 * h), here[2], atol=1e-4)
    expected = sts.home + np.array(motion.amplitude) * np.sin(np.pi * 2.0 + 0.7)
    np.testing.assert_allclose(trajectory.sample(2.0)[0], expected, atol=1e-12)


@pytest.mark.parametrize("passes", [1, 2, 3])
def test_line_goes_there_and_back(sts, passes):
    R_WE = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]
    motion = LineMotion([0.0, 2.0, 0.0], [0.35, 0.0, 0.3], R_WE, 0.2, 1.0, passes, 0.5)
    trajectory = make_trajectory(Scenario(motion=motion), sts)
    assert trajectory.t[0] == 0.5
    assert trajectory.t[-1] == pytest.approx(0.5 + passes)
    assert np.all(np.diff(trajectory.t) > 1e-6)
    for time, y in ((0.0, -0.1), (1.5, 0.1), (2.5, -0.1), (3.5, 0.1)):
        R, p = sts.chain.pose(trajectory.sample(min(time, 0.5 + passes))[0])
        if time <= 0.5 + passes:
            np.testing.assert_allclose(p, [0.35, y, 0.3], atol=1e-7)
            np.testing.assert_allclose(R, R_WE, atol=1e-7)
    # No jump of the position, nor of the velocity, where one pass meets the next.
    q, v, _ = trajectory.sample(np.arange(0.4, 0.6 + passes, 1e-3))
    assert np.abs(np.diff(q, axis=0)).max() < 2e-3
    assert np.abs(np.diff(v, axis=0)).max() < 0.02


def test_line_through_home_by_default(sts):
    trajectory = make_trajectory(
        Scenario(motion=LineMotion(one_way=1.0, path_length=0.1, start=0.0)), sts
    )
    R, p = sts.chain.pose(trajectory.sample(0.5)[0])
    R_home, p_home = sts.chain.pose(sts.home)
    np.testing.assert_allclose(p, p_home, atol=1e-7)
    np.testing.assert_allclose(R, R_home, atol=1e-7)


@pytest.mark.parametrize(
    ("motion", "words"),
    [
        (HoldMotion(q=[0.1, 0.2]), "6 joints"),
        (HoldMotion(q=[9.0]), "beyond its limits"),
        (JointSineMotion(amplitude=[5.0]), "beyond its limits"),
        (JointSineMotion(ramp=0.0), "ramp"),
        (LineMotion(time_law="third"), 'did you mean "thirds"'),
        (LineMotion(one_way=0.0), r"motion\.one_way: 0\.0, expected above 0"),
        (LineMotion(passes=0), r"motion\.passes: 0, expected 1 or more"),
        (LineMotion(start=-1.0), r"motion\.start: -1\.0, expected 0 or more"),
        (LineMotion(path_length=5.0), "reach"),
    ],
)
def test_a_motion_that_the_robot_cannot_do_is_one_line(sts, motion, words):
    with pytest.raises(InputError, match=words) as error:
        make_trajectory(replace(Scenario(), motion=motion), sts)
    assert "\n" not in str(error.value)


def test_a_fourier_motion_is_its_series_over_whole_periods(sts):
    sine, cosine = [[0.1, 0.02]] * 6, [[0.0, 0.03]] * 6
    motion = FourierMotion(0.5, sts.home.tolist(), sine, cosine, 2)
    trajectory = make_trajectory(Scenario(motion=motion), sts)
    assert trajectory.duration == pytest.approx(4.0)
    t = 1.3
    w = np.pi
    expected = 0.1 * np.sin(w * t) + 0.02 * np.sin(2 * w * t) + 0.03 * np.cos(2 * w * t)
    np.testing.assert_allclose(trajectory.sample(t)[0] - sts.home, expected, atol=1e-9)
    with pytest.raises(InputError, match="6 joints"):
        make_trajectory(Scenario(motion=FourierMotion(0.5, [0.0], [[0.1]], [[0.1]])), sts)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"workpiece": None}, "there is no workpiece"),
        ({"controller": ImpedanceConfig()}, "needs impedance control with a force"),
        ({"workpiece": BladeConfig(modulus=0.0)}, "modulus"),
        ({"machining": MachiningConfig(one_way=-1.0)}, "one_way"),
        ({"machining": MachiningConfig(start=[0.5])}, "u and v"),
        ({"machining": MachiningConfig(process=ProcessConfig(lag=0.0))}, "lag"),
        ({"machining": MachiningConfig(phases=PhasesConfig(rise=0.0))}, "rise"),
    ],
)
def test_machining_that_cannot_be_is_refused(changes, words):
    scenario = replace(load_scenario("Polishing"), **changes)
    with pytest.raises(InputError, match=words):
        check_scenario(scenario)


def test_a_lead_in_is_the_end_of_a_way_back(sts):
    motion = LineMotion(path_length=0.1, one_way=2.0, passes=3, start=0.5)
    plain = make_trajectory(Scenario(motion=motion), sts)
    led = make_trajectory(Scenario(motion=replace(motion, lead_in=1.5)), sts)
    assert led.duration == pytest.approx(plain.duration + 1.5)
    t = np.linspace(0.6, 6.4, 30)
    for x, y in zip(led.sample(t + 1.5), plain.sample(t), strict=True):
        np.testing.assert_allclose(x, y, atol=1e-9)
    # Before: the last 1.5 s of the second pass.
    np.testing.assert_allclose(led.sample(1.0)[0], plain.sample(0.5 + 4.0 - 1.0)[0], atol=1e-9)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"lead_in": 3.0}, "lead_in"),
        ({"lead_in": -1.0}, "lead_in"),
        ({"lead_in": 1.0, "passes": 1}, "lead_in"),
        ({"ramp": 0.0}, "ramp"),
        ({"ramp": 0.7}, "ramp"),
    ],
)
def test_a_line_that_cannot_be_timed_is_refused(sts, changes, words):
    motion = replace(LineMotion(path_length=0.1, one_way=2.0), **changes)
    with pytest.raises(InputError, match=words):
        make_trajectory(Scenario(motion=motion), sts)


def test_the_scenario_in_the_documentation_is_one(tmp_path):
    text = (Path(__file__).parents[2] / "docs" / "machining.md").read_text(encoding="utf-8")
    path = tmp_path / "mine.yaml"
    path.write_text(text.split("```yaml\n")[1].split("```")[0], encoding="utf-8")
    scenario = load_scenario(str(path))
    # As the bundled one, but for the path's ends and the rounded place.
    bundled = load_scenario("Polishing")
    assert scenario.machining.process == bundled.machining.process
    assert scenario.controller.force == bundled.controller.force
    assert scenario.feedback == "sensor"


@pytest.mark.parametrize("change", [{"ramp": 0.0}, {"ramp": np.nan}, {"air_pass": -0.001}])
def test_a_machining_number_out_of_range_is_one_line(change):
    scenario = load_scenario("Polishing")
    wrong = replace(scenario, machining=replace(scenario.machining, **change))
    with pytest.raises(InputError, match=f"machining.{next(iter(change))}"):
        check_scenario(wrong)


@pytest.mark.parametrize("method", ["damped", "truncated"])
def test_an_observer_that_reads_the_wrench_itself_needs_a_prior(method):
    estimator = WrenchEstimatorConfig(
        KalmanObserverConfig(), WrenchReconstructionConfig(method=method)
    )
    scenario = replace(load_scenario("Default"), estimator=estimator)
    with pytest.raises(InputError, match=f"method: is {method}, .* kalman observer has no prior"):
        check_scenario(scenario)
    check_scenario(replace(scenario, estimator=WrenchEstimatorConfig(KalmanObserverConfig())))


def test_an_observer_that_reads_the_wrench_itself_takes_no_air_pass():
    scenario = load_scenario("Polishing")
    scenario = replace(scenario, estimator=WrenchEstimatorConfig(KalmanObserverConfig()))
    assert scenario.machining is not None
    with pytest.raises(InputError, match="air_pass: corrects joint torques, but the kalman"):
        check_scenario(scenario)
    check_scenario(replace(scenario, machining=replace(scenario.machining, air_pass=0.0)))


def test_paths_in_a_scenario_are_relative_to_its_file(tmp_path, monkeypatch):
    folder = tmp_path / "cell"
    folder.mkdir()
    (folder / "scenarios.yaml").write_text("Mine: {robot: arms/robot.yaml}\n")
    monkeypatch.chdir(tmp_path)  # which has no arms
    scenario = load_scenario("cell/scenarios.yaml", "Mine")
    assert Path(scenario.robot) == Path("cell/arms/robot.yaml")
    assert load_scenario("Default").robot == "sts_sre4_600"  # a bundled name stays one


def test_an_observer_of_another_period_is_refused():
    estimator = WrenchEstimatorConfig()
    estimator.observer.time_step = 0.004
    with pytest.raises(InputError, match=r"time_step.*0\.004 s.*0\.001 s; leave it out"):
        check_scenario(Scenario(estimator=estimator))
    check_scenario(replace(Scenario(), time_step=0.002))  # not written: the scenario's
