"""What an experiment's result depends on: source, libraries and recordings, as SHA-256.

Any change of the source or of a data file of the four packages makes every earlier result old.
"""

import hashlib
import platform
from collections.abc import Iterator
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Final

from wrenchsight.analyses.output.result_marker import file_checksum, visible_files
from wrenchsight.analyses.study.registry import module_file

PACKAGES: Final = ("models", "systems", "diagrams", "analyses")
LIBRARIES: Final = ("drake", "EAIK", "matplotlib", "numba", "numpy", "pyarrow", "scipy", "torch")
ROOT: Final = Path(__file__).resolve().parents[2]  # holds the four packages
_NO_SOURCE: Final = ("__pycache__", "templates")  # templates are for the report alone


@cache
def libraries() -> dict[str, str]:
    """Returns the versions of Python and of the libraries that compute figures."""
    versions = {"python": platform.python_version()}
    for name in LIBRARIES:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            versions[name] = "absent"
    return versions


def software_hash(module: str) -> str:
    """Returns the SHA-256 of the four packages, and of the file of a `module` outside of them."""
    files = {path.relative_to(ROOT).as_posix(): path for path in _package_files()}
    outside = module_file(module)
    if outside is not None and not outside.resolve().is_relative_to(ROOT):
        files[outside.name] = outside
    return _hash_of(files)


def recordings_hash(folder: Path) -> str | None:
    """Returns the SHA-256 over the visible files of a folder; None where it is absent."""
    if not folder.is_dir():
        return None
    return _hash_of({name: path for name, path in visible_files(folder) if path.is_file()})


def _hash_of(files: dict[str, Path]) -> str:
    """The SHA-256 over names and contents."""
    sums = (f"{name}\0{file_checksum(files[name])}\n" for name in sorted(files))
    return hashlib.sha256("".join(sums).encode()).hexdigest()


def _package_files() -> Iterator[Path]:
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*"):
            parts = path.relative_to(ROOT).parts
            hidden = any(part in _NO_SOURCE or part.startswith(".") for part in parts)
            if path.is_file() and not hidden:
                yield path
