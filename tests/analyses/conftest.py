"""Experiments of a test's own, and `estimate` without its figures."""

import sys
from collections.abc import Callable, Iterator
from importlib import invalidate_caches
from pathlib import Path

import pytest

from wrenchsight.analyses.methods.reading.estimate_summary import EstimateSummary
from wrenchsight.analyses.output.outputs import OutputFolder
from wrenchsight.analyses.study.registry import REGISTRY


@pytest.fixture
def no_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """`estimate` draws nothing: that takes longer than all else, and has tests of its own."""
    monkeypatch.setattr(OutputFolder, "write_figure", lambda self, name, figure: None)
    monkeypatch.setattr(EstimateSummary, "figure", lambda self, *given: None)


@pytest.fixture
def add_module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Path]]:
    """Puts a module with an experiment into the registry, for the test and for its processes."""
    folder = tmp_path / "modules"
    folder.mkdir()
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.setenv("PYTHONPATH", str(folder))
    # Else each experiment's process would first import the test runner: its main module.
    monkeypatch.setattr(sys.modules["__main__"], "__spec__", None)
    monkeypatch.delattr(sys.modules["__main__"], "__file__", raising=False)
    added: dict[str, str] = {}

    def add(name: str, text: str) -> Path:
        file = folder / f"fake_{name.replace('-', '_')}.py"
        file.write_text(text, encoding="utf-8")
        invalidate_caches()
        if name in added:
            REGISTRY.unregister(name)
        added[name] = REGISTRY.register(file.stem).name
        return file

    yield add
    for name in added:
        REGISTRY.unregister(name)


@pytest.fixture
def no_other_experiments(monkeypatch: pytest.MonkeyPatch) -> None:
    """The registry has the test's own experiments alone."""
    monkeypatch.setattr(REGISTRY, "_packages", ())
