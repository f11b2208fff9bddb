"""A wrench as a function of time: a list of steps, ramps, sines and hand pushes.

A scenario's wrench can so be evaluated without simulating it. A script states `force` and `moment`;
in arrays the wrench is rotation first.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Union

import numpy as np

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array, Record, record_type
from wrenchsight.models.numerics.kernel import kernel

_STEP_SHAPE, _RAMP_SHAPE, _SINE_SHAPE, _PUSH_SHAPE = 0.0, 1.0, 2.0, 3.0  # values of `shape`
SEGMENT_TYPE = record_type(
    shape=(),
    start=(),
    end=(),
    wrench=(6,),
    rise=(),
    frequency=(),
    phase=(),
    fade=(),
    push_length=(),
    push_period=(),
    push_index=(),
)
"""A segment, as `sample_script` reads it.

    shape        step, ramp, sine or push
    start, end   s, since the start of the script's time
    wrench       (6,) N m and N, rotation first: amplitude or sd, which the shape multiplies
    rise         s, of a ramp
    frequency    Hz, of a sine
    phase        rad, of a sine
    fade         s, of a push, at either end
    push_length  s, of one push
    push_period  s, from the begin of one push to the next
    push_index   of a push, its row of the tones

Fields of other shapes are 0, but `push_period`, a divisor: 1.
"""
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
def sample_script(table: Record, tones: Array, t: float, wrench: Array) -> None:
    """Writes the wrench (6,) of a script at time t, s; rotation first, N m, N.

    Args:
        table: (segments,) of SEGMENT_TYPE; segments add up.
        tones: (pushes, 6 axes, tones, 2) angular frequency rad/s and phase rad of each push.
        t: s.
        wrench: written.
    """
    wrench[:] = 0.0
    for i in range(table.shape[0]):
        segment = table[i]
        if t < segment.start or t >= segment.end:
            continue
        shape = segment.shape
        elapsed = t - segment.start  # since the segment's start: the tones run on from push to push
        if shape == _PUSH_SHAPE:
            push = int(segment.push_index)
            fade = segment.fade
            push_time = elapsed % segment.push_period  # since the start of the present push
            # To the nearer end of the push, or of the segment; negative in the pause.
            edge = min(push_time, segment.push_length - push_time, segment.end - t)
            if edge < 0.0:
                continue
            window = 1.0
            if edge < fade:
                window = 0.5 * (1.0 - np.cos(np.pi * edge / fade))
            # A sum of so many sines has the variance tones / 2.
            per_sine = np.sqrt(2.0 / tones.shape[2])
            for axis in range(6):
                if segment.wrench[axis] != 0.0:
                    sines = 0.0
                    for k in range(tones.shape[2]):
                        sines += np.sin(tones[push, axis, k, 0] * elapsed + tones[push, axis, k, 1])
                    wrench[axis] += window * segment.wrench[axis] * sines * per_sine
            continue
        if shape == _STEP_SHAPE:
            gain = 1.0
        elif shape == _RAMP_SHAPE:
            gain = min(elapsed / segment.rise, 1.0)
        else:  # _SINE_SHAPE
            gain = np.sin(2.0 * np.pi * segment.frequency * elapsed + segment.phase)
        for axis in range(6):
            wrench[axis] += gain * segment.wrench[axis]


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
        self.table = np.zeros(len(self.segments), SEGMENT_TYPE)
        tones: list[Array] = []  # one entry a push
        for i, segment in enumerate(segments):
            _check(segment, i, source)
            _write_segment(segment, self.table[i], push_index=len(tones))
            if isinstance(segment, HandPush):
                tones.append(_random_tones(segment, np.random.default_rng([seed, segment.seed, i])))
        self.tones = np.array(tones, dtype=np.float64).reshape(-1, 6, _NUM_TONES, 2)

    def sample(self, t: float) -> Array:
        """The wrench (6,) at time t, rotation first: [moment N m; force N]."""
        wrench = np.empty(6)
        sample_script(self.table, self.tones, t, wrench)
        return wrench


def _write_segment(segment: WrenchSegment, entry: np.void, push_index: int) -> None:
    """Writes a segment into its entry of SEGMENT_TYPE, which holds zeros.

    Args:
        push_index: row of its tones, of a HandPush.
    """
    entry["start"], entry["end"] = segment.start, segment.start + segment.duration
    entry["wrench"] = (*segment.moment, *segment.force)
    entry["push_period"] = 1.0
    if isinstance(segment, WrenchStep):
        entry["shape"] = _STEP_SHAPE
    elif isinstance(segment, WrenchRamp):
        entry["shape"], entry["rise"] = _RAMP_SHAPE, segment.rise
    elif isinstance(segment, WrenchSine):
        entry["shape"] = _SINE_SHAPE
        entry["frequency"], entry["phase"] = segment.frequency, segment.phase
    else:
        length = segment.each if segment.each > 0.0 else segment.duration
        entry["shape"], entry["fade"], entry["push_index"] = _PUSH_SHAPE, segment.fade, push_index
        entry["push_length"], entry["push_period"] = length, length + segment.pause


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
