"""What the samples of a log show before they are low-passed: ceilings, steps, straight lines.

A drive's signal that stops at its largest value again and again was cut off there, by a logger or
a range of words. Whole amperes are coarser than a model's error. Positions that are straight lines
between samples some tenths of a second apart were interpolated.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.recordings.recording import Recording

MIN_RUN_SAMPLES, MIN_RUN_TIME = 5, 0.05  # s; of equal values in a row
MIN_CEILING_RUNS = 3  # at the extremes of a drive's signal
MIN_CEILING_SHARE = 3.0  # times as long as at all other values: a coarse signal has runs of each
MIN_CEILING_LEVELS = 12.0  # steps between the extremes: a signal of fewer reaches them by rounding
MOST_TIME_SHARE = 0.98  # of the log; a signal that stands there for longer is none
LOW_PASS_TIME = 0.1  # s, by which a low-pass spreads what is cut off
MOST_SAMPLES = 20000  # in which steps and straight lines are looked for
MIN_KNOTS = 10  # of straight lines
MIN_STRAIGHT_SHARE = 0.95  # of the samples of joints that move, at which no line ends
MIN_REGULAR_SHARE = 0.9  # of the ends of lines, that are a multiple of the period apart
MIN_PERIOD_SAMPLES = 4  # of a line
STRAIGHT_SHARE = 0.02  # of the usual change of slope at the end of a line: less is rounding
MIN_LEVEL_CHANGES = 50  # of a signal, from which its step shows
LEVEL_TOLERANCE = 0.02  # of a step, by which a change differs from a multiple of it at most
MIN_LEVEL_SHARE = 0.99  # of the changes that are multiples of the step


class Run(NamedTuple):
    """Samples in a row at which one joint's drive has the same value.

    Attributes:
        begin, end: s.
        joint: counted from 0.
        value: as the log has it.
    """

    begin: float
    end: float
    joint: int
    value: float


@dataclass(frozen=True, eq=False)
class SampleTraits:
    """Traits of a log's samples.

    Attributes:
        ceilings: runs at which a drive's signal stands at an extreme that cuts it off.
        effort_step: (n,) of which all values of a drive's signal are multiples; 0: none is known.
        line_samples: of a straight line of the positions; 0: they are no such lines.
        line_time: s, of such a line.
    """

    ceilings: tuple[Run, ...]
    effort_step: Array
    line_samples: int
    line_time: float

    def at_ceiling(self, t: Array, num_joints: int) -> Flags:
        """(T, n) whether a drive's signal, low-passed, is cut off at times t (T,)."""
        is_cut = np.zeros((len(t), num_joints), bool)
        for run in self.ceilings:
            is_near = (t >= run.begin - LOW_PASS_TIME) & (t <= run.end + LOW_PASS_TIME)
            is_cut[is_near, run.joint] = True
        return is_cut


class TraitFinder:
    """Finds the traits of a log that comes in parts."""

    def __init__(self) -> None:
        self._runs: list[Run] = []  # while a joint moves
        self._extremes: list[tuple[Array, Array]] = []  # (n,) least and largest of each part
        self._duration = 0.0
        self._first: list[Recording] = []  # the first MOST_SAMPLES
        self._count = 0

    def feed(self, chunk: Recording) -> None:
        """Adds the next part, on a uniform grid."""
        if chunk.num_samples < 2:
            return
        effort = chunk.current if chunk.tau_J is None else chunk.tau_J
        self._extremes.append((np.nanmin(effort, axis=0), np.nanmax(effort, axis=0)))
        step = chunk.time_step
        self._duration += step * chunk.num_samples
        shortest = max(MIN_RUN_SAMPLES, math.ceil(MIN_RUN_TIME / step))
        changes = np.abs(np.diff(chunk.v, axis=0)).max(axis=1, initial=0.0) > 0.0
        for j in range(chunk.num_joints):
            bounds = np.flatnonzero(np.diff(effort[:, j]) != 0.0) + 1
            bounds = np.concatenate([[0], bounds, [chunk.num_samples]])
            for k in np.flatnonzero(np.diff(bounds) >= shortest):
                first, last = int(bounds[k]), int(bounds[k + 1]) - 1
                if changes[first:last].mean() > 0.5:
                    value = float(effort[first, j])
                    self._runs.append(Run(float(chunk.t[first]), float(chunk.t[last]), j, value))
        if self._count < MOST_SAMPLES:
            self._first.append(chunk)
            self._count += chunk.num_samples

    def traits(self) -> SampleTraits | None:
        """The traits of all parts; None: there is no part."""
        if not self._first:
            return None
        q = np.concatenate([chunk.q for chunk in self._first])[:MOST_SAMPLES]
        effort = np.concatenate(
            [chunk.current if chunk.tau_J is None else chunk.tau_J for chunk in self._first]
        )
        line_samples = _line_samples(q)
        effort_step = np.array([_level_step(x) for x in effort[:MOST_SAMPLES].T])
        return SampleTraits(
            ceilings=self._ceilings(effort_step),
            effort_step=effort_step,
            line_samples=line_samples,
            line_time=self._first[0].time_step * line_samples,
        )

    def _ceilings(self, effort_step: Array) -> tuple[Run, ...]:
        lowest = np.min([least for least, _ in self._extremes], axis=0)
        highest = np.max([largest for _, largest in self._extremes], axis=0)
        found: list[Run] = []
        for j in range(len(lowest)):
            if highest[j] - lowest[j] < MIN_CEILING_LEVELS * effort_step[j]:
                continue
            own = [run for run in self._runs if run.joint == j]
            # A drive that is off has 0.
            ends = [end for end in (lowest[j], highest[j]) if end != 0.0]
            runs = [run for run in own if run.value in ends]
            at_ends = sum(run.end - run.begin for run in runs)
            elsewhere = sum(run.end - run.begin for run in own) - at_ends
            is_cut = len(runs) >= MIN_CEILING_RUNS and at_ends > MIN_CEILING_SHARE * elsewhere
            if is_cut and at_ends < MOST_TIME_SHARE * self._duration:
                found += runs
        return tuple(found)


def _level_step(x: Array) -> float:
    """The step of which all changes of a signal (T,) are multiples; 0: there is none."""
    changes = np.abs(np.diff(x[np.isfinite(x)]))
    changes = changes[changes > 0.0]
    if len(changes) < MIN_LEVEL_CHANGES:
        return float(changes.min()) if len(changes) else 0.0
    step = float(changes.min())
    multiples = changes / step
    is_multiple = np.abs(multiples - np.round(multiples)) <= LEVEL_TOLERANCE
    return step if float(is_multiple.mean()) >= MIN_LEVEL_SHARE else 0.0


def _line_samples(q: Array) -> int:
    """Samples between those that positions (T, n) are straight lines between; 0: they are not."""
    q = q[np.isfinite(q).all(axis=1)]
    if len(q) < MIN_KNOTS * MIN_PERIOD_SAMPLES:
        return 0
    bend = np.abs(np.diff(q, 2, axis=0))
    largest = bend.max(axis=0)
    bend = bend[:, largest > 0.0] / largest[largest > 0.0]
    if not bend.size:
        return 0
    size = bend.max(axis=1)
    is_end = size > STRAIGHT_SHARE * float(np.median(size[size > STRAIGHT_SHARE]))
    ends = np.flatnonzero(is_end)
    if len(ends) < MIN_KNOTS or float(is_end.mean()) > 1.0 - MIN_STRAIGHT_SHARE:
        return 0
    spacing = np.diff(ends)
    period = int(np.median(spacing))
    is_regular = period >= MIN_PERIOD_SAMPLES and (
        float((spacing % period == 0).mean()) >= MIN_REGULAR_SHARE
    )
    return period if is_regular else 0
