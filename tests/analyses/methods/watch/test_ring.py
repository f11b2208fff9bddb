"""Rows between processes."""

import threading

import numpy as np
import pytest

from wrenchsight.analyses.methods.watch.ring import Ring, RingReader
from wrenchsight.models.live.samples import EVENT_SIZE, EventKind, StreamEvent


def test_each_row_comes_once_in_order():
    ring = Ring(3, 64)
    reader = RingReader(ring)
    received = []
    for k in range(500):
        ring.write(np.full(3, float(k)))
        if k % 20 == 0:
            received.append(reader.read())
    received.append(reader.read())
    rows = np.concatenate(received)
    np.testing.assert_array_equal(rows[:, 0], np.arange(500))
    assert reader.dropped == 0


def test_a_slow_reader_loses_the_oldest_and_counts_them():
    ring = Ring(1, 64)
    slow, quick = RingReader(ring), RingReader(ring)
    seen = 0
    for k in range(1000):
        ring.write(np.array([float(k)]))
        seen += len(quick.read())
    rows = slow.read()
    assert seen == 1000
    assert quick.dropped == 0
    assert rows[-1, 0] == 999.0
    assert slow.dropped == 1000 - len(rows)
    assert 40 <= len(rows) <= 64


def test_another_process_sees_the_same_memory():
    ring = Ring(2, 32)
    other = Ring(2, 32, ring.descriptor)
    reader = RingReader(other)
    ring.write(np.array([1.0, 2.0]))
    np.testing.assert_array_equal(reader.read(), [[1.0, 2.0]])


def test_no_row_is_ever_torn():
    """One writes as fast as it can; what is read is whole, in order, and what is not is counted."""
    ring = Ring(64, 128)
    reader = RingReader(ring)
    total = 20_000

    def write():
        for k in range(total):
            ring.write(np.full(64, float(k)))

    thread = threading.Thread(target=write)
    thread.start()
    received = []
    while thread.is_alive() or reader.ring.written > sum(map(len, received)) + reader.dropped:
        received.append(reader.read())
    rows = np.concatenate(received)
    assert (rows == rows[:, :1]).all()
    assert (np.diff(rows[:, 0]) > 0).all()
    assert len(rows) + reader.dropped == total


@pytest.mark.parametrize("text", ["", "plain", "ü" * 400, "\x1b[2J\n\U0001f600" * 200])
def test_events_go_through_as_they_are(text):
    event = StreamEvent(EventKind.LATE, text, 12.5, 3)
    ring = Ring(EVENT_SIZE, 16)
    reader = RingReader(ring)
    ring.write(event.row)
    received = StreamEvent.of_row(reader.read()[0])
    assert (received.kind, received.received, received.count) == (event.kind, 12.5, 3)
    assert received.text.isprintable()
    assert received.text == event.text or "?" in received.text
