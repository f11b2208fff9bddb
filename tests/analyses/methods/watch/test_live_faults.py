"""Live faults: each stream goes on, or ends in a sentence; none holds its reader up for long.

Each kind of source gets a stream of an arm that nothing touches, with one fault in it: a peer that
answers wrongly, messages that are damaged, lost, late or twice, numbers that are none, clocks that
jump, files that end within a row. What the stream is read with is what `watch` reads it with. No
fault may end in an exception, nor hold the reader up for LONGEST_TURN; no valid reading may be
beyond MOST_SD of its stated deviation; and where the fault is over, readings are valid again.
"""

import socket
import struct
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from drake import lcmt_iiwa_status, lcmt_panda_status
from pydrake.lcm import DrakeLcm
from sample_models import sample_torque_error

from wrenchsight.analyses.methods.watch.franka_source import FrankaSource
from wrenchsight.analyses.methods.watch.lcm_links import LcmSource
from wrenchsight.analyses.methods.watch.reader_process import read_stream
from wrenchsight.analyses.methods.watch.rtde_controller import RtdeController
from wrenchsight.analyses.methods.watch.sources import open_source
from wrenchsight.analyses.methods.watch.start_checks import StartChecks
from wrenchsight.analyses.methods.watch.watch_config import WatchConfig
from wrenchsight.models.estimation.estimator import WrenchEstimatorConfig
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.live.live_estimator import LiveConfig, LiveEstimator
from wrenchsight.models.live.reading import Reading
from wrenchsight.models.live.rtde import (
    FIELD_TYPES,
    HEADER,
    NOT_FOUND,
    PacketReader,
    PacketType,
    Recipe,
    packet,
    read_outputs_request,
)
from wrenchsight.models.live.samples import EventKind, Sample, StreamEvent
from wrenchsight.models.live.source import Source
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_writer import write_recording
from wrenchsight.models.robot.robot import Robot

pytestmark = [pytest.mark.usefixtures("one_thread"), pytest.mark.long]

LONGEST_TURN = 10.0  # s, from one look at the source to the next one
LONGEST_STREAM = 60.0  # s, on a busy computer; an idle one takes 1 to 3
MOST_SD = 3.0
H = 0.002
SAMPLES = 980  # just below the 2 s after which the hypotheses on a log's faults are tried
FAULT_AT = 300  # sample at which a stream's fault begins
FAULT_SAMPLES = 40
RECOVERED = 200  # last samples, among whose readings valid ones must be
# What is late is judged elsewhere: on a busy computer all comes late, and is rightly not valid.
OBSERVER = MomentumObserverConfig(time_step=H)
LIVE = LiveConfig(WrenchEstimatorConfig(OBSERVER), late=10.0)


@pytest.fixture(scope="module")
def arms(ur10e):
    """By the number of joints: robot, its own model, and a log of a motion."""
    return {robot.num_joints: arm_of(robot) for robot in (ur10e, Robot.load("panda"))}


@dataclass
class Arm:
    robot: Robot
    model: IdentifiedModel
    log: Recording


def arm_of(robot: Robot) -> Arm:
    n = robot.num_joints
    friction = SemiParametricFriction(CoulombViscous(np.zeros(n), np.full(n, 5.0), np.zeros(n)))
    model = replace(
        IdentifiedModel.nominal(robot), friction=friction, torque_error=sample_torque_error(n)
    )
    t = H * np.arange(SAMPLES)
    angle = t[:, None] + np.arange(n)
    q, v, vdot = robot.home + 0.2 * np.sin(angle), 0.2 * np.cos(angle), -0.2 * np.sin(angle)
    tau = model.chain(robot).inverse_dynamics(q, v, vdot) + model.friction.feedforward.torque(v)
    log = Recording(t=20.0 + t, q=q, v=v, current=robot.motor_current(tau), source="", tau_J=tau)
    return Arm(robot, model, log)


# Reading ------------------------------------------------------------------------------------------


@dataclass
class Watched:
    """What came of a stream."""

    readings: list[Reading] = field(default_factory=list)
    events: list[StreamEvent] = field(default_factory=list)
    last_came: float = 0.0
    last_turn: float = field(default_factory=time.monotonic)
    longest_turn: float = 0.0
    error: str = ""

    def note_turn(self) -> None:
        now = time.monotonic()
        self.longest_turn, self.last_turn = max(self.longest_turn, now - self.last_turn), now

    def kinds(self) -> set[EventKind]:
        return {event.kind for event in self.events}


def watch(
    arm: Arm, source: Source, is_over: Callable[[Watched], object], checks: bool = True
) -> Watched:
    """Reads a source as `watch` does until `is_over`, in a thread that a hang cannot hold up."""
    watched, over = Watched(), threading.Event()
    live = LiveEstimator(arm.robot, arm.model, LIVE, source.step, source.rate)
    start_checks = StartChecks(arm.robot, arm.model, WatchConfig()) if checks else None

    def emit(item: Reading | StreamEvent) -> None:
        watched.last_came = time.monotonic()
        assert isinstance(item, Reading) or len(item.row)  # goes to another process
        (watched.readings if isinstance(item, Reading) else watched.events).append(item)

    def go_on() -> bool:
        watched.note_turn()
        return not is_over(watched) and not over.is_set()

    def work() -> None:
        try:
            read_stream(source, live, emit, start_checks, go_on)
            source.close()
        except BaseException:  # a defect: the test says so
            watched.error = traceback.format_exc()

    began = time.monotonic()
    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    thread.join(LONGEST_STREAM)
    over.set()
    thread.join(LONGEST_TURN)
    assert not thread.is_alive(), f"hangs; events so far: {watched.events}"
    assert not watched.error, watched.error
    watched.note_turn()
    assert watched.longest_turn < LONGEST_TURN
    print(f"longest turn {watched.longest_turn:.2f} s, {time.monotonic() - began:.1f} s in all")
    for event in watched.events:
        assert event.text.isprintable()
    for reading in watched.readings:
        share = np.abs(reading.wrench / reading.sd).max()
        assert not reading.valid or share <= MOST_SD, (reading.t, share)
    return watched


def is_valid_again(watched: Watched) -> bool:
    return any(reading.valid for reading in watched.readings[-RECOVERED:])


# RTDE ---------------------------------------------------------------------------------------------

Script = Callable[[socket.socket], None]
YES = b"\x01"
VERSION = struct.pack(">4I", 5, 11, 0, 0)


class FaultyController(RtdeController):
    """A controller whose first connection is served by a script, and whose later ones rightly.

    `types` are those that it states for some fields in that many further set-ups.
    """

    script: Script | None = None
    types: Mapping[str, str] = MappingProxyType({})
    set_ups: int = 0

    def __init__(self, log: Recording, script: Script | None = None, **options: Any) -> None:
        self.script = script
        super().__init__([log], port=0, rate=0.0, **options)

    def _serve(self, connection: socket.socket) -> None:
        script, self.script = self.script, None
        if script is None:
            super()._serve(connection)
            return
        with suppress(OSError):
            script(connection)
        with suppress(OSError):
            connection.close()

    def _answer(self, client: Any, kind: PacketType, payload: bytes) -> None:
        if kind is PacketType.OUTPUTS and self.set_ups > 0:
            self.set_ups -= 1
            frequency, names = read_outputs_request(payload)
            types = [FIELD_TYPES[n] if n in self._names else NOT_FOUND for n in names]
            types = [self.types.get(n, kind) for n, kind in zip(names, types, strict=True)]
            client.recipe, client.period = Recipe(1, tuple(names), tuple(types)), 1.0 / frequency
            client.send(client.recipe.answer())
            return
        super()._answer(client, kind, payload)


def requests(connection: socket.socket) -> Iterator[tuple[PacketType, bytes]]:
    connection.settimeout(3.0)
    packets = PacketReader()
    while data := connection.recv(4096):
        yield from packets.feed(data)


def answering(**answers: bytes) -> Script:
    """A peer that shakes hands rightly but for the answers to some requests, as bytes; it then
    waits until the other side leaves.
    """

    def script(connection: socket.socket) -> None:
        for kind, payload in requests(connection):
            right = {
                PacketType.PROTOCOL_VERSION: packet(kind, YES),
                PacketType.CONTROL_VERSION: packet(kind, VERSION),
                PacketType.START: packet(kind, YES),
            }
            if kind is PacketType.OUTPUTS:
                names = read_outputs_request(payload)[1]
                types = ",".join(FIELD_TYPES[name] for name in names)
                right[kind] = packet(kind, YES + types.encode())
            connection.sendall(answers.get(kind.name.lower(), right[kind]))

    return script


def says(data: bytes, wait: float = 0.0) -> Script:
    """A peer that says the same to whoever comes, and leaves."""

    def script(connection: socket.socket) -> None:
        connection.sendall(data)
        time.sleep(wait)

    return script


def resets(connection: socket.socket) -> None:
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))


def trickles(connection: socket.socket) -> None:
    for byte in packet(PacketType.PROTOCOL_VERSION, YES) * 100:
        connection.sendall(bytes([byte]))
        time.sleep(0.3)


def floods(data: bytes) -> Script:
    def script(connection: socket.socket) -> None:
        connection.settimeout(3.0)
        end = time.monotonic() + 3.0
        while time.monotonic() < end:
            connection.sendall(data * 200)

    return script


def outputs(types: bytes, number: bytes = YES) -> bytes:
    return packet(PacketType.OUTPUTS, number + types)


HANDSHAKES: dict[str, Script] = {
    "silence": says(b"", 3.0),
    "closes at once": says(b""),
    "resets": resets,
    "a web server": says(b"HTTP/1.1 400 Bad Request\r\n\r\n", 0.2),
    "an answer byte by byte": trickles,
    "an endless stream of texts": floods(packet(PacketType.TEXT, b"x" * 50)),
    "an endless stream of zeros": floods(b"\0" * 100),
    "data before all": says(packet(PacketType.DATA, b"\x01" + bytes(100)) * 50, 2.0),
    "version refused": answering(protocol_version=packet(PacketType.PROTOCOL_VERSION, b"\0")),
    "version of two bytes": answering(
        protocol_version=packet(PacketType.PROTOCOL_VERSION, b"\1\1")
    ),
    "version answered twice": answering(
        protocol_version=2 * packet(PacketType.PROTOCOL_VERSION, YES)
    ),
    "half an answer": answering(protocol_version=b"\x00\x04"),
    "software of 15 bytes": answering(
        control_version=packet(PacketType.CONTROL_VERSION, VERSION[1:])
    ),
    "software as text": answering(control_version=packet(PacketType.CONTROL_VERSION, b"5.11")),
    "software not answered": answering(control_version=b""),
    "recipe empty": answering(outputs=packet(PacketType.OUTPUTS)),
    "recipe too short": answering(outputs=outputs(b"DOUBLE,VECTOR6D")),
    "recipe of unknown types": answering(outputs=outputs(b",".join([b"FLOAT"] * 12))),
    "recipe of no letters": answering(outputs=outputs(b"\xff\xfe\x00\x01")),
    "recipe of 60 kB": answering(outputs=outputs(b"DOUBLE," * 8000)),
    "recipe without a field": answering(outputs=outputs(b",".join([b"NOT_FOUND"] * 12))),
    "start refused": answering(start=packet(PacketType.START, b"\0")),
    "start not answered": answering(start=b""),
    "connection that then is silent": answering(),
}


@pytest.mark.parametrize("name", HANDSHAKES)
def test_a_wrong_handshake_is_survived(arms, name):
    arm = arms[6]
    with FaultyController(arm.log, HANDSHAKES[name]) as controller:
        source = open_source(f"rtde://127.0.0.1:{controller.port}", arm.robot)
        watched = watch(arm, source, is_valid_again, checks=False)
    assert is_valid_again(watched), watched.events
    assert EventKind.CONNECTED in watched.kinds()


TYPES: dict[str, Mapping[str, str]] = {
    "current as one number": {"actual_current": "DOUBLE"},
    "current missing": {"actual_current": NOT_FOUND},
    "positions as whole numbers": {"actual_q": "VECTOR6INT32"},
    "time as a whole number": {"timestamp": "UINT64"},
    "mode as a double": {"robot_mode": "DOUBLE"},
    "targets of three numbers": {"target_current": "VECTOR3D", "target_moment": "VECTOR3D"},
}


@pytest.mark.parametrize("name", TYPES)
def test_other_types_at_a_reconnect_are_survived(arms, name):
    arm = arms[6]

    def tamper(count: int, data: bytes) -> tuple[bytes, ...]:
        if count == FAULT_AT:
            controller.types, controller.set_ups = TYPES[name], 2
            raise ConnectionAbortedError
        return (data,)

    long_log = replace(arm.log, extra={"current_desired": arm.log.current})
    with FaultyController(long_log, tamper=tamper) as controller:
        source = open_source(f"rtde://127.0.0.1:{controller.port}", arm.robot)
        controller._rate = 1.0  # else the log is over before the other side is back
        watched = watch(arm, source, is_read(controller), checks=False)
    assert EventKind.LOST in watched.kinds()
    assert is_valid_again(watched), watched.events


def is_read(controller: RtdeController) -> Callable[[Watched], bool]:
    def is_over(watched: Watched) -> bool:
        quiet = time.monotonic() - watched.last_came > 0.3
        return bool(controller.ended.is_set() and watched.last_came and quiet)

    return is_over


class OneFault:
    """Tampers with the FAULT_SAMPLES data packets from FAULT_AT on."""

    def __init__(self, fault: Callable[[int, bytes], tuple[bytes, ...]]) -> None:
        self._fault = fault

    def __call__(self, count: int, data: bytes) -> tuple[bytes, ...]:
        number = count - FAULT_AT
        return self._fault(number, data) if 0 <= number < FAULT_SAMPLES else (data,)


def once(*parts: Callable[[bytes], bytes]) -> Callable[[int, bytes], tuple[bytes, ...]]:
    """What is sent in the place of the first packet; the others are left alone."""
    return lambda number, data: tuple(part(data) for part in parts) if not number else (data,)


def number_at(place: int, value: float) -> Callable[[int, bytes], tuple[bytes, ...]]:
    """A double of each packet: at 0 the time, at 1 the first position, 7 speed, 13 current."""

    def spoilt(_: int, data: bytes) -> tuple[bytes, ...]:
        at = HEADER.size + 1 + 8 * place
        return (data[:at] + struct.pack(">d", value) + data[at + 8 :],)

    return spoilt


def time_shifted(change: Callable[[int], float]) -> Callable[[int, bytes], tuple[bytes, ...]]:
    def spoilt(number: int, data: bytes) -> tuple[bytes, ...]:
        at = HEADER.size + 1
        (t,) = struct.unpack_from(">d", data, at)
        return (data[:at] + struct.pack(">d", t + change(number)) + data[at + 8 :],)

    return spoilt


def ends_within(_: int, data: bytes) -> tuple[bytes, ...]:
    raise ConnectionAbortedError


class Swapped:
    """Every packet comes after the one that follows it."""

    def __init__(self) -> None:
        self.held = b""

    def __call__(self, number: int, data: bytes) -> tuple[bytes, ...]:
        if number % 2 == 0:
            self.held = data
            return ()
        return (data, self.held)


class Held:
    """All packets of the fault come at once, at its end."""

    def __init__(self) -> None:
        self.held: list[bytes] = []

    def __call__(self, number: int, data: bytes) -> tuple[bytes, ...]:
        self.held.append(data)
        if number < FAULT_SAMPLES - 1:
            return ()
        time.sleep(0.3)
        return tuple(self.held)


def waits(number: int, data: bytes) -> tuple[bytes, ...]:
    if number == 0:
        time.sleep(1.5)  # longer than a connection may be quiet
    return (data,)


OTHER_RECIPE = b"\x63"
DATA_FAULTS: dict[str, Callable[[int, bytes], tuple[bytes, ...]]] = {
    "packets lost": lambda _, data: (),
    "packets twice": lambda _, data: (data, data),
    "packets swapped": Swapped(),
    "packets late, all at once": Held(),
    "packets cut": lambda number, data: (data[: 3 * number + 1], data[3 * number + 1 :]),
    "half a frame, then the next": once(lambda data: data[: len(data) // 2]),
    "half a frame, then the end": lambda number, data: (
        (data[:20],) if number == 0 else ends_within(number, data)
    ),
    "silence": waits,
    "a packet too short": once(lambda data: packet(PacketType.DATA, data[3:-8])),
    "a packet too long": once(lambda data: packet(PacketType.DATA, data[3:] + bytes(8))),
    "a packet of no bytes": once(lambda data: packet(PacketType.DATA)),
    "another recipe": lambda _, data: (packet(PacketType.DATA, OTHER_RECIPE + data[4:]), data),
    "a flood of another recipe": once(
        lambda data: packet(PacketType.DATA, OTHER_RECIPE) * 50_000, lambda data: data
    ),
    "a flood of texts": once(
        lambda data: packet(PacketType.TEXT, b"\x1b[2J") * 50_000, lambda data: data
    ),
    "an answer that nobody asked for": once(lambda data: outputs(b"DOUBLE"), lambda data: data),
    "a size of zero": once(lambda data: b"\0\0U", lambda data: data),
    "an unknown type": once(lambda data: b"\0\4?x", lambda data: data),
    "time is no number": number_at(0, np.nan),
    "time without end": number_at(0, np.inf),
    "time of 1e300 s": number_at(0, 1e300),
    "time stands still": number_at(0, 20.0 + H * FAULT_AT),
    "time runs back": time_shifted(lambda number: -2.0 * H * number),
    "time an hour on": time_shifted(lambda number: 3600.0),
    "time a second back": time_shifted(lambda number: -1.0),
    "time in nanosteps": time_shifted(lambda number: (1e-9 - H) * number),
    "time below zero": time_shifted(lambda number: -1e6),
    "a position is no number": number_at(2, np.nan),
    "a position of 1e300": number_at(2, 1e300),
    "a speed without end": number_at(9, -np.inf),
    "a current of 1e308": number_at(14, 1e308),
    "a current is no number": number_at(14, np.nan),
}


@pytest.mark.parametrize("name", DATA_FAULTS)
def test_a_fault_among_packets_is_survived(arms, name):
    arm = arms[6]
    with FaultyController(arm.log, tamper=OneFault(DATA_FAULTS[name])) as controller:
        source = open_source(f"rtde://127.0.0.1:{controller.port}", arm.robot)
        watched = watch(arm, source, is_read(controller))
    assert is_valid_again(watched), watched.events


@pytest.mark.parametrize(("mode", "safety"), [(-1, 1), (99, 1), (7, 3), (7, -5)])
def test_a_mode_that_is_none_is_survived(arms, mode, safety):
    arm = arms[6]

    def tamper(count: int, data: bytes) -> tuple[bytes, ...]:
        is_fault = FAULT_AT <= count < FAULT_AT + FAULT_SAMPLES
        controller.robot_mode, controller.safety_mode = (mode, safety) if is_fault else (7, 1)
        return (data,)

    with FaultyController(arm.log, tamper=tamper) as controller:
        source = open_source(f"rtde://127.0.0.1:{controller.port}", arm.robot)
        watched = watch(arm, source, is_read(controller), checks=False)
    assert {EventKind.STOPPED, EventKind.RUNNING} <= watched.kinds()
    assert is_valid_again(watched), watched.events


# Messages: LCM, ROS 2, Franka ---------------------------------------------------------------------


class Fed:
    """A source before each `read` of which messages are sent.

    Args:
        send: sends the messages of a row.
    """

    def __init__(self, source: Source, send: Callable[[int], None], count: int = SAMPLES) -> None:
        self._source, self._send, self._count, self._row = source, send, count, 0
        self.step, self.rate = source.step, source.rate

    @property
    def is_over(self) -> bool:
        return self._row >= self._count

    def read(self, timeout: float) -> list[Sample | StreamEvent]:
        rows = range(self._row, min(self._row + 10, self._count))
        for row in rows:
            self._send(row)
        self._row = rows.stop
        return self._source.read(timeout if not rows else 0.002)

    def close(self) -> None:
        self._source.close()


def is_fed(source: Fed) -> Callable[[Watched], bool]:
    return lambda watched: source.is_over and time.monotonic() - watched.last_came > 0.3


def is_at_fault(row: int) -> bool:
    return FAULT_AT <= row < FAULT_AT + FAULT_SAMPLES


def iiwa(log: Recording, row: int) -> lcmt_iiwa_status:
    message = lcmt_iiwa_status()
    message.utime, message.num_joints = round(1e6 * log.t[row]), 7
    for name in message.__slots__[2:]:
        setattr(message, name, [0.0] * 7)
    message.joint_position_measured = log.q[row].tolist()
    message.joint_velocity_estimated = log.v[row].tolist()
    message.joint_torque_measured = log.tau_J[row].tolist()
    return message


def changed(**fields: Any) -> Callable[[lcmt_iiwa_status], bytes]:
    def encoded(message: lcmt_iiwa_status) -> bytes:
        for name, value in fields.items():
            setattr(message, name, value)
        return message.encode()

    return encoded


def six_joints(message: lcmt_iiwa_status) -> bytes:
    message.num_joints = 6
    for name in message.__slots__[2:]:
        setattr(message, name, getattr(message, name)[:6])
    return message.encode()


LCM_FAULTS: dict[str, Callable[[lcmt_iiwa_status], bytes]] = {
    "no bytes": lambda message: b"",
    "half a message": lambda message: message.encode()[:100],
    "other bytes": lambda message: b"\xff" * 300,
    "two thousand million joints": lambda message: (
        message.encode()[:16] + b"\x7f\xff\xff\xff" + message.encode()[20:]
    ),
    "joints below zero": lambda message: (
        message.encode()[:16] + b"\xff\xff\xff\xff" + message.encode()[20:]
    ),
    "six joints": six_joints,
    "another robot's status": lambda message: lcmt_panda_status().encode(),
    "a time of zero": changed(utime=0),
    "a time below zero": changed(utime=-(2**62)),
    "positions that are no numbers": changed(joint_position_measured=[float("nan")] * 7),
    "torques without end": changed(joint_torque_measured=[float("inf")] * 7),
}


@pytest.mark.parametrize("name", LCM_FAULTS)
def test_a_fault_among_messages_of_lcm_is_survived(arms, name):
    arm = arms[7]
    lcm = DrakeLcm("memq://")

    def send(row: int) -> None:
        message = iiwa(arm.log, row)
        data = LCM_FAULTS[name](message) if is_at_fault(row) else message.encode()
        lcm.Publish("STATUS", data)

    source = Fed(LcmSource(lcm, "STATUS", "iiwa"), send)
    watched = watch(arm, source, is_fed(source))
    assert is_valid_again(watched), watched.events


def joint_state(log: Recording, joints: tuple[str, ...], row: int, **change: Any) -> bytes:
    """The bytes of a JointState of a row, with some of its fields changed."""
    from wrenchsight.models.recordings.rosbag.messages import JOINT_STATE, typestore

    kinds = typestore().types
    seconds = change.get("seconds", log.t[row])
    stamp = kinds["builtin_interfaces/msg/Time"](int(seconds), round(1e9 * (seconds % 1.0)))
    header = kinds["std_msgs/msg/Header"](stamp, "base")
    fields = {"position": log.q[row], "velocity": log.v[row], "effort": log.tau_J[row]} | change
    arrays = [np.asarray(fields[name], float) for name in ("position", "velocity", "effort")]
    message = kinds[JOINT_STATE](header, list(change.get("names", joints)), *arrays)
    return bytes(typestore().serialize_cdr(message, JOINT_STATE))


NONE = np.zeros(0)
ROS2_FAULTS: dict[str, dict[str, Any]] = {
    "other bytes": {"data": b"\x00\x01\x00\x00" + b"\xff" * 200},
    "half a message": {"keep": 60},
    "no names": {"names": ()},
    "a name twice": {"names": ("shoulder_pan_joint",) * 6},
    "names of another arm": {"names": tuple("abcdef")},
    "no effort": {"effort": NONE},
    "velocities of five joints": {"velocity": np.zeros(5)},
    "no time": {"seconds": 0.0},
    "time stands still": {"seconds": 20.6},
    "time a minute on": {"seconds": 80.6},
    "effort that is no number": {"effort": np.full(6, np.nan)},
    "positions of 1e300": {"position": np.full(6, 1e300)},
}


@pytest.mark.parametrize("name", ROS2_FAULTS)
def test_a_fault_among_messages_of_ros2_is_survived(arms, name):
    pytest.importorskip("cyclonedds", reason="the extra ros2 is not installed")
    from wrenchsight.analyses.methods.watch.ros2_dds import TopicWriter, join
    from wrenchsight.models.live.source import SourceAddress
    from wrenchsight.models.recordings.rosbag.messages import JOINT_STATE

    arm, change = arms[6], dict(ROS2_FAULTS[name])
    url = f"ros2://faults_{list(ROS2_FAULTS).index(name)}?domain=77&effort=torque"
    source = open_source(url, arm.robot)
    topic = SourceAddress.parse(url)
    writer = TopicWriter(join(topic), topic.place, JOINT_STATE)
    source.read(0.0)
    end = time.monotonic() + 5.0
    while not writer.is_read and time.monotonic() < end:
        time.sleep(0.01)
    keep, data = change.pop("keep", None), change.pop("data", None)
    joints = arm.robot.joint_names

    def send(row: int) -> None:
        fields = change if is_at_fault(row) else {}
        message = joint_state(arm.log, joints, row, **fields)
        if is_at_fault(row):
            message = data if data is not None else message[:keep]
        writer.write(message)

    fed = Fed(source, send)
    watched = watch(arm, fed, is_fed(fed))
    assert is_valid_again(watched), watched.events


def franka_state(log: Recording, row: int, mode: str = "Move", **change: Any) -> Any:
    state = SimpleNamespace(
        q=log.q[row], dq=log.v[row], tau_J=log.tau_J[row], tau_ext_hat_filtered=np.zeros(7)
    )
    state.robot_mode, state.time = SimpleNamespace(name=mode), SimpleNamespace()
    state.time.to_sec = lambda: float(log.t[row])
    for name, value in change.items():
        setattr(state, name, value)
    return state


FRANKA_FAULTS: dict[str, Any] = {
    "connection lost": RuntimeError("UDP receive: Timeout"),
    "an error of another kind": KeyError("\x1b[2J"),
    "a mode that is none": {"mode": "Dancing"},
    "positions that are no numbers": {"q": np.full(7, np.nan)},
    "torques of six joints": {"tau_J": np.zeros(6)},
}


@pytest.mark.parametrize("name", FRANKA_FAULTS)
def test_a_fault_among_states_of_franka_is_survived(arms, name):
    arm, fault = arms[7], FRANKA_FAULTS[name]
    rows = iter(range(SAMPLES))
    over = threading.Event()

    def read_once() -> Any:
        row = next(rows, None)
        if row is None:
            over.set()
            time.sleep(0.01)
            raise RuntimeError("the robot is switched off")
        if is_at_fault(row) and isinstance(fault, Exception):
            raise fault
        return franka_state(arm.log, row, **(fault if is_at_fault(row) and fault else {}))

    def opener(host: str) -> Any:
        if is_at_fault(row_now()) and isinstance(fault, Exception):
            for _ in range(FAULT_SAMPLES):
                next(rows, None)
            raise fault
        return SimpleNamespace(read_once=read_once)

    def row_now() -> int:
        return SAMPLES - rows.__length_hint__()

    source = FrankaSource("robot", False, opener)
    source.step = H
    watched = watch(arm, source, lambda w: over.is_set(), checks=False)
    assert is_valid_again(watched), watched.events


# Logs as a source ---------------------------------------------------------------------------------


def line_at(text: str, change: Callable[[list[str]], list[str]]) -> str:
    """The text of a table with the lines of the fault changed."""
    lines = text.splitlines(keepends=True)
    begin, end = 1 + FAULT_AT, 1 + FAULT_AT + FAULT_SAMPLES
    return "".join([*lines[:begin], *change(lines[begin:end]), *lines[end:]])


FILE_FAULTS: dict[str, Callable[[str], str]] = {
    "no bytes": lambda text: "",
    "a header alone": lambda text: text.splitlines()[0] + "\n",
    "ends within a row": lambda text: text[: int(0.4 * len(text))],
    "a row of words": lambda text: line_at(text, lambda lines: ["a,b,c\n", *lines]),
    "rows too long": lambda text: line_at(text, lambda lines: [f"1,{line}" for line in lines]),
    "rows too short": lambda text: line_at(
        text, lambda lines: [line[:40] + "\n" for line in lines]
    ),
    "rows of zeros": lambda text: line_at(text, lambda lines: ["\0" * 50 + "\n" for _ in lines]),
    "rows that are no numbers": lambda text: line_at(
        text, lambda lines: [",".join(["nan"] * (line.count(",") + 1)) + "\n" for line in lines]
    ),
    "rows twice": lambda text: line_at(text, lambda lines: [line for line in lines for _ in "12"]),
    "rows missing": lambda text: line_at(text, lambda lines: []),
    "rows in the wrong order": lambda text: line_at(text, lambda lines: lines[::-1]),
    "the header again": lambda text: line_at(text, lambda lines: [text.splitlines()[0] + "\n"]),
}


@pytest.mark.parametrize("name", FILE_FAULTS)
def test_a_damaged_log_is_played_or_refused(arms, name, tmp_path):
    arm, path = arms[6], tmp_path / "log.csv"
    write_recording(arm.log, path)
    path.write_text(FILE_FAULTS[name](path.read_text()))
    play(arm, path)


def play(arm: Arm, path: Path) -> None:
    """Plays a log: it ends, or is refused, in one line."""
    try:
        source = open_source(f"replay://{path}?rate=0", arm.robot)
    except InputError as error:
        assert str(error).isprintable()
        return
    watched = watch(arm, source, lambda w: False)
    assert watched.events[-1].kind is EventKind.ENDED
