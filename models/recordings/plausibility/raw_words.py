"""Whole numbers with a sign that were logged as words without one."""

from typing import NamedTuple

import numpy as np

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.recording_format import SIGN_BIT, TWOS_COMPLEMENT, Signal

_LEAST_BITS, _MOST_BITS = 8, 32  # the shortest and the longest whole number of a drive
# Changes of the sign that one column has at least, there and back: a single one in each may be the
# step of numbers without a sign, as when the drives are switched on.
_LEAST_CHANGES = 2
# Times, by which the decoded numbers change less. It is 1 for numbers without a sign that jump
# about, less where they are smooth, and 1 + 1/x for smooth words that reach the share x of their
# range: 4 finds those up to a third.
_SMOOTHER_RATIO = 4.0


class RawWords(NamedTuple):
    """How words are to be read: `SignalColumns.encoding` and `bits`."""

    encoding: str
    bits: int


def raw_words(columns: Array) -> RawWords | None:
    """How the words (N, k) of a signal were encoded; None where they are numbers as they are.

    Numbers near zero that change their sign jump by a whole range of words. Decoded, they change
    by far less. A wrong claim refuses a log that is right: where it is not sure, they are numbers.
    """
    if not columns.size or not np.isfinite(columns).all():
        return None
    if columns.min() < 0.0 or (columns != np.rint(columns)).any():
        return None
    bits = int(columns.max()).bit_length()  # a number below zero sets the highest bit of a word
    if not _LEAST_BITS <= bits <= _MOST_BITS:
        return None
    half = 2.0 ** (bits - 1)  # from here on a word stands for a number below zero
    changes = np.abs(np.diff(columns >= half, axis=0)).sum(axis=0)  # of each column
    if changes.max() < _LEAST_CHANGES:
        return None
    # The sum of all steps from row to row, of the words as they are and decoded in either way.
    plain_travel = np.abs(np.diff(columns, axis=0)).sum()
    travels = {}
    for encoding in (TWOS_COMPLEMENT, SIGN_BIT):
        scale = np.ones(columns.shape[1])
        signal = Signal(
            name="",
            columns=(),
            scale=scale,
            offset=0.0 * scale,
            shape=(),
            encoding=encoding,
            bits=bits,
        )
        travels[encoding] = np.abs(np.diff(signal.numbers(columns), axis=0)).sum()
    best = min(travels, key=lambda encoding: travels[encoding])
    return RawWords(best, bits) if _SMOOTHER_RATIO * travels[best] < plain_travel else None
