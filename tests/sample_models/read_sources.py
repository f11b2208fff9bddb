"""What a live source gives, read until something has come."""

import time
from collections.abc import Callable

from wrenchsight.models.live.samples import Sample, StreamEvent
from wrenchsight.models.live.source import Source


def read_until(
    source: Source,
    over: Callable[[list[Sample], list[StreamEvent]], object],
    longest: float = 30.0,
) -> tuple[list[Sample], list[StreamEvent]]:
    """Samples and events until `over(samples, events)`, for `longest` s at most."""
    samples: list[Sample] = []
    events: list[StreamEvent] = []
    end = time.monotonic() + longest
    while not over(samples, events):
        assert time.monotonic() < end, [str(event) for event in events]
        for item in source.read(0.02):
            if isinstance(item, Sample):
                samples.append(item)
            else:
                events.append(item)
    return samples, events
