"""Commands that cannot write: a full disk, a folder that is read only, both found in one line."""

import os
import shutil
from pathlib import Path

import pytest
from fuzzing.clean_inputs import motion
from fuzzing.judging import checksums
from fuzzing.sandbox import Sandbox

from wrenchsight.analyses.output.result_folder import ResultFolder
from wrenchsight.analyses.output.result_marker import MARKER
from wrenchsight.models.recordings.recording_writer import write_recording

_LOG = ("long.csv", "--robot", "robot")
_EXPERIMENT = "quick-experiment"
WRITERS = {
    "estimate": ("estimate", "log.csv", "--robot", "robot", "--prior", "30,2"),
    "estimate of a bag": ("estimate", "log.csv", "--robot", "robot", "--prior", "30,2", "--mcap"),
    "estimate to parquet": (
        "estimate",
        "log.csv",
        "--robot",
        "robot",
        "--prior",
        "30,2",
        "--table",
        "parquet",
    ),
    "simulate": ("simulate", "--duration", "0.02"),
    "jcn-map": ("jcn-map", "--samples", "200"),
    "redundancy": ("redundancy", "--task", "redundancy.yaml"),
    "identify": ("identify", *_LOG),
    "refresh": ("identify", *_LOG, "--refresh", "identified/model.yaml"),
    "payload": ("payload", *_LOG, "--model", "identified/model.yaml"),
    "place": ("place", "--task", "place.yaml", "--quick"),
    "excite": ("excite", "--robot", "robot", "--config", "excite.yaml", "--no-validation"),
}
IN_PROCESSES = {
    "study": ("study", _EXPERIMENT, "--jobs", "1"),
    "campaign": ("campaign", _EXPERIMENT, "--worlds", "1", "--jobs", "1"),
}
FILES = {
    "robot": ("robot", "robot/robot.urdf"),
    "robot show": ("robot", "show", "robot"),
}

pytestmark = pytest.mark.timeout(1800)  # where the kernels are not compiled yet


@pytest.fixture(scope="module")
def inputs(clean, sandbox, tmp_path_factory):
    """The clean inputs, a log that is long enough to identify from, and a model of it."""
    folder = tmp_path_factory.mktemp("inputs") / "inputs"
    shutil.copytree(clean.folder, folder)
    write_recording(motion(5200), folder / "long.csv")
    (folder / "excite.yaml").write_text(
        "excitation: {num_starts: 2, iterations: 3, num_harmonics: 2}\n"
    )
    sandbox.warm_up([(*WRITERS["identify"], "--out", "identified")], folder)
    # A kernel that is compiled is kept in a file, too, which would not fit the disk.
    sandbox.warm_up([(*WRITERS[name], "--out", f"warm/{name}") for name in WRITERS], folder)
    shutil.rmtree(folder / "warm")
    return folder


@pytest.fixture
def work(inputs, tmp_path):
    """A folder with the inputs."""
    folder = tmp_path / "work"
    shutil.copytree(inputs, folder)
    return folder


@pytest.fixture(scope="module")
def with_an_experiment():
    """Runs commands that know the experiment of a moment."""
    with Sandbox(("fuzzing.quick_experiment",)) as sandbox:
        yield sandbox


def _last_line(ending):
    """What a refused command said, behind what a long one says of its progress."""
    assert not ending.timed_out
    assert "Traceback" not in ending.stderr
    assert ending.code == 2, ending.stderr[-2000:]
    return ending.stderr.splitlines()[-1]


@pytest.mark.parametrize("command", WRITERS)
def test_a_full_disk(sandbox, work, command):
    arguments = (*WRITERS[command], "--out", "out")
    for most in (4000, 20_000):  # bytes that a file may have, that of stderr among them
        before = checksums(work)
        ending = sandbox.run(arguments, work, bytes_of_file=most)
        line = _last_line(ending)
        assert "cannot be written" in line
        assert "out/" in line  # which file
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


@pytest.mark.parametrize("command", IN_PROCESSES)
def test_a_full_disk_keeps_an_older_study_or_campaign(with_an_experiment, work, command):
    arguments = (*IN_PROCESSES[command], "--out", "out")
    assert with_an_experiment.run(arguments, work).code == 0
    out = work / "out"
    before = checksums(out)
    more = ("--seed", "1", *(("--fresh",) if command == "campaign" else ()))
    ending = with_an_experiment.run((*arguments, *more), work, bytes_of_file=1500)
    line = _last_line(ending)
    assert "cannot be written" in line
    assert "out/" in line
    after = checksums(out)
    changed = {name for name in before if after.get(name) != before[name]}
    # The experiment itself had room, and its new result is kept whole.
    experiment_files = {name for name in changed if name.startswith(f"{_EXPERIMENT}/")}
    assert changed - experiment_files <= ({MARKER} if experiment_files else set())
    if command == "study":
        assert ResultFolder(out, command).below(_EXPERIMENT)


@pytest.mark.parametrize("command", FILES)
def test_a_full_disk_leaves_no_part_of_a_file(sandbox, work, command):
    before = checksums(work)
    ending = sandbox.run((*FILES[command], "--out", "new/file"), work, bytes_of_file=1000)
    assert ending.fault() is None, ending.stderr[-2000:]
    assert ending.code == 2
    assert "file" in ending.stderr
    assert checksums(work) == before


@pytest.mark.parametrize("command", [*WRITERS, *IN_PROCESSES, *FILES])
def test_a_folder_that_is_read_only(with_an_experiment, sandbox, work, command):
    place = "/proc"  # where not even root can write
    if os.geteuid() != 0:
        place = str(work / "closed")
        Path(place).mkdir(0o500)
    arguments = (WRITERS | IN_PROCESSES | FILES)[command]
    runs = with_an_experiment if command in IN_PROCESSES else sandbox
    ending = runs.run((*arguments, "--out", f"{place}/out"), work)
    assert ending.fault() is None, ending.stderr[-2000:]
    assert ending.code == 2
    assert place in ending.stderr
