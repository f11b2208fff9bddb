"""Messages of an iiwa and a Panda in, forces out, in memory."""

import numpy as np
import pytest
from drake import lcmt_force_torque, lcmt_iiwa_status, lcmt_panda_status
from pydrake.lcm import DrakeLcm

from wrenchsight.analyses.methods.watch.lcm_links import LcmPublisher, LcmSource
from wrenchsight.analyses.methods.watch.publishers import open_publisher
from wrenchsight.analyses.methods.watch.reader_process import read_stream
from wrenchsight.analyses.methods.watch.sources import open_source
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.live.live_estimator import LiveConfig, LiveEstimator
from wrenchsight.models.live.reading import Reading
from wrenchsight.models.live.samples import EventKind, Sample, StreamEvent


def iiwa(utime, rng):
    message = lcmt_iiwa_status()
    message.utime, message.num_joints = utime, 7
    for name in message.__slots__[2:]:
        setattr(message, name, rng.normal(size=7).tolist())
    return message


def panda(utime, rng, mode=2):
    message = lcmt_panda_status()
    message.utime, message.num_joints, message.robot_mode = utime, 7, mode
    for name in message.__slots__:
        if name.startswith("joint_"):
            setattr(message, name, rng.normal(size=7).tolist())
    return message


def test_an_iiwa_is_read_message_by_message():
    lcm, rng = DrakeLcm("memq://"), np.random.default_rng(1)
    source = LcmSource(lcm, "IIWA_STATUS", "iiwa")
    assert source.read(0.0) == []
    sent = [iiwa(5_000_000 + 5000 * k, rng) for k in range(5)]
    for message in sent:
        lcm.Publish("IIWA_STATUS", message.encode())
        lcm.Publish("OTHER", b"nothing of ours")
    items = [item for _ in range(10) for item in source.read(0.0)]
    assert items[0].kind is EventKind.CONNECTED
    for sample, message in zip(items[1:], sent, strict=True):
        assert isinstance(sample, Sample)
        assert sample.t == pytest.approx(1e-6 * message.utime, abs=1e-12)
        np.testing.assert_array_equal(sample.q, message.joint_position_measured)
        np.testing.assert_array_equal(sample.v, message.joint_velocity_estimated)
        np.testing.assert_array_equal(sample.effort, message.joint_torque_measured)
        assert sample.is_torque
        assert sample.running


@pytest.mark.parametrize(("mode", "running"), [(2, True), (3, True), (4, False), (5, False)])
def test_a_panda_says_whether_it_runs(mode, running):
    lcm = DrakeLcm("memq://")
    source = LcmSource(lcm, "PANDA_STATUS", "panda")
    assert source.read(0.0) == []
    message = panda(7, np.random.default_rng(2), mode)
    lcm.Publish("PANDA_STATUS", message.encode())
    _, sample = source.read(0.0)
    np.testing.assert_array_equal(sample.effort, message.joint_torque)
    assert sample.running is running
    assert bool(sample.state) is not running


@pytest.mark.parametrize(("kind", "make", "sign"), [("iiwa", iiwa, 1.0), ("panda", panda, -1.0)])
def test_external_torque_is_that_on_the_arm(kind, make, sign):
    lcm = DrakeLcm("memq://")
    source = LcmSource(lcm, "S", kind, external=True)
    assert source.read(0.0) == []
    message = make(7, np.random.default_rng(2))
    lcm.Publish("S", message.encode())
    _, sample = source.read(0.0)
    np.testing.assert_array_equal(sample.effort, sign * np.array(message.joint_torque_external))
    assert sample.is_external


def test_messages_that_are_no_status_are_left_out():
    lcm, rng = DrakeLcm("memq://"), np.random.default_rng(3)
    source = LcmSource(lcm, "S", "iiwa")
    assert source.read(0.0) == []
    good = iiwa(1, rng).encode()
    huge = good[:16] + b"\x7f\xff\xff\xff" + good[20:]
    for data in (b"", b"x" * 40, good[:50], huge, panda(1, rng).encode(), good):
        lcm.Publish("S", data)
    items = [item for _ in range(10) for item in source.read(0.0)]
    kinds = [item.kind for item in items if not isinstance(item, Sample)]
    assert kinds.count(EventKind.RECIPE) == 5
    assert sum(isinstance(item, Sample) for item in items) == 1


def test_a_stream_of_another_robot_s_messages_is_one_event_a_second(panda):
    """At 1 kHz there would be a thousand lines a second."""
    lcm, rng = DrakeLcm("memq://"), np.random.default_rng(3)
    source = LcmSource(lcm, "S", "panda")
    assert source.read(0.0) == []
    for _ in range(50):
        lcm.Publish("S", iiwa(1, rng).encode())
    events, turns = [], iter(range(100))
    live = LiveEstimator(panda, IdentifiedModel.nominal(panda), LiveConfig())
    read_stream(source, live, events.append, go_on=lambda: next(turns, None) is not None)
    assert [event.kind for event in events if isinstance(event, StreamEvent)] == [EventKind.RECIPE]


def test_valid_readings_are_sent_as_drakes_force_torque():
    lcm, received = DrakeLcm("memq://"), []
    lcm.Subscribe("WRENCH", lambda data: received.append(lcmt_force_torque.decode(data)))
    publisher = LcmPublisher(lcm, "WRENCH")
    wrench = np.arange(1.0, 7.0)
    for valid in (0.0, 1.0):
        zero = np.zeros(7)
        publisher.send(Reading.of(wrench, np.eye(6), zero, zero, t=12.5, invalid=1.0 - valid))
        lcm.HandleSubscriptions(0)
    (message,) = received
    assert message.timestamp == 12_500_000
    assert [message.tx, message.ty, message.tz] == [1.0, 2.0, 3.0]
    assert [message.fx, message.fy, message.fz] == [4.0, 5.0, 6.0]


def test_addresses_are_checked(ur10e):
    with pytest.raises(InputError, match="channel"):
        open_source("lcm://", ur10e)
    with pytest.raises(InputError, match="robot"):
        open_source("lcm://S?robot=toaster", ur10e)
    with pytest.raises(InputError, match="publish"):
        open_publisher("smoke://h", ur10e)
    open_publisher("lcm://WRENCH?url=memq://", ur10e).close()
    open_source("lcm://S?url=memq://", ur10e).close()
