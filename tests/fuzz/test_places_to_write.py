"""Commands that cannot write: a full disk, a folder that is read only, both found in one line."""

import os
import shutil
from pathlib import Path

import pytest
from fuzzing.judging import checksums

WRITERS = {
    "estimate": ("estimate", "log.csv", "--robot", "robot", "--prior", "30,2"),
    "estimate of a bag": ("estimate", "log.csv", "--robot", "robot", "--prior", "30,2", "--mcap"),
    "estimate to parquet": (
        *("estimate", "log.csv", "--robot", "robot", "--prior", "30,2", "--table", "parquet"),
    ),
    "simulate": ("simulate", "--duration", "0.02"),
    "jcn-map": ("jcn-map", "--samples", "200"),
    "redundancy": ("redundancy", "--task", "redundancy.yaml"),
}

pytestmark = pytest.mark.timeout(1800)  # where the kernels are not compiled yet


@pytest.fixture
def work(clean, tmp_path):
    """A folder with the clean inputs, and another one with older results."""
    folder = tmp_path / "work"
    shutil.copytree(clean.folder, folder)
    return folder


@pytest.mark.parametrize("command", WRITERS)
def test_a_full_disk(sandbox, work, command):
    arguments = (*WRITERS[command], "--out", "out")
    for most in (4000, 20_000):  # bytes that a file may have, that of stderr among them
        before = checksums(work)
        ending = sandbox.run(arguments, work, bytes_of_file=most)
        assert ending.fault() is None, ending.stderr[-2000:]
        assert ending.code == 2
        assert "cannot be written" in ending.stderr
        assert "out/" in ending.stderr  # which file
        assert checksums(work) == before


def test_a_full_disk_leaves_older_results(sandbox, work):
    arguments = (*WRITERS["jcn-map"], "--out", "out")
    assert sandbox.run(arguments, work).code == 0
    before = checksums(work)
    ending = sandbox.run((*arguments, "--seed", "1"), work, bytes_of_file=4000)
    assert ending.code == 2
    assert checksums(work) == before


def test_a_full_disk_for_a_page(sandbox, work):
    before = checksums(work)
    ending = sandbox.run(
        ("robot", "show", "robot", "--out", "arm.html"), work, bytes_of_file=20_000
    )
    assert ending.fault() is None, ending.stderr[-2000:]
    assert ending.code == 2
    assert "arm.html" in ending.stderr
    assert checksums(work) == before


@pytest.mark.parametrize("command", [*WRITERS, "identify", "excite", "place", "payload", "study"])
def test_a_folder_that_is_read_only(sandbox, work, command):
    others = {
        "identify": ("identify", "log.csv", "--robot", "robot"),
        "excite": ("excite", "--robot", "robot"),
        "place": ("place", "--task", "place.yaml"),
        "payload": ("payload", "log.csv", "--robot", "robot", "--model", "model.yaml"),
        "study": ("study", "jcn-map", "--quick"),
    }
    place = "/proc"  # where not even root can write
    if os.geteuid() != 0:
        place = str(work / "closed")
        Path(place).mkdir(0o500)
    arguments = WRITERS.get(command) or others[command]
    ending = sandbox.run((*arguments, "--out", f"{place}/out"), work)
    assert ending.fault() is None, ending.stderr[-2000:]
    assert ending.code == 2
    assert place in ending.stderr
