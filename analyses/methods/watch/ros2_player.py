"""A recording as a robot's JointStates on ROS 2, at real time."""

import time
from collections.abc import Callable

import numpy as np

from wrenchsight.analyses.methods.watch.ros2_dds import OPTIONS, TopicWriter, join, topic_name
from wrenchsight.models.live.source import SourceAddress
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.rosbag.messages import (
    JOINT_STATE,
    Layout,
    header,
    nanoseconds,
    typestore,
)
from wrenchsight.models.robot.robot import Robot

_POLL_PERIOD = 0.05  # s between two looks for a subscriber
_LAST_WAIT = 0.5  # s after the last message, in which what is on its way arrives


def play_joint_states(
    recording: Recording, robot: Robot, address: SourceAddress, tell: Callable[[str], None]
) -> None:
    """Plays a recording as JointStates, once, from the first subscriber on; returns at its end.

    Stamps are ROS' own: this computer's time. Efforts are torques, as sensor_msgs/JointState has
    them; `effort=current` sends currents, as some drivers do.

    Args:
        recording: recording of currents.
        robot: whose joints are named.
        address: ros2://TOPIC, options `domain`, `network`, `effort`.
        tell: what a person is to know.

    Raises:
        InputError: an address that is none.
    """
    address.require_known("effort", *OPTIONS)
    is_torque = address.choice("effort", ("torque", "current")) == "torque"
    topic = topic_name(address)
    effort = robot.joint_torque(recording.current) if is_torque else recording.current
    writer = TopicWriter(join(address), topic, JOINT_STATE)
    values = np.concatenate([recording.q, recording.v, effort], axis=1)
    names, joint_state = list(robot.joint_names), typestore().types[JOINT_STATE]

    def message(stamp: int, number: float) -> object:
        """One of these sizes; `Layout` finds from it where stamp and numbers lie in the bytes."""
        numbers = np.full(len(names), number)
        base_link = robot.config.base_link
        return joint_state(header(base_link, stamp), names, numbers, numbers, numbers)

    layout = Layout(JOINT_STATE, message)  # encodes (stamps, values); values are q, v, effort
    tell(f"plays {recording.duration:.1f} s once a client reads {topic}; Ctrl-C ends it")
    while not writer.is_read:
        time.sleep(_POLL_PERIOD)
    begin, elapsed = time.time(), recording.t - recording.t[0]  # s, by the clock of the stamps
    stamps = nanoseconds(begin + elapsed)
    for k, due in enumerate(elapsed.tolist()):
        time.sleep(max(0.0, begin + due - time.time()))
        writer.write(layout.encode(stamps[k : k + 1], values[k : k + 1]).tobytes())
    time.sleep(_LAST_WAIT)
