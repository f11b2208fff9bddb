"""Logs of JSON objects, one a line."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings import json_table
from wrenchsight.models.recordings.recording_reader import read_recording

T = 0.01 * np.arange(60)
Q = np.c_[np.sin(T), np.cos(T)]
_TWO_JOINTS = SimpleNamespace(
    name="two",
    num_joints=2,
    joint_names=("shoulder", "elbow"),
    q_offset=np.zeros(2),
    velocity_limit=np.full(2, np.inf),
    position_lower=np.full(2, -np.inf),
    position_upper=np.full(2, np.inf),
    chain=SimpleNamespace(prismatic=np.zeros(2, bool)),
)


def _objects() -> list[dict]:
    return [
        {
            "timestamp": float(t),
            "joint_positions": q.tolist(),
            "joint_velocities": [0, float(t)],  # whole numbers, then others
            "joint_currents": [1, 2],
            "state": {"mode": "AUTO"},
        }
        for t, q in zip(T, Q, strict=True)
    ]


@pytest.mark.parametrize("block", [1 << 22, 400])
def test_objects_are_read_as_rows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: int
) -> None:
    monkeypatch.setattr(json_table, "_BLOCK_BYTES", block)
    path = tmp_path / "log.jsonl"
    path.write_text("\n".join(json.dumps(entry) for entry in _objects()))
    log = read_recording(path)
    np.testing.assert_array_equal(log.t, T)
    np.testing.assert_array_equal(log.q, Q)
    np.testing.assert_array_equal(log.current, np.tile([1.0, 2.0], (60, 1)))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (json.dumps(_objects()[0], indent=2), "holds neither samples nor arrays"),
        ("[[0.0, 0.1], [0.01, 0.2]]", "holds neither samples nor arrays"),
        ('{"t": 0.0, "q": [0.1\n', "cannot be read as JSON"),
        ('{"t": 0.0}\n{"t": [1.0]}\n', "all with the same entries"),
        ("t,q1\n0,1\n", "is no JSON"),
        ("", "is no JSON"),
    ],
)
def test_other_json_is_refused_with_a_remedy(tmp_path: Path, content: str, words: str) -> None:
    path = tmp_path / "log.json"
    path.write_text(content)
    with pytest.raises(InputError) as caught:
        read_recording(path)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "document",
    [
        _objects(),
        {"robot": "two", "samples": _objects()},
        {"t": T.tolist(), "q": Q.tolist(), "i": [[1.0] * 60, [2.0] * 60]},
    ],
    ids=["list", "under-a-key", "arrays"],
)
def test_one_document_is_read(tmp_path: Path, document: Any) -> None:
    """Samples in a list, or arrays over all samples, one of them with a row for each joint."""
    path = tmp_path / "log.txt"  # known by its content
    path.write_text(json.dumps(document, indent=1))
    log = read_recording(path)
    np.testing.assert_array_equal(log.t, T)
    np.testing.assert_array_equal(log.q, Q)
    np.testing.assert_array_equal(log.current, np.tile([1.0, 2.0], (60, 1)))


def test_documents_of_yaml_are_read(tmp_path: Path) -> None:
    path = tmp_path / "log.yaml"
    path.write_text("---\n".join(json.dumps(entry) + "\n" for entry in _objects()))
    log = read_recording(path)
    np.testing.assert_array_equal(log.q, Q)
    path.write_text("- &a [1, 2]\n- *a\n")
    with pytest.raises(InputError, match="aliases"):
        read_recording(path)


def test_yaml_is_known_by_its_content(tmp_path: Path) -> None:
    """Messages of any kind as topic echo prints them into a text file: keys within keys."""
    path = tmp_path / "echo.txt"
    text = ""
    for k, q in enumerate(Q.tolist()):
        text += f"stamp:\n  sec: 7\n  nanosec: {10_000_000 * k}\nmeasured_joints:\n  q: {q}\n"
        text += "  current:\n  - 1e-05\n  - 2\n---\n"  # 1e-05 is a word in YAML 1.1
    path.write_text(text)
    log = read_recording(path)
    np.testing.assert_array_equal(log.q, Q)
    np.testing.assert_array_equal(log.current, np.tile([1e-5, 2.0], (60, 1)))


def test_yaml_may_be_arrays_or_objects_of_one_line(tmp_path: Path) -> None:
    rows = zip(Q.tolist(), range(60), strict=True)
    flow = tmp_path / "flow.txt"
    flow.write_text("".join(f"{{stamp: {{sec: 7, nanosec: {10_000_000 * k}}}, q: {q}, "
                            "current: [1.0, 2.0]}\n---\n" for q, k in rows))  # fmt: skip
    arrays = tmp_path / "arrays.yaml"  # one of which has the name of a key of a description
    lines = "".join(f"- {q}\n" for q in Q.tolist())
    arrays.write_text(f"t: {T.tolist()}\nq:\n{lines}current:\n" + "- [1.0, 2.0]\n" * 60)
    for path in (flow, arrays):
        log = read_recording(path)
        np.testing.assert_array_equal(log.q, Q)
        np.testing.assert_array_equal(log.current, np.tile([1.0, 2.0], (60, 1)))


@pytest.mark.parametrize("suffix", [".yaml", ".txt"])
def test_a_plan_is_no_log(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"plan{suffix}"
    point = "- positions: [0.0, -1.5]\n  effort: []\n  time_from_start:\n    secs: {}\n"
    points = "".join(point.format(k) for k in range(20))
    path.write_text(f"header:\n  seq: 0\njoint_names:\n- a\n- b\npoints:\n{points}")
    with pytest.raises(InputError, match="is a planned trajectory"):
        read_recording(path)


def test_objects_of_joints_are_put_in_the_robots_order(tmp_path: Path) -> None:
    """As a list of objects with a name each, in another order than the robot's."""
    path = tmp_path / "log.json"
    rows = [{"stamp": t, "joints": [{"name": name, "pos": q[j], "current": 1.0 + j}
                                    for name, j in (("elbow", 1), ("shoulder", 0))]}
            for t, q in zip(T.tolist(), Q.tolist(), strict=True)]  # fmt: skip
    path.write_text(json.dumps(rows))
    log = read_recording(path, None, _TWO_JOINTS, check=False)  # type: ignore[arg-type]
    np.testing.assert_array_equal(log.q, Q)
    np.testing.assert_array_equal(log.current, np.tile([1.0, 2.0], (60, 1)))


@pytest.mark.parametrize("kind", ["json", "npz"])
def test_joints_that_a_file_lists_once_are_put_in_the_robots_order(
    tmp_path: Path, kind: str
) -> None:
    arrays = {"t": T, "q": Q[:, ::-1], "i": np.tile([2.0, 1.0], (60, 1))}
    names = ["elbow", "shoulder"]
    path = tmp_path / f"log.{kind}"
    if kind == "npz":
        np.savez(path, joint_names=np.array(names), **arrays)  # type: ignore[arg-type]
    else:
        lists = {name: array.tolist() for name, array in arrays.items()}
        path.write_text(json.dumps({"joint_names": names, "data": lists}))
    log = read_recording(path, None, _TWO_JOINTS, check=False)  # type: ignore[arg-type]
    np.testing.assert_array_equal(log.q, Q)
    np.testing.assert_array_equal(log.current, np.tile([1.0, 2.0], (60, 1)))


_STAMPS = pd.date_range("2024-01-01", periods=60, freq="10ms")


@pytest.mark.filterwarnings("ignore:.*epoch")  # also what older versions of pandas write
@pytest.mark.parametrize("orient", ["split", "columns", "index", "records", "table"])
@pytest.mark.parametrize("index", [None, _STAMPS, T], ids=["counts", "dates", "seconds"])
def test_what_pandas_writes_is_read(tmp_path: Path, orient: Any, index: Any) -> None:
    if orient == "records" and index is not None:
        return  # has no index
    frame = pd.DataFrame(Q, columns=["q1", "q2"])
    frame[["v1", "v2", "i1", "i2"]] = np.c_[Q, Q]
    if index is None:
        frame.insert(0, "t", T)
    else:
        frame.index = pd.Index(index, name="time")
    path = tmp_path / "log.json"
    date_format = "iso" if orient == "table" else "epoch"
    frame.to_json(path, orient=orient, double_precision=15, date_format=date_format)
    log = read_recording(path)
    np.testing.assert_allclose(log.t - log.t[0], T, atol=1e-6)  # stamps since 1970 have 2.4e-7 s
    np.testing.assert_allclose(log.q, Q, atol=1e-14)
    np.testing.assert_allclose(log.current, Q, atol=1e-14)


def _series(is_prometheus: bool) -> list[dict]:
    """A series for each joint and quantity."""
    result = []
    for name in ("joint_position_rad", "joint_current_amperes"):
        for j, x in enumerate(Q.T):
            entry: dict[str, Any] = {
                "metric": {"__name__": name, "job": "arm", "joint": f"{j + 1}"}
            }
            if is_prometheus:
                entry["values"] = [
                    [1700000000 + float(t), str(y)] for t, y in zip(T, x, strict=True)
                ]
            else:
                entry["values"] = x.tolist()
                entry["timestamps"] = [1700000000000 + round(1e3 * t) for t in T]
            result.append(entry)
    return result


@pytest.mark.parametrize("is_prometheus", [False, True])
def test_series_become_columns(tmp_path: Path, is_prometheus: bool) -> None:
    path = tmp_path / "export.json"
    series = _series(is_prometheus)
    if is_prometheus:
        path.write_text(json.dumps({"status": "success", "data": {"result": series}}))
    else:
        path.write_text("\n".join(json.dumps(entry) for entry in series))
    table = json_table.JsonTable(path)
    assert table.names == (
        "t", "1 joint_position_rad", "2 joint_position_rad",
        "1 joint_current_amperes", "2 joint_current_amperes",
    )  # fmt: skip
    rows = np.concatenate([x for x, _ in table.blocks([0, 1, 2])])
    np.testing.assert_allclose(rows[:, 1:3], Q, atol=1e-12)


@pytest.mark.parametrize("suffix", [".json", ".yaml"])
def test_a_plan_is_refused_as_one(tmp_path: Path, suffix: str) -> None:
    points = [{"positions": q.tolist(), "time_from_start": {"secs": 0, "nsecs": 10}} for q in Q]
    path = tmp_path / f"plan{suffix}"
    path.write_text(json.dumps([{"joint_names": ["a", "b"], "points": points}]))
    opened = json_table.YamlTable if suffix == ".yaml" else json_table.JsonTable
    with pytest.raises(InputError, match=r"planned trajectory .* nothing in it is measured"):
        opened(path)
