"""Unit Gaussian noise as a pure function of a seed, a tick and a channel."""

import math

import numpy as np

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import kernel

_GOLDEN_INCREMENT = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_TO_UNIT = 2.0**-53


MAX_SEED = 2**63 - 1
"""Largest seed: a kernel takes it as an integer of 64 bits with a sign."""


def check_seed(seed: int | None) -> None:
    """Raises ValueError where a seed is none of `gaussian_noise`; None, for no noise, is one.

    A negative one is refused: tables of constants state it for no noise.
    """
    if seed is not None and not 0 <= seed <= MAX_SEED:
        raise ValueError(f"seed of the noise: {seed}, expected 0 to 2^63 - 1, or None for no noise")


@kernel(inline="always")
def _mix(z: np.uint64) -> np.uint64:
    """SplitMix64's finaliser (Steele, Lea and Flood, OOPSLA 2014): every bit moves every bit."""
    z = (z ^ (z >> np.uint64(30))) * _MIX_1
    z = (z ^ (z >> np.uint64(27))) * _MIX_2
    return z ^ (z >> np.uint64(31))


@kernel
def gaussian_noise(seed: int, tick: int, noise: Array) -> None:
    """Fills `noise` (n,) with independent draws of N(0, 1): the same for the same seed and tick.

    Counter-based (a hash of seed, tick and channel, then Box-Muller), so that a simulation started
    anywhere, any number of times, in any order, sees the same noise, and no generator state has to
    be carried along.
    """
    stream = _mix(_mix(np.uint64(seed) + _GOLDEN_INCREMENT) ^ np.uint64(tick)) + _GOLDEN_INCREMENT
    for i in range(0, noise.shape[0], 2):
        counter = np.uint64(i)
        first = _mix(stream + counter * _GOLDEN_INCREMENT)
        second = _mix(stream + (counter + np.uint64(1)) * _GOLDEN_INCREMENT)
        # (0, 1]: the logarithm stays finite.
        uniform = (np.float64(first >> np.uint64(11)) + 1.0) * _TO_UNIT
        radius = math.sqrt(-2.0 * math.log(uniform))
        angle = 2.0 * math.pi * np.float64(second >> np.uint64(11)) * _TO_UNIT
        noise[i] = radius * math.cos(angle)
        if i + 1 < noise.shape[0]:
            noise[i + 1] = radius * math.sin(angle)
