"""npz and Parquet files of other tools, recognised by the names of their arrays."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

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
    assert is_effort == (torque == "efforts")


def test_a_plain_header_may_call_the_time_otherwise(tmp_path: Path) -> None:
    """A plain header with "time" in place of t."""
    path = tmp_path / "log.csv"
    rows = [f"{t:.3f},1,0.5,2" for t in _T]
    path.write_text("\n".join(["time,q1,v1,i1", *rows]) + "\n")
    np.testing.assert_allclose(read_recording(path).t, _T)
