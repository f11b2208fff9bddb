"""An experiment, run as a study runs it."""

import json
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from wrenchsight.analyses.study.experiment import Experiment, ExperimentContext
from wrenchsight.analyses.study.outcome import look_up
from wrenchsight.analyses.study.shared_results import sharing_in
from wrenchsight.analyses.study.stored_result import write_result
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot


@pytest.hookimpl(tryfirst=True)  # before tests are chosen by their marks
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """A test that runs an experiment is a long one."""
    for item in items:
        if "run_experiment" in getattr(item, "fixturenames", ()):
            item.add_marker("long")


class Ran(NamedTuple):
    """What an experiment measured, the folder of its files, and its notes with their figures."""

    metrics: dict[str, Any]
    out: Path
    notes: list[str]


@pytest.fixture(scope="session")
def run_experiment(
    tmp_path_factory: pytest.TempPathFactory, common_work: Path
) -> Callable[..., Ran]:
    """Runs an experiment and writes its result: every row has its number, every figure its file."""

    def run(experiment: Experiment, data: Path = Path("absent"), **options: Any) -> Ran:
        out = tmp_path_factory.mktemp(experiment.name)
        shares: list[float] = []
        context = ExperimentContext(
            out=out, data=data, progress=lambda share, step: shares.append(share), **options
        )
        with sharing_in(common_work):
            result = experiment.run(context)
        assert (np.diff(shares) > -1e-9).all()
        write_result(out, experiment, result, {}, {})
        metrics, stored = (
            json.loads((out / name).read_text(encoding="utf-8"))
            for name in ("metrics.json", "result.json")
        )
        keys = [row["key"] for row in stored["comparison"]]
        assert all(look_up(metrics, key) is not None for key in keys)
        assert not experiment.readme or {*experiment.readme} & {*keys}
        files = [out / file["path"] for file in (*stored["figures"], *stored["pages"])]
        assert all(file.stat().st_size > 10_000 for file in files)
        return Ran(result.metrics, out, stored["notes"])

    return run


@pytest.fixture(scope="module")
def ran(
    request: pytest.FixtureRequest,
    run_experiment: Callable[..., Ran],
    data_holding: Callable[..., Path],
) -> Ran:
    """The folder's experiment, with the module's OPTIONS, on recordings that hold its FILES."""
    module, folder = request.module, request.path.parent.name
    experiment = import_module(f"wrenchsight.analyses.experiments.{folder}.experiment").EXPERIMENT
    data = data_holding(*module.FILES) if hasattr(module, "FILES") else Path("absent")
    return run_experiment(experiment, data, **getattr(module, "OPTIONS", {}))


@pytest.fixture(scope="module")
def metrics(ran: Ran) -> dict[str, Any]:
    """What it measured."""
    return ran.metrics


@pytest.fixture(scope="session")
def swing(ur10e: Robot) -> Recording:
    """4 s of a UR10e whose joints all swing once, with rounded angles and without currents."""
    t = 100.0 + 0.01 * np.arange(400)
    turned = 0.2 * (1 - np.cos(2 * np.pi * (t - 100.0) / 4.0))
    q = np.round(np.asarray(ur10e.home) + turned[:, None], 4)
    v = np.gradient(q, 0.01, axis=0)
    return Recording(t=t, q=q, v=v, current=np.zeros_like(q), source="real")
