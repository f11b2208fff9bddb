"""A page in a user's folder, with a mark by which a command recognises what it wrote.

Folders of results have a marker beside their files (`result_marker`). A page that stands alone ends
with a comment instead, which holds the checksum of all that is above it: a page without it, or that
someone has changed, is the user's.
"""

import hashlib
import os
import stat
from pathlib import Path
from typing import Final

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.whole_file import whole_file, writing_to

_MARK: Final = "<!-- written by wrenchsight; SHA-256 of what is above: {} -->\n"
_REMEDY: Final = "name another file with --out, or move it away"


def refuse_unmarked(path: Path) -> None:
    """Refuses to replace what is not a page that `write_marked` wrote.

    Raises:
        InputError: there is something else, or it has been changed since.
    """
    if not os.path.lexists(path):
        return
    try:
        is_ours = stat.S_ISREG(path.lstat().st_mode) and _is_marked(path.read_bytes())
    except OSError as error:
        problem = f"exists and cannot be read ({error.strerror})"
        raise InputError(path, "", problem, _REMEDY) from None
    if not is_ours:
        raise InputError(path, "", "exists and is not as wrenchsight wrote it", _REMEDY)


def write_marked(path: Path, page: str) -> None:
    """Writes a page and its mark, whole or not at all; replaces only an earlier one of ours.

    Raises:
        InputError: it cannot be written, or what is there is not ours.
    """
    content = page.rstrip("\n").encode("utf-8") + b"\n"
    with whole_file(path) as partial, writing_to(path):
        partial.write_bytes(content + _mark_of(content))
        refuse_unmarked(path)


def _mark_of(content: bytes) -> bytes:
    return _MARK.format(hashlib.sha256(content).hexdigest()).encode()


def _is_marked(data: bytes) -> bool:
    length = len(_mark_of(b""))
    return data[-length:] == _mark_of(data[:-length])
