"""Announces that numba compiles kernels: a wait of seconds, once on a machine."""

from collections.abc import Callable
from typing import Any

ANNOUNCEMENT = "compiling kernels, once on this machine"


def on_first_compilation(say: Callable[[str], None]) -> None:
    """Calls `say(ANNOUNCEMENT)` when this process first compiles a kernel that is not cached."""
    from numba.core import event

    class FirstCompilation(event.Listener):
        said = False

        def on_start(self, event: Any) -> None:
            if not self.said:
                self.said = True
                say(ANNOUNCEMENT)

        def on_end(self, event: Any) -> None:
            pass

    event.register("numba:compile", FirstCompilation())
