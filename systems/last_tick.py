"""A block's outputs at its last tick, for readers between two ticks."""

import numpy as np
from pydrake.systems.framework import (
    Context,
    DependencyTicket,
    DiscreteStateIndex,
    DiscreteValues,
    LeafSystem,
)

from wrenchsight.models.numerics.arrays import Array

_TIMES = 2  # last entries: when the last tick was, when the next one is


def tick_of(t: float, time_step: float) -> int:
    """The number of the tick that begins at t or before, s."""
    # A thousandth of a tick absorbs the rounding of t = k time_step.
    return int(t / time_step + 1e-3)


class LastTick:
    """The discrete state of a block, with the time and the outputs of its last tick.

    A block of the estimator takes one sample at each tick k time_step. Drake evaluates an output
    whenever a port is read, also between two ticks. There the sample has been taken already, and
    must not be taken again as the next one: the output is that of the last tick.

    Both are one vector: each access to a state costs as much as a stage's arithmetic.

        [ the block's state | outputs of the last tick | its time, the next one's time ]

    Args:
        block: the block, which has no other discrete state.
        initial: the block's state before its first tick, of any shape.
        time_step: s, of its periodic update.
        size: entries of all outputs together.
    """

    def __init__(self, block: LeafSystem, initial: Array, time_step: float, size: int) -> None:
        self._time_step = time_step
        self._state_size = initial.size
        # The times are NaN: there was no tick.
        state = np.concatenate([initial.ravel(), np.zeros(size), np.full(_TIMES, np.nan)])
        index: DiscreteStateIndex = block.DeclareDiscreteState(state)
        self.tickets: set[DependencyTicket] = {
            block.time_ticket(),
            block.discrete_state_ticket(index),
        }

    def at(self, context: Context) -> tuple[Array, Array | None]:
        """The block's state, flat, and the outputs of the last tick.

        The outputs are None where `context` is at a tick: then they are to be computed. Both are
        views of the context's memory: read or copy them at once.
        """
        memory = context.get_discrete_state_vector().value()
        # NaN, before the first tick, is between nothing.
        if memory.item(-2) <= context.get_time() < memory.item(-1):
            return memory[: self._state_size], memory[self._state_size : -_TIMES]
        return memory[: self._state_size], None

    def take(
        self, context: Context, discrete_state: DiscreteValues, *values: Array
    ) -> tuple[Array, Array]:
        """Stores the outputs of the tick that `context` is at, one after another.

        Returns:
            The block's state, flat, to be written, and the stored outputs.
        """
        memory = discrete_state.get_mutable_value()
        memory[-2] = now = context.get_time()
        # The ticks' times are computed as Drake does, so that rounding makes no third kind.
        memory[-1] = (round(now / self._time_step) + 1) * self._time_step
        begin = self._state_size
        for value in values:  # a third of the time that concatenate takes
            end = begin + len(value)
            memory[begin:end] = value
            begin = end
        return memory[: self._state_size], memory[self._state_size : -_TIMES]
