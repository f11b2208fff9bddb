"""Signals with rows or clocks of their own, on the rows of the positions."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.recording_reader import read_recording

_T = 0.01 * np.arange(80)
_LATE = 0.004  # s, by which the currents are sampled later: a ramp shows whether that is undone
_JOINTS = np.arange(2)


def _q(t: np.ndarray) -> np.ndarray:
    return t[:, None] * (1.0 + _JOINTS)


def _currents(t: np.ndarray) -> np.ndarray:
    return 5.0 - 3.0 * t[:, None] * (1.0 + _JOINTS)


def _checked(path: Path, notice: str) -> None:
    log = read_recording(path)
    assert any(notice in text for text in log.notices), log.notices
    assert log.num_samples >= len(_T) - 2
    np.testing.assert_allclose(log.q, _q(log.t), atol=1e-9)
    np.testing.assert_allclose(log.current, _currents(log.t), atol=1e-9)


@pytest.mark.parametrize("step", [1, 2])
def test_rows_of_each_message_are_joined(tmp_path: Path, step: int) -> None:
    """As PlotJuggler exports two topics, one of them perhaps at half the rate."""
    positions = pd.DataFrame({"time": _T, **{f"pos_{j + 1}": _q(_T)[:, j] for j in _JOINTS}})
    own = np.append(_T[::step], _T[-1]) + _LATE
    own = np.unique(np.concatenate([[-0.006], own]))
    currents = {"time": own, **{f"current_{j + 1}": _currents(own)[:, j] for j in _JOINTS}}
    table = pd.concat([positions, pd.DataFrame(currents)]).sort_values("time")
    path = tmp_path / "log.csv"
    table.to_csv(path, index=False)
    _checked(path, "signals have rows of their own")


@pytest.mark.parametrize("names", ["Time [s]", "t_{}", "{} time"])
def test_each_signal_has_its_clock(tmp_path: Path, names: str) -> None:
    header, columns = [], []
    for word, of_time, shift in (("pos", _q, 0.0), ("cur", _currents, _LATE)):
        for j in _JOINTS:
            header += [names.format(f"{word}{j + 1}"), f"{word}{j + 1}"]
            columns += [_T + shift, of_time(_T + shift)[:, j]]
    path = tmp_path / "log.csv"
    rows = [",".join(f"{x:.9f}" for x in row) for row in zip(*columns, strict=True)]
    path.write_text("\n".join([",".join(header), *rows]))
    _checked(path, "signals have clocks of their own")


def test_clocks_of_one_moment_are_one(tmp_path: Path) -> None:
    columns = {"time": _T, **{f"pos_{j + 1}": _q(_T)[:, j] for j in _JOINTS}}
    columns |= {"system_time": 1.7e9 + _T}
    columns |= {f"current_{j + 1}": _currents(_T)[:, j] for j in _JOINTS}
    path = tmp_path / "log.csv"
    pd.DataFrame(columns).to_csv(path, index=False)
    log = read_recording(path)
    np.testing.assert_allclose(log.current, _currents(_T), atol=1e-9)
    assert not any("clocks of their own" in text for text in log.notices)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("times", [[], [("0.01", "0.013")], [("nan", "nan")] * 20])
def test_clocks_without_samples_are_one_line(tmp_path: Path, times: list[tuple[str, str]]) -> None:
    with pytest.raises(InputError, match="expected"):
        read_recording(_two_clocks(tmp_path, times))


@pytest.mark.filterwarnings("error")
def test_signals_whose_clock_has_no_number_are_left_out(tmp_path: Path) -> None:
    log = read_recording(_two_clocks(tmp_path, [(f"{t:.2f}", "nan") for t in _T]))
    assert any("currents are left out: they hold no number" in text for text in log.notices)


def _two_clocks(folder: Path, times: list[tuple[str, str]]) -> Path:
    """A log of positions and currents, each behind its own clock."""
    path = folder / "log.csv"
    rows = [f"{first},1.0,2.0,{second},3.0,4.0" for first, second in times]
    path.write_text("\n".join(["Time,q1,q2,Time,i1,i2", *rows]))
    return path
