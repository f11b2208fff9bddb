"""JointStates in and wrenches out, against a peer of Cyclone DDS's own types over loopback."""

import os
import threading
import time
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
from read_sources import read_until

pytest.importorskip("cyclonedds", reason="the extra ros2 is not installed")

from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct, types
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from wrenchsight.analyses.methods.watch import ros2_dds
from wrenchsight.analyses.methods.watch.playing import play
from wrenchsight.analyses.methods.watch.publishers import open_publisher
from wrenchsight.analyses.methods.watch.ros2_publisher import STATUS
from wrenchsight.analyses.methods.watch.sources import open_source
from wrenchsight.models.estimation.wrench_bag import COVARIANCE, TF
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.live.reading import Reading
from wrenchsight.models.live.samples import EventKind, Sample
from wrenchsight.models.live.source import MOST_ITEMS
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.rosbag.messages import JOINT_STATE, WRENCH, typestore

DOMAIN = 100 + os.getpid() % 100  # another one each process
QOS = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(5000))


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: types.int32
    nanosec: types.uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class JointState(IdlStruct, typename="sensor_msgs::msg::dds_::JointState_"):
    header: Header
    name: types.sequence[str]
    position: types.sequence[types.float64]
    velocity: types.sequence[types.float64]
    effort: types.sequence[types.float64]


@dataclass
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    x: types.float64
    y: types.float64
    z: types.float64


@dataclass
class Wrench(IdlStruct, typename="geometry_msgs::msg::dds_::Wrench_"):
    force: Vector3
    torque: Vector3


@dataclass
class WrenchStamped(IdlStruct, typename="geometry_msgs::msg::dds_::WrenchStamped_"):
    header: Header
    wrench: Wrench


class Peer:
    """What stands for a node of ROS 2: it writes or reads one topic, with the types above."""

    def __init__(self, url):
        name, _, _ = url.removeprefix("ros2://").partition("?")
        self.participant = DomainParticipant(DOMAIN)
        self.name = f"rt/{name}"

    def topic(self, kind, more=""):
        return Topic(self.participant, self.name + more, kind)

    def writer(self):
        return DataWriter(self.participant, self.topic(JointState), qos=QOS)

    def reader(self, kind, more=""):
        return DataReader(self.participant, self.topic(kind, more), qos=QOS)


@pytest.fixture
def url(request):
    return f"ros2://{request.node.originalname}?domain={DOMAIN}"


def until(condition, timeout=10.0):
    end = time.monotonic() + timeout
    while time.monotonic() < end:
        if condition():
            return
        time.sleep(0.01)
    raise AssertionError("it did not come")


def kinds_of(events):
    return {event.kind for event in events}


def state(names, t, effort=True, extra=()):
    """A JointState of joints whose numbers tell which joint they are of."""
    names = [*names, *extra]
    place = [float(sum(map(ord, name))) for name in names]
    stamp = Time(int(t), round(1e9 * (t % 1)))
    velocity = [-x for x in place]
    return JointState(
        Header(stamp, "base"), names, place, velocity, [10 * x for x in place] if effort else []
    )


def numbers_of(message, kind):
    """The values of a rosbags message as those of the type that cyclonedds makes of it."""
    return dds_values(message, ros2_dds.dds_type(kind))


def dds_values(value, kind):
    fields = getattr(kind, "__dataclass_fields__", None)
    if fields is not None:
        values = {f: dds_values(getattr(value, f), fields[f].type) for f in fields}
        return kind(**values)
    if isinstance(value, list | np.ndarray):
        return [dds_values(one, kind.__metadata__[0].subtype) for one in value]
    return value


def sample_messages():
    kinds = typestore().types
    vector, header = kinds["geometry_msgs/msg/Vector3"], kinds["std_msgs/msg/Header"]
    head = header(kinds["builtin_interfaces/msg/Time"](7, 8), "base_link")
    joints = np.array([1.5, -2.0, 3e-7])
    yield JOINT_STATE, (head, ["a", "elbow_joint", "wrist 3"], joints, 2 * joints, -joints)
    both = kinds["geometry_msgs/msg/Wrench"](vector(1.0, 2.0, 3.0), vector(-1.0, 0.0, 9.0))
    yield WRENCH, (head, both)
    side = kinds["std_msgs/msg/MultiArrayDimension"]("rows", 6, 36)
    yield COVARIANCE, (kinds["std_msgs/msg/MultiArrayLayout"]([side, side], 0), joints)
    turn = kinds["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    move = kinds["geometry_msgs/msg/Transform"](vector(4.0, 5.0, 6.0), turn)
    yield TF, ([kinds["geometry_msgs/msg/TransformStamped"](head, "E_W", move)],)
    pair = kinds["diagnostic_msgs/msg/KeyValue"]("valid", "1")
    one = kinds["diagnostic_msgs/msg/DiagnosticStatus"](1, "n", "valid", "arm", [pair, pair])
    yield STATUS, (head, [one])


@pytest.mark.parametrize(("kind", "fields"), list(sample_messages()))
def test_bytes_are_those_of_cyclonedds_and_of_rosbags_alike(kind, fields):
    message = typestore().types[kind](*fields)
    by_rosbags = bytes(typestore().serialize_cdr(message, kind))
    assert numbers_of(message, kind).serialize(use_version_2=False) == by_rosbags
    package, _, name = kind.split("/")
    assert ros2_dds.dds_type(kind).__idl_typename__ == f"{package}::msg::dds_::{name}_"


def test_joints_are_found_by_name_and_what_is_no_sample_is_left_out(ur10e, url):
    source, peer = open_source(f"{url}&effort=current", ur10e), Peer(url)
    writer = peer.writer()
    source.read(0.0)
    until(writer.get_matched_subscriptions)
    names = list(ur10e.joint_names)
    turned = names[::-1]
    for message in (
        state(["finger"], 0.5),  # a gripper's own
        state(names, 1.0),
        state(turned[:3], 1.002, extra=["finger", *turned[3:]]),
        state(names, 1.004, effort=False),
        state(names[:5], 1.006),
        state([*names, names[0]], 1.008),
        state(names, 0.0),
        state(turned, 1.010),
    ):
        writer.write(message)
    samples, events = read_until(source, lambda s, _: len(s) == 3)
    assert [sample.t for sample in samples] == [1.0, 1.002, 1.01]
    expected = [sum(map(ord, name)) for name in names]
    for sample in samples:
        np.testing.assert_array_equal(sample.q, expected)
        np.testing.assert_array_equal(sample.v, np.negative(expected))
        np.testing.assert_array_equal(sample.effort, np.multiply(expected, 10))
        assert not sample.is_torque
    texts = [event.text for event in events if event.kind is EventKind.RECIPE]
    for word in ("without effort", names[5], names[0], "time stamp"):
        assert any(word in text for text in texts), (word, texts)
    writer.write(state(names, 1.2))  # and what is still to be read when it goes
    del writer
    read_until(source, lambda _, events: kinds_of(events) >= {EventKind.LOST, EventKind.REFUSED})
    writer = peer.writer()
    until(writer.get_matched_subscriptions)
    writer.write(state(names, 2.0))
    samples, events = read_until(source, lambda s, _: s)
    assert samples[0].t == 2.0
    assert events[0].kind is EventKind.CONNECTED
    source.close()
    assert source.read(0.0) == []


@pytest.mark.parametrize("unit", ["N m", "A"])
def test_gravity_decides_of_the_unit_and_a_played_arm_is_read(ur10e, url, unit):
    n, h = 400, 0.002
    q = np.tile(np.add(ur10e.home, [0.0, -0.5, 0.7, 0.0, 0.3, 0.0]), (n, 1))
    q += 1e-3 * np.arange(n)[:, None]
    v = np.full_like(q, 0.5)
    current = ur10e.motor_current(ur10e.chain.gravity_torque(q))
    recording = Recording(t=h * np.arange(n), q=q, v=v, current=current, source="")
    effort = "torque" if unit == "N m" else "current"
    source, texts = open_source(url, ur10e), []
    player = threading.Thread(
        target=play, args=(recording, ur10e, f"{url}&effort={effort}", texts.append)
    )
    player.start()
    samples, events = read_until(source, lambda s, _: len(s) == n)
    player.join()
    assert "0.8 s" in texts[0]
    for name, wanted in (("q", q), ("v", v)):
        np.testing.assert_array_equal([getattr(sample, name) for sample in samples], wanted)
    np.testing.assert_allclose(np.diff([sample.t for sample in samples]), h, atol=1e-6)
    assert {sample.is_torque for sample in samples} == {unit == "N m"}
    tau = ur10e.joint_torque(current)
    np.testing.assert_array_equal([s.effort for s in samples], tau if unit == "N m" else current)
    (check,) = [event.text for event in events if event.kind is EventKind.CHECK]
    assert f"in {unit}" in check
    assert "?effort=" in check


def reading(ur10e, t, valid=1.0):
    q = np.add(ur10e.home, 0.2)
    covariance = np.diag(np.arange(1.0, 7.0))
    wrench = np.array([4.0, 5.0, 6.0, 1.0, 2.0, 3.0])  # rotation first
    return Reading.of(wrench, covariance, np.zeros(6), q, t=t, invalid=1.0 - valid, running=1.0)


def test_valid_readings_go_out_as_a_sensors_broadcaster_sends_them(ur10e, url):
    peer, publisher = Peer(url), open_publisher(url, ur10e)
    of_tool = open_publisher(url.replace("?", "/tool?") + "&frame=tool0&stamp=computer", ur10e)
    wrenches, in_tool = peer.reader(WrenchStamped), peer.reader(WrenchStamped, "/tool")
    status = peer.reader(ros2_dds.dds_type(STATUS), "/status")
    until(lambda: len(wrenches.get_matched_publications() + in_tool.get_matched_publications()) > 1)
    until(status.get_matched_publications)
    for k, valid in enumerate((0.0, 1.0, 1.0)):
        publisher.send(reading(ur10e, 12.5 + k, valid))
    of_tool.send(reading(ur10e, 1.0))
    received, statuses = [], []
    until(lambda: received.extend(wrenches.take(10)) or len(received) == 2)
    assert [message.header.stamp.sec for message in received] == [13, 14]
    assert received[0].header.stamp.nanosec == 500_000_000
    assert received[0].header.frame_id == "E_W"
    assert received[0].wrench == Wrench(Vector3(1.0, 2.0, 3.0), Vector3(4.0, 5.0, 6.0))
    until(lambda: statuses.extend(status.take(10)) or len(statuses) > 1)
    words = [typestore().deserialize_cdr(one.data, STATUS).status[0] for one in statuses[:2]]
    assert [word.message for word in words] == ["not valid: settling", "valid"]
    assert "fault" in {value.key for value in words[0].values}
    turned = []
    until(lambda: turned.extend(in_tool.take(10)) or turned)
    R_WE, _ = ur10e.chain.pose(np.add(ur10e.home, 0.2)[None])
    force = turned[0].wrench.force
    np.testing.assert_allclose([force.x, force.y, force.z], R_WE[0].T @ [1.0, 2.0, 3.0])
    assert turned[0].header.frame_id == "tool0"
    assert abs(turned[0].header.stamp.sec - time.time()) < 1e6  # of this age
    assert publisher.lost == 0
    publisher.send(reading(ur10e, -1.0))
    assert publisher.lost == 1


def test_a_subscriber_that_reads_nothing_makes_nobody_wait(ur10e, url):
    slow = Qos(
        Policy.Reliability.Reliable(duration(seconds=1)),
        Policy.History.KeepAll,
        Policy.ResourceLimits(max_samples=5),
    )
    peer, publisher = Peer(url), open_publisher(url, ur10e)
    quick = peer.reader(WrenchStamped)
    other = DataReader(peer.participant, peer.topic(WrenchStamped), qos=slow)
    until(lambda: quick.get_matched_publications() and other.get_matched_publications())
    received = []
    for k in range(200):
        publisher.send(reading(ur10e, float(k)))
        time.sleep(0.001)
        received += quick.take(100)
    until(lambda: received.extend(quick.take(100)) or len(received) >= 150)
    assert len(other.take(1000)) <= 5


@pytest.mark.parametrize(
    "wrong", ["a-b", "", "9", "x?domain=999", "x?network=a b", "x?network=nowhere9", "x?effort=V"]
)
def test_addresses_are_checked(ur10e, wrong):
    with pytest.raises(InputError, match="ros2://"):
        open_source(f"ros2://{wrong}", ur10e)


def test_what_one_call_cannot_give_comes_with_the_next(ur10e, url):
    source = open_source(f"{url}&effort=current", ur10e)
    count = MOST_ITEMS + 20
    batch = [state(ur10e.joint_names, 1.0 + 0.002 * k).serialize() for k in range(count)]
    batches = iter([batch])
    source._reader = SimpleNamespace(take=lambda timeout: next(batches, []))
    first, second = source.read(0.0), source.read(0.0)
    assert len(first) == MOST_ITEMS
    times = [item.t for item in (*first, *second) if isinstance(item, Sample)]
    np.testing.assert_allclose(times, 1.0 + 0.002 * np.arange(count), atol=1e-8)
    assert not source.read(0.0)
    source.close()


def test_faults_without_end_are_not_all_remembered(ur10e, url):
    source = open_source(url, ur10e)
    for k in range(3 * MOST_ITEMS):
        source._say([], EventKind.RECIPE, f"fault {k}")
    assert len(source._counts) <= MOST_ITEMS + 1
    assert len(source._event_times) <= MOST_ITEMS + 1
    source.close()
