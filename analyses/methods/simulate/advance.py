"""Advances a simulation to its end and tells how far it is.

Every tick makes some hundred short-lived objects, all freed by reference counting. The garbage
collector would go through the whole heap for them again and again, at a tenth of the time: it rests
meanwhile.
"""

import gc
from collections.abc import Callable, Sequence

from pydrake.systems.analysis import Simulator

from wrenchsight.diagrams.closed_loop import ClosedLoop
from wrenchsight.models.numerics.arrays import Array


def even_stretches(duration: float, stretch: float) -> list[float]:
    """Times from above 0 to `duration`, all equally far apart, about `stretch`; in s."""
    count = max(1, round(duration / stretch))
    return [duration * (k + 1) / count for k in range(count)]


def advance(
    simulator: Simulator,
    ends: Sequence[float],
    told: Callable[[float], None] = lambda share: None,
) -> None:
    """Advances to each time of `ends` in turn.

    Args:
        simulator: initialised.
        ends: s, ascending, of the stretches between two reports of progress.
        told: called after each stretch with the share of them that is done; what it raises ends the
            simulation there.
    """
    collecting = gc.isenabled()
    gc.disable()
    try:
        for k, end in enumerate(ends):
            simulator.AdvanceTo(end)
            told((k + 1) / len(ends))
    finally:
        if collecting:
            gc.enable()


def run_loop(
    loop: ClosedLoop, duration: float, stretch: float, told: Callable[[float], None]
) -> tuple[Array, dict[str, Array]]:
    """Simulates a closed loop from its start; what it logged, see `ClosedLoop.logged`.

    Args:
        loop: to run.
        duration, stretch: s, of all and between two reports of progress.
        told: as in `advance`.
    """
    simulator = Simulator(loop.diagram)
    simulator.Initialize()
    advance(simulator, even_stretches(duration, stretch), told)
    return loop.logged(simulator.get_context())
