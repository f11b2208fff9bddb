"""A file that is written whole or not at all."""

import fcntl
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from wrenchsight.models.files.input_error import InputError


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """Gives a path beside `path` to write to; renames it to `path` if the block ends without error.

    Until then `path` is as it was. An error or an interrupt leaves nothing behind; the next attempt
    removes what a kill left.

    Raises:
        InputError: the file cannot be made there: no folder, no permission; or not be written to
            its end: a full disk.
    """
    path = Path(path)
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    descriptor = -1
    try:
        with writing_to(path):  # a place that cannot be is found before the work, not after it
            _remove_left_overs(path)
            flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC
            descriptor = os.open(partial, flags, 0o666)
        # Until it is closed, another process's `_remove_left_overs` leaves this file alone.
        _locked(descriptor)
        try:
            yield partial
        except OSError as error:
            if error.filename not in (None, str(partial)):  # of another file, which is read
                raise
            with writing_to(path):  # makes an InputError of it
                raise
        with writing_to(path):
            with partial.open("rb") as file:
                os.fsync(file.fileno())  # the content must be on the disk before its name is
            partial.replace(path)
    finally:
        with suppress(OSError):  # it is not there, or neither is its folder
            partial.unlink()
        if descriptor >= 0:
            os.close(descriptor)


def _remove_left_overs(path: Path) -> None:
    """Removes the partial files of killed processes: a living one holds the lock on its file."""
    ours = re.compile(rf"\.{re.escape(path.name)}\.[0-9]+\.partial")
    entries: list[os.DirEntry[str]] = []
    with suppress(OSError):  # one may write to a folder that one may not list
        entries = list(os.scandir(path.parent))
    for entry in entries:
        if ours.fullmatch(entry.name) and entry.is_file(follow_symlinks=False):
            with suppress(OSError), Path(entry.path).open("rb") as file:  # another was faster
                if _locked(file.fileno()):
                    Path(entry.path).unlink()


def _locked(descriptor: int) -> bool:
    """Whether this process now holds the file's lock; the system releases it when it dies."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:  # another process has it, or the file system knows no locks
        return False
    return True


@contextmanager
def writing_to(path: str | Path) -> Iterator[None]:
    """Turns an error of the file system (a full disk, a missing folder) into an InputError.

    Raises:
        InputError: an OSError was raised in the block.
    """
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)
        remedy = "choose a folder that exists, can be written to and has space left"
        raise InputError(path, "", f"cannot be written ({reason})", remedy) from error
