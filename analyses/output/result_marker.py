"""The marker of a folder of results: it lists the files that the command wrote.

`.wrenchsight.json` names the command and lists the files that it wrote, with their checksums. What
is not listed there, or not as it was written, is the user's: no command replaces or removes it.
While files are being replaced it lists the new ones, too, so that a kill leaves none unknown.
Hidden files are never results; they stay where they are and do not count.
"""

import hashlib
import json
import os
import stat
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Final

MARKER: Final = ".wrenchsight.json"
_FORMAT_VERSION: Final = 1
_NOTE: Final = "wrenchsight replaces and removes only the files that are listed here"


@dataclass(frozen=True)
class ResultMarker:
    """What a command wrote into a folder."""

    command: str  # that wrote it
    files: Mapping[str, str]  # SHA-256 of each file, by its name relative to the folder (with `/`)
    # the same of files that were being put into their places; "": that was being removed
    replacing: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def read(cls, folder: Path) -> "ResultMarker | None":
        """Returns the folder's marker; None where there is none that can be read."""
        path = folder / MARKER
        try:
            if not stat.S_ISREG(path.lstat().st_mode):
                return None
            content = json.loads(path.read_text(encoding="utf-8"))
            if content["format"] != _FORMAT_VERSION or not isinstance(content["command"], str):
                return None
            files, replacing = (
                {str(name): str(checksum) for name, checksum in content.get(key, {}).items()}
                for key in ("files", "replacing")
            )
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
            return None
        is_ours = all(map(_is_inside, (*files, *replacing)))
        return cls(content["command"], files, replacing) if is_ours else None

    def text(self) -> str:
        """Returns what the marker's file holds; the same for the same files."""
        content = {
            "command": self.command,
            "files": dict(self.files),
            "format": _FORMAT_VERSION,
            "note": _NOTE,
            **({"replacing": dict(self.replacing)} if self.replacing else {}),
        }
        return json.dumps(content, indent=2, sort_keys=True, ensure_ascii=False) + "\n"


def strangers(folder: Path, marker: ResultMarker | None) -> Iterator[str]:
    """Yields the names of visible files below `folder` that are not as a command wrote them.

    Raises:
        OSError: a file or folder cannot be read.
    """
    listed = () if marker is None else (marker.files, marker.replacing)
    for name, path in visible_files(folder):
        if not any(is_as_written(path, files.get(name)) for files in listed):
            yield name


def visible_files(folder: Path) -> Iterator[tuple[str, Path]]:
    """Yields name and path of all below `folder` that is neither a folder nor hidden, in order."""
    for entry in sorted(os.scandir(folder), key=lambda entry: entry.name):
        if entry.name.startswith("."):
            continue
        if entry.is_dir(follow_symlinks=False):
            for name, path in visible_files(folder / entry.name):
                yield f"{entry.name}/{name}", path
        else:
            yield entry.name, folder / entry.name


def is_as_written(path: Path, checksum: str | None) -> bool:
    """Whether `path` is a plain file (no link) with this SHA-256; None: it has none."""
    if checksum is None or not stat.S_ISREG(path.lstat().st_mode):
        return False
    return file_checksum(path) == checksum


def file_checksum(path: Path) -> str:
    """Returns the SHA-256 of a file's content, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _is_inside(name: str) -> bool:
    path = PurePosixPath(name)
    return bool(name) and not path.is_absolute() and ".." not in path.parts
