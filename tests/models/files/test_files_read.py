"""Whoever asks is told of every file of the user's before it is read."""

import os
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from wrenchsight.models.files.files_read import (
    about_to_read,
    remembering_files_read,
    reporting_files_read,
)
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.planning.motion.surface_path import SurfacePath
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.robot.robot import Robot


def _told(read) -> list[str]:
    names: list[str] = []
    with reporting_files_read(lambda path: names.append(path.name)):
        read()
    return names


def test_nobody_needs_to_be_told(tmp_path):
    about_to_read(tmp_path / "a")


def test_only_what_is_read_inside_the_block_is_told(tmp_path):
    assert _told(lambda: about_to_read(tmp_path / "a")) == ["a"]
    about_to_read(tmp_path / "b")


def test_what_was_read_before_the_block_is_remembered_where_asked_for(tmp_path):
    with remembering_files_read():
        about_to_read(tmp_path / "a")
        assert _told(lambda: about_to_read(tmp_path / "b")) == ["a", "b"]
    assert _told(lambda: None) == []


def test_a_refusal_comes_before_the_file_is_opened(tmp_path):
    def refuse(path: Path) -> None:
        raise InputError(path, "", "must not be read")

    (tmp_path / "log.csv").write_text("no log at all")
    with reporting_files_read(refuse), pytest.raises(InputError, match="must not be read"):
        read_recording(tmp_path / "log.csv")


def test_a_robot_s_files_are_told():
    assert _told(lambda: Robot.load("ur10e"))[:2] == ["robot.yaml", "robot.urdf"]


@pytest.mark.parametrize("name", ["log.csv", "log.parquet"])
def test_a_log_and_its_description_are_told(tmp_path, name):
    t = 0.01 * np.arange(20)
    if name.endswith("csv"):
        (tmp_path / name).write_text("t,a\n" + "".join(f"{x},{x}\n" for x in t))
    else:
        pq.write_table(pa.table({"t": t, "a": t}), tmp_path / name)
    (tmp_path / "format.yaml").write_text("time: {columns: t}\nextra: {a: {columns: a}}\n")
    told = _told(lambda: read_recording(tmp_path / name, tmp_path / "format.yaml"))
    assert set(told) == {name, "format.yaml"}


def test_a_surface_s_points_are_told(tmp_path):
    (tmp_path / "cam.csv").write_text("x,y,z,nx,ny,nz\n0,0,0,0,0,1\n0,1,0,0,0,1\n")
    assert _told(lambda: SurfacePath.read_csv(tmp_path / "cam.csv")) == ["cam.csv"]


@pytest.mark.timeout(60)  # unmended, each waits for somebody who writes
@pytest.mark.parametrize("read", [Robot.load, read_recording, about_to_read])
def test_a_pipe_that_nobody_writes_to_is_refused_and_not_waited_for(tmp_path, read):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    arguments = (pipe, Robot.load("sts_sre4_600")) if read is read_recording else (pipe,)
    with pytest.raises(InputError, match=r"pipe: is a pipe; write its content to a file"):
        read(*arguments)
