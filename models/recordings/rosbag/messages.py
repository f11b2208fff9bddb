"""ROS 2 messages as they stand in a bag (CDR), many at a time, to and from arrays.

A topic's messages almost always have one length and differ in their numbers only: those are read
at once, as one array of bytes. A message that differs otherwise is read by itself.

CDR: four bytes that say the byte order, then the fields, each aligned to its own size counted from
behind those four; a string and a sequence begin with their length.
"""

import struct
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.arrays import Array

Stamps = NDArray[np.int64]

JOINT_STATE = "sensor_msgs/msg/JointState"
WRENCH = "geometry_msgs/msg/WrenchStamped"
QUANTITIES = ("position", "velocity", "effort")
WRENCH_PARTS = ("force/x", "force/y", "force/z", "torque/x", "torque/y", "torque/z")
_HEAD = 4  # bytes that say the byte order
_STAMP = slice(_HEAD, _HEAD + 8)  # seconds and nanoseconds, both of 4 bytes


class Messages(Protocol):
    """Reads the messages of one topic, as its first one is laid out."""

    names: tuple[str, ...]
    """Of the numbers in a message, without the topic."""

    def decode(self, raw: Sequence[bytes]) -> tuple[Stamps, Array]:
        """(N,) stamps of the headers in ns, and (N, k) numbers; NaN where a message lacks one.

        Raises:
            ValueError: a message is damaged.
        """


class _Cursor:
    """Reads one message field by field."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        if len(data) < _HEAD + 8:
            raise ValueError("a message is too short")
        self.order = "<" if data[1] & 1 else ">"
        self.at = _HEAD

    def number(self) -> int:
        self._align(4)
        (value,) = struct.unpack_from(self.order + "I", self.data, self._step(4))
        return int(value)

    def stamp(self) -> int:
        seconds, nanoseconds = struct.unpack_from(self.order + "iI", self.data, self._step(8))
        return int(seconds) * 10**9 + int(nanoseconds)

    def text(self) -> str:
        size = self.number()
        begin = self._step(size)
        return self.data[begin : begin + max(size - 1, 0)].decode("utf-8", "replace")

    def doubles(self, count: int) -> tuple[int, Array]:
        """Where they begin, and they."""
        if count:
            self._align(8)
        begin = self._step(8 * count)
        values = np.frombuffer(self.data, self.order + "f8", count, begin)
        return begin, values.astype(np.float64)

    def _align(self, size: int) -> None:
        self.at += -(self.at - _HEAD) % size

    def _step(self, size: int) -> int:
        begin, self.at = self.at, self.at + size
        if self.at > len(self.data):
            raise ValueError("a message is cut off")
        return begin


class _OneLayout:
    """What the messages of both kinds share: blocks of doubles at fixed places."""

    names: tuple[str, ...] = ()
    _places: tuple[tuple[int, int], ...] = ()  # begin and count of each block of doubles
    _first: bytes = b""

    @property
    def places(self) -> tuple[tuple[int, int], ...]:
        """Where each block of doubles begins in a message, and how many it has."""
        return self._places

    def decode(self, raw: Sequence[bytes]) -> tuple[Stamps, Array]:
        """As the protocol."""
        stamps, values = np.empty(len(raw), np.int64), np.empty((len(raw), len(self.names)))
        size = len(self._first)
        like = np.fromiter((len(data) == size for data in raw), bool, len(raw))
        if like.any():
            joined = b"".join(raw) if like.all() else b"".join(d for d in raw if len(d) == size)
            block = np.frombuffer(joined, np.uint8).reshape(-1, size)
            fixed = np.ones(size, bool)
            fixed[_STAMP] = False
            for begin, count in self._places:
                fixed[begin : begin + 8 * count] = False
            own = np.frombuffer(self._first, np.uint8)
            same = (block[:, fixed] == own[fixed]).all(axis=1)
            stamps[like], values[like] = self._decode_alike(block)
            like[np.flatnonzero(like)[~same]] = False
        for k in np.flatnonzero(~like).tolist():
            stamps[k], values[k] = self._decode_one(raw[k])
        return stamps, values

    def _decode_alike(self, block: NDArray[np.uint8]) -> tuple[Stamps, Array]:
        order = "<" if self._first[1] & 1 else ">"
        kind = np.dtype([("s", order + "i4"), ("ns", order + "u4")])
        stamp = np.ascontiguousarray(block[:, _STAMP]).view(kind)[:, 0]
        parts = [
            np.ascontiguousarray(block[:, begin : begin + 8 * count]).view(order + "f8")
            for begin, count in self._places
        ]
        values = np.concatenate(parts, axis=1).astype(np.float64, copy=False)
        return stamp["s"].astype(np.int64) * 10**9 + stamp["ns"], values

    def _decode_one(self, data: bytes) -> tuple[int, Array]:
        raise NotImplementedError


class JointStateMessages(_OneLayout):
    """sensor_msgs/JointState: JOINT/position, JOINT/velocity and JOINT/effort of what it holds.

    Args:
        first: a message of the topic; it says which joints there are.

    Raises:
        ValueError: it is damaged.
    """

    def __init__(self, first: bytes) -> None:
        _, joints, found = self._parsed(first)
        names: list[str] = []
        places: list[tuple[int, int]] = []
        for quantity, (begin, values) in found.items():
            if len(values) == len(joints) > 0:
                names += [f"{joint}/{quantity}" for joint in joints]
                places.append((begin, len(joints)))
        self.names, self._places, self._first = tuple(names), tuple(places), first

    @staticmethod
    def _parsed(data: bytes) -> tuple[int, list[str], dict[str, tuple[int, Array]]]:
        cursor = _Cursor(data)
        stamp = cursor.stamp()
        cursor.text()  # the frame, which means nothing for joints
        joints = [cursor.text() for _ in range(cursor.number())]
        return stamp, joints, {name: cursor.doubles(cursor.number()) for name in QUANTITIES}

    def _decode_one(self, data: bytes) -> tuple[int, Array]:
        stamp, joints, found = self._parsed(data)
        held = {
            f"{joint}/{quantity}": value
            for quantity, (_, values) in found.items()
            for joint, value in zip(joints, values, strict=False)
        }
        return stamp, np.array([held.get(name, np.nan) for name in self.names])


class WrenchMessages(_OneLayout):
    """geometry_msgs/WrenchStamped: force/x to torque/z, in the axes of `frame`.

    Args:
        first: a message of the topic.

    Raises:
        ValueError: it is damaged.
    """

    def __init__(self, first: bytes) -> None:
        _, self.frame, begin, _ = self._parsed(first)
        self.names, self._places, self._first = WRENCH_PARTS, ((begin, 6),), first

    @staticmethod
    def _parsed(data: bytes) -> tuple[int, str, int, Array]:
        cursor = _Cursor(data)
        stamp, frame = cursor.stamp(), cursor.text()
        return stamp, frame, *cursor.doubles(6)

    def _decode_one(self, data: bytes) -> tuple[int, Array]:
        stamp, frame, _, values = self._parsed(data)
        return stamp, values if frame == self.frame else np.full(6, np.nan)


KINDS: dict[str, type[JointStateMessages | WrenchMessages]] = {
    JOINT_STATE: JointStateMessages,
    WRENCH: WrenchMessages,
}
"""The messages that are read, by the name of their type."""


def nanoseconds(t: Array) -> Stamps:
    """(N,) whole nanoseconds of times in s; what `seconds` gives back where t has no finer part."""
    whole = np.floor(t)
    return whole.astype(np.int64) * 10**9 + np.rint((t - whole) * 1e9).astype(np.int64)


def seconds(stamps: Stamps) -> Array:
    """(N,) s of times in ns: the double that is nearest."""
    small = np.abs(stamps) < 1 << 53  # one rounding instead of two
    whole = stamps // 10**9
    return np.where(small, stamps / 1e9, whole + (stamps - whole * 10**9) / 1e9)


def encoded(
    template: bytes,
    stamps: Stamps,
    blocks: Sequence[tuple[int, Array]],
    stamp_at: int | None = _HEAD,
) -> NDArray[np.uint8]:
    """(N, L) messages like `template`, little-endian, with other stamps and other doubles.

    Args:
        stamps: (N,) ns, not negative.
        blocks: where each block of doubles begins, and its (N, k) numbers.
        stamp_at: where the stamp begins; None: there is none.
    """
    messages = np.tile(np.frombuffer(template, np.uint8), (len(stamps), 1))
    if stamp_at is not None:
        parts = np.stack([stamps // 10**9, stamps % 10**9], axis=1).astype("<u4")
        messages[:, stamp_at : stamp_at + 8] = parts.view(np.uint8)
    for begin, values in blocks:
        raw: NDArray[Any] = np.ascontiguousarray(values, "<f8").view(np.uint8)
        messages[:, begin : begin + raw.shape[1]] = raw
    return messages
