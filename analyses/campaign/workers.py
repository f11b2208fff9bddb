"""Runs worlds in processes of this machine, or on the workers of a Dask scheduler.

Either gives outcomes as they come, in any order, and loses none when a worker dies: its world goes
to another. A world that takes every worker down that it is given to is a failure of its own; of
such a world joblib's Dask backend (1.6.0) never tells, and waits for ever.
"""

import logging
import re
import socket
from collections.abc import Generator, Sequence
from contextlib import closing, suppress
from pathlib import Path
from typing import Final

from wrenchsight.analyses.campaign.world_run import WorldOutcome, WorldTask, run_world
from wrenchsight.analyses.output.side_by_side import Died, run_side_by_side
from wrenchsight.models.files.input_error import InputError, install_of

_CONNECT_TIMEOUT: Final = 10  # s in which a scheduler answers
_MAX_REASON: Final = 200  # characters of the library's own reason in our one line
_ADDRESS: Final = re.compile(
    r"((tcp|tls)://)?(?P<host>\[[0-9a-fA-F:.]+\]|[\w.-]+):(?P<port>\d{1,5})"
)
_START_ONE: Final = "start one with `dask scheduler`, workers with `dask worker ADDRESS`"


def on_this_machine(tasks: Sequence[WorldTask], jobs: int, log: Path) -> Generator[WorldOutcome]:
    """Runs worlds in `jobs` processes; one whose process dies is begun once more.

    Args:
        tasks: to run.
        jobs: processes side by side.
        log: file that takes what the processes print.
    """
    runs = run_side_by_side(run_world, tasks, jobs, tries=2, log=str(log))
    with closing(runs):
        for task, outcome in runs:
            yield killed(task, str(outcome)) if isinstance(outcome, Died) else outcome


def on_cluster(tasks: Sequence[WorldTask], address: str) -> Generator[WorldOutcome]:
    """Runs worlds on the workers of a Dask scheduler, which repeats those of lost workers.

    Args:
        tasks: to run.
        address: address of the scheduler, such as `tcp://127.0.0.1:8786`.

    Raises:
        InputError: the library is not installed, no scheduler answers, it has no workers or
            ends; `UnfitWorkerError` of a worker (`run_world`).
    """
    try:
        from distributed import Client, as_completed
        from distributed.client import FutureCancelledError
        from distributed.scheduler import KilledWorker
    except ImportError:
        problem = "needs the package distributed"
        raise InputError("--cluster", "", problem, install_of("cluster")) from None
    for library in ("distributed", "tornado", "asyncio"):
        logging.getLogger(library).setLevel(logging.CRITICAL + 1)  # one line reports a failure
    try:
        # Not the default client of this process: a caller may have one of its own.
        client = Client(address, timeout=_CONNECT_TIMEOUT, set_as_default=False)
    except Exception as error:  # of the transport's kind: no certificates, another protocol
        reason = f"{type(error).__name__}: {error}"
        problem = f"no scheduler answers at {address} ({reason[:_MAX_REASON]})"
        raise InputError("--cluster", "", problem, _START_ONE) from None
    with client:
        if not client.scheduler_info()["workers"]:
            remedy = f"start them with `dask worker {address}`"
            raise InputError("--cluster", "", f"the scheduler at {address} has no workers", remedy)
        # Not pure: two campaigns may ask the same of one scheduler, and one may end before.
        futures = {client.submit(run_world, task, pure=False): task for task in tasks}
        try:
            # A list of its own: `futures` shrinks as they complete. The loop is named, as this
            # client is not the default one.
            for future in as_completed(list(futures), loop=client.loop):
                try:
                    outcome = future.result()
                except KilledWorker:
                    outcome = killed(futures[future], "its workers were killed, or crashed")
                except FutureCancelledError:
                    problem = f"the scheduler at {address} has ended"
                    remedy = "run the command again: finished worlds are kept"
                    raise InputError("--cluster", "", problem, remedy) from None
                # No longer among those that the end cancels.
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


def killed(task: WorldTask, reason: str) -> WorldOutcome:
    """The outcome of a world whose workers die."""
    world = task.world()
    failures = dict.fromkeys(task.modules, f"{reason}, each time")
    return WorldOutcome(world.number, world.seed, world.parameters(), failures=failures)
