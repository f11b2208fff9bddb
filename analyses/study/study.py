"""Runs experiments, keeps their whole results and reports on them.

Each experiment runs in a process of its own, also when it runs alone: one that crashes takes no
other with it, nothing that it leaves in memory can change the next one's figures, and its linear
algebra runs in one thread whatever `jobs` is, so that the same seed gives the same bytes.
"""

import errno
import json
import os
import resource
import sys
import time
import traceback
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from difflib import get_close_matches
from importlib import import_module
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as distribution_version
from pathlib import Path
from typing import Any, Final

from wrenchsight.analyses.data_sets.advice import how_to_get_all
from wrenchsight.analyses.output.compilation import on_first_compilation
from wrenchsight.analyses.output.interruption import begin_worker, signals_are_interrupts
from wrenchsight.analyses.output.outputs import json_text
from wrenchsight.analyses.output.progress import Progress, State
from wrenchsight.analyses.output.result_folder import ResultFolder, open_results
from wrenchsight.analyses.output.side_by_side import Died, run_side_by_side
from wrenchsight.analyses.study.experiment import Experiment, ExperimentContext
from wrenchsight.analyses.study.fingerprint import software_hash
from wrenchsight.analyses.study.outcome import Outcome, StudyResult, StudySettings
from wrenchsight.analyses.study.own_methods import named_methods
from wrenchsight.analyses.study.registry import REGISTRY
from wrenchsight.analyses.study.report import write_report
from wrenchsight.analyses.study.shared_results import sharing_in
from wrenchsight.analyses.study.stored_result import read_result, write_result
from wrenchsight.models.files.input_error import InputError, install_of
from wrenchsight.models.files.whole_file import whole_file, writing_to
from wrenchsight.models.robot.truth_config import TRUTHS

COMMAND: Final = "study"
_TIMINGS: Final = "timings.json"
_SHARED_FOLDER: Final = ".shared"  # folder of results that experiments share
_SHORT_RUN: Final = 10.0  # s of processor time, up to which an experiment begins before long ones
_PROGRESS_PERIOD: Final = 0.1  # s at least between two writes of an experiment's progress


def run_study(
    names: Sequence[str],
    out: Path,
    data: Path | None = None,
    *,
    seed: int = 0,
    quick: bool = False,
    truth: str = "own",
    jobs: int = 1,
    fresh: bool = False,
    methods: Sequence[str] = (),
    watch: Callable[[Progress], None] = lambda progress: None,
) -> StudyResult:
    """Runs experiments, `jobs` at a time, and writes what they measured below `out`.

    `out/<name>/` receives metrics.json, config.yaml, result.json (what the report shows), figures
    and recordings, at once and only when the experiment has come to its end. An experiment whose
    whole result is there already, with the fingerprint that it would get now (see
    `StudySettings.fingerprint`), is not run again.

    At the end, and also after an interrupt, `out/metrics.json` gets one object per experiment,
    `out/timings.json` the seconds, `out/report.html` the report. They cover all results in `out`,
    requested or not, whose fingerprints belong together, and no others. After a kill that nothing
    can catch they are as before the study; the next study finds the whole results.

    An experiment that fails leaves out/failures/<name>.txt and does not stop the others.

    Args:
        names: experiments to run; empty means all of `wrenchsight.analyses.study.registry`.
        out: folder of the study; made if absent.
        data: folder of the real recordings that is given; see
            `wrenchsight.analyses.data_sets.places`. Experiments that need a set that is nowhere
            are skipped.
        seed: seed of every random number.
        quick: whether experiments run shorter and coarser.
        truth: truth of simulated arms, one of `wrenchsight.models.robot.truth_config.TRUTHS`.
        jobs: processes side by side, at least 1.
        fresh: whether to run also what has a whole result.
        methods: estimators of others, see `wrenchsight.analyses.study.own_methods`.
        watch: called in this process at every step of every experiment.

    Raises:
        InputError: an unknown name, truth or method, a method that no requested experiment takes, a
            full disk, a folder that cannot be written, that another study is at work in, or that
            holds what no study wrote.
        KeyboardInterrupt: passed on after the results so far were written; a `TerminatedError`
            for SIGTERM and SIGHUP.
    """
    requested = tuple(check_names(names))
    takes_methods = any(REGISTRY.entries()[name].takes_methods for name in requested)
    if methods and not takes_methods:
        takers = [name for name, entry in REGISTRY.entries().items() if entry.takes_methods]
        problem = f"none of {', '.join(requested)} takes a --method"
        raise InputError("--method", "", problem, f"add {' or '.join(takers)}")
    settings = StudySettings(
        requested=requested,
        all_experiments=tuple(REGISTRY.entries()),
        data=data,
        seed=seed,
        quick=quick,
        truth=truth,
        version=software_version(),
        methods=named_methods(methods, takes_methods),
    )
    if jobs < 1:
        raise InputError("--jobs", "", f"is {jobs}, expected 1 or more")
    if truth not in TRUTHS:
        raise InputError("--truth", "", f"is {truth!r}, expected {', '.join(TRUTHS)}")
    with signals_are_interrupts(), open_results(out, COMMAND) as folder:
        due = _due(folder, settings, fresh, watch)
        runs = _Runs(folder, settings, due, watch)
        try:
            with writing_to(out):
                folder.work(_SHARED_FOLDER).mkdir()  # gone at the end, with all of the staging
            runs.run(jobs)
        except BaseException:
            # The user should see the cause, not an error that follows from it.
            with suppress(InputError, OSError):
                _summarise(folder, runs.outcomes, settings)
            raise
        return _summarise(folder, runs.outcomes, settings)


def _due(
    folder: ResultFolder,
    settings: StudySettings,
    fresh: bool,
    watch: Callable[[Progress], None],
) -> list[str]:
    """The experiments whose earlier result is missing or does not count.

    Args:
        fresh: whether no earlier result counts.
    """
    due = []
    for name in settings.requested:
        earlier, why = (None, "") if fresh else _earlier(folder, name, settings)
        if earlier is not None:
            watch(Progress(name, "earlier", 1.0, "nothing has changed since its run"))
            continue
        due.append(name)
        if why:
            watch(Progress(name, "waiting", action=why))
    return due


def check_names(names: Iterable[str]) -> list[str]:
    """Returns the experiments meant by `names`, without repetitions; all if there are none.

    Raises:
        InputError: a name is unknown; the line lists the known ones.
    """
    experiments = REGISTRY.entries()
    requested = list(dict.fromkeys(names)) or list(experiments)
    for name in requested:
        if name not in experiments:
            near = get_close_matches(name, experiments, n=len(experiments), cutoff=0.0)
            hint = f"did you mean {near[0]}? " if get_close_matches(name, near, n=1) else ""
            remedy = f"{hint}known are {', '.join(near)}"
            raise InputError("study", "", f"no experiment is named {name!r}", remedy)
    return requested


@dataclass(frozen=True)
class _Task:
    """What an experiment's process is given."""

    name: str
    module: str
    work: Path  # folder for what it writes: `result`, log.txt, progress.txt
    shared: Path  # folder of what experiments share
    settings: StudySettings

    @property
    def result(self) -> Path:
        return self.work / "result"

    @property
    def log(self) -> Path:
        return self.work / "log.txt"

    @property
    def progress(self) -> Path:
        return self.work / "progress.txt"


@dataclass(frozen=True)
class _End:
    """How an experiment ended, as its process says it."""

    state: State
    reason: str = ""  # one line
    lacks: tuple[str, ...] = ()  # sets of recordings that it needs
    lacks_storage: bool = False
    processor_seconds: float = 0.0


class _Runs:
    """The experiments of a study that run: their outcomes, as they come.

    Each is "waiting" at first, "running" from `_begin` on, and then as `_finish` is told: "done",
    "failed" or "skipped". What an exception leaves waiting or running, `run` sets to "interrupted".
    Every change goes to `watch`.
    """

    def __init__(
        self,
        folder: ResultFolder,
        settings: StudySettings,
        names: Iterable[str],
        watch: Callable[[Progress], None],
    ) -> None:
        self.outcomes = {name: Outcome(name, "waiting") for name in names}
        self._folder, self._settings, self._watch = folder, settings, watch
        self._started: dict[str, float] = {}
        self._under_way: dict[str, _Task] = {}
        self._reported: dict[str, str] = {}  # text of each one's progress

    def run(self, jobs: int) -> None:
        """Runs them, `jobs` at a time, in the order of `_in_order`.

        Raises:
            InputError: the disk is full.
        """
        # Of numba, whose loops write each element once: their number changes no figure.
        threads = max(1, available_cores() // jobs)
        ends = run_side_by_side(
            _run_task,
            map(self._task, _in_order(self.outcomes, self._folder.path)),
            jobs,
            each_in_its_own=True,
            environment={"NUMBA_NUM_THREADS": str(threads)},
            started=self._begin,
            tick=self._report_progress,
        )
        try:
            with closing(ends):
                for task, end in ends:
                    self._report_progress()
                    del self._under_way[task.name]
                    self._finish(task, _End("failed", str(end)) if isinstance(end, Died) else end)
        finally:
            for name, outcome in self.outcomes.items():
                if outcome.state in ("waiting", "running"):
                    outcome.state = "interrupted"
                    self._watch(Progress(name, "interrupted"))

    def _task(self, name: str) -> _Task:
        module = REGISTRY.entries()[name].module
        work = self._folder.work(f"{name}/result").parent
        return _Task(name, module, work, self._folder.work(_SHARED_FOLDER), self._settings)

    def _begin(self, task: _Task) -> None:
        self.outcomes[task.name].state = "running"
        self._started[task.name] = time.monotonic()
        self._under_way[task.name] = task
        self._watch(Progress(task.name, "running"))

    def _report_progress(self) -> None:
        """Passes on what the experiments under way have written of their progress since."""
        for name, task in self._under_way.items():
            with suppress(OSError):
                text = task.progress.read_text(encoding="utf-8")
                if self._reported.get(name) != text:
                    self._reported[name] = text
                    fraction, _, action = text.partition(" ")
                    self._watch(Progress(name, "running", float(fraction), action))

    def _finish(self, task: _Task, end: _End) -> None:
        """Puts the results of a task in their place, and reports how it ended.

        Results replace the experiment's earlier ones, whole; a failure leaves these, and writes
        what the experiment printed into failures/NAME.txt.

        Raises:
            InputError: the disk is full.
        """
        name, folder, outcome = task.name, self._folder, self.outcomes[task.name]
        if end.lacks_storage:
            remedy = "free some space and run again: what is finished is kept"
            raise InputError(folder.path, "", f"{end.reason}, while {name} ran", remedy)
        outcome.seconds = time.monotonic() - self._started[name]
        outcome.processor_seconds = end.processor_seconds
        outcome.lacks = end.lacks  # what a skipped run needs; of any other run none
        failure = f"failures/{name}.txt"
        if end.state == "done":
            earlier = [file for file in folder.files if file.startswith(f"{name}/")]
            outcome.metrics, outcome.stored = self._store(task, outdated=[*earlier, failure])
            # The run is done, without these recordings, which it can do without.
            outcome.lacks = _absent_recordings(outcome.stored)
        elif end.state == "failed":  # else "skipped": nothing was written
            printed = ""
            with suppress(OSError):
                printed = task.log.read_text(encoding="utf-8", errors="replace")
            with folder.changing() as new:
                new.write_text(failure, printed or f"{end.reason}\n")
        outcome.state, outcome.reason = end.state, end.reason
        seconds = outcome.seconds if end.state == "done" else None
        self._watch(Progress(name, end.state, 1.0, end.reason, seconds))

    def _store(
        self, task: _Task, outdated: Collection[str]
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Puts a task's results in their place; returns its metrics and its result.json.

        Args:
            outdated: files of earlier results and failures, which go where they are not replaced.

        Raises:
            InputError: the disk is full; the folder is as it was.
        """
        folder = self._folder
        with folder.changing(outdated) as new, writing_to(folder.path):
            task.result.rename(new / task.name)
        result = read_result(folder, task.name)
        assert result is not None  # it was stored just now
        return result


def _in_order(names: Iterable[str], out: Path) -> list[str]:
    """Experiments in the order in which they begin.

    Short ones come first, so that a result soon shows; then those that take longest, so that none
    of these is left alone at the end. Processor seconds are those measured in `out` before, else
    typical ones.
    """
    seconds = {name: entry.seconds for name, entry in REGISTRY.entries().items()}
    for name, timing in _read_timings(out).items():
        seconds[name] = timing.get("processor_seconds", seconds.get(name, 0.0))
    ascending = sorted(names, key=lambda name: seconds[name])
    short = [name for name in ascending if seconds[name] <= _SHORT_RUN]
    return short + [name for name in reversed(ascending) if name not in short]


def _run_task(task: _Task) -> _End:
    """Runs in the experiment's process; what it prints goes to the task's log."""
    import faulthandler

    try:
        task.result.mkdir(parents=True)
        begin_worker(os.getppid(), task.log)
        faulthandler.enable()
        end = _run_experiment(task)
    except BaseException as error:  # the study gets any error
        lines = str(error).strip().splitlines()
        reason = lines[0] if lines else ""
        if not isinstance(error, InputError):
            reason = f"{type(error).__name__}: {reason}".rstrip(": ")
        storage_problem = _lack_of_storage(error)
        end = _End("failed", storage_problem or reason, lacks_storage=bool(storage_problem))
        with suppress(OSError):
            traceback.print_exc()
    with suppress(OSError):
        sys.stderr.flush()
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return replace(end, processor_seconds=usage.ru_utime + usage.ru_stime)


def _lack_of_storage(error: BaseException | None) -> str:
    """The system's message where an error, or its cause, is a full disk; else empty."""
    while error is not None:
        if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EROFS):
            return os.strerror(error.errno)
        error = error.__cause__ or error.__context__
    return ""


def _run_experiment(task: _Task) -> _End:
    """Runs an experiment in this process and writes its result, or says why it is skipped.

    The result goes into `task.result`, which the study moves to its place; the progress into
    `task.progress`, "SHARE ACTION", which the study reads meanwhile.

    Raises:
        Exception: whatever the experiment raises.
    """
    module, settings = task.module, task.settings
    experiment: Experiment = import_module(module).EXPERIMENT
    if experiment.name != task.name:
        raise ValueError(f"{module}: its experiment is {experiment.name}, not {task.name}")
    missing = experiment.missing(settings.data)
    if missing:
        reason = f"needs the recordings {', '.join(missing)}; {how_to_get_all(missing)}"
        return _End("skipped", reason, tuple(missing))
    missing_modules = experiment.missing_modules()
    if missing_modules:
        return _End("skipped", f"needs {', '.join(missing_modules)}; {install_of('study')}")

    def write_progress(fraction: float, action: str) -> None:
        with suppress(OSError, InputError), whole_file(task.progress) as partial:
            partial.write_text(f"{fraction:.6g} {action}", encoding="utf-8")

    if "numba" in sys.modules:  # else the experiment has no kernel to compile
        on_first_compilation(lambda action: write_progress(0.0, action))
    next_write = 0.0  # s of the monotonic clock

    def progress(fraction: float, action: str) -> None:
        nonlocal next_write
        if time.monotonic() >= next_write:
            next_write = time.monotonic() + _PROGRESS_PERIOD
            write_progress(float(fraction), str(action))

    context = ExperimentContext(
        out=task.result,
        data=settings.data,
        seed=settings.seed,
        quick=settings.quick,
        progress=progress,
        truth=settings.truth,
        methods=settings.methods if experiment.takes_methods else (),
    )
    folders = (*experiment.needs, *experiment.uses)
    fingerprint = settings.fingerprint(module, folders, experiment.takes_methods)
    with sharing_in(task.shared):
        result = experiment.run(context)
    if software_hash(module) != fingerprint["software"]:
        fingerprint["software"] = "changed while it ran"  # which part was imported when: not known
    write_result(task.result, experiment, result, fingerprint, settings.of_results)
    return _End("done")


def _earlier(
    folder: ResultFolder, name: str, settings: StudySettings
) -> tuple[Outcome | None, str]:
    """Returns the whole result that is there already, if running again would give the same.

    Else None and, where there is a result, in a few words why it does not count.
    """
    result = read_result(folder, name)
    if result is None:
        return None, ""
    metrics, stored = result
    recorded = stored["fingerprint"]
    # Which recordings these are follows from the software.
    entry = REGISTRY.entries()[name]
    now = settings.fingerprint(entry.module, recorded["recordings"], entry.takes_methods)
    changed = [key for key in now if recorded.get(key) != now[key]]
    if changed:
        return None, f"changed since its earlier result: {', '.join(changed)}; it runs again"
    lacks = _absent_recordings(stored)
    return Outcome(name, "earlier", lacks=lacks, metrics=metrics, stored=stored), ""


def _absent_recordings(stored: Mapping[str, Any]) -> tuple[str, ...]:
    """The sets of recordings that were missing when an experiment ran."""
    recordings = stored["fingerprint"]["recordings"]
    return tuple(name for name, content in recordings.items() if content is None)


def _summarise(
    folder: ResultFolder, runs: Mapping[str, Outcome], settings: StudySettings
) -> StudyResult:
    """Writes metrics, timings and report of all results in the folder that belong together.

    Args:
        runs: outcomes of what ran now, by experiment. The others, and those that were interrupted,
            count by their earlier result, if it is still that of these settings; its seconds are
            those of timings.json, which it is given here.
    """
    outcomes = []
    for name in REGISTRY.entries():
        outcome = runs.get(name)
        if outcome is None or outcome.state == "interrupted":
            earlier, _ = _earlier(folder, name, settings)
            outcome = earlier or outcome  # without an earlier result it stays as it ended
        if outcome is not None:
            outcomes.append(outcome)
    metrics = {outcome.name: outcome.metrics for outcome in outcomes if outcome.has_result}
    timings = _read_timings(folder.path)
    for outcome in outcomes:
        if outcome.state == "done" and outcome.seconds is not None:
            timings[outcome.name] = {
                "seconds": round(outcome.seconds, 1),
                "processor_seconds": round(outcome.processor_seconds or 0.0, 1),
            }
        elif outcome.state == "earlier":  # for the report
            outcome.seconds = timings.get(outcome.name, {}).get("seconds")
    with folder.changing() as new:
        new.write_text("metrics.json", json_text(metrics))
        with_result = {name: timings[name] for name in metrics if name in timings}
        new.write_text(_TIMINGS, json_text(with_result))
        report = write_report(new, outcomes, settings, folder.path)
    # The report was written into `new`, whose files were put in their places when the block ended.
    return StudyResult(folder.path, tuple(outcomes), metrics, folder.path / report.name)


def _read_timings(out: Path) -> dict[str, dict[str, float]]:
    path = out / _TIMINGS
    return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}


def available_cores() -> int:
    """Returns how many cores this process may use."""
    return len(os.sched_getaffinity(0))  # what a container or taskset allows


def software_version() -> str:
    """Returns the version of the installed distribution, or "source" where there is none."""
    try:
        return distribution_version("wrenchsight")
    except PackageNotFoundError:
        return "source"
