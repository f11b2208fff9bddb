"""Kinds of files that are made into a Parquet table, and those that are known by their content."""

import io
import sqlite3
import tarfile
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.arrow_table import ArrowContainer
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_reader import read_recording

_T = 0.01 * np.arange(40)
_Q = np.round(np.sin(_T[:, None] + np.arange(2)), 6)
_TABLE = pd.DataFrame({"t": _T} | {f"{x}{j + 1}": k + _Q[:, j] for k, x in enumerate("qvi")
                                   for j in range(2)})  # fmt: skip


def _same(log: Recording) -> None:
    np.testing.assert_allclose(log.t - log.t[0], _T, rtol=0, atol=2e-6)  # pandas' microseconds
    np.testing.assert_array_equal(np.hstack([log.q, log.v, log.current]), _TABLE.to_numpy()[:, 1:])


def _stream(path: Path) -> None:
    table = pa.Table.from_pandas(_TABLE)
    with pa.OSFile(str(path), "wb") as file, pa.ipc.new_stream(file, table.schema) as writer:
        writer.write_table(table)


def _sqlite(path: Path) -> None:
    connection = sqlite3.connect(path)
    _TABLE.to_sql("joint log", connection, index=False)
    connection.execute("CREATE TABLE meta (key TEXT, value TEXT)")
    connection.commit()
    connection.close()


def _npy(path: Path) -> None:
    array = np.zeros(40, [("t", "f8"), ("q", "f8", 2), ("v", "f8", 2), ("i", "f4", 2)])
    array["t"], array["q"], array["v"] = _T, _Q, 1.0 + _Q
    array["i"] = 0.0
    np.save(path, array)


@pytest.mark.parametrize(
    ("name", "write"),
    [
        ("log.feather", _TABLE.to_feather),
        ("log.arrow", lambda path: ArrowContainer().write(path, dict(_TABLE))),
        ("log.arrows", lambda path: None),
        ("log.db", _sqlite),
        ("log.dat", _TABLE.to_parquet),  # by its content
        ("log.asc", lambda path: _TABLE.to_csv(path, index=False)),
        ("log", lambda path: _TABLE.to_csv(path, index=False, sep="\t")),
    ],
)
def test_each_kind_is_read(tmp_path: Path, name: str, write: Callable[[Path], object]) -> None:
    path = tmp_path / name
    write(path)
    if name == "log.arrows":
        path = path.with_suffix(".arrow")
        _stream(path)
    _same(read_recording(path))


def test_arrays_of_numpy_alone(tmp_path: Path) -> None:
    path = tmp_path / "log.npy"
    _npy(path)
    np.testing.assert_array_equal(read_recording(path).q, _Q)
    np.save(path, _TABLE.to_numpy())
    with pytest.raises(InputError, match="holds 7 numbers and no names"):
        read_recording(path)
    description = tmp_path / "columns.yaml"
    description.write_text(
        "header: false\ntime: {columns: 1}\nposition: {columns: 2-3}\nvelocity: {columns: 4-5}\n"
        "current: {columns: 6-7}\n"
    )
    _same(read_recording(path, description))


@pytest.mark.parametrize("column", ["datetime", "zoned", "duration", "text", "numbers-as-text"])
@pytest.mark.parametrize("kind", ["feather", "parquet", "npz"])
def test_stamps_of_any_type_are_seconds(tmp_path: Path, kind: str, column: str) -> None:
    stamps = pd.Series(pd.to_datetime(1_700_000_000.0 + _T, unit="s"))
    values = {
        "datetime": stamps,
        "zoned": stamps.dt.tz_localize("UTC"),
        "duration": pd.Series(pd.to_timedelta(_T, unit="s")),
        "text": stamps.dt.strftime("%d.%m.%Y %H:%M:%S,%f"),
        "numbers-as-text": pd.Series([f"{t:.3f}" for t in _T]),
    }[column]
    path = tmp_path / f"log.{kind}"
    table = _TABLE.assign(t=values)
    if kind != "npz":
        table.to_feather(path) if kind == "feather" else table.to_parquet(path)
    elif column in ("datetime", "duration", "text"):
        dtype = "U26" if column == "text" else None
        np.savez(path, **{n: np.asarray(x, dtype if n == "t" else None) for n, x in table.items()})
    else:
        pytest.skip("not of NumPy's types")
    _same(read_recording(path))


def _zip(path: Path, members: dict[str, bytes]) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)


def _tar(path: Path, members: dict[str, bytes]) -> None:
    with tarfile.open(path, "w:gz") as archive:
        for name, content in members.items():
            entry = tarfile.TarInfo(name)
            entry.size = len(content)
            archive.addfile(entry, io.BytesIO(content))


@pytest.mark.parametrize(("name", "write"), [("run.zip", _zip), ("run.tar.gz", _tar),
                                             ("run.tgz", _tar), ("run.dat", _tar)])  # fmt: skip
def test_an_archive_of_one_log_is_read(
    tmp_path: Path, name: str, write: Callable[[Path, dict[str, bytes]], None]
) -> None:
    content = _TABLE.to_csv(index=False).encode()
    members = {"run/README.md": b"# run 12", "run/log.csv": content, "run/robot.yaml": b"a: 1"}
    write(tmp_path / name, members)
    _same(read_recording(tmp_path / name))
    write(tmp_path / name, members | {"run/force.csv": b"t,fx\n0,1\n"})
    with pytest.raises(InputError, match=r"2 files: run/log.csv, run/force.csv; expected one"):
        read_recording(tmp_path / name)


def test_a_database_of_several_tables_is_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "log.db"
    _sqlite(path)
    connection = sqlite3.connect(path)
    _TABLE.to_sql("forces", connection, index=False)
    connection.close()
    with pytest.raises(InputError, match=r"holds 2 tables.*joint log, forces.*sqlite3 -csv"):
        read_recording(path)
