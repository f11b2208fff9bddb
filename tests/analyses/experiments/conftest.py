"""An experiment, run as a study runs it."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from wrenchsight.analyses.study.experiment import Experiment, ExperimentContext
from wrenchsight.analyses.study.outcome import look_up
from wrenchsight.analyses.study.shared_results import sharing_in
from wrenchsight.analyses.study.stored_result import write_result


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
        told: list[float] = []
        context = ExperimentContext(
            out=out, data=data, progress=lambda share, what: told.append(share), **options
        )
        with sharing_in(common_work):
            result = experiment.run(context)
        assert (np.diff(told) > -1e-9).all()
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
