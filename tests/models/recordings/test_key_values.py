"""Lines that name each number, in the forms of loggers and prints."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from wrenchsight.models.recordings import plain_text
from wrenchsight.models.recordings.key_values import are_key_values
from wrenchsight.models.recordings.recording_reader import read_recording

_T = 0.01 * np.arange(40)
_Q = np.round(np.sin(_T[:, None] + np.arange(2)), 6)
_I = np.round(1.0 + _Q, 6)


def _logfmt(k: int) -> str:
    numbers = {"t": _T[k]} | {f"q{j + 1}": _Q[k, j] for j in range(2)}
    numbers |= {f"i{j + 1}": _I[k, j] for j in range(2)}
    return " ".join(f"{name}={x:.6f}" for name, x in numbers.items())


def _packet(k: int) -> str:
    """As KUKA's sensor interface sends them, IPOC in ms."""
    q, i = (" ".join(f'A{j + 1}="{x[k, j]:.6f}"' for j in range(2)) for x in (_Q, _I))
    return f'<Rob Type="KUKA"><AIPos {q}/><MACur {i}/><IPOC>{10 * k}</IPOC></Rob>'


def _objects(k: int) -> str:
    states = ", ".join(f"State(mode=1, q={_Q[k, j]:.6f}, i={_I[k, j]:.6f})" for j in range(2))
    return f"stamp: {_T[k]:.3f} [{states}]"


def _dictionary(k: int) -> str:
    numbers = {"t": float(_T[k])} | {f"q{j + 1}": float(_Q[k, j]) for j in range(2)}
    return str(numbers | {f"i{j + 1}": float(_I[k, j]) for j in range(2)})


@pytest.mark.parametrize("block", [1 << 20, 100])
@pytest.mark.parametrize("line", [_logfmt, _packet, _objects, _dictionary])
def test_each_form_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, line: Callable[[int], str], block: int
) -> None:
    monkeypatch.setattr(plain_text, "_BLOCK_BYTES", block)
    path = tmp_path / "log.txt"
    path.write_text("\n".join(line(k) for k in range(40)) + "\n")
    log = read_recording(path)
    np.testing.assert_allclose(log.t, _T, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(log.q, _Q)
    np.testing.assert_array_equal(log.current, _I)
    assert log.row is not None
    assert log.row[0] == 1


def test_lines_of_influxdb_are_rows_of_a_joint(tmp_path: Path) -> None:
    lines = [
        f"joint_state,robot=a,joint_name=joint_{j + 1} position={_Q[k, j]},current={_I[k, j]} "
        f"{1_700_000_000_000_000_000 + 10_000_000 * k}"
        for k in range(40)
        for j in range(2)
    ]
    path = tmp_path / "export.lp"
    path.write_text("\n".join(["# DML", "# CONTEXT-DATABASE: test", *lines]) + "\n")
    log = read_recording(path)
    np.testing.assert_array_equal(log.q, _Q)
    np.testing.assert_array_equal(log.current, _I)


@pytest.mark.parametrize(
    "lines",
    [
        ["t,q1,q2", *["0.1,1,2"] * 9],
        ["position:", "- 1.0", "- 2.0", "velocity:", "- 3.0"] * 4,
        ["14:22:31 a:1"] * 9,
        [],
    ],
)
def test_other_text_is_none(lines: list[str]) -> None:
    assert not are_key_values(lines)
