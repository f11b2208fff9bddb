"""States of several arrays, and the one vector that a Drake Context holds of them."""

from collections.abc import Callable
from typing import Any, cast

import numpy as np

from wrenchsight.models.numerics.arrays import Array


class StateLayout:
    """Where the arrays of a state stand in a vector: one after another, row by row.

    Args:
        state: an array, or a NamedTuple of states.

    Attributes:
        initial: (size,) the numbers of that state.
    """

    def __init__(self, state: Any) -> None:
        arrays = _arrays_of(state)
        self.initial: Array = np.concatenate([np.ravel(array) for array in arrays])
        ends = np.cumsum([array.size for array in arrays]).tolist()
        starts = [0, *ends[:-1]]
        slices = [slice(start, end) for start, end in zip(starts, ends, strict=True)]
        shapes = [array.shape for array in arrays]
        self._parts = list(zip(slices, shapes, strict=True))
        is_flat = isinstance(state, tuple) and not any(isinstance(part, tuple) for part in state)
        self._made = cast(Any, type(state))._make if is_flat else _maker(state)

    def state_of(self, vector: Array) -> Any:
        """The state whose numbers stand in a vector (size,), as views of it."""
        if self._made is next:  # of one array alone
            return vector.reshape(self._parts[0][1])
        arrays = [
            vector[part] if len(shape) == 1 else vector[part].reshape(shape)
            for part, shape in self._parts
        ]
        return self._made(iter(arrays))


def assign_state(state: Any, other: Any) -> None:
    """Writes the numbers of another state of the same shapes into the arrays of a state."""
    for array, values in zip(_arrays_of(state), _arrays_of(other), strict=True):
        array[:] = values


def _arrays_of(state: Any) -> list[Array]:
    """The arrays of a state, in their order."""
    if isinstance(state, tuple):
        return [array for part in state for array in _arrays_of(part)]
    return [state]


def _maker(state: Any) -> Callable[[Any], Any]:
    """A function that makes a state like this one of an iterator of arrays."""
    if not isinstance(state, tuple):
        return next
    kind, makers = type(state), [_maker(part) for part in state]
    return lambda arrays: kind(*[make(arrays) for make in makers])
