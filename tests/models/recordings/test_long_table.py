"""A row for each joint or signal becomes a row for each sample."""

import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.recording_reader import read_recording

_T = 0.01 * np.arange(40)
_Q = np.round(np.sin(_T[:, None] + np.arange(3)), 6)
_I = np.round(1.0 + _Q**2, 6)
_JOINTS = ("shoulder_pan_joint", "elbow_joint", "wrist_1_joint")
_ROBOT = SimpleNamespace(
    name="arm",
    num_joints=3,
    joint_names=_JOINTS,
    q_offset=np.zeros(3),
    velocity_limit=np.full(3, np.inf),
    position_lower=np.full(3, -np.inf),
    position_upper=np.full(3, np.inf),
    chain=SimpleNamespace(prismatic=np.zeros(3, bool)),
)


def _by_joint(names: list[str] | list[int], key: str = "joint") -> pd.DataFrame:
    """A row a joint, the joints in another order than the robot's."""
    return pd.DataFrame(
        [(t, names[j], _Q[k, j], _I[k, j]) for k, t in enumerate(_T) for j in (1, 0, 2)],
        columns=["time", key, "position [rad]", "current"],
    )


def _by_signal() -> pd.DataFrame:
    signals = (("q", _Q), ("i", _I))
    return pd.DataFrame(
        [(t, f"{word}{j + 1}", x[k, j]) for k, t in enumerate(_T) for word, x in signals
         for j in range(3)],
        columns=["timestamp", "signal", "value"],
    )  # fmt: skip


def _by_both() -> pd.DataFrame:
    signals = (("position", _Q), ("current", _I))
    return pd.DataFrame(
        [(t, j + 1, word, x[k, j]) for k, t in enumerate(_T) for word, x in signals
         for j in range(3)],
        columns=["t", "axis", "variable", "value"],
    )  # fmt: skip


@pytest.mark.parametrize(
    "table",
    [lambda: _by_joint(list(_JOINTS)), lambda: _by_joint([1, 2, 3], "Axis ID"),
     lambda: _by_joint(["A1", "A2", "A3"], "name"),
     lambda: _by_joint(["0x141", "0x142", "0x143"], "can_id"),  # type: ignore[list-item]
     lambda: _by_joint([11, 12, 13], "node"),
     lambda: _by_joint([1, 2, 3], "ID").rename(columns={"current": "present motor current"}),
     _by_signal, _by_both],
    ids=["names", "numbers", "axes", "addresses", "nodes", "measured", "signals",
         "joints-and-signals"],
)  # fmt: skip
@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_rows_of_one_stamp_are_a_sample(
    tmp_path: Path, table: Callable[[], pd.DataFrame], kind: str
) -> None:
    path = tmp_path / f"log.{kind}"
    frame = table()
    frame.to_csv(path, index=False) if kind == "csv" else frame.to_parquet(path)
    log = read_recording(path, None, _ROBOT, check=False)  # type: ignore[arg-type]
    np.testing.assert_allclose(log.t, _T, atol=1e-12)
    np.testing.assert_array_equal(log.q, _Q)
    np.testing.assert_array_equal(log.current, _I)
    assert any("turned into a row a sample" in notice for notice in log.notices)


def test_joints_with_stamps_of_their_own_are_interpolated(tmp_path: Path) -> None:
    frame = _by_joint(list(_JOINTS))
    frame["time"] += 1e-4 * (np.arange(len(frame)) % 3)
    path = tmp_path / "log.csv"
    frame.to_csv(path, index=False)
    log = read_recording(path, None, _ROBOT, check=False)  # type: ignore[arg-type]
    inner = slice(2, -2)
    now = np.sin(log.t[inner, None] + np.arange(3) - 1e-4 * np.array([1, 0, 2]))
    np.testing.assert_allclose(log.q[inner], now, atol=1e-4)


def test_two_rows_of_one_joint_and_stamp_are_refused(tmp_path: Path) -> None:
    frame = pd.concat([_by_joint(list(_JOINTS)), _by_joint(list(_JOINTS))[:1]])
    path = tmp_path / "log.csv"
    frame.to_csv(path, index=False)
    with pytest.raises(InputError, match="two rows of elbow_joint with one stamp"):
        read_recording(path, None, _ROBOT)  # type: ignore[arg-type]


def test_a_time_of_too_many_digits_is_refused(tmp_path: Path) -> None:
    frame = _by_joint(list(_JOINTS))
    frame["time"] = [10**23 if k == 7 else k // 3 for k in range(len(frame))]
    path = tmp_path / "log.csv"
    frame.to_csv(path, index=False)
    with pytest.raises(InputError, match="column time: has a time that is no number"):
        read_recording(path, None, _ROBOT)  # type: ignore[arg-type]


def test_a_name_that_does_not_change_is_no_joint(tmp_path: Path) -> None:
    columns = {"t": _T, "name": "arm 7"}
    columns |= {f"q{j + 1}": _Q[:, j] for j in range(3)} | {f"i{j + 1}": _I[:, j] for j in range(3)}
    path = tmp_path / "log.csv"
    pd.DataFrame(columns).to_csv(path, index=False)
    np.testing.assert_array_equal(read_recording(path).q, _Q)


def _message(k: int, j: int) -> dict[str, Any]:
    """A JointState of one joint."""
    stamp = {"sec": 1, "nanosec": 10_000_000 * k}
    return {
        "header": {"stamp": stamp},
        "name": [_JOINTS[j]],
        "position": [_Q[k, j]],
        "current": [_I[k, j]],
    }


@pytest.mark.parametrize(
    "line",
    [
        _message,
        lambda k, j: {"t": _T[k], "id": j + 1, "state": {"pos": _Q[k, j], "cur": _I[k, j]}},
        lambda k, j: {
            "t": _T[k],
            "topic": f"/arm/{_JOINTS[j]}",
            "msg": {"position": _Q[k, j], "current": _I[k, j]},
        },
    ],
)
def test_objects_of_one_joint_each_are_joined(
    tmp_path: Path, line: Callable[[int, int], dict[str, Any]]
) -> None:
    path = tmp_path / "log.jsonl"
    lines = [json.dumps(line(k, j)) for k in range(len(_T)) for j in (1, 0, 2)]
    path.write_text("\n".join(lines) + "\n")
    log = read_recording(path, None, _ROBOT, check=False)  # type: ignore[arg-type]
    np.testing.assert_array_equal(log.q, _Q)
    np.testing.assert_array_equal(log.current, _I)
