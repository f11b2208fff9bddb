"""Which kernels a compiled function calls, chosen when it is compiled.

A tick is one compiled function. The kernels that it calls depend on the observer and the friction
law. numba compiles a function anew for every type of its arguments. So the choice is an argument
whose type names the kernels:

    choice = kernel_choice(observer.kernels, law.kernels)      # of no length: it costs nothing

    observe = chosen_kernel(0, "output")
    observe(choice)(table, state, signals, J)                  # in a kernel

The compiled function is kept on disk like every other. The name in the type holds the kernels'
stamp (`wrenchsight.models.numerics.kernel`): a kernel that changed is another choice. Of a kernel
outside this package it also holds when its folder's files last changed.
"""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba.core import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from wrenchsight.models.numerics.kernel import kernel_stamp

KernelChoice = NDArray[np.void]

_PACKAGE = Path(__file__).resolve().parents[1]
_known: dict[str, tuple[Any, ...]] = {}


def kernel_choice(*kernels: tuple[Any, ...]) -> KernelChoice:
    """Returns the choice of these groups of kernels (`numba.njit` functions each)."""
    names = [f"{place}_{_name(group)}" for place, group in enumerate(kernels)]
    _known.update(zip(names, kernels, strict=True))
    return np.zeros(0, np.dtype([(name, np.uint8) for name in names]))


def chosen_kernel(
    place: int, name: str, otherwise: Any = None
) -> Callable[[KernelChoice], Callable[..., Any]]:
    """Returns a function that selects a kernel of a choice, for use within a kernel.

    Args:
        place: of its group.
        name: in that group.
        otherwise: the kernel of a group that has none of this name.
    """

    @intrinsic
    def selected(context: Any, choice: Any) -> Any:
        kind = numba.typeof(getattr(_group(choice, place), name) or otherwise)

        def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return context.get_dummy_value()

        return kind(choice), code

    return selected


def has_kernel(place: int, name: str) -> Callable[[KernelChoice], bool]:
    """Returns a function that tests whether a choice has a kernel, for use within a kernel.

    Args:
        place: of its group.
        name: in that group.
    """

    @intrinsic
    def is_present(context: Any, choice: Any) -> Any:
        has_it = getattr(_group(choice, place), name) is not None

        def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return context.get_constant(types.boolean, has_it)

        return types.boolean(choice), code

    return is_present


def _group(choice: Any, place: int) -> Any:
    """The group at a place of a choice, whose numba type is given."""
    (name,) = (name for name in choice.dtype.fields if name.startswith(f"{place}_"))
    return _known[name]


def _name(group: tuple[Any, ...]) -> str:
    """A digest of a group's kernels: of their names, their constants and their code."""
    digest = hashlib.sha1(usedforsecurity=False)
    for kernel in _single(group):
        function = kernel.py_func
        digest.update(f"{function.__module__}.{function.__qualname__}".encode())
        closure = (cell.cell_contents for cell in function.__closure__ or ())
        constants = [value for value in closure if isinstance(value, int | float)]
        digest.update(repr(constants).encode())
        source = Path(function.__code__.co_filename)
        if source.is_file():
            digest.update(kernel_stamp(source, function.__qualname__.partition(".")[0]).encode())
        if _PACKAGE in source.resolve().parents:
            continue
        digest.update(function.__code__.co_code)
        for file in sorted(source.parent.glob("*.py")) if source.is_file() else ():
            digest.update(f"{file.name} {file.stat().st_mtime_ns}".encode())
    return digest.hexdigest()[:16]


def _single(group: tuple[Any, ...]) -> list[Any]:
    """The kernels of a group, and those that they are composed of; None entries are left out."""
    kernels = []
    for kernel in group:
        if kernel is not None:
            kernels += _single(kernel) if isinstance(kernel, tuple) else [kernel]
    return kernels
