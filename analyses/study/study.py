"""Runs experiments, keeps their whole results and reports on them.

Each experiment runs in a process of its own, also when it runs alone: one that crashes takes no
other with it, nothing that it leaves in memory can change the next one's figures, and its linear
algebra runs in one thread whatever `jobs` is, so that the same seed gives the same bytes.
"""

import errno
import json
import multiprocessing
import os
import resource
import sys
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from difflib import get_close_matches
from functools import partial
from importlib import import_module
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as distribution_version
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any, Final

from wrenchsight.analyses.data_sets.advice import how_to_get_all
from wrenchsight.analyses.output.compilation import on_first_compilation
from wrenchsight.analyses.output.interruption import (
    begin_worker,
    ends_are_interrupts,
    for_this_process_alone,
)
from wrenchsight.analyses.output.outputs import json_text
from wrenchsight.analyses.output.progress import Progress, State
from wrenchsight.analyses.output.result_folder import ResultFolder, open_results
from wrenchsight.analyses.study.experiment import Experiment, ExperimentContext
from wrenchsight.analyses.study.fingerprint import software_hash
from wrenchsight.analyses.study.outcome import Outcome, StudyResult, StudySettings
from wrenchsight.analyses.study.own_methods import named_methods
from wrenchsight.analyses.study.registry import REGISTRY
from wrenchsight.analyses.study.report import write_report
from wrenchsight.analyses.study.shared_results import sharing_in
from wrenchsight.analyses.study.stored_result import read_result, write_result
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.whole_file import writing_to
from wrenchsight.models.robot.truth_config import TRUTHS

COMMAND: Final = "study"
_TIMINGS: Final = "timings.json"
_NO_STORAGE: Final = "no storage"  # a process ended for lack of it
ONE_THREAD: Final = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Environment of every process that measures: 1, or the last bits hang on the machine's cores."""


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
        seed: of every random number.
        quick: whether experiments run shorter and coarser.
        truth: of simulated arms, one of `wrenchsight.models.robot.truth_config.TRUTHS`.
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
    with ends_are_interrupts(), open_results(out, COMMAND) as folder:
        runs = _due_runs(folder, settings, fresh, watch)
        try:
            with writing_to(out):
                _shared(folder).mkdir()
            _run_all(_shortest_first(runs.values(), out), jobs, watch)
        except BaseException:
            # The user should see the cause, not an error that follows from it.
            with suppress(InputError, OSError):
                _summarise(folder, runs, settings)
            raise
        return _summarise(folder, runs, settings)


def _due_runs(
    folder: ResultFolder,
    settings: StudySettings,
    fresh: bool,
    watch: Callable[[Progress], None],
) -> "dict[str, _Run]":
    """The runs of the experiments, by name, whose earlier result is missing or does not count.

    Args:
        fresh: whether no earlier result counts.
    """
    runs = {}
    for name in settings.requested:
        earlier, why = (None, "") if fresh else _earlier(folder, name, settings)
        if earlier is not None:
            watch(Progress(name, "earlier", 1.0, "nothing has changed since its run"))
            continue
        runs[name] = _Run(name, folder, settings)
        if why:
            watch(Progress(name, "waiting", action=why))
    return runs


def _shortest_first(runs: "Iterable[_Run]", out: Path) -> "list[_Run]":
    """The runs by their processor seconds: those measured in `out` before, else typical ones."""
    seconds = {name: entry.seconds for name, entry in REGISTRY.entries().items()}
    for name, timing in _read_timings(out).items():
        seconds[name] = timing.get("processor_seconds", seconds.get(name, 0.0))
    return sorted(runs, key=lambda run: seconds[run.outcome.name])


def _shared(folder: ResultFolder) -> Path:
    """The folder of results that experiments share."""
    return folder.work(".shared")


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


class _Run:
    """One experiment's process, its staging folder and its outcome."""

    def __init__(self, name: str, folder: ResultFolder, settings: StudySettings) -> None:
        self.outcome = Outcome(name, "waiting")
        self._folder, self._settings = folder, settings
        self._staging = folder.work(f"{name}/result")
        self._log = folder.work(f"{name}/log.txt")
        self._failure = f"failures/{name}.txt"
        self._process: Any = None
        self._started = 0.0
        self.connection: Connection | None = None

    def start(self, threads: int) -> None:
        with writing_to(self._staging):
            self._staging.mkdir()
        name = self.outcome.name
        spawn = multiprocessing.get_context("spawn")  # a forked numba or Drake may hang
        self.connection, workers_end = spawn.Pipe()
        module = REGISTRY.entries()[name].module
        run = partial(
            _run_experiment, name, module, self._staging, _shared(self._folder), self._settings
        )
        arguments = (run, workers_end, self._log, os.getpid())
        with _thread_limits(threads), for_this_process_alone():
            self._process = spawn.Process(target=_work, args=arguments, name=name)
            self._process.start()
        workers_end.close()
        self._started = time.monotonic()
        self.outcome.state = "running"

    def receive(self) -> Progress:
        """Takes one message of the process; an end of its messages is the end of the run."""
        assert self.connection is not None
        outcome = self.outcome
        try:
            kind, *content = self.connection.recv()
        except (EOFError, OSError):
            return self._finish("failed", self._how_it_died())
        if kind == "loaded":
            return Progress(outcome.name, "running")
        if kind == "progress":
            return Progress(outcome.name, "running", *content)
        if kind == "lacks":
            (outcome.lacks,) = content
            return Progress(outcome.name, "running")
        reason, outcome.processor_seconds = content
        if kind == _NO_STORAGE:
            remedy = "free some space and run again: what is finished is kept"
            raise InputError(self._folder.path, "", f"{reason}, while {outcome.name} ran", remedy)
        return self._finish(kind, reason)

    def _finish(self, state: State, reason: str) -> Progress:
        self._process.join()
        outcome, folder = self.outcome, self._folder
        outcome.seconds = time.monotonic() - self._started
        if state == "done":
            earlier = [file for file in folder.files if file.startswith(f"{outcome.name}/")]
            with folder.changing([*earlier, self._failure]) as new, writing_to(folder.path):
                self._staging.rename(new / outcome.name)
            result = read_result(folder, outcome.name)
            assert result is not None
            outcome.metrics, outcome.stored = result
            outcome.lacks = _absent_recordings(outcome.stored)
        elif state == "failed":
            printed = ""
            with suppress(OSError):
                printed = self._log.read_text(encoding="utf-8", errors="replace")
            with folder.changing() as new:
                new.write_text(self._failure, printed or f"{reason}\n")
        outcome.state, outcome.reason = state, reason
        seconds = outcome.seconds if state == "done" else None
        return Progress(outcome.name, state, 1.0, reason, seconds)

    def _how_it_died(self) -> str:
        self._process.join()
        code = self._process.exitcode
        return f"its process was ended by signal {-code}" if code < 0 else f"exit code {code}"

    def stop(self) -> None:
        """Ends the process, if it runs."""
        if self._process is not None:
            self._process.kill()  # the study cleans up after it
            self._process.join()
        self.outcome.state = "interrupted"


def _run_all(runs: list[_Run], jobs: int, watch: Callable[[Progress], None]) -> None:
    """Runs them, `jobs` at a time.

    One process takes the shortest first, so that a result soon shows; the others take the longest
    first, so that none is left alone with a long one at the end.

    Args:
        runs: the shortest first.
    """
    threads = max(1, available_cores() // jobs)
    waiting, running = list(runs), dict[Connection, _Run]()
    short: _Run | None = None
    try:
        while waiting or running:
            while waiting and len(running) < jobs:
                if short in running.values():
                    run = waiting.pop()
                else:
                    run = short = waiting.pop(0)
                run.start(threads)
                assert run.connection is not None
                running[run.connection] = run
                watch(Progress(run.outcome.name, "running"))
            for connection in wait(list(running)):
                assert isinstance(connection, Connection)
                run = running[connection]
                progress = run.receive()
                if progress.state != "running":
                    del running[connection]
                watch(progress)
    finally:
        for run in runs:
            if run.outcome.state in ("waiting", "running"):
                run.stop()
                watch(Progress(run.outcome.name, "interrupted"))


def _work(
    run: Callable[[Connection], tuple[State, str]], connection: Connection, log: Path, parent: int
) -> None:
    """Runs in the experiment's process: its output goes to `log`, its steps to `connection`."""
    import faulthandler

    begin_worker(parent, log)
    faulthandler.enable()
    state = "failed"
    try:
        state, reason = run(connection)
    except BaseException as error:  # the parent gets any error
        lines = str(error).strip().splitlines()
        reason = lines[0] if lines else ""
        if not isinstance(error, InputError):
            reason = f"{type(error).__name__}: {reason}".rstrip(": ")
        storage_problem = _lack_of_storage(error)
        if storage_problem:
            state, reason = _NO_STORAGE, storage_problem
        with suppress(OSError):
            traceback.print_exc()
    with suppress(OSError):
        sys.stderr.flush()
    usage = resource.getrusage(resource.RUSAGE_SELF)
    connection.send((state, reason, usage.ru_utime + usage.ru_stime))


def _lack_of_storage(error: BaseException | None) -> str:
    """The system's message where an error, or its cause, is a full disk; else empty."""
    while error is not None:
        if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EROFS):
            return os.strerror(error.errno)
        error = error.__cause__ or error.__context__
    return ""


def _run_experiment(
    name: str, module: str, out: Path, shared: Path, settings: StudySettings, connection: Connection
) -> tuple[State, str]:
    experiment: Experiment = import_module(module).EXPERIMENT
    if experiment.name != name:
        raise ValueError(f"{module}: its experiment is {experiment.name}, not {name}")
    connection.send(("loaded",))
    missing = experiment.missing(settings.data)
    if missing:
        connection.send(("lacks", tuple(missing)))
        return "skipped", f"needs the recordings {', '.join(missing)}; {how_to_get_all(missing)}"
    lacking = experiment.missing_modules()
    if lacking:
        return "skipped", f"needs {', '.join(lacking)}; python -m pip install 'wrenchsight[study]'"
    if "numba" in sys.modules:
        on_first_compilation(lambda action: connection.send(("progress", 0.0, action)))
    due = 0.0

    def progress(fraction: float, action: str) -> None:
        nonlocal due
        if time.monotonic() >= due:
            due = time.monotonic() + 0.1
            connection.send(("progress", float(fraction), str(action)))

    context = ExperimentContext(
        out=out,
        data=settings.data,
        seed=settings.seed,
        quick=settings.quick,
        progress=progress,
        truth=settings.truth,
        methods=settings.methods if experiment.takes_methods else (),
    )
    folders = (*experiment.needs, *experiment.uses)
    depends_on = settings.fingerprint(module, folders, experiment.takes_methods)
    with sharing_in(shared):
        result = experiment.run(context)
    if software_hash(module) != depends_on["software"]:
        depends_on["software"] = "changed while it ran"  # which part was imported when is not known
    write_result(out, experiment, result, depends_on, settings.of_results)
    return "done", ""


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
    folder: ResultFolder, runs: Mapping[str, _Run], settings: StudySettings
) -> StudyResult:
    """Writes metrics, timings and report of all results in the folder that belong together."""
    outcomes = []
    for name in REGISTRY.entries():
        outcome = runs[name].outcome if name in runs else None
        if outcome is None or outcome.state == "interrupted":
            outcome = _earlier(folder, name, settings)[0] or outcome
        outcomes += [outcome] if outcome else []
    metrics = {outcome.name: outcome.metrics for outcome in outcomes if outcome.has_result}
    timings = _read_timings(folder.path)
    for outcome in outcomes:
        if outcome.state == "done" and outcome.seconds is not None:
            timings[outcome.name] = {
                "seconds": round(outcome.seconds, 1),
                "processor_seconds": round(outcome.processor_seconds or 0.0, 1),
            }
        elif outcome.state == "earlier":
            outcome.seconds = timings.get(outcome.name, {}).get("seconds")
    with folder.changing() as new:
        new.write_text("metrics.json", json_text(metrics))
        with_result = {name: timings[name] for name in metrics if name in timings}
        new.write_text(_TIMINGS, json_text(with_result))
        report = write_report(new, outcomes, settings, folder.path)
    return StudyResult(folder.path, tuple(outcomes), metrics, folder.path / report.name)


def _read_timings(out: Path) -> dict[str, dict[str, float]]:
    path = out / _TIMINGS
    return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}


@contextmanager
def _thread_limits(threads: int) -> Iterator[None]:
    """Sets, for processes started inside, how many threads their libraries use.

    Linear algebra gets one: with more, its sums are ordered differently and the last digits change.
    Numba's loops write each element once, so they may share the cores that `jobs` leaves.
    """
    environment = dict(os.environ)
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"), NUMBA_NUM_THREADS=str(threads))
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(environment)


def available_cores() -> int:
    """Returns how many cores this process may use."""
    return len(os.sched_getaffinity(0))  # what a container or taskset allows


def software_version() -> str:
    """Returns the version of the installed distribution, or "source" where there is none."""
    try:
        return distribution_version("wrenchsight")
    except PackageNotFoundError:
        return "source"
