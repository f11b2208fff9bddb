"""Columns of a log that hold its time, by their names."""

import re
from collections.abc import Sequence

from wrenchsight.models.recordings.recording_format import SignalColumns, by_number

TIME_WORDS = ("t", "__time", "time", "times", "timestamp", "timestamps", "%time", "rosbagtimestamp",
              "ipoc")  # fmt: skip
_UNITS = {"s": "s", "sec": "s", "ms": "ms", "us": "us", "ns": "ns"}
_UNITS_BY_WORD = {"%time": "ns", "rosbagtimestamp": "ns", "ipoc": "ms"}  # ROS 1; KUKA RSI
_CLOCK_WORDS = frozenset(
    ("time", "timestamp", "stamp", "datetime", "date", "elapsed", "since", "start", "system", "ros",
     "log", "host", "unix", "epoch", "controller", "robot", "header", "zeit", "zeitstempel", "utc",
     "temps", "tempo", "tiempo", "datum", "uhrzeit", "cycle", "duration", "fecha", "hora", "heure")
)  # fmt: skip
_TIME_TOKENS = frozenset(
    (
        "time",
        "timestamp",
        "stamp",
        "datetime",
        "zeit",
        "zeitstempel",
        "temps",
        "tempo",
        "tiempo",
        "uhrzeit",
        "duration",
        "elapsed",
        "hora",
        "heure",
    )
)
_WITH_UNIT = re.compile(r"(?:t|time|timestamp)[ _]?[\[(]?(s|sec|ms|us|ns)[\])]?")
_SECOND_WORDS = (  # of whole seconds and nanoseconds
    ("sec", "nanosec"),
    ("secs", "nsecs"),
    ("seconds", "nanoseconds"),
    ("s", "ns"),
    ("sec", "nsec"),
    ("secs", "nanosecs"),
)


def time_columns(names: Sequence[str]) -> SignalColumns | None:
    """The column or columns of a log's time; None where there are none, or several.

    A column `t` is the time whatever else there is. Else two columns of seconds and nanoseconds
    are (sec and nanosec, secs and nsecs, s and ns, seconds and nanoseconds, with any prefix:
    header/stamp/sec, t_s), or else the only column that is called time, timestamp or the like,
    in upper or lower case, or with a unit behind it (time_ms, Time [s]); or else the only one
    whose name has no other words than such a clock's (robot_time, Zeit, elapsed time (ms),
    cycle_ms).
    """
    if "t" in names:
        return by_number([list(names).index("t")])
    return _seconds_and_nanoseconds(names) or _single(names) or _of_words(names)


def _single(names: Sequence[str]) -> SignalColumns | None:
    units: dict[int, str] = {}
    for column, name in enumerate(names):
        word = name.strip().lower()
        match = _WITH_UNIT.fullmatch(word)
        if match:
            units[column] = _UNITS[match[1]]
        elif word in TIME_WORDS:
            units[column] = _UNITS_BY_WORD.get(word, "")
    if len(units) != 1:
        return None
    ((column, unit),) = units.items()
    return by_number([column], unit=unit)


def _of_words(names: Sequence[str]) -> SignalColumns | None:
    """The only column all of whose words are those of a clock, the last one perhaps a unit."""
    units: dict[int, str] = {}
    for column, name in enumerate(names):
        tokens = re.findall(r"[a-z]+|\d+", re.sub(r"([a-z])([A-Z])", r"\1 \2", name).lower())
        unit = _UNITS.get(tokens[-1], "") if len(tokens) > 1 else ""
        rest = set(tokens[:-1] if unit else tokens)
        if rest <= _CLOCK_WORDS and (rest & _TIME_TOKENS or unit):
            units[column] = unit
    if len(units) != 1:
        return None
    ((column, unit),) = units.items()
    return by_number([column], unit=unit)


def _seconds_and_nanoseconds(names: Sequence[str]) -> SignalColumns | None:
    for seconds, nanoseconds in _SECOND_WORDS:
        for i, name in enumerate(names):
            match = re.fullmatch(rf"(.*[._/]|){seconds}", name)
            if match and match[1] + nanoseconds in names:
                return by_number([i, list(names).index(match[1] + nanoseconds)])
    return None
