"""Stretches in which all torques stand still while the joints move."""

from pathlib import Path

import numpy as np
import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.plausibility.frozen_drives import LEAST_SAMPLES, FrozenDrives
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.recordings.recording_writer import write_recording
from wrenchsight.models.robot.robot import Robot


def swing(robot: Robot) -> Recording:
    """6 s at 100 Hz about a posture out of which gravity pulls, held against it."""
    t = 0.01 * np.arange(600)
    rate = np.linspace(0.8, 1.6, 6)
    centre = np.array([0.0, -0.8, 1.0, -0.5, 1.0, 0.0])
    q, v = centre + 0.4 * np.sin(t[:, None] * rate), 0.4 * rate * np.cos(t[:, None] * rate)
    current = robot.motor_current(robot.chain.gravity_torque(q))
    current += 0.01 * np.random.default_rng(1).normal(size=current.shape)
    return Recording(t, q, v, current, "log.csv", row=np.arange(2, 602))


@pytest.mark.parametrize("size", [7, 200, 600])
def test_stretches_are_found_whatever_the_chunks_are(ur10e: Robot, size: int) -> None:
    log = swing(ur10e)
    log.current[:150] = 0.0
    log.current[400:] = log.current[400]
    frozen = FrozenDrives()
    for begin in range(0, 600, size):
        frozen.feed(log[begin : begin + size])
    frozen.finish()
    assert [(s.first_row, s.last_row, s.is_zero) for s in frozen.stretches] == [
        (2, 151, True),
        (402, 601, False),
    ]
    assert frozen.usable_rows(2, 601) == (152, 401)


def test_what_rests_or_holds_for_short_is_not_frozen(ur10e: Robot) -> None:
    log = swing(ur10e)
    log.current[: LEAST_SAMPLES - 1] = 0.0
    log.current[300:500], log.q[300:500], log.v[300:500] = 1.0, log.q[300], 0.0
    frozen = FrozenDrives()
    frozen.feed(log)
    frozen.finish()
    assert not frozen.stretches


def test_the_rows_that_are_named_can_be_read(ur10e: Robot, tmp_path: Path) -> None:
    log, path = swing(ur10e), tmp_path / "log.csv"
    log.current[:150] = 0.0
    log.current[400:] = log.current[400]
    write_recording(log, path)
    with pytest.raises(InputError, match=r"stand still while the joints move: at zero") as error:
        read_recording(path, robot=ur10e)
    rows = str(error.value).partition("rows: {log.csv: ")[2].partition("}")[0]
    keys = 'time: {columns: t}\nposition: {columns: "q{1..6}"}\nvelocity: {columns: "v{1..6}"}\n'
    keys += f'current: {{columns: "i{{1..6}}"}}\nrows: {{log.csv: {rows}}}\n'
    (tmp_path / "columns.yaml").write_text(keys)
    mended = read_recording(path, tmp_path / "columns.yaml", ur10e)
    assert mended.t[0] == pytest.approx(1.5)
    assert mended.num_samples == 250


def test_a_log_without_drives_has_none_that_stand_still(ur10e: Robot, tmp_path: Path) -> None:
    log, path = swing(ur10e), tmp_path / "log.csv"
    columns = [f"{name}{j}" for name in "qv" for j in range(1, 7)]
    table = np.c_[log.t, log.q, log.v]
    np.savetxt(path, table, delimiter=",", header=",".join(["t", *columns]), comments="")
    keys = 'time: {columns: t}\nposition: {columns: "q{1..6}"}\nvelocity: {columns: "v{1..6}"}\n'
    (tmp_path / "columns.yaml").write_text(keys)
    assert not read_recording(path, tmp_path / "columns.yaml", ur10e).current.any()
