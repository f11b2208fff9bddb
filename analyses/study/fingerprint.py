"""What an experiment's result depends on, as a fingerprint: equal ones mean an equal result.

    software    SHA-256 over the source files that the experiment's module reaches by its imports
                within the four packages, and over every data file of them (robots, scenarios, ...)
    libraries   versions of Python and of what computes the figures
    seed, quick the options; so is `truth`, what simulated arms truly are
    recordings  per folder of real recordings, SHA-256 over its files; None where it is absent

The number of jobs and of threads is no part of it: they must not change a figure.
"""

import ast
import hashlib
import platform
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

PACKAGES: Final = ("models", "systems", "diagrams", "analyses")
LIBRARIES: Final = ("drake", "EAIK", "matplotlib", "numba", "numpy", "pyarrow", "scipy", "torch")
ROOT: Final = Path(__file__).resolve().parents[2]  # holds the four packages
# The runner makes the context and stores the result: no experiment imports it, all depend on it.
_RUNNER: Final = ("wrenchsight.analyses.study.study", "wrenchsight.analyses.study.stored_result")
_NAME: Final = "wrenchsight"
_REPORT: Final = "templates"  # folder of what only the report uses
_BLOCK: Final = 1 << 20  # bytes

Fingerprint = dict[str, Any]


def fingerprint(
    module: str,
    data: Path,
    folders: Iterable[str],
    *,
    seed: int,
    quick: bool,
    truth: str = "own",
) -> Fingerprint:
    """Returns what the result of an experiment depends on, as plain values.

    Args:
        module: of the experiment; not imported.
        data: folder of the real recordings.
        folders: below `data`, which the experiment reads.
        seed: of every random number.
        quick: whether the experiment is shortened.
        truth: of simulated arms.

    Raises:
        OSError: a file cannot be read.
    """
    return {
        "software": software_hash(module),
        "libraries": libraries(),
        "seed": seed,
        "quick": quick,
        "truth": truth,
        "recordings": {name: folder_hash(data / name) for name in sorted(folders)},
    }


def difference(before: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    """Returns in a few words what changed between two fingerprints; empty if nothing did."""
    for key, words in (
        ("seed", "the seed is another"),
        ("quick", "the length is another (--quick)"),
        ("truth", "the simulated truth is another (--truth)"),
        ("software", "the software has changed"),
        ("libraries", "a library's version has changed"),
        ("recordings", "the recordings have changed"),
    ):
        if before.get(key) != now.get(key):
            return words
    return ""


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
    """Returns the SHA-256 of all of this software that `module` can reach.

    The module may lie outside the four packages; of what it imports, they alone count.
    """
    digest = hashlib.sha256()
    files = {file for name in _RUNNER for file in _files_of(name)} | source_files(module)
    for file in sorted((*files, *_data_files()), key=_label):
        digest.update(f"{_label(file)}\0{file_hash(file)}\n".encode())
    return digest.hexdigest()


def source_files(module: str) -> set[Path]:
    """Returns the file of `module` and those it imports, directly or not, within the packages.

    Imports inside functions count as well; a module's packages count with it.
    """
    found: set[Path] = set()
    ahead = list(_files_of(module))
    while ahead:
        file = ahead.pop()
        if file in found:
            continue
        found.add(file)
        for name in _imported(file, file.stat().st_mtime_ns):
            ahead.extend(_files_of(name))
    return found


def folder_hash(folder: Path) -> str | None:
    """Returns the SHA-256 over names and contents of all files in `folder`; None if it is absent.

    Hidden files do not count.
    """
    if not folder.is_dir():
        return None
    digest = hashlib.sha256()
    files = (p for p in folder.rglob("*") if p.is_file())
    for name, file in sorted((p.relative_to(folder).as_posix(), p) for p in files):
        if not any(part.startswith(".") for part in Path(name).parts):
            digest.update(f"{name}\0{file_hash(file)}\n".encode())
    return digest.hexdigest()


def file_hash(path: Path) -> str:
    """Returns the SHA-256 of a file's content."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(_BLOCK):
            digest.update(block)
    return digest.hexdigest()


def _data_files() -> Iterator[Path]:
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*"):
            parts = path.relative_to(ROOT / package).parts
            skipped = ("__pycache__", _REPORT)
            if any(part in skipped or part.startswith(".") for part in parts):
                continue
            if path.is_file() and path.suffix != ".py":
                yield path


def _files_of(module: str) -> list[Path]:
    """Returns the file of a module of the four packages and its packages' own; or of any `module`
    that is looked up by name and lies outside.
    """
    first, *parts = module.split(".")
    if first != _NAME:
        spec = find_spec(first)
        return [Path(spec.origin)] if spec is not None and spec.origin is not None else []
    files = []
    for depth in range(1, len(parts) + 1):
        path = ROOT.joinpath(*parts[:depth])
        candidates = (path / "__init__.py", path.with_suffix(".py"))
        files += [candidate for candidate in candidates if candidate.is_file()]
    return files


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
