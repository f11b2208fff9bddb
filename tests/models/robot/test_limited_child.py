"""What is said of a child process that fails, or is stopped at one of its limits."""

import os
from pathlib import Path

import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.robot import limited_child
from wrenchsight.models.robot.limited_child import CPU_TIME, run_limited

_WARNING = "import sys; print('a warning', file=sys.stderr, flush=True)\n"


@pytest.fixture
def run_child(tmp_path, monkeypatch):
    """A function that runs a child with a script of its own, after it has written a warning."""
    paths = [str(tmp_path), os.environ.get("PYTHONPATH", "")]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(paths))

    def run(script: str) -> bytes:
        (tmp_path / "child_of_a_test.py").write_text(_WARNING + script)
        return run_limited("child_of_a_test", Path("file.urdf"), (), "xacro", "correct it")

    return run


def test_a_child_that_ends_well_returns_what_it_writes(run_child):
    assert run_child("print('fine')") == b"fine\n"


def test_the_last_line_of_a_child_that_fails_is_the_problem(run_child):
    with pytest.raises(InputError, match="xacro: no such property; correct it"):
        run_child("sys.exit('no such property')")


def test_a_child_without_processor_time_is_said_to_have_taken_it(run_child):
    with pytest.raises(InputError, match=rf"takes more than {CPU_TIME} s of processor") as error:
        run_child("import os, signal; os.kill(os.getpid(), signal.SIGXCPU)")
    assert "a warning" not in str(error.value)


def test_a_child_that_waits_is_stopped_by_the_clock_and_not_for_its_processor_time(
    run_child, monkeypatch
):
    # Long enough for Python to start; a child that has not written its warning passes, too.
    monkeypatch.setattr(limited_child, "WATCH_TIME", 2.0)
    with pytest.raises(InputError, match="waits for more than 2 s; it was stopped") as error:
        run_child("import time; time.sleep(60.0)")
    assert "a warning" not in str(error.value)


def test_a_child_that_works_is_not_stopped_by_the_clock(run_child, monkeypatch):
    # It takes 2.5 s of a processor, which last longer on the clock than the watch, and longer still
    # on a busy machine.
    monkeypatch.setattr(limited_child, "WATCH_TIME", 1.0)
    working = "import time\nwhile time.process_time() < 2.5:\n    pass\nprint('fine')"
    assert run_child(working) == b"fine\n"
