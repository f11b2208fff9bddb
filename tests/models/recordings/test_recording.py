"""Recordings in memory: shapes, slices, and files that read back what was written."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from wrenchsight.models.recordings.recording import Recording, concatenated
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.recordings.recording_writer import write_recording


def _recording(num_samples: int = 50, num_joints: int = 3) -> Recording:
    rng = np.random.default_rng(4)
    q, v, current, tau_J = rng.normal(size=(4, num_samples, num_joints))
    dropout = np.zeros(num_samples, bool)
    dropout[7:9] = True
    return Recording(
        t=1.7e9 + np.cumsum(rng.uniform(0.005, 0.015, num_samples)),
        q=q,
        v=v,
        current=current,
        source="memory",
        tau_J=tau_J,
        dropout=dropout,
        extra={"file": rng.normal(size=(num_samples, 6))},  # as an argument of numpy.savez
    )


@pytest.mark.parametrize("begin", [0.0, 1.7e9])
@pytest.mark.parametrize("ending", ["csv", "parquet", "npz", "mcap"])
def test_a_written_log_reads_back_exactly(tmp_path: Path, ending: str, begin: float) -> None:
    recording = _recording()
    recording = replace(recording, t=begin + np.round(recording.t - 1.7e9, 6))
    if ending == "mcap":  # which has no flags
        recording = replace(recording, dropout=np.zeros(50, bool))
    path = tmp_path / f"log.{ending}"
    write_recording(recording, path)
    assert list(tmp_path.iterdir()) == [path]
    again = read_recording(path)
    for name in ("t", "q", "v", "current", "tau_J", "dropout"):
        np.testing.assert_array_equal(getattr(again, name), getattr(recording, name))
    np.testing.assert_array_equal(again.extra["file"], recording.extra["file"])


def test_a_written_csv_has_the_documented_columns(tmp_path: Path) -> None:
    plain = replace(_recording(12, 2), tau_J=None, dropout=np.zeros(0, bool), extra={})
    write_recording(plain, tmp_path / "log.csv")
    lines = (tmp_path / "log.csv").read_text().splitlines()
    assert lines[0] == "t,q1,q2,v1,v2,i1,i2"
    expected = np.c_[plain.t, plain.q, plain.v, plain.current]
    written = np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]])
    np.testing.assert_array_equal(written, expected)
    write_recording(plain, tmp_path / "log.parquet")
    assert pq.read_table(tmp_path / "log.parquet").column_names == lines[0].split(",")


def test_slices_join_to_the_whole_recording() -> None:
    recording = _recording()
    joined = concatenated([recording[:20], recording[20:21], recording[21:]])
    for name in ("t", "q", "v", "current", "tau_J", "dropout"):
        np.testing.assert_array_equal(getattr(joined, name), getattr(recording, name))
    assert recording[5:9].num_samples == 4
    assert recording[5:9].dropout.tolist() == [False, False, True, True]
    assert recording.num_joints == 3
    assert recording.duration == recording.t[-1] - recording.t[0]
    assert recording.time_step == np.median(np.diff(recording.t))
    with pytest.raises(ValueError, match="no part"):
        concatenated([])


def test_signals_of_different_shapes_are_refused() -> None:
    recording = _recording()
    with pytest.raises(ValueError, match="one row per time stamp"):
        replace(recording, t=recording.t[:-1])
    with pytest.raises(ValueError, match="one shape"):
        replace(recording, v=recording.v[:, :2])
    with pytest.raises(ValueError, match="one row per time stamp"):
        replace(recording, extra={"x": np.zeros(3)})
