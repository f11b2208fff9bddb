"""Lines with an object of JSON behind other text, as lines of JSON alone.

    dt/arm/state {"ts": 1769000000.0, "q": [..]}          mosquitto_sub -v: the topic
    2024-03-01T12:00:00.12 INFO state: {"q": [..]}        a logger's stamp and level
    data: {"t": 0.1, "q": [..]}                           an event stream

Where the objects have no time of their own, a stamp at the begin of the lines is their time.
"""

import json
import re
import tempfile
from pathlib import Path
from typing import Final

from wrenchsight.models.files.limited_file import opened
from wrenchsight.models.recordings.layouts.time_names import time_columns

_LINE: Final = re.compile(r"(?P<before>[^{\"\r\n]{1,200})(?P<object>\{\s*\".*\})\s*")
_STAMP: Final = re.compile(
    r"[\[(]?(?P<date>\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d(?:[.,]\d{1,9})?(?:Z|[+-]\d\d:?\d\d)?"
    r"|\d\d:\d\d:\d\d[.,]\d{1,9})|[\[(]?(?P<number>\d{1,19}(?:\.\d{1,9})?)(?=[\s\]):,])"
)
_TIME: Final = "time"
_MIN_LINES: Final = 2
_MIN_SHARE: Final = 0.8  # of the lines


def has_text_before_objects(head: str) -> bool:
    """Whether most lines of a text have an object behind other text; the last may be cut off."""
    lines = [line for line in head.splitlines()[:-1] if line.strip()]
    matches = [match for line in lines if (match := _LINE.fullmatch(line))]
    return (
        len(matches) >= max(_MIN_LINES, _MIN_SHARE * len(lines))
        and _keys(matches[0]["object"]) is not None
        and _keys(matches[-1]["object"]) is not None
    )


class ObjectLines:
    """The objects of such a text, one a line, on the disk; it is removed with this object.

    Args:
        path: of the text, `has_text_before_objects`.

    Attributes:
        path: of the objects.
        notice: what was left out.

    Raises:
        InputError: the file cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="wrenchsight", ignore_cleanup_errors=True)
        self.path = Path(self._folder.name) / path.name
        lacks_time: bool | None = None
        first = ""
        with opened(path, "a log") as source, self.path.open("w", encoding="utf-8") as target:
            for data in source:
                match = _LINE.fullmatch(data.decode("utf-8", "replace"))
                if match is None:  # a line of something else
                    continue
                first = first or match["before"].strip()
                if lacks_time is None:
                    lacks_time = time_columns(_keys(match["object"]) or []) is None
                stamp = _STAMP.match(match["before"]) if lacks_time else None
                time = ""
                if stamp is not None:
                    time = stamp["number"] or f'"{stamp["date"].replace(",", ".")}"'
                    time = f'"{_TIME}": {time}, '
                target.write(f"{{{time}{match['object'][1:]}\n")
        self.notice = f'objects are read from behind other text ("{first[:40]}")'


def _keys(text: str) -> list[str] | None:
    """The keys of an object that is not empty; None: the text is none."""
    try:
        found = json.loads(text)
    except (ValueError, RecursionError):
        return None
    return list(found) if isinstance(found, dict) and found else None
