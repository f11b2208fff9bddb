"""A live robot from Python: `with live("rtde://192.168.1.10", "ur10e", "model.yaml") as session`.

Its process ends with the block; `for reading in session` gives each reading once.
"""

import os
import pickle
import select
import subprocess
import sys
import time
from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from wrenchsight.analyses.methods.watch.reader_process import EVENT_COUNT, READING_COUNT
from wrenchsight.analyses.methods.watch.ring import Ring, RingReader
from wrenchsight.analyses.methods.watch.watch_config import (
    WatchConfig,
    WatchSettings,
    load_watched,
)
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.live.reading import Reading, row_size
from wrenchsight.models.live.samples import EVENT_SIZE, EventKind, StreamEvent
from wrenchsight.models.robot.robot import Robot

_MODULE = "wrenchsight.analyses.methods.watch.reader_process"
_EVENTS_HELD = 100
_REFUSED_CODE = 2  # exit code of a reading process that refused its settings or its source
_END_TIME = 3.0  # s that the reading process has to end by itself


class LiveSession:
    """A robot, read in a process of its own; iteration gives each reading once.

    Args:
        settings: as of the command `watch`; view and record are not used.

    Attributes:
        robot, model: as loaded.
        events: the newest ones, the oldest first.

    Raises:
        InputError: as `load_watched`.
    """

    def __init__(self, settings: WatchSettings) -> None:
        checked, robot, model = load_watched(settings)
        self.robot: Robot = robot
        self.model: IdentifiedModel = model
        self.events: deque[StreamEvent] = deque(maxlen=_EVENTS_HELD)
        self._readings = Ring(row_size(self.robot.num_joints), READING_COUNT)
        self._event_ring = Ring(EVENT_SIZE, EVENT_COUNT)
        self._reader = RingReader(self._readings)
        self._event_reader = RingReader(self._event_ring)
        self._wake, wake = os.pipe()
        os.set_blocking(self._wake, False)
        descriptors = self._readings.descriptor, self._event_ring.descriptor, wake
        arguments = [str(number) for number in (*descriptors, self.robot.num_joints)]
        self._process = subprocess.Popen(
            [sys.executable, "-m", _MODULE, *arguments],
            stdin=subprocess.PIPE,
            pass_fds=descriptors,
            env={**os.environ, "NUMBA_NUM_THREADS": "1"},
        )
        os.close(wake)
        assert self._process.stdin is not None
        with suppress(BrokenPipeError):
            pickle.dump(checked, self._process.stdin)
            self._process.stdin.flush()

    def __enter__(self) -> "LiveSession":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def dropped(self) -> int:
        """Readings that were overwritten before this iterator took them."""
        return self._reader.dropped

    @property
    def ended(self) -> bool:
        """Whether the reading process has ended."""
        return self._process.poll() is not None

    def follow(self) -> RingReader:
        """Another reader of the same readings, rows of `Reading`, at its own pace."""
        return RingReader(self._readings)

    def new_events(self) -> list[StreamEvent]:
        """Events since the last call; also added to `events`."""
        events = [StreamEvent.of_row(row) for row in self._event_reader.read()]
        self.events.extend(events)
        return events

    def __iter__(self) -> Iterator[Reading]:
        """Each reading once, in order, as soon as it is there; until the stream ends.

        Raises:
            InputError: the source cannot be read at all.
        """
        while True:
            has_ended = self.ended  # read before the last readings are taken
            yield from self.take()
            if has_ended:
                break
            self.wait(0.1)
        self.check()

    def take(self) -> list[Reading]:
        """The readings that are new."""
        self.new_events()
        return [Reading(row) for row in self._reader.read()]

    def wait(self, timeout: float) -> None:
        """Waits until something is new, for `timeout` s at most."""
        ready, _, _ = select.select([self._wake], [], [], timeout)
        if ready:
            with suppress(BlockingIOError):
                if not os.read(self._wake, 1 << 16):  # the other end is gone
                    time.sleep(0.01)

    def check(self) -> None:
        """Raises an error if the reading process failed.

        Raises:
            InputError: it refused its settings or its source.
            RuntimeError: it broke.
        """
        code = self._process.poll()
        self.new_events()
        if code == _REFUSED_CODE:
            reasons = [event.text for event in self.events if event.kind is EventKind.FAILED]
            raise InputError("watch", "", reasons[-1] if reasons else "the source cannot be read")
        if code:
            raise RuntimeError(f"the process that reads the robot failed (exit code {code})")

    def close(self) -> None:
        """Ends the reading process."""
        if self._process.stdin is not None:
            with suppress(OSError):
                self._process.stdin.close()
        try:
            self._process.wait(_END_TIME)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self._wake >= 0:
            os.close(self._wake)
            self._readings.close()
            self._event_ring.close()
            self._wake = -1


def live(
    source: str,
    robot: str | Path,
    model: str | Path | None = None,
    config: WatchConfig | None = None,
    publish: tuple[str, ...] = (),
) -> LiveSession:
    """Reads a live robot:

        with live("rtde://192.168.1.10", "ur10e", "model.yaml") as session:
            for reading in session:
                if reading.valid:
                    ...  # reading.wrench, reading.sd

    Args:
        source: its URL, see docs/live.md.
        robot, model: as `estimate_log`.
        config: how it is read.
        publish: addresses that each reading is also sent to, at once.

    Raises:
        InputError: as `LiveSession`.
    """
    model_path = None if model is None else str(model)
    settings = WatchSettings(
        source=source, robot=str(robot), model=model_path, publish=list(publish), view="none"
    )
    return LiveSession(replace(settings, watch=config if config is not None else WatchConfig()))
