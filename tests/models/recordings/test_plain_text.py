"""Tables that are not written plainly: the same numbers as of the plain table."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings import plain_text
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_reader import read_recording

T = 0.01 * np.arange(40)
TABLE = np.round(np.c_[np.sin(T), np.cos(T), np.cos(T), -np.sin(T), 1.0 + T, 2.0 - T], 6)

_TWO_JOINTS = SimpleNamespace(
    joint_names=("shoulder", "elbow"),
    num_joints=2,
    name="two",
    q_offset=np.zeros(2),
    has_inertias=False,
    is_coupled=False,
    torque_per_ampere=np.ones(2),
    current_sign=np.ones(2),
    motor_current=lambda tau_J: tau_J,
    velocity_limit=np.full(2, np.inf),
    position_lower=np.full(2, -np.inf),
    position_upper=np.full(2, np.inf),
    chain=SimpleNamespace(prismatic=np.zeros(2, bool)),
)


def _same(log: Recording) -> None:
    np.testing.assert_allclose(log.t, T, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(np.c_[log.q, log.v, log.current], TABLE)


def test_text_of_a_western_code_page_is_read(tmp_path: Path) -> None:
    units = {"Winkel": "°", "Vel": "rad/s", "Strom": "A"}
    names = ["Time [µs]", *(f"{word}{j} [{units[word]}]" for word in units for j in (1, 2))]
    in_file = np.c_[1e6 * T, np.rad2deg(TABLE[:, :2]), TABLE[:, 2:]]
    lines = [";".join(names), *(";".join(f"{x:.9f}" for x in row) for row in in_file)]
    path = tmp_path / "log.csv"
    path.write_bytes("\r\n".join(lines).encode("latin-1"))
    log = read_recording(path)
    np.testing.assert_allclose(log.t, T, rtol=0, atol=1e-9)
    np.testing.assert_allclose(log.q, TABLE[:, :2], rtol=0, atol=1e-9)
    assert "text in Windows' code page 1252 is read" in log.notices


@pytest.mark.parametrize(
    ("encoding", "current", "notice"),
    [("gbk", "电流", "text in GB 18030 (GBK) is read"), ("shift_jis", "電流", "in Shift JIS")],
)
def test_text_of_an_eastern_code_page_is_read(
    tmp_path: Path, encoding: str, current: str, notice: str
) -> None:
    words = {"位置": "rad", "速度": "rad/s", current: "A"}
    names = ["time", *(f"軸{j}{word}({unit})" for word, unit in words.items() for j in (1, 2))]
    lines = [",".join(f"{x:.6f}" for x in row) for row in np.c_[T, TABLE]]
    path = tmp_path / "log.csv"
    path.write_bytes("\r\n".join([",".join(names), *lines]).encode(encoding))
    log = read_recording(path)
    _same(log)
    assert any(notice in text for text in log.notices)


@pytest.mark.parametrize("block", [1 << 20, 100])
@pytest.mark.parametrize("kind", ["aligned", "quoted"])
def test_blanks_between_cells_are_no_cells(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, block: int
) -> None:
    """As C and Fortran align columns, or with quotes behind blanks; errors keep their lines."""
    monkeypatch.setattr(plain_text, "_BLOCK_BYTES", block)
    rows = [["t", "q1", "q2", "v1", "v2", "i1", "i2"]]
    rows += [[f"{x:.6f}" for x in row] for row in np.c_[T, TABLE]]
    if kind == "aligned":
        lines = ["".join(f"{cell:>12}" for cell in row) for row in rows]
    else:
        lines = [", ".join(f'"{cell}"' for cell in row) for row in rows]
    path = tmp_path / "log.dat"
    path.write_text("\n".join(lines) + "\n")
    _same(read_recording(path))
    lines[20] = lines[20].replace("0.190000", "soon    ")
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError, match=r'line 21, column 1 \(t\).*holds "soon"'):
        read_recording(path)


@pytest.mark.parametrize("block", [1 << 20, 100])
def test_units_in_cells_become_those_of_their_columns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: int
) -> None:
    monkeypatch.setattr(plain_text, "_BLOCK_BYTES", block)
    units = ["sec", "deg", "deg", "rad/s", "rad/s", "mA", "mA"]
    scale = [1.0, 180 / np.pi, 180 / np.pi, 1.0, 1.0, 1e3, 1e3]
    rows = np.c_[T, TABLE] * scale
    lines = [",".join(f"{x:.9f} {unit}" for x, unit in zip(row, units, strict=True))
             for row in rows]  # fmt: skip
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["Time,q1,q2,v1,v2,current1,current2", *lines]))
    log = read_recording(path)
    read = np.c_[log.t, log.q, log.v, log.current]
    np.testing.assert_allclose(read, np.c_[T, TABLE], rtol=0, atol=1e-9)


def test_arrays_that_numpy_breaks_within_quotes_are_lists(tmp_path: Path) -> None:
    rows = [
        f"{t:.2f},[ {' '.join(map(str, q))} ],"
        + f'"[{q[0]} {q[1]}  {q[2]}  {q[3]}\n {q[4]} {q[5]}]"'
        for t, q in zip(T, TABLE, strict=True)
    ]
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["Time,Position,Current", *rows]) + "\n")
    log = read_recording(path, check=False)
    np.testing.assert_array_equal(log.q, TABLE)
    np.testing.assert_array_equal(log.current, TABLE)


def test_two_carriage_returns_are_one_line_end(tmp_path: Path) -> None:
    lines = ["t,q1,q2,v1,v2,i1,i2", *(",".join(f"{x:.6f}" for x in r) for r in np.c_[T, TABLE])]
    path = tmp_path / "log.csv"
    path.write_bytes("\r\r\n".join([*lines, ""]).encode())
    log = read_recording(path)
    _same(log)
    assert log.row is not None
    assert log.row[0] == 2


@pytest.mark.parametrize("ros", [1, 2])
@pytest.mark.parametrize("in_one_line", [True, False])
@pytest.mark.parametrize("block", [1 << 20, 100])
def test_printed_messages_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ros: int, in_one_line: bool, block: int
) -> None:
    """As topic echo prints JointStates, joints in another order than the robot's."""
    monkeypatch.setattr(plain_text, "_BLOCK_BYTES", block)
    words = ("secs", "nsecs") if ros == 1 else ("sec", "nanosec")

    def array(key: str, entries: list[str]) -> str:
        if in_one_line:
            return f"{key}: [{', '.join(entries)}]"
        return "\n".join([f"{key}:", *(f"- {entry}" for entry in entries)])

    messages = []
    for t, row in zip(T, TABLE, strict=True):
        q, v, effort = row.reshape(3, 2)[:, ::-1]
        lists = {"position": q, "velocity": v, "effort": effort}
        messages.append(
            f"header:\n  seq: 7\n  stamp:\n    {words[0]}: 50\n    {words[1]}: {round(t * 1e9)}\n"
            "  frame_id: ''\n" + array("name", ["elbow", "shoulder"]) + "\n"
            + "\n".join(array(key, [f"{x:.6f}" for x in x_]) for key, x_ in lists.items())
        )  # fmt: skip
    path = tmp_path / "log.txt"
    path.write_text("\n---\n".join([*messages, ""]))
    log = read_recording(path, "effort-in-newton-metres", _TWO_JOINTS, check=False)
    np.testing.assert_allclose(log.t, 50.0 + T, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(np.c_[log.q, log.v, log.tau_J], TABLE)
    assert "read as messages that `ros2 topic echo` has printed" in log.notices


def test_printed_messages_of_one_joint_each_are_joined(tmp_path: Path) -> None:
    """As boards of one motor each publish them, some ms apart."""
    messages = []
    for t, row in zip(T, TABLE, strict=True):
        for j, name in enumerate(("elbow", "shoulder")):
            lists = zip(("position", "velocity", "effort"), row[1 - j :: 2], strict=True)
            messages.append(
                f"header:\n  stamp:\n    sec: 50\n    nanosec: {round(t * 1e9) + 2_000_000 * j}\n"
                f"name:\n- {name}\n" + "\n".join(f"{key}:\n- {x:.6f}" for key, x in lists)
            )  # fmt: skip
    path = tmp_path / "log.txt"
    path.write_text("\n---\n".join([*messages, ""]))
    log = read_recording(path, "effort-in-newton-metres", _TWO_JOINTS, check=False)
    # At the stamps of the shoulder, linear between those of the elbow, 2 ms before it.
    t = log.t - 50.0
    assert len(t) == len(T) - 1  # the elbow has none behind the last one
    np.testing.assert_allclose(t, T[:-1] + 0.002, rtol=0, atol=1e-6)
    np.testing.assert_allclose(log.q[:, 0], TABLE[:-1, 0], rtol=0, atol=1e-6)
    np.testing.assert_allclose(log.q[:, 1], np.cos(t), rtol=0, atol=0.002)
    assert any("rows of their own" in notice for notice in log.notices)


def test_arrays_that_were_left_out_are_told(tmp_path: Path) -> None:
    for name, words in (("log.txt", "<array type: float64, length: 6>"),
                        ("log.yaml", "'<sequence type: double, length: 6>'")):  # fmt: skip
        message = (
            f"header:\n  stamp:\n    sec: 50\n    nanosec: 0\nname: {words}\nposition: {words}\n"
        )
        path = tmp_path / name
        path.write_text("---\n".join([message] * 20))
        with pytest.raises(InputError, match="lengths of arrays alone"):
            read_recording(path)


@pytest.mark.parametrize("encoding", ["utf-16-le", "utf-16-be"])
def test_text_in_utf_16_is_read(tmp_path: Path, encoding: str) -> None:
    lines = ["t\tq1\tq2\tv1\tv2\ti1\ti2"]
    lines += ["\t".join(f"{x:.6f}" for x in row) for row in np.c_[T, TABLE]]
    path = tmp_path / "log.txt"
    path.write_bytes(("\ufeff" + "\r\n".join(lines)).encode(encoding))
    log = read_recording(path)
    _same(log)
    assert "text in UTF-16 is read" in log.notices


def _scope(tmp_path: Path) -> Path:
    """An export of TwinCAT Scope: time and value of each channel, a tag at the end."""
    names = [f"GVL.f{word}_J{j}" for word in ("ActPos", "ActVel", "ActCurrent") for j in (1, 2)]
    lines = ["Name;Robot Scope", "File;C:\\Scope\\robot.tcscopex", ""]
    for label, value in (("Name", None), ("Data-Type", "REAL64"), ("Offset", "0")):
        lines.append(";".join(f"{label};{value or name}" for name in names))
    lines.append("")
    for k, row in enumerate(TABLE):
        lines.append(";".join(f"{10 * k};{x:.6f}".replace(".", ",") for x in row))
    path = tmp_path / "scope.csv"
    path.write_bytes("\r\n".join([*lines, "EOF", ""]).encode())
    return path


def test_an_export_of_twincat_scope_is_read(tmp_path: Path) -> None:
    path = _scope(tmp_path)
    log = read_recording(path)
    _same(log)
    assert any("read as an export of TwinCAT Scope" in notice for notice in log.notices)
    # The rows keep the numbers of their lines, and a description may use the channels' names.
    assert log.row is not None
    assert log.row[0] == 8
    description = tmp_path / "columns.yaml"
    description.write_text(
        'separator: ";"\ndecimal_mark: ","\nskip_lines: 6\n'
        'time: {columns: "Time [ms]", unit: ms}\nposition: {columns: "GVL.fActPos_J{1..2}"}\n'
        'velocity: {columns: "GVL.fActVel_J{1..2}"}\n'
        'current: {columns: "GVL.fActCurrent_J{1..2}"}\n'
    )
    _same(read_recording(path, description))


def _message(t: float, names: list[str], **lists: list[float]) -> str:
    stamp = f"header:\n  stamp:\n    sec: 50\n    nanosec: {round(t * 1e9)}\n"
    texts = {"name": names} | lists
    return stamp + "".join(f"{key}: {x}\n" for key, x in texts.items()) + "---\n"


def test_printed_messages_of_another_publisher_are_left_out(tmp_path: Path) -> None:
    """Without velocity and effort, and with the joints in another order."""
    path = tmp_path / "log.txt"
    text = ""
    for t, row in zip(T, TABLE, strict=True):
        q, v, effort = row.reshape(3, 2).tolist()
        text += _message(t, ["joint_1", "joint_2"], position=q, velocity=v, effort=effort)
        text += _message(t + 0.004, ["joint_2", "joint_1"], position=[0.0, 0.0], velocity=[])
    path.write_text(text)
    log = read_recording(path, "effort-in-newton-metres")
    np.testing.assert_allclose(log.t, 50.0 + T, rtol=0, atol=1e-9)
    assert log.tau_J is not None
    np.testing.assert_array_equal(np.c_[log.q, log.v, log.tau_J], TABLE)
    assert any("lack a number: 40" in notice for notice in log.notices)


def test_printed_names_may_be_those_of_interfaces(tmp_path: Path) -> None:
    names = [f"joint_{j}/{word}" for j in (1, 2) for word in ("position", "velocity", "effort")]
    numbers = TABLE.reshape(-1, 3, 2).transpose(0, 2, 1).reshape(-1, 6)  # joint by joint
    path = tmp_path / "log.txt"
    path.write_text("".join(_message(t, names, position=row.tolist())
                            for t, row in zip(T, numbers, strict=True)))  # fmt: skip
    log = read_recording(path, "effort-in-newton-metres")
    assert log.tau_J is not None
    np.testing.assert_array_equal(np.c_[log.q, log.v, log.tau_J], TABLE)


@pytest.mark.parametrize("in_one_line", [True, False])
def test_printed_interfaces_of_each_joint_are_read(tmp_path: Path, in_one_line: bool) -> None:
    """As topic echo prints DynamicJointStates, with an interface that is no signal of a joint."""

    def array(indent: str, key: str, entries: list[str]) -> str:
        if in_one_line:
            return f"{indent}{key}: [{', '.join(entries)}]\n"
        return f"{indent}{key}:\n" + "".join(f"{' ' * len(indent)}- {x}\n" for x in entries)

    text = ""
    for t, row in zip(T, TABLE, strict=True):
        text += f"header:\n  stamp:\n    sec: 50\n    nanosec: {round(t * 1e9)}\n  frame_id: ''\n"
        text += array("", "joint_names", ["joint_1", "joint_2"]) + "interface_values:\n"
        for q, v, effort in row.reshape(3, 2).T:
            text += array("- ", "interface_names", ["effort", "position", "heat", "velocity"])
            text += array("  ", "values", [f"{x:.6f}" for x in (effort, q, 35.0, v)])
        text += "---\n"
    path = tmp_path / "log.txt"
    path.write_text(text)
    log = read_recording(path, "effort-in-newton-metres")
    np.testing.assert_allclose(log.t, 50.0 + T, rtol=0, atol=1e-9)
    assert log.tau_J is not None
    np.testing.assert_array_equal(np.c_[log.q, log.v, log.tau_J], TABLE)
