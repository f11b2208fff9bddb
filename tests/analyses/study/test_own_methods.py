"""Estimators of others: how they are named, found, refused, and what makes a study run anew."""

import subprocess
import sys

import pytest

from wrenchsight.analyses.study import own_methods
from wrenchsight.analyses.study.outcome import StudySettings
from wrenchsight.analyses.study.own_methods import MethodEntry, named_methods
from wrenchsight.analyses.study.study import run_study
from wrenchsight.models.files.input_error import InputError


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working directory, which is not among the places of modules."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    modules_before = set(sys.modules)
    yield tmp_path
    for name in set(sys.modules) - modules_before:
        del sys.modules[name]


def module(folder, name, text):
    (folder / f"{name}.py").write_text(text)


def test_a_method_is_found_in_the_working_directory_and_named_by_its_module(folder):
    module(folder, "their_method", "def make(setting): return None\ndef other(setting): pass\n")
    texts = ["their_method:make", "their_method:other", "a-third=their_method:make"]
    methods = named_methods(texts)
    assert [method.name for method in methods] == ["their_method", "other", "a-third"]
    assert methods[0].load()(None) is None


def test_an_entry_point_is_a_method_without_an_option(folder, monkeypatch):
    module(folder, "their_package", "def make(setting): pass\n")
    monkeypatch.syspath_prepend(str(folder))

    class Point:
        name, value, dist = "theirs", "their_package:make", None

    monkeypatch.setattr(own_methods, "_installed", lambda: [Point])
    assert named_methods([]) == (MethodEntry("theirs", "their_package", "make"),)
    Point.value = "their_package:absent"
    with pytest.raises(InputError, match=r"^package theirs: their_package has no function"):
        named_methods([])
    # Who takes no methods imports none.
    assert named_methods([], imported=False) == (MethodEntry("theirs", "their_package", "absent"),)
    with pytest.raises(InputError, match="--jobs"):
        run_study(["jcn-map"], folder / "out", folder, jobs=0)


@pytest.mark.parametrize(
    ("text", "content", "words"),
    [
        ("absent_method:make", None, "there is no module absent_method"),
        ("absent.method:make", None, "there is no module absent.method"),
        ("broken_method:make", "import absent_too\n", "cannot be imported (ModuleNotFoundError: "),
        ("broken_syntax:make", "def make(:\n", "cannot be imported (SyntaxError"),
        ("leaving_method:make", "raise SystemExit(3)\n", "cannot be imported (SystemExit: 3)"),
        ("empty_method:make", "", "has no function 'make'"),
        ("no_function:make", "make = 3\n", "is no function, but a int"),
        ("no_colon", None, "expected MODULE:FUNCTION"),
        ("a/b.py:make", None, "expected MODULE:FUNCTION"),
        (
            "ours=fine_method:make",
            "def make(setting): pass\n",
            "there is already a method named 'ours'",
        ),
    ],
)
def test_an_object_that_is_no_method_is_refused_in_one_line(folder, text, content, words):
    if content is not None:
        module(folder, text.partition("=")[2].partition(":")[0] or text.partition(":")[0], content)
    with pytest.raises(InputError) as refused:
        named_methods([text])
    line = str(refused.value)
    assert line.startswith("--method") and words in line and "\n" not in line


def test_a_study_without_an_experiment_that_takes_methods_refuses_them(folder):
    module(folder, "idle_method", "def make(setting): pass\n")
    with pytest.raises(InputError, match=r"none of jcn-map takes a --method; add benchmark"):
        run_study(["jcn-map"], folder / "out", folder, methods=["idle_method:make"])
    assert not (folder / "out").exists()


def test_a_changed_method_runs_anew_what_measures_it_and_nothing_else(folder):
    module(folder, "changing_method", "def make(setting): pass\n")

    def fingerprints():
        settings = StudySettings(
            (), (), folder, 0, False, "1", methods=named_methods(["changing_method:make"])
        )
        measured_module = "wrenchsight.analyses.study.own_methods"
        return [settings.fingerprint(measured_module, (), takes) for takes in (False, True)]

    others, taking = fingerprints()
    module(folder, "changing_method", "def make(setting): return None\n")
    others_after, taking_after = fingerprints()
    assert others == others_after and "methods" not in others
    assert taking != taking_after
    assert {**taking, "methods": []} == {**taking_after, "methods": []}


def test_the_command_refuses_what_is_no_method_and_writes_nothing(folder):
    command = [sys.executable, "-m", "wrenchsight", "study", "benchmark", "--out", "out"]
    ended = subprocess.run(
        [*command, "--method", "absent_method:make"],
        capture_output=True,
        text=True,
        check=False,
        cwd=folder,
    )
    assert ended.returncode == 2
    assert "there is no module absent_method" in " ".join(ended.stderr.split())
    assert "Traceback" not in ended.stderr
    assert not (folder / "out").exists()
