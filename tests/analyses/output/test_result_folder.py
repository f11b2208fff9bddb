"""A command's results: they change as one, and nothing that is not ours is touched."""

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from wrenchsight.analyses.output import result_folder as module
from wrenchsight.analyses.output.outputs import OutputFolder
from wrenchsight.analyses.output.result_folder import STAGING, recover, result_folder
from wrenchsight.analyses.output.result_marker import (
    MARKER,
    ResultMarker,
    file_checksum,
    strangers,
)
from wrenchsight.models.files.files_read import about_to_read
from wrenchsight.models.files.input_error import InputError

ROOT = Path(module.__file__).parents[2]


def _write(out, content="1", names=("a.txt", "figures/b.png"), command="estimate"):
    with result_folder(out, command) as folder:
        for name in names:
            folder.write_text(name, content)


def _files(out):
    """All that is below a folder, hidden or not."""
    return {p.relative_to(out).as_posix(): p.read_bytes() for p in out.rglob("*") if p.is_file()}


def _visible(out):
    return {k: v.decode() for k, v in _files(out).items() if not k.startswith(".")}


def _refused(act) -> str:
    with pytest.raises(InputError) as caught:
        act()
    line = str(caught.value)
    assert "\n" not in line
    assert "--out" in line
    return line


@pytest.fixture
def out(tmp_path):
    _write(tmp_path / "out")
    return tmp_path / "out"


# ---- what is written ----


def test_files_and_a_marker_and_nothing_else(out):
    assert _visible(out) == {"a.txt": "1", "figures/b.png": "1"}
    assert sorted(p.name for p in out.iterdir()) == [MARKER, "a.txt", "figures"]
    marker = ResultMarker.read(out)
    assert marker.command == "estimate"
    assert list(marker.files) == ["a.txt", "figures/b.png"]
    assert list(strangers(out, marker)) == []


def test_the_same_results_are_the_same_bytes(out, tmp_path):
    _write(tmp_path / "again")
    assert _files(tmp_path / "again") == _files(out)


def test_until_the_end_the_older_results_are_there(out):
    with result_folder(out, "estimate") as folder:
        folder.write_text("a.txt", "2")
        assert _visible(out) == {"a.txt": "1", "figures/b.png": "1"}
        assert folder.path != out
    assert _visible(out) == {"a.txt": "2"}


def test_what_the_new_run_does_not_write_is_removed(out):
    _write(out, "2", ["a.txt"])
    assert _visible(out) == {"a.txt": "2"}
    assert not (out / "figures").exists()
    assert list(ResultMarker.read(out).files) == ["a.txt"]


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_an_error_leaves_the_older_results_and_nothing_else(out, error):
    before = _files(out)
    with pytest.raises(error), result_folder(out, "estimate") as folder:
        folder.write_text("a.txt", "2")
        folder.write_text("c.txt", "2")
        raise error
    assert _files(out) == before


@pytest.mark.parametrize("below", ["", "deeper/still"])
def test_an_error_leaves_no_folder_that_was_not_there(tmp_path, below):
    with pytest.raises(RuntimeError), result_folder(tmp_path / "out" / below, "estimate"):
        raise RuntimeError
    assert list(tmp_path.iterdir()) == []


def test_an_empty_folder_is_taken_and_stays_after_an_error(tmp_path):
    with pytest.raises(RuntimeError), result_folder(tmp_path, "estimate"):
        raise RuntimeError
    _write(tmp_path)
    assert set(_visible(tmp_path)) == {"a.txt", "figures/b.png"}


def test_the_folder_may_be_the_working_one(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    _write(Path())
    _write(Path(), "2")
    assert Path("a.txt").read_text() == "2"


def test_refusals_name_the_file_as_the_user_knows_it(tmp_path):
    out = tmp_path / "out"
    with pytest.raises(InputError) as caught, result_folder(out, "estimate") as folder:
        raise InputError(folder / "wrench.csv", "", "cannot be written (No space left on device)")
    assert str(caught.value).startswith(f"{out / 'wrench.csv'}: cannot")


# ---- what is not ours ----


def test_a_folder_that_is_not_ours_is_refused_and_as_it_was(tmp_path):
    (tmp_path / "robot.urdf").write_text("mine")
    line = _refused(lambda: _write(tmp_path))
    assert "robot.urdf, which wrenchsight did not write there" in line
    assert _files(tmp_path) == {"robot.urdf": b"mine"}


def test_it_is_refused_before_any_work(tmp_path):
    (tmp_path / "a").write_text("mine")
    with pytest.raises(InputError), result_folder(tmp_path, "estimate"):
        raise AssertionError


def test_a_file_among_ours_is_refused_wherever_it_lies(out):
    for name in ("notes.txt", "figures/mine.png", "new/deep/c.txt"):
        path = out / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("mine")
        before = _files(out)
        assert name in _refused(lambda: _write(out, "2"))
        assert _files(out) == before
        path.unlink()


def test_a_result_that_someone_changed_is_refused(out):
    (out / "a.txt").write_text("1 and my remarks")
    before = _files(out)
    line = _refused(lambda: _write(out, "2"))
    assert line.startswith(f"{out / 'a.txt'}: was changed since wrenchsight wrote it")
    assert _files(out) == before


def test_a_result_that_someone_removed_is_written_again(out):
    (out / "a.txt").unlink()
    _write(out, "2")
    assert _visible(out)["a.txt"] == "2"


def test_hidden_files_stay(out):
    (out / ".gitignore").write_text("*")
    _write(out, "2")
    assert (out / ".gitignore").read_text() == "*"


def test_the_results_of_another_command_are_refused(out):
    before = _files(out)
    line = _refused(lambda: _write(out, "2", command="identify"))
    assert "holds the results of estimate, not of identify" in line
    assert _files(out) == before


def test_a_link_to_a_folder_is_refused(out, tmp_path):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "b.png").write_text("1")
    (out / "figures" / "b.png").unlink()
    (out / "figures").rmdir()
    (out / "figures").symlink_to(tmp_path / "elsewhere")
    _refused(lambda: _write(out, "2"))
    assert (tmp_path / "elsewhere" / "b.png").read_text() == "1"


@pytest.mark.parametrize("name", ["a.txt", "new.txt", "figures"])
def test_what_appears_while_it_runs_is_not_overwritten(out, name):
    with pytest.raises(InputError), result_folder(out, "estimate") as folder:
        for file in ("a.txt", "new.txt", "figures/b.png"):
            folder.write_text(file, "2")
        if name == "figures":
            (out / "figures" / "b.png").unlink()
            (out / "figures").rmdir()
        (out / name).write_text("mine")
    assert (out / name).read_text() == "mine"
    assert not (out / STAGING).exists()
    if name != "a.txt":
        assert (out / "a.txt").read_text() == "1"


# ---- what is read ----


def test_a_file_in_the_folder_is_not_read(out):
    def run():
        with result_folder(out, "estimate"):
            about_to_read(out / "a.txt")

    line = _refused(run)
    assert line.startswith(f"{out / 'a.txt'}: is read by this command")
    assert _visible(out) == {"a.txt": "1", "figures/b.png": "1"}


@pytest.mark.parametrize("link", [Path.symlink_to, Path.hardlink_to])
@pytest.mark.parametrize("way", ["a.txt", "figures/b.png"])
def test_nor_by_another_name(out, tmp_path, link, way):
    link(tmp_path / "log.csv", out / way)

    def run():
        with result_folder(out, "estimate"):
            about_to_read(tmp_path / "log.csv")

    assert "log.csv: is read by this command" in _refused(run)


def test_nor_through_a_linked_folder(out, tmp_path):
    (tmp_path / "link").symlink_to(out)

    def run(folder, file):
        with result_folder(folder, "estimate"):
            about_to_read(file)

    _refused(lambda: run(tmp_path / "link", out / "a.txt"))
    _refused(lambda: run(out, tmp_path / "link" / "a.txt"))


def test_other_files_may_be_read_also_where_there_are_none(out, tmp_path):
    (tmp_path / "log.csv").write_text("x")
    with result_folder(out, "estimate"):
        about_to_read(tmp_path / "log.csv")
        about_to_read(tmp_path / "nowhere.csv")
        about_to_read("x" * 5000)


# ---- two runs, and runs that are killed ----


def test_a_second_run_is_refused(out):
    with result_folder(out, "estimate") as folder:
        folder.write_text("a.txt", "2")
        assert "another run is writing" in _refused(lambda: _write(out, "3"))
    assert _visible(out) == {"a.txt": "2"}


def test_the_left_overs_of_a_killed_run_go_with_the_next(out):
    (out / STAGING / "new").mkdir(parents=True)
    (out / STAGING / "new" / ".wrench.csv.123.partial").write_text("half")
    _write(out, "2")
    assert sorted(p.name for p in out.iterdir()) == [MARKER, "a.txt", "figures"]


def _stopped_after(out, monkeypatch, renames):
    """Writes "2", and dies after so many files have gone to their places."""
    child = os.fork()
    if child == 0:
        replace, count = Path.replace, iter(range(100))

        def die_in_time(self, target):
            goes_to_its_place = f"{STAGING}/ready" in str(self)
            if goes_to_its_place and next(count) == renames:
                os.kill(os.getpid(), signal.SIGKILL)
            return replace(self, target)

        monkeypatch.setattr(Path, "replace", die_in_time)
        _write(out, "2", ["a.txt", "c.txt", "figures/b.png"])
        os._exit(0)
    _, status = os.waitpid(child, 0)
    return os.WIFSIGNALED(status)


@pytest.mark.parametrize("renames", range(4))
def test_a_kill_while_files_change_places_is_completed(out, monkeypatch, renames):
    assert _stopped_after(out, monkeypatch, renames)
    assert (out / STAGING / "ready").exists()
    recover(out)
    assert _visible(out) == {"a.txt": "2", "c.txt": "2", "figures/b.png": "2"}
    assert list(strangers(out, ResultMarker.read(out))) == []
    assert sorted(p.name for p in out.iterdir()) == [
        ".lock", MARKER, "a.txt", "c.txt", "figures",
    ]  # fmt: skip
    _write(out, "3")
    assert _visible(out) == {"a.txt": "3", "figures/b.png": "3"}
    assert not (out / ".lock").exists()


def test_a_kill_before_outdated_files_are_removed_is_completed(out, monkeypatch):
    child = os.fork()
    if child == 0:
        monkeypatch.setattr(Path, "unlink", lambda *_, **__: os.kill(os.getpid(), signal.SIGKILL))
        with result_folder(out, "estimate") as folder:
            (folder / "a.txt").write_text("2")
            monkeypatch.setattr(OutputFolder, "write_text", _plainly)
        os._exit(0)
    _, status = os.waitpid(child, 0)
    assert os.WIFSIGNALED(status)
    assert (out / "figures" / "b.png").exists() and (out / "a.txt").read_text() == "2"
    _write(out, "3", ["a.txt"])
    assert _visible(out) == {"a.txt": "3"}


def _plainly(self, name, text):
    (self.path / name).write_text(text)


def test_what_was_changed_after_such_a_kill_is_not_overwritten(out, monkeypatch):
    assert _stopped_after(out, monkeypatch, 1)
    (out / "c.txt").write_text("mine")
    assert "c.txt: was changed" in _refused(lambda: _write(out, "3"))
    assert (out / "c.txt").read_text() == "mine"


_LOOP = """
import itertools, sys
from pathlib import Path
from wrenchsight.analyses.output.interruption import ends_are_interrupts
from wrenchsight.analyses.output.result_folder import result_folder
out = Path(sys.argv[1])
print("ready", flush=True)
with ends_are_interrupts():
    for k in itertools.count(int(sys.argv[2])):
        with result_folder(out, "estimate") as folder:
            for name in ("a.txt", "b.txt", "figures/c.png", f"figures/{k % 3}.png"):
                folder.write_text(name, str(k))
"""


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_ends_at_random_moments_leave_one_run_s_results(tmp_path, number):
    """Of a program that does nothing but replace its results."""
    moments = random.Random(int(number))
    out = tmp_path / "out"
    for attempt in range(12):
        process = subprocess.Popen(
            [sys.executable, "-c", _LOOP, str(out), str(1000 * attempt)],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        assert process.stdout.readline() == "ready\n"
        time.sleep(moments.uniform(0.0, 0.15))
        process.send_signal(number)
        process.communicate()
        if number == signal.SIGKILL and out.exists():
            recover(out)
        if not out.exists():
            continue
        if number != signal.SIGKILL:
            assert not (out / STAGING).exists()
        files = _visible(out)
        assert len(set(files.values())) <= 1, files
        marker = ResultMarker.read(out)
        if files:
            assert set(marker.files) == set(files)
            assert len(files) == 4
            assert list(strangers(out, marker)) == []
    _write(out)
    assert sorted(p.name for p in out.iterdir()) == [MARKER, "a.txt", "figures"]


# ---- a disk that is full or cannot be written to ----


def test_a_full_disk_leaves_the_older_results(out, monkeypatch):
    before = _files(out)

    def full(self, *_, **__):
        raise OSError(28, "No space left on device")

    with pytest.raises(InputError, match="No space left"), result_folder(out, "estimate") as folder:
        folder.write_text("a.txt", "2")
        monkeypatch.setattr(Path, "write_text", full)
        folder.write_text("c.txt", "2")
    monkeypatch.undo()
    assert _files(out) == before


def test_a_full_disk_at_the_marker_leaves_the_older_results(out, monkeypatch):
    before = _files(out)
    write_text = Path.write_text

    def full(self, *values, **options):
        if MARKER in self.name:
            raise OSError(28, "No space left on device")
        return write_text(self, *values, **options)

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(InputError, match="No space left"):
        _write(out, "2")
    monkeypatch.undo()
    assert _files(out) == before


# ---- a folder that someone has prepared ----


def _prepare_ready(out, files, listed=None):
    """Lays out what a killed run leaves: files that are ready, and their marker."""
    ready = out / STAGING / "ready"
    for name, content in files.items():
        (ready / name).parent.mkdir(parents=True, exist_ok=True)
        (ready / name).write_text(content)
    sums = {name: file_checksum(ready / name) for name in files}
    (ready / MARKER).write_text(ResultMarker("estimate", listed or sums).text())
    return ready


JOURNALS = (
    *("", "{", "{}", "[]", "null", '{"files": 3}', '{"files": ["../mine"], "remove": []}'),
    '{"files": [], "remove": ["../mine"], "before": {}, "after": {}}',
)


@pytest.mark.parametrize("journal", JOURNALS)
@pytest.mark.parametrize("place", ["journal.json", f"ready/{MARKER}", "ready", "new", ""])
def test_what_lies_where_a_run_writes_reaches_nothing_outside(out, tmp_path, journal, place):
    (tmp_path / "mine").write_text("mine")
    file = out / STAGING / place
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(journal)
    if place:
        _write(out, "2")
        assert _visible(out) == {"a.txt": "2", "figures/b.png": "2"}
    else:  # a file where the folder is needed
        _refused(lambda: _write(out, "2"))
    assert (tmp_path / "mine").read_text() == "mine"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["mine", "out"]


@pytest.mark.parametrize("content", ["escaped", "mine"])
def test_a_marker_that_is_ready_names_nothing_outside(out, tmp_path, content):
    (tmp_path / "mine").write_text("mine")
    _prepare_ready(out, {"c.txt": "2"}, {"../mine": file_checksum(tmp_path / "mine")})
    (out / STAGING / "mine").write_text(content)
    _write(out, "2")
    assert _visible(out) == {"a.txt": "2", "figures/b.png": "2"}
    assert (tmp_path / "mine").read_text() == "mine"


@pytest.mark.parametrize("way", [STAGING, f"{STAGING}/ready", f"{STAGING}/ready/deep"])
def test_a_link_where_a_run_writes_is_not_followed(out, tmp_path, way):
    elsewhere = tmp_path / "elsewhere"
    _prepare_ready(elsewhere, {"deep/c.txt": "2"})
    (out / way).parent.mkdir(parents=True, exist_ok=True)
    (out / way).symlink_to(elsewhere / way)
    before = _files(elsewhere)
    if way == STAGING:
        _refused(lambda: _write(out, "2"))
    else:
        _write(out, "2")
        assert _visible(out) == {"a.txt": "2", "figures/b.png": "2"}
    assert _files(elsewhere) == before


def test_a_linked_folder_in_the_way_of_what_is_ready_is_not_followed(out, tmp_path):
    (tmp_path / "elsewhere").mkdir()
    (out / "deep").symlink_to(tmp_path / "elsewhere")
    _prepare_ready(out, {"deep/c.txt": "2"})
    assert "deep: is a link" in _refused(lambda: _write(out, "2"))
    assert list((tmp_path / "elsewhere").iterdir()) == []


def test_a_pipe_among_what_is_ready_is_not_waited_for(out):
    os.mkfifo(_prepare_ready(out, {"c.txt": "2"}) / "d.txt")
    _write(out, "2")
    assert _visible(out) == {"a.txt": "2", "figures/b.png": "2"}


def test_a_marker_of_hand_made_names_is_no_licence(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (tmp_path / "mine").write_text("mine")
    files = {"../mine": "0" * 64}
    marker = {"format": 1, "command": "estimate", "files": files}
    (out / MARKER).write_text(json.dumps(marker))
    _write(out)
    assert (tmp_path / "mine").read_text() == "mine"
