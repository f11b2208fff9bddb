"""The user's files that are read, announced before they are.

Code that opens one announces it with `about_to_read`. A command that writes into a folder listens
(`reporting_files_read`), and refuses in time to read files that it would replace. A pipe is
refused: it can be read only once, and opening one that nobody writes to would wait for ever.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

from wrenchsight.models.files.input_error import InputError

_listener: ContextVar[Callable[[Path], None] | None] = ContextVar("told of files", default=None)
_remembered: ContextVar[list[Path] | None] = ContextVar("files read", default=None)


def about_to_read(path: str | Path) -> None:
    """Announces to the listener, if any, that a file is going to be read.

    Raises:
        InputError: it is a pipe; or it must not be read, see `reporting_files_read`.
    """
    try:
        pipe = Path(path).is_fifo()
    except (OSError, ValueError):  # whoever opens it says what is wrong with it
        pipe = False
    if pipe:
        raise InputError(path, "", "is a pipe", "write its content to a file, and name that")
    listener, remembered = _listener.get(), _remembered.get()
    if remembered is not None:
        remembered.append(Path(path))
    if listener is not None:
        listener(Path(path))


@contextmanager
def remembering_files_read() -> Iterator[None]:
    """Within the block, `reporting_files_read` reports also the files read before it."""
    token = _remembered.set([])
    try:
        yield
    finally:
        _remembered.reset(token)


@contextmanager
def reporting_files_read(listener: Callable[[Path], None]) -> Iterator[None]:
    """Calls `listener` with the path of each file before it is read inside the block.

    Args:
        listener: may raise InputError; the file is then not read.
    """
    for path in _remembered.get() or ():
        listener(path)
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)
