"""Packets of Universal Robots' real-time data exchange (RTDE), version 2.

A packet is its size with this header (uint16), its type (uint8) and a payload, big-endian. A client
requests version 2 (V), sets up the data (O: frequency in Hz and names, answered by a recipe's
number and the names' types) and starts it (S); data packets (U) then bear the recipe's number and
the values. Source: Universal Robots, Real-Time Data Exchange (RTDE) Guide.
"""

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum
from itertools import pairwise

import numpy as np

from wrenchsight.models.numerics.arrays import Array

RTDE_PORT = 30004
RTDE_VERSION = 2
NOT_FOUND = "NOT_FOUND"
MOST_NAMES = 256  # of a recipe
LONGEST_NAME = 128
HEADER = struct.Struct(">HB")
_FREQUENCY = struct.Struct(">d")


class PacketType(IntEnum):
    """The types that a client of robot data meets."""

    PROTOCOL_VERSION = ord("V")
    CONTROL_VERSION = ord("v")
    TEXT = ord("M")
    DATA = ord("U")
    OUTPUTS = ord("O")
    START = ord("S")
    PAUSE = ord("P")


_KINDS = {kind.value: kind for kind in PacketType}
_CODES = {
    "BOOL": "?",
    "UINT8": "B",
    "UINT32": "I",
    "UINT64": "Q",
    "INT32": "i",
    "DOUBLE": "d",
    "VECTOR3D": "3d",
    "VECTOR6D": "6d",
    "VECTOR6INT32": "6i",
    "VECTOR6UINT32": "6I",
}
_SIZES = {"3": 3, "6": 6}


class ProtocolError(ValueError):
    """Bytes that are no packet, or a packet without a valid meaning."""


def packet(kind: PacketType, payload: bytes = b"") -> bytes:
    """The bytes of a packet."""
    return HEADER.pack(HEADER.size + len(payload), kind) + payload


class PacketReader:
    """Cuts a stream of bytes into packets.

    It holds at most one unfinished packet: 65,535 bytes, the most that a header can say.
    """

    def __init__(self) -> None:
        self._unfinished = bytearray()

    def feed(self, data: bytes) -> Iterator[tuple[PacketType, bytes]]:
        """Type and payload of each packet that is whole now.

        Raises:
            ProtocolError: a size or a type that is none: the stream cannot be followed any more.
        """
        buffer = self._unfinished
        buffer += data
        start = 0
        try:
            while len(buffer) - start >= HEADER.size:
                size, code = HEADER.unpack_from(buffer, start)
                if size < HEADER.size or code not in _KINDS:
                    raise ProtocolError(f"a packet of type {code} and {size} bytes")
                if len(buffer) - start < size:
                    break
                payload = bytes(buffer[start + HEADER.size : start + size])
                start += size
                yield _KINDS[code], payload
        finally:
            del buffer[:start]


def outputs_request(frequency: float, names: Sequence[str]) -> bytes:
    """The request of these fields at this frequency in Hz."""
    return packet(PacketType.OUTPUTS, _FREQUENCY.pack(frequency) + ",".join(names).encode("ascii"))


def read_outputs_request(payload: bytes) -> tuple[float, list[str]]:
    """Frequency in Hz and names of such a request; some clients end the names with a comma.

    Raises:
        ProtocolError: it is none.
    """
    if len(payload) < _FREQUENCY.size:
        raise ProtocolError("a request without a frequency")
    (frequency,) = _FREQUENCY.unpack_from(payload)
    return frequency, _names(payload[_FREQUENCY.size :].removesuffix(b","))


def accepted(payload: bytes) -> bool:
    """Whether an answer to V or S accepts."""
    return len(payload) == 1 and payload[0] == 1


def read_control_version(payload: bytes) -> tuple[int, int, int, int]:
    """Major, minor, bug fix and build of the controller's software.

    Raises:
        ProtocolError: it is none.
    """
    if len(payload) != 16:
        raise ProtocolError(f"a version of {len(payload)} bytes")
    major, minor, bugfix, build = struct.unpack(">IIII", payload)
    return major, minor, bugfix, build


@dataclass(frozen=True)
class Recipe:
    """What a data packet holds.

    Attributes:
        number: number of the recipe.
        names: names of its fields.
        types: types of them, or NOT_FOUND.
    """

    number: int
    names: tuple[str, ...]
    types: tuple[str, ...]

    def __post_init__(self) -> None:
        codes = {
            name: _CODES[kind]
            for name, kind in zip(self.names, self.types, strict=True)
            if kind in _CODES
        }
        object.__setattr__(self, "_layout", struct.Struct(">B" + "".join(codes.values())))
        sizes = [_SIZES.get(code[0], 1) for code in codes.values()]
        ends = np.cumsum([1, *sizes]).tolist()
        places = dict(zip(codes, pairwise(ends), strict=True))
        object.__setattr__(self, "_places", places)

    @classmethod
    def read(cls, payload: bytes, names: Sequence[str]) -> "Recipe":
        """The answer to an O request for `names`.

        Raises:
            ProtocolError: it is none, names an unknown type, or not as many as were requested.
        """
        if not payload:
            raise ProtocolError("an empty recipe")
        types = _names(payload[1:])
        if len(types) != len(names):
            raise ProtocolError(f"a recipe of {len(types)} types for {len(names)} fields")
        for name, kind in zip(names, types, strict=True):
            if kind not in {*_CODES, NOT_FOUND, "IN_USE"}:
                raise ProtocolError(f"a recipe with {name} as {kind[:20]!a}, which is no type")
        return cls(payload[0], tuple(names), tuple(types))

    @property
    def missing(self) -> tuple[str, ...]:
        """The names that the controller does not have."""
        return tuple(
            n for n, kind in zip(self.names, self.types, strict=True) if kind not in _CODES
        )

    def answer(self) -> bytes:
        """The packet that states it."""
        return packet(PacketType.OUTPUTS, bytes([self.number]) + ",".join(self.types).encode())

    def encode(self, values: Sequence[float]) -> bytes:
        """A data packet of its fields' numbers, one after another."""
        return packet(PacketType.DATA, self._layout.pack(self.number, *values))  # type: ignore[attr-defined]

    def decode(self, payload: bytes) -> Array | None:
        """All numbers of a data packet, the recipe's own number first; None for another recipe's.

        Raises:
            ProtocolError: its length is not that of this recipe.
        """
        layout: struct.Struct = self._layout  # type: ignore[attr-defined]
        if not payload or payload[0] != self.number:
            return None
        if len(payload) != layout.size:
            raise ProtocolError(f"a data packet of {len(payload)} bytes, expected {layout.size}")
        return np.array(layout.unpack(payload), float)

    def part(self, numbers: Array, name: str) -> Array:
        """The numbers of one field out of what `decode` gives."""
        begin, end = self._places[name]  # type: ignore[attr-defined]
        return numbers[begin:end]


FIELD_TYPES = {  # of the fields that a log can be played as
    "timestamp": "DOUBLE",
    "actual_q": "VECTOR6D",
    "actual_qd": "VECTOR6D",
    "actual_current": "VECTOR6D",
    "actual_current_as_torque": "VECTOR6D",
    "target_current": "VECTOR6D",
    "target_moment": "VECTOR6D",
    "joint_temperatures": "VECTOR6D",
    "actual_TCP_force": "VECTOR6D",
    "payload": "DOUBLE",
    "robot_mode": "INT32",
    "safety_mode": "INT32",
}
ROBOT_RUNS = 7
ROBOT_MODES = {
    -1: "no controller",
    0: "disconnected",
    1: "confirming safety",
    2: "booting",
    3: "power off",
    4: "power on",
    5: "idle: its brakes are on",
    6: "backdrive",
    ROBOT_RUNS: "running",
    8: "updating firmware",
}
SAFE_TO_READ = (1, 2)  # normal and reduced
SAFETY_MODES = {
    1: "normal",
    2: "reduced",
    3: "protective stop",
    4: "recovery",
    5: "safeguard stop",
    6: "emergency stop of the system",
    7: "emergency stop of the robot",
    8: "violation",
    9: "fault",
    10: "validating joints",
    11: "undefined safety mode",
}


def _names(data: bytes) -> list[str]:
    """Comma-joined names, bounded, of printable ASCII.

    Raises:
        ProtocolError: they are not.
    """
    if len(data) > MOST_NAMES * LONGEST_NAME:
        raise ProtocolError(f"names of {len(data)} bytes")
    try:
        names = data.decode("ascii").split(",")
    except UnicodeDecodeError:
        raise ProtocolError("names that are no ASCII") from None
    invalid = [n for n in names if not n.isprintable() or len(n) > LONGEST_NAME]
    if invalid or len(names) > MOST_NAMES:
        raise ProtocolError(f"{len(names)} names, {len(invalid)} of them not printable or too long")
    return names
