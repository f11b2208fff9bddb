"""Display of a live robot: in a terminal, or line by line where there is none."""

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.table import Table
from rich.text import Text

from wrenchsight.analyses.output.console import new_table, plain_text, say
from wrenchsight.models.live.reading import Reading
from wrenchsight.models.live.samples import EventKind, StreamEvent
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.rigid_body.spatial_vectors import WRENCH_AXES

_SHOWN_EVENTS = 6
LEAST_WAIT = 0.01  # s, of a first sample that waited for the estimator to start
LONGEST_START = 2.0  # s after the first reading, at which start-up is over in any case
_WINDOW_READINGS = 2048  # readings that latency and share are taken over
_ALARMS = (
    EventKind.REFUSED,
    EventKind.LOST,
    EventKind.GARBAGE,
    EventKind.SILENT,
    EventKind.STOPPED,
    EventKind.LATE,
    EventKind.CONTRADICTION,
)


@dataclass
class StartUp:
    """Readings of samples that waited for the estimator to start; they show nothing of latency.

    Until the step of a stream is known its samples are held; those that come while the held ones
    are read queue up behind them. Start-up is over with the first sample that comes when none is
    waiting: after the reading before it had gone. A stream whose first sample waited less than
    LEAST_WAIT has none.

    Attributes:
        is_over: whether it is.
        count: readings of it.
        longest: s, that one of their samples waited.
    """

    is_over: bool = False
    count: int = 0
    longest: float = 0.0
    _first: float = 0.0
    _last: float = 0.0

    def take(self, reading: Reading) -> bool:
        """Takes the next reading; whether it belongs to start-up."""
        if self.is_over:
            return False
        if not self.count:
            self._first = reading.published
            self.is_over = reading.latency < LEAST_WAIT
        else:
            is_idle = reading.received >= self._last
            self.is_over = is_idle or reading.published - self._first > LONGEST_START
        if self.is_over:
            return False
        self._last = reading.published
        self.count += 1
        self.longest = max(self.longest, reading.latency)
        return True

    def event(self) -> StreamEvent:
        """The event that reports start-up, once it is over."""
        text = (
            f"the first {self.count} samples waited for the estimator to start, "
            f"{1e3 * self.longest:.0f} ms at most; they do not count in the latency shown"
        )
        return StreamEvent(EventKind.START_UP, text, self._last)


@dataclass
class LiveSummary:
    """Summary that is shown, gathered from readings and events."""

    source: str
    dropped: int = 0
    count: int = 0
    last: Reading | None = None
    events: deque[StreamEvent] = field(default_factory=lambda: deque(maxlen=_SHOWN_EVENTS))
    start_up: StartUp = field(default_factory=StartUp)
    _times: deque[float] = field(default_factory=lambda: deque(maxlen=_WINDOW_READINGS))
    _latencies: deque[float] = field(default_factory=lambda: deque(maxlen=_WINDOW_READINGS))
    _valid: deque[bool] = field(default_factory=lambda: deque(maxlen=_WINDOW_READINGS))

    def add(self, rows: Array, events: list[StreamEvent]) -> list[StreamEvent]:
        """Takes new readings and events; returns the events, with that of start-up."""
        was_starting = not self.start_up.is_over
        for row in rows:
            reading = Reading(row)
            self.count += self.last is None or reading.t != self.last.t
            self._times.append(reading.t)
            if not self.start_up.take(reading):
                self._latencies.append(reading.latency)
            self._valid.append(reading.valid)
            self.last = reading
        if was_starting and self.start_up.is_over and self.start_up.count:
            events = [*events, self.start_up.event()]
        self.events.extend(events)
        return events

    @property
    def rate(self) -> float:
        """Hz of the readings."""
        span = self._times[-1] - self._times[0] if len(self._times) > 1 else 0.0
        return (len(self._times) - 1) / span if span > 0.0 else 0.0

    def latencies(self) -> tuple[float, float]:
        """ms, median and 99th percentile since start-up; NaN where nothing was read since."""
        if not self._latencies:
            return math.nan, math.nan
        p50, p99 = np.percentile(self._latencies, [50.0, 99.0])
        return 1e3 * float(p50), 1e3 * float(p99)

    def _latency(self) -> str:
        p50, p99 = self.latencies()
        return "starting" if math.isnan(p50) else f"latency {p50:.2f} ms (p99 {p99:.2f})"

    def state(self) -> str:
        """State of the last reading in a few words."""
        if self.last is None:
            return "waiting for samples"
        words = ["valid" if self.last.valid else f"NOT VALID ({self.last.reason})"]
        words += ["contact"] if self.last.contact else []
        if self.last.misfit:
            words.append(f"misfit at link {self.last.link}" if self.last.link else "misfit")
        words += ["at rest"] if self.last.rest else []
        words += ["outside the range of the model's logs"] if self.last.out_of_range else []
        return ", ".join(words)

    def line(self) -> str:
        """The summary in one line."""
        numbers = "no reading yet"
        if self.last is not None:
            values = self.last.force_first
            numbers = " ".join(
                f"{axis} {value:.1f}+-{sd:.1f}"
                for axis, value, sd in zip(WRENCH_AXES, values[:6], values[6:], strict=True)
            )
            numbers = f"t {self.last.t:.2f} {numbers}"
        return (
            f"{numbers} | {self.state()} | {self.rate:.0f} Hz, {self._latency()}, "
            f"dropped {self.dropped}"
        )

    def picture(self) -> RenderableType:
        """The summary for a terminal."""
        table = new_table("", "", "sd", "")
        values = self.last.force_first if self.last is not None else np.full(12, np.nan)
        for k, axis in enumerate(WRENCH_AXES):
            unit = "N" if axis.startswith("f") else "N m"
            table.add_row(axis, f"{values[k]:9.2f}", f"{values[6 + k]:.2f}", unit)
        share = 100.0 * float(np.mean(self._valid)) if self._valid else 0.0
        is_valid = self.last is not None and self.last.valid
        state = Text(self.state(), "bold green" if is_valid else "bold red")
        foot = (
            f"{self.rate:.0f} Hz, {self._latency()}, {share:.0f} % valid, "
            f"{self.count} readings, dropped {self.dropped}"
        )
        event_lines = [
            plain_text(f"{event.kind}: {event.text}", "yellow" if event.kind in _ALARMS else "dim")
            for event in self.events
        ]
        head: Table | Text = plain_text(self.source, "bold")
        return Group(head, table, state, plain_text(foot, "dim"), *event_lines)


LEGEND = (
    "fx fy fz in N, mx my mz in N m: by the environment, at the tool, along the base's axes; +- sd"
)


def say_event(console: Console, event: StreamEvent) -> None:
    """Prints an event as one line."""
    count = f" ({event.count} so far)" if event.count > 1 else ""
    say(console, f"{event.kind}: {event.text}{count}")
