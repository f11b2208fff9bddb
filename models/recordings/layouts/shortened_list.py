"""Names in a sentence, the first ones of many."""

from collections.abc import Sequence

_LISTED_NAMES = 6


def shortened(names: Sequence[str], most: int = _LISTED_NAMES) -> str:
    """The names with commas between; of more than `most` the first ones and how many follow."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
