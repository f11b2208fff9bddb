"""Runs experiments in many worlds, keeps what is done and writes the spread of their figures.

A folder holds one campaign: one seed, one set of ranges, one length. What is done in it is never
run again; whatever ends a campaign, the same command goes on where it stopped.
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
    TABLE,
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
from wrenchsight.analyses.output.interruption import ends_are_interrupts, uninterrupted
from wrenchsight.analyses.output.outputs import json_text, plain
from wrenchsight.analyses.output.progress import Progress
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
    """What a campaign came to."""

    out: Path  # its folder
    worlds: int  # how many have figures, of this run or earlier
    found: tuple[Distribution, ...]  # the figures of the article over these
    failures: dict[int, WorldOutcome]  # by world, its outcome: what failed in this run
    kept: int  # how many worlds were whole before
    # of a processor for each experiment in a world, in the mean of this run
    seconds: dict[str, float]


def run_campaign(
    settings: CampaignSettings,
    out: Path,
    watch: Callable[[Progress], None] = lambda progress: None,
) -> CampaignResult:
    """Runs experiments in worlds and writes campaign.parquet, metrics.json and campaign.html.

    Everything below `out` changes as one, at the end and also after an interrupt; a world that has
    come to its end before is kept beside until then, also through a kill.

    Args:
        settings: what to run, and where; `fit` and `narrow` are `fit_figures`'s.
        out: folder of the campaign; made if absent.
        watch: called when a world has come to its end.

    Raises:
        InputError: an unknown experiment, a folder that cannot be written or holds another
            campaign, no scheduler.
        KeyboardInterrupt: passed on after the results so far were written.
    """
    names, cluster = check_names(settings.experiments), settings.cluster
    check_ranges(settings.source.ranges, settings.source.even)
    if settings.world is not None and settings.world >= settings.worlds:
        problem = f"is {settings.world}, one of 0 to {settings.worlds - 1} was expected"
        raise InputError("--world", "", problem)
    if settings.world is not None and cluster is not None:
        problem = "a world that is run alone is run on this machine"
        raise InputError("--world", "", problem, "leave --cluster out")
    settings = replace(settings, data=given_folder(settings.data))
    modules = {name: REGISTRY.entries()[name].module for name in names}
    software = {name: software_hash(module) for name, module in modules.items()}
    with ends_are_interrupts(), open_results(out, COMMAND) as folder:
        campaign = _Campaign(settings, folder, software)
        before = campaign.whole(names)
        # Another machine need not see this folder.
        everywhere = folder.work("everywhere").resolve() if cluster is None else None
        tasks = campaign.tasks(names, modules, everywhere)
        if cluster is not None and tasks:
            refuse_silent(cluster)
        outcomes = (
            on_cluster(tasks, cluster)
            if cluster is not None and tasks
            else on_this_machine(tasks, settings.jobs or available_cores(), folder.work(_LOG))
        )
        try:
            with closing(outcomes):
                campaign.take(outcomes, len(tasks), watch)
        except BaseException:
            watch(Progress(COMMAND, "interrupted", action="what is done is kept"))
            # Whatever ended it is what the user is to hear of, not what follows from it.
            with suppress(InputError, OSError):
                if campaign.record.worlds or not folder.files:  # else the earlier ones stay
                    campaign.write()
            raise
        found = campaign.write()
    return CampaignResult(
        out,
        len(campaign.record.worlds),
        found,
        campaign.failures,
        before,
        campaign.mean_seconds(),
    )


class _Campaign:
    """One campaign at work in its folder."""

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
        """Takes in what is there, if it goes together with what is asked."""
        before = read_table(self._folder.path / TABLE)
        if before is not None:
            self._check(before.settings, before.software, software)
            before.settings = self.record.settings
            self.record = before
        for settings, own, outcome in self.parts.read():
            self._check(settings, own, software)
            self.record.software |= own
            self.record.add(outcome)

    def _check(
        self, settings: dict[str, Any], own: dict[str, str], software: dict[str, str]
    ) -> None:
        now = self.record.settings
        other = [key for key in now if settings.get(key) != now[key]]
        other += [
            f"software of {name}"
            for name in software
            if own.get(name, software[name]) != software[name]
        ]
        if other:
            problem = f"holds worlds of another {other[0].replace('_', ' ')}"
            remedy = "choose another --out, or begin anew with --fresh"
            raise InputError(self._folder.path, "", problem, remedy)

    def whole(self, names: Sequence[str]) -> int:
        """How many of the worlds that are asked for have all figures."""
        worlds = range(self._settings.worlds)
        return sum(not self.record.missing(number, names) for number in worlds)

    def tasks(
        self, names: Sequence[str], modules: dict[str, str], everywhere: Path | None
    ) -> list[WorldTask]:
        """What is left to do; see `WorldTask.everywhere`."""
        alone = self._settings.world
        numbers: Sequence[int] = range(self._settings.worlds) if alone is None else [alone]
        numbers = numbers if self._settings.numbers is None else self._settings.numbers
        return [
            WorldTask(
                settings=self._settings,
                number=number,
                modules={name: modules[name] for name in own},
                software={name: self.record.software[name] for name in own},
                out=None if alone is None else self._drawings(number),
                everywhere=everywhere,
            )
            for number in numbers
            if (own := names if alone is not None else self.record.missing(number, names))
        ]

    def _drawings(self, number: int) -> Path:
        return self._folder.work(_name_of(number)).resolve()

    def take(
        self, outcomes: Generator[WorldOutcome], total: int, watch: Callable[[Progress], None]
    ) -> None:
        """Keeps the outcomes as they come, and says how far it is."""
        started, done = time.monotonic(), 0
        watch(Progress(COMMAND, "running", 0.0, f"0 of {total} worlds"))
        for outcome in outcomes:
            with uninterrupted():
                if outcome.values:
                    self.parts.add(outcome, self.record)
                    self.record.add(outcome)
                if outcome.failures:
                    self.failures[outcome.number] = outcome
                for name, seconds in outcome.seconds.items():
                    self._seconds.setdefault(name, []).append(seconds)
            done += 1
            left = (time.monotonic() - started) / done * (total - done)
            failed = f", {len(self.failures)} failed" if self.failures else ""
            what = f"{done} of {total} worlds{failed}, {_spoken(left)} left"
            watch(Progress(COMMAND, "running", done / total, what))
        watch(Progress(COMMAND, "done", 1.0, f"{done} worlds", time.monotonic() - started))

    def mean_seconds(self) -> dict[str, float]:
        """Of a processor, by experiment, in the mean of this run's worlds."""
        return {name: sum(own) / len(own) for name, own in self._seconds.items()}

    def write(self) -> tuple[Distribution, ...]:
        """Writes all results as one and removes what was kept beside."""
        record, known = self.record, list(REGISTRY.entries())
        order = [name for name in known if name in record.described]
        order += sorted(set(record.described) - set(order))
        found = tuple(distributions(record, order))
        alone = self._settings.world
        drawn = [name for name in self._folder.files if name.startswith("world-")]
        kept = [n for n in drawn if alone is None or not n.startswith(_name_of(alone))]
        with uninterrupted():
            with self._folder.changing([n for n in self._folder.files if n not in kept]) as folder:
                if record.worlds:
                    write_table(record, folder / TABLE, order)
                    folder.write_text(METRICS, json_text(self._metrics(found)))
                    timings = self._timings()
                    folder.write_text(TIMINGS, json_text(timings))
                    seconds = {name: own["seconds_a_world"] for name, own in timings.items()}
                    write_campaign_report(
                        folder, record, found, self.failures, seconds, software_version()
                    )
                for number, outcome in sorted(self.failures.items()):
                    text = self._failure(outcome)
                    folder.write_text(f"{FAILURES}/{_name_of(number)}.txt", text)
                if alone is not None and self._drawings(alone).exists():
                    with writing_to(folder.path):
                        self._drawings(alone).rename(folder / _name_of(alone))
            self.parts.clear()
        return found

    def _metrics(self, found: Sequence[Distribution]) -> dict[str, Any]:
        record = self.record
        settings = {key: record.settings[key] for key in ("seed", "quick")}
        metrics = {
            COMMAND: settings | {"worlds": len(record.worlds)},
            **distribution_metrics(found),
        }
        return dict(plain(metrics))

    def _timings(self) -> dict[str, Any]:
        """Of a processor, by experiment, in a world: of all that were ever measured here."""
        before: dict[str, Any] = {}
        with suppress(OSError, ValueError):
            before = json.loads((self._folder.path / TIMINGS).read_text(encoding="utf-8"))
        for name, own in self._seconds.items():
            total = before.get(name, {"worlds": 0, "seconds_a_world": 0.0})
            worlds = total["worlds"] + len(own)
            seconds = total["worlds"] * total["seconds_a_world"] + sum(own)
            before[name] = {"worlds": worlds, "seconds_a_world": round(seconds / worlds, 2)}
        return before

    def _failure(self, outcome: WorldOutcome) -> str:
        world = draw_world(self._settings.seed, outcome.number, self._settings.source)
        lines = [f"world {outcome.number}, seed {outcome.seed}", "", repr(world), ""]
        for name, what in outcome.failures.items():
            lines += [f"== {name}: {what}", ""]
        log = self._folder.work(_LOG)
        with suppress(OSError):
            printed = log.read_text(encoding="utf-8", errors="replace").splitlines()
            lines += ["== what the workers of this machine printed last", *printed[-_LAST_LINES:]]
        return "\n".join(lines) + "\n"


def _name_of(number: int) -> str:
    return f"world-{number:05d}"


def _spoken(seconds: float) -> str:
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"
