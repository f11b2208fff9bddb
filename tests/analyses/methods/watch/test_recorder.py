"""Recordings that are whole at any time."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from wrenchsight.analyses.methods.watch import recorder as module
from wrenchsight.analyses.methods.watch.recorder import Recorder
from wrenchsight.models.estimation.wrench_bag import WrenchBagWriter, read_wrench_bag
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.live.reading import Reading


def rows(robot, count, start=0.0, step=0.002):
    rng = np.random.default_rng(1)
    ring_rows = []
    for k in range(count):
        root = rng.normal(size=(6, 6))
        reading = Reading.of(
            rng.normal(size=6),
            root @ root.T,
            rng.normal(size=6),
            robot.home,
            t=start + k * step,
        )
        ring_rows.append(reading.row)
    return ring_rows


@pytest.fixture(autouse=True)
def _often(monkeypatch):
    monkeypatch.setattr(module, "SAVE_TIME", 0.0)
    monkeypatch.setattr(module, "SEGMENT_TIME", 0.5)


def test_a_recording_is_what_estimate_writes(ur10e, tmp_path):
    taken = rows(ur10e, 700)
    recorder = Recorder(tmp_path / "rec", ur10e)
    for k in range(0, 700, 90):
        assert recorder.take(taken[k : k + 90]) == ""
        t, _ = read_wrench_bag(tmp_path / "rec")  # whole at any time
        assert len(t) == min(700, k + 90)
    assert recorder.close() == ""
    t, wrench = read_wrench_bag(tmp_path / "rec")
    np.testing.assert_allclose(t, [row[0] for row in taken], atol=1e-9)
    np.testing.assert_array_equal(wrench, [Reading(row).wrench for row in taken])
    assert len(list((tmp_path / "rec").glob("*.mcap"))) == 3

    alone = tmp_path / "alone.mcap"
    readings = [Reading(row) for row in taken[:250]]
    with WrenchBagWriter(alone, ur10e.config.base_link) as bag:
        bag.write(
            np.array([r.t for r in readings]),
            np.array([r.wrench for r in readings]),
            np.array([r.covariance for r in readings]),
            ur10e.chain.pose(np.array([r.q for r in readings]))[1],
        )
    assert (tmp_path / "rec/wrench_00000.mcap").read_bytes() == alone.read_bytes()


def test_a_long_recording_is_saved_as_quickly_as_a_short_one(ur10e, tmp_path, monkeypatch):
    """Each second writes the newest file; what it says of thousands of others is not done anew."""
    recorder = Recorder(tmp_path / "rec", ur10e)
    taken = rows(ur10e, 40, step=1.0)  # each in a file of its own
    made: list[object] = []
    dump = module.yaml.safe_dump
    monkeypatch.setattr(
        module.yaml, "safe_dump", lambda x, **more: made.append(x) or dump(x, **more)
    )
    counts = []
    for row in taken:
        before = len(made)
        recorder.take([row])
        counts.append(len(made) - before)
    assert len(list((tmp_path / "rec").glob("*.mcap"))) == 40
    assert max(counts) <= 6
    monkeypatch.undo()
    information = module.yaml.safe_load((tmp_path / "rec/metadata.yaml").read_text())
    bag = information["rosbag2_bagfile_information"]
    assert [file["path"] for file in bag["files"]] == bag["relative_file_paths"]
    assert [file["message_count"] for file in bag["files"]] == [3] * 40
    assert bag["message_count"] == 120
    assert bag["duration"]["nanoseconds"] == 39 * 10**9


def test_parquet_has_the_columns_of_estimate(ur10e, tmp_path):
    from pyarrow import parquet

    from wrenchsight.models.estimation.wrench_table import columns_of

    recorder = Recorder(tmp_path, ur10e, "parquet")
    recorder.take(rows(ur10e, 300))
    recorder.close()
    tables = [parquet.read_table(path) for path in sorted(tmp_path.glob("*.parquet"))]
    assert sum(table.num_rows for table in tables) == 300
    assert tuple(tables[0].column_names) == columns_of(6)


def _full(self, *given):
    raise InputError("x", "", "cannot be written (No space left on device)")


def test_a_full_disk_is_said_once_and_nothing_is_lost(ur10e, tmp_path, monkeypatch):
    recorder = Recorder(tmp_path, ur10e)
    taken = rows(ur10e, 600)
    recorder.take(taken[:100])
    with monkeypatch.context() as patch:
        patch.setattr(WrenchBagWriter, "write", _full)
        assert "No space left" in recorder.take(taken[100:300])
        assert recorder.take(taken[300:500]) == ""
    t, _ = read_wrench_bag(tmp_path)
    assert len(t) == 100
    assert recorder.take(taken[500:]) == "the recording goes on"
    recorder.close()
    t, _ = read_wrench_bag(tmp_path)
    assert len(t) == 600
    assert recorder.lost == 0


def test_readings_lost_to_a_full_disk_are_reported_at_the_end(ur10e, tmp_path, monkeypatch):
    recorder = Recorder(tmp_path, ur10e)
    taken = rows(ur10e, 600)
    recorder.take(taken[:250])
    monkeypatch.setattr(WrenchBagWriter, "write", _full)
    recorder.take(taken[250:])
    assert recorder.close() == "350 readings are not in the recording"
    assert len(read_wrench_bag(tmp_path)[0]) == 250


def test_a_long_full_disk_keeps_earlier_recordings(ur10e, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "MOST_ROWS", 300)
    recorder = Recorder(tmp_path, ur10e)
    taken = rows(ur10e, 900)
    recorder.take(taken[:200])
    with monkeypatch.context() as patch:
        patch.setattr(WrenchBagWriter, "write", _full)
        recorder.take(taken[200:700])  # more than is held
    recorder.take(taken[700:])
    assert recorder.close() == "500 readings are not in the recording"
    t, _ = read_wrench_bag(tmp_path)
    expected = [row[0] for row in (*taken[:200], *taken[700:])]
    np.testing.assert_allclose(t, expected, atol=1e-9)


def test_times_that_ros_cannot_stamp_are_left_out(ur10e, tmp_path):
    recorder = Recorder(tmp_path, ur10e)
    assert "stamp" in recorder.take(rows(ur10e, 100, start=-0.1))
    recorder.close()
    assert recorder.lost == 50
    assert len(read_wrench_bag(tmp_path)[0]) == 50


def test_times_after_the_last_stamp_are_left_out(ur10e, tmp_path):
    """At the sixtieth reading the clock passes 2^31 s."""
    recorder = Recorder(tmp_path, ur10e)
    last = rows(ur10e, 100, start=2.0**31 - 60 * 0.002)
    assert "2147483648 s" in recorder.take(last)
    recorder.close()
    assert len(read_wrench_bag(tmp_path)[0]) == np.sum([row[0] < 2.0**31 for row in last])


def test_a_folder_that_holds_something_is_refused(ur10e, tmp_path):
    (tmp_path / "mine.txt").write_text("x")
    with pytest.raises(InputError, match="not empty"):
        Recorder(tmp_path, ur10e)


_KILLED = """
import sys, time
from pathlib import Path
sys.path.insert(0, "{tests}")
from wrenchsight.analyses.methods.watch import recorder
from wrenchsight.models.robot.robot import Robot
from test_recorder import rows
recorder.SAVE_TIME, recorder.SEGMENT_TIME = 0.0, 0.5
robot = Robot.load("ur10e")
taken = rows(robot, 5000)
made = recorder.Recorder(Path({folder!r}), robot)
made.take(taken[:50])
print("ready", flush=True)
recorder.SAVE_TIME = 0.02
for k in range(50, 5000, 5):
    made.take(taken[k:k + 5])
"""


@pytest.mark.parametrize("seed", range(3))
def test_a_kill_leaves_a_whole_recording(ur10e, tmp_path, seed):
    text = _KILLED.format(tests=Path(__file__).parent, folder=str(tmp_path / "rec"))
    process = subprocess.Popen([sys.executable, "-c", text], stdout=subprocess.PIPE)
    assert process.stdout is not None
    process.stdout.readline()
    time.sleep(np.random.default_rng(seed).uniform(0.05, 0.8))
    process.send_signal(signal.SIGKILL)
    process.wait()
    process.stdout.close()
    t, wrench = read_wrench_bag(tmp_path / "rec")
    assert len(t) > 0
    np.testing.assert_allclose(np.diff(t), 0.002, atol=1e-9)
    expected = [Reading(row).wrench for row in rows(ur10e, len(t))]
    np.testing.assert_array_equal(wrench, expected)
