"""npz and Parquet files of other tools, recognised by the names of their arrays."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.recording_reader import read_recording

_ROWS = 30
_T = 0.01 * np.arange(_ROWS)
_ARRAYS = np.random.default_rng(1).normal(size=(4, _ROWS, 2))


@pytest.mark.parametrize(
    ("time", "position", "velocity", "torque"),
    [
        ("times", "positions", "velocities", "torques"),
        ("timestamps", "qpos", "qvel", "tau"),
        ("t", "joint_positions", "joint_velocities", "efforts"),
        ("time", "q", "v", "tau_J"),
        ("time", "qpos", "qvel", "Efforts"),
    ],
)
@pytest.mark.parametrize("kind", ["npz", "parquet"])
def test_arrays_are_recognised_by_their_usual_names(
    tmp_path: Path, kind: str, time: str, position: str, velocity: str, torque: str
) -> None:
    q, v, tau, other_signal = _ARRAYS
    arrays = {time: _T, "other": other_signal, position: q, velocity: v, torque: tau}
    path = tmp_path / f"log.{kind}"
    if kind == "npz":
        np.savez(path, **arrays)  # type: ignore[arg-type]
    else:
        columns = {k: pa.array(x.tolist() if x.ndim > 1 else x) for k, x in arrays.items()}
        pq.write_table(pa.table(columns), path)
    log = read_recording(path)
    np.testing.assert_array_equal(log.t, _T)
    np.testing.assert_array_equal(log.q, q)
    np.testing.assert_array_equal(log.v, v)
    np.testing.assert_array_equal(log.tau_J, tau)
    np.testing.assert_array_equal(log.extra["other"], other_signal)
    is_effort = any("effort is read as joint torque" in text for text in log.notices)
    assert is_effort == (torque.lower() == "efforts")


def test_a_plain_header_may_call_the_time_otherwise(tmp_path: Path) -> None:
    """A plain header with "time" in place of t."""
    path = tmp_path / "log.csv"
    rows = [f"{t:.3f},1,0.5,2" for t in _T]
    path.write_text("\n".join(["time,q1,v1,i1", *rows]) + "\n")
    np.testing.assert_allclose(read_recording(path).t, _T)


@pytest.mark.parametrize("kind", ["parquet", "rostopic"])
def test_joints_that_the_rows_name_are_put_in_the_robots_order(tmp_path: Path, kind: str) -> None:
    """As a table of JointStates in Parquet, and as `rostopic echo -p` writes them."""
    values = np.random.default_rng(5).normal(size=(30, 6)).round(6)
    stamps = 1_700_000_000_000_000_000 + 10_000_000 * np.arange(30)
    names = ["elbow", "shoulder"]
    if kind == "parquet":
        path = tmp_path / "log.parquet"
        columns: dict[str, Any] = {"time": 0.01 * np.arange(30), "name": [names] * 30}
        for k, quantity in enumerate(("position", "velocity", "effort")):
            columns[quantity] = list(values[:, 2 * k : 2 * k + 2])
        pq.write_table(pa.table(columns), path)
    else:
        path = tmp_path / "log.csv"
        fields = [f"field.{f}{j}" for f in ("name", "position", "velocity", "effort")
                  for j in range(2)]  # fmt: skip
        header = ["%time", "field.header.seq", "field.header.stamp", "field.header.frame_id"]
        lines = [",".join([*header, *fields])]
        for k, (stamp, row) in enumerate(zip(stamps, values, strict=True)):
            cells = [str(stamp + 500), str(k), str(stamp), "", *names, *map(repr, row.tolist())]
            lines.append(",".join(cells))
        path.write_text("\n".join(lines) + "\n")
    robot = SimpleNamespace(
        has_inertias=False,
        is_coupled=False,
        name="two",
        num_joints=2,
        joint_names=("shoulder", "elbow"),
        torque_per_ampere=np.ones(2),
        current_sign=np.ones(2),
        motor_current=lambda tau_J: tau_J,
        q_offset=np.zeros(2),
        velocity_limit=np.full(2, np.inf),
        position_lower=np.full(2, -np.inf),
        position_upper=np.full(2, np.inf),
        chain=SimpleNamespace(prismatic=np.zeros(2, bool)),
    )
    recording = read_recording(path, robot=robot, check=False)  # type: ignore[arg-type]
    np.testing.assert_array_equal(recording.q, values[:, [1, 0]])
    np.testing.assert_array_equal(recording.v, values[:, [3, 2]])
    np.testing.assert_array_equal(recording.tau_J, values[:, [5, 4]])
    np.testing.assert_allclose(np.diff(recording.t), 0.01, atol=1e-6)
    if kind == "rostopic":
        lines[2] = lines[2].replace("elbow,shoulder", "shoulder,elbow")
        path.write_text("\n".join(lines) + "\n")
        with pytest.raises(InputError, match="line 3: names shoulder, elbow, but the first row"):
            read_recording(path, robot=robot)  # type: ignore[arg-type]


def test_an_effort_in_amperes_does_not_take_the_place_of_currents(tmp_path: Path) -> None:
    t = 0.01 * np.arange(50)
    q = np.sin(t[:, None] + np.arange(3))
    path = tmp_path / "log.npz"
    np.savez(path, t=t, positions=q, velocities=np.gradient(q, t, axis=0), currents=q, efforts=-q)
    log = read_recording(path, "effort-in-amperes", check=False)
    np.testing.assert_array_equal(log.current, q)
    assert log.tau_J is None
    assert "the effort is left out: the log has currents of its own" in log.notices
