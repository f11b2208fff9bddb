"""The command `watch`: readings of a live robot to terminal, viewer and recorder."""

import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Protocol

import numpy as np
from rich.console import Console
from rich.live import Live

from wrenchsight.analyses.methods.watch.links import link
from wrenchsight.analyses.methods.watch.live_display import LEGEND, LiveSummary, say_event
from wrenchsight.analyses.methods.watch.recorder import Recorder
from wrenchsight.analyses.methods.watch.ring import RingReader
from wrenchsight.analyses.methods.watch.session import LiveSession
from wrenchsight.analyses.methods.watch.watch_config import WatchSettings
from wrenchsight.analyses.output.console import say
from wrenchsight.analyses.output.outputs import OutputFolder
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.live.samples import EventKind, StreamEvent
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.robot import Robot

FRAME_TIME = 0.2  # s between two pictures of a terminal
LINE_TIME = 1.0  # s between two lines where there is none


class Sink(Protocol):
    """Receiver of readings at its own pace; it may be slow.

    Attributes:
        period: s between two calls.
    """

    period: float

    def take(self, rows: list[Array]) -> str:
        """Takes rows of `Reading`; returns a message, or an empty text."""
        ...

    def close(self) -> str:
        """Ends it; returns likewise."""
        ...


class ServedView(Sink, Protocol):
    """A sink that others look at.

    Attributes:
        url: where.
    """

    url: str


SERVED_VIEWS: dict[str, Callable[[Robot], ServedView]] = {
    "meshcat": link("meshcat_view:MeshcatView"),
    "foxglove": link("foxglove_view:FoxgloveView", "view", "--view foxglove"),
}
"""By word of --view. A further kind is one line here, and its word in `watch_config.VIEWS`."""


class SinkThread(threading.Thread):
    """Makes one sink and feeds it, so that no other waits for it.

    All of a sink happens in this thread: Meshcat wants its calls from the thread that made it.

    Args:
        make: makes the sink.
        reader: its place among the readings.
        report: takes messages.

    Attributes:
        reader: with the count of readings that the sink was too slow for.

    Raises:
        InputError: as `make`.
    """

    def __init__(
        self, make: Callable[[], Sink], reader: RingReader, report: Callable[[str], None]
    ) -> None:
        super().__init__(daemon=True)
        self._make, self.reader, self._report = make, reader, report
        self._refusal: InputError | None = None
        self._made, self._finished = threading.Event(), threading.Event()
        self.start()
        self._made.wait()
        if self._refusal is not None:
            raise self._refusal

    def run(self) -> None:
        """Until `finish`."""
        name = "a viewer or recorder"
        try:
            sink = self._make()
            name = type(sink).__name__
            self._made.set()
            while not self._finished.wait(sink.period):
                self._say(sink.take(list(self.reader.read())))
            rows = self.reader.read()
            while len(rows):
                self._say(sink.take(list(rows)))
                rows = self.reader.read()
            self._say(sink.close())
        except InputError as error:
            self._refusal = error
            self._report(str(error))
        except Exception as error:  # of any library: the others go on
            self._report(
                f"{name} failed and gets no more readings ({type(error).__name__}: {error})"
            )
        finally:
            self._made.set()

    def finish(self) -> None:
        """Ends the sink once it has all readings."""
        self._finished.set()
        self.join()

    def _say(self, text: str) -> None:
        if text:
            self._report(text)


def watch(settings: WatchSettings, console: Console) -> int:
    """The command `watch`: reads a robot until it ends, or its time is over.

    Args:
        console: to show readings on.

    Returns:
        How many readings there were.

    Raises:
        InputError: as `LiveSession` and `Recorder`.
    """
    with LiveSession(settings) as session:
        sink_events: list[StreamEvent] = []

        def report(text: str) -> None:
            sink_events.append(StreamEvent(EventKind.SINK, text, time.monotonic()))

        def recorder() -> Sink:
            assert settings.record is not None
            folder = Path(settings.record)
            # config.yaml comes with the first reading: a refused source leaves the folder empty.
            config = partial(OutputFolder(folder).write_settings, "config.yaml", settings)
            return Recorder(folder, session.robot, settings.record_format, config)

        def view() -> Sink:
            served_view = SERVED_VIEWS[settings.view](session.robot)
            report(f"the arm and its force are at {served_view.url}")
            return served_view

        sinks = [recorder] if settings.record is not None else []
        sinks += [view] if settings.view in SERVED_VIEWS else []
        threads = [SinkThread(make, session.follow(), report) for make in sinks]
        summary, reader = LiveSummary(settings.source), session.follow()
        shows = settings.view != "none"
        plain = settings.view == "lines" or not console.is_terminal or not shows
        end, legend = np.inf, LEGEND

        def step() -> bool:
            nonlocal end
            now = time.monotonic()
            if settings.duration_s and summary.last is not None:
                end = min(end, now + settings.duration_s)  # since the first reading
            is_over = session.ended or now >= end
            events = session.new_events() + [sink_events.pop(0) for _ in range(len(sink_events))]
            events = summary.add(reader.read(), events)
            summary.dropped = sum(thread.reader.dropped for thread in threads) + reader.dropped
            if plain and shows:
                for event in events:
                    if not session.is_refusal(event):
                        say_event(console, event)
            return not is_over

        def say_line() -> None:
            nonlocal legend
            if shows and summary.last is not None:
                if legend:
                    say(console, legend)
                    legend = ""
                say(console, summary.line())

        try:
            if plain:
                last_line = time.monotonic()
                while step():
                    if time.monotonic() - last_line >= LINE_TIME:
                        last_line = time.monotonic()
                        say_line()
                    time.sleep(0.05)
                say_line()
            else:
                with Live(console=console, auto_refresh=False) as picture:
                    while step():
                        picture.update(summary.picture(), refresh=True)
                        time.sleep(FRAME_TIME)
                    picture.update(summary.picture(), refresh=True)
        finally:
            for thread in threads:
                thread.finish()
            for event in sink_events:
                say_event(console, event)
        session.check()
        return summary.count
