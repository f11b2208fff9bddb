"""Runs experiments in many worlds, stores finished worlds and writes the spread of their figures.

A folder holds one campaign: one seed, one set of ranges, one length. Finished worlds never run
again; whatever ends a campaign, the same command goes on where it stopped.
"""

import json
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import closing, suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final

from wrenchsight.analyses.campaign.campaign_report import write_campaign_report
from wrenchsight.analyses.campaign.campaign_store import (
    TABLE_FILE,
    CampaignRecord,
    WorldParts,
    read_table,
    write_table,
)
from wrenchsight.analyses.campaign.distributions import (
    Distribution,
    distribution_metrics,
    distributions,
)
from wrenchsight.analyses.campaign.workers import on_cluster, on_this_machine, refuse_silent
from wrenchsight.analyses.campaign.world_run import CampaignSettings, WorldOutcome, WorldTask
from wrenchsight.analyses.data_sets.places import given_folder
from wrenchsight.analyses.output.interruption import signals_are_interrupts, uninterrupted
from wrenchsight.analyses.output.outputs import OutputFolder, json_text, plain
from wrenchsight.analyses.output.progress import Progress, State
from wrenchsight.analyses.output.result_folder import ResultFolder, open_results
from wrenchsight.analyses.study.fingerprint import libraries, software_hash
from wrenchsight.analyses.study.registry import REGISTRY
from wrenchsight.analyses.study.shared_results import digest
from wrenchsight.analyses.study.study import available_cores, check_names, software_version
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.whole_file import writing_to
from wrenchsight.models.truth.worlds import check_ranges, draw_world

COMMAND: Final = "campaign"
METRICS: Final = "metrics.json"
TIMINGS: Final = "timings.json"
FAILURES: Final = "failures"
_LOG: Final = "workers.log"
_LAST_LINES: Final = 40  # of what the workers printed, behind the word that one was killed


@dataclass(frozen=True)
class CampaignResult:
    """The result of a campaign.

    Attributes:
        out: its folder.
        worlds: number of worlds with figures, of this run or earlier.
        distributions: the figures of the article over these worlds.
        failures: outcomes of this run in which experiments failed, by world.
        reused: number of worlds that were complete before this run.
        seconds: processor time of each experiment in a world, in the mean of this run.
    """

    out: Path
    worlds: int
    distributions: tuple[Distribution, ...]
    failures: dict[int, WorldOutcome]
    reused: int
    seconds: dict[str, float]


def run_campaign(
    settings: CampaignSettings,
    out: Path,
    report: Callable[[Progress], None] = lambda progress: None,
) -> CampaignResult:
    """Runs experiments in worlds and writes campaign.parquet, metrics.json and campaign.html.

    Everything below `out` changes as one, at the end and also after an interrupt. Until then each
    finished world is stored in a file of its own, which survives a kill.

    Args:
        settings: experiments, worlds and workers.
        out: folder of the campaign; made if absent.
        report: called with the progress when a world has come to its end.

    Raises:
        InputError: an unknown experiment, a folder that cannot be written or holds another
            campaign, no scheduler.
        KeyboardInterrupt: passed on after the results so far were written.
    """
    names = check_names(settings.experiments)
    cluster = settings.cluster
    _check_settings(settings)
    settings = replace(settings, data=given_folder(settings.data))  # absolute, for workers
    modules = {name: REGISTRY.entries()[name].module for name in names}
    software = {name: software_hash(module) for name, module in modules.items()}
    with signals_are_interrupts(), open_results(out, COMMAND) as folder:
        campaign = _Campaign(settings, folder, software)
        num_reused = campaign.count_complete(names)
        # Folder of what all worlds share, below one that goes with this run; another machine need
        # not see it.
        shared_folder = folder.work("everywhere").resolve() if cluster is None else None
        tasks = campaign.tasks(names, modules, shared_folder)
        if cluster is not None and tasks:  # a complete campaign needs no scheduler
            refuse_silent(cluster)
            jobs = 1  # how many workers the scheduler has is not known
            outcomes = on_cluster(tasks, cluster)
        else:
            jobs = settings.jobs or available_cores()
            outcomes = on_this_machine(tasks, jobs, folder.work(_LOG))
        try:
            with closing(outcomes):
                campaign.take(outcomes, len(tasks), jobs, report)
        except BaseException as error:
            state: State = "interrupted" if isinstance(error, KeyboardInterrupt) else "failed"
            report(Progress(COMMAND, state, action="finished worlds are kept"))
            # The user is to hear of the cause, not of an error that follows from it.
            with suppress(InputError, OSError):
                # With `fresh` the record begins empty: before its first world is done, writing
                # would replace the folder's earlier results by nothing.
                if campaign.record.worlds or not folder.files:
                    campaign.write()
            raise
        figures_over_worlds = campaign.write()
    return CampaignResult(
        out=out,
        worlds=len(campaign.record.worlds),
        distributions=figures_over_worlds,
        failures=campaign.failures,
        reused=num_reused,
        seconds=campaign.mean_seconds(),
    )


def _check_settings(settings: CampaignSettings) -> None:
    check_ranges(settings.source.ranges)
    if settings.world is None:
        return
    if settings.world >= settings.worlds:
        problem = f"is {settings.world}, expected 0 to {settings.worlds - 1}"
        raise InputError("--world", "", problem)
    if settings.cluster is not None:
        problem = "a single world runs on this machine only"
        raise InputError("--world", "", problem, "leave --cluster out")


class _Campaign:
    """A campaign that runs in its folder."""

    def __init__(
        self, settings: CampaignSettings, folder: ResultFolder, software: dict[str, str]
    ) -> None:
        self._settings, self._folder = settings, folder
        self.parts = WorldParts(folder.path)
        depends_on: dict[str, Any] = {
            "seed": settings.seed,
            "quick": settings.quick,
            "fastest_feed": settings.fastest_feed,
            "ranges": plain(asdict(settings.source.ranges)),
            "source": digest(settings.source),
            "libraries": libraries(),
        }
        self.record = CampaignRecord(depends_on)
        self.failures: dict[int, WorldOutcome] = {}
        self._seconds: dict[str, list[float]] = {}
        if settings.fresh:
            self.parts.clear()
        else:
            self._read(software)
        self.record.software |= software

    def _read(self, software: dict[str, str]) -> None:
        """Reads the worlds that the folder holds, if settings and software are the same."""
        stored = read_table(self._folder.path / TABLE_FILE)
        if stored is not None:
            self._check(stored.settings, stored.software, software)
            stored.settings = self.record.settings
            self.record = stored
        for part in self.parts.read():
            self._check(part.settings, part.software, software)
            self.record.software |= part.software
            self.record.add(part.outcome)

    def _check(
        self,
        stored_settings: dict[str, Any],
        stored_software: dict[str, str],
        software: dict[str, str],
    ) -> None:
        settings = self.record.settings
        differences = [key for key in settings if stored_settings.get(key) != settings[key]]
        differences += [
            f"software of {name}"
            for name in software
            if stored_software.get(name, software[name]) != software[name]
        ]
        if differences:
            problem = f"holds worlds of another {differences[0].replace('_', ' ')}"
            remedy = "choose another --out, or begin anew with --fresh"
            raise InputError(self._folder.path, "", problem, remedy)

    def count_complete(self, names: Sequence[str]) -> int:
        """Number of the requested worlds that have all figures."""
        worlds = range(self._settings.worlds)
        return sum(not self.record.missing(number, names) for number in worlds)

    def tasks(
        self, names: Sequence[str], modules: dict[str, str], everywhere: Path | None
    ) -> list[WorldTask]:
        """The tasks that remain; see `WorldTask.everywhere`."""
        single_world = self._settings.world
        numbers: Sequence[int] = (
            range(self._settings.worlds) if single_world is None else [single_world]
        )
        tasks = []
        for number in numbers:
            experiments = names if single_world is not None else self.record.missing(number, names)
            if experiments:
                task = WorldTask(
                    settings=self._settings,
                    number=number,
                    modules={name: modules[name] for name in experiments},
                    software={name: self.record.software[name] for name in experiments},
                    out=None if single_world is None else self._drawings(number),
                    everywhere=everywhere,
                )
                tasks.append(task)
        return tasks

    def _drawings(self, number: int) -> Path:
        return self._folder.work(_name_of(number)).resolve()

    def take(
        self,
        outcomes: Generator[WorldOutcome],
        total: int,
        jobs: int,
        report: Callable[[Progress], None],
    ) -> None:
        """Stores the outcomes as they come, and reports the progress.

        What a world measured goes into the record and, against a kill, into a file of its own. A
        world in which an experiment failed is kept in `failures`, beside what it measured. The
        seconds go into those of `mean_seconds`. Between two worlds a signal may end it.

        Args:
            outcomes: outcomes of the worlds, as they end.
            total: number of worlds that `outcomes` will give.
            jobs: number of worlds that run side by side.
            report: called with the progress.
        """
        started = time.monotonic()
        done = 0
        report(Progress(COMMAND, "running", 0.0, f"0 of {total} worlds"))
        for outcome in outcomes:
            with uninterrupted():  # a world counts with all that it brought
                if outcome.values:
                    # The file states settings and software of the record, on which a world depends.
                    self.parts.add(outcome, self.record)
                    self.record.add(outcome)
                if outcome.failures:
                    self.failures[outcome.number] = outcome
                for name, seconds in outcome.seconds.items():
                    self._seconds.setdefault(name, []).append(seconds)
            done += 1  # also where all experiments failed
            remaining = remaining_seconds(time.monotonic() - started, done, total, jobs)
            failed = f", {len(self.failures)} failed" if self.failures else ""
            action = f"{done} of {total} worlds{failed}, {_duration_text(remaining)} left"
            report(Progress(COMMAND, "running", done / total, action))
        report(Progress(COMMAND, "done", 1.0, f"{done} worlds", time.monotonic() - started))

    def mean_seconds(self) -> dict[str, float]:
        """Processor time in s by experiment, in the mean of this run's worlds."""
        return {name: sum(times) / len(times) for name, times in self._seconds.items()}

    def write(self) -> tuple[Distribution, ...]:
        """Writes all results as one and removes the files of single worlds."""
        record = self.record
        order = [name for name in REGISTRY.entries() if name in record.described]
        order += sorted(set(record.described) - set(order))
        spread = tuple(distributions(record, order))
        alone = self._settings.world
        world_files = [name for name in self._folder.files if name.startswith("world-")]
        unchanged = [
            name for name in world_files if alone is None or not name.startswith(_name_of(alone))
        ]
        changing = [name for name in self._folder.files if name not in unchanged]
        with uninterrupted():
            with self._folder.changing(changing) as folder:
                if record.worlds:
                    self._write_figures(folder, spread, order)
                for number, outcome in sorted(self.failures.items()):
                    text = self._failure(outcome)
                    folder.write_text(f"{FAILURES}/{_name_of(number)}.txt", text)
                if alone is not None and self._drawings(alone).exists():
                    with writing_to(folder.path):
                        self._drawings(alone).rename(folder / _name_of(alone))
            self.parts.clear()
        return spread

    def _write_figures(
        self, folder: OutputFolder, spread: Sequence[Distribution], order: Sequence[str]
    ) -> None:
        """Writes table, metrics, timings and report."""
        write_table(self.record, folder / TABLE_FILE, order)
        folder.write_text(METRICS, json_text(self._metrics(spread)))
        timings = self._timings()
        folder.write_text(TIMINGS, json_text(timings))
        seconds = {name: timing["seconds_a_world"] for name, timing in timings.items()}
        write_campaign_report(
            folder, self.record, spread, self.failures, seconds, software_version()
        )

    def _metrics(self, spread: Sequence[Distribution]) -> dict[str, Any]:
        record = self.record
        settings = {key: record.settings[key] for key in ("seed", "quick")}
        metrics = {
            COMMAND: settings | {"worlds": len(record.worlds)},
            **distribution_metrics(spread),
        }
        return dict(plain(metrics))

    def _timings(self) -> dict[str, Any]:
        """Mean processor time of a world by experiment, over all runs in this folder."""
        timings: dict[str, Any] = {}
        with suppress(OSError, ValueError):
            timings = json.loads((self._folder.path / TIMINGS).read_text(encoding="utf-8"))
        for name, times in self._seconds.items():
            earlier = timings.get(name, {"worlds": 0, "seconds_a_world": 0.0})
            worlds = earlier["worlds"] + len(times)
            seconds = earlier["worlds"] * earlier["seconds_a_world"] + sum(times)
            timings[name] = {"worlds": worlds, "seconds_a_world": round(seconds / worlds, 2)}
        return timings

    def _failure(self, outcome: WorldOutcome) -> str:
        world = draw_world(self._settings.seed, outcome.number, self._settings.source)
        lines = [f"world {outcome.number}, seed {outcome.seed}", "", repr(world), ""]
        for name, message in outcome.failures.items():
            lines += [f"== {name}: {message}", ""]
        log = self._folder.work(_LOG)
        with suppress(OSError):
            printed = log.read_text(encoding="utf-8", errors="replace").splitlines()
            lines += ["== last output of this machine's workers", *printed[-_LAST_LINES:]]
        return "\n".join(lines) + "\n"


def _name_of(number: int) -> str:
    return f"world-{number:05d}"


def remaining_seconds(elapsed: float, done: int, total: int, jobs: int) -> float:
    """Expected time in s that the worlds take which have not ended.

    Worlds take about the same time: of those that were begun together, the others are as good as
    ended once the first one has.

    Args:
        elapsed: s, for the worlds so far.
        done: number of worlds that have ended, at least 1.
        total: number of worlds.
        jobs: number of worlds that run side by side.
    """
    nearly_done = min(-(-done // jobs) * jobs, total)
    return elapsed / nearly_done * (total - nearly_done)


def _duration_text(seconds: float) -> str:
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"
