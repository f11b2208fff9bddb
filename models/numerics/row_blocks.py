"""Rows of a log taken side by side by threads, where their kernel lets go of the interpreter."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numba


def in_row_blocks(run: Callable[[slice], None], rows: int, block: int) -> None:
    """Calls `run` for slices of `block` rows, the last of which may be shorter.

    In the place of numba's own parallel loops, which compile slowly: a minute for the reading of a
    wrench, whose kernel alone takes ten seconds.

    Args:
        run: calls a kernel of `nogil=True`.
        rows: N.
        block: rows that are worth a thread, and bound the memory of one.
    """
    if rows <= block:
        if rows > 0:
            run(slice(0, rows))
        return
    slices = [slice(begin, min(rows, begin + block)) for begin in range(0, rows, block)]
    threads = min(numba.get_num_threads(), len(slices))
    if threads < 2:
        for part in slices:
            run(part)
        return
    run(slices[0])  # in this thread a kernel compiles, not in several that wait for each other
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(run, slices[1:]))
