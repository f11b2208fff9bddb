"""One writer a folder at a time."""

import errno
import fcntl
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.whole_file import writing_to

LOCK = ".lock"
_FLAGS = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK


@contextmanager
def sole_writer(folder: Path, who: str = "run") -> Iterator[None]:
    """Holds a lock on `folder` inside the block: two runs would take each other's files away.

    The system releases it when the process dies, for whatever reason. What is locked is a hidden
    file, removed at the end: a folder itself cannot be locked on every file system.

    Args:
        who: what another writer is called, in the refusal.

    Raises:
        InputError: another run holds it; the folder cannot be written to; a pipe has that name.
    """
    path = folder / LOCK
    while True:
        with writing_to(path):
            # No truncation: a file of the user's may have this name.
            descriptor = os.open(path, _FLAGS, 0o666)
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            os.close(descriptor)
            remedy = "choose another folder with --out, or move it away"
            raise InputError(path, "", "is no plain file", remedy)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno in (errno.EAGAIN, errno.EACCES):
                os.close(descriptor)
                problem = f"another {who} is writing in this folder"
                remedy = "wait for it or choose another --out"
                raise InputError(folder, "", problem, remedy) from None
            # A file system without locks: better unguarded than not at all.
        if _is_open_file(path, descriptor):
            break
        os.close(descriptor)  # the one before removed it after it was opened here
    try:
        yield
    finally:
        with suppress(OSError):
            if os.fstat(descriptor).st_size == 0:
                path.unlink()
        os.close(descriptor)


def _is_open_file(path: Path, descriptor: int) -> bool:
    try:
        return os.path.samestat(path.stat(), os.fstat(descriptor))
    except FileNotFoundError:
        return False
