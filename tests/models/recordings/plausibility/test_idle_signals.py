"""What a driver does not fill is no measurement; what it measures stays."""

from pathlib import Path

import numpy as np
import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.plausibility.idle_signals import constant, unfilled
from wrenchsight.models.recordings.recording_reader import RecordingReader, read_recording

ROWS = 200
T = 0.01 * np.arange(ROWS)
Q = np.c_[np.sin(T), np.cos(T)]


def _log(tmp_path: Path, current: np.ndarray) -> Path:
    path = tmp_path / "log.csv"
    names = "t,q1,q2,v1,v2,i1,i2"
    np.savetxt(path, np.c_[T, Q, np.cos(T), -np.sin(T), current], delimiter=",", header=names,
               comments="", fmt="%.17g")  # fmt: skip
    return path


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ([2.89e-321, 1.04e224], "hold numbers such as 2.89e-321: memory that the driver never"),
        ([0.0, 1.04e224], "hold numbers such as 1.04e\\+224: memory that the driver never"),
        ([87.0, 12.0], "stay the same while the joints move \\(87, 12\\)"),
    ],
)
def test_currents_that_the_driver_does_not_fill_are_left_out(
    tmp_path: Path, row: list[float], words: str
) -> None:
    path = _log(tmp_path, np.tile(row, (ROWS, 1)))
    reader = RecordingReader(path)
    with pytest.raises(InputError, match=f"its currents {words}.*; have the driver fill them"):
        reader.require_joint_signals()
    assert reader.layout.signal("current") is None


def test_the_unit_of_an_effort_that_is_left_out_is_no_question(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    effort = np.tile([2.89e-321, 1.04e224], (ROWS, 1))
    names = "time,position_1,position_2,effort_1,effort_2"
    np.savetxt(path, np.c_[T, Q, effort], delimiter=",", header=names, comments="", fmt="%.17g")
    notices = RecordingReader(path).notices
    assert any("the torques are left out: they hold numbers such as" in text for text in notices)
    assert not any("effort is read" in text for text in notices)


def test_a_few_numbers_beyond_any_robot_are_told_with_their_row(tmp_path: Path) -> None:
    current = 1.0 + Q
    current[50, 1] = 1.04e224
    with pytest.raises(InputError, match=r"line 52, i2: 1.04e\+224 is beyond any robot"):
        read_recording(_log(tmp_path, current))


def test_small_large_and_constant_numbers_are_measurements() -> None:
    values = np.c_[1e-30 * Q[:, 0], 1e9 * Q[:, 1]]
    assert unfilled(values) == ""
    assert constant(values) == ""
    assert constant(np.tile([0.0, 0.0], (ROWS, 1))) == ""  # what gravity is there for says more
    assert constant(np.tile([1.0, 2.0], (20, 1))) == ""  # too short


@pytest.mark.parametrize(("rows_each", "is_noted"), [(1, False), (2, True), (10, True)])
def test_samples_that_a_logger_repeats_are_noted(
    tmp_path: Path, rows_each: int, is_noted: bool
) -> None:
    """As one that reads at 100 Hz what its source renews at 10 Hz."""
    t = 0.01 * np.arange(1000)
    held = t[np.arange(1000) // rows_each * rows_each]
    signals = np.c_[np.sin(held), np.cos(held), np.cos(held), -np.sin(held), 1 + held, 2 + held]
    path = tmp_path / "log.csv"
    np.savetxt(path, np.c_[t, signals], delimiter=",", header="t,q1,q2,v1,v2,i1,i2", comments="")
    notices = [x for x in RecordingReader(path).notices if "stay the same" in x]
    words = f"for {rows_each} rows each: their source gives {100 / rows_each:.3g} samples a second"
    assert bool(notices) == is_noted
    assert not is_noted or words in notices[0]


def test_rows_that_repeat_at_rest_are_no_held_samples(tmp_path: Path) -> None:
    """An encoder's step, and a joint that stands for a while."""
    t = 0.01 * np.arange(1000)
    q = np.round(np.where(t < 5.0, np.sin(t), np.sin(5.0)), 2)
    path = tmp_path / "log.csv"
    signals = np.c_[q, q, 0 * q, 0 * q, 10 * q, 10 * q]
    np.savetxt(path, np.c_[t, signals], delimiter=",", header="t,q1,q2,v1,v2,i1,i2", comments="")
    assert not any("stay the same for" in notice for notice in RecordingReader(path).notices)


@pytest.mark.parametrize("begin", [45292.5, 739253.5])
def test_time_in_days_is_read(tmp_path: Path, begin: float) -> None:
    """As spreadsheets and MATLAB count dates; a step of 1e-7 is no other unit's."""
    path = tmp_path / "log.csv"
    log = np.c_[begin + T / 86400.0, Q, np.cos(T), -np.sin(T), Q]
    np.savetxt(path, log, delimiter=",", header="t,q1,q2,v1,v2,i1,i2", comments="", fmt="%.17g")
    reader = RecordingReader(path)
    t = np.concatenate([chunk.t for chunk in reader.chunks()])
    np.testing.assert_allclose(t - t[0], T, rtol=0, atol=2e-5)  # what a double of days resolves
    assert any("time is read in days" in notice for notice in reader.notices)
