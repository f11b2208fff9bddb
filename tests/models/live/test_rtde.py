"""RTDE packets against bytes written by hand from the protocol's guide."""

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wrenchsight.models.live.rtde import (
    PacketReader,
    PacketType,
    ProtocolError,
    Recipe,
    outputs_request,
    packet,
    read_control_version,
    read_outputs_request,
)


def test_requests_are_the_bytes_of_the_guide():
    assert packet(PacketType.PROTOCOL_VERSION, b"\x00\x02") == b"\x00\x05V\x00\x02"
    # 500.0 is 0x407F400000000000
    assert outputs_request(500.0, ["timestamp", "actual_q"]) == (
        b"\x00\x1dO\x40\x7f\x40\x00\x00\x00\x00\x00timestamp,actual_q"
    )
    assert packet(PacketType.START) == b"\x00\x03S"
    assert read_control_version(struct.pack(">4I", 5, 11, 6, 12)) == (5, 11, 6, 12)


def test_names_may_end_with_a_comma():
    # As the bindings ur_rtde 1.6 send them.
    payload = struct.pack(">d", 125.0) + b"timestamp,actual_q,"
    assert read_outputs_request(payload) == (125.0, ["timestamp", "actual_q"])


def test_a_data_packet_is_read_field_by_field():
    names = ["timestamp", "actual_q", "robot_mode", "runtime_state"]
    recipe = Recipe.read(b"\x07DOUBLE,VECTOR6D,INT32,UINT32", names)
    q = [0.1, -0.2, 0.3, -0.4, 0.5, -0.6]
    payload = struct.pack(">Bd6diI", 7, 12.002, *q, -1, 2)
    numbers = recipe.decode(payload)
    assert numbers is not None
    assert recipe.part(numbers, "timestamp").tolist() == [12.002]
    assert recipe.part(numbers, "actual_q").tolist() == q
    assert recipe.part(numbers, "robot_mode").tolist() == [-1.0]
    assert recipe.encode([12.002, *q, -1, 2])[3:] == payload
    assert recipe.decode(b"\x08" + payload[1:]) is None
    with pytest.raises(ProtocolError):
        recipe.decode(payload[:-1])


def test_fields_that_the_controller_lacks_are_named():
    recipe = Recipe.read(b"\x01DOUBLE,NOT_FOUND", ["timestamp", "actual_current_as_torque"])
    assert recipe.missing == ("actual_current_as_torque",)
    for answer in (b"", b"\x01DOUBLE", b"\x01DOUBLE,FLOAT", b"\x01" + b"\xff" * 9):
        with pytest.raises(ProtocolError):
            Recipe.read(answer, ["timestamp", "actual_q"])


@pytest.mark.parametrize("cut", [1, 2, 3, 7, 1000])
def test_packets_come_in_any_pieces(cut):
    sent = [(PacketType.TEXT, b"x" * 300), (PacketType.DATA, b""), (PacketType.DATA, b"\x01ab")]
    data = b"".join(packet(kind, payload) for kind, payload in sent)
    reader = PacketReader()
    packets = [p for k in range(0, len(data), cut) for p in reader.feed(data[k : k + cut])]
    assert packets == sent


@pytest.mark.parametrize("data", [b"\x00\x02U", b"\x00\x04?a", b"HTTP/1.1 400"])
def test_bytes_that_are_no_packet_are_refused(data):
    with pytest.raises(ProtocolError):
        list(PacketReader().feed(data))


@settings(max_examples=200, deadline=None)
@given(st.lists(st.binary(max_size=40), max_size=8))
def test_no_bytes_raise_anything_else(parts):
    reader = PacketReader()
    recipe = Recipe(1, ("timestamp", "actual_q"), ("DOUBLE", "VECTOR6D"))
    try:
        for part in parts:
            for kind, payload in reader.feed(part):
                if kind is PacketType.DATA:
                    recipe.decode(payload)
                elif kind is PacketType.OUTPUTS:
                    read_outputs_request(payload)
                    Recipe.read(payload, ["timestamp"])
    except ProtocolError:
        pass


def test_a_type_that_is_none_is_named_with_its_field():
    with pytest.raises(ProtocolError, match="actual_q as 'FLOAT6', which is no type"):
        Recipe.read(b"\x01DOUBLE,FLOAT6", ["timestamp", "actual_q"])


def test_a_recipe_round_trips_with_numbers_that_are_none():
    recipe = Recipe(1, ("timestamp", "actual_q"), ("DOUBLE", "VECTOR6D"))
    values = [1.0, np.nan, np.inf, 0.1, 0.2, 0.3, 0.4]
    numbers = recipe.decode(recipe.encode(values)[3:])
    assert numbers is not None
    np.testing.assert_array_equal(numbers[1:], values)
