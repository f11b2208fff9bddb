"""Order of a live stream, and its uniform grid.

`StreamOrder` judges whether a sample comes in order and in time; others are left out, with an
event. `SampleGrid` resamples sample by sample by the rule of `models.recordings.resampling`: the
numbers of `resample_chunks`, at a tenth of the cost of chunks of one.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from wrenchsight.models.live.samples import EventKind, Sample, StreamEvent
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.resampling import (
    DROPOUT_STEPS,
    TIME_TOLERANCE,
    UNIFORM_TOLERANCE,
)

DEFAULT_LATE = 0.05
"""s, by which a sample may come later than the quickest one: more than a network's jitter, less
than a queue that has built up."""
SAY_AGAIN = 1.0  # s between two events of one kind
# successive samples before the latest one that show that the clock jumped back
MIN_LATE_SAMPLES = 3
CLOCK_SLACK = 0.5  # s by which a gap of the controller's clock may exceed the computer's
_MAX_CLOCK_DRIFT = 2e-4  # s/s by which two clocks may drift apart


class SampleOrder(NamedTuple):
    """Judgement of a sample.

    Attributes:
        counts: whether it is read.
        begins_anew: whether reading begins anew with it.
    """

    counts: bool
    begins_anew: bool


_LEFT_OUT = SampleOrder(counts=False, begins_anew=False)


@dataclass
class StreamOrder:
    """The order of one stream.

    Attributes:
        late: s, by which a sample may come later than the quickest one.
        rate: as `Source`.
        step: s, of the stream; infinite until it is known: no gap is seen.
        max_gap: s, longest gap that is bridged; infinite until the step is known.
        is_late: whether the samples come late now.
    """

    late: float
    rate: float
    step: float = math.inf
    max_gap: float = math.inf
    is_late: bool = False
    _last: Sample | None = None
    _behind: list[float] = field(default_factory=list)
    _offset: float = math.inf
    _event_times: dict[EventKind, float] = field(default_factory=dict)
    _counts: dict[EventKind, int] = field(default_factory=dict)

    def forget(self) -> None:
        """Begins anew: the connection was lost."""
        self._last, self._behind, self._offset, self.is_late = None, [], math.inf, False

    def take(self, sample: Sample, events: list[StreamEvent]) -> SampleOrder:
        """Judges the next sample.

        One that is older than the last is left out; MIN_LATE_SAMPLES of them in rising order show
        that the clock has jumped back.

        Args:
            sample: as it came.
            events: gets an event for whatever is wrong.

        Returns:
            Whether the sample counts (else it is to be left out), and whether the reading begins
            anew with it: after a jump of the clock, or a gap longer than `max_gap`.
        """
        if not math.isfinite(sample.t):
            self._say(
                EventKind.GARBAGE, "a sample's time is no number; it is left out", sample, events
            )
            return _LEFT_OUT
        begins_anew = False
        if self._last is not None:
            step = sample.t - self._last.t
            if step == 0.0:
                text = "a sample came twice; the second is left out"
                self._say(EventKind.DOUBLED, text, sample, events)
                return _LEFT_OUT
            if step < 0.0:
                if not self._jumped_back(sample.t):  # not enough older samples in a row so far
                    text = f"a sample is {-step:.4g} s older than the one before it; it is left out"
                    self._say(EventKind.DISORDERED, text, sample, events)
                    return _LEFT_OUT
                text = f"the source's clock jumped back by {-step:.4g} s; reading begins anew"
                self._say(EventKind.CLOCK, text, sample, events, always=True)
                begins_anew = True
            else:
                begins_anew = step > self.max_gap
                self._judge_gap(step, self._last, sample, events)
        self._behind.clear()
        if begins_anew:
            self._offset = math.inf  # of the clocks; lateness is measured anew
        self._last = sample
        self._judge_lateness(sample, events)
        return SampleOrder(counts=True, begins_anew=begins_anew)

    def _judge_gap(
        self, step: float, last: Sample, sample: Sample, events: list[StreamEvent]
    ) -> None:
        """Appends an event where samples are missing, or the clock has jumped on.

        Args:
            step: s of the source's clock between both samples, positive.
            last, sample: in order.
            events: gets the event.
        """
        if step > self.max_gap:
            # By the computer's clock; a source without a rate has none to compare with.
            passed = (sample.received - last.received) * self.rate
            if self.rate and step > passed + CLOCK_SLACK * self.rate:
                text = f"the source's clock jumped on by {step:.4g} s; reading begins anew"
                self._say(EventKind.CLOCK, text, sample, events, always=True)
            else:
                text = f"{step:.4g} s of samples are missing, more than the {self.max_gap:.4g} s "
                text += "that are bridged (--max-gap); reading begins anew"
                self._say(EventKind.GAP, text, sample, events)
        elif step > DROPOUT_STEPS * self.step:
            missing = 1e3 * (step - self.step)
            text = f"{missing:.4g} ms of samples are missing; not valid meanwhile"
            self._say(EventKind.GAP, text, sample, events)

    def _jumped_back(self, t: float) -> bool:
        """Takes the time of a sample older than the last; whether enough of them have come."""
        if self._behind and t <= self._behind[-1]:
            self._behind.clear()
        self._behind.append(t)
        return len(self._behind) >= MIN_LATE_SAMPLES

    def _judge_lateness(self, sample: Sample, events: list[StreamEvent]) -> None:
        if not self.rate:
            return
        offset = sample.received - sample.t / self.rate
        self._offset = min(offset, self._offset)
        lateness = offset - self._offset
        self._offset += _MAX_CLOCK_DRIFT * self.late * min(lateness / self.late, 1.0)
        if lateness > self.late:
            if not self.is_late:
                text = (
                    f"samples come {1e3 * lateness:.0f} ms late, more than {1e3 * self.late:.0f} "
                )
                text += "ms (--late): not valid; check the network and this computer's load"
                self._say(EventKind.LATE, text, sample, events)
            self.is_late = True
        elif self.is_late and lateness < 0.5 * self.late:
            self.is_late = False
            self._say(EventKind.ON_TIME, "samples are on time again", sample, events)

    def _say(
        self,
        kind: EventKind,
        text: str,
        sample: Sample,
        events: list[StreamEvent],
        always: bool = False,
    ) -> None:
        count = self._counts[kind] = self._counts.get(kind, 0) + 1
        last_event = self._event_times.get(kind, -math.inf)
        if always or sample.received - last_event >= SAY_AGAIN:
            self._event_times[kind] = sample.received
            events.append(StreamEvent(kind, text, sample.received, count))


class GridSample(NamedTuple):
    """A sample of the grid.

    Attributes:
        t: s.
        x: (k,) its numbers.
        dropout: whether it was bridged, or lacks a number.
    """

    t: float
    x: Array
    dropout: bool


class SampleGrid:
    """Carries the last sample and the grid from one sample to the next.

    Args:
        step: h, s.
    """

    def __init__(self, step: float) -> None:
        self._step = step
        self._last: GridSample | None = None
        self._is_uniform = True  # as long as the stream's own samples are the grid
        # Then the grid's times are origin + h k, the origin the last of these; k comes next.
        self._origin = 0.0
        self._next = 1

    def take(self, sample: GridSample) -> Iterator[GridSample]:
        """The grid's samples up to the next one of the stream, whose time must be later.

        As long as the stream's steps are h, they are its own; from the first other step on they are
        linear between the stream's at even times. A dropout is one inside a gap, or between samples
        of which one is a dropout. All must be taken from the iterator before the next call.
        """
        last, self._last = self._last, sample
        if last is None:
            yield sample
            return
        h, step = self._step, sample.t - last.t
        if self._is_uniform:
            if abs(step - h) <= UNIFORM_TOLERANCE * h:
                yield sample
                return
            self._is_uniform, self._origin = False, last.t
        end = sample.t + TIME_TOLERANCE * h
        most = math.floor((end - self._origin) / h) + 1  # one more than fit, as the quotient rounds
        for k in range(self._next, most + 1):
            t = self._origin + h * k
            if t > end:
                break
            self._next += 1
            weight = (t - last.t) / step
            to_nearest = min(t - last.t, sample.t - t)
            is_bridged = step > DROPOUT_STEPS * h and to_nearest > UNIFORM_TOLERANCE * h
            dropout = is_bridged or sample.dropout or (last.dropout and weight < 1.0)
            # At the sample itself, or behind it by the tolerance, the last one does not count.
            x = last.x + weight * (sample.x - last.x) if weight < 1.0 else sample.x
            yield GridSample(t, x, dropout)
