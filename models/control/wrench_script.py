"""A wrench as a function of time: a list of steps, ramps, sines and hand pushes.

A scenario's wrench can so be evaluated without simulating it. A script states `force` and `moment`;
in arrays the wrench is rotation first.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Union

import numpy as np

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import kernel

_STEP_SHAPE, _RAMP_SHAPE, _SINE_SHAPE, _PUSH_SHAPE = 0.0, 1.0, 2.0, 3.0  # values of column _KIND
# Columns of the table of segments, one row a segment; times in s since the start of the script's
# time, lengths in s, frequency in Hz, phase in rad. Columns of other kinds are zero.
_KIND, _START, _END = 0, 1, 2  # of every segment
_RISE, _FREQUENCY, _FADE = 3, 3, 3  # of a ramp, a sine, a push
_PHASE, _PUSH_INDEX = 4, 4  # of a sine; of a push: its row of the tones
_WRENCH_BEGIN = 5  # first of six: the wrench, amplitude or sd, N m and N
_PUSH_LENGTH, _PUSH_PERIOD = 11, 12  # length of one push, and from the begin of one to the next
_NUM_COLUMNS = 13
_NUM_TONES = 24  # enough for a nearly Gaussian amplitude; few enough for one microsecond a sample
_ENDLESS_TIME = 1e12  # s; finite, so that it survives YAML


def _zero() -> list[float]:
    return [0.0, 0.0, 0.0]


@dataclass
class WrenchStep:
    """Jumps to (force, moment) at `start`, and back to zero after `duration`."""

    start: float = 0.0
    """s"""
    duration: float = _ENDLESS_TIME
    """s"""
    force: list[float] = field(default_factory=_zero)
    """N, on the robot at E, axes of W"""
    moment: list[float] = field(default_factory=_zero)
    """N m, about E, axes of W"""


@dataclass
class WrenchRamp:
    """Grows linearly from zero at `start` over `rise`, holds, and vanishes after `duration`."""

    start: float = 0.0
    """s"""
    rise: float = 1.0
    """s"""
    duration: float = _ENDLESS_TIME
    """s, rise included"""
    force: list[float] = field(default_factory=_zero)
    """N, reached after the rise"""
    moment: list[float] = field(default_factory=_zero)
    """N m, reached after the rise"""


@dataclass
class WrenchSine:
    """Amplitude times sin(2 pi frequency (t - start) + phase) from `start` for `duration`."""

    start: float = 0.0
    """s"""
    duration: float = _ENDLESS_TIME
    """s"""
    frequency: float = 1.0
    """Hz"""
    phase: float = 0.0
    """rad"""
    force: list[float] = field(default_factory=_zero)
    """N, amplitude"""
    moment: list[float] = field(default_factory=_zero)
    """N m, amplitude"""


@dataclass
class HandPush:
    """A random push of limited bandwidth, as of a hand: smooth, and never the same.

    It is a sum of sines of random frequency and phase, drawn once from the seed, so that it can be
    repeated. It is faded in and out by a raised cosine. With `each` it comes and goes: pushes of
    that length, with a pause after each.
    """

    start: float = 0.0
    """s"""
    duration: float = 5.0
    """s"""
    bandwidth: float = 1.5
    """Hz"""
    fade: float = 0.3
    """s, at either end"""
    each: float = 0.0
    """s, length of one push; 0: a single one, as long as the duration"""
    pause: float = 0.0
    """s, after each push"""
    seed: int = 0
    """the scenario's own seed is added"""
    force: list[float] = field(default_factory=_zero)
    """N, standard deviation per axis"""
    moment: list[float] = field(default_factory=_zero)
    """N m, standard deviation per axis"""


WrenchSegment = Union[WrenchStep, WrenchRamp, WrenchSine, HandPush]  # noqa: UP007 (yaml_load_typed)


@kernel
def sample_script(table: Array, tones: Array, t: float, wrench: Array) -> None:
    """Writes the wrench (6,) of a script at time t, s; rotation first, N m, N.

    Args:
        table: (segments, _NUM_COLUMNS), columns _KIND to _PUSH_PERIOD: shape and times of
            a segment, and from _WRENCH_BEGIN on the wrench (6,) that its shape multiplies. Segments
            add up.
        tones: (pushes, 6 axes, tones, 2) angular frequency rad/s and phase rad of each push.
        t: s.
        wrench: written.
    """
    wrench[:] = 0.0
    for i in range(table.shape[0]):
        start, end = table[i, _START], table[i, _END]
        if t < start or t >= end:
            continue
        kind = table[i, _KIND]
        elapsed = t - start  # since the segment's start: the tones run on from push to push
        if kind == _PUSH_SHAPE:
            push = int(table[i, _PUSH_INDEX])
            fade = table[i, _FADE]
            push_time = elapsed % table[i, _PUSH_PERIOD]  # since the start of the present push
            # To the nearer end of the push, or of the segment; negative in the pause.
            edge = min(push_time, table[i, _PUSH_LENGTH] - push_time, end - t)
            if edge < 0.0:
                continue
            window = 1.0
            if edge < fade:
                window = 0.5 * (1.0 - np.cos(np.pi * edge / fade))
            # A sum of so many sines has the variance tones / 2.
            per_sine = np.sqrt(2.0 / tones.shape[2])
            for axis in range(6):
                if table[i, _WRENCH_BEGIN + axis] != 0.0:
                    sines = 0.0
                    for k in range(tones.shape[2]):
                        sines += np.sin(tones[push, axis, k, 0] * elapsed + tones[push, axis, k, 1])
                    wrench[axis] += window * table[i, _WRENCH_BEGIN + axis] * sines * per_sine
            continue
        if kind == _STEP_SHAPE:
            gain = 1.0
        elif kind == _RAMP_SHAPE:
            gain = min(elapsed / table[i, _RISE], 1.0)
        else:  # _SINE_SHAPE
            gain = np.sin(2.0 * np.pi * table[i, _FREQUENCY] * elapsed + table[i, _PHASE])
        for axis in range(6):
            wrench[axis] += gain * table[i, _WRENCH_BEGIN + axis]


class WrenchScript:
    """The sum of the segments, as a function of time.

    Args:
        segments: they add up; each acts in start <= t < start + duration.
        seed: added to the seed of each HandPush.
        source: the file that the segments come from, for error lines.

    Attributes:
        segments: as given.
        table, tones: of `sample_script`.

    Raises:
        InputError: a time, frequency, force or moment that is not finite, negative where that has
            no meaning, or not of length 3.
    """

    def __init__(
        self, segments: Sequence[WrenchSegment], seed: int = 0, source: str = "wrench"
    ) -> None:
        self.segments = tuple(segments)
        rows: list[Array] = []
        tones: list[Array] = []  # one entry a push
        for i, segment in enumerate(segments):
            _check(segment, i, source)
            rows.append(_table_row(segment, push_index=len(tones)))
            if isinstance(segment, HandPush):
                tones.append(_random_tones(segment, np.random.default_rng([seed, segment.seed, i])))
        self.table = np.array(rows, dtype=np.float64).reshape(-1, _NUM_COLUMNS)
        self.tones = np.array(tones, dtype=np.float64).reshape(-1, 6, _NUM_TONES, 2)

    def sample(self, t: float) -> Array:
        """The wrench (6,) at time t, rotation first: [moment N m; force N]."""
        wrench = np.empty(6)
        sample_script(self.table, self.tones, t, wrench)
        return wrench


def _table_row(segment: WrenchSegment, push_index: int) -> Array:
    """The (_NUM_COLUMNS,) numbers of a segment, of `sample_script`.

    Args:
        push_index: row of its tones, of a HandPush.
    """
    row = np.zeros(_NUM_COLUMNS)
    row[_START], row[_END] = segment.start, segment.start + segment.duration
    row[_WRENCH_BEGIN : _WRENCH_BEGIN + 6] = (*segment.moment, *segment.force)
    row[_PUSH_PERIOD] = 1.0  # a divisor
    if isinstance(segment, WrenchStep):
        row[_KIND] = _STEP_SHAPE
    elif isinstance(segment, WrenchRamp):
        row[_KIND], row[_RISE] = _RAMP_SHAPE, segment.rise
    elif isinstance(segment, WrenchSine):
        row[_KIND] = _SINE_SHAPE
        row[_FREQUENCY], row[_PHASE] = segment.frequency, segment.phase
    else:
        row[_KIND], row[_FADE], row[_PUSH_INDEX] = _PUSH_SHAPE, segment.fade, push_index
        row[_PUSH_LENGTH] = segment.each if segment.each > 0.0 else segment.duration
        row[_PUSH_PERIOD] = row[_PUSH_LENGTH] + segment.pause
    return row


def _random_tones(push: HandPush, random: np.random.Generator) -> Array:
    """(6, tones, 2) angular frequencies, rad/s, up to the push's bandwidth, and phases, rad."""
    tones = np.empty((6, _NUM_TONES, 2))
    tones[..., 0] = 2 * np.pi * push.bandwidth * random.random((6, _NUM_TONES))
    tones[..., 1] = 2 * np.pi * random.random((6, _NUM_TONES))
    return tones


def _check(segment: WrenchSegment, index: int, source: str) -> None:
    """Raises InputError where a number of a segment is out of range.

    Args:
        segment: forces in N, moments in N m, times in s, bandwidth and frequency in Hz.
        index: of the segment in the script, from 0, for error lines.
        source: of the script, for error lines.
    """
    location = f"wrench segment {index + 1} ({type(segment).__name__})"
    for name in ("force", "moment"):
        value = getattr(segment, name)
        if len(value) != 3 or not np.all(np.isfinite(value)):
            raise InputError(
                source, location, f"{name} is {value}, expected three finite numbers", "correct it"
            )
    positive = ["duration"]
    if isinstance(segment, WrenchRamp):
        positive.append("rise")
    elif isinstance(segment, WrenchSine):
        positive.append("frequency")
    elif isinstance(segment, HandPush):
        positive += ["bandwidth", "fade"]
        # Zero: one push as long as the duration, and no pause.
        if not (
            np.isfinite(segment.each + segment.pause) and min(segment.each, segment.pause) >= 0
        ):
            times = f"each is {segment.each}, pause {segment.pause}"
            raise InputError(source, location, f"{times}, expected zero or more", "correct it")
    for name in positive:
        value = getattr(segment, name)
        if not (np.isfinite(value) and value > 0):
            raise InputError(
                source, location, f"{name} is {value}, expected a positive number", "correct it"
            )
    if not np.isfinite(segment.start):
        raise InputError(source, location, f"start is {segment.start}", "give a time in s")
