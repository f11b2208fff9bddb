"""Blocks that take one sample of their inputs at each tick."""

from abc import abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DependencyTicket,
    DiscreteValues,
    LeafSystem,
    OutputPort,
    State,
)

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.states import StateLayout

_LAST_TICK, _NEXT_TICK = 0, 1  # entries of the ticks: when the last one was, when the next one is

_STEPS_WITH_PLANT = ContextVar("steps with plant", default=False)


@contextmanager
def stepping_with_plant() -> Iterator[None]:
    """Blocks made within update together with a plant that does not sample its output ports.

    Such a plant steps in a discrete update, and so do these blocks: all updates of a time see one
    Context, and what was computed for one of them, a solved contact above all, serves the others.
    The numbers are those of other blocks. An unrestricted update before the plant's step makes
    Drake compute it twice at each tick. Not for a plant that samples its output ports (Drake's
    default): these blocks would see the state after its step.
    """
    token = _STEPS_WITH_PLANT.set(True)
    try:
        yield
    finally:
        _STEPS_WITH_PLANT.reset(token)


def ticking_period(time_step: float, block: str) -> float:
    """The period of a block that must tick, s: `time_step`, checked.

    Args:
        time_step: s.
        block: of which the error line speaks.

    Raises:
        ValueError: it is not a positive number.
    """
    if not 0.0 < time_step < np.inf:  # NaN neither
        raise ValueError(f"{block}: time_step must be positive, not {time_step:g} s")
    return time_step


def tick_number(t: float, time_step: float) -> int:
    """The number of the tick that begins at t or before, s."""
    # A thousandth of a tick absorbs the rounding of t = k time_step.
    return int(t / time_step + 1e-3)


class SampledBlock(LeafSystem):
    """A block that takes a sample of its inputs at each tick t = 0, period, 2 period...

    **Which state of a plant it sees.** The update is an unrestricted one. At a time t Drake
    performs unrestricted updates first, all of them on the Context as it is before any update of
    that time. So the block sees the state before the plant's step, whether the plant is continuous,
    discrete with sampled output ports (Drake's default), or discrete without. A discrete update
    would see the state *after* the step of a plant that samples its ports. Where all is ours and
    the plant does not, `stepping_with_plant` makes blocks that update in its own phase.

    **What it puts out.** Drake evaluates an output whenever a port is read, also between two ticks
    and, within one time, after the update. There the sample has been taken already and must not be
    taken again as the next one: the outputs are those of the last tick, held
    (`declare_held_output`). A plant that steps in a discrete update, after this block's, so gets
    the same torque as one that steps in the same unrestricted update.

    State, in groups of discrete state:
        memory       of the block, all its arrays one after another
        ticks        (2,) s, the times of the last tick and of the next one; NaN before the first
        one group for each held output, in the order in which they are declared

    A block with `period` 0 has no memory, no event and no state: its outputs are functions of
    its inputs at any time.

    A subclass calls `SampledBlock.__init__` before it declares anything (pydrake makes the C++
    object there), and declares inputs before the outputs that depend on them.

    Args:
        period: s, of the ticks; 0: the block is a function without memory.
        initial_memory: an array, or a NamedTuple of arrays, of any shape; before the first tick.

    Attributes:
        has_memory: whether `period` is positive.
        time_and_memory_tickets: of time and of all discrete state; what a cache entry depends on,
            besides its inputs, whose calc asks for the block's memory. Empty with `period` 0.

    Raises:
        ValueError: the period is negative or no finite number.
    """

    def __init__(self, *, period: float, initial_memory: Any) -> None:
        LeafSystem.__init__(self)
        if period != 0.0:
            ticking_period(period, type(self).__name__)
        self._period = period
        self.has_memory = period != 0.0
        self._memory_layout = StateLayout(initial_memory)
        # Groups of the held outputs, in the order in which these are declared: `_take` fills them
        # with what `take_sample` returns, one after another.
        self._held_indices: list[int] = []
        self.time_and_memory_tickets: set[DependencyTicket] = set()
        if not self.has_memory:
            return
        # Indices of the other groups. Plain numbers: pydrake takes a fifth of a microsecond to look
        # into an index of its own.
        self._memory_index = int(self.DeclareDiscreteState(self._memory_layout.initial))
        self._ticks_index = int(self.DeclareDiscreteState(np.full(2, np.nan)))
        # All groups at once: one edge an output in Drake's graph of dependencies.
        self.time_and_memory_tickets = {self.xd_ticket(), self.time_ticket()}
        if _STEPS_WITH_PLANT.get():
            self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._take)
        else:
            self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._take_before_all)
        self.DeclareForcedUnrestrictedUpdateEvent(self._take_before_all)

    def declare_held_output(
        self,
        name: str,
        size: int,
        calc: Callable[[Context, BasicVector], None],
        tickets: set[DependencyTicket],
    ) -> OutputPort:
        """Declares a vector output that is computed at a tick and held until the next one.

        `take_sample` returns a sequence with one array for each call of this, in the order of the
        calls: at each tick `_take` writes the k-th array into the k-th held output. A block with
        `period` 0 holds nothing: `calc` is called for every context, and `take_sample` never.

        Args:
            name: of the port.
            size: number of its entries.
            calc: writes the output of the present sample. It is called where the context's sample
                has not been taken, at a tick ahead of its update and before the first tick:
                `memory` is then the one before the sample. Where the context's time alone was set
                back, to before its last tick, it is called as well: `memory` is then the one after
                that last tick.
            tickets: of the inputs, parameters and cache entries that `calc` reads; time and all
                discrete state (memory, ticks, what is held) are added here.

        Returns:
            The port. What it holds after a tick is what `take_sample` returned there.
        """
        if not self.has_memory:
            return self.DeclareVectorOutputPort(name, size, calc, tickets)
        # State for what is held, which `_take` finds by its place in `_held_indices`.
        held_index = int(self.DeclareDiscreteState(size))
        self._held_indices.append(held_index)

        def hold_or_calc(context: Context, output: BasicVector) -> None:
            discrete = context.get_discrete_state()
            ticks = discrete.value(self._ticks_index)
            # From the last tick's update to the next tick, whose sample is not taken yet. Before
            # the first tick both are NaN, and the comparison is false.
            if ticks.item(_LAST_TICK) <= context.get_time() < ticks.item(_NEXT_TICK):
                output.SetFromVector(discrete.value(held_index))
            else:
                calc(context, output)

        all_tickets = tickets | self.time_and_memory_tickets
        return self.DeclareVectorOutputPort(name, size, hold_or_calc, all_tickets)

    @abstractmethod
    def take_sample(self, context: Context, memory: Any) -> Sequence[Array]:
        """Takes the sample of the tick that `context` is at.

        Args:
            context: before the tick; evaluate inputs and outputs with it.
            memory: the block's memory, in the shapes of the initial one, as it is before the tick;
                to be changed in place to what it is after. `context` does not see the changes.

        Returns:
            The values that the held outputs keep until the next tick, in the order in which they
            were declared.
        """

    @property
    def memory_size(self) -> int:
        """Number of the memory's entries."""
        return self._memory_layout.initial.size

    def memory(self, context: Context, vector: Array | None = None) -> Any:
        """A copy of the block's memory, in the shapes of the initial one.

        Args:
            vector: (memory_size,) that the copy is written into, as views of which it is returned;
                None: the copy has a vector of its own.
        """
        if self.has_memory:
            value = context.get_discrete_state().value(self._memory_index)
        else:
            value = self._memory_layout.initial
        if vector is None:
            vector = value.copy()
        else:
            vector[:] = value
        return self._memory_layout.state_of(vector)

    def memory_of(self, vector: Array) -> Any:
        """The memory that stands in a vector (memory_size,), as views of it."""
        return self._memory_layout.state_of(vector)

    def _take_before_all(self, context: Context, state: State) -> None:
        self._take(context, state.get_mutable_discrete_state())

    def _take(self, context: Context, discrete: DiscreteValues) -> None:
        memory = discrete.get_mutable_value(self._memory_index)
        outputs = self.take_sample(context, self._memory_layout.state_of(memory))
        for index, value in zip(self._held_indices, outputs, strict=True):
            discrete.set_value(index, value)
        now = context.get_time()
        ticks = discrete.get_mutable_value(self._ticks_index)
        # The times are computed as Drake does, so that rounding makes no third kind.
        ticks[_LAST_TICK], ticks[_NEXT_TICK] = (
            now,
            (tick_number(now, self._period) + 1) * self._period,
        )
