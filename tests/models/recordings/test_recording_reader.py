"""Logs as they come: good ones read exactly, broken ones refused with one line.

The oracle for the numbers is numpy's own reader, or the array that was written.
"""

import os
import zipfile
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings import packed_file, text_table
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_reader import RecordingReader, read_recording
from wrenchsight.models.recordings.resampling import resampled
from wrenchsight.models.robot.robot import Robot

_NUM_ROWS = 40
_HEADER = "t,q1,q2,v1,v2,i1,i2"


def _table(num_rows: int = _NUM_ROWS) -> np.ndarray:
    """t, q1, q2, v1, v2, i1, i2 of a smooth motion at 100 Hz, with six decimals."""
    t = 0.01 * np.arange(num_rows)
    q = np.c_[np.sin(t), 0.5 * np.cos(2 * t)]
    v = np.c_[np.cos(t), -np.sin(2 * t)]
    return np.round(np.c_[t, q, v, 1.0 + q], 6)


def _lines(table: np.ndarray, separator: str = ",") -> list[str]:
    return [separator.join(f"{x:.6f}" for x in row) for row in table]


def _csv(tmp_path: Path, *lines: str, end: str = "\n", name: str = "log.csv") -> Path:
    path = tmp_path / name
    path.write_bytes((end.join(lines) + end).encode())
    return path


def _good(tmp_path: Path) -> Path:
    return _csv(tmp_path, _HEADER, *_lines(_table()))


def _same(recording: Recording, table: np.ndarray) -> None:
    read = np.c_[recording.t, recording.q, recording.v, recording.current]
    np.testing.assert_array_equal(read, table)


def _description(tmp_path: Path, text: str = "") -> Path:
    path = tmp_path / "columns.yaml"
    path.write_text(
        "time: {columns: 1}\nposition: {columns: 2-3}\nvelocity: {columns: 4-5}\n"
        "current: {columns: 6-7}\n" + text
    )
    return path


def _refused(path: Path, *words: str, description: Path | None = None) -> None:
    with pytest.raises(InputError) as caught:
        read_recording(path, description)
    line = str(caught.value)
    assert "\n" not in line
    assert path.name in line
    for word in words:
        assert word in line, line


# --- what reads well ---------------------------------------------------------------------------


def test_a_csv_with_the_plain_header_is_read(tmp_path: Path) -> None:
    recording = read_recording(_good(tmp_path))
    _same(recording, _table())
    assert recording.notices == ()
    assert not recording.dropout.any()
    assert recording.row.tolist() == list(range(2, _NUM_ROWS + 2))
    assert recording.row_word == "line"


@pytest.mark.parametrize("block", [1, 64, 700])
def test_the_size_of_blocks_does_not_change_the_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: int
) -> None:
    path = _csv(tmp_path, _HEADER, *_lines(_table())[:7], "", *_lines(_table())[7:])
    monkeypatch.setattr(text_table, "BLOCK_BYTES", block)
    chunks = list(RecordingReader(path).chunks())
    assert len(chunks) > 3
    np.testing.assert_array_equal(np.concatenate([c.t for c in chunks]), _table()[:, 0])
    np.testing.assert_array_equal(np.concatenate([c.current for c in chunks]), _table()[:, 5:])
    rows = [*range(2, 9), *range(10, _NUM_ROWS + 3)]  # line 9 is empty
    assert np.concatenate([c.row for c in chunks]).tolist() == rows


@pytest.mark.parametrize(
    "change",
    [
        lambda data: data.replace(b"\n", b"\r\n"),
        lambda data: b"\xef\xbb\xbf" + data,
        lambda data: data.rstrip(b"\n"),
        lambda data: data + b"\n  \n\n",
        lambda data: b"# " + data,  # numpy.savetxt
        lambda data: data.replace(b",", b" , "),
        lambda data: data.replace(b"t,q1", b'"T","Q1"'),
        lambda data: data.replace(b"\n", b"\r"),
        lambda data: data.replace(b",", b";", 3),
    ],
    ids=[
        "crlf",
        "bom",
        "no-last-newline",
        "blank-tail",
        "savetxt",
        "spaces",
        "quotes-capitals",
        "cr",
        "header-of-two-separators",
    ],
)
def test_harmless_variants_of_a_csv_are_read(
    tmp_path: Path, change: Callable[[bytes], bytes]
) -> None:
    path = _good(tmp_path)
    path.write_bytes(change(path.read_bytes()))
    recording = read_recording(path)
    _same(recording, _table())
    assert recording.notices == ()


def test_columns_may_have_any_order(tmp_path: Path) -> None:
    order = [3, 0, 6, 2, 5, 1, 4]
    names = [_HEADER.split(",")[k] for k in order]
    path = _csv(tmp_path, ",".join(names), *_lines(_table()[:, order]))
    _same(read_recording(path), _table())


def test_columns_without_a_name_are_left_out(tmp_path: Path) -> None:
    """An index that pandas wrote, and separators at the ends of the lines."""
    lines = [f"{k},{line}," for k, line in enumerate(_lines(_table()))]
    recording = read_recording(_csv(tmp_path, f",{_HEADER},", *lines))
    _same(recording, _table())
    assert recording.notices == ("a column without a name is left out",)


def test_semicolons_and_decimal_commas_are_recognised(tmp_path: Path) -> None:
    lines = [line.replace(".", ",") for line in _lines(_table(), ";")]
    recording = read_recording(_csv(tmp_path, _HEADER.replace(",", ";"), *lines))
    _same(recording, _table())
    assert "decimal commas" in recording.notices[0]
    assert "semicolons" in recording.notices[1]


def test_a_word_of_log_format_states_degrees(tmp_path: Path) -> None:
    table = _table()
    columns = slice(1, 5)
    turned = table.copy()
    turned[:, columns] = np.degrees(table[:, columns])
    path = _csv(tmp_path, _HEADER, *_lines(turned))
    recording = read_recording(path, "positions-in-degrees")
    np.testing.assert_allclose(recording.q, table[:, 1:3], atol=1e-8)  # six decimals of a degree
    np.testing.assert_allclose(recording.v, table[:, 3:5], atol=1e-8)
    np.testing.assert_array_equal(recording.current, table[:, 5:7])
    assert any("are read in degrees" in text for text in recording.notices)


def test_a_word_of_log_format_leaves_joints_that_slide_in_metres(tmp_path: Path) -> None:
    table = _table()
    turned = table.copy()
    turned[:, [1, 3]] = np.degrees(table[:, [1, 3]])  # the second joint slides
    path = _csv(tmp_path, _HEADER, *_lines(turned))
    recording = read_recording(path, "positions-in-degrees", _two_joints([False, True]), False)
    np.testing.assert_allclose(recording.q, table[:, 1:3], atol=1e-8)  # six decimals of a degree
    np.testing.assert_allclose(recording.v, table[:, 3:5], atol=1e-8)
    assert any("of joints that slide in m" in text for text in recording.notices)


def test_a_description_states_another_layout(tmp_path: Path) -> None:
    table = _table()
    scaled = table * [1e3, 180 / np.pi, 180 / np.pi, *[180 / np.pi] * 2, -1e3, 1e3]
    text = [";".join(map(str, row)) + ";idle" for row in scaled]  # a last column with words
    path = _csv(tmp_path, "recorded by a person", *text, name="log.txt")
    description = tmp_path / "format.yaml"
    description.write_text(
        """
        separator: ";"
        header: false
        skip_lines: 1
        num_columns: 8
        time: {columns: 1, unit: ms}
        position: {columns: 2-3, unit: deg}
        velocity: {columns: 4..5, unit: deg/s}
        current: {columns: "6, 7", unit: mA, gain: [-1, 1]}
        extra:
          pair: {columns: 2-5, shape: [2, 2]}
        rows: {log.txt: [3, 30]}
        """
    )
    recording = read_recording(path, description)
    read = np.c_[recording.t, recording.q, recording.v, recording.current]
    np.testing.assert_allclose(read, table[2:30], rtol=1e-14, atol=1e-16)  # one rounding each
    np.testing.assert_array_equal(recording.extra["pair"][:, 1, 0], scaled[2:30, 3])
    assert recording.row[0] == 4  # line of the file


def test_a_description_may_name_its_log(tmp_path: Path) -> None:
    _csv(tmp_path, *_lines(_table()), name="numbers.csv")
    path = _description(tmp_path, "header: false\nfile: numbers.csv\n")
    _same(read_recording(path), _table())
    with pytest.raises(InputError, match="is a description itself"):
        read_recording(path, path)
    with pytest.raises(InputError, match='names no "file"'):
        read_recording(_description(tmp_path, "header: false\n"))
    with pytest.raises(InputError, match=r"numbersx\.csv: no such file.*numbers\.csv"):
        read_recording(_description(tmp_path, "file: numbersx.csv\n"))


def _two_joints(prismatic: list[bool]) -> Any:
    return SimpleNamespace(
        name="two",
        num_joints=2,
        joint_names=("joint_1", "joint_2"),
        torque_per_ampere=np.array([10.0, 4.0]),
        current_sign=np.array([1.0, -1.0]),
        motor_current=lambda tau_J: tau_J / [10.0, -4.0],
        q_offset=np.zeros(2),
        velocity_limit=np.full(2, np.inf),
        position_lower=np.full(2, -np.inf),
        position_upper=np.full(2, np.inf),
        chain=SimpleNamespace(prismatic=np.array(prismatic)),
    )


def test_torque_instead_of_current_needs_the_robot(tmp_path: Path) -> None:
    path = _csv(tmp_path, _HEADER.replace("i", "tau"), *_lines(_table()))
    robot = _two_joints([False, False])
    recording = read_recording(path, robot=robot, check=False)
    np.testing.assert_array_equal(recording.tau_J, _table()[:, 5:])
    np.testing.assert_allclose(recording.current, _table()[:, 5:] / [10.0, -4.0], rtol=1e-15)
    RecordingReader(path, robot=robot, check=False).require_joint_signals()
    with pytest.raises(InputError, match="holds no motor currents"):
        RecordingReader(path).require_joint_signals()


def test_a_truncated_last_line_is_left_out_with_a_notice(tmp_path: Path) -> None:
    path = _good(tmp_path)
    path.write_bytes(path.read_bytes()[:-30])
    recording = read_recording(path)
    _same(recording, _table()[:-1])
    assert recording.notices == (
        f"line {_NUM_ROWS + 1}, the last one, is left out: it is cut off after 4 of 7 columns",
    )


# --- Parquet -----------------------------------------------------------------------------------


def _parquet(tmp_path: Path, **columns: object) -> Path:
    names = _HEADER.split(",")
    data = {name: _table()[:, k] for k, name in enumerate(names)} | columns
    path = tmp_path / "log.parquet"
    pq.write_table(pa.table(data), path, row_group_size=15)
    return path


def test_a_parquet_file_reads_like_a_csv(tmp_path: Path) -> None:
    recording = read_recording(_parquet(tmp_path))
    _same(recording, _table())
    assert recording.row.tolist() == list(range(1, _NUM_ROWS + 1))


def test_a_description_reads_parquet_columns_of_other_types(tmp_path: Path) -> None:
    stamps = (1.7e9 + _table()[:, 0]) * 1e9
    path = _parquet(
        tmp_path,
        stamp=pa.array(np.round(stamps).astype(np.int64)).cast(pa.timestamp("ns")),
        q1=pa.array(_table()[:, 1].astype(np.float32)),
        i2=pa.array(np.arange(_NUM_ROWS, dtype=np.int16)),
    )
    description = tmp_path / "format.yaml"
    description.write_text(
        "time: {columns: stamp}\nposition: {columns: 'q{1..2}'}\nvelocity: {columns: 'v{1..2}'}\n"
        "current: {columns: 'i{1..2}', unit: mA}\nrows: {log.parquet: [11, 30]}\n"
    )
    recording = read_recording(path, description)
    np.testing.assert_allclose(recording.t - 1.7e9, _table()[10:30, 0], atol=5e-7)  # two ulp
    np.testing.assert_array_equal(recording.q[:, 0], _table()[10:30, 1].astype(np.float32))
    np.testing.assert_array_equal(recording.current[:, 1], np.arange(10, 30) * 1e-3)
    assert recording.row[0] == 11


def _empty_cell(values: np.ndarray) -> pa.Array:
    mask = np.zeros(len(values), bool)
    mask[20] = True
    return pa.array(values, mask=mask)


def test_a_damaged_parquet_file_is_refused_in_one_line(tmp_path: Path) -> None:
    table = _table()
    bad = table[:, 2].copy()
    bad[17] = np.inf
    _refused(_parquet(tmp_path, q2=bad), "row 18, column q2", "not finite")
    _refused(_parquet(tmp_path, t=_empty_cell(table[:, 0])), "row 21, column t", "is empty")
    _refused(_parquet(tmp_path, q2=["a"] * _NUM_ROWS), "column q2", "holds string")
    _refused(_parquet(tmp_path, q2=[["a"]] * _NUM_ROWS), "column q2", "holds list")

    path = _parquet(tmp_path)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    _refused(path, "damaged Parquet file")
    path.write_bytes(whole[:100] + bytes(400) + whole[500:])
    _refused(path, "damaged")
    path.write_bytes(b"")
    _refused(path, "is empty")
    path.write_text(_HEADER + "\n")
    _refused(path, "is no Parquet file")
    pq.write_table(pa.table({"t": np.empty(0)}), path)
    _refused(path, "has no rows")
    path = _parquet(tmp_path)
    description = tmp_path / "format.yaml"
    description.write_text("time: {columns: t}\nrows: {log.parquet: [30, 60]}\n")
    _refused(
        path, "has 40 rows, but the description selects rows 30 to 60", description=description
    )


# --- files that are no log ---------------------------------------------------------------------


def test_files_that_are_no_log_are_refused(tmp_path: Path) -> None:
    _refused(tmp_path, "is a directory")
    _good(tmp_path)
    _refused(tmp_path / "lgo.csv", "no such file", 'did you mean "log.csv"?')
    _refused(tmp_path / "none" / "a.csv", "no such file")
    _refused(_csv(tmp_path, "t,q", name="log.abc"), 'has the ending ".abc"', "name the file .csv")
    for name, content, words in (
        ("log.xlsx", b"PK\x03\x04" + bytes(40), "pandas.read_excel('log.xlsx', sheet_name=None"),
        ("log.hdf5", b"\x89HDF\r\n" + bytes(40), "numpy.savez('log.npz', **d)"),
        ("log.h5", b"\x89HDF\r\n" + bytes(40) + b"pandas_type", "pandas.read_hdf('log.h5')"),
        ("log.tdms", b"TDSm" + bytes(40), "nptdms.TdmsFile.read('log.tdms')"),
        ("log.pkl", b"\x80\x04" + bytes(40), "pandas.read_pickle('log.pkl')"),
    ):
        (tmp_path / name).write_bytes(content)
        _refused(tmp_path / name, words)
    empty = tmp_path / "empty.csv"
    for content in (b"", b"\n\n  \n", b"\xef\xbb\xbf"):
        empty.write_bytes(content)
        _refused(empty, "is empty")
    _refused(_csv(tmp_path, _HEADER), "holds no samples")
    _refused(_csv(tmp_path, _HEADER, *_lines(_table(9))), "holds 9 samples, expected 10 or more")


@pytest.mark.parametrize(
    ("content", "word"),
    [
        (b"PAR1" + bytes(40), "is a damaged Parquet file"),
        (b"\x1f\x8b\x08" + bytes(40), "cannot be unpacked"),
        (b"ARROW1" + bytes(40), "is no Arrow file, or a damaged one"),
        (b"SQLite format 3" + bytes(40), "is no SQLite database, or a damaged one"),
        (b"PK\x03\x04" + bytes(40), "spreadsheet"),
        (b"\x7fELF\x02\x01" + bytes(40), "is a binary file"),
        (bytes(range(128, 256)), "is no text"),
        (b"x" * (1 << 23), "header: does not end"),
        ((_HEADER + "\n").encode() + b"x" * (1 << 23), "does not end"),
        (b"1,2,3\r4,5,6\r7,8,9", "holds 3 numbers and no names"),
    ],
)
def test_binary_files_are_refused_by_their_kind(tmp_path: Path, content: bytes, word: str) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(content)
    _refused(path, word)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_a_file_without_permission_is_refused(tmp_path: Path) -> None:
    path = _good(tmp_path)
    path.chmod(0)
    _refused(path, "cannot be read", "Permission denied")


# --- other ways to write a table ---------------------------------------------------------------


def _with_lists(write: Callable[[np.ndarray], str]) -> list[str]:
    """The lines of the table with a list in a cell for each signal."""
    rows = [f"{r[0]:.6f},{write(r[1:3])},{write(r[3:5])},{write(r[5:7])}" for r in _table()]
    return ["time,position,velocity,current", *rows]


@pytest.mark.parametrize(
    "write",
    [
        lambda x: f'"{x.tolist()}"',  # pandas
        lambda x: f'"{tuple(x.tolist())}"',  # bagpy
        lambda x: f'"[{x[0]!r:>12.40s}\n {x[1]!r}]"'.replace("np.float64", ""),  # numpy, broken
        lambda x: f'"array([{float(x[0])!r}, {float(x[1])!r}])"',
    ],
)
def test_lists_in_cells_are_read(tmp_path: Path, write: Callable[[np.ndarray], str]) -> None:
    _same(read_recording(_csv(tmp_path, *_with_lists(write))), _table())


def test_a_list_of_another_length_is_refused(tmp_path: Path) -> None:
    lines = _with_lists(lambda x: f'"{x.tolist()}"')
    lines[7] = '0.06,"[1, 2, 3]","[1, 2]","[1, 2]"'
    _refused(_csv(tmp_path, *lines), "line 8, column position", "a list of 3 entries, expected 2")


@pytest.mark.parametrize("zone", ["", "Z", "+00:00"])
@pytest.mark.parametrize("between", [" ", "T"])
def test_dates_with_times_are_seconds(tmp_path: Path, zone: str, between: str) -> None:
    table = _table()
    table[:, 0] += 50.0  # from 22:14:10 on, across no minute
    lines = _lines(table)
    stamps = [f"2023-11-14{between}22:13:{x:09.6f}{zone}" for x in table[:, 0]]
    lines = [stamp + line[line.index(",") :] for stamp, line in zip(stamps, lines, strict=True)]
    log = read_recording(_csv(tmp_path, _HEADER, *lines))
    midnight = 1_699_920_000.0  # of 2023-11-14, UTC; by the command date
    # A double holds such times to .24 us.
    np.testing.assert_allclose(log.t, midnight + 22 * 3600 + 13 * 60 + table[:, 0], atol=1e-6)
    broken = [*lines[:5], "soon" + lines[5][lines[5].index(",") :], *lines[6:]]
    _refused(_csv(tmp_path, _HEADER, *broken), "line 7, column 1 (t)", 'holds "soon"')


def test_words_above_the_table_are_left_out(tmp_path: Path) -> None:
    head = ["Robot: UR10e", "Rate: 100 Hz", "", "Operator: a, b"]
    log = read_recording(_csv(tmp_path, *head, _HEADER, *_lines(_table())))
    _same(log, _table())
    assert any("the first 4 lines are no table" in text for text in log.notices)


def test_poses_of_the_tool_alone_are_told(tmp_path: Path) -> None:
    pose = "X -691.7951 Y -174.2428 Z 676.7544 A 90.0000 B 0.0456 C 179.9544"
    lines = [f"point {k} at 2024-03-05 14:02:11.{k} {pose}" for k in range(10, 30)]
    _refused(_csv(tmp_path, *lines), "holds poses of the tool alone", "no motor currents")


# --- headers -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("header", "words"),
    [
        ("t,q1,q2,v1,i1,i2,tau1", ["lacks the columns v2, tau2"]),
        ("t,q1,q2,v1,v3,i1,i2", ["lacks the column", "v2"]),
        ("q1,q2,v1,v2,i1,i2,x.1", ["has no column of time", "--log-format rate_hz=100"]),
        ("clockstamp,q1,q2,v1,v2,i1,i2", ["it may be clockstamp", "time: {columns:"]),
        ("t,q1,q2,v1,v2,i1,temperature", ['unknown column "temperature"', "--log-format"]),
        ("t,q1,q2,v1,v2,i1,q_3", ['unknown column "q_3"', 'did you mean "q3"?']),
        ("t,q1,q2,v1,v2,i1,i1", ['names the column "i1" twice']),
        ("t,q1,q2,v1,v2,i1,", ["lacks the column i2"]),
    ],
)
def test_wrong_headers_are_refused_with_a_remedy(
    tmp_path: Path, header: str, words: list[str]
) -> None:
    _refused(_csv(tmp_path, header, *_lines(_table())), "header", *words)


def test_numbers_without_names_are_refused(tmp_path: Path) -> None:
    path = _csv(tmp_path, *_lines(_table()))
    _refused(path, "line 1: holds 7 numbers and no names", "--log-format")
    _refused(path, "line 1", "holds numbers where the names", description=_description(tmp_path))
    path = _good(tmp_path)
    description = _description(tmp_path, "header: false\n")
    _refused(path, "line 1, column 1", 'holds "t"', "header: true", description=description)
    forces = tmp_path / "forces.csv"
    forces.write_text("time,Fx,Fy,Fz\n" + "".join(f"{0.01 * k},1,2,3\n" for k in range(20)))
    _refused(forces, "holds forces (Fx, Fy, Fz), but no joint positions", "is another record")
    two = tmp_path / "two.csv"
    two.write_text("12.0,5402.112\n" * 20)
    _refused(two, "holds 2 numbers and no names: too few for", "this is another record")


def test_another_number_of_joints_is_refused(tmp_path: Path) -> None:
    three = SimpleNamespace(name="three", num_joints=3, joint_names=("a", "b", "c"))
    with pytest.raises(InputError, match=r"lacks the columns q3, v3, i3"):
        read_recording(_good(tmp_path), robot=three)
    robot = SimpleNamespace(name="one", num_joints=1, joint_names=("a",))
    with pytest.raises(InputError, match=r"has the columns q2, v2, i2, expected 1 joints"):
        read_recording(_good(tmp_path), robot=robot)
    description = _description(tmp_path)
    with pytest.raises(InputError, match="holds 2 joints, but three has 3"):
        read_recording(_good(tmp_path), description, robot=three)


# --- broken lines ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("cell", "words"),
    [
        ("-Inf", ["line 12, column 4 (v1)", "holds -Inf"]),
        ("error", ["line 12, column 4 (v1)", 'holds "error"']),
        ("1e999", ["line 12, column 4 (v1)", "too large a number"]),
        ("0x1F", ["line 12, column 4 (v1)", 'holds "0x1F"']),
        ("1_000", ["line 12, column 4 (v1)", 'holds "1_000"']),
        ("0,5", ["line 12", "has 8 columns, expected 7", "decimal commas"]),
        ("1.0,2.0", ["line 12", "has 8 columns"]),
        ("\0\0\0", ["line 12", "zero bytes", "power failure"]),
    ],
)
def test_broken_cells_are_named(tmp_path: Path, cell: str, words: list[str]) -> None:
    lines = _lines(_table())
    cells = lines[10].split(",")
    lines[10] = ",".join([*cells[:3], cell, *cells[4:]])
    _refused(_csv(tmp_path, _HEADER, *lines), *words)
    _refused(_csv(tmp_path, _HEADER, *lines, end="\r\n"), *words)


def test_a_short_line_is_refused(tmp_path: Path) -> None:
    lines = _lines(_table())
    lines[20] = lines[20].rsplit(",", 2)[0]
    _refused(_csv(tmp_path, _HEADER, *lines), "line 22", "has 5 columns, expected 7")
    lines = _lines(_table())
    lines[-1] = lines[-1].rsplit(",", 2)[0]  # complete with its newline: no crash cut it
    _refused(_csv(tmp_path, _HEADER, *lines), f"line {_NUM_ROWS + 1}", "has 5 columns")


@pytest.mark.parametrize("block", [1 << 20, 150])
def test_a_repeated_header_is_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: int
) -> None:
    """A logger that opens its file again; where its time starts again, these are two logs."""
    monkeypatch.setattr(text_table, "BLOCK_BYTES", block)
    lines = _lines(_table())
    log = read_recording(_csv(tmp_path, _HEADER, *lines[:20], _HEADER, *lines[20:]))
    _same(log, _table())
    assert log.notices == ("line 22 repeats the header: left out",)
    path = _csv(tmp_path, _HEADER, *lines, _HEADER, *_lines(_table() + np.eye(7)[1:].sum(axis=0)))
    _refused(path, "line 43", "runs backwards from 0.39 s to 0 s", "split the log there")


def test_words_below_the_table_are_left_out(tmp_path: Path) -> None:
    end = ["", "Recording stopped by user", "lost packets: 0"]
    log = read_recording(_csv(tmp_path, _HEADER, *_lines(_table()), *end))
    _same(log, _table())
    assert log.notices == (
        'the last 2 lines are no rows: left out (beginning "Recording stopped by user")',
    )
    end = ["2024-05-17,10:57:15,STOP TRG"]
    log = read_recording(_csv(tmp_path, _HEADER, *_lines(_table()), *end))
    _same(log, _table())
    assert "the last line is no row" in log.notices[0]
    lines = _lines(_table())
    between = ["Recording paused", "# and resumed"]
    log = read_recording(_csv(tmp_path, _HEADER, *lines[:30], *between, *lines[30:]))
    _same(log, _table())
    assert 'line 32 is no row: left out (beginning "Recording paused")' in log.notices
    path = _csv(tmp_path, _HEADER, *lines[:30], "1.5", *lines[30:])
    _refused(path, "line 32", "has 1 columns, expected 7")


def test_a_separator_at_the_end_of_the_rows_is_no_column(tmp_path: Path) -> None:
    _same(
        read_recording(_csv(tmp_path, _HEADER, *[f"{line}," for line in _lines(_table())])),
        _table(),
    )


def test_decimal_commas_in_quotes_are_recognised(tmp_path: Path) -> None:
    lines = [",".join(f'"{x:.6f}"'.replace(".", ",") for x in row) for row in _table()]
    log = read_recording(_csv(tmp_path, _HEADER, *lines))
    _same(log, _table())
    assert "numbers are read with decimal commas" in log.notices


def test_a_second_table_is_told(tmp_path: Path) -> None:
    path = _csv(tmp_path, _HEADER, *_lines(_table()), "", "t,fx,fy", "0,1,2", "0.01,1,2")
    _refused(path, "line 43", "begins another table (t, fx, fy)", "cut the file before this line")


def test_frames_of_a_can_bus_are_told(tmp_path: Path) -> None:
    frames = [f"(1709647351.{k:06d}) can0 {0x281 + k % 6:03X}#0A0000{k:02X}" for k in range(40)]
    _refused(_csv(tmp_path, *frames), "raw frames of a CAN bus", "decode them with the drives' DBC")


def test_names_in_several_lines_are_joined(tmp_path: Path) -> None:
    """As pandas writes columns of a MultiIndex, whose index has a name, too."""
    levels = [
        "signal,position,position,velocity,velocity,current,current",
        "joint,joint_1,joint_2,joint_1,joint_2,joint_1,joint_2",
        "time,,,,,,",
    ]
    log = read_recording(_csv(tmp_path, *levels, *_lines(_table())))
    _same(log, _table())
    assert "the names stand in 3 lines, which are joined" in log.notices


def test_mixed_decimal_marks_are_refused(tmp_path: Path) -> None:
    lines = [line.replace(".", ",") for line in _lines(_table(), ";")]
    lines[4] = lines[4].replace(",", ".")
    path = _csv(tmp_path, _HEADER.replace(",", ";"), *lines)
    _refused(path, "line 6, column 1 (t)", "use one decimal mark")
    description = _description(tmp_path, 'separator: ";"\n')
    lines = [line.replace(".", ",") for line in _lines(_table(), ";")]
    path = _csv(tmp_path, _HEADER.replace(",", ";"), *lines)
    _refused(path, "line 2, column 1", 'set decimal_mark: ","', description=description)


def test_the_first_fault_is_named_also_in_a_late_block(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(text_table, "BLOCK_BYTES", 200)
    lines = _lines(_table())
    lines[33] = lines[33].replace("0.", "O.", 1)
    _refused(_csv(tmp_path, _HEADER, *lines), "line 35, column 1 (t)", 'holds "O.330000"')


def test_a_faulty_row_outside_the_selected_rows_does_not_matter(tmp_path: Path) -> None:
    lines = _lines(_table())
    lines[2] = "way to the start"
    path = _csv(tmp_path, _HEADER, *lines)
    description = _description(tmp_path, "rows: {log.csv: [4, 40]}\n")
    _same(read_recording(path, description), _table()[3:])
    description = _description(tmp_path, "rows: {log.csv: [4, 41]}\n")
    _refused(
        path, "ends at row 40, but the description selects rows 4 to 41", description=description
    )
    description = _description(tmp_path, "rows: {log.csv: [400, 410]}\n")
    _refused(path, "selects rows 400 to 410", description=description)


@pytest.mark.parametrize("block", [1 << 20, 150])
def test_time_that_does_not_increase_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: int
) -> None:
    monkeypatch.setattr(text_table, "BLOCK_BYTES", block)
    table = _table()
    table[21, 0] = table[20, 0]
    path = _csv(tmp_path, _HEADER, *_lines(table))
    _refused(path, "line 23, column t", "has the stamp 0.2 s of line 22, but other numbers")
    table[21, 0] = table[18, 0]
    path = _csv(tmp_path, _HEADER, *_lines(table))
    _refused(path, "line 23, column t", "runs backwards from 0.2 s to 0.18 s")


def test_a_clock_of_too_few_digits_is_refused(tmp_path: Path) -> None:
    table = _table()
    table[:, 0] = np.round(0.001 * np.arange(_NUM_ROWS), 2)  # 1 kHz, two decimals
    path = _csv(tmp_path, _HEADER, *_lines(table))
    _refused(path, "line 3, column t", "time repeats 0 s", "too few digits",
             "rate_hz=967 (estimated")  # fmt: skip
    # Followed, the rate takes the place of the log's own time.
    log = read_recording(path, "rate_hz=1000")
    np.testing.assert_allclose(log.t, 0.001 * np.arange(_NUM_ROWS), rtol=0, atol=1e-12)
    np.testing.assert_array_equal(log.q, table[:, 1:3])


def test_a_clock_that_was_never_set_is_no_time(tmp_path: Path) -> None:
    table = _table()
    table[:, 0] = 0.0
    path = _csv(tmp_path, _HEADER, *_lines(table))
    _refused(path, "all stamps are 0", "the log holds no time", "rate_hz=100")
    np.testing.assert_allclose(read_recording(path, "rate_hz=100").time_step, 0.01)


def test_a_clock_that_is_rounded_to_its_step_has_too_few_digits(tmp_path: Path) -> None:
    """A tenth of its stamps or less repeat; those of rows that are written twice are no such."""
    table = _table()
    table[:, 0] = 0.01 * np.arange(_NUM_ROWS)
    for k in (7, 15, 22, 31):
        table[k, 0] = table[k - 1, 0]
    _refused(_csv(tmp_path, _HEADER, *_lines(table)), "too few digits", "rate_hz=100 (estimated")
    twice = np.insert(table, [8, 16, 24], table[[8, 16, 24]], axis=0)
    twice[:, 0] = 0.01 * np.insert(np.arange(_NUM_ROWS), [8, 16, 24], [8, 16, 24])
    twice[[8, 17, 26], 1] += 0.01
    _refused(_csv(tmp_path, _HEADER, *_lines(twice)), "two sources write into this log")


@pytest.mark.parametrize("begin", [1.335e17, 6.38e17])  # of 2024, since 1601 and since the year 1
def test_time_in_steps_of_100_ns_is_recognised_by_its_date(tmp_path: Path, begin: float) -> None:
    table = _table()
    table[:, 0] = begin + 1e5 * np.arange(_NUM_ROWS)
    log = read_recording(_csv(tmp_path, _HEADER, *_lines(table)))
    steps = np.diff(log.t)
    np.testing.assert_allclose(steps, 0.01, rtol=0, atol=2e-5)  # 64 steps are a bit of the number
    assert any("time is read in 100 ns" in notice for notice in log.notices)


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "ms"), (1e6, "us"), (1e9, "ns")])
def test_time_in_another_unit_is_recognised(tmp_path: Path, factor: float, unit: str) -> None:
    table = _table() * [factor, 1, 1, 1, 1, 1, 1]
    path = _csv(tmp_path, _HEADER, *_lines(table))
    recording = read_recording(path)
    np.testing.assert_allclose(recording.t, _table()[:, 0], rtol=0, atol=1e-9)
    assert any(f"time is read in {unit}" in notice for notice in recording.notices)
    description = _description(tmp_path)
    _refused(
        path, "column t", "the median step is", f"it looks like {unit}", description=description
    )


@pytest.mark.parametrize(
    ("names", "place"),
    [
        ("timestamp_ms", "column timestamp_ms"),
        ("header.sec,header.nanosec", "columns header.sec, "),
    ],
)
def test_faults_of_time_name_the_columns_of_the_log(tmp_path: Path, names: str, place: str) -> None:
    table = _table()
    table[20, 0] = table[18, 0]
    t, signals = table[:, :1], table[:, 1:]
    columns = [0 * t, 1e9 * t, signals] if "," in names else [1e3 * t, signals]
    header = _HEADER.replace("t,", f"{names},", 1)
    path = _csv(tmp_path, header, *_lines(np.concatenate(columns, axis=1)))
    _refused(path, f"line 22, {place}", "runs backwards")


def test_time_whose_unit_the_velocities_contradict_is_refused(tmp_path: Path) -> None:
    """At 1 Hz, with velocities that fit to seconds, the step is no millisecond."""
    t = np.arange(40.0)
    table = np.c_[t, 0.5 * np.sin(0.1 * t), 0 * t, 0.05 * np.cos(0.1 * t), 0 * t, t, t]
    path = _csv(tmp_path, _HEADER, *_lines(table))
    _refused(path, "the median step is 1 s")


def test_too_few_samples_a_second_are_not_taken_for_milliseconds(tmp_path: Path) -> None:
    """At 2 Hz a joint at 1 rad/s would move at 1000 rad/s, were the time in ms."""
    t = 0.5 * np.arange(40.0)
    table = np.c_[t, 5 * np.sin(0.4 * t), 0 * t, 2 * np.cos(0.4 * t), 0 * t, t, t]
    path = _csv(tmp_path, _HEADER, *_lines(table))
    _refused(path, "the median step is 0.5 s", "record 50 samples a second or more")


@pytest.mark.parametrize("names", ["q{}", "q_{}", "q[{}]", "state.q[{}]"])
def test_joints_may_be_numbered_from_0(tmp_path: Path, names: str) -> None:
    table = _table()
    header = "time," + ",".join(
        names.replace("q", letter).format(j) for letter in ("q", "dq", "i") for j in range(2)
    )
    recording = read_recording(_csv(tmp_path, header, *_lines(table)))
    np.testing.assert_array_equal(recording.q, table[:, 1:3])
    np.testing.assert_array_equal(recording.v, table[:, 3:5])
    np.testing.assert_array_equal(recording.current, table[:, 5:7])


def test_a_log_without_a_time_is_read_at_a_stated_rate(tmp_path: Path) -> None:
    table = _table()
    lines = _lines(table[:, 1:])
    path = _csv(tmp_path, "q1,q2,v1,v2,i1,i2", *lines)
    expected = np.arange(len(table)) / 80.0
    description = tmp_path / "rated.yaml"
    description.write_text("rate_hz: 80\nposition: {columns: 1-2}\nvelocity: {columns: 3-4}\n")
    for log_format in ("rate_hz=80", description):
        recording = read_recording(path, log_format)
        np.testing.assert_allclose(recording.t, expected, rtol=0, atol=1e-12)
        np.testing.assert_array_equal(recording.q, table[:, 1:3])
    with pytest.raises(InputError, match=r"rate_hz.*is no rate"):
        read_recording(path, "rate_hz=fast")


def test_words_without_a_sign_are_named_before_their_size(tmp_path: Path, ur10e: Robot) -> None:
    """Of positions and velocities, too: 4.29e9 is no damaged row, but -1 as a word of 32 bits."""
    t = 0.01 * np.arange(200)
    counts = np.round(5e5 * np.sin(6.0 * t))
    rows = np.c_[t, np.tile(counts[:, None] % 2.0**32, (1, 12)), np.ones((200, 6))]
    names = ["t", *(f"{letter}{j}" for letter in ("q", "v", "i") for j in range(1, 7))]
    path = _csv(tmp_path, ",".join(names), *[",".join(f"{x:.12g}" for x in row) for row in rows])
    with pytest.raises(InputError, match="v1: holds words of 32 bits without a sign") as caught:
        read_recording(path, None, ur10e)
    assert "set velocity: {encoding: twos_complement, bits: 32" in str(caught.value)


def test_words_without_a_sign_are_decoded(tmp_path: Path) -> None:
    table = _table()
    table[:, 5:] = np.random.default_rng(2).integers(-300, 300, (len(table), 2))
    expected = table[:, 5:] * 0.01
    for encoding, encode in (
        ("twos_complement", lambda x: np.where(x < 0, x + 65536, x)),
        ("sign_bit", lambda x: np.where(x < 0, 32768 - x, x)),
    ):
        words = np.c_[table[:, :5], encode(table[:, 5:])]
        path = _csv(tmp_path, _HEADER, *_lines(words))
        description = _description(tmp_path)
        signed = f"columns: 6-7, gain: [0.01], encoding: {encoding}"
        description.write_text(description.read_text().replace("columns: 6-7", signed))
        current = read_recording(path, description).current
        np.testing.assert_allclose(current, expected, rtol=0, atol=1e-12)


def test_wrapped_angles_are_continued(tmp_path: Path) -> None:
    table = _table()
    t = table[:, 0]
    q = 2.5 + 2.0 * t
    table[:, 1], table[:, 2], table[:, 3], table[:, 4] = q, 0.1 * t, 2.0, 0.1
    wrapped = table.copy()
    wrapped[:, 1] = (q + np.pi) % (2 * np.pi) - np.pi
    recording = read_recording(_csv(tmp_path, _HEADER, *_lines(wrapped)))
    np.testing.assert_allclose(recording.q[:, 0], q, rtol=0, atol=1e-5)
    assert any("joint 1 1 times" in notice for notice in recording.notices)
    counts = table.copy()
    counts[:, 1] = np.rint(9000.0 + 1e3 * q) + 6.0 * (np.arange(len(q)) % 2)
    recording = read_recording(_csv(tmp_path, _HEADER, *_lines(counts)))
    assert not any("jump by a turn" in notice for notice in recording.notices)


@pytest.mark.parametrize("block", [1 << 20, 150])
def test_repeated_and_unset_stamps_are_left_out_and_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: int
) -> None:
    monkeypatch.setattr(text_table, "BLOCK_BYTES", block)
    table = _table()
    table[:, 0] += 1000.0
    lines = _lines(table)
    unset = [line.replace(line.split(",")[0], "0", 1) for line in lines[:3]]
    doubled = [*unset, *lines[3:20], lines[19], lines[18], *lines[20:]]
    recording = read_recording(_csv(tmp_path, _HEADER, *doubled))
    np.testing.assert_array_equal(recording.q, table[3:, 1:3])
    assert any("repeat another one with its stamp: 2" in notice for notice in recording.notices)
    assert any("stamp is not set: 3" in notice for notice in recording.notices)


def test_velocities_that_a_driver_does_not_fill_are_differentiated(tmp_path: Path) -> None:
    table = _table()
    t = table[:, 0]
    table[:, 1], table[:, 2], table[:, 3:5] = np.sin(t), np.cos(t), 0.0
    recording = read_recording(_csv(tmp_path, _HEADER, *_lines(table)))
    np.testing.assert_allclose(recording.v[5:-5, 0], np.cos(t)[5:-5], rtol=0, atol=2e-3)
    assert any("stand still while the joints move (all)" in n for n in recording.notices)
    table[:, 1], table[:, 3] = 0.3, 0.5  # exchanged columns, rather than idle ones
    recording = read_recording(_csv(tmp_path, _HEADER, *_lines(table)))
    np.testing.assert_array_equal(recording.v[:, 0], 0.5)


def test_an_archive_of_one_file_is_read(tmp_path: Path) -> None:
    plain = _good(tmp_path)
    packed = tmp_path / "attached.zip"
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.write(plain, "run/log.csv")
        archive.writestr("__MACOSX/run/._log.csv", b"\0")
    _same(read_recording(packed), _table())
    with zipfile.ZipFile(packed, "a") as archive:
        archive.writestr("run/second.csv", "t\n")
    _refused(packed, "cannot be unpacked (2 files: run/log.csv, run/second.csv; expected one)")
    packed.write_bytes(b"PK\x03\x04" + bytes(40))
    _refused(packed, "cannot be unpacked")


@pytest.mark.parametrize("suffix", [".gz", ".bz2", ".xz", ".zst"])
def test_a_packed_log_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str) -> None:
    import bz2
    import gzip
    import lzma

    from backports import zstd

    pack = {".gz": gzip.compress, ".bz2": bz2.compress, ".xz": lzma.compress, ".zst": zstd.compress}
    plain = _csv(tmp_path, _HEADER, *_lines(_table()), name="log.txt")
    packed = tmp_path / f"other.csv{suffix}"
    packed.write_bytes(pack[suffix](plain.read_bytes()))
    np.testing.assert_array_equal(read_recording(packed).q, _table()[:, 1:3])
    capitals = _csv(tmp_path, _HEADER.upper(), *_lines(_table()), name="capitals.txt")
    packed.write_bytes(pack[suffix](capitals.read_bytes()))
    np.testing.assert_array_equal(read_recording(packed).q, _table()[:, 1:3])
    for lines, problem in (
        ((_HEADER, "0,x,0,0,0,0,0"), 'line 2, column 2 (q1): holds "x"'),
        (("q1,q2", "0,0"), "has no column of time"),
    ):
        packed.write_bytes(pack[suffix]("\n".join(lines).encode()))
        with pytest.raises(InputError) as refusal:
            read_recording(packed)
        assert str(refusal.value).startswith(f"{packed}: ")
        assert problem in str(refusal.value)
    packed.write_bytes(pack[suffix](capitals.read_bytes())[:-20] + bytes(20))
    _refused(packed, "cannot be unpacked")
    # The bound itself takes seconds to pack.
    monkeypatch.setattr(packed_file, "_LARGEST_FILE", 1 << 22)
    packed.write_bytes(pack[suffix](bytes(1 << 22) + b"1"))
    _refused(packed, "bytes that unpack to")


# --- cells that may be empty --------------------------------------------------------------------


def _with_gaps(tmp_path: Path, suffix: str) -> tuple[Path, Path, np.ndarray]:
    """A log that lacks its positions in rows 6 to 8, its description, and its numbers."""
    table = _table()
    table[5:8, 1:3] = np.nan
    if suffix == ".csv":
        lines = [",".join("" if np.isnan(x) else repr(float(x)) for x in row) for row in table]
        path = _csv(tmp_path, *lines)
    else:
        path = tmp_path / "log.parquet"
        names = [f"c{k + 1}" for k in range(7)]
        columns = [pa.array(x, from_pandas=True) for x in table.T]
        pq.write_table(pa.table(columns, names), path)
    description = _description(tmp_path, "header: false\n" if suffix == ".csv" else "")
    text = description.read_text().replace("2-3}", "2-3, may_be_empty: true}")
    description.write_text(text)
    return path, description, table


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_an_empty_cell_is_a_dropout_where_the_description_allows_it(
    tmp_path: Path, suffix: str
) -> None:
    path, description, table = _with_gaps(tmp_path, suffix)
    recording = read_recording(path, description)
    _same(recording, table)  # NaN where it is empty
    np.testing.assert_array_equal(np.flatnonzero(recording.dropout), [5, 6, 7])


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_samples_that_lack_a_number_are_left_out(tmp_path: Path, suffix: str) -> None:
    path, description, table = _with_gaps(tmp_path, suffix)
    description.write_text(description.read_text().replace(", may_be_empty: true", ""))
    recording = read_recording(path, description)
    _same(recording, np.delete(table, [5, 6, 7], axis=0))
    (notice,) = recording.notices
    assert notice.startswith("samples left out because they lack a number: 3 (first: ")
    assert "6, column 2)" in notice if suffix == ".csv" else "row 6, c2)" in notice
    on_grid = resampled(recording)  # the gap of 40 ms is bridged there, and flagged
    np.testing.assert_array_equal(np.flatnonzero(on_grid.dropout), [5, 6, 7])
    assert on_grid.num_samples == _NUM_ROWS


@pytest.mark.parametrize("cell", ["", "nan", "NaN", "null", "NULL", "None", "N/A", "-"])
def test_a_sample_with_an_empty_cell_or_nan_is_left_out(tmp_path: Path, cell: str) -> None:
    lines = _lines(_table())
    cells = lines[10].split(",")
    lines[10] = ",".join([*cells[:3], cell, *cells[4:]])
    recording = read_recording(_csv(tmp_path, _HEADER, *lines))
    _same(recording, np.delete(_table(), 10, axis=0))
    assert "lack a number: 1 (first: line 12, v1)" in recording.notices[0]
    lines[10] = ",".join([cell, *cells[1:]])
    _refused(_csv(tmp_path, _HEADER, *lines), "line 12, column 1 (t)")


def test_a_number_that_stands_for_none_is_missing(tmp_path: Path) -> None:
    table = _table()
    table[5, 6] = table[7, 1] = -99999.0
    lines = [",".join(f"{x:.6f}" for x in row) for row in table]
    log = read_recording(_csv(tmp_path, _HEADER, *lines))
    assert log.num_samples == len(table) - 2
    assert any("lack a number: 2 (first: line 7, i2)" in notice for notice in log.notices)


def test_a_row_of_another_topic_is_none(tmp_path: Path) -> None:
    """Without any number of the joints, and without their stamp; others need it."""
    lines = [f"{line},\n,,,,,,,7.0" for line in _lines(_table())]
    _same(read_recording(_csv(tmp_path, f"{_HEADER},load", *lines)), _table())
    lines[3] = lines[3].replace("\n,,", "\n,1.5,")
    path = _csv(tmp_path, f"{_HEADER},load", *lines)
    _refused(path, "line 9, column 1 (t)", "is empty, expected a number")


def test_velocities_and_torques_without_any_number_are_left_out(
    tmp_path: Path, ur10e: Robot
) -> None:
    rows = np.c_[0.01 * np.arange(50), np.tile(np.linspace(0, 0.1, 50)[:, None], 6)]
    header = "t," + ",".join(f"{x}{j}" for x in ("q", "v", "tau") for j in range(1, 7))
    lines = [",".join([*map(repr, row.tolist()), *[".nan"] * 12]) for row in rows]
    path = _csv(tmp_path, header, *lines)
    log = read_recording(path, None, ur10e, check=False)
    assert any("the velocities are left out" in notice for notice in log.notices)
    with pytest.raises(InputError, match=r"its torques hold no number.*have the driver fill them"):
        read_recording(path, None, ur10e, joint_signals=True)


def test_a_column_without_any_number_is_named(tmp_path: Path) -> None:
    rows = [row.rsplit(",", 1)[0] + "," for row in _lines(_table())]
    _refused(_csv(tmp_path, _HEADER, *rows), "40 lack one, first line 2, i2")


def test_rows_that_are_selected_of_other_files_only_give_a_notice(tmp_path: Path) -> None:
    _csv(tmp_path, *_lines(_table()), name="numbers.csv")
    text = "header: false\nrows: {other.csv: [3, 20], third.csv: []}\n"
    recording = read_recording(tmp_path / "numbers.csv", _description(tmp_path, text))
    (notice,) = recording.notices
    assert "selects rows of 2 files, but not of numbers.csv" in notice


def test_velocities_that_are_not_logged_are_differentiated(tmp_path: Path) -> None:
    table = _table(200)
    names = [name for name in _HEADER.split(",") if not name.startswith("v")]
    path = _csv(tmp_path, ",".join(names), *_lines(np.delete(table, [3, 4], axis=1)))
    recording = read_recording(path)
    RecordingReader(path).require_joint_signals()
    assert "the log holds no velocities" in recording.notices[0]
    # six decimals at 100 Hz, and 2 rad/s^4 over a window of 8 samples
    np.testing.assert_allclose(recording.v[4:-4], table[4:-4, 3:5], atol=2e-4)


@pytest.mark.parametrize(
    "header", ["sec,nanosec", "header.stamp.sec,header.stamp.nanosec,header.frame_id", "t_s,t_ns"]
)
def test_time_in_seconds_and_nanoseconds_is_read(tmp_path: Path, header: str) -> None:
    table = _table()
    stamps = np.round(table[:, 0] * 1e9).astype(int) + 1_700_000_000 * 10**9
    head = [f"{stamp // 10**9},{stamp % 10**9}" for stamp in stamps]
    if "frame_id" in header:
        head = [cells + ",base" for cells in head]
    lines = [f"{a},{b}" for a, b in zip(head, _lines(table[:, 1:]), strict=True)]
    path = _csv(tmp_path, header + "," + _HEADER.removeprefix("t,"), *lines)
    recording = read_recording(path)
    np.testing.assert_array_equal(recording.t, 1_700_000_000 + table[:, 0])
    np.testing.assert_array_equal(recording.q, table[:, 1:3])
    description = tmp_path / "two.yaml"
    description.write_text("time: {columns: '1, 2', unit: ms}\nposition: {columns: 'q{1..2}'}\n")
    with pytest.raises(InputError, match="two columns, seconds and nanoseconds"):
        read_recording(path, description)


def test_a_word_is_no_empty_cell(tmp_path: Path) -> None:
    path, description, _ = _with_gaps(tmp_path, ".csv")
    path.write_text(path.read_text().replace(",,", ",none,", 1))
    with pytest.raises(InputError, match=r'line 6, column 2.*holds "none"'):
        read_recording(path, description)


def test_time_may_not_be_empty(tmp_path: Path) -> None:
    path, description, _ = _with_gaps(tmp_path, ".csv")
    text = description.read_text().replace("time: {columns: 1}", "time: {columns: 1, MAY}")
    description.write_text(text.replace("MAY", "may_be_empty: true"))
    with pytest.raises(InputError, match="every sample needs its time"):
        read_recording(path, description)


def test_a_log_with_gaps_is_checked_against_its_robot(
    ur10e: Robot, data: Callable[[str], Path]
) -> None:
    path = data("ur10e_contact/straight_UR_F35_g1_v0.10.csv")
    recording = read_recording(path, "ur10e-contact", ur10e)
    table = np.genfromtxt(path, delimiter=",", names=True)
    np.testing.assert_array_equal(recording.q[:, 3], table["q4"])
    np.testing.assert_array_equal(recording.extra["sensor_force"][:, 0], table["Fz_ati"])
    np.testing.assert_array_equal(recording.dropout, np.isnan(table["q1"]))
    assert 0 < recording.dropout.sum() < 200


# --- real logs ---------------------------------------------------------------------------------


def test_the_ur10e_log_is_recognised_by_its_name(data: Callable[[str], Path]) -> None:
    path = data("ur10e/ur-20_02_19_14harm50secLoad.csv")
    recording = read_recording(path)
    table = np.loadtxt(path, delimiter=",")[307:5071]
    np.testing.assert_array_equal(recording.t, table[:, 0])
    np.testing.assert_array_equal(recording.q, table[:, 1:7])
    np.testing.assert_array_equal(recording.v, table[:, 7:13])
    np.testing.assert_array_equal(recording.current, table[:, 13:19])
    np.testing.assert_array_equal(recording.extra["tau_desired"], table[:, 25:31])
    assert recording.notices == ('columns read as "ur10e-dynamic-calibration", rows 308 to 5071',)


def test_the_ur10e_log_under_another_name_needs_the_description(
    tmp_path: Path, data: Callable[[str], Path]
) -> None:
    path = tmp_path / "copy.csv"
    path.write_bytes(data("ur10e/ur-20_02_10-30sec_12harm.csv").read_bytes())
    _refused(path, "line 1: holds 31 numbers and no names", "--log-format")
    recording = read_recording(path, "ur10e-dynamic-calibration")
    assert recording.num_samples == len(np.loadtxt(path, delimiter=","))


def test_the_panda_log_is_recognised_by_its_columns(data: Callable[[str], Path]) -> None:
    path = data("panda_ati_gamma/data_pos_3.csv")
    recording = read_recording(path)
    table = np.genfromtxt(path, delimiter=",", names=True)
    np.testing.assert_array_equal(recording.extra["jacobian"][:, 2, 4], table["jacobian_2_4"])
    np.testing.assert_array_equal(recording.extra["tau_ext"][:, 6], table["tau_ext_6"])
    np.testing.assert_array_equal(
        recording.extra["sensor_moment"][:, 1], table["ft_wrench_torque_y"]
    )
    assert recording.num_joints == 0
    with pytest.raises(InputError, match="holds no joint positions"):
        RecordingReader(path).require_joint_signals()
