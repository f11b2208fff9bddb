"""What blocks declare alike: parameters by name, what follows from them, ports of one vector."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import (
    BasicVector,
    CacheEntry,
    Context,
    DependencyTicket,
    LeafSystem,
    NumericParameterIndex,
    ValueProducer,
)

from wrenchsight.models.arrays import Array


class TunedParameters:
    """The numeric parameters of a block.

    Args:
        block: whose they are.
        values: of any shape, in the order of the Context's parameters.

    Attributes:
        indices: by name.
        tickets: of them all; of nothing where there are none.
    """

    def __init__(self, block: LeafSystem, values: Mapping[str, Array]) -> None:
        self._shapes = {name: value.shape for name, value in values.items()}
        self.indices = {
            name: NumericParameterIndex(block.DeclareNumericParameter(BasicVector(value.ravel())))
            for name, value in values.items()
        }
        tickets = {block.numeric_parameter_ticket(index) for index in self.indices.values()}
        self.tickets: set[DependencyTicket] = tickets or {block.nothing_ticket()}

    def at(self, context: Context) -> dict[str, Array]:
        """What a context holds, copied."""
        return {
            name: np.array(context.get_numeric_parameter(index).value()).reshape(self._shapes[name])
            for name, index in self.indices.items()
        }


def declare_cached(
    block: LeafSystem,
    name: str,
    calc: Callable[[Context], Any],
    tickets: set[DependencyTicket],
) -> CacheEntry:
    """Declares what `calc` returns as an entry of the block's cache, anew when a ticket says so.

    `EvalAbstract(context).get_value()` of the entry is the value.
    """

    def write(context: Context, value: Value) -> None:
        value.set_value(calc(context))

    producer = ValueProducer(allocate=lambda: AbstractValue.Make(object()), calc=write)
    return block.DeclareCacheEntry(name, producer, tickets)


def declare_parts(
    block: LeafSystem,
    whole: Callable[[Context], Array],
    sizes: Mapping[str, int],
    tickets: set[DependencyTicket],
) -> None:
    """Declares output ports that are parts of one vector, from its first entry on."""
    start = 0
    for name, size in sizes.items():
        part = slice(start, start + size)

        def write(context: Context, output: BasicVector, part: slice = part) -> None:
            output.SetFromVector(whole(context)[part])

        block.DeclareVectorOutputPort(name, size, write, tickets)
        start += size
