"""What went into a first-order low-pass, from what came out of it."""

import numpy as np

from wrenchsight.models.arrays import Array, Flags


def undone_low_pass(y: Array, pole: Array, known: Flags) -> tuple[Array, Flags]:
    """x of y_k = pole y_k-1 + (1 - pole) x_k, and where it is known.

    An observer of pole exp(-K_0 T) so gives back the mean of the external torque over each period.

    Args:
        y: (N, n).
        pole: (n,), below 1.
        known: (N,) samples of y that were measured.

    Returns:
        (N, n), zero where it is not known; (N,) False at the first sample, and where it or the one
        before was not measured.
    """
    y = np.where(known[:, None], y, 0.0)
    both = np.zeros(len(y), np.bool_)
    both[1:] = known[1:] & known[:-1]
    x = np.zeros_like(y)
    x[1:] = (y[1:] - pole * y[:-1]) / (1.0 - pole)
    return np.where(both[:, None], x, 0.0), both
