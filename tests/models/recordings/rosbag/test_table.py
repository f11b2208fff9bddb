"""ROS 2 bags, with rosbags' own writer and deserialiser as the oracle."""

import sqlite3
import struct
import tracemalloc
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import lz4.frame
import numpy as np
import pytest
from backports import zstd
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_reader import RecordingReader, read_recording
from wrenchsight.models.recordings.recording_writer import write_recording
from wrenchsight.models.recordings.rosbag import table as rosbag_table

_TYPES = get_typestore(Stores.ROS2_HUMBLE)
_JOINTS = ["elbow", "finger", "shoulder"]
_ROBOT: Any = SimpleNamespace(
    has_inertias=False,
    is_coupled=False,
    name="two",
    num_joints=2,
    joint_names=("shoulder", "elbow"),
    torque_per_ampere=np.array([10.0, 4.0]),
    current_sign=np.ones(2),
    motor_current=lambda tau_J: tau_J / [10.0, 4.0],
    q_offset=np.zeros(2),
    velocity_limit=np.full(2, np.inf),
    position_lower=np.full(2, -np.inf),
    position_upper=np.full(2, np.inf),
    chain=SimpleNamespace(prismatic=np.zeros(2, bool)),
)
_START = 1_700_000_000 * 10**9
_ROWS = 200


def _header(stamp: int, frame: str = "") -> Any:
    time = _TYPES.types["builtin_interfaces/msg/Time"](stamp // 10**9, stamp % 10**9)
    return _TYPES.types["std_msgs/msg/Header"](time, frame)


def _joint_state(stamp: int, row: np.ndarray, joints: Sequence[str] = _JOINTS) -> Any:
    kind = _TYPES.types["sensor_msgs/msg/JointState"]
    size = len(joints)
    return kind(_header(stamp), list(joints), row[:size], row[size : 2 * size], row[2 * size :])


def _wrench(stamp: int, row: np.ndarray) -> Any:
    vector = _TYPES.types["geometry_msgs/msg/Vector3"]
    wrench = _TYPES.types["geometry_msgs/msg/Wrench"](vector(*row[:3]), vector(*row[3:]))
    return _TYPES.types["geometry_msgs/msg/WrenchStamped"](_header(stamp, "sensor"), wrench)


def _stamps(rows: int = _ROWS, step_ns: int = 2_000_000) -> np.ndarray:
    return _START + step_ns * np.arange(rows)


def _bag(
    path: Path,
    messages: Sequence[tuple[str, int, Any]],
    plugin: Any = StoragePlugin.MCAP,
    compression: Any = None,
) -> Path:
    writer = Writer(path, version=9, storage_plugin=plugin)
    if compression is not None:
        writer.set_compression(compression, CompressionFormat.ZSTD)
    with writer:
        connections: dict[str, Any] = {}
        for topic, stamp, message in messages:
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=_TYPES)
            writer.write(connections[topic], stamp, _TYPES.serialize_cdr(message, kind))
    return path


def _values(rows: int = _ROWS, width: int = 9) -> np.ndarray:
    return np.random.default_rng(7).normal(size=(rows, width))


def _states(values: np.ndarray) -> list[tuple[str, int, Any]]:
    stamps = _stamps(len(values))
    return [
        ("/joint_states", int(s), _joint_state(int(s), row))
        for s, row in zip(stamps, values, strict=True)
    ]


def _same(recording: Recording, values: np.ndarray) -> None:
    np.testing.assert_array_equal(recording.q, values[:, [2, 0]])
    np.testing.assert_array_equal(recording.v, values[:, [5, 3]])
    np.testing.assert_array_equal(recording.tau_J, values[:, [8, 6]])


@pytest.mark.parametrize("block", [7, 1 << 14])
@pytest.mark.parametrize("kind", ["mcap", "mcap-zstd", "mcap-file", "sqlite", "sqlite-zstd"])
def test_joint_states_are_read_from_every_kind_of_bag(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, block: int
) -> None:
    monkeypatch.setattr(rosbag_table, "_BLOCK_MESSAGES", block)
    plugin = StoragePlugin.SQLITE3 if kind.startswith("sqlite") else StoragePlugin.MCAP
    compression = {
        "mcap-zstd": CompressionMode.STORAGE,
        "mcap-file": CompressionMode.FILE,
        "sqlite-zstd": CompressionMode.MESSAGE,
    }.get(kind)
    values = _values()
    path = _bag(tmp_path / "bag", _states(values), plugin, compression)
    recording = read_recording(path, robot=_ROBOT, check=False)
    _same(recording, values)
    np.testing.assert_allclose(recording.t, _stamps() / 1e9, rtol=0, atol=3e-7)  # a double's grain
    assert recording.row is not None
    assert recording.row.tolist() == list(range(1, _ROWS + 1))
    assert any("left out: finger" in notice for notice in recording.notices)
    if kind in ("mcap", "sqlite"):
        (file,) = (file for file in path.iterdir() if file.suffix in (".mcap", ".db3"))
        _same(read_recording(file, robot=_ROBOT, check=False), values)


def test_messages_may_have_other_lengths_and_orders(tmp_path: Path) -> None:
    """Joints in another order, an extra joint, a message without velocities."""
    values = _values()
    messages = _states(values)
    stamp = int(_stamps()[50])
    swapped = values[50].reshape(3, 3)[:, [2, 1, 0]].ravel()
    messages[50] = ("/joint_states", stamp, _joint_state(stamp, swapped, _JOINTS[::-1]))
    stamp = int(_stamps()[60])
    with_extra_joint = np.insert(values[60].reshape(3, 3), 1, 9.0, axis=1).ravel()
    joints = ["elbow", "extra", "finger", "shoulder"]
    messages[60] = ("/joint_states", stamp, _joint_state(stamp, with_extra_joint, joints))
    kind = _TYPES.types["sensor_msgs/msg/JointState"]
    stamp = int(_stamps()[70])
    none = np.empty(0)
    partial = kind(_header(stamp), _JOINTS, values[70, :3], none, values[70, 6:])
    messages[70] = ("/joint_states", stamp, partial)
    recording = read_recording(_bag(tmp_path / "bag", messages), robot=_ROBOT, check=False)
    _same(recording, np.delete(values, 70, axis=0))
    assert any("lack a number: 1 (first: message 71" in n for n in recording.notices)


def test_another_topic_is_interpolated_at_the_joints_stamps(tmp_path: Path) -> None:
    """A force sensor at another rate is interpolated at the joints' stamps."""
    values, stamps = _values(), _stamps()
    messages = _states(values)
    sensor = _stamps(_ROWS // 2, 4_000_000) + 500_000
    rows = np.outer((sensor - _START) * 1e-9, np.arange(1.0, 7.0))
    messages += [("/ft/wrench", int(s), _wrench(int(s), r)) for s, r in zip(sensor, rows)]  # noqa: B905
    messages.sort(key=lambda message: message[1])
    recording = read_recording(_bag(tmp_path / "bag", messages), robot=_ROBOT, check=False)
    inside = (stamps >= sensor[0]) & (stamps <= sensor[-1])
    _same(recording, values[inside])
    assert recording.extra.keys() == {"ft"}
    expected = np.outer((stamps[inside] - _START) * 1e-9, np.arange(1.0, 7.0))
    np.testing.assert_allclose(recording.extra["ft"], expected, atol=2e-6)  # of UNIX time's grain


def test_a_long_gap_of_another_topic_is_not_bridged(tmp_path: Path) -> None:
    messages = _states(_values())
    sensor = np.delete(_stamps(), np.s_[50:150])  # 0.2 s
    messages += [("/ft/wrench", int(s), _wrench(int(s), np.ones(6))) for s in sensor]
    messages.sort(key=lambda message: message[1])
    recording = read_recording(_bag(tmp_path / "bag", messages), robot=_ROBOT, check=False)
    assert recording.row is not None
    np.testing.assert_array_equal(recording.row, [*range(1, 51), *range(152, 201)])


def test_efforts_that_a_driver_does_not_fill_are_no_torque(tmp_path: Path) -> None:
    values = _values()
    values[:, 6:] = np.nan
    path = _bag(tmp_path / "bag", _states(values))
    recording = read_recording(path, robot=_ROBOT, check=False)
    assert recording.tau_J is None
    with pytest.raises(InputError, match="holds no motor currents"):
        RecordingReader(path, robot=_ROBOT, check=False).require_joint_signals()


def test_headers_without_stamps_take_the_time_of_recording(tmp_path: Path) -> None:
    values = _values()
    messages = [
        ("/joint_states", int(s), _joint_state(0, row))
        for s, row in zip(_stamps(), values, strict=True)
    ]
    recording = read_recording(_bag(tmp_path / "bag", messages), robot=_ROBOT, check=False)
    np.testing.assert_allclose(np.diff(recording.t), 0.002, atol=5e-7)
    assert any("the time of recording is used" in n for n in recording.notices)


def test_a_driver_that_leaves_the_effort_of_one_joint_empty_is_named(tmp_path: Path) -> None:
    values = _values()
    values[:, 8] = np.nan  # of the shoulder
    path = _bag(tmp_path / "bag", _states(values))
    with pytest.raises(InputError, match=r"/joint_states lacks the effort of shoulder .*NaN only"):
        read_recording(path, robot=_ROBOT, check=False)


def test_a_bag_without_efforts_names_what_is_not_read(tmp_path: Path) -> None:
    kind = "std_msgs/msg/Float64MultiArray"
    layout = _TYPES.types["std_msgs/msg/MultiArrayLayout"]([], 0)
    messages: list[tuple[str, int, Any]] = []
    for topic, stamp, state in _states(_values()):
        state.effort = np.empty(0)
        messages += [
            (topic, stamp, state),
            ("/currents", stamp, _TYPES.types[kind](layout, np.ones(3))),
        ]
    path = _bag(tmp_path / "bag", messages)
    with pytest.raises(InputError) as caught:
        read_recording(path, None, _ROBOT, check=False, joint_signals=True)
    assert f"topics that are not read: /currents ({kind})" in str(caught.value)
    assert "record them as the effort of a JointState" in str(caught.value)


def test_messages_without_names_are_read_in_a_stated_order(tmp_path: Path) -> None:
    values = _values(width=6)
    stamps = _stamps()
    kind = _TYPES.types["sensor_msgs/msg/JointState"]
    messages = [
        ("/js", int(s), kind(_header(int(s)), [], row[:2], row[2:4], row[4:]))
        for s, row in zip(stamps, values, strict=True)
    ]
    path = _bag(tmp_path / "bag", messages)
    with pytest.raises(InputError, match=r"name no joints.*joints-in-robot-order"):
        read_recording(path, robot=_ROBOT, check=False)
    recording = read_recording(path, "joints-in-robot-order", _ROBOT, check=False)
    np.testing.assert_array_equal(recording.q, values[:, :2])
    np.testing.assert_array_equal(recording.tau_J, values[:, 4:])


def test_dynamic_joint_states_are_read(tmp_path: Path) -> None:
    types = get_typestore(Stores.ROS2_HUMBLE)
    text = (
        "std_msgs/Header header\nstring[] joint_names\nInterfaceValue[] interface_values\n"
        + "=" * 80
        + "\nMSG: control_msgs/InterfaceValue\nstring[] interface_names\nfloat64[] values\n"
    )
    types.register(get_types_from_msg(text, "control_msgs/msg/DynamicJointState"))
    state = types.types["control_msgs/msg/DynamicJointState"]
    interface = types.types["control_msgs/msg/InterfaceValue"]
    values = _values()
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/djs", state.__msgtype__, typestore=types)
        for stamp, row in zip(_stamps(), values, strict=True):
            interfaces = [
                interface(["effort", "position", "velocity"], row[[6 + j, j, 3 + j]])
                for j in range(3)
            ]
            time = types.types["builtin_interfaces/msg/Time"](stamp // 10**9, stamp % 10**9)
            header = types.types["std_msgs/msg/Header"](time, "")
            message = state(header, _JOINTS, interfaces)
            data = types.serialize_cdr(message, state.__msgtype__)
            writer.write(connection, int(stamp), data)
    _same(read_recording(tmp_path / "bag", robot=_ROBOT, check=False), values)


@pytest.mark.parametrize("compression", [None, *Ros1Writer.CompressionFormat])
def test_a_bag_of_ros_1_is_read(tmp_path: Path, compression: Any) -> None:
    types = get_typestore(Stores.ROS1_NOETIC)
    kind = types.types["sensor_msgs/msg/JointState"]
    values = _values()
    path = tmp_path / "log.bag"
    writer = Ros1Writer(path)
    if compression is not None:
        writer.set_compression(compression)
    with writer:
        connections = [
            writer.add_connection("/joint_states", kind.__msgtype__, typestore=types, callerid=name)
            for name in ("/arm", "/gripper")
        ]
        for k, (stamp, row) in enumerate(zip(_stamps(), values, strict=True)):
            time = types.types["builtin_interfaces/msg/Time"](stamp // 10**9, stamp % 10**9)
            header = types.types["std_msgs/msg/Header"](k, time, "")
            message = kind(header, _JOINTS, row[:3], row[3:6], row[6:])
            data = types.serialize_ros1(message, kind.__msgtype__)
            writer.write(connections[k % 2], int(stamp), data)
    _same(read_recording(path, robot=_ROBOT, check=False), values)
    other_name = path.rename(tmp_path / "log.bag.active")
    _same(read_recording(other_name, robot=_ROBOT, check=False), values)
    whole = other_name.read_bytes()
    # The header's index_pos (8 bytes) is 0 until a bag is closed.
    place = whole.index(b"index_pos=") + len(b"index_pos=")
    other_name.write_bytes(whole[:place] + bytes(8) + whole[place + 8 :])
    with pytest.raises(InputError, match=r"not closed .*name it log.bag, then .*reindex log.bag"):
        read_recording(other_name, robot=_ROBOT, check=False)
    path.write_bytes(whole[:5000])
    with pytest.raises(InputError, match="no bag, or a damaged one"):
        read_recording(path, robot=_ROBOT, check=False)


def test_a_lone_compressed_file_of_a_bag_is_read(tmp_path: Path) -> None:
    values = _values()
    path = _bag(tmp_path / "bag", _states(values), StoragePlugin.MCAP, CompressionMode.FILE)
    (file,) = path.glob("*.mcap.zstd")
    alone = tmp_path / "log.mcap.zstd"
    file.rename(alone)
    _same(read_recording(alone, robot=_ROBOT, check=False), values)


def test_rosbags_reads_a_written_bag(tmp_path: Path) -> None:
    q, v, current, tau = np.random.default_rng(3).normal(size=(4, 100, 3))
    log = Recording(1.7e9 + 0.001 * np.arange(100), q, v, current, "made up", tau_J=tau)
    write_recording(log, tmp_path / "out.mcap")
    with Reader(tmp_path / "out.mcap") as reader:
        _, stamp, data = next(iter(reader.messages()))
        message: Any = _TYPES.deserialize_cdr(data, "sensor_msgs/msg/JointState")
    assert stamp == _START
    assert message.name == ["joint_1", "joint_2", "joint_3"]
    np.testing.assert_array_equal(message.position, q[0])


def test_damaged_bags_and_other_files_are_refused(tmp_path: Path) -> None:
    path = _bag(tmp_path / "bag", _states(_values()))
    (file,) = path.glob("*.mcap")
    data = file.read_bytes()
    for content in (b"", b"t,q1\n" * 20, data[:4000], data[:3000] + bytes(500) + data[3500:]):
        file.write_bytes(content)
        for place in (path, file):
            with pytest.raises(InputError, match="no bag, or a damaged one"):
                read_recording(place)
    file.unlink()
    with pytest.raises(InputError, match="no bag"):
        read_recording(path)
    text = _TYPES.types["std_msgs/msg/String"]("hello")
    other = _bag(tmp_path / "other", [("/chatter", _START, text)])
    with pytest.raises(InputError, match=r"holds no topic of sensor_msgs.*std_msgs/msg/String"):
        read_recording(other)
    with pytest.raises(InputError, match="is a directory"):
        read_recording(tmp_path)


_ZEROS = zstd.compress(bytes(1 << 24))  # 16 MB in some hundred bytes


def _mcap(path: Path, chunks: Sequence[tuple[int, str, bytes]]) -> Path:
    """An MCAP file without an index: chunks of a stated size, compression and content."""

    def record(kind: int, content: bytes) -> bytes:
        return struct.pack("<BQ", kind, len(content)) + content

    def text(word: str) -> bytes:
        return struct.pack("<I", len(word)) + word.encode()

    magic = b"\x89MCAP0\r\n"
    content = magic + record(1, text("ros2") + text("by hand"))
    for size, compression, data in chunks:
        chunk = struct.pack("<QQQI", 0, 1, size, 0) + text(compression)
        content += record(6, chunk + struct.pack("<Q", len(data)) + data)
    path.write_bytes(content + record(2, bytes(20)) + magic)
    return path


@pytest.mark.parametrize(
    ("profile", "words"),
    [
        ("ros1", ["of ROS 1 messages", "give the ROS 1 bag (.bag) that it was made of"]),
        ("", ['the profile ""', "such as JSON or protobuf", "export the joint states as CSV"]),
    ],
)
def test_mcap_files_of_other_messages_are_told(
    tmp_path: Path, profile: str, words: list[str]
) -> None:
    content = len(profile).to_bytes(4, "little") + profile.encode() + bytes(4)
    path = tmp_path / "log.mcap"
    record = b"\x01" + len(content).to_bytes(8, "little") + content
    path.write_bytes(b"\x89MCAP0\r\n" + record + bytes(80))
    with pytest.raises(InputError) as caught:
        read_recording(path)
    assert all(word in str(caught.value) for word in words), str(caught.value)


@pytest.mark.parametrize(
    "chunk",
    [
        (100 << 24, "zstd", 100 * _ZEROS),
        (1 << 20, "zstd", _ZEROS),
        (1 << 60, "zstd", _ZEROS),
        (1 << 20, "zstd", 100 * _ZEROS),
        (1 << 30, "lz4", lz4.frame.compress(bytes(1 << 24))),
        (1 << 62, "", b""),
    ],
)
def test_a_chunk_that_unpacks_to_too_much_is_refused(
    tmp_path: Path, chunk: tuple[int, str, bytes]
) -> None:
    tracemalloc.start()
    with pytest.raises(InputError, match="damaged"):
        read_recording(_mcap(tmp_path / "log.mcap", [chunk]))
    assert tracemalloc.get_traced_memory()[1] < 1 << 28
    tracemalloc.stop()


def test_a_message_that_unpacks_to_too_much_is_refused(tmp_path: Path) -> None:
    path = _bag(
        tmp_path / "bag", _states(_values()), StoragePlugin.SQLITE3, CompressionMode.MESSAGE
    )
    (file,) = path.glob("*.db3")
    with closing(sqlite3.connect(file)) as base, base:
        base.execute("UPDATE messages SET data = ?", (zstd.compress(bytes(5 << 24)),))
    with pytest.raises(InputError, match="at most 67108864 are read"):
        read_recording(path)


def test_a_compressed_file_and_a_stated_chunk_size_are_bounded(tmp_path: Path) -> None:
    path = _bag(tmp_path / "bag", _states(_values()), StoragePlugin.MCAP, CompressionMode.FILE)
    (file,) = path.glob("*.zstd")
    file.write_bytes(100 * _ZEROS)
    with pytest.raises(InputError, match="bytes that unpack to"):
        read_recording(path)
    path = _bag(tmp_path / "big", _states(_values()), StoragePlugin.MCAP, CompressionMode.STORAGE)
    (file,) = path.glob("*.mcap")
    data = file.read_bytes()
    with Reader(file) as reader:
        (chunk,) = reader.storage.chunks
    true_sizes = struct.pack("<QQ", chunk.compressed_size, chunk.uncompressed_size)
    false_sizes = struct.pack("<QQ", chunk.compressed_size, 1 << 40)
    assert data.count(true_sizes) == 1  # in the index
    file.write_bytes(data.replace(true_sizes, false_sizes))
    with pytest.raises(InputError, match="bytes that unpack to"):
        read_recording(file)


@pytest.mark.parametrize(("begin", "is_written"), [(2.0**31 - 10.0, True), (2.0**31 - 1.0, False)])
def test_times_that_no_stamp_holds_are_refused(
    tmp_path: Path, begin: float, is_written: bool
) -> None:
    """The seconds of a stamp are an int32."""
    t = begin + 0.1 * np.arange(20)
    zeros = np.zeros((20, 2))
    log = Recording(t=t, q=zeros, v=zeros, current=zeros, source="log")
    path = tmp_path / "log.mcap"
    if is_written:
        write_recording(log, path)
        np.testing.assert_allclose(read_recording(path).t, t, rtol=0, atol=1e-6)
        return
    with pytest.raises(InputError, match="no ROS stamp can hold, expected 0 to 2\\^31 s"):
        write_recording(log, path)


def test_messages_of_one_joint_each_are_joined(tmp_path: Path) -> None:
    """As boards of one motor each publish them, 2 ms apart."""
    t, path = 0.01 * np.arange(60), tmp_path / "log.mcap"
    with rosbag_table.BagWriter(path) as writer:
        for j in range(2):
            stamps = np.round((5.0 + t + 0.002 * j) * 1e9).astype(np.int64)
            x = np.sin(t + 0.002 * j + j)
            quantities = {q: {f"joint_{j + 1}": x} for q in ("position", "velocity", "effort")}
            writer.write_joint_states("/joint_states", stamps, quantities)
    log = read_recording(path)
    at = log.t - 5.0
    assert log.num_samples == 59  # the second joint has none before the first one's
    for j in range(2):
        np.testing.assert_allclose(log.q[:, j], np.sin(at + j), rtol=0, atol=1e-4)


@pytest.mark.parametrize("has_time", [True, False])
def test_fields_of_a_drivers_own_message_are_read(tmp_path: Path, has_time: bool) -> None:
    """As ur_msgs/RobotStateRTMsg has arrays without names; the bag holds the definition."""
    kind, types = "driver/msg/State", get_typestore(Stores.ROS1_NOETIC)
    clock = "time" if has_time else "robot_mode"
    fields = ["q_target", "q_actual", "qd_actual", "i_actual"]
    definition = "\n".join([f"float64 {clock}", *(f"float64[] {name}" for name in fields)])
    types.register(get_types_from_msg(definition, kind))
    values, stamps, path = _values(width=8), _stamps(), tmp_path / "log.bag"
    with Ros1Writer(path) as writer:
        connection = writer.add_connection("/state", kind, typestore=types)
        for stamp, row in zip(stamps, values, strict=True):
            number = 1e-9 * stamp + 5.0 if has_time else 7.0
            message = types.types[kind](number, *row.reshape(4, 2))
            writer.write(connection, int(stamp), bytes(types.serialize_ros1(message, kind)))
    log = read_recording(path)
    np.testing.assert_allclose(log.t, 1e-9 * stamps + 5.0 * has_time, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(np.c_[log.q, log.v, log.current], values[:, 2:])
