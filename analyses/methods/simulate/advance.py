"""Advances a simulation to its end and reports its progress.

Every tick makes some hundred short-lived objects, all freed by reference counting. The garbage
collector would go through the whole heap for them again and again and take a tenth of the time. It
is off meanwhile.
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
    report: Callable[[float], None] = lambda share: None,
) -> None:
    """Advances to each time of `ends` in turn.

    Args:
        simulator: initialised.
        ends: s, ascending, of the stretches between two reports of progress.
        report: called after each stretch with the share that is done. An exception from it ends the
            simulation there.
    """
    collecting = gc.isenabled()
    gc.disable()
    try:
        for k, end in enumerate(ends):
            simulator.AdvanceTo(end)
            report((k + 1) / len(ends))
    finally:
        if collecting:
            gc.enable()


def run_loop(
    loop: ClosedLoop, duration: float, stretch: float, report: Callable[[float], None]
) -> tuple[Array, dict[str, Array]]:
    """Simulates a closed loop from its start and returns what `ClosedLoop.logged` does.

    Args:
        loop: to run.
        duration: s, of the whole simulation.
        stretch: s, between two reports of progress.
        report: as in `advance`.
    """
    simulator = Simulator(loop.diagram)
    simulator.Initialize()
    advance(simulator, even_stretches(duration, stretch), report)
    return loop.logged(simulator.get_context())
