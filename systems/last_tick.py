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

_TIMES = 2  # entries before what is kept: when the last tick was, when the next one is


class LastTick:
    """A discrete state of a block with the time of its last tick and what it put out then.

    A block of the estimator takes one sample at each tick k time_step. Drake evaluates an output
    whenever it is asked for, also between two ticks, where the sample has been taken already: it
    must not be taken for the next one. An output then is that of the last tick.

    Args:
        block: whose state it is; declared after the block's others.
        time_step: s, of its periodic update.
        size: entries that are kept.
    """

    def __init__(self, block: LeafSystem, time_step: float, size: int) -> None:
        self._time_step = time_step
        initial = np.zeros(_TIMES + size)
        initial[:_TIMES] = np.nan  # there was no tick
        index: DiscreteStateIndex = block.DeclareDiscreteState(initial)
        self._index = index
        self.tickets: set[DependencyTicket] = {
            block.time_ticket(),
            block.discrete_state_ticket(index),
        }

    def between(self, context: Context) -> Array | None:
        """What was put out at the last tick, where `context` is between it and the next; or None.

        The numbers are the context's: they are read, or copied, at once.
        """
        kept: Array = context.get_discrete_state(self._index).value()
        between = kept.item(0) <= context.get_time() < kept.item(1)  # not where there was no tick
        return kept[_TIMES:] if between else None

    def take(self, context: Context, discrete_state: DiscreteValues, *values: Array) -> None:
        """Keeps the outputs, one after another, of the tick that `context` is at."""
        kept, begin = discrete_state.get_mutable_value(self._index), _TIMES
        kept[0] = now = context.get_time()
        # The ticks' times are computed as Drake does, so that rounding makes no third kind.
        kept[1] = (round(now / self._time_step) + 1) * self._time_step
        for value in values:  # a third of the time that concatenate takes
            end = begin + len(value)
            kept[begin:end] = value
            begin = end
