"""Signals that hold each value for some rows: found, told with what mends it, and thinned."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.held_samples import HeldSignals, RowThinning, held_signals
from wrenchsight.models.recordings.recording import Recording, concatenated
from wrenchsight.models.recordings.recording_reader import RecordingReader, read_recording
from wrenchsight.models.recordings.recording_writer import write_recording
from wrenchsight.models.robot.robot import Robot

STEP, SIZE = 0.01, 1200
NAMES = ("q", "v", "current")


def moving() -> Recording:
    """Six joints that turn to and fro, at other rates each; currents have noise."""
    t = STEP * np.arange(SIZE)
    rate = 2.0 * np.pi * np.array([0.11, 0.13, 0.17, 0.19, 0.23, 0.29])
    angle = t[:, None] * rate
    noise = 0.01 * np.random.default_rng(3).normal(size=angle.shape)
    q = np.round(0.4 * np.sin(angle), 4)
    return Recording(t, q, 0.4 * rate * np.cos(angle), 1.0 + np.cos(angle) + noise, "log.csv")


def held(log: Recording, rows: np.ndarray, *names: str) -> Recording:
    """The log with the signals of other rows, one for each row of the log."""
    return replace(log, **{name: getattr(log, name)[rows] for name in names})


def each(num_rows: int) -> np.ndarray:
    return np.arange(SIZE) // num_rows * num_rows


def test_signals_that_are_held_are_found() -> None:
    log = moving()
    assert held_signals(log, NAMES) is None
    assert held_signals(held(log, each(10), *NAMES), NAMES) == HeldSignals(NAMES, 10)
    assert held_signals(held(log, each(10), "current"), NAMES) == HeldSignals(("current",), 10)
    assert held_signals(held(log, each(2), "current"), NAMES) == HeldSignals(("current",), 2)
    # Two clocks: values of 9, 10 or 11 rows.
    rng = np.random.default_rng(1)
    begins = np.cumsum(rng.integers(9, 12, SIZE // 8))
    begins = np.concatenate([[0], begins[begins < SIZE]])
    jittering = begins[np.searchsorted(begins, np.arange(SIZE), side="right") - 1]
    found = held_signals(held(log, jittering, *NAMES), NAMES)
    assert found is not None
    assert found.num_rows == 10


def test_an_encoder_that_changes_seldom_is_not_held() -> None:
    """One joint that turns by a step of its encoder every tenth row."""
    log = moving()
    q = np.zeros_like(log.q)
    q[:, 2] = 1e-3 * (np.arange(SIZE) // 10)
    slow = replace(log, q=q, v=np.full_like(q, 0.01), current=np.zeros_like(q))
    assert held_signals(slow, NAMES) is None
    assert held_signals(replace(slow, q=np.zeros_like(q)), NAMES) is None  # at rest


@pytest.mark.parametrize("size", [SIZE, 7])
def test_one_row_of_each_value_is_kept_whatever_the_chunks(size: int) -> None:
    log = moving()
    late = np.maximum(each(10) - 3, 0)  # values change at rows 10, 20, ... and are of 3 before
    thinning = RowThinning(10, ("current",))
    repeated = held(log, late, "current")
    chunks = [thinning.kept(repeated[k : k + size]) for k in range(0, SIZE, size)]
    kept = concatenated(chunks)
    np.testing.assert_array_equal(kept.t, log.t[::10])
    np.testing.assert_array_equal(kept.current, log.current[late[::10]])
    np.testing.assert_array_equal(kept.q, log.q[::10])
    assert RowThinning(10).kept(log).num_samples == SIZE // 10
    assert RowThinning(1).kept(log) is log


def test_a_row_is_kept_at_rest_too() -> None:
    log = moving()
    rows = each(10)
    rows[400:600] = 400  # nothing changes for two seconds
    kept = RowThinning(10, ("current",)).kept(held(log, rows, "current"))
    assert np.diff(kept.t).max() < 0.16


def test_the_remedy_works_when_it_is_followed(ur10e: Robot, tmp_path: Path) -> None:
    log = moving()
    path, description = tmp_path / "log.csv", tmp_path / "log.yaml"
    write_recording(held(log, each(10), *NAMES), path)
    # The positions stand, and then jump: the row is not to be removed.
    fast = replace(log, q=8.0 * log.q, v=8.0 * log.v)
    write_recording(held(fast, each(10), *NAMES), tmp_path / "fast.csv")
    with pytest.raises(InputError, match=r"repeated for 10 rows.*--log-format keep-every=10"):
        read_recording(tmp_path / "fast.csv", None, ur10e)
    notice = next(x for x in RecordingReader(path, None, ur10e).notices if "repeated" in x)
    assert "positions, velocities and currents is repeated for 10 rows" in notice
    assert "gives 10 samples a second, the log 100" in notice
    word = notice.partition("--log-format ")[2]
    columns = {"time": "t", "position": "q{1..6}", "velocity": "v{1..6}", "current": "i{1..6}"}
    lines = [f'{key}: {{columns: "{names}"}}' for key, names in columns.items()]
    description.write_text("\n".join([*lines, "keep_every: 10"]))
    for log_format in (word, description):
        thinned = read_recording(path, log_format, ur10e, check=False)
        np.testing.assert_allclose(thinned.t, log.t[::10], atol=1e-9)
        np.testing.assert_allclose(thinned.q, log.q[::10], atol=1e-9)
        assert not any("repeated" in x for x in thinned.notices)
    description.write_text("\n".join(lines))
    described = next(x for x in RecordingReader(path, description, ur10e).notices if "repeat" in x)
    assert described.endswith("set keep_every: 10 in the description")


@pytest.mark.parametrize("word", ["keep-every=0", "keep-every=ten"])
def test_a_number_of_rows_is_a_whole_one(tmp_path: Path, word: str) -> None:
    write_recording(moving(), tmp_path / "log.csv")
    with pytest.raises(InputError, match=r"keep-every.*is no number of rows"):
        read_recording(tmp_path / "log.csv", word)
