"""A Universal Robots controller as a source, by RTDE: `rtde://HOST[:PORT]`.

Options: `frequency` in Hz (500; an older controller gives 125 at most), `effort` (current, or
torque: the controller's own `actual_current_as_torque`). Nothing is written to the robot: no input
is ever set up.

Standard library alone. Each packet is a sample: the official client keeps the newest one only.
"""

import select
import socket
import time
from collections.abc import Iterator

import numpy as np

from wrenchsight.models.files.input_error import InputError, printable
from wrenchsight.models.live.rtde import (
    FIELD_TYPES,
    ROBOT_MODES,
    ROBOT_RUNS,
    RTDE_PORT,
    RTDE_VERSION,
    SAFE_TO_READ,
    SAFETY_MODES,
    PacketReader,
    PacketType,
    ProtocolError,
    Recipe,
    accepted,
    outputs_request,
    packet,
    read_control_version,
)
from wrenchsight.models.live.samples import EventKind, Sample, StreamEvent
from wrenchsight.models.live.source import MOST_ITEMS, RETRY_TIME, SourceAddress
from wrenchsight.models.robot.robot import Robot

ANSWER_TIME = 1.0  # s, longest wait for a connection or an answer
QUIET_TIME = 1.0  # s without a packet after which the connection counts as lost
_CHUNK_BYTES = 1 << 16  # bytes that are taken at once
_NUM_JOINTS = 6
_FIRST_OF_500_HZ = 5  # major version of the controller's software
_NEEDED = ("timestamp", "actual_q", "actual_qd")
_TORQUE, _CURRENT = "actual_current_as_torque", "actual_current"
_MODES = ("robot_mode", "safety_mode")
_MORE = (
    "target_current",
    "target_moment",
    "joint_temperatures",
    "actual_TCP_force",
    "payload",
)


class _WrongTypeError(ProtocolError):
    """A field has another type than RTDE's guide states."""


def _other_types(recipe: Recipe) -> dict[str, str]:
    """A few words on each field whose type is not that of RTDE's guide, by its name."""
    pairs = zip(recipe.names, recipe.types, strict=True)
    return {
        name: f"{name} as {kind}, expected {FIELD_TYPES[name]}"
        for name, kind in pairs
        if name not in recipe.missing and kind != FIELD_TYPES[name]
    }


class RtdeSource:
    """Reads a controller's stream, connects again where it is lost, and reports what happens.

    Args:
        host, port: of the controller.
        frequency: Hz that is requested.
        effort: "current" or "torque".
    """

    rate = 1.0

    def __init__(self, host: str, port: int, frequency: float, effort: str) -> None:
        self._address = host, port
        self._place = printable(f"{host}:{port}")
        self._frequency = frequency
        self._effort = _CURRENT if effort == "current" else _TORQUE
        self._socket: socket.socket | None = None
        self._packets = PacketReader()
        self._recipe: Recipe | None = None
        self._next_try = 0.0
        self._refusal = ""
        self._was_connected = False
        self._last_packet = 0.0
        self._num_unexpected = 0
        self._closed = False
        self.step: float | None = 1.0 / frequency

    @classmethod
    def open(cls, address: SourceAddress, robot: Robot) -> "RtdeSource":
        """As `SourceOpener`."""
        address.require_known("frequency", "effort")
        if robot.num_joints != _NUM_JOINTS:
            problem = f"has {_NUM_JOINTS} joints, {robot.name} has {robot.num_joints}"
            raise InputError("rtde://", "", f"a robot of this kind {problem}", "name that robot")
        frequency = address.number("frequency", 500.0, 1.0, 500.0)
        return cls(
            *address.host(RTDE_PORT), frequency, address.choice("effort", ("current", "torque"))
        )

    def read(self, timeout: float) -> list[Sample | StreamEvent]:
        """As the protocol."""
        if self._closed:
            return []
        if self._socket is None:
            return self._connect(timeout)
        try:
            ready, _, _ = select.select([self._socket], [], [], timeout)
            now = time.monotonic()
            if not ready:
                if now - self._last_packet < QUIET_TIME:
                    return []
                return [self._lost(EventKind.LOST, f"has sent nothing for {QUIET_TIME:g} s")]
            data = self._socket.recv(_CHUNK_BYTES)
        except OSError as error:
            return [self._lost(EventKind.LOST, error.strerror or str(error))]
        if not data:
            return [self._lost(EventKind.LOST, "closed the connection")]
        items: list[Sample | StreamEvent] = []
        try:
            items.extend(self._items(data, now))
        except ProtocolError as error:
            items.append(self._lost(EventKind.GARBAGE, f"sent {error}"))
        return items[:MOST_ITEMS]

    def close(self) -> None:
        """As the protocol."""
        self._closed = True
        self._disconnect()

    def _items(self, data: bytes, now: float) -> Iterator[Sample | StreamEvent]:
        recipe = self._recipe
        assert recipe is not None
        for kind, payload in self._packets.feed(data):
            self._last_packet = now
            if kind is PacketType.TEXT:
                continue
            numbers = recipe.decode(payload) if kind is PacketType.DATA else None
            if numbers is None:
                self._num_unexpected += 1
                text = f"{self._place} sent a packet that was not requested; it is left out"
                yield StreamEvent(EventKind.RECIPE, text, now, self._num_unexpected)
                continue
            yield self._sample(recipe, numbers, now)

    def _sample(self, recipe: Recipe, numbers: "np.ndarray", now: float) -> Sample:
        running, state = True, ""
        if "robot_mode" in recipe.names:
            mode = int(recipe.part(numbers, "robot_mode")[0])
            running, state = mode == ROBOT_RUNS, ROBOT_MODES.get(mode, f"robot mode {mode}")
        if running and "safety_mode" in recipe.names:
            mode = int(recipe.part(numbers, "safety_mode")[0])
            running = mode in SAFE_TO_READ
            state = state if running else SAFETY_MODES.get(mode, f"safety mode {mode}")
        return Sample(
            t=float(recipe.part(numbers, "timestamp")[0]),
            received=now,
            q=recipe.part(numbers, "actual_q"),
            v=recipe.part(numbers, "actual_qd"),
            effort=recipe.part(numbers, self._effort),
            is_torque=self._effort == _TORQUE,
            running=running,
            state=state,
            more={
                name: recipe.part(numbers, name)
                for name in (*_MORE, _TORQUE)
                if name in recipe.names
            },
        )

    # Connecting ---------------------------------------------------------------------------------

    def _connect(self, timeout: float) -> list[Sample | StreamEvent]:
        now = time.monotonic()
        if now < self._next_try:
            time.sleep(min(timeout, self._next_try - now))
            return []
        self._next_try = now + RETRY_TIME
        try:
            return [self._started()]
        except OSError as error:
            reason = error.strerror or str(error) or "no answer"
        except _WrongTypeError as error:
            reason = str(error)
        except ProtocolError as error:
            reason = f"is no controller that speaks RTDE: it sent {error}"
        self._disconnect()
        self._next_try = time.monotonic() + RETRY_TIME
        if reason == self._refusal:
            return []  # reported already
        self._refusal = reason
        text = f"{self._place}: {reason}; it is tried again"
        return [StreamEvent(EventKind.REFUSED, text, time.monotonic())]

    def _started(self) -> StreamEvent:
        """Connects, agrees on what is sent, and starts it; returns the event that says so.

        The protocol: version 2, the software's version (on which the frequency depends), a recipe
        of the fields that are sent, and the start. `_ask` sends a packet and returns the answer of
        that kind. Where a step raises, the caller closes the socket, keeps the reason as `_refusal`
        and tries again.

        Raises:
            OSError: no connection, or no answer in time.
            ProtocolError: the answer is none of a controller that speaks RTDE.
            _WrongTypeError: a signal that is needed has another type than expected.
        """
        self._packets = PacketReader()
        self._socket = socket.create_connection(self._address, ANSWER_TIME)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        version = packet(PacketType.PROTOCOL_VERSION, RTDE_VERSION.to_bytes(2, "big"))
        if not accepted(self._ask(version, PacketType.PROTOCOL_VERSION)):
            raise ProtocolError("a refusal of version 2")
        answer = self._ask(packet(PacketType.CONTROL_VERSION), PacketType.CONTROL_VERSION)
        major, minor, *_ = read_control_version(answer)
        frequency = min(self._frequency, 500.0 if major >= _FIRST_OF_500_HZ else 125.0)
        self.step = 1.0 / frequency
        recipe, other_types = self._agreed_recipe(frequency)
        if not accepted(self._ask(packet(PacketType.START), PacketType.START)):
            raise ProtocolError("a refusal to start")
        self._recipe, self._refusal = recipe, ""  # the last reason counts no longer
        self._last_packet = time.monotonic()
        again = " again" if self._was_connected else ""
        self._was_connected = True
        text = f"{self._place}: connected{again}, {frequency:g} Hz, software {major}.{minor}"
        if other_types:
            text += f"; left out: {', '.join(other_types.values())}"
        return StreamEvent(EventKind.CONNECTED, text, self._last_packet)

    def _agreed_recipe(self, frequency: float) -> tuple[Recipe, dict[str, str]]:
        """Asks for all signals, and once more without those that this controller has not.

        Returns:
            The recipe of what is sent; what is left out for its type, by name, in words.

        Raises:
            ProtocolError, _WrongTypeError: as `_started`.
        """
        needed = {*_NEEDED, self._effort}
        names = [*_NEEDED, self._effort, *_MODES, *_MORE]
        if self._effort != _TORQUE:  # sent besides
            names.append(_TORQUE)
        recipe = self._set_up(frequency, names)  # as the controller answers it
        if missing := needed & {*recipe.missing}:
            raise ProtocolError(f"no {', '.join(sorted(missing))}")
        other_types = _other_types(recipe)
        for name in names:
            # Modes may be missing, but not be something else: they say whether readings count.
            if name in other_types and name in {*needed, *_MODES}:
                raise _WrongTypeError(f"states {other_types[name]}; check its software's version")
        left_out = {*recipe.missing, *other_types}
        if left_out:
            recipe = self._set_up(frequency, [name for name in names if name not in left_out])
            if recipe.missing or _other_types(recipe):
                raise ProtocolError("another recipe for fields that it had stated")
        return recipe, other_types

    def _set_up(self, frequency: float, names: list[str]) -> Recipe:
        return Recipe.read(self._ask(outputs_request(frequency, names), PacketType.OUTPUTS), names)

    def _ask(self, request: bytes, kind: PacketType) -> bytes:
        """Sends a request and returns the payload of its answer.

        Raises:
            OSError: no answer came in time.
            ProtocolError: the bytes are no packet.
        """
        assert self._socket is not None
        self._socket.settimeout(ANSWER_TIME)
        self._socket.sendall(request)
        deadline = time.monotonic() + ANSWER_TIME
        while time.monotonic() < deadline:
            self._socket.settimeout(max(deadline - time.monotonic(), 1e-3))
            data = self._socket.recv(_CHUNK_BYTES)
            if not data:
                raise ConnectionError("closed the connection")
            for code, payload in self._packets.feed(data):
                if code == kind:
                    return payload
        raise TimeoutError("no answer")

    def _lost(self, kind: EventKind, reason: str) -> StreamEvent:
        self._disconnect()
        self._next_try = time.monotonic() + 0.1 * RETRY_TIME
        return StreamEvent(kind, f"{self._place} {reason}; connecting again", time.monotonic())

    def _disconnect(self) -> None:
        if self._socket is not None:
            self._socket.close()
        self._socket, self._recipe = None, None
