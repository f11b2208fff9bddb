"""Output of commands: tables, lines and progress, the same in a terminal and in a log."""

import logging
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from rich.console import Console, RenderableType
from rich.table import Table
from rich.text import Text

from wrenchsight.analyses.output.compilation import on_first_compilation
from wrenchsight.analyses.output.progress import Progress, ProgressCallback, ProgressDisplay
from wrenchsight.models.files.input_error import printable


def new_console(stderr: bool = False) -> Console:
    """Returns a console that writes no control characters where there is no terminal."""
    console = Console(stderr=stderr, highlight=False)
    if not console.is_terminal:
        return Console(stderr=stderr, highlight=False, width=max(console.width, 120))
    return console


def new_table(first: str, *others: str) -> Table:
    """Returns a table whose first column is text and whose others are figures.

    Headings and cells are shown as they are: "[mm]" is a unit, not rich's markup.
    """
    table = _PrintableTable(box=None, pad_edge=False, header_style="bold")
    table.add_column(Text(first), overflow="fold")
    for heading in others:
        table.add_column(Text(heading), justify="right", overflow="fold")
    return table


class _PrintableTable(Table):
    """A table whose cells hold nothing that a terminal obeys, and no markup: names come out of
    files.
    """

    def add_row(self, *cells: RenderableType | None, **options: Any) -> None:
        """As rich's."""
        shown = (Text(printable(cell)) if isinstance(cell, str) else cell for cell in cells)
        super().add_row(*shown, **options)


def say(console: Console, text: str) -> None:
    """Prints lines as they are: unwrapped, without markup, and nothing that a terminal obeys."""
    lines = "\n".join(printable(line) for line in text.split("\n"))
    console.print(lines, markup=False, highlight=False, soft_wrap=True)


def show(*parts: Table | str) -> None:
    """Prints a command's result on stdout: tables, and lines as `say` does."""
    console = new_console()
    for part in parts:
        if isinstance(part, str):
            say(console, part)
        else:
            console.print(part)


def notes(sentences: Iterable[str]) -> Iterator[str]:
    """Sentences that the user should not miss, as lines for `show`."""
    return (f"note: {sentence}" for sentence in sentences)


def plain_text(text: str, style: str = "") -> Text:
    """Returns text that is printed as it is, without the marks of `code`."""
    return Text(printable(text.replace("`", "")), style)


@contextmanager
def showing_progress(name: str) -> Iterator[ProgressCallback]:
    """Shows how far a piece of work is; the function that it gives takes share and words."""
    # Drake prints Meshcat's address, which is gone before anyone could open it.
    logging.getLogger("drake").setLevel(logging.WARNING)
    with ProgressDisplay(new_console(stderr=True), (name,), fleeting=True) as display:
        on_first_compilation(lambda action: display(Progress(name, "running", 0.0, action)))
        display(Progress(name, "running"))
        yield lambda fraction, action: display(Progress(name, "running", fraction, action))
        display(Progress(name, "done", 1.0))
