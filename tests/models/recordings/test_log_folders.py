"""Folders that are no log: what is said of them, and that the command makes a log of them."""

import subprocess
import sys
from pathlib import Path

import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.log_folders import refuse_other_folder


def _said(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        refuse_other_folder(path)
    return str(caught.value)


def test_quantities_in_a_file_each_are_joined_by_the_command(tmp_path: Path) -> None:
    pytest.importorskip("pandas")
    folder = tmp_path / "run"
    folder.mkdir()
    for k, name in enumerate(("q", "v", "tau")):
        (folder / f"move_{name}.csv").write_text(f"time_ns,elbow\n1000,{k}.5\n2000,{k}.7\n")
    said = _said(folder)
    assert "the quantities of a recording in a file each (move_q.csv, move_tau.csv" in said
    code = said.split('python -c "')[1].split('", and give run.csv')[0]
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=True)
    header, first, *_ = (tmp_path / "run.csv").read_text().splitlines()
    assert header == "time_ns,elbow_q,elbow_tau,elbow_v"
    assert first == "1000,0.5,2.5,1.5"


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
