"""A log as a source, at the pace of its own clock: `replay://FILE`.

Options: `rate`, seconds of the log in one of this computer's (1; 0: as fast as it is read);
`log_format`, as `estimate --log-format`. The file is any log that `estimate` reads.
"""

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from urllib.parse import unquote

import numpy as np

from wrenchsight.models.files.input_error import InputError, printable
from wrenchsight.models.live.samples import CONTROLLER_SIGNALS, EventKind, Sample, StreamEvent
from wrenchsight.models.live.source import MOST_ITEMS, SourceAddress
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_reader import RecordingReader
from wrenchsight.models.robot.robot import Robot

_AT_ONCE = 64  # samples of one call without a rate: few, as the reader can end between two calls


class ReplaySource:
    """Plays a log once.

    Args:
        path: path of the log.
        robot: as `RecordingReader`.
        rate: as `Source`.
        log_format: description of its columns.

    Raises:
        InputError: as `RecordingReader`.
    """

    def __init__(
        self, path: Path, robot: Robot, rate: float = 1.0, log_format: str | None = None
    ) -> None:
        self.rate, self.step = rate, None
        reader = RecordingReader(path, log_format, robot, check=False)
        reader.require_joint_signals()
        self._name = printable(path.name)
        self._samples = _samples(reader.chunks())
        self._next: Sample | None = next(self._samples)  # None: the log is over, or closed
        self._begin: float | None = None  # s by `time.monotonic`, of the log's zero; None: not read

    @classmethod
    def open(cls, address: SourceAddress, robot: Robot) -> "ReplaySource":
        """As `SourceOpener`."""
        address.require_known("rate", "log_format")
        rate = address.number("rate", 1.0, 0.0, 1e6)
        path = Path(unquote(address.place))
        return cls(path, robot, rate, address.options.get("log_format"))

    def read(self, timeout: float) -> list[Sample | StreamEvent]:
        """As `Source.read`: the samples that are due by now, at most some; or after a wait none.

        The first call starts the clock, and says so. With a rate of 0 every sample is due.
        """
        if self._next is None:
            time.sleep(timeout)
            return []
        now = time.monotonic()
        items: list[Sample | StreamEvent] = []
        if self._begin is None:
            self._begin = now - (self._next.t / self.rate if self.rate else 0.0)
            pace = "as fast as it is read"
            if self.rate:
                times = "" if self.rate == 1.0 else f"{self.rate:g} times "
                pace = f"at {times}its own pace"
            text = f"{self._name} is played {pace}"
            items.append(StreamEvent(EventKind.CONNECTED, text, now))
        elif self.rate and self._due(self._next) > now:
            time.sleep(min(self._due(self._next) - now, timeout))
            now = time.monotonic()
        most = MOST_ITEMS if self.rate else _AT_ONCE
        try:
            while self._next is not None and len(items) < most and self._due(self._next) <= now:
                items.append(replace(self._next, received=now))
                self._next = next(self._samples, None)
        except InputError as error:  # of the log's reader: what comes is damaged
            self._next = None
            items.append(StreamEvent(EventKind.GARBAGE, str(error), now))
        if self._next is None:
            items.append(StreamEvent(EventKind.ENDED, f"{self._name} has ended", now))
        return items

    def close(self) -> None:
        """As the protocol."""
        self._next = None

    def _due(self, sample: Sample) -> float:
        """When it is played, s by `time.monotonic`; without a rate at once."""
        assert self._begin is not None
        return self._begin + sample.t / self.rate if self.rate else -np.inf


def _samples(chunks: Iterator[Recording]) -> Iterator[Sample]:
    """The samples of a log, not received yet; efforts are currents, of torques by the drives."""
    for chunk in chunks:
        targets = {
            CONTROLLER_SIGNALS.get(name, name): signal
            for name, signal in chunk.extra.items()
            if signal.shape == chunk.q.shape
        }
        for k, t in enumerate(chunk.t.tolist()):
            targets_now = {name: signal[k] for name, signal in targets.items()}
            yield Sample(t, 0.0, chunk.q[k], chunk.v[k], chunk.current[k], more=targets_now)
