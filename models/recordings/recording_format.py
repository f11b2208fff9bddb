"""Descriptions of recordings: which column of a log holds which signal, in which unit."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from wrenchsight.models.files.bundled_files import named_file
from wrenchsight.models.files.configuration import load_configuration, nearest
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array

MOST_COLUMNS = 10_000  # of a log
MOST_SKIPPED_LINES = 1_000_000
LARGEST_RATE = 1e5  # Hz
TWOS_COMPLEMENT, SIGN_BIT = "twos_complement", "sign_bit"
_ENCODINGS = ("", TWOS_COMPLEMENT, SIGN_BIT)
_WRAPS = ("", "pi")
_MOST_BITS = 52  # of a word that a double holds
TAU_EXT = "tau_ext"  # the extra signal of external torque
ROBOT, ENVIRONMENT = "robot", "environment"  # the body on which an external torque acts
FORMATS = "recordings/formats"  # folder of the bundled descriptions

PER_CENT, PER_MILLE = "per cent", "per mille"  # of the rated value of each drive: the gain
UNITS: dict[str, dict[str, float]] = {  # in SI, by key of a description
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "100 ns": 1e-7, "ns": 1e-9, "days": 86400.0},
    "position": {"rad": 1.0, "deg": np.pi / 180, "rev": 2 * np.pi, "m": 1.0, "mm": 1e-3},
    "velocity": {
        "rad/s": 1.0,
        "deg/s": np.pi / 180,
        "rpm": 2 * np.pi / 60,
        "rev/s": 2 * np.pi,
        "m/s": 1.0,
        "mm/s": 1e-3,
    },
    "current": {"A": 1.0, "mA": 1e-3, PER_CENT: 1e-2, PER_MILLE: 1e-3},
    "motor_torque": {
        "N m": 1.0,
        "Nm": 1.0,
        "mN m": 1e-3,
        "mNm": 1e-3,
        "N": 1.0,
        PER_CENT: 1e-2,
        PER_MILLE: 1e-3,
    },
}
_ANY_UNIT = {unit: factor for table in UNITS.values() for unit, factor in table.items()} | {
    "1": 1.0,
    "": 1.0,
}
_DEFAULT_UNIT = {"time": "s", "position": "rad", "velocity": "rad/s", "current": "A"}
_DEFAULT_UNIT["motor_torque"] = "N m"
_SIGNAL_NAMES = {
    "time": "t",
    "position": "q",
    "velocity": "v",
    "current": "current",
    "motor_torque": "tau_J",
}
_JOINT_SIGNALS = ("q", "v", "current", "tau_J")


LARGEST_DELAY = 5.0  # s


@dataclass(frozen=True)
class SignalCorrection:
    """What is wrong with a signal as it was logged; see the keys of `SignalColumns`."""

    order: tuple[int, ...] = ()
    turned: tuple[int, ...] = ()
    delay: float = 0.0
    without_gravity: bool = False
    gain: float = 1.0
    joint_delay: tuple[float, ...] = ()


@dataclass
class SignalColumns:
    """The columns of one signal: value = gain * (number in the log, in its unit) + offset."""

    columns: int | str = ""
    """Column numbers counted from 1 ("14-19"), or names from the header, separated by commas;
    braces spell a series, the last one running fastest ("tau_{0..6}", "jacobian_{0..5}_{0..6}")."""
    unit: str = ""
    """of the numbers in the log; empty: s, rad, rad/s, A, N m. Torque or current in per cent or per
    mille of the rated one of each drive needs these as gain"""
    gain: list[float] = field(default_factory=list)
    """per column, or one for all; -1: other sign"""
    offset: list[float] = field(default_factory=list)
    """SI; per column, or one for all"""
    shape: list[int] = field(default_factory=list)
    """of one sample of an extra signal; e.g. [6, 7]"""
    encoding: str = ""
    """of whole numbers that were logged as words without a sign: twos_complement (65535 is -1), or
    sign_bit (32769 is -1); empty: numbers as they are"""
    bits: int = 16
    """of such a word, with its sign"""
    wrap: str = ""
    """pi: angles that jump by a turn; empty: only where the jump is no motion"""
    may_be_empty: bool = False
    """an empty cell is NaN, and its sample a drop-out; else an error"""
    order: list[int] = field(default_factory=list)
    """place among the columns, counted from 1, of what belongs to each joint; empty: [1, 2, ..]"""
    turned: list[int] = field(default_factory=list)
    """joints from 1 on that have the other sign"""
    delay: float = 0.0
    """s by which the signal is late against the others; negative: it leads"""
    joint_delay: list[float] = field(default_factory=list)
    """s by which each joint's part is late beside `delay`, in the new order; empty: none is"""
    without_gravity: bool = False
    """motor torque or current without what holds the arm against gravity: that is added"""
    exerted_on: str = ROBOT
    """sign of an external torque or force: robot (what acts on the robot from outside, positive
    along the motion that it causes) or environment (what the robot exerts on the environment, such
    as Franka's tau_ext_hat_filtered: its sign is changed)"""


def by_number(columns: Sequence[int], unit: str = "") -> SignalColumns:
    """The columns of these numbers, counted from 0."""
    return SignalColumns(", ".join(str(column + 1) for column in columns), unit=unit)


def column_numbers(columns: SignalColumns) -> list[int]:
    """The numbers, counted from 0, of columns that `by_number` has made."""
    return [int(number) - 1 for number in str(columns.columns).split(",")]


def in_degrees(columns: SignalColumns, unit: str, prismatic: Sequence[bool]) -> SignalColumns:
    """Columns without a gain, one a joint, in degrees; of joints that slide in metres.

    Args:
        unit: deg or deg/s.
        prismatic: which of the joints slide; empty: none.
    """
    if not any(prismatic):
        return replace(columns, unit=unit)
    metres = 1.0 / _ANY_UNIT[unit]  # the gain that takes the unit away again
    return replace(columns, unit=unit, gain=[metres if slides else 1.0 for slides in prismatic])


@dataclass
class RecordingFormat:
    """A description of a log's columns, read from YAML (`--log-format`)."""

    description: str = ""
    """what the log is"""
    source: str = ""
    """where it comes from"""
    file: str = ""
    """the log itself, relative to this description, if the description stands for it"""
    separator: str = ","
    """between cells of a text log; "\\t" for tabs"""
    decimal_mark: str = "."
    """`.` or `,`"""
    skip_lines: int = 0
    """lines before the header or the first row"""
    header: bool = True
    """the first line (after skip_lines) names the columns"""
    num_columns: int = 0
    """columns that the log must have; 0: any number"""
    time: SignalColumns | None = None
    """one column, or two: seconds and nanoseconds"""
    rate_hz: float = 0.0
    """samples a second of a log without a time; instead of it"""
    position: SignalColumns | None = None
    """q"""
    velocity: SignalColumns | None = None
    """v; without it, differentiated from q"""
    current: SignalColumns | None = None
    """motor current, its sign as logged"""
    motor_torque: SignalColumns | None = None
    """tau_J on the joint side, positive along the joint"""
    extra: dict[str, SignalColumns] = field(default_factory=dict)
    """other signals, by name"""
    rows: dict[str, list[int]] = field(default_factory=dict)
    """First and last row to use, by file name; [] for all. Row 1 is the first line of numbers."""
    keep_every: int = 1
    """Rows of which one is kept, where the source gives a new value only so often; 1: all"""


@dataclass(frozen=True)
class LogHeader:
    """What a log's file says of its columns.

    Attributes:
        path: the log's file.
        names: names of the columns; None where the log has no header.
        num_columns: that the log has.
    """

    path: Path
    names: Sequence[str] | None
    num_columns: int


@dataclass(frozen=True)
class Signal:
    """The place of a signal in a log: its columns and their conversion to SI units."""

    name: str  # t, q, v, current, tau_J, dropout or the name of an extra signal
    columns: tuple[int, ...]  # 0-based
    scale: Array  # (k,): unit and gain
    offset: Array  # (k,)
    shape: tuple[int, ...]  # of one sample
    may_be_empty: bool = False
    exerted_on: str = ROBOT  # of the numbers in the log
    encoding: str = ""  # as `SignalColumns`
    bits: int = 16
    wrap: str = ""
    delay: float = 0.0
    without_gravity: bool = False
    joint_delay: tuple[float, ...] = ()  # one a column, beside `delay`; empty: none

    @property
    def delays(self) -> Array:
        """(k,) s by which each column is late."""
        return self.delay + np.array(self.joint_delay or (0.0,) * len(self.columns))

    def numbers(self, words: Array) -> Array:
        """Numbers with their sign, of logged words (N, k)."""
        if not self.encoding:
            return words
        half = 2.0 ** (self.bits - 1)
        if self.encoding == TWOS_COMPLEMENT:
            return np.where(words >= half, words - 2.0 * half, words)
        return np.where(words >= half, half - words, words)


def corrected(signal: Signal, correction: SignalCorrection, source: str, place: str) -> Signal:
    """A signal whose columns are in another order, turned, late or without gravity.

    Args:
        signal: as the log has it, with unit, gain and offset.
        correction: `order` names for each joint of the robot the place (from 1) of its column among
            the signal's, `turned` the joints (from 1, in the new order) whose sign changes, `delay`
            in s adds to the signal's, `joint_delay` those of its columns, in the new order. Empty
            or 0: unchanged. `gain` multiplies its values.
        source, place: of the correction, for error lines.

    Raises:
        InputError: the correction names joints that the signal has not, or is none for it.
    """
    num_columns = len(signal.columns)
    joint_numbers = list(range(1, num_columns + 1))
    if correction.order and sorted(correction.order) != joint_numbers:
        problem = f"is {list(correction.order)}, expected each of 1 to {num_columns} once"
        raise InputError(source, f"{place}, order", problem, "name each joint's place once")
    if not set(correction.turned) <= set(joint_numbers):
        problem = f"is {list(correction.turned)}, expected joints from 1 to {num_columns}"
        raise InputError(source, f"{place}, turned", problem, "correct it")
    of_each = correction.joint_delay
    if of_each and len(of_each) != num_columns:
        problem = f"holds {len(of_each)} numbers, expected {num_columns}, one for each joint"
        raise InputError(source, f"{place}, joint_delay", problem, "correct it")
    for key, delays in (("delay", (correction.delay,)), ("joint_delay", of_each)):
        for delay in delays:
            if not abs(delay) <= LARGEST_DELAY:
                problem = f"is {delay:g} s, expected {LARGEST_DELAY:g} s at most"
                raise InputError(source, f"{place}, {key}", problem, "correct it")
    is_changed = correction.order or correction.turned or correction.delay or any(of_each)
    if (is_changed or correction.gain != 1.0) and signal.name not in _JOINT_SIGNALS:
        problem = "has an order, a delay, a gain or turned joints"
        raise InputError(source, place, problem, "these are for signals of the joints: remove them")
    if correction.without_gravity and signal.name not in ("current", "tau_J"):
        problem = "is no torque or current, which may be without gravity"
        raise InputError(source, f"{place}, without_gravity", problem, "remove it")
    places = [k - 1 for k in correction.order] or list(range(num_columns))
    factor = np.full(num_columns, correction.gain)
    factor[[k - 1 for k in correction.turned]] *= -1.0
    earlier = signal.joint_delay or (0.0,) * num_columns
    later = of_each or (0.0,) * num_columns
    joint_delay = tuple(earlier[k] + more for k, more in zip(places, later, strict=True))
    return replace(
        signal,
        columns=tuple(signal.columns[k] for k in places),
        scale=factor * signal.scale[places],
        offset=factor * signal.offset[places],
        delay=signal.delay + correction.delay,
        joint_delay=joint_delay if any(joint_delay) else (),
        without_gravity=signal.without_gravity or correction.without_gravity,
    )


@dataclass(frozen=True)
class ColumnLayout:
    """All signals of a log and the names of its columns as a person knows them."""

    signals: tuple[Signal, ...]
    column_names: tuple[str, ...]  # of every column; "column 3" where there is no header

    def signal(self, name: str) -> Signal | None:
        """The signal of this name; None if the log does not hold it."""
        return next((s for s in self.signals if s.name == name), None)

    def column_of(self, name: str, index: int = 0) -> str:
        """The column that holds entry `index` of a signal, as a person knows it."""
        signal = self.signal(name)
        return self.column_names[signal.columns[index]] if signal else name

    @property
    def time_place(self) -> str:
        """The column or columns of the time, for error lines."""
        time = self.signal("t")
        names = ["t"] if time is None else [self.column_names[k] for k in time.columns]
        if names[0].startswith("column "):  # of a log without names
            return ", ".join(names)
        return ("column " if len(names) == 1 else "columns ") + ", ".join(names)


def load_format(name_or_path: str | Path) -> tuple[RecordingFormat, Path]:
    """Reads a description: a bundled name, or the path of a YAML file.

    Returns:
        The description and its file.

    Raises:
        InputError: no such description, or it is wrong.
    """
    path = named_file(name_or_path, FORMATS, "description of a log")
    description = load_configuration(path, RecordingFormat)
    _check_description(description, path)
    return description, path


def rows_for(description: RecordingFormat, file: Path) -> tuple[int, int] | None:
    """First and last row (counted from 1) of a file that the description selects; None for all."""
    rows = description.rows.get(file.name)
    return (rows[0], rows[1]) if rows else None


def _check_description(description: RecordingFormat, path: Path) -> None:
    """Raises InputError for a key that is out of range or contradicts another.

    Args:
        description: as its file has it; signals are checked with the log's columns.
        path: its file, for error lines.
    """
    if len(description.separator) != 1 or description.separator in '"\n\r':
        problem = f'expected one character, found "{description.separator}"'
        raise InputError(path, "separator", problem, 'write separator: ";", or "\\t" for tabs')
    if description.decimal_mark not in (".", ","):
        raise InputError(path, "decimal_mark", 'expected "." or ","', "correct it")
    if description.decimal_mark == description.separator:
        raise InputError(path, "decimal_mark", "is the same as the separator", 'set separator: ";"')
    for key, most in (("skip_lines", MOST_SKIPPED_LINES), ("num_columns", MOST_COLUMNS)):
        value = getattr(description, key)
        if not 0 <= value <= most:
            raise InputError(path, key, f"{value}, expected 0 to {most}")
    for name, rows in description.rows.items():
        if rows and (len(rows) != 2 or not 1 <= rows[0] < rows[1]):
            problem = f"expected the first and the last row, counted from 1, found {rows}"
            raise InputError(
                path, f"rows, {name}", problem, "write e.g. [635, 3510], or [] for all rows"
            )
    for key in ("t", *_JOINT_SIGNALS, "dropout"):
        if key in description.extra:
            problem = "this is the name of a standard signal"
            raise InputError(path, f"extra, {key}", problem, "choose another name")
    if not 0.0 <= description.rate_hz <= LARGEST_RATE:
        problem = f"{description.rate_hz:g}, expected samples a second"
        raise InputError(path, "rate_hz", problem, f"give 0 to {LARGEST_RATE:g}")
    if description.keep_every < 1:
        problem = f"{description.keep_every}, expected a number of rows"
        raise InputError(path, "keep_every", problem, "give 1 for all rows, 10 for each tenth")
    if description.time is None and not description.rate_hz:
        raise InputError(path, "time", "is missing", "name its columns, or give rate_hz")
    if description.time is not None and description.rate_hz:
        raise InputError(path, "rate_hz", "is given beside time", "remove one of them")
    if description.time is not None and not str(description.time.columns).strip():
        raise InputError(path, "time", "names no column", 'write e.g. columns: "1"')


def resolve_layout(
    description: RecordingFormat, description_source: str, header: LogHeader
) -> ColumnLayout:
    """Finds the signals of a description among the columns of a log.

    Args:
        description: as its file has it.
        description_source: the description's file, for error lines.
        header: header of the log.

    Raises:
        InputError: the log lacks a column, has too many, or the description contradicts itself.
    """
    log_columns = _LogColumns(description_source, header)
    num_columns = header.num_columns
    if description.num_columns and num_columns != description.num_columns:
        problem = f"has {num_columns} columns, expected {description.num_columns}"
        remedy = "check the separator, or describe the columns with --log-format"
        raise log_columns.mismatch(problem, remedy)
    signals: list[Signal] = []
    for key, name in _SIGNAL_NAMES.items():
        entry: SignalColumns | None = getattr(description, key)
        if entry is not None:
            if entry.shape:
                problem = "only an extra signal has a shape"
                raise InputError(description_source, key, problem, "remove it")
            signals.append(log_columns.signal(entry, key, name, UNITS[key]))
    for name, entry in description.extra.items():
        signals.append(log_columns.signal(entry, f"extra, {name}", name))
    num_time_columns = max((len(s.columns) for s in signals if s.name == "t"), default=1)
    if num_time_columns > 2:
        problem = f"has {num_time_columns} columns, expected 1, or 2: seconds and nanoseconds"
        raise InputError(description_source, "time", problem, "name one or two")
    sizes = {s.name: len(s.columns) for s in signals if s.name in _JOINT_SIGNALS}
    if len(set(sizes.values())) > 1:
        listed = ", ".join(f"{name}: {size}" for name, size in sizes.items())
        problem = f"the signals have different numbers of joints ({listed})"
        place = "position, velocity, current"
        raise InputError(description_source, place, problem, "name one column per joint in each")
    return ColumnLayout(tuple(signals), log_columns.displayed_names)


def further_signals(
    further: dict[str, SignalColumns], requested_by: str, header: LogHeader
) -> tuple[Signal, ...]:
    """Finds signals that a caller needs besides those of the description.

    Args:
        further: columns by the signal's name.
        requested_by: the option that names the columns, for error lines.
        header: header of the log.

    Raises:
        InputError: the log lacks a column.
    """
    log_columns = _LogColumns(requested_by, header)
    return tuple(log_columns.signal(entry, name, name) for name, entry in further.items())


class _LogColumns:
    """The columns of a log, among which a description (or an option) finds its signals.

    Args:
        source: the description's file, or the option, for error lines.
        header: header of the log.

    Attributes:
        displayed_names: displayed names of every column as a person knows it.
    """

    def __init__(self, source: str, header: LogHeader) -> None:
        self._source = source
        self._log = header.path
        self._names = list(header.names) if header.names else None
        numbered = tuple(f"column {k + 1}" for k in range(header.num_columns))
        self.displayed_names = tuple(header.names) if header.names else numbered

    def mismatch(self, problem: str, remedy: str) -> InputError:
        """The error of a log that lacks what the description needs."""
        return InputError(self._log, "header" if self._names else "line 1", problem, remedy)

    def signal(
        self,
        entry: SignalColumns,
        place: str,
        name: str,
        units: Mapping[str, float] = _ANY_UNIT,
    ) -> Signal:
        """A signal with its columns, and scale and offset that make SI units of them.

        Args:
            entry: as the user describes it; checked here.
            place: key of the entry in the description, for error lines.
            name: of the signal in a recording: t, q, v, current, tau_J or that of an extra one.
            units: factor to SI by unit.

        Raises:
            InputError: a column that the log lacks, or an entry out of range.
        """
        source = self._source
        unit = entry.unit or _DEFAULT_UNIT.get(place, "")
        if unit not in units:
            listed = ", ".join(u for u in units if u)
            raise InputError(source, place, f'unknown unit "{unit}"', f"give one of {listed}")
        columns = self._columns(entry, place)
        num_columns = len(columns)
        scale = units[unit] * self._per_column(entry.gain, 1.0, num_columns, f"{place}, gain")
        offset = self._per_column(entry.offset, 0.0, num_columns, f"{place}, offset")
        if not (np.all(np.isfinite(scale)) and np.all(scale != 0) and np.all(np.isfinite(offset))):
            raise InputError(source, place, "a gain is zero or not a number", "correct it")
        self._check_keys(entry, place, name)
        if entry.exerted_on == ENVIRONMENT:
            scale = -scale
        shape = self._shape(entry, num_columns, place)
        if name == "t":
            shape = ()  # time is one number, also of two columns, which the reader adds up
            self._check_time(entry, num_columns, place)
            if num_columns == 2:  # seconds and nanoseconds, which have no unit or gain of their own
                scale[1] = 1e-9
        signal = Signal(
            name=name,
            columns=tuple(columns),
            scale=scale,
            offset=offset,
            shape=shape,
            may_be_empty=entry.may_be_empty,
            exerted_on=entry.exerted_on,
            encoding=entry.encoding,
            bits=entry.bits,
            wrap=entry.wrap,
        )
        correction = SignalCorrection(
            order=tuple(entry.order),
            turned=tuple(entry.turned),
            delay=entry.delay,
            joint_delay=tuple(entry.joint_delay),
            without_gravity=entry.without_gravity,
        )
        return corrected(signal, correction, source, place)

    def _check_keys(self, entry: SignalColumns, place: str, name: str) -> None:
        """Checks the words of an entry and the length of its numbers; arguments as `signal`."""
        source = self._source
        if entry.exerted_on not in (ROBOT, ENVIRONMENT):
            problem = f'exerted_on is "{entry.exerted_on}", expected {ROBOT} or {ENVIRONMENT}'
            raise InputError(source, place, problem, "correct it")
        for key, value, allowed in (
            ("encoding", entry.encoding, _ENCODINGS),
            ("wrap", entry.wrap, _WRAPS if name == "q" else ("",)),
        ):
            if value not in allowed:
                remedy = f"give one of {', '.join(w for w in allowed if w) or 'none'}"
                raise InputError(source, f"{place}, {key}", f'unknown "{value}"', remedy)
        if not 2 <= entry.bits <= _MOST_BITS:
            problem = f"{entry.bits}, expected 2 to {_MOST_BITS}"
            raise InputError(source, f"{place}, bits", problem, "give the length of a word")

    def _shape(self, entry: SignalColumns, num_columns: int, place: str) -> tuple[int, ...]:
        """The shape of a sample; of a vector where the entry states none."""
        shape = tuple(entry.shape) or (num_columns,)
        size = math.prod(shape)
        if min(shape) < 1 or size != num_columns:
            problem = f"{list(shape)} holds {size} numbers, but {num_columns} columns are named"
            remedy = "correct the shape or the columns"
            raise InputError(self._source, f"{place}, shape", problem, remedy)
        return shape

    def _check_time(self, entry: SignalColumns, num_columns: int, place: str) -> None:
        """Checks an entry that is the log's time."""
        if entry.may_be_empty:
            problem = "every sample needs its time"
            raise InputError(self._source, place, problem, "remove may_be_empty")
        if num_columns == 2 and (entry.unit or entry.gain or entry.offset):
            problem = "has two columns, seconds and nanoseconds, but also a unit, gain or offset"
            raise InputError(self._source, place, problem, "remove these")

    def _per_column(self, values: list[float], default: float, size: int, place: str) -> Array:
        if len(values) not in (0, 1, size):
            problem = f"has {len(values)} values for {size} columns"
            raise InputError(self._source, place, problem, "give one for all, or one per column")
        return np.array(np.broadcast_to(values or [default], size), dtype=np.float64)

    def _columns(self, entry: SignalColumns, place: str) -> list[int]:
        items = column_items(str(entry.columns), place, self._source)
        columns = [self._column(item, place) for item in items]
        if len(set(columns)) != len(columns):
            problem = "names a column twice"
            raise InputError(self._source, place, problem, "name each column once")
        return columns

    def _column(self, item: str, place: str) -> int:
        names = self._names
        num_columns = len(self.displayed_names)
        entry_place = f"{Path(self._source).name} ({place})"
        if item.isdecimal():
            number = int(item) if len(item) < 10 else MOST_COLUMNS + 1
            if not 1 <= number <= num_columns and names is not None and names.count(item) == 1:
                return names.index(item)  # of a register, whose number is its column's name
            if not 1 <= number <= num_columns:
                problem = f"has {num_columns} columns, but {entry_place} names column {item}"
                remedy = "check the separator, or the description's column numbers (from 1)"
                raise self.mismatch(problem, remedy)
            return number - 1
        if names is None:
            problem = f'names column "{item}", but the log has no header'
            remedy = "give column numbers counted from 1, or set header: true"
            raise InputError(self._source, place, problem, remedy)
        if item == "?" and item not in names:
            problem = "has a question mark, where a draft leaves a choice"
            raise InputError(self._source, place, problem, "name the columns there")
        if item not in names:
            remedy = nearest(item, names) or f"it has {', '.join(names[:12])}, ..."
            raise self.mismatch(f'lacks the column "{item}", which {entry_place} names', remedy)
        if names.count(item) > 1:
            raise self.mismatch(f'names the column "{item}" twice', "rename one of them")
        return names.index(item)


_NUMBERS = re.compile(r"(\d+)\s*(?:-|\.\.)\s*(\d+)")
_SERIES = re.compile(r"\{(\d+)\.\.(\d+)\}")


def column_items(text: str, place: str, source: str) -> list[str]:
    """The columns that a text names: "1, 3-5" or "t, q{1..3}"; braces from left to right.

    Args:
        text: items with commas between; of several braces in one item the last varies fastest.
        place, source: key and file of the description, for error lines.

    Returns:
        Each column's number (from 1) or name: of these texts 1, 3, 4, 5 and t, q1, q2, q3.

    Raises:
        InputError: the text cannot be read.
    """
    items: list[str] = []
    for item in (part.strip() for part in text.split(",")):
        if not item:
            raise InputError(source, place, "names no column", 'write e.g. columns: "2-7"')
        numbers = _NUMBERS.fullmatch(item)
        if numbers:
            span = _number_range(numbers, place, source)
            if not span:
                raise InputError(source, place, f'"{item}" runs backwards', "swap its ends")
            items += [str(k) for k in span]
            continue
        expanded = [item]
        while "{" in expanded[0]:
            match = _SERIES.search(expanded[0])
            span = range(0) if match is None else _number_range(match, place, source)
            if not span:
                raise InputError(source, place, f'cannot read "{item}"', 'write e.g. "q{1..6}"')
            if len(expanded) * len(span) > MOST_COLUMNS:
                raise _too_many(item, place, source)
            expanded = [_SERIES.sub(str(k), text, count=1) for text in expanded for k in span]
        items += expanded
        if len(items) > MOST_COLUMNS:
            raise _too_many(text, place, source)
    return items


def _number_range(match: re.Match[str], place: str, source: str) -> range:
    """The numbers of a series, its last one included; empty where it runs backwards."""
    if max(len(match[1]), len(match[2])) > len(str(MOST_COLUMNS)):
        raise _too_many(match[0], place, source)
    first, last = int(match[1]), int(match[2])
    if last - first >= MOST_COLUMNS:
        raise _too_many(match[0], place, source)
    return range(first, last + 1)


def _too_many(text: str, place: str, source: str) -> InputError:
    problem = f'"{text}" names more than {MOST_COLUMNS} columns'
    return InputError(source, place, problem, "name the columns of the log's signals only")
