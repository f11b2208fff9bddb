import threading

import numba
import numpy as np
import pytest

from wrenchsight.models.numerics.row_blocks import in_row_blocks

MOST = numba.config.NUMBA_NUM_THREADS


@pytest.mark.parametrize("rows", [0, 1, 9, 10, 11, 1001])
@pytest.mark.parametrize("threads", sorted({1, MOST}))
def test_every_row_once_whatever_the_threads(rows: int, threads: int) -> None:
    taken, slices = np.zeros(rows, int), []

    def run(part: slice) -> None:
        taken[part] += 1
        slices.append(part)

    numba.set_num_threads(threads)
    in_row_blocks(run, rows, 10)
    numba.set_num_threads(MOST)
    assert (taken == 1).all()
    assert all(part.stop - part.start == 10 or part.stop == rows for part in slices)


@pytest.mark.skipif(MOST < 2, reason="one processor")
def test_blocks_run_side_by_side_and_their_errors_come_out() -> None:
    meeting = threading.Barrier(2, timeout=30.0)

    def run(part: slice) -> None:
        if part.start in (10, 60):
            meeting.wait()  # that the other one is at work, too
        if part.start > 10:
            raise ValueError("of a block")

    numba.set_num_threads(2)
    with pytest.raises(ValueError, match="of a block"):
        in_row_blocks(run, 100, 10)
    numba.set_num_threads(MOST)
