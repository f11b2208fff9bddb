"""Dates with times in the cells of a text table, as loggers write them, in seconds.

2024-03-05T14:22:31.25+01:00    ISO 8601
05.03.2024 14:22:31,250         day first (dots or dashes); 03/05/2024 has the month first,
                                unless its first number is no month
2024/03/05 02:22:31 PM
14:22:31.250                    a time alone counts from midnight
2024-03-05 | 14:22:31.250       a date and a time in two columns
"""

import re
from typing import Final, NamedTuple

import pyarrow as pa
import pyarrow.compute as pc

_ISO: Final = re.compile(
    r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d([.]\d{1,9})?)?(?P<zone>Z|[+-]\d\d(:?\d\d)?)?"
)
_TIME: Final = (
    r"(?P<hour>\d{1,2}):(?P<minute>\d\d):(?P<second>\d\d)(?:[.,](?P<fraction>\d{1,9}))?"
    r"(?: ?(?P<half>[AaPp])[.]?[Mm][.]?)?"
)
_GAP: Final = r"(?:[T ]|, |; ?) *"
_YEAR, _MONTH, _DAY = r"(?P<year>\d{4})", r"(?P<month>\d{1,2})", r"(?P<day>\d{1,2})"
_DATES: Final = {  # by the order of their numbers
    "year first": rf"{_YEAR}[./-]{_MONTH}[./-]{_DAY}",
    "day first": rf"{_DAY}[./-]{_MONTH}[./-]{_YEAR}",
    "month first": rf"{_MONTH}/{_DAY}/{_YEAR}",
}
_PATTERNS: Final = {order: f"{date}{_GAP}{_TIME}" for order, date in _DATES.items()} | {
    "no date": _TIME
}
_MONTHS_OF_YEAR: Final = 12
_HOURS_OF_HALF_DAY: Final = 12
_SECONDS_OF_DAY: Final = 86400.0


class StampForm(NamedTuple):
    """How the cells of a column write their time.

    Attributes:
        order: "ISO", or a key of the patterns above.
        has_zone: whether they state a time zone.
    """

    order: str
    has_zone: bool = False

    def fits(self, cell: str) -> bool:
        """Whether a cell is written so."""
        pattern = _ISO if self.order == "ISO" else re.compile(_PATTERNS[self.order])
        return pattern.fullmatch(cell.strip()) is not None

    def arrow_type(self) -> pa.DataType:
        """The type as which Arrow reads the cells."""
        if self.order != "ISO":
            return pa.string()
        return pa.timestamp("ns", tz="UTC" if self.has_zone else None)


def is_date(cell: str) -> bool:
    """Whether a cell is a date without a time."""
    return any(re.fullmatch(date, cell.strip()) for date in _DATES.values())


def is_clock(cell: str) -> bool:
    """Whether a cell is a time of a day without a date."""
    return re.fullmatch(_TIME, cell.strip()) is not None


def stamp_form(cell: str) -> StampForm | None:
    """How a column writes its time, by its first cell; None where that is no date and time.

    A date with slashes has the month first, as in the United States, unless that is no month.
    """
    iso = _ISO.fullmatch(cell)
    if iso is not None:
        return StampForm("ISO", has_zone=bool(iso["zone"]))
    month_first = re.fullmatch(_PATTERNS["month first"], cell)
    orders = dict.fromkeys(_PATTERNS)
    if month_first is not None and int(month_first["month"]) <= _MONTHS_OF_YEAR:
        orders = {"month first": None, **orders}
    return next((StampForm(o) for o in orders if re.fullmatch(_PATTERNS[o], cell)), None)


def joined_seconds(
    dates: pa.ChunkedArray, clocks: pa.ChunkedArray, form: StampForm
) -> pa.ChunkedArray:
    """As `stamp_seconds`, of a date and a time that stand in two columns of texts.

    Args:
        dates, clocks: of one length; an empty one of either gives a missing number.
        form: of the date, a blank and the time.

    Raises:
        pa.ArrowInvalid: as `stamp_seconds`.
    """
    dates, clocks = (
        pc.if_else(pc.equal(texts, ""), None, texts)
        for texts in (pc.utf8_trim_whitespace(dates), pc.utf8_trim_whitespace(clocks))
    )
    joined = pc.binary_join_element_wise(dates, clocks, " ")
    return stamp_seconds(joined, form)


def stamp_seconds(cells: pa.ChunkedArray, form: StampForm) -> pa.ChunkedArray:
    """Seconds since 1970 (since midnight where there is no date) of cells.

    Args:
        cells: texts, or of the type `form.arrow_type()`; an empty one gives a missing number.
        form: how they are written.

    Raises:
        pa.ArrowInvalid: a cell is written in another way, or is no date.
    """
    cells = pc.cast(cells, form.arrow_type())
    if form.order == "ISO":
        nanoseconds = pc.cast(pc.cast(cells, pa.int64()), pa.float64(), safe=False)
        return pc.multiply(nanoseconds, 1e-9)
    parts = pc.extract_regex(cells, rf"^\s*{_PATTERNS[form.order]}\s*$")
    if parts.null_count > cells.null_count:
        raise pa.ArrowInvalid("a cell is no date and time")

    def number(name: str) -> pa.ChunkedArray:
        return pc.cast(pc.struct_field(parts, name), pa.float64())

    hour, half = number("hour"), pc.utf8_lower(pc.struct_field(parts, "half"))
    # Of a clock of twelve hours: 12 AM is hour 0, 12 PM hour 12.
    half_day_hour = pc.add(
        pc.if_else(pc.equal(hour, _HOURS_OF_HALF_DAY), 0.0, hour),
        pc.if_else(pc.equal(half, "p"), float(_HOURS_OF_HALF_DAY), 0.0),
    )
    hour = pc.if_else(pc.equal(half, ""), hour, half_day_hour)
    fraction = pc.cast(
        pc.binary_join_element_wise("0", pc.struct_field(parts, "fraction"), "."), pa.float64()
    )
    seconds = pc.add(
        pc.multiply(pc.add(pc.multiply(hour, 60.0), number("minute")), 60.0),
        pc.add(number("second"), fraction),
    )
    if form.order == "no date":
        return seconds
    date = pc.binary_join_element_wise(
        pc.struct_field(parts, "year"),
        pc.utf8_lpad(pc.struct_field(parts, "month"), 2, "0"),
        pc.utf8_lpad(pc.struct_field(parts, "day"), 2, "0"),
        "-",
    )
    days = pc.cast(pc.cast(pc.cast(date, pa.date32()), pa.int32()), pa.float64())
    return pc.add(pc.multiply(days, _SECONDS_OF_DAY), seconds)
