"""Experiments of a test's own, programs that run them, and `estimate` without its figures."""

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from importlib import invalidate_caches
from pathlib import Path
from textwrap import dedent, indent

import pytest

from wrenchsight.analyses.methods.estimate.estimate_summary import EstimateSummary
from wrenchsight.analyses.output.outputs import OutputFolder
from wrenchsight.analyses.study.registry import REGISTRY

_MODULE = """
from pathlib import Path
import os, sys, time
from dataclasses import replace
import numpy as np
from wrenchsight.analyses.study.experiment import (
    ComparisonRow, Experiment, ExperimentContext, ExperimentResult, FigureFile
)
from wrenchsight.models.files.input_error import InputError

def run(context: ExperimentContext) -> ExperimentResult:
{body}
    return measured(context)

def measured(context, **more):
    random = np.random.default_rng(context.seed)
    context.progress(0.5, "half way")
    figure = context.out / "figures" / "noise.png"
    figure.parent.mkdir()
    figure.write_bytes(random.bytes(64))
    return ExperimentResult(
        metrics=dict(max_error_n=24.7, rmse_nm=random.normal(size=6), **more),
        figures=[FigureFile(Path("figures/noise.png"), "Noise, as <measured> & drawn.")],
        comparison=[ComparisonRow("Largest error in `Y` [bold]", "max_error_n", 24.86, "noise")],
        notes=["The error is `small`."],
        configuration=dict(length=10 if context.quick else 1000),
    )

EXPERIMENT = Experiment("{name}", "The {name} experiment", "4.3", run, needs={needs},
    seconds={seconds})
"""


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
def ended(tmp_path: Path) -> Callable[..., tuple[int, str]]:
    """Runs a program that knows a module's experiment until `begun` says so, and ends it, with
    whatever it started, as a terminal or a batch system does.

    Returns:
        Its exit code, and what it wrote on stderr.
    """

    def end(
        module: Path, program: str, begun: Callable[[], bool], number: int, group: bool = True
    ) -> tuple[int, str]:
        script = tmp_path / "script.py"
        script.write_text(
            "import signal\n"
            "from pathlib import Path\n"
            "from wrenchsight.analyses.study.registry import REGISTRY\n"
            # What a shell starts in the background ignores it.
            "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
            "if __name__ == '__main__':\n"
            f"    REGISTRY.register({module.stem!r})\n" + indent(dedent(program), "    ")
        )
        path = os.pathsep.join(map(str, (module.parent, Path(__file__).parents[2])))
        process = subprocess.Popen(
            [sys.executable, str(script)],
            start_new_session=True,
            env=os.environ | {"PYTHONPATH": path},
            stderr=subprocess.PIPE,
            text=True,
        )
        limit = time.monotonic() + 120.0
        while not begun() and time.monotonic() < limit:
            assert process.poll() is None, process.communicate()
            time.sleep(0.02)
        (os.killpg if group else os.kill)(process.pid, number)
        _, errors = process.communicate(timeout=60)
        return process.returncode, errors

    return end


@pytest.fixture
def experiments(
    add_module: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> Callable[..., Path]:
    """Adds an experiment that does what `body` says and then measures noise; the registry has no
    others."""
    monkeypatch.setattr(REGISTRY, "_packages", ())

    def add(name: str, body: str = "", needs: tuple[str, ...] = (), seconds: float = 30.0) -> Path:
        body = indent(dedent(body), "    ")
        return add_module(name, _MODULE.format(body=body, name=name, needs=needs, seconds=seconds))

    return add
