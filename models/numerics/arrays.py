"""Types of numpy arrays, by what they hold. The shapes stand in the docstrings of their users."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_FLOAT64 = np.dtype(np.float64)

Record = NDArray[np.void]
"""One structured entry (1,) with named fields: what belongs together, in one argument of a kernel.

Handing over an array costs a kernel half a microsecond, so a record of twelve is ten times as fast
as twelve arrays. Inside a kernel `p = record[0]` and then `p.name` are views; written to, they
change the record.
"""


def record(**values: Any) -> Record:
    """Returns a record of these numbers and arrays, each with its own shape, as float64."""
    arrays = {name: np.asarray(value, dtype=np.float64) for name, value in values.items()}
    made = np.zeros(1, record_type(**{name: array.shape for name, array in arrays.items()}))
    for name, array in arrays.items():
        made[name][0] = array
    return made


def record_of(numbers: NamedTuple) -> Record:
    """Returns a record of a NamedTuple's numbers; a NamedTuple among them is a record within it.

    A kernel takes it in a quarter of the time of the NamedTuple itself. Kernels that name its
    fields take either, as `p.name`.
    """
    return np.array([_entries(numbers)], _type_of(numbers))


def _entries(numbers: Any) -> tuple[Any, ...]:
    """The entries of a record of `record_of`."""
    return tuple(_entries(x) if isinstance(x, tuple) else x for x in numbers)


def _type_of(numbers: Any) -> np.dtype[np.void]:
    """The type of a record of `record_of`."""
    kinds = [_type_of(x) if isinstance(x, tuple) else _FLOAT64 for x in numbers]
    return np.dtype(list(zip(numbers._fields, kinds, strict=True)))


def record_type(**shapes: tuple[int, ...]) -> np.dtype[np.void]:
    """The type of a record whose fields have these shapes; () is a number."""
    return np.dtype([(name, np.float64, shape) for name, shape in shapes.items()])


def contiguous(*signals: ArrayLike) -> list[Array]:
    """Each as kernels take it: float64, contiguous, writeable; the same memory where it is so."""
    return [
        x
        if type(x) is np.ndarray and x.dtype is _FLOAT64 and x.flags.carray
        else np.require(x, np.float64, ("C", "W"))
        for x in signals
    ]
