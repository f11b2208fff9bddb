"""What a block's outputs were at its last tick, for those who read it between its ticks."""

import numpy as np
from pydrake.systems.framework import (
    Context,
    DependencyTicket,
    DiscreteStateIndex,
    DiscreteValues,
    LeafSystem,
)

from wrenchsight.models.arrays import Array

_TIMES = 2  # last entries: when the last tick was, when the next one is


def tick_of(t: float, time_step: float) -> int:
    """The number of the tick that begins at t or before, s."""
    # A thousandth of a tick absorbs the rounding of t = k time_step.
    return int(t / time_step + 1e-3)


class LastTick:
    """The discrete state of a block, which also holds its last tick's time and what it put out.

    A block of the estimator takes one sample at each tick k time_step. Drake evaluates an output
    whenever it is asked for, also between two ticks, where the sample has been taken already: it
    must not be taken for the next one. An output then is that of the last tick.

    Both are one vector: each access to a state costs as much as a stage's arithmetic.

        [ the block's state | what is kept of the last tick | its time, the next one's time ]

    Args:
        block: whose only discrete state it is.
        initial: the block's state before its first tick, of any shape.
        time_step: s, of its periodic update.
        size: entries that are kept.
    """

    def __init__(self, block: LeafSystem, initial: Array, time_step: float, size: int) -> None:
        self._time_step = time_step
        self._own = initial.size
        # The times are NaN: there was no tick.
        state = np.concatenate([initial.ravel(), np.zeros(size), np.full(_TIMES, np.nan)])
        index: DiscreteStateIndex = block.DeclareDiscreteState(state)
        self.tickets: set[DependencyTicket] = {
            block.time_ticket(),
            block.discrete_state_ticket(index),
        }

    def at(self, context: Context) -> tuple[Array, Array | None]:
        """The block's state, flat, and where `context` is between the last tick and the next, what
        was put out at the last one; else None.

        The numbers are the context's: they are read, or copied, at once.
        """
        memory = context.get_discrete_state_vector().value()
        # NaN, before the first tick, is between nothing.
        if memory.item(-2) <= context.get_time() < memory.item(-1):
            return memory[: self._own], memory[self._own : -_TIMES]
        return memory[: self._own], None

    def take(
        self, context: Context, discrete_state: DiscreteValues, *values: Array
    ) -> tuple[Array, Array]:
        """Keeps the outputs, one after another, of the tick that `context` is at.

        Returns:
            The block's state, flat, to be written, and what is kept.
        """
        memory = discrete_state.get_mutable_value()
        memory[-2] = now = context.get_time()
        # The ticks' times are computed as Drake does, so that rounding makes no third kind.
        memory[-1] = (round(now / self._time_step) + 1) * self._time_step
        begin = self._own
        for value in values:  # a third of the time that concatenate takes
            end = begin + len(value)
            memory[begin:end] = value
            begin = end
        return memory[: self._own], memory[self._own : -_TIMES]
