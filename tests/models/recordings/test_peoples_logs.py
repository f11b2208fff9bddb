"""Logs in shapes that public reports describe: one motion of a UR10e, as many drivers write it.

They lie in `../shared/cases` beside the repository; without them the tests are skipped.
"""

from pathlib import Path

import numpy as np
import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.hypotheses.judgement import refuse_faulty
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.robot.robot import Robot

CASES = Path(__file__).parents[4] / "shared" / "cases"


def _case(name: str) -> Path:
    found = sorted(CASES.glob(f"{name}*"))
    if not found:
        pytest.skip(f"no case {name} in {CASES}")
    return found[0]


# case, file, word of --log-format, what a notice says
_READ = [
    ("02", "record.csv", None, "effort holds no gravity torque"),
    ("05", "record.csv", "rate_hz=100", "the time is counted in rows, 100 a second"),
    ("08", "joint_states.csv", None, "in the robot's order by the names in the rows"),
    ("09", "log.mcap", "joints-in-robot-order", "joints without names are taken as shoulder_pan"),
    ("11", "log.mcap", None, "the velocities stand still while the joints move (all)"),
    ("14", "log.mcap", None, "repeat another one with its stamp: 30"),
    (
        "17",
        "joint_states_with_names.parquet",
        None,
        "in the robot's order by the names in the rows",
    ),
    ("30", "log.mcap", None, "joints read from the columns of /dynamic_joint_states"),
    ("44", "log.mcap", None, 'joints are matched apart from "robot1_"'),
]


@pytest.mark.parametrize(("case", "file", "word", "notice"), _READ)
def test_one_motion_is_read_from_each_shape(
    ur10e: Robot, case: str, file: str, word: str | None, notice: str
) -> None:
    recording = read_recording(_case(case) / file, word, ur10e, check=False)
    assert any(notice in sentence for sentence in recording.notices), recording.notices
    t = recording.t - recording.t[0]
    # All joints follow one course from home: that of the first one, as case 02 logs it.
    course = read_recording(_case("02") / "record.csv", None, ur10e, check=False)
    seconds = course.t - course.t[0]
    inside = t <= seconds[-1]
    for j in range(6):
        expected = np.interp(t[inside], seconds, course.q[:, j])
        np.testing.assert_allclose(recording.q[inside, j], expected, rtol=0, atol=2e-3)
        change = np.interp(t[inside], seconds, course.v[:, j])
        assert np.sqrt(np.mean((recording.v[inside, j] - change) ** 2)) < 0.01  # rad/s


def test_states_of_a_franka_client_are_external_torque() -> None:
    recording = read_recording(_case("03") / "log.csv", None, Robot.load("panda"))
    assert recording.time_step == pytest.approx(0.01)
    assert recording.extra["tau_ext"].shape == (recording.num_samples, 7)
    assert any("time is read in ms" in sentence for sentence in recording.notices)


def test_external_torque_as_effort_is_told_from_motor_torque() -> None:
    recording = read_recording(_case("18") / "log.mcap", None, Robot.load("panda"), check=False)
    assert any("effort holds no gravity torque" in sentence for sentence in recording.notices)


@pytest.mark.parametrize(
    ("case", "file", "words"),
    [
        ("05", "record.csv", r"has no column of time.*--log-format rate_hz=100"),
        ("09", "log.mcap", r"/joint_states: the messages name no joints.*joints-in-robot-order"),
    ],
)
def test_what_cannot_be_known_is_asked_for(ur10e: Robot, case: str, file: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_recording(_case(case) / file, None, ur10e)


def test_per_mille_of_rated_torque_are_told_without_gains_to_copy(ur10e: Robot) -> None:
    recording = read_recording(_case("21") / "free.csv", None, ur10e)
    # A gain that is fitted to one log is up to half off where friction prevails.
    remedy = r"rated torque in N m .*data sheet.*unit: per mille, gain: \[RATED TORQUES\]"
    with pytest.raises(InputError, match=remedy):
        refuse_faulty([recording], ur10e)
