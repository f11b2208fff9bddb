"""Logs in bags of ROS 1 and ROS 2 (MCAP and SQLite, one file or a folder), read without ROS.

Columns are named as PlotJuggler names its series: TOPIC/JOINT/position and so on of
sensor_msgs/JointState and control_msgs/DynamicJointState, TOPIC/force/x and so on of
geometry_msgs/WrenchStamped. `time` is the stamp in the messages' headers, in s. If the columns come
from several topics, each message of the topic of the positions is a row. The other topics are
interpolated linearly at its stamps.
"""

import re
import tempfile
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.whole_file import whole_file, writing_to
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.parquet_table import ConvertedTable
from wrenchsight.models.recordings.recording_format import RecordingFormat
from wrenchsight.models.recordings.rosbag.bounded_bag import (
    ROS1_SUFFIX,
    OpenedBag,
    bounded_reader,
    is_ros1_bag,
)
from wrenchsight.models.recordings.rosbag.fields_table import fields_table
from wrenchsight.models.recordings.rosbag.messages import (
    JOINT_STATE,
    KINDS,
    QUANTITIES,
    STAMP_END,
    Layout,
    Messages,
    header,
    nanoseconds,
    seconds,
    typestore,
)
from wrenchsight.models.recordings.table_checks import no_words, refuse_missing, rows_within

Rows = NDArray[np.int64]

_BLOCK_MESSAGES = 1 << 14
_PROBED_MESSAGES = 64  # messages that show whether a driver fills a quantity, or leaves it NaN
_LONGEST_BRIDGE = 0.1  # s, longest step of a topic that is interpolated, or
_BRIDGED_STEPS = 3.0  # median steps, whichever is longer
_METADATA = "metadata.yaml"
_JOINT_TOPIC, _CURRENT_TOPIC = "/joint_states", "/motor_current"
_QUANTITY_OF_LETTER = {"q": "position", "v": "velocity", "tau": "effort", "i": "effort"}


class _Column(NamedTuple):
    """Where a column of the table comes from."""

    topic: str
    entry: int  # among the numbers of its messages


class _WrittenColumn(NamedTuple):
    """Where a column of a log is written."""

    topic: str
    quantity: str
    joint: str


def _written_column(name: str) -> _WrittenColumn:
    """The place in a bag of a column with this name."""
    joint = re.fullmatch(r"(q|v|tau|i)(\d+)", name)
    if joint:
        topic = _CURRENT_TOPIC if joint[1] == "i" else _JOINT_TOPIC
        return _WrittenColumn(topic, _QUANTITY_OF_LETTER[joint[1]], f"joint_{joint[2]}")
    entry = re.fullmatch(r"(.+)\.(\d+)", name)
    if entry:
        return _WrittenColumn("/" + re.sub(r"\W", "_", entry[1]), "position", entry[2])
    return _WrittenColumn("/" + name, "position", "1")


class RosbagContainer:
    """Logs in bags; implements `log_container.LogContainer`."""

    suffixes: tuple[str, ...] = (".mcap", ".db3", ROS1_SUFFIX)

    def open(self, path: Path, form: RecordingFormat | None) -> "RosbagTable | ConvertedTable":
        """As the protocol; the bag describes itself, so that `form` is not used.

        Where no topic is of a kind of joint states, the fields of another one may be.
        """
        try:
            return RosbagTable(path)
        except InputError:
            table = fields_table(path)
            if table is None:
                raise
            return table

    def write(self, path: Path, columns: Mapping[str, NDArray[Any]]) -> None:
        """As the protocol, in MCAP; times are rounded to the nanosecond of a stamp.

        q, v and tau go to /joint_states, i to /motor_current as efforts, and a signal NAME.1.. to
        /NAME as positions.

        Raises:
            InputError: a stamp cannot hold a time, or the file cannot be written.
        """
        topics: dict[str, dict[str, dict[str, NDArray[Any]]]] = {}  # by topic, quantity, joint
        for name, values in columns.items():
            if name != "t":
                column = _written_column(name)
                quantities = topics.setdefault(column.topic, {})
                quantities.setdefault(column.quantity, {})[column.joint] = values
        stamps = nanoseconds(np.asarray(columns["t"], float))
        if len(stamps) and not 0 <= stamps.min() <= stamps.max() < STAMP_END * 10**9:
            problem = "has times that no ROS stamp can hold, expected 0 to 2^31 s"
            raise InputError(path, "", problem, "shift the times")
        with BagWriter(path) as writer:
            for topic, quantities in topics.items():
                writer.write_joint_states(topic, stamps, quantities)


class BagWriter:
    """Writes an MCAP file of ROS 2 messages; it appears when the `with` block ends without error.

    Raises:
        InputError: on entry, on exit and while writing, the file cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._connections: dict[str, Any] = {}

    def __enter__(self) -> "BagWriter":
        from rosbags.rosbag2 import StoragePlugin, Writer

        with ExitStack() as stack:
            self._partial = stack.enter_context(whole_file(self.path))
            with writing_to(self.path):
                # rosbags writes a folder, whose file is moved to the path at the end.
                folder = stack.enter_context(
                    tempfile.TemporaryDirectory(
                        prefix=".bag", dir=self.path.parent, ignore_cleanup_errors=True
                    )
                )
                self._bag = Path(folder) / "bag"
                self._writer = Writer(self._bag, version=9, storage_plugin=StoragePlugin.MCAP)
                self._writer.open()
            self._opened = stack.pop_all()
        return self

    def write(self, topic: str, kind: str, stamps: Rows, messages: NDArray[np.uint8]) -> None:
        """Appends (N, L) messages of one kind to a topic, at their stamps (N,) in ns."""
        with writing_to(self.path):
            if topic not in self._connections:
                self._connections[topic] = self._writer.add_connection(
                    topic, kind, typestore=typestore()
                )
            connection = self._connections[topic]
            for stamp, message in zip(stamps.tolist(), messages, strict=True):
                self._writer.write(connection, stamp, message.tobytes())

    def write_joint_states(
        self, topic: str, stamps: Rows, quantities: Mapping[str, Mapping[str, NDArray[Any]]]
    ) -> None:
        """Appends sensor_msgs/JointState: (N,) numbers by quantity and joint."""
        joints = list(
            dict.fromkeys(joint for by_joint in quantities.values() for joint in by_joint)
        )
        columns = [
            np.asarray(quantities[quantity][joint], float)
            for quantity in QUANTITIES
            if quantity in quantities
            for joint in joints
        ]
        values = np.stack(columns, axis=1)

        def message(stamp: int, number: float) -> Any:
            sizes = [len(joints) if quantity in quantities else 0 for quantity in QUANTITIES]
            numbers = [np.full(size, number) for size in sizes]
            return typestore().types[JOINT_STATE](header("", stamp), joints, *numbers)

        layout = Layout(JOINT_STATE, message)
        for begin in range(0, len(stamps), _BLOCK_MESSAGES):
            part = slice(begin, begin + _BLOCK_MESSAGES)
            self.write(topic, JOINT_STATE, stamps[part], layout.encode(stamps[part], values[part]))

    def __exit__(self, kind: Any, error: BaseException | None, traceback: Any) -> None:
        with self._opened:
            if error is not None:
                raise error
            with writing_to(self.path):
                self._writer.close()
                (file,) = self._bag.glob("*.mcap")
                file.replace(self._partial)


def is_bag(path: Path) -> bool:
    """Whether a path is a rosbag2 folder."""
    return path.is_dir() and (path / _METADATA).is_file()


class RosbagTable:
    """A bag: each message of the topic that holds the positions is a row, counted from 1.

    Raises:
        InputError: no such file, no bag or a damaged one, no topic of a kind that is read.
    """

    row_word = "message"

    def __init__(self, path: Path) -> None:
        """Finds the columns: time, then TOPIC/NAME of each number in the first messages' topics."""
        self.path = path
        self.notices: list[str] = []
        self.progress = 0.0
        self._topics: dict[str, Messages] = {}
        self._kinds: dict[str, str] = {}
        self._counts: dict[str, int] = {}
        self._columns: list[_Column] = []  # all but the first one, the time
        self._others: dict[str, str] = {}  # kinds of the topics that are not read
        self.has_parts = False  # no message of a topic holds all of its numbers
        self._unstamped: set[str] = set()  # topics whose headers have no stamp
        names = ["time"]
        kinds: set[str] = set()
        with self._reading() as bag:
            for connection in bag.reader.connections:
                kinds.add(connection.msgtype)
                topic = connection.topic
                if connection.msgtype not in KINDS:
                    self._others[topic] = connection.msgtype
                if connection.msgtype not in KINDS or connection.msgcount == 0:
                    continue
                if topic in self._topics:  # a further publisher of ROS 1
                    self._counts[topic] += connection.msgcount
                    continue
                # What all of its publishers sent first tells its numbers: those that are not NaN in
                # any of these messages become columns.
                same = _connections(bag, topic, connection.msgtype)
                probe = [data for *_, data in islice(bag.reader.messages(same), _PROBED_MESSAGES)]
                messages = Messages(connection.msgtype, bag.deserialize, probe)
                self._kinds[topic] = connection.msgtype
                stamps, values = messages.decode(probe)
                if not stamps.any():
                    self._unstamped.add(topic)
                    self.notices.append(
                        f"{topic}: its headers have no stamp; the time of recording is used"
                    )
                self._topics[topic] = messages
                self._counts[topic] = connection.msgcount
                is_number = np.isfinite(values)
                self.has_parts |= not (is_number == is_number.any(axis=0)).all(axis=1).any()
                for k, name in enumerate(messages.names):
                    if np.isfinite(values[:, k]).any():
                        names.append(f"{topic}/{name}")
                        self._columns.append(_Column(topic, k))
        if not self._columns:
            listed = ", ".join(sorted(kinds)) or "nothing"
            problem = f"holds no topic of {' or '.join(KINDS)}; it holds {listed}"
            if self._topics:
                problem = f"the messages of {', '.join(self._topics)} hold no numbers"
            raise InputError(path, "", problem, "record the joint states")
        self.names: tuple[str, ...] | None = tuple(names)
        self.num_columns = len(names)

    def others(self) -> str:
        """The topics that are not read, as the end of a sentence; '' where there are none."""
        if not self._others:
            return ""
        listed = ", ".join(f"{topic} ({kind})" for topic, kind in self._others.items())
        return f"; topics that are not read: {listed}"

    def row_words(self, columns: Sequence[int], in_all_rows: bool = True) -> Sequence[str]:
        """As the protocol; the names of the joints are in those of the columns."""
        raise no_words(self.path)

    def blocks(
        self,
        columns: list[int],
        rows: tuple[int, int] | None = None,
        may_be_empty: Collection[int] = (),
    ) -> Iterator[tuple[Array, Rows]]:
        """As the protocol LogTable: blocks of (values (N, k), numbers (N,) of their rows).

        The rows are the messages of one of the columns' topics, the main one; the numbers of the
        others are interpolated to their times.

        Args:
            columns: numbers of the k columns, from 0; 0 is the time.
            rows: the first and the last message that is read, from 1; None: all.
            may_be_empty: columns of which a value may be missing: NaN.
        """
        assert self.names is not None
        main = self._main_topic(columns)
        count = self._counts[main]
        first, last = rows_within(self.path, rows, count, f"messages on {main}")
        topics = {self._columns[column - 1].topic for column in columns if column > 0}
        interpolated = {topic: _InterpolatedTopic(self._stream(topic)) for topic in topics - {main}}
        next_row = 1
        for t, block in self._stream(main):
            row, next_row = next_row, next_row + len(t)  # of the block's first message
            begin, end = max(first - row, 0), min(last + 1 - row, len(t))
            self.progress = min(1.0, (next_row - 1) / count)
            if end <= begin:
                continue
            numbers_of = {topic: source.at(t[begin:end]) for topic, source in interpolated.items()}
            numbers_of[main] = block[begin:end]
            values = np.empty((end - begin, len(columns)))
            for i, column in enumerate(columns):
                if column == 0:
                    values[:, i] = t[begin:end]
                else:
                    place = self._columns[column - 1]
                    values[:, i] = numbers_of[place.topic][:, place.entry]
            row_numbers = np.arange(row + begin, row + end)
            refuse_missing(self, self.path, values, row_numbers, columns, may_be_empty)
            yield values, row_numbers
            if next_row > last:
                break

    def _main_topic(self, columns: Sequence[int]) -> str:
        """The topic whose messages are the rows: that of the positions, if it is among them."""
        assert self.names is not None
        signals = [column for column in columns if column > 0]
        positions = [column for column in signals if self.names[column].endswith("/position")]
        if signals:
            return self._columns[(positions or signals)[0] - 1].topic
        return max(self._counts, key=lambda topic: self._counts[topic])

    def _stream(self, topic: str) -> Iterator[tuple[Array, Array]]:
        """Times (N,) in s and numbers (N, k) of a topic, some thousand messages at a time."""
        messages = self._topics[topic]
        with self._reading() as bag:
            source = bag.reader.messages(_connections(bag, topic, self._kinds[topic]))
            while part := list(islice(source, _BLOCK_MESSAGES)):
                stamps, values = messages.decode([data for *_, data in part])
                if topic in self._unstamped:
                    stamps = np.array([recorded for _, recorded, _ in part], np.int64)
                yield seconds(stamps), values

    @contextmanager
    def _reading(self) -> Iterator[OpenedBag]:
        """The opened bag; errors while it is read become an InputError."""
        try:
            with bounded_reader(self.path) as bag:
                yield bag
        except FileNotFoundError as error:
            raise InputError(self.path, "", "no such bag", "check the path") from error
        except InputError:
            raise
        except Exception as error:  # rosbags raises errors of any kind over damaged bytes
            problem = "is no bag, or a damaged one"
            if is_ros1_bag(self.path):
                if "not indexed" in str(error):
                    problem = "is a ROS 1 bag that was not closed"
                name = self.path.name
                remedy = f"write its index anew: rosbag reindex {name} (of ROS 1)"
                if self.path.suffix.lower() != ROS1_SUFFIX:  # .bag.active
                    new_name = self.path.stem.removesuffix(ROS1_SUFFIX) + ROS1_SUFFIX
                    remedy = f"name it {new_name}, then {remedy.replace(name, new_name)}"
            else:
                remedy = "repair it (ros2 bag reindex, mcap recover)"
            detail = str(error)[:200] or type(error).__name__
            raise InputError(
                self.path, "", f"{problem} ({detail})", f"{remedy}, or record it again"
            ) from error


def _connections(bag: OpenedBag, topic: str, kind: str) -> list[Any]:
    """All connections of a topic, of which there is one for each publisher in ROS 1."""
    return [c for c in bag.reader.connections if c.topic == topic and c.msgtype == kind]


class _InterpolatedTopic:
    """The numbers of a topic, interpolated at the times of the main topic."""

    def __init__(self, source: Iterator[tuple[Array, Array]]) -> None:
        self._source = source
        self._t = np.empty(0)
        self._values: Array | None = None
        self._step = np.inf

    def at(self, t: Array) -> Array:
        """(N, k) numbers of the topic, linear between its messages, at times (N,).

        NaN in gaps longer than _LONGEST_BRIDGE s or _BRIDGED_STEPS of its usual steps, and before
        and after the messages. Messages are read as far as needed, and forgotten behind t.

        Args:
            t: increasing, and not before the times of an earlier call.
        """
        while not len(self._t) or self._t[-1] < t[-1]:
            block = next(self._source, None)
            if block is None:
                break
            times, numbers = block
            self._t = np.concatenate([self._t, times])
            if self._values is None:
                self._values = numbers
            else:
                self._values = np.concatenate([self._values, numbers])
            if not np.isfinite(self._step) and len(self._t) > 1:  # by the first messages, for good
                self._step = float(np.median(np.diff(self._t)))
        assert self._values is not None  # a topic that has columns has messages
        if len(self._t) < 2:
            return np.full((len(t), self._values.shape[1]), np.nan)
        right = np.clip(np.searchsorted(self._t, t, side="left"), 1, len(self._t) - 1)
        columns = [np.interp(t, self._t, column, np.nan, np.nan) for column in self._values.T]
        values = np.stack(columns, axis=1)
        longest = max(_LONGEST_BRIDGE, _BRIDGED_STEPS * self._step)
        values[self._t[right] - self._t[right - 1] > longest] = np.nan
        start = max(int(right[-1]) - 1, 0)  # of the messages that later times may need
        self._t, self._values = self._t[start:], self._values[start:]
        return values
