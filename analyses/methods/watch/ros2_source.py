"""A topic of sensor_msgs/JointState as a source: `ros2://TOPIC`; no ROS is needed.

Options: `domain` (that of ROS_DOMAIN_ID, or 0); `network` (an interface such as eth0, or any; else
this computer's loopback); `effort` (torque in N m, current in A; else gravity decides, as in logs).
Joints are found by their names. The sample's time is the header's stamp.
"""

import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from cyclonedds.core import DDSException

from wrenchsight.analyses.methods.watch.ros2_dds import OPTIONS, TopicReader, join, topic_name
from wrenchsight.models.live.samples import EventKind, Sample, StreamEvent
from wrenchsight.models.live.source import MOST_ITEMS, SourceAddress
from wrenchsight.models.live.stream_order import SAY_AGAIN
from wrenchsight.models.recordings.plausibility.effort_unit import effort_unit
from wrenchsight.models.recordings.plausibility.product_sums import telling_joints
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.rosbag.messages import JOINT_STATE, QUANTITIES, typestore
from wrenchsight.models.robot.robot import Robot

EFFORTS = ("found", "torque", "current")
WAIT_TIME = 1.0  # s without a publisher, after which an event reports it
UNIT_TIME, UNIT_SAMPLES = 0.5, 25  # s and samples from which gravity decides the effort's unit
LONGEST_UNIT_TIME = 3.0  # s, where it cannot decide earlier
REMEDIES = {"N m": "?effort=torque", "A": "?effort=current"}


class Ros2Source:
    """Reads one topic.

    Args:
        participant: participant of DDS; the topic is subscribed to when it is first read.
        topic: its name.
        robot: whose joints are looked for.
        effort: one of EFFORTS.
    """

    rate = 1.0
    step = None

    def __init__(self, participant: Any, topic: str, robot: Robot, effort: str) -> None:
        self._participant, self._topic, self._robot = participant, topic, robot
        self._reader: TopicReader | None = None
        self._is_torque = None if effort == "found" else effort == "torque"
        self._waiting: list[Sample] = []  # until the unit is known
        self._unit_time = UNIT_TIME if telling_joints(robot).any() else 0.0
        self._names: list[str] = []
        self._places: list[int] | None = None
        self._is_publishing = self._closed = False
        self._counts: Counter[str] = Counter()
        self._event_times: dict[str, float] = {}
        self._begin = 0.0  # s, from which on a publisher is waited for
        self._left: list[Sample | StreamEvent] = []  # of the last `read`, beyond MOST_ITEMS

    @classmethod
    def open(cls, address: SourceAddress, robot: Robot) -> "Ros2Source":
        """As `SourceOpener`."""
        address.require_known("effort", *OPTIONS)
        topic, effort = topic_name(address), address.choice("effort", EFFORTS)
        return cls(join(address), topic, robot, effort)

    def read(self, timeout: float) -> list[Sample | StreamEvent]:
        """As `Source.read`; the topic is joined at the first call.

        Without a publisher for WAIT_TIME s an event says so, again and again.
        """
        if self._closed:
            return []
        if self._left:
            first, self._left = self._left[:MOST_ITEMS], self._left[MOST_ITEMS:]
            return first
        items: list[Sample | StreamEvent] = []
        try:
            if self._reader is None:
                self._reader = TopicReader(self._participant, self._topic, JOINT_STATE)
                self._begin = time.monotonic()
            received = self._reader.take(timeout)
        except DDSException as error:
            self._say(items, EventKind.LOST, f"cannot be read ({error})")
            time.sleep(timeout)
            return items
        now = time.monotonic()
        for data in received:  # bytes of a message; None: the last publisher has gone
            if data is None:
                self._is_publishing, self._begin = False, now
                self._say(items, EventKind.LOST, "no publisher any more; waiting for one")
            else:
                self._take(data, now, items)
        if not self._is_publishing and now - self._begin > WAIT_TIME:
            self._begin = now
            text = "no publisher of JointStates: check topic, domain and network; waiting for one"
            self._say(items, EventKind.REFUSED, text)
        # Once the unit is known, all that waited for it comes beside the newest messages.
        self._left = items[MOST_ITEMS:]
        return items[:MOST_ITEMS]

    def close(self) -> None:
        """As the protocol."""
        self._closed = True

    def _say(self, items: list[Sample | StreamEvent], kind: EventKind, text: str) -> None:
        """Adds an event of the topic, at most one of a text each SAY_AGAIN; all are counted."""
        now = time.monotonic()
        if len(self._counts) > MOST_ITEMS:
            self._counts.clear()
            self._event_times.clear()
        self._counts[text] += 1
        if now - self._event_times.get(text, -SAY_AGAIN) >= SAY_AGAIN:
            self._event_times[text] = now
            items.append(StreamEvent(kind, f"{self._topic}: {text}", now, self._counts[text]))

    def _take(self, data: bytes, now: float, items: list[Sample | StreamEvent]) -> None:
        try:
            message = typestore().deserialize_cdr(data, JOINT_STATE)
            sample = self._sample(message, now)
        except Exception as error:  # rosbags raises any kind over damaged bytes
            reason = str(error) if isinstance(error, _RefusedError) else "bytes of no JointState"
            self._say(items, EventKind.RECIPE, f"{reason}; it is left out")
            return
        if sample is None:  # of a gripper, or another arm
            return
        if not self._is_publishing:
            self._is_publishing = True
            text = f"{self._topic}: {len(sample.q)} of {len(self._names)} joints"
            items.append(StreamEvent(EventKind.CONNECTED, text, now))
        if self._is_torque is not None:
            items.append(sample)
            return
        self._waiting.append(sample)
        oldest = self._waiting[0]
        span = max(abs(sample.t - oldest.t), now - oldest.received)
        if len(self._waiting) >= UNIT_SAMPLES and span >= self._unit_time:
            items += self._settle(span, now)

    def _settle(self, span: float, now: float) -> list[Sample | StreamEvent]:
        """Decides whether effort is torque or current, as the reader of logs does."""
        waiting = self._waiting
        t = np.array([sample.t for sample in waiting])
        q = np.array([sample.q for sample in waiting])
        v = np.array([sample.v for sample in waiting])
        effort = np.array([sample.effort for sample in waiting])
        unit = effort_unit([Recording(t, q, v, effort, self._topic, effort)], self._robot)
        if not unit.unit and self._unit_time and span < LONGEST_UNIT_TIME:
            self._unit_time = span + UNIT_TIME
            return []
        self._waiting, self._is_torque = [], unit.unit != "A"
        text = f"{self._topic}: {unit.sentence(self._robot, REMEDIES)}"
        samples = [replace(sample, is_torque=self._is_torque) for sample in waiting]
        return [StreamEvent(EventKind.CHECK, text, now), *samples]

    def _sample(self, message: Any, now: float) -> Sample | None:
        if message.name != self._names:
            self._names = list(message.name)
            self._places = self._find_joints(self._names)
        if self._places is None:
            return None
        for quantity in QUANTITIES:
            if len(getattr(message, quantity)) != len(self._names):
                raise _RefusedError(f"a message without {quantity} of each joint")
        stamp = message.header.stamp
        if not (stamp.sec or stamp.nanosec):
            raise _RefusedError("a message without a time stamp")
        q, v, effort = (getattr(message, name)[self._places] for name in QUANTITIES)
        t = (stamp.sec * 10**9 + stamp.nanosec) / 1e9
        return Sample(t, now, q, v, effort, self._is_torque is not False)

    def _find_joints(self, names: Sequence[str]) -> list[int] | None:
        """Indices of the robot's joints among the names; None where none is there."""
        joint_names = self._robot.joint_names
        missing = [name for name in joint_names if names.count(name) != 1]
        if len(missing) == len(joint_names):
            return None
        if missing:
            self._names = []  # the next message is checked again
            raise _RefusedError(f'a message that does not name the joint "{missing[0]}" once')
        return [names.index(name) for name in joint_names]


class _RefusedError(Exception):
    """A message that is no sample."""
