"""What a study may replace in its folder, and where it puts what it may not."""

import os
import signal

import pytest

from wrenchsight.analyses.output.outputs import OutputFolder
from wrenchsight.analyses.output.result_marker import MARKER, ResultMarker
from wrenchsight.analyses.study.study_folder import StudyFolder, mark_experiment
from wrenchsight.models.files.input_error import InputError

NAMES = ("one", "two")


def _result(folder, content):
    folder.mkdir()
    for name in ("metrics.json", "figures/a.png"):
        OutputFolder(folder).write_text(name, content)
    mark_experiment(folder, "one")
    return folder


def _files(folder):
    found = {p.relative_to(folder).as_posix(): p for p in folder.rglob("*") if p.is_file()}
    return {name: path.read_text() for name, path in found.items() if MARKER not in name}


@pytest.fixture
def folder(tmp_path):
    """A study's folder with a result in it."""
    _result(tmp_path / "new", "1")
    (tmp_path / "study").mkdir()
    folder = StudyFolder(tmp_path / "study", NAMES)
    folder.replace(tmp_path / "new", "one")
    return folder


def test_an_empty_folder_becomes_a_study_s(tmp_path):
    StudyFolder(tmp_path, NAMES)
    assert ResultMarker.read(tmp_path).command == "study"
    StudyFolder(tmp_path, NAMES)


@pytest.mark.parametrize("name", ["one/a.txt", "metrics.json", "anything.txt", "report.html"])
def test_a_folder_that_holds_something_is_none(tmp_path, name):
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_text("mine")
    with pytest.raises(InputError, match="which wrenchsight did not write there"):
        StudyFolder(tmp_path, NAMES)
    assert _files(tmp_path) == {name: "mine"}
    assert not (tmp_path / MARKER).exists()


@pytest.mark.parametrize("name", ["metrics.json", "report.html", "failures/one.txt"])
def test_a_summary_that_someone_wrote_or_changed_is_refused(folder, name):
    path = folder.path / name
    path.parent.mkdir(exist_ok=True)
    path.write_text("mine")
    with pytest.raises(InputError, match="is not as a study wrote it"):
        StudyFolder(folder.path, NAMES)
    path.unlink()
    with folder.staged() as staged:
        staged.write_text(name, "ours")
    StudyFolder(folder.path, NAMES)
    path.write_text("mine")
    with pytest.raises(InputError, match="is not as a study wrote it"):
        StudyFolder(folder.path, NAMES)
    assert path.read_text() == "mine"


def test_other_files_of_the_user_s_do_no_harm(folder):
    (folder.path / "notes.txt").write_text("mine")
    (folder.path / ".my.partial").write_text("mine")
    StudyFolder(folder.path, NAMES)
    assert (folder.path / ".my.partial").read_text() == "mine"


def test_the_summary_is_kept_when_a_failure_is_written(folder):
    with folder.staged() as staged:
        staged.write_text("metrics.json", "1")
    with folder.staged() as staged:
        staged.write_text("failures/two.txt", "why")
    assert set(ResultMarker.read(folder.path).files) == {"metrics.json", "failures/two.txt"}
    with folder.staged(outdated=["failures/two.txt"]):
        pass
    assert set(ResultMarker.read(folder.path).files) == {"metrics.json"}
    assert not (folder.path / "failures").exists()


def test_a_result_as_it_was_written_is_removed(folder, tmp_path):
    assert folder.not_ours("one") == []
    folder.replace(_result(tmp_path / "new", "2"), "one")
    assert _files(folder.path) == {"one/metrics.json": "2", "one/figures/a.png": "2"}


def test_what_was_added_or_changed_is_set_aside(folder, tmp_path):
    for attempt in ("", "-2"):
        (folder.path / "one" / "figures" / "mine.png").write_text("mine")
        (folder.path / "one" / "metrics.json").write_text("changed")
        assert folder.not_ours("one") == ["figures/mine.png", "metrics.json"]
        folder.replace(_result(tmp_path / f"new{attempt}", "2"), "one")
        kept = folder.path / "set-aside" / f"one{attempt}"
        assert _files(kept) == {"figures/mine.png": "mine", "metrics.json": "changed"}
        assert _files(folder.path / "one") == {"metrics.json": "2", "figures/a.png": "2"}


def test_a_folder_without_a_marker_is_set_aside_whole(folder, tmp_path):
    (folder.path / "two").mkdir()
    (folder.path / "two" / "thesis.txt").write_text("mine")
    assert folder.not_ours("two") == ["thesis.txt"]
    folder.replace(_result(tmp_path / "new", "2"), "two")
    assert _files(folder.path / "set-aside" / "two") == {"thesis.txt": "mine"}


def test_results_of_a_command_are_not_an_experiment_s(folder, tmp_path):
    """As of `jcn-map --out STUDY/jcn-map`."""
    (folder.path / "two").mkdir()
    OutputFolder(folder.path / "two").write_text("metrics.json", "mine")
    mark = ResultMarker("two", {})
    OutputFolder(folder.path / "two").write_text(MARKER, mark.text())
    folder.replace(_result(tmp_path / "new", "2"), "two")
    assert _files(folder.path / "set-aside" / "two") == {"metrics.json": "mine"}


@pytest.mark.parametrize("what", ["file", "link"])
def test_a_file_or_link_in_the_place_is_set_aside(folder, tmp_path, what):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "a").write_text("mine")
    if what == "file":
        (folder.path / "two").write_text("mine")
    else:
        (folder.path / "two").symlink_to(tmp_path / "elsewhere")
    assert folder.not_ours("two") == [""]
    folder.replace(_result(tmp_path / "new", "2"), "two")
    assert (folder.path / "two").is_dir() and not (folder.path / "two").is_symlink()
    assert os.path.lexists(folder.path / "set-aside" / "two")
    assert (tmp_path / "elsewhere" / "a").read_text() == "mine"


@pytest.mark.parametrize("step", range(4))
def test_a_kill_while_it_is_replaced_loses_nothing(folder, tmp_path, monkeypatch, step):
    (folder.path / "one" / "mine.txt").write_text("mine")
    _result(tmp_path / "new", "2")
    child = os.fork()
    if child == 0:
        steps = iter(range(100))

        def dying(act):
            def die_in_time(self, *values, **options):
                if next(steps) == step:
                    os.kill(os.getpid(), signal.SIGKILL)
                return act(self, *values, **options)

            return die_in_time

        for name in ("rename", "unlink"):
            monkeypatch.setattr(type(tmp_path), name, dying(getattr(type(tmp_path), name)))
        folder.replace(tmp_path / "new", "one")
        os._exit(0)
    _, status = os.waitpid(child, 0)
    assert os.WIFSIGNALED(status)
    folder.recover("one")
    if (tmp_path / "new").exists():
        expected = {"metrics.json": "1", "figures/a.png": "1", "mine.txt": "mine"}
        assert _files(folder.path / "one") == expected
    else:
        assert _files(folder.path / "one") == {"metrics.json": "2", "figures/a.png": "2"}
        assert _files(folder.path / "set-aside" / "one") == {"mine.txt": "mine"}
