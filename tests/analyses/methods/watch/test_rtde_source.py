"""The reader of RTDE against a controller of ours over loopback, and what can go wrong between."""

import json
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
import pytest
from read_sources import read_until

from wrenchsight.analyses.methods.watch.rtde_controller import RtdeController
from wrenchsight.analyses.methods.watch.sources import open_source
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.live.rtde import (
    FIELD_TYPES,
    NOT_FOUND,
    PacketType,
    Recipe,
    packet,
    read_outputs_request,
)
from wrenchsight.models.live.samples import EventKind
from wrenchsight.models.recordings.recording import Recording

H = 0.002


def log(count=400, torque=False):
    rng = np.random.default_rng(3)
    q, v, current, tau = rng.normal(size=(4, count, 6))
    t = 1.0e6 + H * np.arange(count)
    extra = {"current_desired": 2.0 * current}
    return Recording(
        t=t, q=q, v=v, current=current, source="", tau_J=tau if torque else None, extra=extra
    )


def opened(controller, robot, options=""):
    return open_source(f"rtde://127.0.0.1:{controller.port}{options}", robot)


def test_each_sample_comes_once_bit_by_bit(ur10e):
    recording = log()
    with RtdeController([recording[:150], recording[150:]], port=0, rate=0.0) as controller:
        source = opened(controller, ur10e)
        samples, events = read_until(source, lambda s, _: len(s) == 400)
        source.close()
    assert [event.kind for event in events] == [EventKind.CONNECTED]
    np.testing.assert_array_equal([s.t for s in samples], recording.t)
    for name, signal in (("q", recording.q), ("v", recording.v), ("effort", recording.current)):
        np.testing.assert_array_equal([getattr(s, name) for s in samples], signal)
    np.testing.assert_array_equal(
        [s.more["target_current"] for s in samples], recording.extra["current_desired"]
    )
    assert all(s.running and not s.is_torque for s in samples)


def test_the_frequency_that_is_asked_for_comes(ur10e):
    with RtdeController([log()], port=0, rate=0.0) as controller:
        source = opened(controller, ur10e, "?frequency=125")
        samples, _ = read_until(source, lambda s, _: len(s) == 100)
        source.close()
    np.testing.assert_allclose(np.diff([s.t for s in samples]), 0.008, rtol=1e-6)
    assert source.step == 0.008


def test_torque_is_read_where_the_controller_has_it(ur10e):
    recording = log(torque=True)
    with RtdeController([recording], port=0, rate=0.0) as controller:
        source = opened(controller, ur10e, "?effort=torque")
        samples, _ = read_until(source, lambda s, _: len(s) == 400)
        source.close()
    assert all(s.is_torque for s in samples)
    np.testing.assert_array_equal([s.effort for s in samples], recording.tau_J)
    with RtdeController([log()], port=0) as controller:
        source = opened(controller, ur10e, "?effort=torque")
        _, events = read_until(source, lambda _, e: bool(e))
        source.close()
    assert events[0].kind is EventKind.REFUSED
    assert "actual_current_as_torque" in events[0].text


@pytest.mark.parametrize(
    ("mode", "safety", "word"),
    [(7, 3, "protective stop"), (5, 1, "brakes"), (7, 99, "safety mode 99")],
)
def test_a_robot_that_does_not_run_says_so(ur10e, mode, safety, word):
    with RtdeController([log()], port=0, rate=0.0) as controller:
        controller.robot_mode, controller.safety_mode = mode, safety
        source = opened(controller, ur10e)
        samples, _ = read_until(source, lambda s, _: bool(s))
        source.close()
    assert not samples[0].running
    assert word in samples[0].state


def test_nobody_there_is_one_event_until_somebody_is(ur10e):
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    source = open_source(f"rtde://127.0.0.1:{port}", ur10e)
    end = time.monotonic() + 0.7
    events = []
    while time.monotonic() < end:
        events += source.read(0.05)
    assert [event.kind for event in events] == [EventKind.REFUSED]
    with RtdeController([log()], port=port, rate=0.0):
        began = time.monotonic()
        _, events = read_until(source, lambda s, _: bool(s))
        assert time.monotonic() - began < 1.0  # the promise: back within a second
    source.close()
    assert events[0].kind is EventKind.CONNECTED


def test_a_lost_connection_comes_back(ur10e):
    with RtdeController([log(3000)], port=0) as controller:
        source = opened(controller, ur10e)
        read_until(source, lambda s, _: len(s) >= 20)
        controller.drop_clients()
        _, events = read_until(source, lambda s, _: len(s) >= 20)
        source.close()
    assert [event.kind for event in events][:2] == [EventKind.LOST, EventKind.CONNECTED]
    assert "again" in events[1].text


@pytest.mark.parametrize(
    ("bad", "kind"),
    [
        (b"\x00\x01U", EventKind.GARBAGE),
        (b"GET / HTTP/1.1\r\n\r\n", EventKind.GARBAGE),
        (packet(PacketType.DATA, b"\x01short"), EventKind.GARBAGE),
        (packet(PacketType.DATA, b"\x09" + bytes(80)), EventKind.RECIPE),
        (packet(PacketType.TEXT, b"\x1b[2J popup"), None),
    ],
)
def test_garbage_between_packets_is_said_and_survived(ur10e, bad, kind):
    def tamper(count, data):
        return (bad, data) if count == 100 else (data,)

    with RtdeController([log(1500)], port=0, rate=2.0, tamper=tamper) as controller:
        source = opened(controller, ur10e)
        samples, events = read_until(source, lambda s, _: len(s) >= 300)
        source.close()
    kinds = [event.kind for event in events]
    expected = [EventKind.CONNECTED] + ([kind] if kind else [])
    if kind is EventKind.GARBAGE:
        expected.append(EventKind.CONNECTED)
    assert kinds == expected
    assert all(event.text.isprintable() for event in events)
    assert np.isin([s.t for s in samples], log(1500).t).all()  # nothing is made up


def test_packets_cut_anywhere_are_put_together(ur10e):
    def tamper(count, data):
        cut = count % len(data)
        return (data[:cut], data[cut:])

    with RtdeController([log()], port=0, rate=0.0, tamper=tamper) as controller:
        source = opened(controller, ur10e)
        samples, _ = read_until(source, lambda s, _: len(s) == 400)
        source.close()
    np.testing.assert_array_equal([s.t for s in samples], log().t)


@pytest.mark.parametrize(
    "answer", [b"", b"\x00\x02U", b"HTTP/1.1 400 Bad Request\r\n\r\n", packet(PacketType.START)]
)
def test_somebody_else_on_the_port_is_refused(ur10e, answer):
    with socket.create_server(("127.0.0.1", 0)) as listener:
        source = open_source(f"rtde://127.0.0.1:{listener.getsockname()[1]}", ur10e)

        def serve():
            connection, _ = listener.accept()
            connection.sendall(answer)
            connection.close()

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        _, events = read_until(source, lambda _, e: bool(e))
        source.close()
        thread.join()
    assert events[0].kind is EventKind.REFUSED


def test_nothing_is_ever_written_but_what_a_reader_asks(ur10e):
    """Only V, v, O and S are sent: no input is set up, no script, no pause."""
    sent = bytearray()
    with RtdeController([log()], port=0, rate=0.0) as controller:
        source = opened(controller, ur10e)
        real = socket.socket.sendall

        def spy(self, data, *more):
            if self.getpeername()[1] == controller.port:
                sent.extend(data)
            return real(self, data, *more)

        patch = pytest.MonkeyPatch()
        patch.setattr(socket.socket, "sendall", spy)
        read_until(source, lambda s, _: len(s) == 400)
        patch.undo()
        source.close()
    kinds, at = [], 0
    while at < len(sent):
        size, kind = struct.unpack_from(">HB", sent, at)
        kinds.append(chr(kind))
        at += size
    assert set(kinds) == {"V", "v", "O", "S"}


def test_a_taken_port_is_one_line():
    with RtdeController([log()], port=0) as controller, pytest.raises(InputError, match="listened"):
        RtdeController([log()], port=controller.port)


_OFFICIAL = """
import json, time, rtde_receive
names = ["timestamp", "actual_q", "actual_qd", "actual_current", "robot_mode", "safety_mode"]
client = rtde_receive.RTDEReceiveInterface("127.0.0.1", 500.0, names)
seen, end = [], time.monotonic() + 1.5
while time.monotonic() < end:
    seen.append((client.getTimestamp(), client.getActualQ()[0]))
print(json.dumps([sorted(set(seen)), client.getRobotMode(), client.getSafetyMode()]))
"""


def test_the_official_client_reads_the_same_replay():
    pytest.importorskip("rtde_receive", reason="ur-rtde is not installed")
    recording = log(2000)
    with RtdeController([recording]):  # at 30004, which that client takes for granted
        # In a process of its own: the bindings do not let other threads run while they wait.
        command = [sys.executable, "-c", _OFFICIAL]
        done = subprocess.run(command, capture_output=True, text=True, timeout=20, check=True)
    seen, robot_mode, safety_mode = json.loads(done.stdout.splitlines()[-1])
    assert (robot_mode, safety_mode) == (7, 1)
    times = {t for t, _ in seen}
    assert len(times) > 300  # it keeps the newest packet only
    assert times <= set(recording.t.tolist())
    # Two getters may see two packets, so that q is of this sample or of a later one.
    rows = np.searchsorted(recording.t, [t for t, _ in seen])
    same = [q in recording.q[k : k + 10, 0] for k, (_, q) in zip(rows, seen, strict=True)]
    assert all(same)


class OtherTypes(RtdeController):
    """A controller that states other types for some fields, by name, once `other` is set."""

    other: Mapping[str, str] = MappingProxyType({})

    def _answer(self, client, kind, payload):
        if kind is not PacketType.OUTPUTS:
            super()._answer(client, kind, payload)
            return
        frequency, names = read_outputs_request(payload)
        types = [FIELD_TYPES[n] if n in self._names else NOT_FOUND for n in names]
        types = [self.other.get(n, kind) for n, kind in zip(names, types, strict=True)]
        client.recipe, client.period = Recipe(1, tuple(names), tuple(types)), 1.0 / frequency
        client.send(client.recipe.answer())


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("actual_current", "VECTOR3D"),
        ("actual_current", "DOUBLE"),
        ("timestamp", "VECTOR6D"),
        ("actual_q", "VECTOR6INT32"),
        ("robot_mode", "DOUBLE"),
    ],
)
def test_a_needed_field_of_another_type_is_refused_also_at_a_reconnect(ur10e, name, kind):
    with OtherTypes([log(3000)], port=0) as controller:
        source = opened(controller, ur10e)
        read_until(source, lambda s, _: len(s) >= 20)
        controller.other = {name: kind}
        controller.drop_clients()
        _, events = read_until(source, lambda _, e: len(e) == 2)
        assert [event.kind for event in events] == [EventKind.LOST, EventKind.REFUSED]
        assert f"{name} as {kind}, expected {FIELD_TYPES[name]}" in events[1].text
        controller.other = {}
        _, events = read_until(source, lambda s, _: len(s) >= 20)
        source.close()
    assert events[0].kind is EventKind.CONNECTED


def test_another_field_of_another_type_is_left_out_and_named(ur10e):
    with OtherTypes([log(3000)], port=0) as controller:
        controller.other = {"target_current": "VECTOR3D"}
        source = opened(controller, ur10e)
        samples, events = read_until(source, lambda s, _: len(s) >= 20)
        source.close()
    assert "left out: target_current as VECTOR3D, expected VECTOR6D" in events[0].text
    assert all("target_current" not in sample.more for sample in samples)
