"""Compilation of numba's kernels, a wait once on a machine: announced, and done side by side."""

import os
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, wait
from typing import Any, Final

from wrenchsight.analyses.output.interruption import begin_worker, for_this_process_alone

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
    # joblib's processes do not import the main module again.
    from joblib.externals.loky.process_executor import BrokenProcessPool, ProcessPoolExecutor

    with for_this_process_alone():
        executor = ProcessPoolExecutor(
            min(len(parts), len(os.sched_getaffinity(0))),
            initializer=begin_worker,
            initargs=(os.getpid(), os.devnull),
        )
        left: dict[Future[object], str] = {
            executor.submit(call): name for name, call in parts.items()
        }
    try:
        while left:
            share = 1.0 - len(left) / len(parts)
            announce(share, f"{ANNOUNCEMENT}; left: {', '.join(left.values())}")
            for future in wait(left, return_when=FIRST_COMPLETED).done:
                future.result()
                del left[future]
    except BrokenProcessPool:
        pass  # one was killed: this process compiles what it needs
    finally:
        executor.shutdown(wait=True, kill_workers=True)
