"""What Foxglove is served, read by a client of its protocol over loopback."""

import base64
import json
import os
import socket
import struct
import time

import numpy as np
import pytest

pytest.importorskip("foxglove", reason="the extra view is not installed")

from wrenchsight.analyses.methods.watch.foxglove_view import FoxgloveView
from wrenchsight.models.live.reading import Reading

TEXT, BINARY = 1, 2


class Client:
    """Speaks foxglove.sdk.v1 by websocket (RFC 6455): subscribes, and gets messages."""

    def __init__(self, port):
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=10.0)
        self.file = self.socket.makefile("rb")
        key = base64.b64encode(os.urandom(16)).decode()
        self.socket.sendall(
            f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\n"
            f"Connection: Upgrade\r\nSec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n"
            "Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n".encode()
        )
        assert b"101" in self.file.readline()
        while self.file.readline().strip():
            pass

    def send(self, message):
        data = json.dumps(message).encode()
        assert len(data) < 1 << 16
        head = struct.pack(">BBH", 0x80 | TEXT, 0x80 | 126, len(data)) + bytes(4)  # a mask of zeros
        self.socket.sendall(head + data)

    def frame(self):
        first, size = self.file.read(2)
        assert first & 0x80
        if size >= 126:
            size = int.from_bytes(self.file.read(2 if size == 126 else 8), "big")
        return first & 0x0F, self.file.read(size)

    def told(self, op):
        while True:
            kind, data = self.frame()
            if kind == TEXT and (message := json.loads(data))["op"] == op:
                return message

    def subscribe(self, view):
        """The channels by topic, all subscribed to with their own ids."""
        channels = {channel["topic"]: channel for channel in self.told("advertise")["channels"]}
        ids = [channel["id"] for channel in channels.values()]
        ids.sort(key=channels["/arm"]["id"].__eq__)  # the arm's last: of it the view is told
        wanted = [{"id": one, "channelId": one} for one in ids]
        self.send({"op": "subscribe", "subscriptions": wanted})
        end = time.monotonic() + 10.0
        while not view._listener.wants_arm:
            assert time.monotonic() < end
            time.sleep(0.01)
        return channels

    def messages(self, counts):
        """So many messages of each channel: log time in ns, and what is in them."""
        messages = {one: [] for one in counts}
        while any(len(messages[one]) < count for one, count in counts.items()):
            kind, data = self.frame()
            if kind == BINARY and data[0] == 1:
                channel, log_time = struct.unpack_from("<IQ", data, 1)
                messages.setdefault(channel, []).append((log_time, data[13:]))
        return messages


def protobuf(data):
    """The fields of a message by number, each a list."""
    fields, place = {}, 0

    def varint():
        nonlocal place
        value, shift = 0, 0
        while True:
            byte = data[place]
            value, shift, place = value | (byte & 127) << shift, shift + 7, place + 1
            if byte < 128:
                return value

    while place < len(data):
        key = varint()
        size = {1: 8, 2: None, 5: 4}.get(key & 7)
        if key & 7 == 0:
            fields.setdefault(key >> 3, []).append(varint())
            continue
        size = varint() if size is None else size
        fields.setdefault(key >> 3, []).append(data[place : place + size])
        place += size
    return fields


def doubles(data, count):
    """The first fields of a message of doubles, which are left out where they are 0."""
    held = protobuf(data)
    return [struct.unpack("<d", held[k][0])[0] if k in held else 0.0 for k in range(1, count + 1)]


@pytest.fixture
def view(ur10e):
    made = FoxgloveView(ur10e, port=0)
    yield made
    made.close()


def readings(ur10e, count):
    q = np.add(ur10e.home, [0.3, 0.1, -0.2, 0.0, 0.4, 0.0])
    tau_ext = np.arange(1.0, 7.0)
    for k in range(count):
        wrench = np.array([0.1, 0.2, 0.3, 0.0, 0.0, 100.0 + k])
        covariance = np.diag([np.inf, 4.0, 1.0, 9.0, 1.0, 16.0])
        yield Reading.of(wrench, covariance, tau_ext, q, t=5.25 + k, running=1.0)


def test_a_client_gets_plots_and_a_scene(ur10e, view):
    host, port = view.url.removeprefix("ws://").split(":")
    assert host == "127.0.0.1"
    client = Client(int(port))
    assert client.told("serverInfo")["capabilities"] == []  # nothing is taken from a client
    channels = client.subscribe(view)
    arm, wrench = channels["/arm"]["id"], channels["/wrench"]["id"]
    rows = [reading.row for reading in readings(ur10e, 3)]
    view.take(rows)
    counts = {channels[topic]["id"]: 1 for topic in ("/arm", "/tf", "/force")}
    counts |= {wrench: 3, channels["/joints"]["id"]: 3}
    messages = client.messages(counts)

    assert [log_time for log_time, _ in messages[wrench]] == [
        5_250_000_000,
        6_250_000_000,
        7_250_000_000,
    ]
    values = json.loads(messages[wrench][1][1])
    assert (values["fz"], values["sd_fz"], values["valid"]) == (101.0, 4.0, 1)
    assert values["sd_mx"] is None
    assert values["fault"] == 0
    assert set(values) == set(json.loads(channels["/wrench"]["schema"])["properties"])

    states = protobuf(messages[channels["/joints"]["id"]][0][1])
    names = [protobuf(joint)[1][0].decode() for joint in states[2]]
    assert names == list(ur10e.joint_names)

    q = Reading(rows[0]).q
    _, p_WE = ur10e.chain.pose(q[None])
    placed = {
        protobuf(one)[3][0].decode(): protobuf(one)
        for one in protobuf(messages[channels["/tf"]["id"]][0][1])[1]
    }
    np.testing.assert_allclose(doubles(placed["E_W"][4][0], 3), p_WE[0], atol=1e-12)
    shapes = [protobuf(one) for one in protobuf(messages[arm][0][1])[2]]
    frames = {shape[2][0].decode() for shape in shapes}
    assert len(frames) > 5
    assert frames <= set(placed)

    (force,) = protobuf(messages[channels["/force"]["id"]][0][1])[2]
    arrow = protobuf(protobuf(force)[7][0])
    x, y, z, w = doubles(protobuf(arrow[1][0])[2][0], 4)
    along = [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)]
    np.testing.assert_allclose(along, [0.0, 0.0, 1.0], atol=1e-12)
    lengths = [struct.unpack("<d", arrow[k][0])[0] for k in (2, 4)]
    assert sum(lengths) == pytest.approx(0.005 * 102.0)

    late = Client(int(port))  # the shapes are sent once more
    late.subscribe(view)
    view.take(rows[2:])
    assert late.messages({arm: 1})


def test_a_client_that_reads_nothing_makes_nobody_wait(ur10e, view):
    port = int(view.url.rpartition(":")[2])
    slow, quick = Client(port), Client(port)
    slow.subscribe(view)
    view._listener.wants_arm = False
    channels = quick.subscribe(view)
    rows = [reading.row for reading in readings(ur10e, 50)]
    wrench = channels["/wrench"]["id"]
    for _ in range(100):
        view.take(rows)
        messages = quick.messages({wrench: 50})
    assert json.loads(messages[wrench][-1][1])["fz"] == 149.0


def test_a_taken_port_is_no_hindrance(ur10e, view):
    other = FoxgloveView(ur10e, port=int(view.url.rpartition(":")[2]))
    assert other.url != view.url
    other.close()
