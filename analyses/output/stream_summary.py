"""Summaries of a stream of samples whose length is not known beforehand."""

import numpy as np

from wrenchsight.models.numerics.arrays import Array


class EvenSample:
    """Rows spread evenly over a stream of unknown length: every k-th, k a power of two.

    The first `capacity` rows are all kept; then k doubles whenever there are more.
    """

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        self._every = 1
        self._count = 0
        self._parts: list[Array] = []
        self._num_rows = 0

    def add(self, rows: Array) -> None:
        """Takes the next rows, (N, ...)."""
        first = -self._count % self._every
        self._count += len(rows)
        self._parts.append(rows[first :: self._every].copy())
        self._num_rows += len(self._parts[-1])
        while self._num_rows > self._capacity:
            self._parts = [np.concatenate(self._parts)[::2]]
            self._num_rows = len(self._parts[0])
            self._every *= 2

    def values(self) -> Array:
        """The rows kept, in order."""
        return np.concatenate(self._parts)


class Envelope:
    """Extremes and means of signals over equal stretches of a stream, for a figure of any log.

    A stretch is one sample at first, and doubles whenever there are more than 2 `num_bins`.
    """

    def __init__(self, num_bins: int) -> None:
        self._num_bins = num_bins
        self._per_bin = 1
        self._partial: Array | None = None  # samples that do not fill a stretch yet
        self._bins: list[Array] = []
        self._count = 0
        self._splits = [0, 0]

    def add(self, low: Array, high: Array, mean: Array) -> None:
        """Takes the next samples of signals whose minima, maxima and means are kept; (N, ...)."""
        self._splits = [low.shape[1], low.shape[1] + high.shape[1]]
        rows = np.concatenate([low, high, mean], axis=1)
        if self._partial is not None:
            rows = np.concatenate([self._partial, rows])
        whole = len(rows) // self._per_bin * self._per_bin
        self._partial = rows[whole:].copy()
        if whole:
            bins = self._merged(rows[:whole], self._per_bin)
            self._bins.append(bins)
            self._count += len(bins)
        while self._count > 2 * self._num_bins:
            bins = np.concatenate(self._bins)
            even = len(bins) // 2 * 2
            if even < len(bins):  # the odd last stretch goes back, as samples of its own value
                self._partial = np.concatenate(
                    [bins[even:].repeat(self._per_bin, axis=0), self._partial]
                )
            self._bins = [self._merged(bins[:even], 2)]
            self._count = len(self._bins[0])
            self._per_bin *= 2

    def values(self) -> tuple[Array, Array, Array]:
        """Minima, maxima and means of each stretch, in order; (B, ...)."""
        bins = list(self._bins)
        if self._partial is not None and len(self._partial):
            bins.append(self._merged(self._partial, len(self._partial)))
        low, high, mean = np.split(np.concatenate(bins), self._splits, axis=1)
        return low, high, mean

    def _merged(self, rows: Array, number: int) -> Array:
        """Each `number` successive rows in one."""
        stretches = rows.reshape(-1, number, rows.shape[1])
        low, high, mean = np.split(stretches, self._splits, axis=2)
        return np.concatenate([low.min(axis=1), high.max(axis=1), mean.mean(axis=1)], axis=1)
