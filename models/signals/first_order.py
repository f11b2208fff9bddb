"""A first-order low-pass sample by sample, as an observer's pole is one."""

import numpy as np

from wrenchsight.models.arrays import Array
from wrenchsight.models.kernel import kernel


@kernel
def low_pass(keep: Array, memory: Array, x: Array) -> None:
    """A first-order low-pass along the first axis, in place.

    What is not finite is replaced by what the filter holds; the first finite sample starts it.

    Args:
        keep: (n,) exp(-pole T).
        memory: (n, m) of the sample before, changed; NaN: nothing yet.
        x: (N, n, m), changed.
    """
    for k in range(x.shape[0]):
        for i in range(x.shape[1]):
            for c in range(x.shape[2]):
                new, old = x[k, i, c], memory[i, c]
                if not np.isfinite(new):
                    new = old if np.isfinite(old) else 0.0
                elif np.isfinite(old):
                    new = keep[i] * old + (1.0 - keep[i]) * new
                    memory[i, c] = new
                else:
                    memory[i, c] = new
                x[k, i, c] = new
