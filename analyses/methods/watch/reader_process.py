"""The process that reads a robot: source, estimator, publishers; readings go into a ring.

`session.LiveSession` starts it. It stands alone so that nobody who looks at readings makes them
late. It ends with its stream, or when its standard input does: with the process that started it.
"""

import gc
import os
import pickle
import select
import signal
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace

import numba
import numpy as np

from wrenchsight.analyses.methods.watch.load_search import LoadSearch
from wrenchsight.analyses.methods.watch.publishers import Publisher, open_publisher
from wrenchsight.analyses.methods.watch.replay_source import ReplaySource
from wrenchsight.analyses.methods.watch.ring import Ring
from wrenchsight.analyses.methods.watch.sources import open_source
from wrenchsight.analyses.methods.watch.start_checks import StartChecks
from wrenchsight.analyses.methods.watch.watch_config import WatchSettings, load_watched
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.live.event_gate import EventGate
from wrenchsight.models.live.live_estimator import LiveEstimator
from wrenchsight.models.live.reading import Reading, row_size
from wrenchsight.models.live.samples import EVENT_SIZE, EventKind, Sample, StreamEvent
from wrenchsight.models.live.source import Source
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.robot import Robot

READING_COUNT = 1 << 14  # rows of the ring: half a minute at 500 Hz
EVENT_COUNT = 256  # rows of that of events
_MAX_WAIT = 0.02  # s, longest wait for the source
_INTERRUPTIONS = (EventKind.LOST, EventKind.GARBAGE, EventKind.REFUSED, EventKind.ENDED)
# samples that compile what is still to be compiled, and s
_WARMING_SAMPLES, _WARMING_STEP = 560, 0.01

Emit = Callable[[Reading | StreamEvent], None]


def read_stream(
    source: Source,
    live: LiveEstimator,
    emit: Emit,
    checks: StartChecks | None = None,
    go_on: Callable[[], bool] = lambda: True,
    q_offset: Array | None = None,
) -> None:
    """Reads a source until it ends, or `go_on` returns False.

    The source gives samples and events. A sample becomes no reading, one or several (of samples
    that it fills a gap to); where nothing comes, the estimator says so by readings, too. Of events
    that each message may bear, one a second is passed on (`EventGate`).

    Args:
        live: that reads it.
        emit: given each reading and event, of the source, the checks or the estimator, at once.
        checks: of the first seconds; None: the stream is not checked.
        q_offset: (n,) rad (m), added to the positions; None: they are at the robot's zeros already.
    """
    gate = EventGate()
    while go_on():
        items = source.read(_MAX_WAIT)
        for item in items:
            if isinstance(item, Sample):
                sample = item
                # A sample of another size is refused by the estimator.
                if q_offset is not None and sample.q.shape == q_offset.shape:
                    sample = replace(sample, q=sample.q + q_offset)
                results = live.take(sample)  # before the checks, which ask it what is possible
                if checks is not None and (event := checks.take(sample, live)) is not None:
                    emit(event)
            else:
                if gate.passes(item):
                    emit(item)
                results = live.interrupt(item.received) if item.kind in _INTERRUPTIONS else []
            for result in results:  # readings and events
                if isinstance(result, Reading) or gate.passes(result):
                    emit(result)
                if checks is not None and isinstance(result, Reading):
                    checks.add(result)
            if isinstance(item, StreamEvent) and item.kind is EventKind.ENDED:
                return
        if not items:
            for result in live.idle(time.monotonic()):
                emit(result)


def warm_up(settings: WatchSettings, robot: Robot, model: IdentifiedModel) -> None:
    """Compiles what reading takes, before the first sample comes."""
    live = LiveEstimator(robot, model, settings.watch.live, _WARMING_STEP, 0.0)
    checks, search = StartChecks(robot, model, settings.watch), LoadSearch(robot, model)
    one = np.ones(robot.num_joints)
    for k in range(_WARMING_SAMPLES):
        t = k * _WARMING_STEP + (0.001 if k > _WARMING_SAMPLES // 2 else 0.0)
        angle = 0.2 * np.sin(t)
        sample = Sample(t, t, robot.home + angle * one, 0.2 * np.cos(t) * one, one)
        items = live.take(sample)
        checks.take(sample, live)
        search.add_sample(sample)
        for item in items:
            if isinstance(item, Reading):
                checks.add(item)
                search.add_reading(item)
    search.look(sample.t, live.estimator)


def make_live(
    settings: WatchSettings, robot: Robot, model: IdentifiedModel, source: Source
) -> LiveEstimator:
    """The reader of a source as the settings want it."""
    live = LiveEstimator(robot, model, settings.watch.live, source.step, source.rate)
    live.lacks_model = settings.model is None  # nothing holds the stated band to the arm
    return live


def main(readings: Ring, events: Ring, wake: int) -> int:
    """Reads what the settings on standard input ask for; returns the exit code.

    It ends with the source, with an InputError (which becomes the last event), or when the process
    that started it has gone.

    Args:
        readings, events: rings of shared memory, which the process that started this one reads.
        wake: file descriptor of a pipe; a byte in it says that there is something to read.
    """
    requested: WatchSettings = pickle.load(sys.stdin.buffer)  # of the process that started this one
    numba.set_num_threads(1)  # samples come one by one
    os.set_blocking(wake, False)  # a full pipe wakes the reader anyway
    publishers: list[Publisher] = []

    def emit(item: Reading | StreamEvent) -> None:
        if isinstance(item, Reading):
            for publisher in publishers:
                publisher.send(item)
            item.publish(time.monotonic())
            readings.write(item.row)
        else:
            events.write(item.row)
        with suppress(BlockingIOError, BrokenPipeError):  # nobody waits
            os.write(wake, b".")

    def starter_is_alive() -> bool:
        """It holds standard input open, and writes nothing more: readable means closed."""
        ready, _, _ = select.select([sys.stdin], [], [], 0.0)
        return not ready

    source: Source | None = None
    checks: StartChecks | None = None
    try:
        settings, robot, model = load_watched(requested)
        source = open_source(settings.source, robot)
        # One by one: of those before one that cannot be opened, all are closed.
        publishers.extend(open_publisher(url, robot) for url in settings.publish)
        warm_up(settings, robot, model)
        if settings.watch.check:
            # As fast as samples are read, they wait for the checks: a log gives the same each time.
            checks = StartChecks(robot, model, settings.watch, in_background=source.rate > 0.0)
        live = make_live(settings, robot, model, source)
        # What lives until the end need not be gone through at each collection between samples.
        gc.collect()
        gc.freeze()
        # A log's reader has put its positions at the robot's zeros.
        is_log = isinstance(source, ReplaySource)
        q_offset = robot.q_offset if robot.q_offset.any() and not is_log else None
        read_stream(source, live, emit, checks, starter_is_alive, q_offset)
    except InputError as error:
        emit(StreamEvent(EventKind.FAILED, str(error), time.monotonic()))
        return 2
    finally:
        if checks is not None:
            checks.close()
        if source is not None:
            source.close()
        for publisher in publishers:
            publisher.close()
    return 0


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the process that started it ends it
    fd_readings, fd_events, fd_wake, joints = (int(word) for word in sys.argv[1:])
    code = main(
        Ring(row_size(joints), READING_COUNT, fd_readings),
        Ring(EVENT_SIZE, EVENT_COUNT, fd_events),
        fd_wake,
    )
    sys.exit(code)
