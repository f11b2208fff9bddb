"""Which files of the user's are being read.

Whatever opens one says so with `about_to_read`. A command that writes into a folder asks to be
told (`told_of_files_read`) and refuses in time what it would replace.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

_listener: ContextVar[Callable[[Path], None] | None] = ContextVar("told of files", default=None)


def about_to_read(path: str | Path) -> None:
    """Tells whoever asked to be told that a file is going to be read.

    Raises:
        InputError: it must not be, see `told_of_files_read`.
    """
    listener = _listener.get()
    if listener is not None:
        listener(Path(path))


@contextmanager
def told_of_files_read(listener: Callable[[Path], None]) -> Iterator[None]:
    """Calls `listener` with the path of each file before it is read inside the block.

    Args:
        listener: may raise InputError; the file is then not read.
    """
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)
