"""Folders for a while: gone at the end, and after a kill with the next one."""

import subprocess
import sys
import tempfile

import pytest

from wrenchsight.analyses.output.scratch_folder import scratch_folder


@pytest.fixture
def place(tmp_path, monkeypatch):
    """In the place of the system's folder for temporary files."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def test_it_is_gone_at_the_end(place):
    with scratch_folder() as folder:
        (folder / "a").write_text("a")
        assert folder.parent == place
    assert list(place.iterdir()) == []


def test_what_a_kill_left_goes_with_the_next(place):
    code = (
        "import os, sys, tempfile\n"
        "from wrenchsight.analyses.output.scratch_folder import scratch_folder\n"
        "tempfile.tempdir = sys.argv[1]\nwith scratch_folder():\n    os.kill(os.getpid(), 9)\n"
    )
    subprocess.run([sys.executable, "-c", code, str(place)], check=False)
    (left,) = place.iterdir()
    other = place / "wrenchsight.txt"
    other.write_text("somebody's")
    with scratch_folder() as first, scratch_folder() as second:
        assert not left.exists()
        assert first.exists()  # held by its maker
        assert second.exists()
    assert list(place.iterdir()) == [other]
