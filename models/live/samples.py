"""Items of a live source: samples, and events in the place of errors."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from types import MappingProxyType

import numpy as np

from wrenchsight.models.files.input_error import one_line
from wrenchsight.models.numerics.arrays import Array

_NO_SIGNALS: Mapping[str, Array] = MappingProxyType({})
LONGEST_TEXT = 900  # characters of an event; a quotation mark takes two of its row
# What a log calls what its controller aimed at, by the controller's own words.
CONTROLLER_SIGNALS = {"current_desired": "target_current", "tau_desired": "target_moment"}
EVENT_SIZE = 256  # numbers of its row: 2 kB


class EventKind(StrEnum):
    """What can happen to a stream; see `StreamEvent`."""

    CONNECTED = "connected"
    REFUSED = "refused"  # nobody answers, or it is no such controller; it is tried again
    LOST = "lost"  # the connection ended, or fell silent; it is tried again
    GARBAGE = "garbage"  # bytes of no packet; the connection is made anew
    RECIPE = "recipe"  # a packet that was not asked for; it is left out
    SILENT = "silent"  # samples are overdue
    STOPPED = "stopped"  # the robot does not run: protective stop, brakes, no power
    RUNNING = "running"  # it does again
    GAP = "gap"  # samples are missing
    DOUBLED = "doubled"  # a sample came twice; the second is left out
    DISORDERED = "disordered"  # a sample came after a later one; it is left out
    CLOCK = "clock"  # the controller's clock jumped; reading begins anew
    LATE = "late"  # samples come later than they should
    ON_TIME = "on time"  # they do no longer
    START_UP = "start-up"  # samples that waited for the estimator to start
    CHECK = "check"  # what the stream says of units, signs, gravity, load and drives
    CONTRADICTION = "contradiction"  # they contradict the model; no reading is valid
    ZERO = "zero"  # a payload is taken off, or was
    SINK = "sink"  # a recorder or publisher has something to say
    ENDED = "ended"  # the stream is over
    FAILED = "failed"  # source or settings are refused: nothing is read, or no more


@dataclass(frozen=True)
class StreamEvent:
    """Something that happened to a stream.

    Attributes:
        kind: which.
        text: one sentence for a person, one printable line.
        received: s, monotonic clock of this computer.
        count: how many such there were since the stream began, where they are counted.
    """

    kind: EventKind
    text: str
    received: float
    count: int = 1

    def __post_init__(self) -> None:
        object.__setattr__(self, "text", one_line(self.text)[:LONGEST_TEXT])

    @property
    def row(self) -> Array:
        """(EVENT_SIZE,) numbers that bear it from process to process."""
        text = json.dumps([self.kind, self.text, self.received, self.count])
        if len(text) > 8 * EVENT_SIZE:  # of letters that JSON writes at length
            short = self.text.encode("ascii", "replace").decode()
            text = json.dumps([self.kind, short, self.received, self.count])
        return np.frombuffer(text.encode().ljust(8 * EVENT_SIZE, b"\0"))

    @classmethod
    def of_row(cls, row: Array) -> "StreamEvent":
        """The event of such a row."""
        kind, words, received, count = json.loads(row.tobytes().rstrip(b"\0"))
        return cls(EventKind(kind), words, received, count)


@dataclass(frozen=True, eq=False)
class Sample:
    """State that a controller reports of one instant.

    Attributes:
        t: s, the controller's own clock.
        received: s, monotonic clock of this computer.
        q, v: (n,) rad and rad/s (m and m/s).
        effort: (n,) A of the motors, with the drives' sign; or N m on the joint side.
        is_torque: whether it is N m.
        running: whether the robot is powered, its brakes open, and not in a protective stop.
        state: the controller's word for its state, where the robot does not run.
        is_external: whether effort is external torque, positive along the motion that it causes.
        more: further signals, by name.
    """

    t: float
    received: float
    q: Array
    v: Array
    effort: Array
    is_torque: bool = False
    running: bool = True
    state: str = ""
    more: Mapping[str, Array] = field(default_factory=lambda: _NO_SIGNALS)
    is_external: bool = False
