"""The registry of experiments: found, registered from outside, and taken out again."""

import json
import sys
from importlib.metadata import EntryPoint

import pytest

from wrenchsight.analyses.study import registry
from wrenchsight.analyses.study.registry import REGISTRY, ExperimentRegistry, read_entry
from wrenchsight.analyses.study.study import run_study
from wrenchsight.models.files.input_error import InputError, install_of

_MODULE = """
from wrenchsight.analyses.study.experiment import ComparisonRow, Experiment, ExperimentResult

def run(context):
    return ExperimentResult(
        metrics={"error_n": float(context.seed)},
        comparison=[ComparisonRow("Error", "error_n")],
    )

EXPERIMENT = Experiment(
    "toy", "A toy", "nowhere", run, order=75, seconds=2, readme=("error_n",)
)
"""


@pytest.fixture
def toy(tmp_path, monkeypatch):
    """The name of a module with an experiment, outside of this software."""
    monkeypatch.syspath_prepend(str(tmp_path))
    # Else each experiment's process would first import the test runner: its main module.
    monkeypatch.setattr(sys.modules["__main__"], "__spec__", None)
    monkeypatch.delattr(sys.modules["__main__"], "__file__", raising=False)
    (tmp_path / "toy_experiment.py").write_text(_MODULE)
    return "toy_experiment"


def test_a_module_outside_runs_as_any_other_and_is_taken_out_again(toy, tmp_path):
    before = dict(REGISTRY.entries())
    with REGISTRY.registered(toy) as entry:
        assert (entry.order, entry.seconds, entry.readme) == (75, 2, ("error_n",))
        names = list(REGISTRY.entries())
        assert names[names.index("repeat-cycle") + 1] == "toy"  # by its order
        run_study(["toy"], tmp_path / "out", tmp_path, seed=4)
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text())
    assert metrics == {"toy": {"error_n": 4.0}}
    assert dict(REGISTRY.entries()) == before
    assert toy not in sys.modules  # read here, imported in its own process alone


def test_without_a_module_that_it_needs_it_is_skipped(toy, tmp_path):
    file = tmp_path / "toy_experiment.py"
    file.write_text(_MODULE.replace("order=75", 'order=75, modules=("no_such_module",)'))
    with REGISTRY.registered(toy):
        (outcome,) = run_study(["toy"], tmp_path / "out", tmp_path).outcomes
    assert outcome.state == "skipped"
    assert outcome.reason == f"needs no_such_module; {install_of('study')}"


def test_recordings_that_are_no_literals_are_read_from_the_module(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))
    text = _MODULE.replace("order=75", "order=75, needs=(SET,), uses=('other',)")
    (tmp_path / "named_sets.py").write_text(
        text.replace("EXPERIMENT =", "SET = 'mine'\nEXPERIMENT =")
    )
    entry = read_entry("named_sets")
    assert "named_sets" not in sys.modules
    assert entry.recordings() == (("mine",), ("other",))


def test_a_name_is_given_once(toy):
    toys = ExperimentRegistry()
    toys.register(toy)
    with pytest.raises(ValueError, match="has an experiment toy already"):
        toys.register(toy)
    toys.unregister("toy")
    with pytest.raises(ValueError, match="no experiment toy was"):
        toys.unregister("toy")
    assert toys.entries() == {}


def test_an_installed_package_adds_one_by_an_entry_point(toy, monkeypatch):
    point = EntryPoint("toy", toy, registry.ENTRY_POINTS)
    monkeypatch.setattr(registry, "entry_points", lambda group: [point])
    assert list(ExperimentRegistry(group=registry.ENTRY_POINTS).entries()) == ["toy"]
    broken = EntryPoint("toy", "nowhere", registry.ENTRY_POINTS)
    monkeypatch.setattr(registry, "entry_points", lambda group: [broken])
    with pytest.raises(InputError, match="entry point fails: there is no module nowhere"):
        ExperimentRegistry(group=registry.ENTRY_POINTS).entries()


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("x = 1\n", "has no EXPERIMENT"),
        ("\nEXPERIMENT = 3\n", r"not Experiment\(...\)"),
        ("\nEXPERIMENT = Experiment(name=name())\n", "must be literals"),
    ],
)
def test_what_a_list_needs_must_be_there_in_plain_words(tmp_path, monkeypatch, text, problem):
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "odd_experiment.py").write_text(text)
    with pytest.raises(ValueError, match=problem):
        read_entry("odd_experiment")
