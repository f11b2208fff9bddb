"""`log`: what it says of files, and drafts that read a log as it was read."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from wrenchsight.analyses.__main__ import app
from wrenchsight.analyses.methods.log.log_inspection import InspectedLog, inspect_logs
from wrenchsight.analyses.methods.log.log_settings import LogSettings
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.recordings.recording_writer import write_recording

_T = np.round(0.01 * np.arange(300), 6)
_Q = np.round(np.c_[np.sin(_T), 0.5 * np.cos(2 * _T), 0.25 + 0 * _T], 6)
_V = np.round(np.c_[np.cos(_T), -np.sin(2 * _T), 0 * _T], 6)
_I = np.round(10.0 * _Q, 6)


def _log() -> Recording:
    return Recording(_T, _Q, _V, _I, "made up")


def _inspected(tmp_path: Path, *logs: Path, log_format: str | None = None) -> list[InspectedLog]:
    settings = LogSettings(logs=[str(log) for log in logs], log_format=log_format)
    return inspect_logs(settings, tmp_path / "out")


def _csv(path: Path, header: str, columns: np.ndarray, separator: str = ",") -> Path:
    lines = [separator.join(f"{x:.6f}" for x in row) for row in columns]
    path.write_text("\n".join([header, *lines] if header else lines) + "\n")
    return path


def test_angles_beyond_any_joint_have_a_question_in_the_draft(tmp_path: Path) -> None:
    """A draft that states rad of degrees would be followed; columns without a name are no names."""
    header = "t,q1,q2,q3,v1,v2,v3,i1,i2,i3,,"
    columns = np.c_[_T, 57.3 * _Q, 57.3 * _V, _I, 0 * _T, 0 * _T]
    (log,) = _inspected(tmp_path, _csv(tmp_path / "log.csv", header, columns))
    assert "unit: rad}  # ? unit: deg; or gain: rad of one count" in log.draft
    assert "unit: rad/s}  # ? unit: deg/s" in log.draft
    assert log.unread == ()
    stated = header.replace("q1,q2,q3", "q1 [deg],q2 [deg],q3 [deg]")
    (log,) = _inspected(tmp_path, _csv(tmp_path / "stated.csv", stated, columns))
    assert "unit: deg}\n" in log.draft


@pytest.mark.parametrize("kind", ["csv", "parquet", "npz", "mat", "mcap", "semicolons", "torque",
                                  "milliseconds", "external", "unfilled", "labels"])  # fmt: skip
def test_a_draft_reads_the_log_as_it_was_read(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"log.{kind}"
    log = _log()
    if kind == "semicolons":
        header = "t;q1;q2;q3;v1;v2;v3;i1;i2;i3"
        path = _csv(tmp_path / "log.csv", header, np.c_[_T, _Q, _V, _I], ";")
        path.write_text("\n" + path.read_text().replace(".", ","))
    elif kind == "torque":
        path = tmp_path / "log.parquet"
        write_recording(Recording(_T, _Q, _V, _I, "made up", tau_J=2.0 * _I), path)
    elif kind == "milliseconds":
        header = "time,actual_q_0,actual_q_1,actual_q_2,actual_current_0,actual_current_1,"
        path = _csv(tmp_path / "log.csv", header + "actual_current_2", np.c_[1e3 * _T, _Q, _I])
    elif kind == "external":
        header = "t,q[0],q[1],q[2],tau_ext_hat[0],tau_ext_hat[1],tau_ext_hat[2]"
        path = _csv(tmp_path / "log.csv", header, np.c_[_T, _Q, _I])
    elif kind == "labels":  # names, units and the step of the time stand in lines of their own
        header = "Unit,rad,rad,rad,A,A,A\nDelta_X,0.01,0.01,0.01,0.01,0.01,0.01\n"
        header += "Name,pos 1,pos 2,pos 3,current 1,current 2,current 3"
        path = _csv(tmp_path / "log.csv", header, np.c_[_Q, _I])
        lines = path.read_text().splitlines()
        path.write_text("\n".join([*lines[:3], *(f",{line}" for line in lines[3:]), ""]))
    elif kind == "unfilled":
        path = _csv(tmp_path / "log.csv", "t,q0,q1,q2,v0,v1,v2", np.c_[_T, _Q, 0 * _V])
    else:
        write_recording(log, path)
    (inspected,) = _inspected(tmp_path, path)
    assert inspected.summary is not None, inspected.problem
    as_read = read_recording(path)
    again = read_recording(path, tmp_path / "out" / "columns.yaml")
    for name in ("t", "q", "v", "current", "tau_J"):
        expected, found = getattr(as_read, name), getattr(again, name)
        if expected is None:
            assert found is None
        else:
            np.testing.assert_array_equal(found, expected)
    assert again.extra.keys() == as_read.extra.keys()
    for name, signal in as_read.extra.items():
        np.testing.assert_array_equal(again.extra[name], signal)
    assert (tmp_path / "out" / "figures" / "log_log.png").stat().st_size > 10_000


def test_rate_gaps_motion_and_rests_are_stated(tmp_path: Path) -> None:
    kept = np.r_[0:100, 120:300]
    log = _log()
    path = tmp_path / "log.csv"
    write_recording(log[np.isin(np.arange(300), kept)], path)
    (inspected,) = _inspected(tmp_path, path)
    summary = inspected.summary
    assert summary is not None
    assert summary.rate_hz == pytest.approx(100.0)
    assert (summary.num_gaps, summary.num_samples) == (1, 280)
    assert summary.longest_gap == pytest.approx(0.21)
    np.testing.assert_allclose(summary.q_max, _Q[kept].max(axis=0))
    np.testing.assert_allclose(summary.v_max, np.abs(_V[kept]).max(axis=0))
    np.testing.assert_allclose(summary.effort_rms, np.sqrt((_I[kept] ** 2).mean(axis=0)))
    np.testing.assert_array_equal(summary.rests_throughout, [False, False, True])
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text())
    assert metrics["log.csv"]["log"]["gaps"] == 1
    result = CliRunner().invoke(app, ["log", str(path), "--out", str(tmp_path / "again")])
    assert result.exit_code == 0
    for words in ("gaps: 1, the longest 0.21 s", "rest throughout: joint 3", "columns.yaml"):
        assert words in result.output


def test_a_log_that_is_not_read_gets_a_draft_with_questions(tmp_path: Path) -> None:
    header = "pos_1,pos_2,pos_3,v1,v2,v3,amps_1,amps_2,amps_3"
    path = _csv(tmp_path / "log.csv", header, np.c_[_Q, _V, _I])
    (inspected,) = _inspected(tmp_path, path)
    assert inspected.summary is None
    assert "has no column of time" in inspected.problem
    draft = tmp_path / "out" / "columns.yaml"
    with pytest.raises(InputError, match="rate_hz: expected a number"):
        read_recording(path, draft)
    draft.write_text(draft.read_text().replace('rate_hz: "?"', "rate_hz: 100"))
    recording = read_recording(path, draft)
    np.testing.assert_allclose(recording.t, _T, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(recording.q, _Q)
    np.testing.assert_array_equal(recording.v, _V)
    np.testing.assert_array_equal(recording.current, _I)


def test_a_table_without_names_is_drafted_by_numbers(tmp_path: Path) -> None:
    q = np.c_[_Q, _Q]
    path = _csv(tmp_path / "log.csv", "", np.c_[_T, q, q, q])
    (inspected,) = _inspected(tmp_path, path)
    assert "header: false" in inspected.draft
    np.testing.assert_array_equal(
        read_recording(path, tmp_path / "out" / "columns.yaml").current, q
    )


def test_words_without_a_sign_are_recognised(tmp_path: Path) -> None:
    counts = np.rint(100.0 * np.sin(5 * _T))[:, None] * [1.0, 2.0, 3.0]
    words = np.where(counts < 0, counts + 65536, counts)
    path = tmp_path / "log.csv"
    write_recording(Recording(_T, _Q, _V, words, "made up"), path)
    (inspected,) = _inspected(tmp_path, path)
    assert "encoding: twos_complement, bits: 16" in inspected.draft
    recording = read_recording(path, tmp_path / "out" / "columns.yaml")
    np.testing.assert_array_equal(recording.current, counts)


def test_words_of_a_log_that_is_not_read_are_drafted(tmp_path: Path) -> None:
    """Counts of 32 bits of all signals, as a drive's objects hold them; the time keeps its unit."""
    counts = np.round(1e5 * np.sin(4.0 * np.pi * _T))[:, None]
    names = [f"Axis{j}_{word}" for word in ("ActualPosition", "ActualVelocity", "ActualTorque")
             for j in (1, 2)]  # fmt: skip
    columns = np.c_[1e3 * _T, np.tile(counts % 2.0**32, (1, 6))]
    (log,) = _inspected(
        tmp_path, _csv(tmp_path / "log.csv", "cycle_ms," + ",".join(names), columns)
    )
    assert "holds words of 32 bits without a sign" in log.problem
    draft = log.draft.replace('gain: ["?"]', "gain: [1e-5]")
    assert 'time: {columns: "cycle_ms", unit: ms}' in draft
    assert draft.count("encoding: twos_complement, bits: 32, gain: [1e-5]") == 3
    (tmp_path / "columns.yaml").write_text(draft)
    read = read_recording(tmp_path / "log.csv", tmp_path / "columns.yaml")
    np.testing.assert_allclose(read.t, _T, rtol=0, atol=1e-9)
    np.testing.assert_allclose(read.q, 1e-5 * np.tile(counts, (1, 2)), rtol=0, atol=1e-9)


def test_several_files_have_a_draft_each_and_no_table_is_refused(tmp_path: Path) -> None:
    for name in ("one.csv", "two.npz"):
        write_recording(_log(), tmp_path / name)
    logs = _inspected(tmp_path, tmp_path / "one.csv", tmp_path / "two.npz")
    assert [log.draft_name for log in logs] == ["columns_one.yaml", "columns_two.yaml"]
    assert all((tmp_path / "out" / log.draft_name).is_file() for log in logs)
    with pytest.raises(InputError, match="no such file"):
        _inspected(tmp_path, tmp_path / "three.csv")
    os.mkfifo(tmp_path / "pipe.csv")
    with pytest.raises(InputError, match="is a pipe"):
        _inspected(tmp_path, tmp_path / "pipe.csv")
    (tmp_path / "four.mcap").write_bytes(b"nothing")
    with pytest.raises(InputError, match="no bag, or a damaged one"):
        _inspected(tmp_path, tmp_path / "four.mcap")


def test_files_of_one_name_have_a_draft_a_figure_and_figures_each(tmp_path: Path) -> None:
    (tmp_path / "day").mkdir()
    paths = [tmp_path / "run.csv", tmp_path / "day" / "run.csv", tmp_path / "run.2.csv"]
    for count, path in zip((300, 200, 100), paths, strict=True):
        write_recording(_log()[:count], path)
    logs = _inspected(tmp_path, *paths)
    assert [log.name for log in logs] == ["run", "run_2", "run_3"]
    out = tmp_path / "out"
    for log in logs:
        assert log.draft_name == f"columns_{log.name}.yaml"
        assert (out / log.draft_name).read_text() == log.draft
        assert (out / "figures" / f"log_{log.name}.png").is_file()
    figures = json.loads((out / "metrics.json").read_text())
    assert [figures[key]["log"]["samples"] for key in map(str, paths[:2])] == [300, 200]
    assert figures["run.2.csv"]["log"]["samples"] == 100


def test_registers_that_name_columns_are_drafted_by_the_columns_numbers(tmp_path: Path) -> None:
    """A number in a description is that of a column, from 1; beyond these it may be a name."""
    header = ",".join(["time", *(str(k) for k in range(270, 279))])
    path = _csv(tmp_path / "log.csv", header, np.c_[_T, 1e3 * _Q, 1e3 * _V, 1e3 * _I])
    keys = "time: {columns: time}\nposition: {columns: '{270..272}', gain: [0.001]}\n"
    keys += "velocity: {columns: '{273..275}', gain: [0.001]}\n"
    keys += "current: {columns: '{276..278}', unit: mA}\n"
    (tmp_path / "columns.yaml").write_text(keys)
    log = read_recording(path, tmp_path / "columns.yaml")
    np.testing.assert_allclose(log.q, _Q, rtol=0, atol=1e-9)
    settings = LogSettings(logs=[str(path)], log_format=str(tmp_path / "columns.yaml"))
    (inspected,) = inspect_logs(settings, tmp_path / "out")
    assert 'position: {columns: "2-4", unit: rad, gain: [0.001]}' in inspected.draft
    again = read_recording(path, tmp_path / "out" / "columns.yaml")
    np.testing.assert_array_equal(again.q, log.q)
