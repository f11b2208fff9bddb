"""States of several arrays, and the one vector that a Drake Context holds of them."""

from collections.abc import Callable
from typing import Any, cast

import numpy as np

from wrenchsight.models.numerics.arrays import Array

_FLOAT64 = np.dtype(np.float64)


class StateLayout:
    """Where the arrays of a state stand in a vector: one after another, row by row.

    Args:
        state: an array, a record (1,) of float64 fields, or a NamedTuple of states.

    Attributes:
        initial: (size,) the numbers of that state.
    """

    def __init__(self, state: Any) -> None:
        arrays = _arrays_of(state)
        numbers = [_numbers_of(array) for array in arrays]
        self.initial: Array = np.concatenate(numbers)
        ends = np.cumsum([part.size for part in numbers]).tolist()
        starts = [0, *ends[:-1]]
        slices = [slice(start, end) for start, end in zip(starts, ends, strict=True)]
        # Of a record its type, of an array with more than one axis its shape: how a part is viewed.
        kinds: list[Any] = [_kind_of(array) for array in arrays]
        self._parts = list(zip(slices, kinds, strict=True))
        is_flat = isinstance(state, tuple) and not any(isinstance(part, tuple) for part in state)
        self._made = cast(Any, type(state))._make if is_flat else _maker(state)

    def state_of(self, vector: Array) -> Any:
        """The state whose numbers stand in a vector (size,), as views of it."""
        arrays = [
            vector[part]
            if kind is None
            else vector[part].reshape(kind)
            if type(kind) is tuple
            else np.frombuffer(vector[part], kind)  # a fifth of the time that a view takes
            for part, kind in self._parts
        ]
        return self._made(iter(arrays))


def assign_state(state: Any, other: Any) -> None:
    """Writes the numbers of another state of the same shapes into the arrays of a state."""
    for array, values in zip(_arrays_of(state), _arrays_of(other), strict=True):
        if array.dtype is _FLOAT64 or array.dtype.names is None:
            array[:] = values
        else:  # numpy copies a record field by field, in three times the time
            np.frombuffer(array)[:] = np.frombuffer(values)


def _arrays_of(state: Any) -> list[Array]:
    """The arrays of a state, in their order."""
    if isinstance(state, tuple):
        return [array for part in state for array in _arrays_of(part)]
    return [state]


def _numbers_of(array: Any) -> Array:
    """The numbers of an array or record, one after another."""
    return np.ravel(array) if array.dtype.names is None else np.array(array).view(np.float64)


def _kind_of(array: Any) -> tuple[int, ...] | np.dtype[np.void] | None:
    """How an array is viewed in a vector: the shape, or the type of a record; None: as it is."""
    if array.dtype.names is not None:
        return cast("np.dtype[np.void]", array.dtype)
    return None if array.ndim == 1 else tuple(array.shape)


def _maker(state: Any) -> Callable[[Any], Any]:
    """A function that makes a state like this one of an iterator of arrays."""
    if not isinstance(state, tuple):
        return next
    kind, makers = type(state), [_maker(part) for part in state]
    return lambda arrays: kind(*[make(arrays) for make in makers])
