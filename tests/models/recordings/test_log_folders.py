"""Folders: joined where their files are of one recording, else what is said of them."""

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.log_folders import refuse_other_folder
from wrenchsight.models.recordings.recording_reader import read_recording

_JOINTS = ("shoulder_pan_joint", "elbow_joint", "wrist_1_joint")
_ROBOT: Any = SimpleNamespace(
    name="arm",
    num_joints=3,
    joint_names=_JOINTS,
    q_offset=np.zeros(3),
    velocity_limit=np.full(3, np.inf),
    position_lower=np.full(3, -np.inf),
    position_upper=np.full(3, np.inf),
    motor_current=lambda tau_J: tau_J,
    chain=SimpleNamespace(prismatic=np.zeros(3, bool)),
)


def _said(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        refuse_other_folder(path)
    return str(caught.value)


def _motion() -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """t (60,) s and q, v, i (60, 3)."""
    t = 1.7e9 + 0.01 * np.arange(60)
    phase = t[:, None] - 1.7e9 + np.arange(3)
    return t, {"q": np.sin(phase), "v": np.cos(phase), "i": 1.0 + np.sin(phase) ** 2}


def _write(path: Path, columns: dict[str, np.ndarray]) -> None:
    pd.DataFrame(columns).to_csv(path, index=False)


@pytest.mark.parametrize("dropped", [0, 7])
def test_a_file_for_each_quantity_is_joined_by_times(tmp_path: Path, dropped: int) -> None:
    t, signals = _motion()
    folder = tmp_path / "run"
    folder.mkdir()
    for name, signal in {"q": signals["q"], "v": signals["v"], "current": signals["i"]}.items():
        rows = t != (t[dropped] if dropped and name == "v" else -1.0)
        columns = {joint: signal[rows, k] for k, joint in enumerate(_JOINTS[::-1])}
        _write(folder / f"move_{name}.csv", {"stamp": t[rows], **columns, "frame": "base"})
    _write(folder / "move_notes.csv", {"note": np.array(["none"])})
    log = read_recording(folder, None, _ROBOT, check=False)
    is_whole = t != (t[dropped] if dropped else -1.0)  # a sample that lacks a number is left out
    np.testing.assert_allclose(log.t, t[is_whole], rtol=0, atol=1e-6)
    for logged, true in ((log.q, "q"), (log.v, "v"), (log.current, "i")):
        np.testing.assert_allclose(logged, signals[true][is_whole, ::-1], rtol=0, atol=1e-12)
    assert any("a file for each quantity: move_current.csv, move_q" in x for x in log.notices)
    assert "files left out: move_notes.csv" in log.notices


@pytest.mark.parametrize("names", [_JOINTS, ("joint_1", "joint_2", "joint_3"), ("J1", "J2", "J3")])
def test_a_file_for_each_joint_is_joined_by_times(tmp_path: Path, names: tuple[str, ...]) -> None:
    t, signals = _motion()
    for k, name in enumerate(names):
        columns = {"position": signals["q"][:, k], "velocity": signals["v"][:, k]}
        _write(tmp_path / f"{name}.csv", {"time": t, **columns, "current": signals["i"][:, k]})
    log = read_recording(tmp_path, None, _ROBOT, check=False)
    np.testing.assert_allclose(log.q, signals["q"], rtol=0, atol=1e-12)
    np.testing.assert_allclose(log.current, signals["i"], rtol=0, atol=1e-12)
    assert any("a file for each joint" in notice for notice in log.notices)


def test_files_whose_times_differ_are_joined_by_a_command_alone(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    for k, name in enumerate(("q", "v", "tau")):
        (folder / f"move_{name}.csv").write_text(f"time_ns,elbow\n{k}000,{k}.5\n{k}200,{k}.7\n")
    with pytest.raises(InputError) as caught:
        read_recording(folder)
    said = str(caught.value)
    assert "(move_q.csv, move_tau.csv, move_v.csv), whose times are not the same" in said
    code = said.split('python -c "')[1].split('", and give run.csv', maxsplit=1)[0]
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=True)
    header, first, *_ = (tmp_path / "run.csv").read_text().splitlines()
    assert header == "time_ns,elbow_q,elbow_tau,elbow_v"
    assert first == "0,0.5,,"


@pytest.mark.parametrize("names", [("run_1", "run_2"), ("q",), ("v", "tau"), ("q", "notes"), ()])
def test_other_folders_are_told_to_name_a_file(tmp_path: Path, names: tuple[str, ...]) -> None:
    for name in names:
        (tmp_path / f"{name}.csv").write_text("t,q1\n0,1\n")
    assert "is a directory, expected a log; name a file in it" in _said(tmp_path)


@pytest.mark.parametrize(("group", "array"), [(".zgroup", ".zarray"), ("zarr.json", "zarr.json")])
def test_a_zarr_store_and_its_parts_are_told(tmp_path: Path, group: str, array: str) -> None:
    store = tmp_path / "log.zarr"
    chunk = store / "data" / "q" / "0.0"
    chunk.parent.mkdir(parents=True)
    (store / group).write_text("{}")
    (chunk.parent / array).write_text("{}")
    chunk.write_bytes(b"\x02\x01")
    assert "is a zarr store (a folder); write its arrays as npz: pip install zarr" in _said(store)
    assert f"is a zarr store (a folder), of which {Path('data/q/0.0')} is a part" in _said(chunk)
    assert f"{store}: " in _said(chunk)


def test_a_file_elsewhere_is_none_of_these(tmp_path: Path) -> None:
    (tmp_path / "q.csv").write_text("t,q1\n")
    refuse_other_folder(tmp_path / "q.csv")
    refuse_other_folder(tmp_path / "nothing.csv")


def test_runs_of_one_joint_are_not_joined(tmp_path: Path) -> None:
    for name in ("run_1", "run_2"):
        _write(tmp_path / f"{name}.csv", dict.fromkeys(("t", "position"), np.arange(20.0)))
    assert "is a directory, expected a log; name a file in it" in _said(tmp_path)
