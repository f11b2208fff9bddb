"""Calls in processes of this machine side by side, of joblib's executors.

Each process has an executor of its own, so that one that dies (a crash in a library, the system's
want of memory) takes no other with it. `joblib.Parallel` gives up all calls under way when one
process dies, and computes in this process where it is to use a single one.
"""

import os
import re
import warnings
from collections import deque
from collections.abc import Callable, Generator, Iterable, Mapping
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from dataclasses import dataclass
from typing import Any, Final, Generic, NamedTuple, TypeVar

from wrenchsight.analyses.output.interruption import begin_worker, for_this_process_alone

Task = TypeVar("Task")
Result = TypeVar("Result")

ONE_THREAD: Final = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Environment of every process that measures: 1, or the last bits hang on the machine's cores."""
_MEMORY_ENVIRONMENT: Final = {
    "MALLOC_MMAP_THRESHOLD_": str(2**30),
    "MALLOC_TRIM_THRESHOLD_": str(2**34),
}
"""Environment in which glibc keeps what is freed: pages that come anew from the system each time
take a twelfth of a world's processor time."""
_LOOK_PERIOD: Final = 0.1  # s between two looks at what is under way, and two calls of `tick`


@dataclass(frozen=True)
class Died:
    """Stands for the result of a call whose process died."""

    exit_codes: str  # such as SIGSEGV(-11)

    def __str__(self) -> str:
        return f"its process died ({self.exit_codes})"


class _Call(NamedTuple, Generic[Task]):
    """A call under way."""

    task: Task
    attempt: int  # from 1
    executor: Any  # of one process, which does nothing else meanwhile


def _death(future: Future[Any]) -> Died | None:
    """The death of the process of a call that is over; None where it lives on."""
    error = future.exception()
    if not isinstance(error, BrokenExecutor):
        return None
    codes = re.search(r"\{(.+)\}", str(error))  # joblib's message ends with them, in braces
    return Died(codes.group(1) if codes else "exit code unknown")


def run_side_by_side(
    run: Callable[[Task], Result],
    tasks: Iterable[Task],
    jobs: int,
    *,
    tries: int = 1,
    each_in_its_own: bool = False,
    environment: Mapping[str, str] | None = None,
    log: str = os.devnull,
    started: Callable[[Task], None] = lambda task: None,
    tick: Callable[[], None] = lambda: None,
) -> Generator[tuple[Task, Result | Died]]:
    """Yields each task with its result, as they end; closed before its end, it kills what runs.

    Linear algebra gets one thread: with more, its sums are ordered differently and the last digits
    change.

    Args:
        run: can be pickled, as its tasks and results can.
        tasks: in the order in which they begin.
        jobs: processes side by side, at least 1.
        tries: how often a task is begun, at the most, whose process dies. A process that was seen
            to die while idle is replaced, which counts for no task.
        each_in_its_own: whether each task gets a new process; else a process takes several.
        environment: environment of the processes, beside the limits of threads.
        log: file that takes what the processes print.
        started: called with a task when it has begun, in each of its tries.
        tick: called about ten times a second, while this generator is asked for its next task.

    Yields:
        Each task with its result; `Died` where its process died in its last try. An exception that
        `run` raised is raised here.
    """
    from joblib.externals.loky.process_executor import ProcessPoolExecutor

    worker_environment = {
        **dict.fromkeys(ONE_THREAD, "1"),
        **_MEMORY_ENVIRONMENT,
        **(environment or {}),
    }

    def new_executor() -> Any:
        return ProcessPoolExecutor(
            max_workers=1,
            initializer=begin_worker,
            initargs=(os.getpid(), log),
            env=worker_environment,
        )

    # A process whose memory has grown is replaced between two tasks: nothing is lost by it.
    warnings.filterwarnings("ignore", "A worker stopped while some jobs were given", UserWarning)
    waiting = deque((task, 1) for task in tasks)  # with the number of the try
    idle = list[Any]()  # executors, of one process each
    under_way = dict[Future[Result], _Call[Task]]()

    def submit(task: Task) -> tuple[Any, Future[Result]]:
        """The executor that the task was given to, and the task's future."""
        while idle:
            executor = idle.pop()
            try:
                return executor, executor.submit(run, task)
            except BrokenExecutor:  # its process died while idle: the task was not begun
                executor.shutdown(wait=True, kill_workers=True)
        executor = new_executor()
        return executor, executor.submit(run, task)

    try:
        while waiting or under_way:
            while waiting and len(under_way) < jobs:
                task, attempt = waiting.popleft()
                # The process begins with the submission. SIGINT, SIGTERM and SIGHUP are blocked
                # until its executor has its entry in `under_way`, by which the end finds it; the
                # threads and processes that begin in the block keep them blocked.
                with for_this_process_alone():
                    executor, future = submit(task)
                    under_way[future] = _Call(task, attempt, executor)
                started(task)  # which may raise: the call is in `under_way`, and killed at the end
            ended = wait(under_way, timeout=_LOOK_PERIOD, return_when=FIRST_COMPLETED).done
            tick()
            for future in ended:
                call = under_way.pop(future)
                death = _death(future)
                if death is not None or each_in_its_own:
                    call.executor.shutdown(wait=True, kill_workers=True)
                else:
                    idle.append(call.executor)
                if death is None:
                    yield call.task, future.result()
                elif call.attempt < tries:
                    waiting.append((call.task, call.attempt + 1))
                else:
                    yield call.task, death
    finally:  # the end, an exception, or the generator is closed
        for executor in (*idle, *(call.executor for call in under_way.values())):
            executor.shutdown(wait=True, kill_workers=True)
