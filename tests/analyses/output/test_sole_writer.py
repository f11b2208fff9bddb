"""One writer a folder at a time."""

import os
import signal
import subprocess
import sys

import pytest

from wrenchsight.analyses.output.sole_writer import LOCK, sole_writer
from wrenchsight.models.files.input_error import InputError


def test_a_second_writer_is_refused_in_one_line(tmp_path):
    with sole_writer(tmp_path):
        with pytest.raises(InputError) as caught, sole_writer(tmp_path):
            pass
        line = str(caught.value)
        assert line.startswith(f"{tmp_path}: another run is writing")
        assert "--out" in line
    with sole_writer(tmp_path):
        pass


def test_nothing_is_left(tmp_path):
    with sole_writer(tmp_path):
        assert [path.name for path in tmp_path.iterdir()] == [LOCK]
    assert list(tmp_path.iterdir()) == []


def test_the_lock_ends_with_its_process(tmp_path):
    program = (
        "import sys, time; from pathlib import Path\n"
        "from wrenchsight.analyses.output.sole_writer import sole_writer\n"
        "with sole_writer(Path(sys.argv[1])):\n"
        "    print('locked', flush=True)\n"
        "    time.sleep(60)\n"
    )
    holder = subprocess.Popen(
        [sys.executable, "-c", program, str(tmp_path)], stdout=subprocess.PIPE, text=True
    )
    assert holder.stdout.readline() == "locked\n"
    with pytest.raises(InputError, match="another run"), sole_writer(tmp_path):
        pass
    holder.send_signal(signal.SIGKILL)
    holder.communicate()
    with sole_writer(tmp_path):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_file_of_the_user_s_with_that_name_is_not_emptied(tmp_path):
    (tmp_path / LOCK).write_text("mine")
    with sole_writer(tmp_path):
        pass
    assert (tmp_path / LOCK).read_text() == "mine"


def test_a_link_with_that_name_is_not_followed(tmp_path):
    (tmp_path / "mine").write_text("mine")
    (tmp_path / LOCK).symlink_to(tmp_path / "mine")
    with pytest.raises(InputError, match="cannot be written"), sole_writer(tmp_path):
        pass
    assert (tmp_path / "mine").read_text() == "mine"


def test_a_pipe_with_that_name_stays(tmp_path):
    os.mkfifo(tmp_path / LOCK)
    with pytest.raises(InputError, match="is no plain file"), sole_writer(tmp_path):
        pass
    assert (tmp_path / LOCK).is_fifo()
