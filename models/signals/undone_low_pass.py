"""The inverse of a first-order low-pass: its input from its output."""

import numpy as np

from wrenchsight.models.numerics.arrays import Array, Flags


def undone_low_pass(y: Array, pole: Array, is_measured: Flags) -> tuple[Array, Flags]:
    """Solves y_k = pole y_k-1 + (1 - pole) x_k for x.

    From an observer of pole exp(-K_0 T) it gives the mean external torque over each period.

    Args:
        y: (N, n).
        pole: (n,), below 1.
        is_measured: (N,) samples of y that were measured.

    Returns:
        x (N, n), zero where it is not known; (N,) whether it is: False at the first sample, and
        where it or the one before was not measured.
    """
    y = np.where(is_measured[:, None], y, 0.0)
    is_known = np.zeros(len(y), np.bool_)
    is_known[1:] = is_measured[1:] & is_measured[:-1]
    x = np.zeros_like(y)
    x[1:] = (y[1:] - pole * y[:-1]) / (1.0 - pole)
    return np.where(is_known[:, None], x, 0.0), is_known
