"""Files that are read up to a largest size: a device such as /dev/zero never ends."""

from pathlib import Path

from wrenchsight.models.files.files_read import about_to_read
from wrenchsight.models.files.input_error import InputError


def read_limited(path: Path, most: int, kind: str, remedy: str = "") -> bytes:
    """Returns the content of a file.

    Args:
        most: bytes that a file of this kind has at most.
        kind: for error lines: "URDF".

    Raises:
        InputError: the file is missing, larger, or cannot be read.
    """
    about_to_read(path)
    try:
        with path.open("rb") as file:
            content = file.read(most + 1)
    except (OSError, ValueError) as error:
        what = getattr(error, "strerror", None) or str(error)
        what = "no such file" if isinstance(error, FileNotFoundError) else what
        raise InputError(path, "", f"{kind}: {what}", remedy) from error
    if len(content) > most:
        raise InputError(path, "", f"{kind}: is larger than {most >> 20} MB", remedy)
    return content
