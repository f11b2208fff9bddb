"""Events that each message of a stream may bear are said once a second."""

import pytest

from wrenchsight.models.live.event_gate import EventGate
from wrenchsight.models.live.samples import EventKind, StreamEvent
from wrenchsight.models.live.stream_order import SAY_AGAIN


def _passed(kind, times, text="no status of panda"):
    gate = EventGate()
    return [t for t in times if gate.passes(StreamEvent(kind, text, t))]


@pytest.mark.parametrize("kind", [EventKind.RECIPE, EventKind.CLOCK])
def test_an_event_of_each_message_is_said_once_a_second(kind):
    times = [100.0 + 0.25 * SAY_AGAIN * k for k in range(12)]
    assert _passed(kind, times) == times[::4]


def test_another_text_and_a_change_of_the_stream_s_state_are_said_at_once():
    gate = EventGate()
    for text in ("one", "two"):
        assert gate.passes(StreamEvent(EventKind.RECIPE, text, 5.0))
    assert _passed(EventKind.LOST, [5.0, 5.1, 5.2]) == [5.0, 5.1, 5.2]


def test_texts_from_a_network_do_not_fill_the_memory():
    gate = EventGate()
    for k in range(5000):
        gate.passes(StreamEvent(EventKind.RECIPE, f"field {k}", 5.0))
    assert len(gate._said) < 2000
