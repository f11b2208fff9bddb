"""Compilation of numba's kernels, a wait once on a machine: announced, and done side by side."""

import os
from collections.abc import Callable, Iterable, Mapping
from contextlib import closing
from typing import Any, Final

from wrenchsight.analyses.output.side_by_side import run_side_by_side

ANNOUNCEMENT: Final = "compiling kernels, once on this machine"


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


def are_compiled(kernels: Iterable[Any]) -> bool:
    """Whether the disk holds compiled code of each of these kernels."""
    return all(kernel._cache._cache_file._load_index() for kernel in kernels)


def compile_side_by_side(
    parts: Mapping[str, Callable[[], object]], announce: Callable[[float, str], None]
) -> None:
    """Runs calls in processes side by side; the kernels that they compile stay on disk.

    Args:
        parts: calls that can be pickled, by what they compile; the longest first.
        announce: called with the share that is done and a sentence on what is left.
    """
    left = list(parts)

    def say() -> None:
        announce(1.0 - len(left) / len(parts), f"{ANNOUNCEMENT}; left: {', '.join(left)}")

    say()
    calls = run_side_by_side(_call, parts.items(), len(os.sched_getaffinity(0)))
    with closing(calls):
        for (name, _), _died in calls:  # this process compiles what one that died has not
            left.remove(name)
            if left:
                say()


def _call(part: tuple[str, Callable[[], object]]) -> None:
    part[1]()
