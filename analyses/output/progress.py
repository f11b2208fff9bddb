"""Progress of long work: bars in a terminal, one line per step in a log."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Self

from wrenchsight.analyses.output.compilation import ANNOUNCEMENT
from wrenchsight.models.files.input_error import printable

if TYPE_CHECKING:
    import rich.progress
    from rich.console import Console

State = Literal["waiting", "running", "done", "earlier", "skipped", "failed", "interrupted"]

ProgressCallback = Callable[[float, str], None]
"""Takes the share that is done, 0 to 1, and what is being done."""

_HEARTBEAT_PERIOD = 20.0  # s between lines in a log
_ENDS = {
    "done": "done",
    "earlier": "kept",
    "skipped": "skipped",
    "failed": "failed",
    "interrupted": "interrupted",
}


@dataclass(frozen=True)
class Progress:
    """What a piece of work, such as an experiment, is doing now."""

    name: str
    state: State
    fraction: float = 0.0  # 0..1
    action: str = ""  # what it is doing
    seconds: float | None = None  # that it took, once it is done


class ProgressDisplay:
    """Draws a bar per piece of work; use as a context manager and call with what happens.

    Where the console is no terminal, such as in a log of continuous integration, it writes plain
    lines and no control characters: when work begins and ends (with the seconds that it took), and
    three times a minute between.

    Args:
        console: where to draw.
        names: names of the pieces of work, in their order.
        fleeting: whether the bars vanish at the end and no line marks beginning and end.
    """

    def __init__(
        self, console: "Console", names: tuple[str, ...], *, fleeting: bool = False
    ) -> None:
        self._console = console
        self._fleeting = fleeting
        self._width = max(map(len, names), default=0)
        self._tasks: dict[str, rich.progress.TaskID] = {}
        self._states: dict[str, str] = {}
        self._last_line: dict[str, float] = {}
        self._bars: rich.progress.Progress | None = None
        if console.is_terminal:
            from rich import progress

            self._bars = progress.Progress(
                progress.TextColumn("{task.description}"),
                progress.BarColumn(bar_width=24),
                progress.TimeElapsedColumn(),
                progress.TextColumn("{task.fields[action]}", style="dim"),
                console=console,
                transient=fleeting,
            )
            for name in names:
                self._tasks[name] = self._bars.add_task(name, total=1.0, start=False, action="")

    def __enter__(self) -> Self:
        if self._bars is not None:
            self._bars.start()
        return self

    def __exit__(self, *ended: object) -> None:
        if self._bars is not None:
            self._bars.stop()

    def __call__(self, progress: Progress) -> None:
        end = _ENDS.get(progress.state, "")
        if progress.seconds is not None:
            end = f"{end} in {progress.seconds:.1f} s"
        action = printable(progress.action)
        message = f"{end}: {action}" if end and action else end or action
        if self._bars is not None:
            from rich.markup import escape

            task = self._tasks[progress.name]
            if progress.state == "waiting":
                if message:  # stays above the bars, which will show other things
                    text = f"{progress.name}: {message}"
                    self._bars.console.print(text, markup=False, soft_wrap=True)
                return
            self._bars.start_task(task)
            self._bars.update(task, completed=progress.fraction, action=escape(message))
            if end:
                self._bars.stop_task(task)
            return
        self._write_line(progress, end, message)

    def _write_line(self, progress: Progress, end: str, message: str) -> None:
        name, now = progress.name, time.monotonic()
        last = self._last_line.setdefault(name, now)
        if progress.state == "waiting":
            text = message
        elif end or self._states.get(name) != progress.state:
            text = "" if self._fleeting else message if end else "started"
        elif message == ANNOUNCEMENT:
            text = message
        else:
            text = (
                f"{100 * progress.fraction:.0f} %  {message}"
                if now - last > _HEARTBEAT_PERIOD
                else ""
            )
        self._states[name] = progress.state
        if text:
            self._last_line[name] = now
            # Not through the console: interrupted, it would write its buffer a second time.
            self._console.file.write(f"{name:<{self._width}}  {text}\n")
            self._console.file.flush()
