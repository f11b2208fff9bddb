"""Rows of numbers in memory that processes share: one writes, any number read at their own pace.

The writer never waits. A reader that falls behind by more than the ring holds loses the oldest rows
and counts them; nobody else notices. The memory has no name and goes with its last process.
"""

import mmap
import os
import tempfile

import numpy as np

from wrenchsight.models.numerics.arrays import Array

_HEADER_NUMBERS = 8  # numbers before the rows: how many were ever written, then nothing
_MARGIN_ROWS = 8  # rows next to the writer that a reader leaves alone


class Ring:
    """The memory, seen from one process.

    Args:
        size: numbers of a row.
        count: rows that it holds.
        descriptor: descriptor of memory that another process made; None: it is made.
    """

    def __init__(self, size: int, count: int, descriptor: int | None = None) -> None:
        self.size, self.count = size, count
        numbers = _HEADER_NUMBERS + count * (1 + size)
        if descriptor is None:
            descriptor = _memory()
            os.ftruncate(descriptor, 8 * numbers)
        self.descriptor = descriptor
        everything = np.frombuffer(mmap.mmap(descriptor, 8 * numbers), float)
        self._written = everything[:1]
        self._slots = everything[_HEADER_NUMBERS:].reshape(count, 1 + size)

    @property
    def written(self) -> int:
        """Rows that were ever written."""
        return int(self._written[0])

    def write(self, row: Array) -> None:
        """Appends a row (size,); in one process alone."""
        number = self._written[0]
        slot = self._slots[int(number) % self.count]
        slot[0] = -1.0  # no reader takes half a row
        slot[1:] = row
        slot[0] = number
        self._written[0] = number + 1.0

    def rows(self, begin: int, end: int) -> tuple[Array, int]:
        """The rows begin to end that are still there, and how many are not."""
        first = max(begin, self.written - self.count + _MARGIN_ROWS)
        if first >= end:
            return np.empty((0, self.size)), end - begin
        numbers = np.arange(first, end)
        slots = self._slots[numbers % self.count]
        whole = slots[:, 0] == numbers
        # What was overwritten meanwhile no longer bears its number.
        whole &= self._slots[numbers % self.count, 0] == numbers
        return slots[whole, 1:], end - begin - int(whole.sum())

    def close(self) -> None:
        """Lets go of the descriptor; the memory stays as long as somebody reads it."""
        os.close(self.descriptor)


class RingReader:
    """One reader's place in a ring.

    Attributes:
        dropped: rows that it was too slow for.
    """

    def __init__(self, ring: Ring) -> None:
        self.ring, self.dropped = ring, 0
        self._next = ring.written

    def read(self, most: int = 1 << 16) -> Array:
        """(N, size) rows that are new, `most` at most, the oldest first."""
        begin = self._next
        end = min(self.ring.written, begin + most)
        rows, lost = self.ring.rows(begin, end)
        self._next = end
        self.dropped += lost
        return rows


def _memory() -> int:
    """A descriptor of memory without a name, which a child process may inherit."""
    if hasattr(os, "memfd_create"):
        return os.memfd_create("wrenchsight")
    with tempfile.TemporaryFile() as file:
        return os.dup(file.fileno())
