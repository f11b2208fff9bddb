"""Events of single messages, of which a stream may bear a thousand a second: each is said once a
second.
"""

from wrenchsight.models.live.samples import EventKind, StreamEvent
from wrenchsight.models.live.stream_order import SAY_AGAIN

# What changes the state of a stream (lost, connected, late, stopped ..) is said each time.
_OF_SINGLE_MESSAGES = (EventKind.RECIPE, EventKind.CLOCK)
_MOST_TEXTS = 1000  # that are held; texts may bear what a network sends


class EventGate:
    """Leaves out an event of a single message that another one of its kind and text precedes by
    less than SAY_AGAIN.

    Sources count such events themselves: the next one that is said bears their number.
    """

    def __init__(self) -> None:
        self._said: dict[tuple[EventKind, str], float] = {}  # s, when it was said last

    def passes(self, event: StreamEvent) -> bool:
        """Whether the event is to be said."""
        if event.kind not in _OF_SINGLE_MESSAGES:
            return True
        if len(self._said) > _MOST_TEXTS:
            self._said.clear()
        key = (event.kind, event.text)
        if event.received - self._said.get(key, -SAY_AGAIN) < SAY_AGAIN:
            return False
        self._said[key] = event.received
        return True
