"""States of a Franka arm: from a stand-in, and by libfranka from a peer that speaks FCI."""

import select
import socket
import struct
import subprocess
import sys
from importlib.util import find_spec
from types import SimpleNamespace

import numpy as np
import pytest
from read_sources import read_until

from wrenchsight.analyses.methods.watch.franka_source import FCI_PORT, FrankaSource
from wrenchsight.analyses.methods.watch.sources import open_source
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.live.samples import EventKind
from wrenchsight.models.robot.robot import Robot

JOINTS = np.arange(1.0, 8.0)
SIGNALS = {"q": 0.1 * JOINTS, "dq": -0.2 * JOINTS, "tau_J": 3.0 * JOINTS}
SIGNALS["tau_ext_hat_filtered"] = 0.25 * JOINTS
# Of the state that libfranka 0.21 expects: its size, and where single-precision numbers stand.
STATE_SIZE, MODE_AT, MOVE, USER_STOPPED = 1377, 1372, 2, 5
PLACES = {"q": 596, "dq": 652, "tau_J": 512, "tau_ext_hat_filtered": 840}
NUM_STATES = 300
CONNECT, GET_MODEL = 0, 11  # commands


def urdf():
    limits = "<limit lower='-3' upper='3' effort='87' velocity='2'/>"
    limits += "<position_based_velocity_limits velocity_offset='0.3' deceleration_limit='6'/>"
    joints = "".join(
        f"<link name='link{k}'/><joint name='joint{k}' type='revolute'><parent link='link{k - 1}'/>"
        f"<child link='link{k}'/><axis xyz='0 0 1'/>{limits}</joint>"
        for k in range(1, 8)
    )
    return f"<robot name='fr3'><link name='link0'/>{joints}</robot>".encode()


def serve(connection):
    """Answers one client by FCI, and sends it states every millisecond; what it asked, printed."""
    states, port, number, requests = socket.socket(socket.AF_INET, socket.SOCK_DGRAM), 0, 0, []
    while number < NUM_STATES:
        ready, _, _ = select.select([connection], [], [], 0.001)
        if ready:
            request = connection.recv(1 << 16)
            if not request:
                break
            command, order, _ = struct.unpack_from("<III", request)
            requests.append(command)
            answer = b"\0" + urdf()
            if command == CONNECT:
                version, port = struct.unpack_from("<HH", request, 12)
                answer = struct.pack("<BH", 0, version)
            connection.sendall(struct.pack("<III", command, order, 12 + len(answer)) + answer)
        elif port:
            number += 1
            state = bytearray(STATE_SIZE)
            struct.pack_into("<Q", state, 0, number)
            for name, place in PLACES.items():
                struct.pack_into("<7f", state, place, *SIGNALS[name])
            state[MODE_AT] = MOVE if number < NUM_STATES - 20 else USER_STOPPED
            states.sendto(state, ("127.0.0.1", port))
    print(requests, flush=True)


@pytest.mark.skipif(find_spec("pylibfranka") is None, reason="the extra franka is not installed")
@pytest.mark.parametrize("torque", ["measured", "external"])
def test_a_robot_is_read_by_libfranka_and_asked_for_nothing_else(torque):
    try:
        peer = subprocess.Popen([sys.executable, __file__], stdout=subprocess.PIPE, text=True)
        if peer.stdout.readline() != "up\n":
            pytest.skip(f"port {FCI_PORT} is taken")
        source = open_source(f"franka://127.0.0.1?torque={torque}", Robot.load("panda"))
        samples, events = read_until(
            source, lambda _, events: events and events[-1].kind is EventKind.LOST
        )
        source.close()
        requests = peer.stdout.readline()
    finally:
        peer.kill()
        peer.wait()
        peer.stdout.close()
    assert requests == f"[{CONNECT}, {GET_MODEL}]\n"
    assert events[0].kind is EventKind.CONNECTED
    steps = np.diff([sample.t for sample in samples])
    assert len(samples) > 0.5 * NUM_STATES
    assert (steps > 0.0009).all()
    effort = SIGNALS["tau_J"] if torque == "measured" else -SIGNALS["tau_ext_hat_filtered"]
    for sample in samples:
        np.testing.assert_allclose(sample.q, SIGNALS["q"], rtol=1e-7)
        np.testing.assert_allclose(sample.v, SIGNALS["dq"], rtol=1e-7)
        np.testing.assert_allclose(sample.effort, effort, rtol=1e-7)
        assert sample.is_torque
        assert sample.is_external is (torque == "external")
    assert samples[0].running
    assert not samples[-1].running
    assert samples[-1].state == "UserStopped"


def test_a_robot_that_is_lost_comes_back():
    fails = [True, True, False, False]

    def opener(host):
        if fails.pop(0):
            raise RuntimeError("nobody\x1b there")
        return SimpleNamespace(read_once=read_once)

    left = [2, 1]

    def read_once():
        if not left[0]:
            left[0] = left.pop()
            raise RuntimeError("gone")
        left[0] -= 1
        time_of = SimpleNamespace(to_sec=lambda: 1.5)
        mode = SimpleNamespace(name="Reflex")
        return SimpleNamespace(time=time_of, robot_mode=mode, **SIGNALS)

    source = FrankaSource("h", False, opener)
    items = []
    while len(items) < 6:
        items += source.read(1.0)
    kinds = [getattr(item, "kind", None) for item in items]
    expected = [
        EventKind.REFUSED,
        EventKind.CONNECTED,
        None,
        None,
        EventKind.LOST,
        EventKind.CONNECTED,
    ]
    assert kinds == expected  # refused twice, said once
    assert "\x1b" not in items[0].text
    assert (items[2].t, items[2].running, items[2].state) == (1.5, False, "Reflex")
    source.close()
    assert source.read(0.0) == []


@pytest.mark.skipif(find_spec("pylibfranka") is None, reason="the extra franka is not installed")
def test_addresses_are_checked(ur10e):
    with pytest.raises(InputError, match="7 joints"):
        open_source("franka://h", ur10e)
    with pytest.raises(InputError, match="1337"):
        open_source("franka://h:80", Robot.load("panda"))


if __name__ == "__main__":
    with socket.socket() as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind(("127.0.0.1", FCI_PORT))
        except OSError:
            sys.exit("taken")
        listener.listen()
        print("up", flush=True)
        serve(listener.accept()[0])
