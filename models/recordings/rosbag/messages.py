"""Converts ROS 2 messages in their serialised form (CDR) to and from arrays, many at a time.

`rosbags` reads and writes single messages, which is slow. A topic's messages almost always differ
only in their stamp and numbers. The bytes of these are found by serialising one message with two
sets of numbers. All messages that agree in the other bytes are decoded as one array; any other
message is decoded by `rosbags`.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.numerics.arrays import Array

Stamps = NDArray[np.int64]

JOINT_STATE: Final = "sensor_msgs/msg/JointState"
WRENCH: Final = "geometry_msgs/msg/WrenchStamped"
KINDS: Final = (JOINT_STATE, WRENCH)
"""The types of messages that are read."""
QUANTITIES: Final = ("position", "velocity", "effort")
WRENCH_PARTS: Final = ("force/x", "force/y", "force/z", "torque/x", "torque/y", "torque/z")
_ONES: Final = 0x01010101  # a whole number none of whose bytes is zero
_ONES_DOUBLE: Final = float(np.frombuffer(b"\x01" * 8)[0])  # such a double


@cache
def typestore() -> Any:
    """The message types of rosbags; those read here are the same in all versions of ROS 2."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_HUMBLE)


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
        little: whether their byte order is little-endian.
    """

    def __init__(
        self,
        kind: str,
        make: Callable[[int, float], Any],
        stamped: bool = True,
        little: bool = True,
    ) -> None:
        zeros = typestore().serialize_cdr(make(0, 0.0), kind, little_endian=little)
        ones = typestore().serialize_cdr(make(_ONES, _ONES_DOUBLE), kind, little_endian=little)
        self._template = np.frombuffer(bytes(zeros), np.uint8)
        self._varies = self._template != np.frombuffer(bytes(ones), np.uint8)
        self._stamp_bytes = 8 if stamped else 0
        order = "<" if little else ">"
        self._double = np.dtype(order + "f8")
        self._time = np.dtype([("s", order + "i4"), ("ns", order + "u4")])

    @property
    def size(self) -> int:
        """Bytes of a message."""
        return len(self._template)

    def alike(self, block: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """(N,) which of (N, size) messages have this layout: only stamp and doubles differ."""
        is_same = block[:, ~self._varies] == self._template[~self._varies]
        return np.asarray(is_same.all(axis=1))

    def decode(self, block: NDArray[np.uint8]) -> tuple[Stamps, Array]:
        """(N,) stamps in ns and (N, k) doubles of (N, size) messages of this layout."""
        varying = block[:, self._varies]
        stamp = np.ascontiguousarray(varying[:, : self._stamp_bytes]).view(self._time)[:, 0]
        values = np.ascontiguousarray(varying[:, self._stamp_bytes :]).view(self._double)
        stamps = stamp["s"].astype(np.int64) * 10**9 + stamp["ns"]
        return stamps, values.astype(np.float64, copy=False)

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
    """Decodes the messages of one topic, in the layout of its first message.

    Args:
        kind: one of `KINDS`.
        example: a message of the topic, with the names of its joints or the frame of its wrenches.

    Attributes:
        names: of the numbers in a message: JOINT/position, JOINT/velocity and JOINT/effort for each
            quantity of a JointState, force/x to torque/z of a WrenchStamped.
    """

    def __init__(self, kind: str, example: bytes) -> None:
        self._kind = kind
        message = typestore().deserialize_cdr(example, kind)
        self._frame = message.header.frame_id
        names = self._names(message)
        self.names = tuple(name for name in names if name is not None)
        self._columns = [k for k, name in enumerate(names) if name is not None]
        is_little = bool(example[1] & 1)

        def filled(stamp: int, number: float) -> Any:
            return _filled(message, stamp, number)

        self._layout = Layout(kind, filled, little=is_little)

    def decode(self, raw: Sequence[bytes]) -> tuple[Stamps, Array]:
        """(N,) stamps of the headers in ns, and (N, k) numbers; NaN where a message lacks one.

        Raises:
            Exception: of any kind, a message is damaged.
        """
        stamps, values = np.empty(len(raw), np.int64), np.empty((len(raw), len(self.names)))
        size = self._layout.size
        has_layout = np.fromiter((len(data) == size for data in raw), bool, len(raw))
        if has_layout.any():
            joined = b"".join(data for data in raw if len(data) == size)
            block = np.frombuffer(joined, np.uint8).reshape(-1, size)
            is_alike = self._layout.alike(block)
            has_layout[np.flatnonzero(has_layout)[~is_alike]] = False
            stamps[has_layout], doubles = self._layout.decode(block[is_alike])
            values[has_layout] = doubles[:, self._columns]
        for k in np.flatnonzero(~has_layout).tolist():
            message = typestore().deserialize_cdr(raw[k], self._kind)
            stamp = message.header.stamp
            stamps[k] = int(stamp.sec) * 10**9 + int(stamp.nanosec)
            numbers = self._numbers(message)
            values[k] = [numbers.get(name, np.nan) for name in self.names]
        return stamps, values

    def _names(self, message: Any) -> Sequence[str | None]:
        """A name for each double of a message.

        None for the doubles of a quantity that does not have one number for each joint.
        """
        if self._kind == WRENCH:
            return WRENCH_PARTS
        names: list[str | None] = []
        for quantity in QUANTITIES:
            count = len(getattr(message, quantity))
            has_all_joints = count == len(message.name)
            names += [
                f"{message.name[k]}/{quantity}" if has_all_joints else None for k in range(count)
            ]
        return names

    def _numbers(self, message: Any) -> dict[str, float]:
        """The numbers of a message by name; NaN for a wrench in another frame."""
        numbers: dict[str, float] = {}
        if self._kind == WRENCH:
            if message.header.frame_id != self._frame:
                return dict.fromkeys(WRENCH_PARTS, np.nan)
            for part in WRENCH_PARTS:
                vector, axis = part.split("/")
                numbers[part] = getattr(getattr(message.wrench, vector), axis)
            return numbers
        for quantity in QUANTITIES:
            for joint, number in zip(message.name, getattr(message, quantity), strict=False):
                numbers[f"{joint}/{quantity}"] = number
        return numbers


def _filled(message: Any, stamp: int, number: float) -> Any:
    """A copy of a JointState or WrenchStamped with another stamp and other numbers."""
    stamped = replace(message, header=header(message.header.frame_id, stamp))
    if hasattr(message, "wrench"):
        vector = type(message.wrench.force)(number, number, number)
        return replace(stamped, wrench=replace(message.wrench, force=vector, torque=vector))
    values = {name: np.full(len(getattr(message, name)), number) for name in QUANTITIES}
    return replace(stamped, **values)


def nanoseconds(t: Array) -> Stamps:
    """(N,) whole nanoseconds of times in s; inverse of `seconds` where t has no finer part."""
    whole = np.floor(t)
    return whole.astype(np.int64) * 10**9 + np.rint((t - whole) * 1e9).astype(np.int64)


def seconds(stamps: Stamps) -> Array:
    """(N,) s of times in ns, rounded to the nearest double."""
    is_exact = np.abs(stamps) < 1 << 53  # as a double, so that one rounding suffices
    whole = stamps // 10**9
    return np.where(is_exact, stamps / 1e9, whole + (stamps - whole * 10**9) / 1e9)
