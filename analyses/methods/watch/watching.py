"""The command `watch`: readings of a live robot to terminal, viewer and recorder."""

import threading
import time
from collections.abc import Callable, Sequence
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


class _Screen:
    """The readings of a session on a terminal, until the session ends or its time is over.

    Args:
        settings: what is shown, and for how long.
        session: gives the readings.
        threads: the sinks, whose lost readings are counted too.
        sink_events: what sinks report; taken from here once shown.
        console: to show readings on.

    Attributes:
        summary: summary of the readings so far.
    """

    def __init__(
        self,
        settings: WatchSettings,
        session: LiveSession,
        threads: Sequence[SinkThread],
        sink_events: list[StreamEvent],
        console: Console,
    ) -> None:
        self._session, self._threads, self._console = session, threads, console
        self._sink_events = sink_events
        self._duration = settings.duration_s
        self._shows = settings.view != "none"
        self._is_plain = settings.view == "lines" or not console.is_terminal or not self._shows
        self._reader = session.follow()
        self._end = np.inf
        self._says_legend = True
        self.summary = LiveSummary(settings.source)

    def show(self) -> None:
        """Shows readings as a picture, or as lines where there is no terminal."""
        if self._is_plain:
            self._show_lines()
        else:
            self._show_picture()

    def _show_lines(self) -> None:
        last_line = time.monotonic()
        while self._step():
            if time.monotonic() - last_line >= LINE_TIME:
                last_line = time.monotonic()
                self._say_line()
            time.sleep(0.05)
        self._say_line()

    def _show_picture(self) -> None:
        with Live(console=self._console, auto_refresh=False) as picture:
            while self._step():
                picture.update(self.summary.picture(), refresh=True)
                time.sleep(FRAME_TIME)
            picture.update(self.summary.picture(), refresh=True)

    def _step(self) -> bool:
        """Takes what is new; returns whether there may be more."""
        now = time.monotonic()
        if self._duration and self.summary.last is not None:
            self._end = min(self._end, now + self._duration)  # since the first reading
        is_over = self._session.ended or now >= self._end
        events = self._session.new_events() + self._new_sink_events()
        events = self.summary.add(self._reader.read(), events)
        dropped_by_sinks = sum(thread.reader.dropped for thread in self._threads)
        self.summary.dropped = dropped_by_sinks + self._reader.dropped
        if self._is_plain and self._shows:
            for event in events:
                if event.kind is not EventKind.FAILED:  # which `LiveSession.check` raises
                    say_event(self._console, event)
        return not is_over

    def _new_sink_events(self) -> list[StreamEvent]:
        # One by one: the sinks' threads may add more at any time.
        return [self._sink_events.pop(0) for _ in range(len(self._sink_events))]

    def _say_line(self) -> None:
        if not self._shows or self.summary.last is None:
            return
        if self._says_legend:
            say(self._console, LEGEND)
            self._says_legend = False
        say(self._console, self.summary.line())


def watch(settings: WatchSettings, console: Console) -> int:
    """The command `watch`: reads a robot until it ends, or its time is over.

    Each sink (recorder, served view) follows the session in a thread of its own, so that a slow one
    stops nobody. What sinks report is shown with the readings, or at the end.

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

        sinks = _sinks(settings, session.robot, report)  # each is made in its thread
        threads = [SinkThread(make, session.follow(), report) for make in sinks]
        screen = _Screen(settings, session, threads, sink_events, console)
        try:
            screen.show()
        finally:
            for thread in threads:
                thread.finish()
            for event in sink_events:
                say_event(console, event)
        session.check()  # raises where the process that reads the robot ended by an error
        return screen.summary.count


def _sinks(
    settings: WatchSettings, robot: Robot, report: Callable[[str], None]
) -> list[Callable[[], Sink]]:
    """What makes the recorder and the view of the settings; each is made in its own thread.

    Args:
        report: takes messages.
    """

    def recorder() -> Sink:
        assert settings.record is not None
        folder = Path(settings.record)
        # config.yaml comes with the first reading: a refused source leaves the folder empty.
        config = partial(OutputFolder(folder).write_settings, "config.yaml", settings)
        return Recorder(folder, robot, settings.record_format, config)

    def view() -> Sink:
        served_view = SERVED_VIEWS[settings.view](robot)
        report(f"the arm and its force are at {served_view.url}")
        return served_view

    sinks: list[Callable[[], Sink]] = []
    if settings.record is not None:
        sinks.append(recorder)
    if settings.view in SERVED_VIEWS:
        sinks.append(view)
    return sinks
