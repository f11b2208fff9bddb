"""Logs in ROS 2 bags (MCAP and SQLite, one file or a folder of them), read without ROS.

Columns are named as PlotJuggler names its series: TOPIC/JOINT/position and so on of
sensor_msgs/JointState, TOPIC/force/x and so on of geometry_msgs/WrenchStamped; `time` is the
messages' own stamp in s. Where columns of several topics are wanted, the topic of the positions
gives the rows, and the others are interpolated linearly at its stamps.
"""

import re
import tempfile
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.whole_file import whole_file, writing_to
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.recording_format import RecordingFormat
from wrenchsight.models.recordings.rosbag.bounded_bag import bounded_reader
from wrenchsight.models.recordings.rosbag.messages import (
    JOINT_STATE,
    KINDS,
    QUANTITIES,
    Layout,
    Messages,
    header,
    nanoseconds,
    seconds,
    typestore,
)
from wrenchsight.models.recordings.table_checks import refuse_missing, rows_within

Rows = NDArray[np.int64]

_BLOCK_MESSAGES = 1 << 14
_PROBED = 64  # messages that show whether a driver fills a quantity, or leaves NaN in it
_LONGEST_BRIDGE = 0.1  # s between two messages of a topic that is interpolated, or
_BRIDGED_STEPS = 3.0  # its median steps, whichever is longer
_METADATA = "metadata.yaml"
_CURRENT_TOPIC = "/motor_current"


class RosbagContainer:
    """Logs in ROS 2 bags; implements `log_container.LogContainer`."""

    suffixes: tuple[str, ...] = (".mcap", ".db3")

    def open(self, path: Path, form: RecordingFormat | None) -> "RosbagTable":
        """As the protocol; the bag says all by itself, so that `form` is not read."""
        return RosbagTable(path)

    def write(self, path: Path, columns: Mapping[str, NDArray[Any]]) -> None:
        """As the protocol, in MCAP; times are rounded to the nanosecond that a stamp holds.

        q, v and tau go to /joint_states, i to /motor_current as efforts, and a signal NAME.1.. to
        /NAME as positions.

        Raises:
            InputError: a time that a stamp cannot hold; the file cannot be written.
        """
        joints: dict[str, dict[str, dict[str, NDArray[Any]]]] = {}  # topic, quantity, joint
        own = {"q": "position", "v": "velocity", "tau": "effort", "i": "effort"}
        for name, column in columns.items():
            if match := re.fullmatch(r"(q|v|tau|i)(\d+)", name):
                topic = _CURRENT_TOPIC if match[1] == "i" else "/joint_states"
                held = joints.setdefault(topic, {}).setdefault(own[match[1]], {})
                held[f"joint_{match[2]}"] = column
            elif match := re.fullmatch(r"(.+)\.(\d+)", name):
                topic = "/" + re.sub(r"\W", "_", match[1])
                joints.setdefault(topic, {}).setdefault("position", {})[match[2]] = column
            elif name != "t":
                joints.setdefault("/" + name, {}).setdefault("position", {})["1"] = column
        stamps = nanoseconds(np.asarray(columns["t"], float))
        if len(stamps) and not 0 <= stamps.min() <= stamps.max() < 2**32 * 10**9:
            raise InputError(path, "", "a stamp of ROS holds 0 to 2^32 s", "shift the times")
        with BagWriter(path) as writer:
            for topic, quantities in joints.items():
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
                # rosbags writes a folder; the file in it is a bag by itself.
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
        joints = list(dict.fromkeys(name for held in quantities.values() for name in held))
        held = [quantity for quantity in QUANTITIES if quantity in quantities]
        values = np.concatenate(
            [
                np.stack([np.asarray(quantities[q][name], float) for name in joints], axis=1)
                for q in held
            ],
            axis=1,
        )

        def message(stamp: int, number: float) -> Any:
            sizes = [len(joints) if quantity in held else 0 for quantity in QUANTITIES]
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
                (found,) = self._bag.glob("*.mcap")
                found.replace(self._partial)


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
        self.path = path
        self.notices: list[str] = []
        self.progress = 0.0
        self._topics: dict[str, Messages] = {}
        self._counts: dict[str, int] = {}
        self._columns: list[tuple[str, int]] = []  # topic and place in its messages
        self._bag_time: set[str] = set()  # topics whose headers bear no stamp
        names = ["time"]
        kinds: set[str] = set()
        with self._reading() as reader:
            for connection in reader.connections:
                kinds.add(connection.msgtype)
                topic = connection.topic
                known = connection.msgtype in KINDS
                if not known or topic in self._topics or connection.msgcount == 0:
                    continue
                probe = [data for *_, data in islice(reader.messages([connection]), _PROBED)]
                messages = Messages(connection.msgtype, probe[0])
                stamps, values = messages.decode(probe)
                if not stamps.any():
                    self._bag_time.add(topic)
                    self.notices.append(
                        f"{topic}: its headers bear no stamp; the time of recording stands for it"
                    )
                self._topics[topic], self._counts[topic] = messages, connection.msgcount
                for k, name in enumerate(messages.names):
                    if np.isfinite(values[:, k]).any():
                        names.append(f"{topic}/{name}")
                        self._columns.append((topic, k))
        if not self._columns:
            listed = ", ".join(sorted(kinds)) or "nothing"
            problem = f"holds no topic of {' or '.join(KINDS)}; it holds {listed}"
            raise InputError(path, "", problem, "record the joint states")
        self.names: tuple[str, ...] | None = tuple(names)
        self.num_columns = len(names)

    def blocks(
        self,
        columns: list[int],
        rows: tuple[int, int] | None = None,
        may_be_empty: Collection[int] = (),
    ) -> Iterator[tuple[Array, Rows]]:
        """As the protocol."""
        assert self.names is not None
        wanted = [self._columns[column - 1] for column in columns if column > 0]
        main = self._main_topic(columns)
        count = self._counts[main]
        first, last = rows_within(self.path, rows, count, f"messages on {main}")
        followers = {
            topic: _Follower(self._stream(topic)) for topic in {t for t, _ in wanted} - {main}
        }
        row = 1
        for t, block in self._stream(main):
            begin, end = max(first - row, 0), min(last + 1 - row, len(t))
            row += len(t)
            self.progress = min(1.0, (row - 1) / count)
            if end <= begin:
                continue
            read = {topic: one.at(t[begin:end]) for topic, one in followers.items()}
            read[main] = block[begin:end]
            values = np.empty((end - begin, len(columns)))
            for i, column in enumerate(columns):
                if column == 0:
                    values[:, i] = t[begin:end]
                else:
                    topic, k = self._columns[column - 1]
                    values[:, i] = read[topic][:, k]
            numbers = np.arange(row - len(t) + begin, row - len(t) + end)
            refuse_missing(self, self.path, values, numbers, columns, may_be_empty)
            yield values, numbers
            if row > last:
                break

    def _main_topic(self, columns: Sequence[int]) -> str:
        assert self.names is not None
        held = [column for column in columns if column > 0]
        positions = [column for column in held if self.names[column].endswith("/position")]
        if positions or held:
            return self._columns[(positions or held)[0] - 1][0]
        return max(self._counts, key=lambda topic: self._counts[topic])

    def _stream(self, topic: str) -> Iterator[tuple[Array, Array]]:
        """Times (N,) in s and numbers (N, k) of a topic, some thousand messages at a time."""
        messages = self._topics[topic]
        with self._reading() as reader:
            source = reader.messages([c for c in reader.connections if c.topic == topic])
            while part := list(islice(source, _BLOCK_MESSAGES)):
                stamps, values = messages.decode([data for *_, data in part])
                if topic in self._bag_time:
                    stamps = np.array([recorded for _, recorded, _ in part], np.int64)
                yield seconds(stamps), values

    @contextmanager
    def _reading(self) -> Iterator[Any]:
        """The opened bag; what goes wrong in it is the user's line."""
        try:
            with bounded_reader(self.path) as reader:
                yield reader
        except FileNotFoundError as error:
            raise InputError(self.path, "", "no such bag", "check the path") from error
        except InputError:
            raise
        except Exception as error:  # damaged bytes raise whatever they meet first
            raise InputError(
                self.path,
                "",
                f"is no bag, or a damaged one ({str(error)[:200] or type(error).__name__})",
                "repair it (ros2 bag reindex, mcap recover), or record it again",
            ) from error


class _Follower:
    """Another topic's numbers at the times of the main one."""

    def __init__(self, source: Iterator[tuple[Array, Array]]) -> None:
        self._source = source
        self._t = np.empty(0)
        self._values: Array | None = None
        self._step = np.inf

    def at(self, t: Array) -> Array:
        """(N, k) interpolated at increasing times (N,); NaN where there is nothing to either side.

        Times must not lie before those of the call before.
        """
        while not len(self._t) or self._t[-1] < t[-1]:
            block = next(self._source, None)
            if block is None:
                break
            self._t = np.concatenate([self._t, block[0]])
            held = [block[1]] if self._values is None else [self._values, block[1]]
            self._values = np.concatenate(held)
            if not np.isfinite(self._step) and len(self._t) > 1:
                self._step = float(np.median(np.diff(self._t)))
        assert self._values is not None
        if len(self._t) < 2:
            return np.full((len(t), self._values.shape[1]), np.nan)
        right = np.clip(np.searchsorted(self._t, t, side="left"), 1, len(self._t) - 1)
        columns = [np.interp(t, self._t, column, np.nan, np.nan) for column in self._values.T]
        values = np.stack(columns, axis=1)
        longest = max(_LONGEST_BRIDGE, _BRIDGED_STEPS * self._step)
        values[self._t[right] - self._t[right - 1] > longest] = np.nan
        keep = max(int(right[-1]) - 1, 0)
        self._t, self._values = self._t[keep:], self._values[keep:]
        return values
