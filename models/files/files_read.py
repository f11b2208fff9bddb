"""Which files of the user's are being read.

Whatever opens one says so with `about_to_read`. A command that writes into a folder asks to be
told (`told_of_files_read`) and refuses in time what it would replace.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

_listener: ContextVar[Callable[[Path], None] | None] = ContextVar("told of files", default=None)
_remembered: ContextVar[list[Path] | None] = ContextVar("files read", default=None)


def about_to_read(path: str | Path) -> None:
    """Tells whoever asked to be told that a file is going to be read.

    Raises:
        InputError: it must not be, see `told_of_files_read`.
    """
    listener, remembered = _listener.get(), _remembered.get()
    if remembered is not None:
        remembered.append(Path(path))
    if listener is not None:
        listener(Path(path))


@contextmanager
def remembering_files_read() -> Iterator[None]:
    """Has `told_of_files_read`, inside the block, tell also of what was read before it."""
    token = _remembered.set([])
    try:
        yield
    finally:
        _remembered.reset(token)


@contextmanager
def told_of_files_read(listener: Callable[[Path], None]) -> Iterator[None]:
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
