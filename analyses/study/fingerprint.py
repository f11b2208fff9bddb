"""Fingerprints of software, libraries and recordings, on which an experiment's result depends."""

import ast
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
# The runner makes the context and stores the result: all experiments depend on it, none imports it.
_RUNNER: Final = ("wrenchsight.analyses.study.study", "wrenchsight.analyses.study.stored_result")
_NAME: Final = "wrenchsight"
_NO_DATA: Final = ("__pycache__", "templates")  # templates are for the report alone


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
    """Returns the SHA-256 of all source that `module` can reach, and of the packages' data files.

    These are the source files that it imports, directly or not, within the four packages, and every
    data file of them (robots, scenarios, ...). The module itself, which is not imported, may lie
    outside.
    """
    runner = {file for name in _RUNNER for file in _files_of(name)}
    files = {*runner, *source_files(module), *_data_files()}
    return _hash_of({_label(file): file for file in files})


def source_files(module: str) -> set[Path]:
    """Returns the file of `module` and those it imports, directly or not, within the packages.

    It follows imports inside functions, too, and adds the packages that hold a module.
    """
    files: set[Path] = set()
    pending = _files_of(module)
    while pending:
        file = pending.pop()
        if file not in files:
            files.add(file)
            for name in _imported(file, file.stat().st_mtime_ns):
                pending += _files_of(name)
    return files


def recordings_hash(folder: Path) -> str | None:
    """Returns the SHA-256 over the visible files of a folder; None where it is absent."""
    if not folder.is_dir():
        return None
    return _hash_of({name: path for name, path in visible_files(folder) if path.is_file()})


def _hash_of(files: dict[str, Path]) -> str:
    """The SHA-256 over names and contents."""
    sums = (f"{name}\0{file_checksum(files[name])}\n" for name in sorted(files))
    return hashlib.sha256("".join(sums).encode()).hexdigest()


def _data_files() -> Iterator[Path]:
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*"):
            parts = path.relative_to(ROOT).parts
            if path.suffix == ".py" or any(p in _NO_DATA or p.startswith(".") for p in parts):
                continue
            if path.is_file():
                yield path


def _files_of(module: str) -> list[Path]:
    """Returns the file of a module of the four packages and its packages' own; or of any `module`
    that is looked up by name and lies outside.
    """
    package, *parts = module.split(".")
    if package != _NAME:
        outside = module_file(module)
        return [] if outside is None else [outside]
    paths = (ROOT.joinpath(*parts[: depth + 1]) for depth in range(len(parts)))
    candidates = (
        file for path in paths for file in (path / "__init__.py", path.with_suffix(".py"))
    )
    return [candidate for candidate in candidates if candidate.is_file()]


@cache
def _imported(file: Path, changed: int) -> frozenset[str]:
    """Returns the names of the packages' modules that a file imports.

    Of `from a.b import c`, c may be a module or a name in a.b: `_files_of` takes it as either.
    """
    names = set()
    try:
        tree = ast.parse(file.read_bytes())
    except (SyntaxError, ValueError):  # running it will say so; its content counts all the same
        return frozenset()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module is not None and node.level == 0:
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return frozenset(name for name in names if name.startswith(f"{_NAME}."))


def _label(file: Path) -> str:
    return file.relative_to(ROOT).as_posix() if file.is_relative_to(ROOT) else file.name
