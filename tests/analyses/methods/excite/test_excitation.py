"""The command excite: trajectory, files, figures to reach, bad input."""

import json
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

from wrenchsight.analyses.__main__ import app
from wrenchsight.analyses.methods.excite import excitation
from wrenchsight.analyses.methods.excite.excitation import (
    RETREAT_SHARES,
    SOLVE_RESERVES,
    _Candidate,
    _candidates,
    _first_within_limits,
    excite,
    excite_robot,
)
from wrenchsight.analyses.methods.excite.excitation_config import ExcitationConfig
from wrenchsight.diagrams.distances.clearance import Clearance
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.least_motion import LEAST_TRAVEL
from wrenchsight.models.planning.excitation.excitation_limits import ExcitationLimits
from wrenchsight.models.planning.excitation.excitation_program import (
    ExcitationProgram,
    ExcitationSolution,
    MotionBounds,
    NoTrajectoryError,
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
    # Nor is there a motion nearby that keeps the limits.
    monkeypatch.setattr(ExcitationProgram, "nearest_within_limits", lambda self, motion: motion)
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


class LineProgram:
    """Of one joint that stands at its centre: solves end 10 rad on, the limits 2 rad below that."""

    def solve(self, start, iterations, watch):
        end = FourierTrajectory(0.1, start.centre + 10.0, [[0.0]], [[0.0]])
        return ExcitationSolution(end, self.cost(end), "snopt 31", 1)

    def nearest_within_limits(self, trajectory):
        return FourierTrajectory(0.1, trajectory.centre - 2.0, [[0.0]], [[0.0]])

    def cost(self, trajectory):
        return abs(float(trajectory.centre[0]) - 8.0)


def test_the_ways_back_are_tried_from_all_ends_and_the_best_first():
    """A poor end, or a poor random motion, is not what is left of four searches."""
    starts = [FourierTrajectory(0.1, [float(k)], [[0.0]], [[0.0]]) for k in (1, 2, 3)]
    programs = [LineProgram() for _ in SOLVE_RESERVES]
    candidates = list(_candidates(programs, starts, ExcitationConfig(), lambda *_: None))
    # The first end, 11, costs 3, less than the best random motion's 7; what is nearest to it, 9,
    # costs 1. The second solve goes on from there, to 19. No later end costs less than that 1.
    centres = [float(candidate.trajectory.centre[0]) for candidate in candidates]
    assert centres[0] == 11.0
    assert {19.0, 12.0, 13.0} <= set(centres[1:])
    assert len(centres) == 4 + len(programs) * len(RETREAT_SHARES)
    costs = [abs(centre - 8.0) for centre in centres[1:]]
    assert (np.diff(costs) > -1e-9).all()
    assert costs[0] < 0.4  # on the way to one of 9, 17, 10 and 11
    ends = {float(candidate.solution.trajectory.centre[0]) for candidate in candidates}
    assert ends == {11.0, 19.0, 12.0, 13.0}


def swing(sts, amplitude, last):
    """A motion of all joints by `amplitude`, rad, but the last one's."""
    shape = np.full((6, 2), [amplitude, -amplitude])
    shape[-1] = [last, -last]
    return FourierTrajectory(0.1, sts.home, shape, np.zeros((6, 2)))


@pytest.mark.parametrize(
    ("beyond", "expected", "looked_at"),
    [
        ((), 2, [2]),  # the first that moves each joint enough; no other is checked
        ((2,), 3, [2, 3]),
        ((2, 3, 0), 1, [2, 3, 0, 1]),  # none of these keeps the limits: one that moves less
    ],
)
def test_a_motion_in_which_each_joint_moves_enough_is_preferred(
    sts, monkeypatch, beyond, expected, looked_at
):
    """`identify` refuses a log in which a joint hardly moves."""
    motions = [swing(sts, 0.2, 0.01), swing(sts, 0.1, 0.0), swing(sts, 0.2, 0.1), swing(sts, 1, 1)]
    checked = []

    def check(robot, clearance, solution, trajectory, time_step):
        checked.append(motions.index(trajectory))
        is_clear = checked[-1] not in beyond
        return SimpleNamespace(is_clear=is_clear, torque=np.zeros(6), trajectory=trajectory)

    monkeypatch.setattr(excitation, "_checked", check)
    candidates = [_Candidate(None, motion) for motion in motions]
    bounds = MotionBounds.of_robot(sts, ExcitationLimits())
    taken = _first_within_limits(sts, None, bounds, candidates, 0.01)
    assert motions.index(taken.trajectory) == expected
    assert checked == looked_at


def test_joints_that_move_too_little_for_identify_are_named_with_what_to_do(sts):
    limits = ExcitationLimits(velocity_share=4e-3)
    config = ExcitationConfig(limits=limits, num_starts=1, iterations=1, time_step=0.01)
    result = excite(sts, config)
    (still,) = [warning for warning in result.warnings if "too little for `identify`" in warning]
    named = dict(re.findall(r"(joint_\d) by ([0-9.e-]+) rad", still))
    t = np.linspace(0.0, result.trajectory.period, 2001)
    travel = np.ptp(result.trajectory.sample(t)[0], axis=0)
    slow = {name for name, x in zip(sts.joint_names, travel, strict=True) if x < 1.5 * LEAST_TRAVEL}
    assert named and slow <= named.keys()
    for name, text in named.items():
        assert float(text) == pytest.approx(travel[sts.joint_names.index(name)], rel=0.1)
    assert "more --starts and --iterations" in still


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
    with pytest.raises(
        InputError, match=r"too near each other in random postures are .* in \d+ %"
    ) as error:
        excite(sts, QUICK)
    assert f"the floor (now {sts.floor:g} m: floor in robot.yaml" in str(error.value)
    assert "--no-floor where none is near" in str(error.value)


def test_a_motion_that_torque_alone_forbids_names_the_joint_and_its_torque(sts, monkeypatch):
    def refuses(*_):
        raise NoTrajectoryError("torque", 61)

    monkeypatch.setattr(ExcitationProgram, "random_feasible", refuses)
    message = r"gravity takes up to .* N m at joint_\d, which has .* a larger --torque-share"
    with pytest.raises(InputError, match=message):
        excite(sts, QUICK)
