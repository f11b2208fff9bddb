"""Announces that numba compiles kernels: a wait of seconds, once on a machine."""

from collections.abc import Callable
from typing import Any

ANNOUNCEMENT = "compiling kernels, once on this machine"


def on_first_compilation(announce: Callable[[str], None]) -> None:
    """Calls `announce(ANNOUNCEMENT)` when this process first compiles an uncached kernel."""
    from numba.core import event

    class FirstCompilation(event.Listener):
        announced = False

        def on_start(self, event: Any) -> None:
            if not self.announced:
                self.announced = True
                announce(ANNOUNCEMENT)

        def on_end(self, event: Any) -> None:
            pass

    event.register("numba:compile", FirstCompilation())
