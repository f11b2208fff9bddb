"""Columns of a log that hold its time, by their names."""

import re
from collections.abc import Sequence
from typing import NamedTuple

from wrenchsight.models.recordings.layouts.signal_words import is_signal_word, name_tokens
from wrenchsight.models.recordings.layouts.unit_words import unit_of
from wrenchsight.models.recordings.recording_format import UNITS, SignalColumns, by_number

_UNITS_BY_WORD = {"%time": "ns", "rosbagtimestamp": "ns", "ipoc": "ms"}  # ROS 1; KUKA RSI
_PLAIN_WORDS = ("t", "__time", "time", "times", "timestamp", "timestamps", "stamp", "%time",
                "rosbagtimestamp", "ipoc")  # fmt: skip
# Words that name a time, and words that may stand beside them.
_TIME_WORDS = frozenset((
    "time", "times", "timestamp", "timestamps", "stamp", "datetime", "timespan", "elapsed",
    "duration", "clock", "zeit", "zeiten", "epoch", "zeitstempel", "uhrzeit", "uhr",
    "laufzeit", "messzeit", "temps", "tempo", "tiempo", "hora", "heure", "horodatage", "时间",
    "时间戳", "時間", "時刻", "rosbagtimestamp",
))  # fmt: skip
_BESIDE = frozenset((
    "date", "datum", "fecha", "data", "since", "start", "started", "system", "sys", "ros",
    "ros2", "log", "logger", "host", "unix", "epoch", "controller", "ctrl", "robot", "header",
    "zeit", "utc", "local", "cycle", "of", "day", "the", "rel", "relative", "abs", "absolute",
    "wall", "recv", "received", "receive", "record", "recording", "recorded", "rec",
    "measurement", "meas", "sample", "sampling", "server", "client", "pc", "plc", "device",
    "sensor", "total", "run", "running", "sim", "simulation", "stamp", "msg", "message",
    "mono", "monotonic", "absolute", "relativ", "vergangene", "系统", "采样", "运行", "记录",
))  # fmt: skip
_CLOCKS_OF_SIGNALS = ("t", "time", "timestamp", "stamp", "zeit")
_DATE_RANK = 9  # behind that of any clock
_DOUBTFUL_WORDS = ("ts", "tstamp", "x_value")  # also the sample time, another abscissa
_PERIOD_WORDS = frozenset(("sample", "sampling", "cycle"))  # before ts: a time between samples
_DATE_WORDS = frozenset(("date", "datum", "fecha", "data", "日期"))
_UNIT_ALONE = re.compile(
    r"(milli|micro|nano)?sec(onds|s)?|msec|usec|nsec|ms|us|ns|µs", re.IGNORECASE
)
_UNIT_BEHIND = re.compile(r"(.*?)[\s_]*[\[(（]?([^\W\d_]+)[\])）]?", re.DOTALL)
_FORMAT = re.compile(r"[\[(][^\[\]()]*(?:yy|hh:|utc|gmt)[^\[\]()]*[\])]", re.IGNORECASE)
_UNIT_IN_BRACKETS = re.compile(r"\s*[\[(]n?s[\])]$")
# Of whole seconds and nanoseconds, also in one name with more: robot_time_seconds, .._nanos.
_SECOND_WORDS = ("sec", "secs", "seconds", "s")
_NANOSECOND_WORDS = (
    "nano_sec",
    "nanosec",
    "nanosecs",
    "nanoseconds",
    "nsec",
    "nsecs",
    "nanos",
    "ns",
)


class _Clock(NamedTuple):
    """A column that is a time by its name; the one of the smallest numbers is the log's."""

    rank: int
    column: int
    unit: str


def time_columns(names: Sequence[str]) -> SignalColumns | None:
    """The column or columns of a log's time; None where no name is one.

    A column `t` is the time whatever else there is. Else two columns of seconds and nanoseconds
    are (sec and nanosec, secs and nsecs, s and ns, seconds and nanos, with any prefix:
    header/stamp/sec, t_s), or else a column that is called time, timestamp or the like; or else
    one whose words are those of a clock (robot_time, Zeit, elapsed time (ms), log.stamp), or
    a unit of time alone (ms). Of several the first such kind, and its first column, counts:
    `clock_numbers` has the others, too.
    """
    if "t" in names:
        return by_number([list(names).index("t")])
    pair = _seconds_and_nanoseconds(names)
    if pair is not None:
        return pair
    clocks = _clocks(names)
    return by_number([clocks[0].column], unit=clocks[0].unit) if clocks else None


def clock_numbers(names: Sequence[str]) -> list[int]:
    """Numbers, from 0, of all columns that are a time by their names, without doubtful ones."""
    return [clock.column for clock in _clocks(names) if clock.rank < _DATE_RANK]


def _clocks(names: Sequence[str]) -> list[_Clock]:
    """The columns that are a time by their names, the likeliest first."""
    found = (
        _clock(column, name)
        for column, name in enumerate(names)
        if not _is_lettered_axis(name, names)
    )
    return sorted(clock for clock in found if clock is not None)


def _is_lettered_axis(name: str, names: Sequence[str]) -> bool:
    """Whether a name is that of Yaskawa's axis T: S_pos, L_pos, U_pos are there, too."""
    others = {"t": "slu", "T": "SLU"}.get(name[:1], "")
    return bool(others) and all(letter + name[1:] in names for letter in others)


def _clock(column: int, name: str) -> _Clock | None:
    """The column as a clock; None where its name is that of something else."""
    unit, stem = _unit(_FORMAT.sub("", name).strip())
    word = stem.lower()
    if word in _PLAIN_WORDS:
        return _Clock(0, column, unit or _UNITS_BY_WORD.get(word, ""))
    for part in (name.strip(), stem):  # ms; ns [ns]
        if _UNIT_ALONE.fullmatch(part):
            return _Clock(2, column, unit_of(part))
    for rank, part in ((1, stem), (2, re.split(r"[/.:]", stem)[-1])):  # robot_time; log.stamp
        split = re.sub(r"([a-z])([A-Z])", r"\1 \2", part).lower()
        words = set(re.findall(r"[^\W\d_]+\d?", split))
        if words & _TIME_WORDS and words <= _TIME_WORDS | _BESIDE:
            return _Clock(rank + (1 if unit or words <= _TIME_WORDS else 2), column, unit)
        if words and words <= _BESIDE and unit and part == stem:  # cycle_ms
            return _Clock(4, column, unit)
    first, *rest = name_tokens(stem) or [""]
    for clock, signal in ((first, rest), ((rest or [first])[-1], [first, *rest[:-1]])):
        # Of a signal: t_pos, time_q1, J1_time.
        if clock in _CLOCKS_OF_SIGNALS and signal and all(map(is_signal_word, signal)):
            return _Clock(6, column, unit)
    if word in _DOUBTFUL_WORDS or _is_stamp(stem):
        return _Clock(_DATE_RANK, column, unit)
    if word in _DATE_WORDS:  # a date, with the time behind it where it is the only clock
        return _Clock(_DATE_RANK, column, "")
    return None


def _is_stamp(name: str) -> bool:
    """Whether a name is ts, of a clock: pc_ts, host.ts."""
    words = {*name_tokens(name[:200])}
    return "ts" in words and words <= {"ts"} | _BESIDE - _PERIOD_WORDS


def _unit(name: str) -> tuple[str, str]:
    """The unit of time at the end of a name, perhaps twice (time_ms [ms]), and what precedes it."""
    unit = ""
    for _ in range(2):
        match = _UNIT_BEHIND.fullmatch(name)
        if match is None or not match[1] or unit_of(match[2]) not in UNITS["time"]:
            break
        if match.end(1) == match.start(2) and match[1][-1:].isalpha():  # a part of a word
            break
        unit, name = unit or unit_of(match[2]), match[1]
    return unit, name


def _seconds_and_nanoseconds(names: Sequence[str]) -> SignalColumns | None:
    """The first two columns of one prefix that are called so; None where there are none."""
    # TimeInSec, TimeInNanoSec
    split = [re.sub(r"([a-z])([A-Z])", r"\1_\2", name[:200]).lower() for name in names]
    plain = [_UNIT_IN_BRACKETS.sub("", name) for name in split]
    for i, name in enumerate(plain):
        match = re.fullmatch(rf"(.*[._/]|)({'|'.join(_SECOND_WORDS)})", name)
        for word in _NANOSECOND_WORDS if match else ():
            if match and match[1] + word in plain:
                return by_number([i, plain.index(match[1] + word)])
    return None
