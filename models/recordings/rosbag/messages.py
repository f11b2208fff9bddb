"""ROS 2 messages as they stand in a bag (CDR), many at a time, to and from arrays.

`rosbags` reads and writes each message. A topic's messages almost always differ in their stamp and
their numbers alone: where these stand is found by writing one message with two sets of numbers, and
then all messages that agree elsewhere are one array of bytes. One that does not is read by itself.
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
"""The messages that are read, by the name of their type."""
QUANTITIES: Final = ("position", "velocity", "effort")
WRENCH_PARTS: Final = ("force/x", "force/y", "force/z", "torque/x", "torque/y", "torque/z")
_ONES: Final = 0x01010101  # a whole number, and a double, none of whose bytes is zero
_ONES_DOUBLE: Final = float(np.frombuffer(b"\x01" * 8)[0])


@cache
def typestore() -> Any:
    """The types of messages that rosbags knows; those read here are the same in all of ROS 2."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_HUMBLE)


def header(frame: str, stamp: int = 0) -> Any:
    """A std_msgs/Header whose stamp has this number of seconds, and of nanoseconds."""
    types = typestore().types
    time = types["builtin_interfaces/msg/Time"](stamp, stamp)
    return types["std_msgs/msg/Header"](time, frame)


class Layout:
    """Where stamp and doubles stand in messages that are alike in all else.

    Args:
        kind: of the messages.
        make: a message of them with this number in its stamp, and this one in its doubles.
        stamped: whether they have a stamp, before all doubles.
        little: whether their byte order is.
    """

    def __init__(
        self,
        kind: str,
        make: Callable[[int, float], Any],
        stamped: bool = True,
        little: bool = True,
    ) -> None:
        both = (make(0, 0.0), make(_ONES, _ONES_DOUBLE))
        raw = [bytes(typestore().serialize_cdr(one, kind, little_endian=little)) for one in both]
        self._template, ones = (np.frombuffer(one, np.uint8) for one in raw)
        self._varies = self._template != ones
        self._stamp_bytes = 8 if stamped else 0
        order = "<" if little else ">"
        self._double = np.dtype(order + "f8")
        self._time = np.dtype([("s", order + "i4"), ("ns", order + "u4")])

    @property
    def size(self) -> int:
        """Bytes of a message."""
        return len(self._template)

    def alike(self, block: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """(N,) which of (N, size) messages differ in stamp and doubles alone."""
        same = block[:, ~self._varies] == self._template[~self._varies]
        return np.asarray(same.all(axis=1))

    def decode(self, block: NDArray[np.uint8]) -> tuple[Stamps, Array]:
        """(N,) stamps in ns and (N, k) doubles of (N, size) messages that are alike."""
        own = block[:, self._varies]
        stamp = np.ascontiguousarray(own[:, : self._stamp_bytes]).view(self._time)[:, 0]
        values = np.ascontiguousarray(own[:, self._stamp_bytes :]).view(self._double)
        stamps = stamp["s"].astype(np.int64) * 10**9 + stamp["ns"]
        return stamps, values.astype(np.float64, copy=False)

    def encode(self, stamps: Stamps, values: Array) -> NDArray[np.uint8]:
        """(N, size) messages with stamps (N,) in ns, not negative, and doubles (N, k)."""
        own = [np.ascontiguousarray(values, self._double).view(np.uint8)]
        if self._stamp_bytes:
            time = np.empty(len(stamps), self._time)
            time["s"], time["ns"] = stamps // 10**9, stamps % 10**9
            own.insert(0, time[:, None].view(np.uint8))
        messages = np.tile(self._template, (len(stamps), 1))
        messages[:, self._varies] = np.concatenate(own, axis=1)
        return messages


class Messages:
    """Reads the messages of one topic, as its first one is laid out.

    Args:
        kind: one of `KINDS`.
        first: a message of the topic; it says which joints there are, or in which frame wrenches
            are.

    Attributes:
        names: of the numbers in a message: JOINT/position, JOINT/velocity and JOINT/effort of what
            a JointState holds, force/x to torque/z of a WrenchStamped.
    """

    def __init__(self, kind: str, first: bytes) -> None:
        self._kind = kind
        message = typestore().deserialize_cdr(first, kind)
        self._frame = message.header.frame_id
        numbers = self._numbers(message, whole=True)
        self.names = tuple(name for name in numbers if name is not None)
        self._columns = [place for place, name in enumerate(numbers) if name is not None]
        little = bool(first[1] & 1)
        self._layout = Layout(kind, lambda *fill: _filled(message, *fill), little=little)

    def decode(self, raw: Sequence[bytes]) -> tuple[Stamps, Array]:
        """(N,) stamps of the headers in ns, and (N, k) numbers; NaN where a message lacks one.

        Raises:
            Exception: of any kind, a message is damaged.
        """
        stamps, values = np.empty(len(raw), np.int64), np.empty((len(raw), len(self.names)))
        size = self._layout.size
        like = np.fromiter((len(data) == size for data in raw), bool, len(raw))
        if like.any():
            joined = b"".join(raw) if like.all() else b"".join(d for d in raw if len(d) == size)
            block = np.frombuffer(joined, np.uint8).reshape(-1, size)
            alike = self._layout.alike(block)
            like[np.flatnonzero(like)[~alike]] = False
            stamps[like], doubles = self._layout.decode(block[alike])
            values[like] = doubles[:, self._columns]
        for k in np.flatnonzero(~like).tolist():
            message = typestore().deserialize_cdr(raw[k], self._kind)
            stamp = message.header.stamp
            stamps[k] = int(stamp.sec) * 10**9 + int(stamp.nanosec)
            held = dict(self._numbers(message))
            values[k] = [held.get(name, np.nan) for name in self.names]
        return stamps, values

    def _numbers(self, message: Any, whole: bool = False) -> Any:
        """The numbers of a message by name.

        Args:
            whole: the names alone, one for each double that the message has; None where a quantity
                does not have one number a joint.
        """
        if self._kind == WRENCH:
            sides = message.wrench.force, message.wrench.torque
            values = [getattr(side, axis) for side in sides for axis in "xyz"]
            if message.header.frame_id != self._frame:
                values = [np.nan] * 6
            return WRENCH_PARTS if whole else zip(WRENCH_PARTS, values, strict=True)
        found: list[Any] = []
        for quantity in QUANTITIES:
            values = getattr(message, quantity)
            names = [f"{joint}/{quantity}" for joint in message.name]
            if not whole:
                found += zip(names, values, strict=False)
            else:
                found += names if len(names) == len(values) else [None] * len(values)
        return found


def _filled(message: Any, stamp: int, number: float) -> Any:
    """A JointState or WrenchStamped as it is, but for its stamp and numbers."""
    own = {"header": header(message.header.frame_id, stamp)}
    if hasattr(message, "wrench"):
        vector = type(message.wrench.force)(number, number, number)
        return replace(message, **own, wrench=replace(message.wrench, force=vector, torque=vector))
    values = {name: np.full(len(getattr(message, name)), number) for name in QUANTITIES}
    return replace(message, **own, **values)


def nanoseconds(t: Array) -> Stamps:
    """(N,) whole nanoseconds of times in s; what `seconds` gives back where t has no finer part."""
    whole = np.floor(t)
    return whole.astype(np.int64) * 10**9 + np.rint((t - whole) * 1e9).astype(np.int64)


def seconds(stamps: Stamps) -> Array:
    """(N,) s of times in ns: the double that is nearest."""
    small = np.abs(stamps) < 1 << 53  # one rounding instead of two
    whole = stamps // 10**9
    return np.where(small, stamps / 1e9, whole + (stamps - whole * 10**9) / 1e9)
