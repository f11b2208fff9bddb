"""Runs experiments, keeps their whole results and reports on them.

Each experiment runs in a process of its own, also when it runs alone: one that crashes takes no
other with it, nothing that it leaves in memory can change the next one's figures, and its linear
algebra runs in one thread whatever `jobs` is, so that the same seed gives the same bytes.
"""

import fcntl
import json
import multiprocessing
import os
import shutil
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from difflib import get_close_matches
from importlib import import_module
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as distribution_version
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

from analyses.compilation import on_first_compilation
from analyses.experiment import Experiment, ExperimentContext, ExperimentResult
from analyses.outcome import Outcome, State, StudyResult, StudySettings, look_up
from analyses.outputs import (
    OutputFolder,
    json_text,
    plain,
    plain_metrics,
    recover_folder,
    replace_folder,
)
from analyses.report import write_report
from models.input_error import InputError

# Name of an experiment -> the module whose EXPERIMENT it is, in the order of the report. Modules,
# not experiments, so that listing the names imports neither Drake nor numba.
EXPERIMENTS: dict[str, str] = {
    "identification": "analyses.simulated_identification",
    "jcn-map": "analyses.jcn_map",
    "linear-path": "analyses.linear_path",
    "constant-wrench": "analyses.constant_wrench",
    "surface-path": "analyses.redundancy",
    "metrics-compare": "analyses.metrics_compare",
    "bandwidth": "analyses.bandwidth",
    "friction-laws": "analyses.friction_laws",
    "ur10e-identification": "analyses.ur10e_identification",
    "ur10e-payload": "analyses.ur10e_payload",
    "panda-wrench": "analyses.panda_wrench",
}

_STORED_FORMAT = 1  # of result.json; another one is not read back
_FAILURES = "failures"


@dataclass(frozen=True)
class Progress:
    """What an experiment is doing now."""

    name: str
    state: State
    fraction: float = 0.0  # 0..1
    what: str = ""


def run_study(
    names: Sequence[str],
    out: Path,
    data: Path,
    *,
    seed: int = 0,
    quick: bool = False,
    jobs: int = 1,
    watch: Callable[[Progress], None] = lambda progress: None,
) -> StudyResult:
    """Runs experiments, `jobs` at a time, and writes what they measured below `out`.

    `out/<name>/` receives metrics.json, config.yaml, result.json (what the report shows), figures
    and recordings, at once and only when the experiment has come to its end. `out/metrics.json` has
    one object per experiment, `out/timings.json` the seconds, `out/report.html` the report. Whole
    results of experiments that are not in `names` stay in both if they were made with the same
    seed, length and version. An experiment that fails leaves out/failures/<name>.txt and does not
    stop the others. After an interrupt the files hold what had come to its end before.

    Args:
        names: experiments to run; empty means all of EXPERIMENTS.
        out: folder of the study; made if absent.
        data: folder of the real recordings; experiments that need an absent one are skipped.
        seed: of every random number.
        quick: whether experiments run shorter and coarser.
        jobs: processes side by side, at least 1.
        watch: called in this process at every step of every experiment.

    Raises:
        InputError: an unknown name, a folder that cannot be written, another study at work in it.
        KeyboardInterrupt: passed on after the results so far were written.
    """
    settings = StudySettings(
        asked=tuple(check_names(names)),
        known=tuple(EXPERIMENTS),
        data=data,
        seed=seed,
        quick=quick,
        version=software_version(),
    )
    if jobs < 1:
        raise InputError("--jobs", "", f"is {jobs}, at least 1 was expected")
    folder = OutputFolder(out)
    with _sole_writer(out):
        for name in EXPERIMENTS:
            recover_folder(out / name)
        for left_over in list(out.glob(".*.partial")):  # of a study that was killed
            shutil.rmtree(left_over) if left_over.is_dir() else left_over.unlink()
        runs = {name: _Run(name, EXPERIMENTS[name], out, settings) for name in settings.asked}
        try:
            _run_all(list(runs.values()), jobs, watch)
        finally:
            outcomes = []
            for name in EXPERIMENTS:
                outcome = runs[name].outcome if name in runs else None
                if outcome is None or outcome.state == "interrupted":
                    outcome = _earlier(out, name, settings) or outcome
                outcomes += [outcome] if outcome else []
            result = _write_summary(folder, outcomes, settings)
    return result


def check_names(names: Iterable[str]) -> list[str]:
    """Returns the experiments meant by `names`, without repetitions; all if there are none.

    Raises:
        InputError: a name is unknown; the line lists the known ones.
    """
    asked = list(dict.fromkeys(names)) or list(EXPERIMENTS)
    for name in asked:
        if name not in EXPERIMENTS:
            near = get_close_matches(name, EXPERIMENTS, n=1)
            hint = f"did you mean {near[0]}? " if near else ""
            known = f"{hint}known are {', '.join(EXPERIMENTS)}"
            raise InputError("study", "", f"no experiment is named {name!r}", known)
    return asked


class _Run:
    """One experiment's process, its staging folder and what has come of it."""

    def __init__(self, name: str, module: str, out: Path, settings: StudySettings) -> None:
        self.outcome = Outcome(name, "waiting")
        self._module, self._out, self._settings = module, out, settings
        self._staging = out / f".{name}.partial"
        self._log = out / f".{name}.log.partial"
        self._failure = out / _FAILURES / f"{name}.txt"
        self._process: Any = None
        self._started = 0.0
        self.connection: Connection | None = None

    def start(self, threads: int) -> None:
        self._staging.mkdir()
        self._failure.unlink(missing_ok=True)
        spawn = multiprocessing.get_context("spawn")  # a forked numba or Drake may hang
        self.connection, theirs = spawn.Pipe()
        task = _Task(self.outcome.name, self._module, self._staging, self._settings)
        with _thread_limits(threads):
            self._process = spawn.Process(
                target=_work, args=(task, theirs, self._log), name=self.outcome.name
            )
            self._process.start()
        theirs.close()
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
            outcome.title, outcome.section = content
            return Progress(outcome.name, "running")
        if kind == "progress":
            return Progress(outcome.name, "running", *content)
        return self._finish(kind, content[0])

    def _finish(self, state: State, reason: str) -> Progress:
        assert self.connection is not None
        self.connection.close()
        self._process.join()
        outcome = self.outcome
        outcome.state, outcome.reason = state, reason
        outcome.seconds = time.monotonic() - self._started
        if state == "done":
            replace_folder(self._staging, self._out / outcome.name)
            outcome.metrics, outcome.stored = _read_result(self._out / outcome.name)
        elif state == "failed":
            self._failure.parent.mkdir(exist_ok=True)
            if self._log.exists():
                self._log.replace(self._failure)
            else:
                self._failure.write_text(reason + "\n", encoding="utf-8")
        self._clean()
        return Progress(outcome.name, state, 1.0, reason)

    def _how_it_died(self) -> str:
        self._process.join()
        code = self._process.exitcode
        return f"its process was ended by signal {-code}" if code < 0 else f"exit code {code}"

    def stop(self) -> None:
        """Ends the process, if it runs, and removes what it had begun to write."""
        if self._process is not None:
            self._process.terminate()
            self._process.join(5)
            if self._process.is_alive():
                self._process.kill()
                self._process.join()
        self.outcome.state = "interrupted"
        self._clean()

    def _clean(self) -> None:
        shutil.rmtree(self._staging, ignore_errors=True)
        self._log.unlink(missing_ok=True)


def _run_all(runs: list[_Run], jobs: int, watch: Callable[[Progress], None]) -> None:
    threads = max(1, available_cores() // jobs)
    waiting, running = list(runs), dict[Connection, _Run]()
    try:
        while waiting or running:
            while waiting and len(running) < jobs:
                run = waiting.pop(0)
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


@dataclass(frozen=True)
class _Task:
    """What a process is sent to do."""

    name: str
    module: str
    out: Path
    settings: StudySettings


def _work(task: _Task, connection: Connection, log: Path) -> None:
    """Runs in the experiment's own process: its output goes to `log`, its steps to `connection`."""
    import faulthandler
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent has it too, and ends this process
    threading.Thread(target=_die_with_parent, args=(connection,), daemon=True).start()
    descriptor = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    sys.stdout.flush()
    os.dup2(descriptor, 1)  # what Drake or numba print would tear the progress lines apart
    os.dup2(descriptor, 2)
    faulthandler.enable(file=descriptor)
    try:
        state, reason = _run_experiment(task, connection)
    except InputError as error:
        traceback.print_exc()
        state, reason = "failed", str(error)
    except BaseException as error:  # whatever it is, the parent is to know
        traceback.print_exc()
        state, reason = "failed", _first_line(error)
    sys.stderr.flush()
    connection.send((state, reason))


def _run_experiment(task: _Task, connection: Connection) -> tuple[State, str]:
    experiment: Experiment = import_module(task.module).EXPERIMENT
    if experiment.name != task.name:
        raise ValueError(f"{task.module}: its experiment is {experiment.name}, not {task.name}")
    connection.send(("loaded", experiment.title, experiment.section))
    settings = task.settings
    missing = [settings.data / n for n in experiment.needs if not (settings.data / n).is_dir()]
    if missing:
        return "skipped", f"needs the recordings {', '.join(map(str, missing))}; see --data"
    if "numba" in sys.modules:
        on_first_compilation(lambda what: connection.send(("progress", 0.0, what)))
    context = ExperimentContext(
        out=task.out,
        data=settings.data,
        seed=settings.seed,
        quick=settings.quick,
        progress=_Throttled(connection),
    )
    _store(task, experiment, experiment.run(context))
    return "done", ""


class _Throttled:
    """Passes progress on, at most ten times a second."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._next = 0.0

    def __call__(self, fraction: float, what: str) -> None:
        now = time.monotonic()
        if now >= self._next:
            self._next = now + 0.1
            self._connection.send(("progress", float(fraction), str(what)))


def _die_with_parent(connection: Connection) -> None:
    """Ends this process when the parent, killed, no longer holds its end of the pipe."""
    try:
        connection.recv()  # the parent sends nothing
    except (EOFError, OSError):
        os._exit(1)


def _store(task: _Task, experiment: Experiment, result: ExperimentResult) -> None:
    """Writes a result into the experiment's folder.

    Raises:
        ValueError: the result names a figure, a recording or a metric that it does not have.
    """
    folder = OutputFolder(task.out)
    metrics = plain_metrics(result.metrics)
    settings = task.settings.of_results
    stored = plain(
        {
            "format": _STORED_FORMAT,
            "title": experiment.title,
            "section": experiment.section,
            **settings,
            "notes": result.notes,
            "figures": result.figures,
            "recordings": result.recordings,
            "comparison": result.comparison,
        }
    )
    _check_whole(task.out, metrics, stored)
    folder.write_json("metrics.json", metrics)
    folder.write_json("result.json", stored)
    configuration = {"experiment": task.name, **settings, "configuration": result.configuration}
    folder.write_yaml("config.yaml", configuration)


def _check_whole(folder: Path, metrics: dict[str, Any], stored: dict[str, Any]) -> None:
    for file in (*stored["figures"], *stored["recordings"]):
        path = Path(file["path"])
        if path.is_absolute() or not (folder / path).is_file():
            raise ValueError(f"{path} is not a file in the experiment's folder")
    for row in stored["comparison"]:
        look_up(metrics, row["key"])


def _read_result(folder: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Reads back what `_store` wrote.

    Raises:
        OSError, ValueError, KeyError, TypeError: it is not there or not whole.
    """
    metrics = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
    stored = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    if stored["format"] != _STORED_FORMAT:
        raise ValueError(f"{folder}: result of format {stored['format']}")
    _check_whole(folder, metrics, stored)
    return metrics, stored


def _earlier(out: Path, name: str, settings: StudySettings) -> Outcome | None:
    """Returns the whole result that an earlier study left, if it belongs beside this one's."""
    try:
        metrics, stored = _read_result(out / name)
        title, section = stored["title"], stored["section"]
    except (OSError, ValueError, KeyError, TypeError):
        return None
    if any(stored.get(key) != value for key, value in settings.of_results.items()):
        return None
    return Outcome(name, "earlier", title, section, metrics=metrics, stored=stored)


def _write_summary(
    folder: OutputFolder, outcomes: list[Outcome], settings: StudySettings
) -> StudyResult:
    metrics = {outcome.name: outcome.metrics for outcome in outcomes if outcome.has_result}
    folder.write_text("metrics.json", json_text(metrics))
    timings = _read_timings(folder / "timings.json")
    for outcome in outcomes:
        if outcome.state == "done" and outcome.seconds is not None:
            timings[outcome.name] = {"seconds": round(outcome.seconds, 1)}
        elif outcome.state == "earlier":
            outcome.seconds = timings.get(outcome.name, {}).get("seconds")
    with_result = {name: timings[name] for name in metrics if name in timings}
    folder.write_text("timings.json", json_text(plain(with_result)))
    report = write_report(folder, outcomes, settings)
    return StudyResult(folder.path, tuple(outcomes), metrics, report)


def _read_timings(path: Path) -> dict[str, dict[str, float]]:
    try:
        timings = json.loads(path.read_text(encoding="utf-8"))
        return {str(name): {"seconds": float(t["seconds"])} for name, t in timings.items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return {}


@contextmanager
def _thread_limits(threads: int) -> Iterator[None]:
    """Sets, for processes started inside, how many threads their libraries use.

    Linear algebra gets one: with more, its sums are ordered differently and the last digits change.
    Numba's loops write each element once, so they may share the cores that `jobs` leaves.
    """
    limits = dict.fromkeys(
        ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"),
        "1",
    )
    limits["NUMBA_NUM_THREADS"] = str(threads)
    before = {name: os.environ.get(name) for name in limits}
    os.environ.update(limits)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextmanager
def _sole_writer(out: Path) -> Iterator[None]:
    """Holds a lock on `out`: two studies in one folder would take each other's files away."""
    with (out / ".lock").open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            problem = "another study is writing in this folder"
            raise InputError(out, "", problem, "wait for it or choose another --out") from None
        yield


def available_cores() -> int:
    """Returns how many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):  # Linux: what a container or taskset allows
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def software_version() -> str:
    """Returns the version of the installed distribution, or "source" where there is none."""
    try:
        return distribution_version("wrenchsight")
    except PackageNotFoundError:
        return "source"


def _first_line(error: BaseException) -> str:
    lines = str(error).strip().splitlines()
    return f"{type(error).__name__}: {lines[0]}" if lines else type(error).__name__
