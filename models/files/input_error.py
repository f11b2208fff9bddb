"""The exception for errors in a user's input."""

import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final


class InputError(ValueError):
    """An error in what a user supplied; `str()` is the one line that the user reads.

    The line names the file, the place in it, what is wrong (and what was expected), and what to
    do. The command line prints it and exits with code 2.

    Args:
        source: the file, folder or option that is wrong.
        place: line, row, column, key or joint inside it; empty where there is none.
        problem: what is wrong, and what was expected instead.
        remedy: what to do about it.
    """

    def __init__(self, source: str | Path, location: str, problem: str, remedy: str = "") -> None:
        subject = f"{source}: {location}" if location else str(source)
        line = f"{subject}: {problem}" + (f"; {remedy}" if remedy else "")
        super().__init__(one_line(line))


@contextmanager
def needing_extra(extra: str, source: str) -> Iterator[None]:
    """Turns a failed import of an optional package into an error that names the extra to install.

    Args:
        extra: extra of this package, to which the imports of the `with` block belong.
        source: the option or source that needs them.

    Raises:
        InputError: a package is not installed.
    """
    try:
        yield
    except ImportError as error:
        problem = f"needs a package that is not installed ({error.name})"
        raise InputError(source, "", problem, install_of(extra)) from None


def install_of(extra: str) -> str:
    """The command that installs an extra of this package, with the Python that runs now."""
    python, on_path = Path(sys.executable), shutil.which("python")
    if on_path is not None and Path(on_path) == python:
        return f"python -m pip install 'wrenchsight[{extra}]'"
    if python.is_relative_to(Path.cwd()):
        python = python.relative_to(Path.cwd())
    return f"{python} -m pip install 'wrenchsight[{extra}]'"


LONGEST_LINE: Final = 1000  # characters, of an error line


def one_line(text: str) -> str:
    """`text` as a line that a person can read: printable, and shortened in the middle."""
    line = printable(" ".join(text[: 8 * LONGEST_LINE].split()))
    if len(line) <= LONGEST_LINE:
        return line
    half = LONGEST_LINE // 2 - 5
    return f"{line[:half]} [...] {line[-half:]}"


def printable(text: str) -> str:
    """`text` with control characters and those that cannot be shown written as `\\x1b` and so on.

    A cell of a log or the name of a file may hold escape sequences, or bytes that are no UTF-8.
    """
    return "".join(
        c if c.isprintable() else c.encode("unicode_escape", "surrogatepass").decode("ascii")
        for c in text
    )
