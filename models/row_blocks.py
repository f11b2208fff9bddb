"""Rows of a log taken side by side by threads, where their kernel lets go of the interpreter."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numba


def in_row_blocks(run: Callable[[slice], None], rows: int, block: int) -> None:
    """Calls `run` for slices of `rows` rows, of `block` rows or more each.

    In the place of numba's own parallel loop where that compiles slowly: a minute for the reading
    of a wrench, whose kernel alone takes ten seconds.

    Args:
        run: calls a kernel of `nogil=True`.
        rows: N.
        block: rows that are worth a thread.
    """
    threads = numba.get_num_threads()
    size = max(block, -(-rows // threads))
    slices = [slice(begin, min(rows, begin + size)) for begin in range(0, rows, size)]
    if len(slices) < 2:
        for part in slices:
            run(part)
        return
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(run, slices))
