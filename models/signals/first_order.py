"""A first-order low-pass sample by sample, like an observer's."""

import numpy as np

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import kernel


@kernel
def low_pass(decay: Array, memory: Array, x: Array) -> None:
    """Filters along the first axis, in place.

    A value that is not finite is replaced by the filter's last one; the first finite sample starts
    the filter.

    Args:
        decay: (n,) exp(-pole T).
        memory: (n, m) of the sample before, changed; NaN: nothing yet.
        x: (N, n, m), changed.
    """
    for k in range(x.shape[0]):
        for i in range(x.shape[1]):
            for c in range(x.shape[2]):
                value, previous = x[k, i, c], memory[i, c]
                if not np.isfinite(value):
                    value = previous if np.isfinite(previous) else 0.0
                elif np.isfinite(previous):
                    value = decay[i] * previous + (1.0 - decay[i]) * value
                    memory[i, c] = value
                else:
                    memory[i, c] = value
                x[k, i, c] = value
