"""Messages of ROS as numbers by name, and wrenches and joint states as serialised messages.

`rosbags` deserialises every message that is read, of ROS 1 and ROS 2. It serialises single
messages, which is slow for a log's worth of them: `Layout` finds the bytes of stamp and numbers by
serialising one message with two sets of numbers, and writes all others as one array.
"""

from collections.abc import Callable, Sequence
from functools import cache, lru_cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.numerics.arrays import Array

Stamps = NDArray[np.int64]
Deserialize = Callable[[bytes, str], Any]
"""Makes a message of its bytes and the name of its type."""

JOINT_STATE: Final = "sensor_msgs/msg/JointState"
DYNAMIC_JOINT_STATE: Final = "control_msgs/msg/DynamicJointState"
WRENCH: Final = "geometry_msgs/msg/WrenchStamped"
KINDS: Final = (JOINT_STATE, DYNAMIC_JOINT_STATE, WRENCH)
"""The types of messages that are read."""
QUANTITIES: Final = ("position", "velocity", "effort")
WRENCH_PARTS: Final = ("force/x", "force/y", "force/z", "torque/x", "torque/y", "torque/z")
STAMP_END: Final = 2**31
"""s, from which on no stamp of ROS 2 holds a time: its seconds are an int32."""
MOST_NUMBERS: Final = 4096  # of a message
_ONES_WORD: Final = 0x01010101  # a whole number none of whose bytes is zero
_ONES_DOUBLE: Final = float(np.frombuffer(b"\x01" * 8)[0])  # such a double
_DYNAMIC_JOINT_STATE_DEFINITION: Final = f"""\
std_msgs/Header header
string[] joint_names
InterfaceValue[] interface_values
{"=" * 80}
MSG: control_msgs/InterfaceValue
string[] interface_names
float64[] values
"""


@cache
def typestore() -> Any:
    """The message types of ROS 2; those used here are the same in all its versions."""
    from rosbags.typesys import Stores, get_typestore

    return _with_dynamic_joint_state(get_typestore(Stores.ROS2_HUMBLE))


@cache
def ros1_typestore() -> Any:
    """The message types of ROS 1."""
    from rosbags.typesys import Stores, get_typestore

    return _with_dynamic_joint_state(get_typestore(Stores.ROS1_NOETIC))


def _with_dynamic_joint_state(store: Any) -> Any:
    from rosbags.typesys import get_types_from_msg

    store.register(get_types_from_msg(_DYNAMIC_JOINT_STATE_DEFINITION, DYNAMIC_JOINT_STATE))
    return store


def header(frame: str, stamp: int = 0) -> Any:
    """A std_msgs/Header whose stamp has this number of seconds, and of nanoseconds."""
    types = typestore().types
    time = types["builtin_interfaces/msg/Time"](stamp, stamp)
    return types["std_msgs/msg/Header"](time, frame)


class Layout:
    """The bytes of stamp and doubles in messages that agree in all other bytes.

    Args:
        kind: type of the messages.
        make: returns such a message, given the number in its stamp and the one in its doubles.
        stamped: whether they have a stamp, before all doubles.
    """

    def __init__(
        self,
        kind: str,
        make: Callable[[int, float], Any],
        stamped: bool = True,
    ) -> None:
        zeros = typestore().serialize_cdr(make(0, 0.0), kind)
        ones = typestore().serialize_cdr(make(_ONES_WORD, _ONES_DOUBLE), kind)
        self._template = np.frombuffer(bytes(zeros), np.uint8)
        self._varies = self._template != np.frombuffer(bytes(ones), np.uint8)
        self._stamp_bytes = 8 if stamped else 0
        self._double = np.dtype("<f8")
        self._time = np.dtype([("s", "<i4"), ("ns", "<u4")])

    def encode(self, stamps: Stamps, values: Array) -> NDArray[np.uint8]:
        """(N, size) messages with stamps (N,) in ns, not negative, and doubles (N, k)."""
        varying = np.ascontiguousarray(values, self._double).view(np.uint8)
        if self._stamp_bytes:
            time = np.empty(len(stamps), self._time)
            time["s"], time["ns"] = stamps // 10**9, stamps % 10**9
            varying = np.concatenate([time[:, None].view(np.uint8), varying], axis=1)
        messages = np.tile(self._template, (len(stamps), 1))
        messages[:, self._varies] = varying
        return messages


class Messages:
    """Reads the messages of one topic as numbers by name.

    The names are JOINT/position, JOINT/velocity and JOINT/effort for each quantity of a JointState
    (the numbers of the joints from 1 on where it names none), JOINT/INTERFACE for each interface
    of a DynamicJointState, force/x to torque/z of a WrenchStamped.

    Args:
        kind: one of `KINDS`.
        deserialize: function of the bag that reads a message.
        examples: examples of the topic's first messages.

    Attributes:
        names: names of all numbers in the examples.
    """

    def __init__(self, kind: str, deserialize: Deserialize, examples: Sequence[bytes]) -> None:
        self._kind = kind
        self._deserialize = deserialize
        self._frame: str | None = None  # of the first wrench
        numbers = [self._numbers(deserialize(data, kind)) for data in examples]
        self.names = tuple(dict.fromkeys(name for entry in numbers for name in entry[0]))
        self._column = {name: k for k, name in enumerate(self.names)}
        self._columns_of: dict[tuple[str, ...], NDArray[np.int64]] = {}

    def decode(self, raw: Sequence[bytes]) -> tuple[Stamps, Array]:
        """(N,) stamps of the headers in ns, and (N, k) numbers; NaN where a message lacks one.

        Raises:
            Exception: of any kind, a message is damaged.
        """
        stamps, values = np.empty(len(raw), np.int64), np.full((len(raw), len(self.names)), np.nan)
        for k, data in enumerate(raw):
            message = self._deserialize(data, self._kind)
            stamp = message.header.stamp
            stamps[k] = int(stamp.sec) * 10**9 + int(stamp.nanosec)
            names, numbers = self._numbers(message)
            columns = self._columns_of.get(names)
            if columns is None:  # a driver writes one set of names, or a few
                columns = np.array([self._column.get(name, -1) for name in names], np.int64)
                self._columns_of[names] = columns
            is_known = columns >= 0
            values[k, columns[is_known]] = numbers[is_known]
        return stamps, values

    def _numbers(self, message: Any) -> tuple[tuple[str, ...], Array]:
        """The names of a message's numbers, and the numbers."""
        if self._kind == JOINT_STATE:
            return _joint_state_numbers(message)
        if self._kind == DYNAMIC_JOINT_STATE:
            return _interface_numbers(message)
        if self._frame is None:
            self._frame = message.header.frame_id
        elif message.header.frame_id != self._frame:
            return WRENCH_PARTS, np.full(6, np.nan)
        force, torque = message.wrench.force, message.wrench.torque
        numbers = np.array([force.x, force.y, force.z, torque.x, torque.y, torque.z])
        return WRENCH_PARTS, numbers


def _joint_state_numbers(message: Any) -> tuple[tuple[str, ...], Array]:
    """A quantity with another number of entries than the message has joints is left out."""
    joints = message.name
    if not joints:
        joints = _joint_numbers(len(message.position))
    quantities = [name for name in QUANTITIES if len(getattr(message, name)) == len(joints)]
    numbers = [getattr(message, name) for name in quantities]
    names = _joined_names(tuple(joints), tuple(quantities))
    return names, np.concatenate(numbers) if numbers else np.empty(0)


@cache
def _joint_numbers(count: int) -> tuple[str, ...]:
    return tuple(str(k + 1) for k in range(min(count, MOST_NUMBERS)))


@lru_cache(maxsize=64)
def _joined_names(joints: tuple[str, ...], quantities: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(f"{joint}/{quantity}" for quantity in quantities for joint in joints)


def _interface_numbers(message: Any) -> tuple[tuple[str, ...], Array]:
    names: list[str] = []
    numbers: list[float] = []
    for joint, values in zip(message.joint_names, message.interface_values, strict=False):
        for interface, number in zip(values.interface_names, values.values, strict=False):
            names.append(f"{joint}/{interface}")
            numbers.append(number)
    return tuple(names), np.array(numbers, float)


def nanoseconds(t: Array) -> Stamps:
    """(N,) whole nanoseconds of times in s; inverse of `seconds` where t has no finer part."""
    whole = np.floor(t)
    return whole.astype(np.int64) * 10**9 + np.rint((t - whole) * 1e9).astype(np.int64)


def seconds(stamps: Stamps) -> Array:
    """(N,) s of times in ns, rounded to the nearest double."""
    is_exact = np.abs(stamps) < 1 << 53  # as a double, so that one rounding suffices
    whole = stamps // 10**9
    return np.where(is_exact, stamps / 1e9, whole + (stamps - whole * 10**9) / 1e9)
