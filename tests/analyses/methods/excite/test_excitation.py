"""The command excite: trajectory, files, figures to reach, bad input."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from wrenchsight.analyses.__main__ import app
from wrenchsight.analyses.methods.excite.excitation import (
    RETREAT_SHARES,
    SOLVE_RESERVES,
    _candidates,
    excite,
    excite_robot,
)
from wrenchsight.analyses.methods.excite.excitation_config import ExcitationConfig
from wrenchsight.diagrams.distances.clearance import Clearance
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.planning.excitation.excitation_limits import ExcitationLimits
from wrenchsight.models.planning.excitation.excitation_program import (
    ExcitationProgram,
    ExcitationSolution,
)
from wrenchsight.models.planning.excitation.fourier_trajectory import FourierTrajectory
from wrenchsight.models.robot.robot import Robot


@pytest.mark.slow
def test_the_figures_to_reach(sts):
    result = excite(sts)
    assert result.condition_number < 10.0  # an excitation is called good below 60 to 100
    assert result.unweighted_condition_number < 30.0
    assert result.ratio_to_random > 5.0
    assert result.num_parameters == 58 and result.undetermined == ()
    assert result.warnings == ()
    # Samples keep all of the clearance, the motion between them half of it (`Clearance.certify`).
    if result.closest is not None:
        assert result.closest.distance > 0.5 * result.config.limits.clearance


@pytest.mark.slow
def test_files_and_their_content(sts, tmp_path):
    config = ExcitationConfig(num_starts=2, iterations=20)
    first, second = excite_robot("sts_sre4_600", tmp_path, config)
    assert np.abs(first.trajectory.sine - second.trajectory.sine).max() > 0.01
    for name in ("trajectory", "validation"):
        assert (tmp_path / f"{name}.html").stat().st_size > 1e6
        assert (tmp_path / "figures" / f"{name}.png").is_file()
    assert (tmp_path / "config.yaml").is_file()
    table = np.loadtxt(tmp_path / "trajectory.csv", delimiter=",", skiprows=1)
    header = (tmp_path / "trajectory.csv").read_text().splitlines()[0].split(",")
    assert header[:2] == ["t", "q1"] and header[-1] == "vdot6" and len(header) == 19
    stops = first.trajectory.stops
    assert stops.number == 2 and stops.rest == config.stop_time
    duration = 10.0 + stops.number * (stops.rest + stops.ramp)  # s, at 1 kHz
    assert table.shape == (round(1000.0 * duration) + 1, 19)
    series = FourierTrajectory.load(tmp_path / "trajectory.yaml", sts.name)
    motion = series.joint_trajectory(config.num_periods, config.time_step)  # with its stops
    expected = np.column_stack([motion.t, motion.q, motion.v, motion.vdot])
    np.testing.assert_allclose(table, expected, rtol=1e-7, atol=1e-7)
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    assert metrics["condition_number"] == pytest.approx(first.condition_number)
    assert metrics["validation"]["condition_number"] == pytest.approx(second.condition_number)
    assert (np.array(metrics["peak_torque_share"]) < 0.7).all()


def test_where_the_solver_ends_beyond_the_limits_the_way_back_is_gone(sts, monkeypatch):
    """Where it ends is a matter of the last bits: on another processor each end may collide."""
    checked = []

    def beyond(self, start, iterations, watch):
        checked.append(start)
        end = FourierTrajectory(
            start.base_frequency, start.centre, 3 * start.sine, 3 * start.cosine
        )
        return ExcitationSolution(end, 0.0, "snopt 32", 1)

    monkeypatch.setattr(ExcitationProgram, "solve", beyond)
    result = excite(sts, ExcitationConfig(num_starts=2))
    assert len(checked) == len(SOLVE_RESERVES)
    # Of either random motion, the first and the last: a stretched one, shorter than any end.
    sine = result.trajectory.sine
    begins = [checked[0].sine, checked[-1].sine]
    stretches = [float((sine * begin).sum() / (begin * begin).sum()) for begin in begins]
    gaps = [float(np.abs(sine - s * b).max()) for s, b in zip(stretches, begins, strict=True)]
    assert min(gaps) < 1e-9
    assert 1.0 <= stretches[int(np.argmin(gaps))] < 2.9
    assert result.closest is None or result.closest.slack > 0.0
    assert (result.peak_torque_share <= 0.7).all()


def test_the_ways_back_are_tried_from_all_ends_and_the_best_first():
    """A poor end, or a poor random motion, is not what is left of four searches."""
    starts = [FourierTrajectory(0.1, [float(k)], [[0.0]], [[0.0]]) for k in (1, 2, 3)]

    class Program:
        def solve(self, start, iterations, watch):
            end = FourierTrajectory(0.1, start.centre + 10.0, [[0.0]], [[0.0]])
            return ExcitationSolution(end, self.cost(end), "snopt 31", 1)

        def cost(self, trajectory):
            return abs(float(trajectory.centre[0]) - 8.0)  # best on the way to the first end

    programs = [Program() for _ in SOLVE_RESERVES]
    candidates = list(_candidates(programs, starts, ExcitationConfig(), lambda *_: None))
    # The first random motion costs 7: the second end, at 21, costs more, and waits its turn.
    ends, ways_back = candidates[:3], candidates[3:]
    assert [float(end.trajectory.centre[0]) for end in ends] == [11.0, 12.0, 13.0]
    assert len(ways_back) == 1 + len(programs) * len(RETREAT_SHARES)
    assert float(ways_back[-1].trajectory.centre[0]) == 21.0
    costs = [Program().cost(way.trajectory) for way in ways_back]
    assert costs == sorted(costs)
    assert float(ways_back[0].trajectory.centre[0]) == 8.0
    assert {float(way.solution.trajectory.centre[0]) for way in ways_back} == {11, 21, 12, 13}


def test_a_motion_too_slow_to_determine_inertias_is_reported(sts):
    limits = ExcitationLimits(acceleration=[2e-3], velocity_share=1e-3)
    result = excite(sts, ExcitationConfig(limits=limits, num_starts=1, iterations=2))
    assert any("Ixx" in name or "Izz" in name for name in result.undetermined)
    assert any("undetermined" in warning for warning in result.warnings)
    (poor,) = [warning for warning in result.warnings if "parameters poorly" in warning]
    assert f"{result.unweighted_condition_number:.3g} in `identify`" in poor


@pytest.mark.parametrize(
    ("config", "message"),
    [
        (ExcitationConfig(measure="cond"), "measure"),
        (ExcitationConfig(num_harmonics=1), "num_harmonics"),
        (ExcitationConfig(base_frequency=0.0), "base_frequency"),
        (ExcitationConfig(limits=ExcitationLimits(floor=0.6)), "floor: 0.6 m lies above"),
    ],
)
def test_bad_settings_are_one_line(sts, config, message):
    with pytest.raises(InputError, match=message) as error:
        excite(sts, config)
    assert "\n" not in str(error.value)


def test_the_command_line_ends_in_one_line(tmp_path):
    arguments = ["excite", "--robot", "sts_sre4_600", "--position-margin", "3", "--out"]
    result = CliRunner().invoke(app, [*arguments, str(tmp_path)])
    assert result.exit_code == 2
    assert not (tmp_path / "metrics.json").exists()


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("--clearance", "1"),
        ("--clearance", "nan"),
        ("--position-margin", "-3"),
        ("--velocity-share", "1e9"),
        ("--torque-share", "1.5"),
        ("--floor", "nan"),
        ("--acceleration", "1e9"),
        ("--base-frequency", "1e308"),
        ("--periods", "100000000"),
    ],
)
def test_a_limit_that_cannot_be_kept_is_refused(tmp_path, option, value):
    arguments = ["excite", "--robot", "sts_sre4_600", option, value, "--out", str(tmp_path / "out")]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 1
    assert "expected" in result.stderr or "at most" in result.stderr
    assert not (tmp_path / "out").exists()


def test_pairs_closer_than_the_requested_clearance_are_named(sts):
    near = dict(Clearance(sts, 0.1).near_at_home)
    assert all(0.0 < selected < 0.1 for selected in near.values())
    assert len(near) >= len(Clearance(sts, 0.02).near_at_home)


QUICK = ExcitationConfig(num_starts=1, iterations=2, time_step=0.01)


def test_efforts_that_cannot_hold_the_arm_are_named_with_what_gravity_takes(sts):
    weak = [replace(drive, effort_limit=1.0) for drive in sts.config.drives]
    q = np.random.default_rng(5).uniform(-3.0, 3.0, (2000, 6))
    most = np.abs(sts.chain.gravity_torque(q)).max()
    with pytest.raises(InputError, match=r"cannot hold .* up.*state effort_limit") as error:
        excite(sts.with_drives(weak), QUICK)
    stated = float(re.search(r"takes up to ([0-9.]+) N m", str(error.value))[1])
    assert stated == pytest.approx(most, rel=0.1)  # of two sets of postures


def test_an_arm_without_inertias_has_a_motion_too(serial_robot):
    joints = [("revolute", axis, "0 0 .3") for axis in ("0 0 1", "0 1 0", "0 1 0")]
    robot = serial_robot(joints)
    bare = Robot(robot.config, robot.source, robot._urdf)
    bare._urdf.inertia_fault = InputError("arm.urdf", "line 3", "no inertia")
    bare.__dict__["chain"] = robot.chain.with_inertial_parameters(np.zeros((3, 10)))
    result = excite(bare, QUICK)
    assert any("torque of the motion is not checked" in warning for warning in result.warnings)
    assert result.num_parameters == excite(serial_robot(joints), QUICK).num_parameters


def test_the_shapes_that_leave_no_room_are_named(sts, monkeypatch):
    monkeypatch.setattr(Clearance, "smooth_slack", lambda self, q: (-1.0, np.zeros(6)))
    with pytest.raises(InputError, match=r"too near each other in random postures are .* in \d+ %"):
        excite(sts, QUICK)
