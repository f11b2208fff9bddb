"""A folder of results: it changes as one, and nothing that is not ours is touched."""

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
from wrenchsight.analyses.output.result_folder import (
    LOCK,
    STAGING,
    open_results,
    result_folder,
)
from wrenchsight.analyses.output.result_marker import MARKER, ResultMarker, file_checksum, strangers
from wrenchsight.models.files.files_read import about_to_read
from wrenchsight.models.files.input_error import InputError

ROOT = Path(module.__file__).resolve().parents[2]
_OLD = {"a.txt": "1", "figures/b.png": "1"}


def _write(out, content="1", names=tuple(_OLD), command="estimate"):
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


def test_files_and_a_marker_and_nothing_else(out, tmp_path):
    assert _visible(out) == _OLD
    assert sorted(p.name for p in out.iterdir()) == [MARKER, "a.txt", "figures"]
    marker = ResultMarker.read(out)
    assert marker == ResultMarker("estimate", {n: file_checksum(out / n) for n in _OLD})
    assert "replaces and removes only" in (out / MARKER).read_text()
    _write(tmp_path / "again")
    assert _files(tmp_path / "again") == _files(out)


def test_the_older_results_are_there_until_the_end_and_go_as_a_whole(out):
    with result_folder(out, "estimate") as folder:
        folder.write_text("a.txt", "2")
        assert _visible(out) == _OLD
    assert _visible(out) == {"a.txt": "2"}
    assert not (out / "figures").exists()
    assert list(ResultMarker.read(out).files) == ["a.txt"]


def test_a_part_changes_and_the_rest_stays(out):
    with open_results(out, "estimate") as results:
        with results.changing(["figures/b.png"]) as folder:
            folder.write_text("one/c.txt", "2")
        assert results.below("one") == ["one/c.txt"]
        with pytest.raises(RuntimeError), results.changing(["a.txt"]):
            raise RuntimeError
        with results.changing() as folder:
            results.work("log.txt").write_text("no result")
            folder.write_text("d.txt", "3")
    assert _visible(out) == {"a.txt": "1", "one/c.txt": "2", "d.txt": "3"}
    assert list(strangers(out, ResultMarker.read(out))) == []
    (out / "one" / "c.txt").unlink()
    with open_results(out, "estimate") as results:
        assert results.below("one") == []


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


def test_the_folder_may_be_the_working_one_and_hidden_files_stay(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path(".gitignore").write_text("*")
    _write(Path())
    _write(Path(), "2")
    assert Path("a.txt").read_text() == "2"
    assert Path(".gitignore").read_text() == "*"


def test_refusals_name_the_file_as_the_user_knows_it(tmp_path):
    out = tmp_path / "out"
    with pytest.raises(InputError) as caught, result_folder(out, "estimate") as folder:
        raise InputError(folder / "wrench.csv", "", "cannot be written (No space left on device)")
    assert str(caught.value).startswith(f"{out / 'wrench.csv'}: cannot")


# ---- what is not ours ----


def _change(path):
    """At the same size and time."""
    times = path.stat()
    path.write_text("7")
    os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))


def _link(path):
    """To a file of the same content, which lies outside."""
    outside = path.parents[1] / "outside"
    outside.write_bytes(path.read_bytes())
    path.unlink()
    path.symlink_to(outside)


def _linked_folder(path):
    (path.parents[2] / "elsewhere").mkdir()
    path.rename(path.parents[2] / "elsewhere" / path.name)
    path.parent.rmdir()
    path.parent.symlink_to(path.parents[2] / "elsewhere")


@pytest.mark.parametrize(
    ("name", "spoil", "message"),
    [
        ("notes.txt", _change, "notes.txt"),
        ("figures/mine.png", _change, "figures/mine.png"),
        ("new/deep/c.txt", _change, "new/deep/c.txt"),
        ("a.txt", _change, "a.txt"),
        ("a.txt", _link, "a.txt"),
        ("figures/b.png", _linked_folder, "figures"),
    ],
)
def test_a_folder_with_something_of_the_user_s_is_refused_as_it_is(out, name, spoil, message):
    path = out / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch()
    spoil(path)
    before = _files(out.parent)

    def run():
        with result_folder(out, "estimate"):
            raise AssertionError("before any work")

    assert f"{out}: holds {message}, which is not as wrenchsight wrote it" in _refused(run)
    assert _files(out.parent) == before


def test_a_result_that_someone_removed_is_written_again(out):
    (out / "a.txt").unlink()
    _write(out, "2")
    assert _visible(out)["a.txt"] == "2"


def test_the_results_of_another_command_are_refused(out):
    before = _files(out)
    line = _refused(lambda: _write(out, "2", command="identify"))
    assert "holds the results of estimate, not of identify" in line
    assert _files(out) == before


@pytest.mark.parametrize("name", ["a.txt", "new.txt", "figures"])
def test_a_file_that_appears_during_a_run_is_not_overwritten(out, name):
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


@pytest.mark.parametrize("link", [None, Path.symlink_to, Path.hardlink_to])
@pytest.mark.parametrize("name", _OLD)
def test_a_file_in_the_folder_is_not_read_by_whatever_name(out, tmp_path, link, name):
    log = out / name
    if link is not None:
        log = tmp_path / "log.csv"
        link(log, out / name)
    (tmp_path / "linked").symlink_to(out)

    def run(folder):
        with result_folder(folder, "estimate"):
            about_to_read(log)

    for folder in (out, tmp_path / "linked"):
        assert f"{log}: is read by this command" in _refused(lambda: run(folder))  # noqa: B023
    assert _visible(out) == _OLD


def test_other_files_may_be_read_also_where_there_are_none(out, tmp_path):
    (tmp_path / "log.csv").write_text("x")
    with result_folder(out, "estimate"):
        about_to_read(tmp_path / "log.csv")
        about_to_read(tmp_path / "nowhere.csv")
        about_to_read("x" * 5000)


# ---- two runs, and runs that are killed ----

_HOLD = """
import sys, time
from pathlib import Path
from wrenchsight.analyses.output.result_folder import result_folder
with result_folder(Path(sys.argv[1]), "estimate") as folder:
    folder.write_text("a.txt", "half")
    print("locked", flush=True)
    time.sleep(60)
"""


def test_a_second_run_is_refused_until_the_first_is_dead(out):
    process = subprocess.Popen(
        [sys.executable, "-c", _HOLD, str(out)], cwd=ROOT, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout.readline() == "locked\n"
    assert "another run is writing" in _refused(lambda: _write(out, "3"))
    process.kill()
    process.communicate()
    assert (out / STAGING).exists()
    assert _visible(out) == _OLD
    _write(out, "3")
    assert sorted(p.name for p in out.iterdir()) == [MARKER, "a.txt", "figures"]


def test_a_link_in_the_lock_s_place_is_not_followed(out, tmp_path):
    (tmp_path / "mine").write_text("mine")
    (out / LOCK).symlink_to(tmp_path / "mine")
    with pytest.raises(InputError, match="cannot be written"):
        _write(out, "2")
    assert (tmp_path / "mine").read_text() == "mine"


def _killed(act):
    """Whether a child that does this dies of a signal."""
    child = os.fork()
    if child == 0:
        act()
        os._exit(0)
    _, status = os.waitpid(child, 0)
    return os.WIFSIGNALED(status)


def _stopped_after(out, monkeypatch, steps):
    """Writes "2", and dies after so many files have gone to their places or were removed."""

    def run():
        count = iter(range(100))

        def dying(act):
            def die_in_time(self, *values, **options):
                moves_results = f"{STAGING}/new" in str(self) or (
                    act is unlink and f"{out}/figures" in str(self)
                )
                if moves_results and ".partial" not in self.name and next(count) == steps:
                    os.kill(os.getpid(), signal.SIGKILL)
                return act(self, *values, **options)

            return die_in_time

        unlink = Path.unlink
        for name in ("replace", "unlink"):
            monkeypatch.setattr(Path, name, dying(getattr(Path, name)))
        _write(out, "2", ["a.txt", "c.txt"])

    return _killed(run)


@pytest.mark.parametrize("steps", range(4))
def test_after_a_kill_while_files_change_places_nothing_counts_and_all_is_known(
    out, monkeypatch, steps
):
    assert _stopped_after(out, monkeypatch, steps)
    marker = ResultMarker.read(out)
    assert set(marker.replacing) == {"a.txt", "c.txt", "figures/b.png"}
    assert list(strangers(out, marker)) == []
    with open_results(out, "estimate") as results:
        assert results.below("figures") == []
    _write(out, "3")
    assert _visible(out) == {"a.txt": "3", "figures/b.png": "3"}
    assert ResultMarker.read(out).replacing == {}
    assert sorted(p.name for p in out.iterdir()) == [MARKER, "a.txt", "figures"]


def test_what_a_kill_mixed_counts_only_once_it_is_replaced(out, monkeypatch):
    """Another part may change before."""
    assert _stopped_after(out, monkeypatch, 1)
    with open_results(out, "estimate") as results:
        with results.changing() as folder:
            folder.write_text("other/d.txt", "3")
        assert results.below("other") == ["other/d.txt"]
    with open_results(out, "estimate") as results:
        assert results.below("figures") == []
        with results.changing(["a.txt", "c.txt", "figures/b.png"]) as folder:
            folder.write_text("figures/b.png", "3")
        assert results.below("figures") == ["figures/b.png"]
    assert ResultMarker.read(out).replacing == {}


def test_a_file_changed_after_a_kill_is_not_overwritten(out, monkeypatch):
    assert _stopped_after(out, monkeypatch, 1)
    (out / "c.txt").write_text("mine")
    assert "holds c.txt, which is not as wrenchsight wrote it" in _refused(lambda: _write(out, "3"))
    assert (out / "c.txt").read_text() == "mine"


_LOOP = """
import itertools, sys
from pathlib import Path
from wrenchsight.analyses.output.interruption import signals_are_interrupts
from wrenchsight.analyses.output.result_folder import result_folder
out = Path(sys.argv[1])
print("ready", flush=True)
with signals_are_interrupts():
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
    for attempt in range(8):
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
        if not out.exists():
            continue
        if number != signal.SIGKILL:
            assert not (out / STAGING).exists()
            assert not (out / LOCK).exists()
        files = _visible(out)
        marker = ResultMarker.read(out)
        if marker is not None and marker.replacing:
            assert number == signal.SIGKILL
            assert list(strangers(out, marker)) == []
            continue
        assert len(set(files.values())) <= 1, files
        if files:
            assert set(marker.files) == set(files)
            assert len(files) == 4
            assert list(strangers(out, marker)) == []
    _write(out)
    assert sorted(p.name for p in out.iterdir()) == [MARKER, "a.txt", "figures"]


@pytest.mark.parametrize("at", [module.shutil.rmtree, Path.rmdir, Path.unlink])
def test_an_interrupt_while_it_tidies_up_leaves_nothing_behind(tmp_path, monkeypatch, at):
    """The random moments meet one of these once in a hundred."""
    owner = module.shutil if at is module.shutil.rmtree else Path

    def interrupted(*values, **options):
        os.kill(os.getpid(), signal.SIGINT)
        return at(*values, **options)

    with (
        pytest.raises(KeyboardInterrupt),
        open_results(tmp_path / "below/out", "estimate") as folder,
    ):
        folder.work("notes")
        monkeypatch.setattr(owner, at.__name__, interrupted)
    monkeypatch.undo()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("full_for", ["c.txt", MARKER])
def test_a_full_disk_leaves_the_older_results(out, monkeypatch, full_for):
    before = _files(out)
    write_text = Path.write_text

    def full(self, *values, **options):
        if full_for in self.name:
            raise OSError(28, "No space left on device")
        return write_text(self, *values, **options)

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(InputError, match="No space left"):
        _write(out, "2", ["a.txt", "c.txt"])
    monkeypatch.undo()
    assert _files(out) == before


# ---- a folder that someone has prepared ----


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"{",
        b"[]",
        b'{"format": 2, "command": "estimate", "files": {}}',
        b'{"format": 1, "command": 3, "files": {}}',
        b'{"format": 1, "command": "estimate", "files": ["a"]}',
        b'{"format": 1, "command": "estimate", "files": {"../mine": "0"}}',
        b'{"format": 1, "command": "estimate", "files": {"/etc/passwd": "0"}}',
        b'{"format": 1, "command": "estimate", "files": {}, "replacing": {"../mine": "0"}}',
        b"[" * 100_000,
        b"\xff\xfe\x00",
    ],
)
def test_a_foreign_file_under_the_markers_name_is_no_marker(out, content):
    (out.parent / "mine").write_text("mine")
    (out / MARKER).write_bytes(content)
    assert ResultMarker.read(out) is None
    _refused(lambda: _write(out, "2"))
    for name in _OLD:
        (out / name).unlink()
    _write(out, "2")
    assert (out.parent / "mine").read_text() == "mine"
    elsewhere = out.parent / "linked"
    elsewhere.mkdir()
    (elsewhere / MARKER).symlink_to(out / MARKER)
    assert ResultMarker.read(elsewhere) is None


@pytest.mark.parametrize("content", ["{", json.dumps({"files": ["../mine"]})])
@pytest.mark.parametrize("place", [f"new/{MARKER}", "new", "work"])
def test_what_lies_where_a_run_writes_reaches_nothing_outside(out, tmp_path, content, place):
    (tmp_path / "mine").write_text("mine")
    file = out / STAGING / place
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(content)
    _write(out, "2")
    assert _visible(out) == {"a.txt": "2", "figures/b.png": "2"}
    assert sorted(p.name for p in tmp_path.iterdir()) == ["mine", "out"]
    (out / STAGING).write_text("no folder")
    _refused(lambda: _write(out, "2"))
    assert (tmp_path / "mine").read_text() == "mine"


@pytest.mark.parametrize("way", [STAGING, f"{STAGING}/new", f"{STAGING}/new/deep", "deep"])
def test_a_link_where_a_run_writes_is_not_followed(out, tmp_path, way):
    elsewhere = tmp_path / "elsewhere"
    (elsewhere / way).mkdir(parents=True)
    (elsewhere / way / "c.txt").write_text("2")
    (out / way).parent.mkdir(parents=True, exist_ok=True)
    (out / way).symlink_to(elsewhere / way)
    before = _files(elsewhere)
    if way in (STAGING, "deep"):
        line = _refused(lambda: _write(out, "2", ["deep/c.txt"]))
        assert "is no folder" in line or "holds deep" in line
    else:
        _write(out, "2")
        assert _visible(out) == {"a.txt": "2", "figures/b.png": "2"}
    assert _files(elsewhere) == before
