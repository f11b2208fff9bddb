"""ROS packages, found as ROS finds them, and without ROS.

In this order: above the file; on ROS_PACKAGE_PATH (folders that are gone through, as rospack does)
and AMENT_PREFIX_PATH (PREFIX/share/PACKAGE); in the workspace around the file, beside the file's
repository and others; last, a folder of its name beside or above the file that has lost its
package.xml.
"""

import os
import re
from collections.abc import Iterable, Iterator
from functools import lru_cache
from pathlib import Path

PACKAGE_NOT_FOUND = "is found neither in the workspace"
"""Words of every message on a package that `find_package` does not find."""

_MAX_FOLDERS = 5_000  # that one search goes through
_MAX_DEPTH = 4  # of a package below the folder that is gone through: src/repository/group/package
_MAX_PARENTS = 6  # of the file that are gone through
_LARGEST_FILE = 1 << 20  # bytes of a package.xml
_NAME = re.compile(rb"<name>\s*([\w.-]+)\s*</name>")
_SKIPPED_FOLDERS = {
    "build",
    "devel",
    "log",
    "node_modules",
    "__pycache__",
    "site-packages",
    "proc",
    "sys",
}


@lru_cache(maxsize=256)
def find_package(name: str, start: Path) -> Path | None:
    """The folder of a package, by the name in its package.xml or its own.

    Args:
        start: folder of the file that asks for it.
    """
    if not name or "/" in name or name in (".", ".."):
        return None
    start = start.resolve()
    for parent in (start, *start.parents):
        for folder in (parent, parent / name):
            if _is_package(folder, name) or (folder.name == name and start.is_relative_to(folder)):
                return folder
    for prefix in _paths("AMENT_PREFIX_PATH"):
        if (folder := prefix / "share" / name).is_dir():
            return folder
    around = [parent for parent in (start, *start.parents)[:_MAX_PARENTS] if _is_searched(parent)]
    for place in (*_paths("ROS_PACKAGE_PATH"), *around):
        found = next((f for f in _packages_below(place) if _is_package(f, name)), None)
        if found is not None:
            return found
    return next((parent / name for parent in around if (parent / name).is_dir()), None)


def folder_that_holds(paths: Iterable[str], start: Path) -> Path | None:
    """The nearest folder above a file, of no package, in which paths of a package are found.

    Args:
        paths: of files, within the package.
        start: folder of the file that asks for them.
    """
    start, wanted = start.resolve(), list(paths)
    around = [parent for parent in (start, *start.parents)[:_MAX_PARENTS] if _is_searched(parent)]
    for folder in around:
        holds_all = wanted and all((folder / path).is_file() for path in wanted)
        if holds_all and not (folder / "package.xml").is_file():
            return folder
    return None


def _paths(variable: str) -> list[Path]:
    return [Path(word) for word in os.environ.get(variable, "").split(os.pathsep) if word]


def _is_searched(folder: Path) -> bool:
    """Whether what lies below a folder around the file may belong to its workspace."""
    return len(folder.parts) > 2 and folder != Path.home()


def _packages_below(top: Path) -> Iterator[Path]:
    """Folders with a package.xml, breadth first; none lies within another."""
    waiting, count = [(top, 0)], 0
    while waiting and count < _MAX_FOLDERS:
        folder, depth = waiting.pop(0)
        count += 1
        try:
            if (folder / "package.xml").is_file():
                yield folder
                continue
            children = sorted(child for child in folder.iterdir() if child.is_dir())
        except OSError:
            continue
        if depth < _MAX_DEPTH:
            waiting += [
                (child, depth + 1)
                for child in children
                if not child.name.startswith(".") and child.name not in _SKIPPED_FOLDERS
            ]


def _is_package(folder: Path, name: str) -> bool:
    """Whether a folder is the package of that name: by its package.xml, or its own name."""
    package_file = folder / "package.xml"
    if not package_file.is_file():
        return False
    if folder.name == name:
        return True
    try:
        with package_file.open("rb") as file:
            match = _NAME.search(file.read(_LARGEST_FILE))
    except OSError:
        return False
    return match is not None and match[1].decode() == name
