"""Logs on a uniform time grid, chunk by chunk.

The rule is causal, so that chunks of any size give the samples of one pass, bit by bit:

- The step h is the median step of the first 65,536 samples, unless it is given.
- As long as every step of the log is within 1 % of h, its samples are taken as they are.
- From the first other step on, the signals are interpolated linearly on the grid t_0 + k h. t_0 is
  the time of the last sample that was taken as it is.
- A step longer than 1.75 h means that samples are missing. Grid points inside it are bridged by
  the same interpolation and flagged in `dropout`. A gap longer than `max_gap` is an error.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.recording import Recording, concatenated, place_of

UNIFORM_TOLERANCE = 0.01  # of the step
DROPOUT_STEPS = 1.75  # a longer step misses a sample; jitter stays below in logs of real robots
TIME_TOLERANCE = 1e-3  # of the step; UNIX time in a double is a multiple of 0.24 us
MAX_GAP_S = 0.1  # at 1 rad/s^2 the interpolated q is then off by at most 1.3 mrad
MAX_GAP_STEPS = 3  # the least number of steps that may be bridged, for slow logs
STEP_SAMPLES = 1 << 16  # at the beginning of a log, whose median step is the log's
COARSE_CLOCK = 0.1  # share of repeated times above which the clock is too coarse
_PLAUSIBLE_STEP = (1e-5, 0.25)  # s, least and most of a log of motor currents
_FASTEST_JOINT = 300.0  # a second, in rad, m or degrees: no arm's joint moves faster
_REQUESTED_STEP = (1e-5, 1.0)  # s, least and most that may be requested
LONGEST_BRIDGE = 60.0  # s, longest gap that may be bridged on request
_MIN_ROUNDED = 3  # stamps that repeat where a clock is rounded
_MIN_CHANGES = 3  # of a coarse clock, whose rate is known to one sample in their time
_FASTEST_HZ = 1e5  # of any log of joints; beyond, the column is no clock
_LARGE_TIME = 1e6  # s, such as since 1970: its milliseconds need more digits
_MOST_POINTS = 1 << 20  # grid points of one chunk; with more the step is far too small


def resample_chunks(
    chunks: Iterable[Recording], time_step: float | None = None, max_gap: float | None = None
) -> Iterator[Recording]:
    """Puts a recording that comes in chunks on a uniform grid.

    As long as the log's steps are h, its samples are returned as they are; from the first other
    step on they are interpolated linearly at even times, those in gaps marked as dropouts.

    There is no filter: a step longer than the log's aliases faster content into the result.

    Args:
        chunks: successive parts of one recording.
        time_step: h, s; None: the median step of the first samples.
        max_gap: longest step of the log that is bridged, s; by default 0.1 s or 3 h, whichever is
            longer.

    Raises:
        InputError: time stands still or runs backwards, a gap is too long, or the step is no
            plausible one (wrong unit of time).
    """
    least_step, largest_step = _REQUESTED_STEP
    if time_step is not None and not least_step <= time_step <= largest_step:
        problem = f"{time_step:g} s, expected {least_step:g} to {largest_step:g} s"
        raise InputError("time step", "", problem, "give a step in seconds, such as 0.001")
    if max_gap is not None and not 0 <= max_gap <= LONGEST_BRIDGE:
        problem = f"{max_gap:g} s, expected 0 to {LONGEST_BRIDGE:g} s"
        raise InputError("max gap", "", problem, "split the log at a longer gap")
    grid: _Grid | None = None
    for chunk in _with_long_first_chunk(iter(chunks)):
        if grid is None:
            step = time_step or plausible_step(chunk)
            grid = _Grid(step, max_gap if max_gap is not None else default_max_gap(step))
        yield grid.resampled(chunk)


def resampled(
    recording: Recording, time_step: float | None = None, max_gap: float | None = None
) -> Recording:
    """Returns a recording on a uniform grid; arguments and errors as `resample_chunks`."""
    chunks = list(resample_chunks([recording], time_step, max_gap))
    return replace(concatenated(chunks), notices=recording.notices)


def default_max_gap(time_step: float) -> float:
    """Longest gap that is bridged by default, s."""
    return max(MAX_GAP_S, MAX_GAP_STEPS * time_step * (1 + UNIFORM_TOLERANCE))


def _with_long_first_chunk(chunks: Iterator[Recording]) -> Iterator[Recording]:
    """The same samples, the first chunk long enough for the median step."""
    parts: list[Recording] = []
    for chunk in chunks:
        parts.append(chunk)
        if sum(part.num_samples for part in parts) >= STEP_SAMPLES:
            break
    if parts:
        yield concatenated(parts)
    yield from chunks


def plausible_step(chunk: Recording) -> float:
    """The median step of the first samples of a recording, s, to nine digits.

    Raises:
        InputError: the step is not that of a robot's log: time in another unit.
    """
    if chunk.num_samples < 2:
        raise InputError(chunk.source, "", "holds one sample only", "record a longer log")
    median = np.median(np.diff(chunk.t[:STEP_SAMPLES]))
    step = float(f"{median:.9g}")  # 0.01 rather than 0.00999999999990905
    shortest, longest = _PLAUSIBLE_STEP
    if shortest <= step <= longest or step <= 0:  # `time_error` reports time that runs backwards
        return step
    units = (("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9))
    plausible_units = [name for name, factor in units if shortest <= step * factor <= longest]
    remedy = "check the unit of time"
    if plausible_units:
        unit = plausible_units[0]
        moves = np.abs(np.diff(chunk.q[:STEP_SAMPLES], axis=0))
        speed = np.median(moves.max(axis=1)) / (step * dict(units)[unit])
        remedy = f"it looks like {unit}: set time: {{unit: {unit}}} in a description (--log-format)"
        if speed > _FASTEST_JOINT:
            remedy = (
                f"record 50 samples a second or more; were the time in {unit}, "
                f"a joint would move by {speed:.3g} (rad or degrees) a second"
            )
    problem = f"the median step is {step:.6g} s, expected {shortest} to {longest} s"
    raise InputError(chunk.source, chunk.time_place, problem, remedy)


class _Grid:
    """Resamples successive chunks; keeps the last sample and the grid from chunk to chunk."""

    def __init__(self, step: float, max_gap: float) -> None:
        self._step = step
        self._max_gap = max_gap
        self._last: Recording | None = None  # one sample
        self._is_uniform = True  # the log so far
        self._origin = 0.0  # s, of the grid, once the log is not uniform
        self._next_point = 1  # number of the next grid point

    def resampled(self, chunk: Recording) -> Recording:
        """The samples of the next chunk on the grid."""
        is_first = self._last is None
        part = chunk if self._last is None else concatenated([self._last, chunk])
        self._last = part[-1:]
        steps = np.diff(part.t)
        self._check_steps(part, steps)
        if not self._is_uniform:
            return self._interpolated(part, steps)
        begin = 0 if is_first else 1  # the last sample of the chunk before was returned with it
        irregular = np.flatnonzero(np.abs(steps - self._step) > UNIFORM_TOLERANCE * self._step)
        if not len(irregular):
            return part[begin:]
        last_regular = int(irregular[0])
        self._is_uniform = False
        self._origin = float(part.t[last_regular])
        interpolated = self._interpolated(part[last_regular:], steps[last_regular:])
        return concatenated([part[begin : last_regular + 1], interpolated])

    def _check_steps(self, part: Recording, steps: Array) -> None:
        """Refuses time that does not increase, and gaps that are too long."""
        refused = np.flatnonzero(~((steps > 0) & (steps <= self._max_gap)))
        if not len(refused):
            return
        k = int(refused[0])
        if steps[k] <= 0:
            raise time_error(part, k + 1)
        problem = f"a gap of {steps[k]:.4g} s, expected at most {self._max_gap:.4g} s"
        raise InputError(
            part.source,
            f"{place_of(part, k)} to {place_of(part, k + 1)}, {part.time_place}",
            problem,
            "split the log there, or let `estimate` bridge it (--max-gap)",
        )

    def _interpolated(self, part: Recording, steps: Array) -> Recording:
        """The part at its grid points in (t[0] + r, t[-1] + r], with r the rounding error of t.

        Args:
            part: the last sample before and those after it; the grid's points up to the first of
                them have been returned.
            steps: (T - 1,) s from each sample of the part to the next.

        Returns:
            Linear between samples. A point is a dropout where a sample beside it is one, or where
            it lies inside a gap, away from both ends. Each has the row of the nearer sample.

        Raises:
            InputError: far more points than samples.
        """
        h = self._step
        # Up to where a grid point counts as a sample's or before it: a point at a sample's time,
        # but for rounding, has the weight 1 or a little more, which `_between` takes as 1.
        bounds = part.t + TIME_TOLERANCE * h
        last_point = int(np.floor((bounds[-1] - self._origin) / h)) + 1
        num_points = last_point - self._next_point
        if num_points > _MOST_POINTS:
            problem = f"a step of {h:g} s makes {num_points} samples of {part.num_samples}"
            raise InputError(part.source, "", problem, "give a time step nearer to the log's")
        # One point more than the quotient gives, as it may be rounded down; then those within.
        t = self._origin + h * np.arange(self._next_point, last_point + 1)
        t = t[t <= bounds[-1]]
        self._next_point += len(t)
        left = np.searchsorted(bounds, t, side="left") - 1  # bounds[left] < t <= bounds[left + 1]
        weight = (t - part.t[left]) / steps[left]
        to_nearest = np.minimum(t - part.t[left], part.t[left + 1] - t)
        is_bridged = (steps[left] > DROPOUT_STEPS * h) & (to_nearest > UNIFORM_TOLERANCE * h)
        nearest = np.where(weight < 0.5, left, left + 1)
        return replace(
            part,
            t=t,
            q=_between(part.q, left, weight),
            v=_between(part.v, left, weight),
            current=_between(part.current, left, weight),
            tau_J=None if part.tau_J is None else _between(part.tau_J, left, weight),
            dropout=is_bridged | part.dropout[left + 1] | (part.dropout[left] & (weight < 1)),
            extra={name: _between(signal, left, weight) for name, signal in part.extra.items()},
            row=None if part.row is None else part.row[nearest],
        )


def _between(signal: Array, left: NDArray[np.int64], weight: Array) -> Array:
    """Interpolates a signal between samples `left` and `left + 1`.

    With weight 1 the value is that of the right sample, even if the left one is NaN.
    """
    weight = weight.reshape(-1, *[1] * (signal.ndim - 1))
    right = signal[left + 1]
    return np.where(weight < 1.0, signal[left] + weight * (right - signal[left]), right)


def time_error(recording: Recording, sample: int) -> InputError:
    """The error for a sample whose time is not later than that of the sample before it."""
    previous, current = recording.t[sample - 1], recording.t[sample]
    problem = f"time repeats {previous:.9g} s, expected to increase"
    digits = 9 if abs(previous) < _LARGE_TIME else 13
    if current != previous:
        problem = f"time runs backwards from {previous:.{digits}g} s to {current:.{digits}g} s"
        problem += ", expected to increase"
    remedy = "remove the repeated rows"
    if current < previous:
        remedy = "split the log there: a clock was set, or one recording follows another"
    if is_rounded(recording.t):
        remedy = "time has too few digits: log it with more; if the samples are evenly spaced, add "
        remedy += f"--log-format rate_hz={_rate_of_ticks(recording.t)}"
    place = f"{place_of(recording, sample)}, {recording.time_place}"
    return InputError(recording.source, place, problem, remedy)


def is_rounded(t: Array) -> bool:
    """Whether a clock (T,) shows too few digits: many stamps repeat, or each repeat is made up for.

    Where rows are written twice they are as many more than steps of the clock.
    """
    steps = np.diff(t)
    num_equal = int((steps == 0.0).sum())
    if len(t) <= 2 / COARSE_CLOCK or not num_equal:
        return False
    if num_equal > COARSE_CLOCK * len(steps):
        return True
    step = float(np.median(steps[steps > 0.0]))
    num_too_many = len(steps) - (t[-1] - t[0]) / step
    return num_equal >= _MIN_ROUNDED and abs(num_too_many) < 0.5 * num_equal


def _rate_of_ticks(t: Array) -> str:
    """Samples a second of a coarse clock, from its first change to its last one, for a remedy."""
    changes = 1 + np.flatnonzero(np.diff(t) > 0.0)
    if len(changes) < _MIN_CHANGES:
        return "100, with the rate that it was recorded at"
    rate = (changes[-1] - changes[0]) / (t[changes[-1]] - t[changes[0]])
    if rate > _FASTEST_HZ:
        return "100, with the rate that it was recorded at"
    return f"{rate:.3g} (estimated: better the rate that was set)"
