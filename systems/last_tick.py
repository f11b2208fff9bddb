"""What a block's outputs were at its last tick, for those who read it between its ticks."""

import math

import numpy as np
from pydrake.systems.framework import (
    Context,
    DependencyTicket,
    DiscreteStateIndex,
    DiscreteValues,
    LeafSystem,
)

from wrenchsight.models.arrays import Array


class LastTick:
    """A discrete state of a block with the time of its last tick and what it put out then.

    A block of the estimator takes one sample at each tick k time_step. Drake evaluates an output
    whenever it is asked for, also between two ticks, where the sample has been taken already: it
    must not be taken for the next one. An output then is `values`, that of the last tick.

    Args:
        block: whose state it is; declared after the block's others.
        time_step: s, of its periodic update.
        size: entries that are kept.
    """

    def __init__(self, block: LeafSystem, time_step: float, size: int) -> None:
        self._time_step = time_step
        initial = np.zeros(1 + size)
        initial[0] = np.nan  # there was no tick
        index: DiscreteStateIndex = block.DeclareDiscreteState(initial)
        self._index = index
        self.tickets: set[DependencyTicket] = {
            block.time_ticket(),
            block.discrete_state_ticket(index),
        }

    def is_between(self, context: Context) -> bool:
        """Whether `context` is between the last tick and the next one."""
        last: float = context.get_discrete_state(self._index).GetAtIndex(0)
        # The ticks' times are computed as Drake does, so that rounding makes no third kind.
        if math.isnan(last):
            return False
        now: float = context.get_time()
        return last <= now < (round(last / self._time_step) + 1) * self._time_step

    def values(self, context: Context) -> Array:
        """What was put out at the last tick."""
        return np.asarray(context.get_discrete_state(self._index).value()[1:])

    def take(self, context: Context, discrete_state: DiscreteValues, *values: Array) -> None:
        """Keeps the outputs, one after another, of the tick that `context` is at."""
        kept = discrete_state.get_mutable_value(self._index)
        kept[0] = context.get_time()
        np.concatenate(values, out=kept[1:])
