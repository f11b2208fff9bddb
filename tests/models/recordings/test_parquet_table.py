"""Parquet files with columns of lists, as LeRobot has them."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.parquet_table import ParquetContainer, ParquetTable
from wrenchsight.models.recordings.recording_reader import read_recording

_ROWS = 40
_Q = np.random.default_rng(3).normal(size=(_ROWS, 3))


def _written(tmp_path: Path, kind: pa.DataType, rows: list[object], group: int = 7) -> Path:
    path = tmp_path / "log.parquet"
    columns = {"stamp": pa.array(0.01 * np.arange(len(rows))), "joints": pa.array(rows, kind)}
    pq.write_table(pa.table(columns), path, row_group_size=group)
    return path


@pytest.mark.parametrize(
    "kind", [pa.list_(pa.float64(), 3), pa.list_(pa.float64()), pa.large_list(pa.float64())]
)
def test_a_list_column_becomes_a_column_per_entry(tmp_path: Path, kind: pa.DataType) -> None:
    path = _written(tmp_path, kind, _Q.tolist())
    form = tmp_path / "form.yaml"
    form.write_text(
        "time: {columns: stamp}\nposition: {columns: 'joints.{1..3}'}\n"
        "velocity: {columns: 'joints.{1..3}', gain: [0.1]}\nrows: {log.parquet: [5, 38]}\n"
    )
    log = read_recording(path, form)
    np.testing.assert_array_equal(log.q, _Q[4:38])
    np.testing.assert_allclose(log.v, 0.1 * _Q[4:38])
    assert log.row is not None
    assert log.row[0] == 5


def test_lists_of_lists_are_read_row_by_row(tmp_path: Path) -> None:
    kind = pa.list_(pa.list_(pa.float64(), 2), 2)
    values = np.arange(4.0 * _ROWS).reshape(_ROWS, 2, 2)
    table = ParquetTable(_written(tmp_path, kind, values.tolist()))
    assert table.names == ("stamp", "joints.1", "joints.2", "joints.3", "joints.4")
    entries = np.concatenate([x for x, _ in table.blocks([2, 3])])
    np.testing.assert_array_equal(entries, values.reshape(_ROWS, 4)[:, 1:3])


@pytest.mark.parametrize("part", [range(12), range(6, 14), range(7, 14), range(30, 40)])
def test_a_part_of_a_file_is_a_table(tmp_path: Path, part: range) -> None:
    """Whatever groups of rows the file has."""
    path = _written(tmp_path, pa.list_(pa.float64(), 3), _Q.tolist())
    table = ParquetTable(path, part)
    blocks = list(table.blocks([1, 2, 3]))
    np.testing.assert_array_equal(
        np.concatenate([x for x, _ in blocks]), _Q[part.start : part.stop]
    )
    row_numbers = np.concatenate([rows for _, rows in blocks]).tolist()
    assert row_numbers == list(range(1, len(part) + 1))
    assert table.progress <= 1.0
    with pytest.raises(InputError, match="has 40 rows, expected 41"):
        ParquetTable(path, range(31, 41))


@pytest.mark.parametrize(
    ("entry", "problem"),
    [([1.0, 2.0], "a list of 2 numbers"), (None, "is empty"), ([1.0, np.nan, 2.0], "not finite")],
)
def test_a_row_of_another_length_is_named(tmp_path: Path, entry: object, problem: str) -> None:
    rows: list[object] = [*_Q.tolist()]
    rows[16] = entry
    table = ParquetTable(_written(tmp_path, pa.list_(pa.float64()), rows))
    with pytest.raises(InputError, match=rf"row 17, column joints.*{problem}"):
        list(table.blocks([1, 2, 3]))


def test_a_list_that_is_too_long_is_left_out(tmp_path: Path) -> None:
    table = ParquetTable(_written(tmp_path, pa.list_(pa.float64()), [[0.0] * 5000] * 12))
    assert table.names == ("stamp",)
    assert "is left out: it holds lists of 5000 numbers" in table.notices[0]


def test_two_columns_of_one_name_are_refused_where_they_are_read(tmp_path: Path) -> None:
    path = tmp_path / "log.parquet"
    columns = [pa.array([1.0, 2.0]), pa.array([3.0, 4.0]), pa.array([[5.0], [6.0]])]
    pq.write_table(pa.table([*columns, columns[2]], names=["t", "q", "q", "list"]), path)
    table = ParquetTable(path)
    assert table.names == ("t", "q", "list")
    (values, _) = next(table.blocks([0, 2]))
    np.testing.assert_array_equal(values, [[1.0, 5.0], [2.0, 6.0]])
    with pytest.raises(InputError, match='schema: names the column "q" more than once'):
        next(table.blocks([0, 1]))


def test_fields_of_records_are_columns(tmp_path: Path) -> None:
    t = 0.01 * np.arange(40)
    fields = {"position": np.sin(t), "velocity": np.cos(t), "current": 1.0 + t}
    record = pa.StructArray.from_arrays([pa.array(x) for x in fields.values()], list(fields))
    path = tmp_path / "log.parquet"
    pq.write_table(pa.table({"t": t, "joint_1": record}), path)
    table = ParquetContainer().open(path, None)
    assert table.names == ("t", "joint_1.position", "joint_1.velocity", "joint_1.current")
    values, _ = next(table.blocks([0, 1, 2, 3]))
    np.testing.assert_array_equal(values, np.c_[t, *fields.values()])
