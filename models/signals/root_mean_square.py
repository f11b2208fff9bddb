"""Root mean square of signals."""

import numpy as np

from wrenchsight.models.numerics.arrays import Array


def rms(x: Array) -> Array:
    """Root mean square along the first axis."""
    return np.asarray(np.sqrt(np.mean(x**2, axis=0)))


def rms_length(vectors: Array) -> float:
    """Root mean square of the lengths of vectors (N, k)."""
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=1))))
