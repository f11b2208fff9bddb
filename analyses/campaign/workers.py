"""Runs worlds in processes of this machine, or on the workers of a Dask scheduler.

Either gives outcomes as they come, in any order, and loses none when a worker dies: its world goes
to another. A world that takes every worker down that it is given to is a failure of its own.
"""

import logging
import os
import re
import socket
import warnings
from collections import deque
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final

from wrenchsight.analyses.campaign.world_run import WorldOutcome, WorldTask, run_world
from wrenchsight.analyses.output.interruption import begin_worker, for_this_process_alone
from wrenchsight.analyses.study.study import ONE_THREAD
from wrenchsight.models.files.input_error import InputError

KILLED_MESSAGE: Final = "its process was killed, or crashed, each time"
_CONNECT_TIMEOUT: Final = 10  # s in which a scheduler answers
_ADDRESS: Final = re.compile(
    r"((tcp|tls)://)?(?P<host>\[[0-9a-fA-F:.]+\]|[\w.-]+):(?P<port>\d{1,5})"
)
_START_ONE: Final = "start one with `dask scheduler`, workers with `dask worker ADDRESS`"
_WORKER_MEMORY: Final = {"MALLOC_MMAP_THRESHOLD_": str(2**30), "MALLOC_TRIM_THRESHOLD_": str(2**34)}
"""Environment in which glibc keeps what is freed: pages that come anew from the system each time
take a twelfth of a world's processor time."""


def on_this_machine(tasks: Sequence[WorldTask], jobs: int, log: Path) -> Generator[WorldOutcome]:
    """Runs worlds in `jobs` processes, of joblib's executor.

    `joblib.Parallel` would not do: with one process that dies it gives up all worlds under way. A
    single job it computes in this process, with its threads.

    Args:
        tasks: to run.
        jobs: processes side by side.
        log: file that takes what the processes print.
    """
    waiting, suspects = deque(tasks), deque[WorldTask]()
    while waiting or suspects:
        # After a crash the world that caused it is unknown: those under way go on one by one.
        alone = bool(suspects)
        source = deque([suspects.popleft()]) if alone else waiting
        under_way = dict[Future[WorldOutcome], WorldTask]()
        processes = min(jobs, len(source))
        with _executor(processes, log) as (executor, broken):
            try:
                while source or under_way:
                    while source and len(under_way) < processes:
                        with for_this_process_alone():
                            under_way[executor.submit(run_world, source[0])] = source[0]
                        source.popleft()  # not before: a broken pool takes no more
                    for future in wait(under_way, return_when=FIRST_COMPLETED).done:
                        outcome = future.result()
                        del under_way[future]
                        yield outcome
            except broken:
                unfinished = list(under_way.values()) or [source.popleft()]
                if alone:
                    yield killed(unfinished[0])
                else:
                    suspects.extend(unfinished)


def on_cluster(tasks: Sequence[WorldTask], address: str) -> Generator[WorldOutcome]:
    """Runs worlds on the workers of a Dask scheduler, which repeats those of lost workers.

    Args:
        tasks: to run.
        address: of the scheduler, such as `tcp://127.0.0.1:8786`.

    Raises:
        InputError: the library is not installed, no scheduler answers, it has no workers or
            ends.
    """
    try:
        from distributed import Client, as_completed
        from distributed.client import FutureCancelledError
        from distributed.scheduler import KilledWorker
    except ImportError:
        problem, remedy = "needs the package distributed", "pip install 'wrenchsight[cluster]'"
        raise InputError("--cluster", "", problem, remedy) from None
    for library in ("distributed", "tornado", "asyncio"):
        logging.getLogger(library).setLevel(logging.CRITICAL + 1)  # one line reports a failure
    try:
        client = Client(address, timeout=_CONNECT_TIMEOUT, set_as_default=False)
    except Exception as error:  # of the transport's kind: no certificates, another protocol
        reason = f"{type(error).__name__}: {error}"
        problem = f"no scheduler answers at {address} ({reason[:200]})"
        raise InputError("--cluster", "", problem, _START_ONE) from None
    with client:
        if not client.scheduler_info()["workers"]:
            remedy = f"start them with `dask worker {address}`"
            raise InputError("--cluster", "", f"the scheduler at {address} has no workers", remedy)
        # Not pure: two campaigns may ask the same of one scheduler, and one may end before.
        futures = {client.submit(run_world, task, pure=False): task for task in tasks}
        try:
            for future in as_completed(list(futures), loop=client.loop):
                try:
                    outcome = future.result()
                except KilledWorker:
                    outcome = killed(futures[future])
                except FutureCancelledError:
                    problem = f"the scheduler at {address} has ended"
                    remedy = "run the command again: finished worlds are kept"
                    raise InputError("--cluster", "", problem, remedy) from None
                del futures[future]
                future.release()
                yield outcome
        finally:
            with suppress(Exception):  # the scheduler may have ended
                client.cancel(list(futures), force=True)


def refuse_silent(address: str) -> None:
    """Refuses an address where nothing listens, at once: the library would go on trying.

    Raises:
        InputError: it is no address, or nobody answers there.
    """
    match = _ADDRESS.fullmatch(address)
    if match is None or not 0 < int(match["port"]) < 1 << 16:
        problem = f"{address!r} is no address of a scheduler, expected tcp://HOST:PORT"
        raise InputError("--cluster", "", problem, _START_ONE)
    place = match["host"].strip("[]"), int(match["port"])
    try:
        with socket.create_connection(place, _CONNECT_TIMEOUT) as connection:
            if not address.startswith("tls:") and not connection.recv(
                1
            ):  # a scheduler speaks first
                raise OSError
    except (OSError, UnicodeError):
        problem = f"no scheduler answers at {address}"
        raise InputError("--cluster", "", problem, _START_ONE) from None


def killed(task: WorldTask) -> WorldOutcome:
    """The outcome of a world whose workers die."""
    world = task.world()
    failures = dict.fromkeys(task.modules, KILLED_MESSAGE)
    return WorldOutcome(world.number, world.seed, world.parameters(), failures=failures)


@contextmanager
def _executor(jobs: int, log: Path) -> Iterator[tuple[Any, type[Exception]]]:
    from joblib.externals.loky.process_executor import BrokenProcessPool, ProcessPoolExecutor

    # A process whose memory has grown is replaced between two worlds: nothing is lost by it.
    warnings.filterwarnings("ignore", "A worker stopped while some jobs were given", UserWarning)
    with for_this_process_alone():
        executor = ProcessPoolExecutor(
            jobs,
            initializer=begin_worker,
            initargs=(os.getpid(), str(log)),
            env={**dict.fromkeys(ONE_THREAD, "1"), **_WORKER_MEMORY},
        )
    try:
        yield executor, BrokenProcessPool
    finally:
        executor.shutdown(wait=True, kill_workers=True)
