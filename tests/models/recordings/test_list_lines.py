"""Lines of lists without a header are a table; a table with lists in its cells stays one."""

from pathlib import Path

import numpy as np
import pytest

from wrenchsight.models.recordings import plain_text
from wrenchsight.models.recordings.list_lines import are_list_lines, table_of_list_lines
from wrenchsight.models.recordings.recording_reader import RecordingReader, read_recording

T = 0.01 * np.arange(60)
Q = np.round(np.c_[np.sin(T), np.cos(T)], 6)
I = np.round(np.c_[3.0 + T, 1.0 - 2.0 * T], 6)  # noqa: E741


def _numpy(row: np.ndarray) -> str:
    """As NumPy prints an array, broken within it."""
    return "[" + "\n ".join(f"{x: .6f}" for x in row) + "]"


def _numbers(row: np.ndarray) -> str:
    return ", ".join(f"{x:.6f}" for x in row)


_FORMS = {  # of a sample at t with positions q and currents i; what read_recording is told
    "tuples": lambda t, q, i: f"#pos: ({t:.2f}, array([{q}]))\n#cur: ({t:.2f}, array([{i}]))",
    "log": lambda t, q, i: f"[INFO] [{1.7e9 + t:.2f}]: pos ({q}) current ({i})",
    "dictionary": lambda t, q, i: f"{{'stamp': {t:.2f}, 'q': [{q}], 'current': [{i}]}}",
    "apart": lambda t, q, i: f"time: {t:.2f}\nq: [{q}]\ncurrent: [{i}]",
    "alternating": lambda t, q, i: f"q: [{q}]\nmotor current: [{i}]",
}


@pytest.mark.parametrize("block", [1 << 20, 300])
@pytest.mark.parametrize("form", _FORMS)
def test_printed_lists_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, form: str, block: int
) -> None:
    monkeypatch.setattr(plain_text, "_BLOCK_BYTES", block)
    path = tmp_path / "print.txt"
    rows = zip(T, Q, I, strict=True)
    path.write_text("".join(f"{_FORMS[form](t, _numbers(q), _numbers(i))}\n" for t, q, i in rows))
    log = read_recording(path, "rate_hz=100" if form == "alternating" else None)
    begin = 1.7e9 if form == "log" else 0.0
    np.testing.assert_allclose(log.t - begin, T, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(np.c_[log.q, log.current], np.c_[Q, I])
    assert log.row is not None
    assert log.row[-1] == len(path.read_text().splitlines()) - (form == "tuples")


def test_arrays_that_numpy_breaks_are_one_line(tmp_path: Path) -> None:
    path = tmp_path / "print.txt"
    text = "".join(
        f"t {t:.2f} q {_numpy(q)} i {_numpy(i)}\n" for t, q, i in zip(T, Q, I, strict=True)
    )
    path.write_text(text)
    log = read_recording(path)
    np.testing.assert_allclose(log.t, T, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(np.c_[log.q, log.current], np.c_[Q, I])


def test_a_bracket_that_is_not_closed_costs_some_lines(tmp_path: Path) -> None:
    path = tmp_path / "print.txt"
    lines = [
        f"t {t:.2f} q [{_numbers(q)}] i [{_numbers(i)}]" for t, q, i in zip(T, Q, I, strict=True)
    ]
    lines[20] = lines[20][:-1]
    path.write_text("\n".join(lines) + "\n")
    read = RecordingReader(path).table.blocks([0])
    assert sum(len(rows) for _, rows in read) >= len(T) - 17


def test_lists_in_the_order_of_a_program_have_its_names(tmp_path: Path) -> None:
    """YARP's stateExt: position, velocity, acceleration of joint and motor, torque, pwm, ..."""
    path = tmp_path / "data.log"
    zeros = "(0 0)"
    lines = []
    for k, (t, q, i) in enumerate(zip(T, np.rad2deg(Q), I, strict=True)):
        lists = [f"({q[0]:.9f} {q[1]:.9f})", "(0.1 0.2)", *[zeros] * 5, "(12 -4)",
                 f"({i[0]:.6f} {i[1]:.6f})"]  # fmt: skip
        lines.append(f"{k} {1.4e9 + t:.6f} " + " ".join(f"[ok] {x}" for x in lists))
    path.write_text("\n".join(lines) + "\n")
    log = read_recording(path, check=False)
    np.testing.assert_allclose(log.t, 1.4e9 + T, rtol=0, atol=1e-6)
    np.testing.assert_allclose(log.q, Q, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(log.current, I)


@pytest.mark.parametrize(
    "header", ["time,q,i", "time q current", "# recorded; by hand\ntime q current"]
)
def test_names_above_lists_are_a_header(header: str) -> None:
    lines = [
        *header.split("\n"),
        *(f"{t} [{_numbers(q)}] [1, 2]" for t, q in zip(T, Q, strict=True)),
    ]
    assert not are_list_lines(lines)
    assert are_list_lines(lines[header.count("\n") + 1 :])


def test_text_without_lists_is_none() -> None:
    assert not are_list_lines([f"{t} {q[0]} {q[1]}" for t, q in zip(T, Q, strict=True)])
    assert not are_list_lines([f"({t}) {q[0]} (deg)" for t, q in zip(T, Q, strict=True)])
    assert not are_list_lines(["the robot (6 axes, 10 kg) moves"] * 30 + ["t [s] q (1)"])


def test_a_number_in_brackets_before_a_list_is_its_kind() -> None:
    """The first whole number of a list that grows is the time; one row holds all kinds."""
    lines = ["[2007][1,1,0]"]
    for k in range(8):
        time = 5_402_112_345 + 10_000 * k
        lines += [f"[2026][0.{k},1.5]", f"[2210][{time},0.{k},2.5]", f"[2213][{time},-1.{k},3.5]"]
    assert are_list_lines(lines)
    header, *rows = "".join(table_of_list_lines(["\n".join(lines) + "\n"])).splitlines()
    names = ["message_2026.1", "message_2026.2", "time", "message_2210.1", "message_2210.2"]
    names += ["message_2213.1", "message_2213.2"]
    assert header == ",".join(f'"{name}"' for name in names)
    shown = [row for row in rows if row]
    assert len(shown) == 8
    assert shown[1] == "0.1,1.5,5402122345,0.1,2.5,-1.1,3.5"
