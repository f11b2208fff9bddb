"""Readings on ROS 2, as a force/torque sensor's broadcaster sends them: `ros2://TOPIC`.

- TOPIC: geometry_msgs/WrenchStamped, valid readings only, environment on robot at E;
- TOPIC/covariance: std_msgs/Float64MultiArray, 6 x 6, force first, beside each;
- TOPIC/status: diagnostic_msgs/DiagnosticArray, where it changes and ten times a second;
- tf: where the wrench's frame E_W (E's origin, W's axes) is.

Options: `domain` and `network` as the source's; `frame`: the name that this frame has in your URDF;
wrench and covariance are then in axes of E, and no tf is sent; `stamp`: source (the sample's own
time), or computer (when it came, for a robot whose clock is not ROS').
"""

import re
import time
from typing import Any

import numpy as np

from wrenchsight.analyses.methods.watch.ros2_dds import OPTIONS, TopicWriter, join, topic_name
from wrenchsight.models.estimation.wrench_bag import (
    COVARIANCE,
    FRAME,
    TF,
    WrenchMessages,
)
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.live.reading import FLAGS, Reading
from wrenchsight.models.live.source import SourceAddress
from wrenchsight.models.recordings.rosbag.messages import STAMP_END, WRENCH, header, typestore
from wrenchsight.models.robot.robot import Robot

STATUS = "diagnostic_msgs/msg/DiagnosticArray"
STATUS_TIME = 0.1  # s between two statuses of one kind
_NAME = re.compile(r"[\w/.-]{1,200}", re.ASCII)


class Ros2Publisher:
    """Sends readings.

    Args:
        participant: participant of DDS.
        topic: topic of the wrench.
        frame: name of E's frame; "": E_W is made.
        by_computer: whether stamps are this computer's time.

    Attributes:
        lost: readings that could not be sent.
    """

    def __init__(
        self, participant: Any, topic: str, robot: Robot, frame: str = "", by_computer: bool = False
    ) -> None:
        self._robot, self._frame = robot, frame
        self._by_computer = by_computer
        self._messages = WrenchMessages(robot.config.base_link, frame or FRAME)
        kinds = {topic: WRENCH, f"{topic}/covariance": COVARIANCE, "tf": TF}
        if frame:
            del kinds["tf"]
        # by kind, as `WrenchMessages` has them
        self._writers = {kind: TopicWriter(participant, name, kind) for name, kind in kinds.items()}
        self._status = TopicWriter(participant, f"{topic}/status", STATUS)
        self._published_state: tuple[float, ...] = ()
        self._published_at = 0.0
        self.lost = 0

    @classmethod
    def open(cls, address: SourceAddress, robot: Robot) -> "Ros2Publisher":
        """From its address.

        Raises:
            InputError: it is none.
        """
        address.require_known("frame", "stamp", *OPTIONS)
        frame = address.options.get("frame", "")
        if frame and not _NAME.fullmatch(frame):
            raise InputError("ros2://", "frame", f'"{frame}" is no name of a frame')
        by_computer = address.choice("stamp", ("source", "computer")) == "computer"
        return cls(join(address), topic_name(address), robot, frame, by_computer)

    def send(self, reading: Reading) -> None:
        """As `publishers.Publisher`."""
        stamp = round(1e9 * reading.t) if np.isfinite(reading.t) else -1
        if self._by_computer:
            stamp = time.time_ns() - round(1e9 * (time.monotonic() - reading.received))
        if not 0 <= stamp < STAMP_END * 10**9:
            self.lost += 1
            return
        sent = self._send_status(reading, stamp)
        if reading.valid:
            R_WE, p_WE = self._robot.chain.pose(reading.q[None])
            wrench, covariance = reading.wrench[None], reading.covariance[None]
            if self._frame:
                turn = np.kron(np.eye(2), R_WE[0].T)
                wrench, covariance = wrench @ turn.T, turn @ covariance @ turn.T
            parts = self._messages.encode(np.array([stamp]), wrench, covariance, p_WE)
            for _, kind, messages in parts:
                if kind in self._writers:
                    sent &= self._writers[kind].write(messages.tobytes())
        self.lost += not sent

    def close(self) -> None:
        """As `publishers.Publisher`."""

    def _send_status(self, reading: Reading, stamp: int) -> bool:
        state = tuple(float(getattr(reading, flag)) for flag in FLAGS)
        now = time.monotonic()
        if state == self._published_state and now - self._published_at < STATUS_TIME:
            return True
        self._published_state, self._published_at = state, now
        types = typestore().types
        pair, level = types["diagnostic_msgs/msg/KeyValue"], 0 if reading.valid else 1
        values = [pair(name, f"{value:g}") for name, value in zip(FLAGS, state, strict=True)]
        word = "valid" if reading.valid else f"not valid: {reading.reason}"
        status = types["diagnostic_msgs/msg/DiagnosticStatus"]
        message_status = status(level, "wrenchsight", word, self._robot.name, values)
        status_header = header("", 0)
        status_header.stamp.sec, status_header.stamp.nanosec = divmod(stamp, 10**9)
        message = types[STATUS](status_header, [message_status])
        return self._status.write(bytes(typestore().serialize_cdr(message, STATUS)))
