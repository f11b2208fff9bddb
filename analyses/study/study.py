"""Runs experiments, keeps their whole results and reports on them.

Each experiment runs in a process of its own, also when it runs alone: one that crashes takes no
other with it, nothing that it leaves in memory can change the next one's figures, and its linear
algebra runs in one thread whatever `jobs` is, so that the same seed gives the same bytes.
"""

import ctypes
import errno
import json
import multiprocessing
import os
import resource
import shutil
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from difflib import get_close_matches
from importlib import import_module
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as distribution_version
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any, Final

from wrenchsight.analyses.output.compilation import on_first_compilation
from wrenchsight.analyses.output.interruption import ends_are_interrupts, uninterrupted
from wrenchsight.analyses.output.outputs import OutputFolder, json_text, plain
from wrenchsight.analyses.output.progress import Progress, State
from wrenchsight.analyses.output.sole_writer import sole_writer
from wrenchsight.analyses.study.experiment import Experiment, ExperimentContext
from wrenchsight.analyses.study.fingerprint import difference, fingerprint, software_hash
from wrenchsight.analyses.study.outcome import Outcome, StudyResult, StudySettings
from wrenchsight.analyses.study.registry import REGISTRY
from wrenchsight.analyses.study.report import write_report
from wrenchsight.analyses.study.shared_results import sharing_in
from wrenchsight.analyses.study.stored_result import DamagedResultError, read_result, write_result
from wrenchsight.analyses.study.study_folder import FAILURES, SET_ASIDE, StudyFolder
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.whole_file import writing_to
from wrenchsight.models.robot.truth_config import TRUTHS

_SHARED: Final = ".shared.partial"  # folder of what experiments have in common
_ENDS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_NO_STORAGE: Final = (errno.ENOSPC, errno.EDQUOT, errno.EROFS)


def run_study(
    names: Sequence[str],
    out: Path,
    data: Path,
    *,
    seed: int = 0,
    quick: bool = False,
    truth: str = "own",
    jobs: int = 1,
    fresh: bool = False,
    watch: Callable[[Progress], None] = lambda progress: None,
) -> StudyResult:
    """Runs experiments, `jobs` at a time, and writes what they measured below `out`.

    `out/<name>/` receives metrics.json, config.yaml, result.json (what the report shows), figures,
    recordings and their checksums, at once and only when the experiment has come to its end. An
    experiment whose whole result is there already, with the fingerprint that it would get now (see
    `analyses.study.fingerprint`), is not run again; a result that is not as it was written is.

    At the end, and also after an interrupt or a full disk, `out/metrics.json` gets one object per
    experiment, `out/timings.json` the seconds, `out/report.html` the report: of all results in
    `out`, asked for or not, that belong together by their fingerprints, and of no others. After a
    kill that nothing can catch they are as before the study; the next one finds the whole results.

    An experiment that fails leaves out/failures/<name>.txt and does not stop the others.

    Args:
        names: experiments to run; empty means all of `wrenchsight.analyses.study.registry`.
        out: folder of the study; made if absent.
        data: folder of the real recordings; experiments that need an absent one are skipped.
        seed: of every random number.
        quick: whether experiments run shorter and coarser.
        truth: of simulated arms, one of `wrenchsight.models.robot.truth_config.TRUTHS`.
        jobs: processes side by side, at least 1.
        fresh: whether to run also what has a whole result.
        watch: called in this process at every step of every experiment.

    Raises:
        InputError: an unknown name or truth, a folder that cannot be written, a full disk,
            another study at work in the folder.
        KeyboardInterrupt: passed on after the results so far were written; a `TerminatedError`
            for SIGTERM and SIGHUP.
    """
    settings = StudySettings(
        asked=tuple(check_names(names)),
        known=tuple(REGISTRY.entries()),
        data=data,
        seed=seed,
        quick=quick,
        truth=truth,
        version=software_version(),
    )
    if jobs < 1:
        raise InputError("--jobs", "", f"is {jobs}, at least 1 was expected")
    if truth not in TRUTHS:
        raise InputError("--truth", "", f"is {truth!r}, expected {' or '.join(TRUTHS)}")
    OutputFolder(out)
    _check_apart(out, data)
    with sole_writer(out, "study"), ends_are_interrupts():
        folder = StudyFolder(out, settings.asked)
        _recover(folder)
        runs = {}
        for name in settings.asked:
            earlier, why = (None, "") if fresh else _earlier(out, name, settings)
            if earlier is None:
                runs[name] = _Run(name, REGISTRY.entries()[name].module, folder, settings)
                for what in (why, _kept(folder, name)):
                    if what:
                        watch(Progress(name, "waiting", what=what))
            else:
                watch(Progress(name, "earlier", 1.0, "nothing has changed since its run"))
        timings = _read_timings(out / "timings.json")
        first = sorted(runs.values(), key=lambda run: -_expected_seconds(run.outcome.name, timings))
        try:
            with writing_to(out):
                (out / _SHARED).mkdir(mode=0o700)
            _run_all(first, jobs, watch)
        except BaseException:
            # The user should see the cause, not an error that follows from it.
            with suppress(InputError, OSError):
                _summarise(folder, runs, settings)
            raise
        finally:
            shutil.rmtree(out / _SHARED, ignore_errors=True)
        return _summarise(folder, runs, settings)


def _summarise(
    folder: StudyFolder, runs: Mapping[str, "_Run"], settings: StudySettings
) -> StudyResult:
    """Writes what all results in the folder that belong together say."""
    _recover(folder)
    outcomes = []
    for name in REGISTRY.entries():
        outcome = runs[name].outcome if name in runs else None
        if outcome is None or outcome.state == "interrupted":
            outcome = _earlier(folder.path, name, settings)[0] or outcome
        outcomes += [outcome] if outcome else []
    return _write_summary(folder, outcomes, settings)


def _recover(folder: StudyFolder) -> None:
    for name in REGISTRY.entries():
        with writing_to(folder.path / name):
            folder.recover(name)
            for left_over in _left_overs(folder.path, name):  # of a study that was killed
                shutil.rmtree(left_over) if left_over.is_dir() else left_over.unlink()


def _left_overs(out: Path, name: str) -> list[Path]:
    mine = (out / f".{name}.partial", out / f".{name}.log.partial", out / _SHARED)
    return [path for path in mine if os.path.lexists(path)]


def _check_apart(out: Path, data: Path) -> None:
    """Refuses recordings that lie where the results go: they might be moved or replaced."""
    if data.resolve().is_relative_to(out.resolve()):
        problem = f"the recordings lie in the folder of the results, {out}"
        raise InputError(data, "", problem, "choose another folder with --out")


def _kept(folder: StudyFolder, name: str) -> str:
    """Says what of an experiment's folder is not removed when its new result comes."""
    found = folder.not_ours(name)
    if not found:
        return ""
    files = found[0] or "what lies in its place"
    more = f" and {len(found) - 1} more" if len(found) > 1 else ""
    return f"{files}{more} was not written by a study: moved to {SET_ASIDE}/{name}"


def _expected_seconds(name: str, timings: Mapping[str, Mapping[str, float]]) -> float:
    typical = REGISTRY.entries()[name].seconds  # the folder's own timings count before it
    return timings.get(name, {}).get("processor_seconds", typical)


def check_names(names: Iterable[str]) -> list[str]:
    """Returns the experiments meant by `names`, without repetitions; all if there are none.

    Raises:
        InputError: a name is unknown; the line lists the known ones.
    """
    experiments = REGISTRY.entries()
    asked = list(dict.fromkeys(names)) or list(experiments)
    for name in asked:
        if name not in experiments:
            near = get_close_matches(name, experiments, n=len(experiments), cutoff=0.0)
            hint = f"did you mean {near[0]}? " if get_close_matches(name, near, n=1) else ""
            known = f"{hint}known are {', '.join(near)}"
            raise InputError("study", "", f"no experiment is named {name!r}", known)
    return asked


class _Run:
    """One experiment's process, its staging folder and what has come of it."""

    def __init__(
        self, name: str, module: str, folder: StudyFolder, settings: StudySettings
    ) -> None:
        out = folder.path
        self.outcome = Outcome(name, "waiting")
        self._module, self._settings = module, settings
        self._folder, self._out = folder, out
        self._staging = out / f".{name}.partial"
        self._log = out / f".{name}.log.partial"
        self._failure = f"{FAILURES}/{name}.txt"
        self._process: Any = None
        self._started = 0.0
        self.connection: Connection | None = None

    def start(self, threads: int) -> None:
        with writing_to(self._staging):
            self._staging.mkdir()
        if (self._out / self._failure).exists():
            with self._folder.staged(outdated=[self._failure]):
                pass
        spawn = multiprocessing.get_context("spawn")  # a forked numba or Drake may hang
        self.connection, theirs = spawn.Pipe()
        task = _Task(
            self.outcome.name, self._module, self._staging, self._out / _SHARED, self._settings
        )
        with _thread_limits(threads):
            self._process = spawn.Process(
                target=_work, args=(task, theirs, self._log), name=self.outcome.name
            )
            with _for_this_process_alone():
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
        reason, no_storage, processor_seconds = content
        if no_storage:
            remedy = "free some space and run again: what is finished is kept"
            raise InputError(self._out, "", f"{no_storage}, while {outcome.name} ran", remedy)
        outcome.processor_seconds = processor_seconds
        return self._finish(kind, reason)

    def _finish(self, state: State, reason: str) -> Progress:
        assert self.connection is not None
        self.connection.close()
        self._process.join()
        outcome = self.outcome
        outcome.seconds = time.monotonic() - self._started
        with writing_to(self._out):
            if state == "done":
                with uninterrupted():
                    self._folder.replace(self._staging, outcome.name)
                result = read_result(self._out / outcome.name)
                outcome.metrics, outcome.stored = result.metrics, result.stored
            elif state == "failed":
                text = reason + "\n"
                if self._log.exists():
                    text = self._log.read_text(encoding="utf-8", errors="replace") or text
                with self._folder.staged() as staged:
                    staged.write_text(self._failure, text)
        outcome.state, outcome.reason = state, reason
        self._clean()
        seconds = outcome.seconds if state == "done" else None
        return Progress(outcome.name, state, 1.0, reason, seconds)

    def _how_it_died(self) -> str:
        self._process.join()
        code = self._process.exitcode
        return f"its process was ended by signal {-code}" if code < 0 else f"exit code {code}"

    def stop(self) -> None:
        """Ends the process, if it runs, and removes what it had begun to write."""
        if self._process is not None:
            self._process.kill()  # it has nothing to tidy up that `_clean` does not
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
    shared: Path
    settings: StudySettings


@contextmanager
def _for_this_process_alone() -> Iterator[None]:
    """Holds signals back from a process that starts within the block, for all of its life: the
    terminal and `kill` tell the whole group, and an interpreter that is just starting would end in
    a traceback. They reach this process at the block's end.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _ENDS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _work(task: _Task, connection: Connection, log: Path) -> None:
    """Runs in the experiment's own process: its output goes to `log`, its steps to `connection`."""
    import faulthandler

    # The terminal and `kill` tell the whole group; it is the parent that ends this process.
    for number in _ENDS:
        signal.signal(number, signal.SIG_IGN)
    _die_with_parent()
    descriptor = -1
    state: State = "failed"
    no_storage = ""
    try:
        descriptor = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        sys.stdout.flush()
        os.dup2(descriptor, 1)  # what Drake or numba print would tear the progress lines apart
        os.dup2(descriptor, 2)
        faulthandler.enable(file=descriptor)
        state, reason = _run_experiment(task, connection)
    except BaseException as error:  # whatever it is, the parent is to know
        reason = str(error) if isinstance(error, InputError) else _first_line(error)
        no_storage = _lack_of_storage(error)
        with suppress(OSError):
            if descriptor >= 0:
                traceback.print_exc()
    with suppress(OSError):
        sys.stderr.flush()
    usage = resource.getrusage(resource.RUSAGE_SELF)
    connection.send((state, reason, no_storage, usage.ru_utime + usage.ru_stime))


def _lack_of_storage(error: BaseException | None) -> str:
    """Returns what the file system said if it had no room, in this error or behind it."""
    while error is not None:
        if isinstance(error, OSError) and error.errno in _NO_STORAGE:
            return error.strerror or str(error)
        error = error.__cause__ or error.__context__
    return ""


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
        truth=settings.truth,
    )
    depends_on = fingerprint(
        task.module,
        settings.data,
        (*experiment.needs, *experiment.uses),
        seed=settings.seed,
        quick=settings.quick,
        truth=settings.truth,
    )
    with sharing_in(task.shared):
        result = experiment.run(context)
    if software_hash(task.module) != depends_on["software"]:
        depends_on["software"] = "changed while it ran"  # which part was imported when is not known
    write_result(task.out, experiment, result, depends_on, settings.of_results)
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


def _die_with_parent() -> None:
    """Has the kernel kill this process as soon as its parent is dead, however that comes."""
    parent = multiprocessing.parent_process()
    with suppress(AttributeError, OSError):  # not Linux
        ctypes.CDLL(None).prctl(1, int(signal.SIGKILL))  # 1: PR_SET_PDEATHSIG
    if parent is not None and os.getppid() != parent.pid:  # it was faster
        os._exit(1)


def _earlier(out: Path, name: str, settings: StudySettings) -> tuple[Outcome | None, str]:
    """Returns the whole result that is there already, if running again would give the same.

    Else None and, where there is a result, in a few words why it does not count.
    """
    try:
        result = read_result(out / name)
        recorded = result.stored["fingerprint"]
        now = fingerprint(
            REGISTRY.entries()[name].module,
            settings.data,
            recorded["recordings"],  # which folders these are follows from the software
            seed=settings.seed,
            quick=settings.quick,
            truth=settings.truth,
        )
        changed = difference(recorded, now)
        title, section = result.stored["title"], result.stored["section"]
    except FileNotFoundError:
        return None, ""
    except DamagedResultError as damage:
        return None, f"its earlier result is damaged ({damage}): it runs again"
    except (KeyError, TypeError, AttributeError):
        return None, "its earlier result is damaged (result.json): it runs again"
    if changed:
        return None, f"{changed} since its earlier run: it runs again"
    outcome = Outcome(name, "earlier", title, section, metrics=result.metrics, stored=result.stored)
    return outcome, ""


def _write_summary(
    folder: StudyFolder, outcomes: list[Outcome], settings: StudySettings
) -> StudyResult:
    metrics = {outcome.name: outcome.metrics for outcome in outcomes if outcome.has_result}
    timings = _read_timings(folder.path / "timings.json")
    for outcome in outcomes:
        if outcome.state == "done" and outcome.seconds is not None:
            timings[outcome.name] = {
                "seconds": round(outcome.seconds, 1),
                "processor_seconds": round(outcome.processor_seconds or 0.0, 1),
            }
        elif outcome.state == "earlier":
            outcome.seconds = timings.get(outcome.name, {}).get("seconds")
    with_result = {name: timings[name] for name in metrics if name in timings}
    with folder.staged() as staged:
        staged.write_text("metrics.json", json_text(metrics))
        staged.write_text("timings.json", json_text(plain(with_result)))
        report = write_report(staged, outcomes, settings, folder.path)
    return StudyResult(folder.path, tuple(outcomes), metrics, folder.path / report.name)


def _read_timings(path: Path) -> dict[str, dict[str, float]]:
    try:
        timings = json.loads(path.read_text(encoding="utf-8"))
        return {str(n): {str(k): float(s) for k, s in t.items()} for n, t in timings.items()}
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
