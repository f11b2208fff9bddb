"""Wrenches through MCAP: exact, in a frame, with their covariance; rosbags deserialises."""

from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from wrenchsight.models.estimation.wrench_bag import FRAME, WrenchBagWriter, read_wrench_bag
from wrenchsight.models.files.input_error import InputError

_ROWS = 300


def _written(path: Path, start: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(5)
    t = start + np.round(0.002 * np.arange(_ROWS), 6)
    wrench = rng.normal(size=(_ROWS, 6)) * 10.0 ** rng.integers(-9, 9, (_ROWS, 6))
    root = rng.normal(size=(_ROWS, 6, 6))
    covariance = root @ root.transpose(0, 2, 1)
    p_WE = rng.normal(size=(_ROWS, 3))
    with WrenchBagWriter(path, "base_link") as writer:
        for part in (slice(0, 100), slice(100, 101), slice(101, None)):
            writer.write(t[part], wrench[part], covariance[part], p_WE[part])
    return t, wrench, covariance, p_WE


@pytest.mark.parametrize("start", [0.0, 1_700_000_000.0])
def test_the_round_trip_is_exact(tmp_path: Path, start: float) -> None:
    path = tmp_path / "wrench.mcap"
    t, wrench, _, _ = _written(path, start)
    again = read_wrench_bag(path)
    np.testing.assert_array_equal(again[0], t)
    np.testing.assert_array_equal(again[1], wrench)
    assert [file.name for file in tmp_path.iterdir()] == ["wrench.mcap"]


def test_the_messages_are_what_ros_expects(tmp_path: Path) -> None:
    path = tmp_path / "wrench.mcap"
    t, wrench, covariance, p_WE = _written(path, 1_700_000_000.0)
    types = get_typestore(Stores.ROS2_HUMBLE)
    seen: dict[str, list[Any]] = {}
    with Reader(path) as reader:
        for connection, stamp, data in reader.messages():
            message = types.deserialize_cdr(data, connection.msgtype)
            seen.setdefault(connection.topic, []).append((stamp, message))
    assert {topic: len(messages) for topic, messages in seen.items()} == dict.fromkeys(
        ("/tf", "/wrench", "/wrench/covariance"), _ROWS
    )
    k = 123
    stamp, message = seen["/wrench"][k]
    assert stamp == round(Fraction(float(t[k])) * 10**9)
    assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == stamp
    assert message.header.frame_id == FRAME
    force, torque = message.wrench.force, message.wrench.torque
    np.testing.assert_array_equal(
        [torque.x, torque.y, torque.z, force.x, force.y, force.z], wrench[k]
    )
    (transform,) = seen["/tf"][k][1].transforms
    assert (transform.header.frame_id, transform.child_frame_id) == ("base_link", FRAME)
    assert transform.header.stamp.nanosec == message.header.stamp.nanosec
    place = transform.transform.translation
    np.testing.assert_array_equal([place.x, place.y, place.z], p_WE[k])
    assert transform.transform.rotation.w == 1.0
    layout = seen["/wrench/covariance"][k][1]
    assert [side.size for side in layout.layout.dim] == [6, 6]
    sigma = np.asarray(layout.data).reshape(6, 6)
    np.testing.assert_array_equal(sigma[:3, :3], covariance[k, 3:, 3:])  # force first
    np.testing.assert_array_equal(sigma[:3, 3:], covariance[k, 3:, :3])


def test_the_last_time_that_a_stamp_holds_comes_back(tmp_path: Path) -> None:
    """Its seconds are an int32: a second later they would count from -2^31."""
    path, last = tmp_path / "wrench.mcap", 2.0**31 - 1.0
    zeros = np.zeros((1, 6)), np.zeros((1, 6, 6)), np.zeros((1, 3))
    with WrenchBagWriter(path, "base_link") as writer:
        writer.write(np.array([last]), *zeros)
    assert read_wrench_bag(path)[0].tolist() == [last]
    with (
        pytest.raises(InputError, match="a stamp of ROS"),
        WrenchBagWriter(path, "base_link") as writer,
    ):
        writer.write(np.array([last + 1.0]), *zeros)


def test_a_failure_leaves_nothing(tmp_path: Path) -> None:
    path = tmp_path / "wrench.mcap"
    path.write_text("earlier")
    with (
        pytest.raises(InputError, match="a stamp of ROS"),
        WrenchBagWriter(path, "base_link") as writer,
    ):
        writer.write(np.array([-1.0]), np.zeros((1, 6)), np.zeros((1, 6, 6)), np.zeros((1, 3)))
    assert path.read_text() == "earlier"
    assert [file.name for file in tmp_path.iterdir()] == ["wrench.mcap"]


def test_another_topic(tmp_path: Path) -> None:
    path = tmp_path / "wrench.mcap"
    _written(path, 0.0)
    with pytest.raises(InputError, match="/ft: is no topic of wrenches"):
        read_wrench_bag(path, "/ft")
