"""The compiler of kernels: one dialect, and compiled code that lives as long as its source.

numba keeps a compiled kernel beside its source, under a stamp of that file: it does not notice when
a kernel or a constant of another file changes that this one uses, and it compiles all of a file
anew for a mended docstring. Here the stamp is a digest of the kernel's syntax tree, without
docstrings and annotations, and of the definitions of this package that it uses, directly or not.
So what changed is compiled again, and what calls it, and nothing else.
"""

import ast
import hashlib
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, overload

import numba
from numba import njit
from numba.core import caching
from numba.extending import register_jitable

NO_NEW_ARRAYS = {"_nrt": False}
"""Option of a kernel that makes, returns and stores no array: numba counts no references to those
that it is handed. Counting takes half of what a call from Python does, and most of the time of a
kernel that hands on tuples of arrays. One that makes an array all the same is refused when it is
compiled ("Only accept returning of array passed into the function")."""

NEW_ARRAYS = {"_nrt": True}
"""Option of a kernel that makes arrays where one of NO_NEW_ARRAYS calls it: without either option a
kernel has that of its first caller."""

_Function = TypeVar("_Function", bound=Callable[..., Any])
_Definitions = dict[str, tuple[str, tuple[str, ...]]]

_NAME = "wrenchsight"
_PACKAGE = Path(__file__).resolve().parents[2]


def _date(file: str | Path) -> int:
    """When a file last changed, ns; 0: there is none."""
    try:
        return Path(file).stat().st_mtime_ns
    except OSError:
        return 0


# Dates of the sources, when this process began: what runs is no younger.
_dates = {
    str(file): _date(file)
    for room in ("models", "systems", "diagrams", "analyses")
    for file in (_PACKAGE / room).rglob("*.py")
}


@overload
def kernel(function: _Function) -> _Function: ...
@overload
def kernel(**options: Any) -> Callable[[_Function], _Function]: ...
def kernel(function: Any = None, **options: Any) -> Any:
    """Compiles a function when it is first called, and keeps the result on disk.

    A division by zero gives inf or nan, as in numpy, in every kernel.

    Args:
        options: options of `numba.njit`, such as parallel=True.
    """
    if function is None:
        return lambda function: kernel(function, **options)
    # No entry for callers in C: nobody uses it, and it takes a twelfth of the time to compile.
    compiled: Any = njit(error_model="numpy", no_cfunc_wrapper=True, **options)(function)
    compiled._cache = _Cache(function)
    return compiled


def in_kernels(function: _Function) -> _Function:
    """Lets kernels call a function that stays plain Python where Python calls it.

    It is compiled with each kernel that calls it. Made for functions that name the parts of a
    vector, as views of it: a layout is so stated once for blocks and kernels.
    """
    made: _Function = register_jitable(function)
    return made


def kernel_stamp(file: Path, name: str) -> str:
    """Returns a digest of a top-level definition and of all definitions of this package it uses.

    Args:
        file: file of the module; only what lies in this package is followed further.
        name: name of a function, class or variable at the module's top level.
    """
    digests: dict[tuple[str, str], str] = {}
    ahead = [(str(file.resolve()), name)]
    while ahead:
        place = ahead.pop()
        if place not in digests:
            digests[place], used = _definitions(place[0]).get(place[1], ("", ()))
            for source in used:
                path, _, other = source.rpartition(":")
                ahead.append((path or place[0], other))
    text = "\n".join(f"{Path(p[0]).name} {p[1]} {digests[p]}" for p in sorted(digests))
    return hashlib.sha256(text.encode()).hexdigest()


@cache
def _definitions(file: str) -> _Definitions:
    """Of each function, class and constant of a module: its digest, and the names it uses.

    From these the stamp of a kernel is made: its cached code counts as long as neither it nor
    anything that it uses, directly or not, has changed. Docstrings, comments and annotations of
    functions are no part of a digest.

    Returns:
        By name: digest, and sorted names used: NAME of the same module, or "FILE:NAME" of another
        of this package. All that a name stands for is one digest: a constant that is assigned
        twice, a function with its overloads.
    """
    # A file that has changed since this process began is not what runs in it. Its digests get a
    # random salt: what this process compiles is kept under a stamp that no other process finds.
    date = _date(file)
    salt = b"" if _dates.get(file, date) == date else os.urandom(16)
    imports: dict[str, str] = {}
    nodes: dict[str, list[ast.AST]] = {}
    for node in ast.parse(Path(file).read_bytes()).body:
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(_NAME):
            for alias in node.names:
                if (source := _source(node.module or "")) is not None:
                    imports[alias.asname or alias.name] = f"{source}:{alias.name}"
        elif isinstance(node, ast.FunctionDef | ast.ClassDef):
            # A numba overload belongs to the function that it stands for: @overload(function).
            replaced = [
                ast.unparse(d.args[0])
                for d in node.decorator_list
                if isinstance(d, ast.Call) and ast.unparse(d.func) == "overload"
            ]
            for name in replaced or [node.name]:
                nodes.setdefault(name, []).append(node)
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            for target in ast.walk(node):
                if isinstance(target, ast.Name) and isinstance(target.ctx, ast.Store):
                    nodes.setdefault(target.id, []).append(node)
    result: _Definitions = {}
    for name, group in nodes.items():
        # Bare first: a name that only an annotation uses is not used.
        tree = [_bare(node) for node in group]
        used = {n.id for node in tree for n in ast.walk(node) if isinstance(n, ast.Name)} - {name}
        # `used` holds local names, too: those that are no import or definition here drop out below.
        digest = hashlib.sha256(salt + "".join(map(ast.dump, tree)).encode()).hexdigest()
        result[name] = (
            digest,
            tuple(sorted(imports.get(n, n) for n in used if n in imports or n in nodes)),
        )
    return result


def _source(module: str) -> Path | None:
    """The file of a module of this package; None for a package or what lies elsewhere."""
    file = _PACKAGE.joinpath(*module.split(".")[1:]).with_suffix(".py")
    return file.resolve() if file.is_file() else None


def _bare(node: ast.AST) -> ast.AST:
    """Takes docstrings and annotations away, in place."""
    for part in ast.walk(node):
        if isinstance(part, ast.FunctionDef | ast.ClassDef):
            first = part.body[0]
            if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant):
                part.body = part.body[1:] or [ast.Pass()]
        if isinstance(part, ast.FunctionDef):
            part.returns = None
        elif isinstance(part, ast.arg):
            part.annotation = None
    return node


class _Stamped:
    """A locator of numba's with the stamp of this module."""

    def __init__(self, py_func: Any, py_file: str) -> None:
        super().__init__(py_func, py_file)  # type: ignore[call-arg]
        self._qualname = py_func.__qualname__
        self._file = Path(py_file)

    def get_source_stamp(self) -> str:
        return kernel_stamp(self._file, self._qualname.partition(".")[0])

    def get_disambiguator(self) -> str:
        if "." in self._qualname:
            return str(super().get_disambiguator())  # type: ignore[misc]
        return "0"  # not its line, which a sentence above it moves


class _Implementation(caching.CompileResultCacheImpl):
    _locator_classes = tuple(
        type(kind.__name__, (_Stamped, kind), {})
        for kind in (
            caching.UserProvidedCacheLocator,
            caching.InTreeCacheLocator,
            caching.UserWideCacheLocator,
        )
    )


class _Index(caching.IndexDataCacheFile):
    """The list of what is compiled of one kernel.

    It names the records that the kernel takes. One that has been renamed or moved since makes the
    list unreadable: then nothing is compiled yet.
    """

    def _load_index(self) -> Any:
        try:
            return super()._load_index()
        except (AttributeError, ImportError):
            return {}


class _Cache(caching.FunctionCache):
    """Looks for its file when it is first asked.

    A program calls few of the kernels that it imports, and the stamps of all take half a second.
    """

    _impl_class = _Implementation

    def __init__(self, function: Any) -> None:
        self._function = function
        file = function.__code__.co_filename
        if not file.startswith(str(_PACKAGE)):
            _dates.setdefault(str(Path(file).resolve()), _date(file))

    def __getattr__(self, name: str) -> Any:
        if "_function" not in self.__dict__ or "_impl" in self.__dict__:
            raise AttributeError(name)
        super().__init__(self._function)
        self._cache_file = _Index(
            cache_path=self._cache_path,
            filename_base=self._impl.filename_base,
            source_stamp=self._cache_file._source_stamp,  # type: ignore[has-type]
        )
        return getattr(self, name)


@contextmanager
def one_thread() -> Iterator[None]:
    """Keeps numba's loops in this thread.

    A step is some milliseconds of work in several loops. Waiting for a second thread at the end of
    each costs more than it gives as soon as anything else runs on the machine.
    """
    threads = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        yield
    finally:
        numba.set_num_threads(threads)
