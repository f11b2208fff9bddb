"""Stretches: samples in a row in which a flag is set."""

import numpy as np

from wrenchsight.models.numerics.arrays import Flags


def stretches(flag: Flags) -> list[slice]:
    """The stretches of samples in which a flag (N,) is set, in their order."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flag, [False]]).astype(np.int8)))
    return [slice(int(begin), int(end)) for begin, end in edges.reshape(-1, 2)]
