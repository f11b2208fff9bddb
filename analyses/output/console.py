"""What commands print: tables, lines and progress, alike in a terminal and in a log."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.table import Table
from rich.text import Text

from wrenchsight.analyses.output.compilation import on_first_compilation
from wrenchsight.analyses.output.progress import Progress, ProgressDisplay


def new_console(stderr: bool = False) -> Console:
    """Returns a console that writes no control characters where there is no terminal."""
    console = Console(stderr=stderr, highlight=False)
    if not console.is_terminal:
        return Console(stderr=stderr, highlight=False, width=max(console.width, 120))
    return console


def new_table(first: str, *others: str) -> Table:
    """Returns a table whose first column is text and whose others are figures."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column(first, overflow="fold")
    for heading in others:
        table.add_column(heading, justify="right", overflow="fold")
    return table


def say(console: Console, text: str) -> None:
    """Prints a line as it is: unwrapped, without markup."""
    console.print(text, markup=False, highlight=False, soft_wrap=True)


def plain_text(text: str, style: str = "") -> Text:
    """Returns text that is printed as it is, without the marks of `code`."""
    return Text(text.replace("`", ""), style)


@contextmanager
def showing_progress(name: str) -> Iterator[Callable[[float, str], None]]:
    """Shows how far a piece of work is; the function that it gives takes share and words."""
    with ProgressDisplay(new_console(stderr=True), (name,), fleeting=True) as watch:
        on_first_compilation(lambda what: watch(Progress(name, "running", 0.0, what)))
        watch(Progress(name, "running"))
        yield lambda fraction, what: watch(Progress(name, "running", fraction, what))
        watch(Progress(name, "done", 1.0))
