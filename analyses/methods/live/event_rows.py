"""Events of a stream as rows of numbers, for a ring."""

import json

import numpy as np

from wrenchsight.models.arrays import Array
from wrenchsight.models.live.samples import EventKind, StreamEvent

EVENT_SIZE = 256  # numbers of a row: 2 kB
EVENT_COUNT = 256  # rows of the ring


def event_row(event: StreamEvent) -> Array:
    """The row (EVENT_SIZE,) of an event."""
    text = json.dumps([event.kind.value, event.text, event.received, event.count])
    if len(text) > 8 * EVENT_SIZE:  # of letters that JSON writes at length
        short = event.text.encode("ascii", "replace").decode()
        text = json.dumps([event.kind.value, short, event.received, event.count])
    row = np.zeros(EVENT_SIZE)
    row.view(np.uint8)[: len(text)] = np.frombuffer(text.encode(), np.uint8)
    return row


def event_of(row: Array) -> StreamEvent:
    """The event of such a row."""
    text = np.ascontiguousarray(row).view(np.uint8).tobytes().rstrip(b"\0")
    kind, words, received, count = json.loads(text)
    return StreamEvent(EventKind(kind), words, received, count)
