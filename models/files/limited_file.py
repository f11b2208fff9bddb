"""Files that are opened or read whole, up to a largest size: a device such as /dev/zero never ends.

A file that cannot be read is reported in one line.
"""

from pathlib import Path
from typing import BinaryIO

from wrenchsight.models.files.files_read import about_to_read
from wrenchsight.models.files.input_error import InputError


def opened(path: Path, expected: str, remedy: str = "check the path") -> BinaryIO:
    """Opens a file.

    Args:
        expected: what it should be, for error lines: "a URDF".

    Raises:
        InputError: no such file, a directory, or one that may not be read.
    """
    try:
        return path.open("rb")
    except (OSError, ValueError) as error:
        raise _unreadable(path, error, expected, remedy) from error


def read_limited(path: Path, limit: int, expected: str, remedy: str = "check the path") -> bytes:
    """Returns the content of a file.

    Args:
        limit: bytes, largest size of a file of this kind.
        expected: as `opened`.

    Raises:
        InputError: the file is missing, larger, or cannot be read.
    """
    about_to_read(path)
    try:
        with path.open("rb") as file:
            content = file.read(limit + 1)
    except (OSError, ValueError) as error:
        raise _unreadable(path, error, expected, remedy) from error
    if len(content) > limit:
        problem = f"is larger than {limit >> 20} MB, expected {expected}"
        raise InputError(path, "", problem, remedy)
    return content


def _unreadable(path: Path, error: Exception, expected: str, remedy: str) -> InputError:
    if isinstance(error, FileNotFoundError):
        return InputError(path, "", "no such file", remedy)
    if isinstance(error, IsADirectoryError):
        problem = f"is a directory, expected {expected}"
        return InputError(path, "", problem, "name a file in it")
    reason = getattr(error, "strerror", None) or str(error)
    return InputError(path, "", f"cannot be read ({reason})", remedy)
