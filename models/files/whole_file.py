"""A file that is written whole or not at all."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from models.files.input_error import InputError


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """Gives a path beside `path` to write to; renames it to `path` if the block ends without error.

    Until then `path` is as it was. After an error or an interrupt nothing of the attempt is left.

    Raises:
        InputError: the file cannot be made there: no folder, no permission; or not be written to
            its end: a full disk.
    """
    path = Path(path)
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        with writing_to(path), partial.open("wb"):
            pass  # a place that cannot be written to is found before the work, not after it
        try:
            yield partial
        except OSError as error:
            if error.filename not in (None, str(partial)):  # of another file, which is read
                raise
            with writing_to(path):
                raise
        with writing_to(path):
            with partial.open("rb") as file:
                os.fsync(file.fileno())  # the content must be on the disk before its name is
            partial.replace(path)
    finally:
        with suppress(OSError):  # it is not there, or neither is its folder
            partial.unlink()


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
