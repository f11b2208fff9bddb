"""The experiments of one world: the task of a worker, its run and its outcome.

What the experiments of a world have in common, such as the identification of its arm, is computed
once (`analyses.study.shared_results`); what all worlds have in common once in the campaign, or once
on each worker of a scheduler. Nothing is drawn or recorded, unless the world has a folder.
"""

import os
import tempfile
import threading
import time
import traceback
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from wrenchsight.analyses.campaign.campaign_options import CampaignOptions
from wrenchsight.analyses.data_sets.advice import how_to_get_all
from wrenchsight.analyses.output.outputs import json_text, plain, plain_metrics
from wrenchsight.analyses.output.side_by_side import ONE_THREAD
from wrenchsight.analyses.study.experiment import Experiment, ExperimentContext, ExperimentResult
from wrenchsight.analyses.study.fingerprint import software_hash
from wrenchsight.analyses.study.shared_results import sharing_in
from wrenchsight.analyses.study.stored_result import written_figures
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.kernel import one_thread
from wrenchsight.models.truth.worlds import World, WorldSource, draw_world

_one_at_a_time = threading.Lock()  # torch's random numbers are those of the process
_worker_folders: list[tempfile.TemporaryDirectory[str]] = []


@dataclass
class CampaignSettings(CampaignOptions):
    """The settings of a campaign."""

    source: WorldSource = field(default_factory=WorldSource)  # of worlds


@dataclass(frozen=True)
class WorldTask:
    """The task of a worker: experiments to run in one world."""

    settings: CampaignSettings  # of the campaign
    number: int  # of the world
    modules: Mapping[str, str]  # of the experiments to run, by their names
    software: Mapping[str, str]  # `software_hash` of each module, by the experiment's name
    # folder for figures and recordings, one below it an experiment; None: they are not wanted
    out: Path | None = None
    # folder for what all worlds share; None: one of the worker's own
    everywhere: Path | None = None

    def world(self) -> World:
        """The world itself."""
        return draw_world(self.settings.seed, self.number, self.settings.source)


@dataclass
class WorldOutcome:
    """The outcome of a world, in plain values."""

    number: int  # of the world
    seed: int  # of the world
    parameters: dict[str, float]  # that were drawn
    # by experiment and key (`optimised.rmse_x_n`, `rmse_nm.0`); None: not finite
    values: dict[str, dict[str, float | None]] = field(default_factory=dict)
    # title and rows of "article / here" of each experiment
    described: dict[str, dict[str, Any]] = field(default_factory=dict)
    # by experiment, first one line, then where it happened
    failures: dict[str, str] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)  # of a processor, by experiment


class UnfitWorkerError(InputError):
    """A worker whose figures would not be those of this machine."""

    def __init__(self, place: str, problem: str, remedy: str) -> None:
        super().__init__("a worker", place, problem, remedy)
        self._arguments = place, problem, remedy

    def __reduce__(self) -> tuple[Any, ...]:  # it comes from another process
        return type(self), self._arguments


def run_world(task: WorldTask) -> WorldOutcome:
    """Runs the experiments of a task in its world; one that fails does not stop the others.

    Each experiment writes into a folder of its own, below `task.out`, or else below one of this
    world that is removed again. What the world's experiments share lies in the latter in either
    case; what all worlds share in the folder around it, `task.everywhere` or the worker's own. One
    world at a time runs in a process, and in one thread: seeds and sums are the process's.

    Raises:
        UnfitWorkerError: the worker has other software, or would compute in several threads.
    """
    for name, module in task.modules.items():
        _check_worker(module, task.software[name])
    settings, world = task.settings, task.world()
    outcome = WorldOutcome(world.number, world.seed, world.parameters())
    shared_by_worlds = _worker_folder() if task.everywhere is None else task.everywhere
    shared_by_worlds.mkdir(parents=True, exist_ok=True)
    with (
        _one_at_a_time,
        one_thread(),
        tempfile.TemporaryDirectory(dir=shared_by_worlds) as temporary,
    ):
        world_folder = Path(temporary)
        for name, module in task.modules.items():
            started = time.process_time()
            try:
                out = (world_folder if task.out is None else task.out) / name
                out.mkdir(parents=True)  # below a new folder of this world, or of this run
                with sharing_in(world_folder, shared_by_worlds):
                    experiment: Experiment = import_module(module).EXPERIMENT
                    missing = experiment.missing(settings.data)
                    if missing:
                        remedy = how_to_get_all(missing)
                        problem = "these recordings are not there"
                        raise InputError(", ".join(missing), "", problem, remedy)
                    context = ExperimentContext(
                        out=out,
                        data=settings.data,
                        seed=world.seed,
                        quick=settings.quick,
                        draws=task.out is not None,  # nobody looks into a temporary folder
                        world=world.robot,
                        hand=world.hand,
                        fastest_feed=settings.fastest_feed,
                    )
                    result = experiment.run(context)
                    metrics = plain_metrics(result.metrics)
                    if task.out is not None:
                        (out / "metrics.json").write_text(json_text(metrics), encoding="utf-8")
                        written_figures(result.figures, out)
                    outcome.values[name] = numbers_in(metrics)
                    outcome.described[name] = _description(experiment, result)
            except Exception as error:  # whatever it is, the others are to run
                # The first line is the reason, as `WorldOutcome.failures` states.
                lines = str(error).strip().splitlines() or [""]
                line = f"{type(error).__name__}: {lines[0]}".rstrip(": ")
                outcome.failures[name] = f"{line}\n\n{traceback.format_exc()}"
            outcome.seconds[name] = time.process_time() - started
    return outcome


@cache
def _worker_folder() -> Path:
    """A folder that lasts as long as this process."""
    _worker_folders.append(tempfile.TemporaryDirectory(prefix="wrenchsight-"))
    return Path(_worker_folders[0].name)


def numbers_in(metrics: Mapping[str, Any]) -> dict[str, float | None]:
    """The numbers of plain, nested metrics, by their paths; True is 1, None stays None.

    Raises:
        ValueError: there are none.
    """
    numbers = dict(_numbers(metrics, ""))
    if not numbers:
        raise ValueError("the experiment has measured no number")
    return numbers


def _numbers(value: Any, path: str) -> Iterator[tuple[str, float | None]]:
    if value is None or isinstance(value, bool | int | float):
        yield path, None if value is None else float(value)
    elif isinstance(value, Mapping | list):
        items = value.items() if isinstance(value, Mapping) else enumerate(value)
        for key, inner in items:
            yield from _numbers(inner, f"{path}.{key}".lstrip("."))


def _description(experiment: Experiment, result: ExperimentResult) -> dict[str, Any]:
    rows = [plain(asdict(row)) for row in result.comparison]  # tuples are lists, as in a table
    return {"title": experiment.title, "section": experiment.section, "comparison": rows}


def _check_worker(module: str, software: str) -> None:
    remedy = "install the same version on every machine"
    if _software_here(module) != software:
        raise UnfitWorkerError("", f"has another version of {module}", remedy)
    several = [name for name in ONE_THREAD if os.environ.get(name) != "1"]
    if several:
        remedy = "start workers with a nanny, as `dask worker` does, or set it to 1"
        raise UnfitWorkerError(several[0], "is not 1 in a worker's environment", remedy)


@cache
def _software_here(module: str) -> str:
    """`software_hash` of a module in this process; computed once."""
    return software_hash(module)
