"""Samples whose stamps do not increase: repeats and unset stamps are left out and counted.

Two publishers, relays and replays write a message twice; a clock that is not set stamps 0. A sample
that differs from another one of the same stamp is refused.
"""

import numpy as np

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.recordings.recording import Recording, concatenated, place_of
from wrenchsight.models.recordings.resampling import (
    COARSE_CLOCK,
    LONGEST_BRIDGE,
    is_rounded,
    time_error,
)

_HISTORY_SAMPLES = 512  # samples before a repeat among which its first copy is looked for


class StampFilter:
    """Leaves out samples of successive chunks.

    Attributes:
        num_repeated: samples that repeat another one.
        num_unset: samples whose stamp is 0 in a log whose others are far from it.
    """

    def __init__(self) -> None:
        self.num_repeated = 0
        self.num_unset = 0
        self._history: Recording | None = None
        self._pending: Recording | None = None  # samples at 0, before any other

    def notices(self) -> tuple[str, ...]:
        """What was left out, one sentence each."""
        sentences = []
        if self.num_repeated:
            sentences.append(
                f"samples left out because they repeat another one with its stamp: "
                f"{self.num_repeated}"
            )
        if self.num_unset:
            sentences.append(f"samples left out because their stamp is not set: {self.num_unset}")
        return tuple(sentences)

    def kept(self, chunk: Recording) -> Recording:
        """The samples of the next chunk whose time increases.

        Left out are those whose stamp is not set (0), and repeats: samples with the stamp and all
        the numbers of one of the last _HISTORY_SAMPLES. A log that begins with stamps of 0 waits
        for others (`rest` returns what waited).

        Raises:
            InputError: time runs backwards, or two samples of one stamp differ.
        """
        part = chunk if self._pending is None else concatenated([self._pending, chunk])
        self._pending = None
        if self._history is None and (part.t == 0.0).all():
            self._pending = part
            return part[:0]
        is_unset = self._unset(part.t)  # which also depends on the history
        self.num_unset += int(is_unset.sum())
        stamped = part[~is_unset] if is_unset.any() else part
        if not stamped.num_samples:
            return stamped
        history = self._history
        is_later = history is None or bool(stamped.t[0] > history.t[-1])
        if is_later and (np.diff(stamped.t) > 0.0).all():
            self._history = stamped[-_HISTORY_SAMPLES:]
            return stamped
        # Some sample is not later than all before it: it must repeat one of them.
        with_history = stamped if history is None else concatenated([history, stamped])
        begin = 0 if history is None else history.num_samples  # of `stamped` behind the history
        is_kept = np.ones(with_history.num_samples, bool)
        latest = np.maximum.accumulate(with_history.t)
        late = 1 + np.flatnonzero(with_history.t[1:] <= latest[:-1])
        signals = _signals(with_history)
        for k in late[late >= begin].tolist():  # in their order: a repeat repeats one that is kept
            if not self._is_repeat(with_history, signals, is_kept, k):
                raise _stamp_error(with_history, signals, k)
            is_kept[k] = False
            self.num_repeated += 1
        self._history = with_history[is_kept][-_HISTORY_SAMPLES:]
        return with_history[is_kept & (np.arange(with_history.num_samples) >= begin)]

    def rest(self) -> Recording | None:
        """The samples of a log that ends before its clock runs; None for any other log.

        Raises:
            InputError: there are several: no clock was set.
        """
        if self._pending is not None and self._pending.num_samples > 1:
            problem = "all stamps are 0: no clock was set, and the log holds no time"
            remedy = "if it was recorded at a known rate, add --log-format rate_hz=100 (samples a "
            remedy += "second; in a description rate_hz: 100 in place of time)"
            raise InputError(self._pending.source, self._pending.time_place, problem, remedy)
        return self._pending

    def _unset(self, t: Array) -> Flags:
        """(T,) stamps that a clock wrote before it was set."""
        is_zero = np.asarray(t == 0.0)
        if not is_zero.any():
            return is_zero
        others = t[~is_zero]
        is_far = len(others) > 0 and others[0] > LONGEST_BRIDGE
        if self._history is not None and self._history.t[-1] > LONGEST_BRIDGE:
            is_far = True
        if is_far:
            return is_zero
        # A clock that starts late: of several samples at 0 the last one begins the log.
        is_coarse = np.mean(np.diff(others) == 0.0) > COARSE_CLOCK if len(others) > 1 else True
        leading = int(np.argmin(is_zero)) if not is_coarse else 0
        is_first = np.arange(len(t)) < leading - 1
        return is_first if self._history is None else np.zeros(len(t), bool)

    @staticmethod
    def _is_repeat(part: Recording, signals: Array, is_kept: Flags, k: int) -> bool:
        begin = max(0, k - _HISTORY_SAMPLES)
        same_stamp = begin + np.flatnonzero((part.t[begin:k] == part.t[k]) & is_kept[begin:k])
        return any(np.array_equal(signals[i], signals[k], equal_nan=True) for i in same_stamp)


def _signals(part: Recording) -> Array:
    """(T, m) all numbers of the samples but their stamps."""
    parts = [
        part.q,
        part.v,
        part.current,
        *(x.reshape(len(part.t), -1) for x in part.extra.values()),
    ]
    if part.tau_J is not None:
        parts.append(part.tau_J)
    return np.concatenate(parts, axis=1)


def _stamp_error(part: Recording, signals: Array, k: int) -> InputError:
    i = k - 1
    num_equal = int((np.diff(part.t) == 0.0).sum())
    is_coarse = num_equal > max(2, COARSE_CLOCK * part.num_samples)
    if part.t[i] != part.t[k] or is_coarse or is_rounded(part.t):
        return time_error(part, k)
    difference = float(np.nanmax(np.abs(signals[k] - signals[i]), initial=0.0))
    problem = (
        f"has the stamp {part.t[k]:.9g} s of {place_of(part, i)}, but other numbers (by up to "
        f"{difference:.3g}): two sources write into this log"
    )
    remedy = "record one of them, or leave out the other one's rows"
    return InputError(part.source, f"{place_of(part, k)}, {part.time_place}", problem, remedy)
