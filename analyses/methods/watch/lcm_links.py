"""LCM as Drake speaks it: status messages of an iiwa or a Panda in, forces and torques out.

Source: `lcm://CHANNEL`, options `robot` (iiwa or panda), `url`, LCM's own (its default keeps to
this computer), and `torque`: `measured`, joint torque in N m (`torque_per_ampere: 1` in
robot.yaml), or `external`, as the arm reports it. A Panda's driver hands on tau_ext_hat_filtered,
what the arm exerts against the outside: it is turned. An iiwa's acts on the arm.

Publisher: `lcm://CHANNEL`, as `drake.lcmt_force_torque`: at E in axes of W, environment on robot,
at the controller's time in us. It has no place for a flag: readings that are not valid are not
sent.
"""

import struct
import time
from dataclasses import replace

import numpy as np
from drake import lcmt_force_torque, lcmt_iiwa_status, lcmt_panda_status
from pydrake.lcm import DrakeLcm, DrakeLcmInterface

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.live.reading import Reading
from wrenchsight.models.live.samples import EventKind, Sample, StreamEvent
from wrenchsight.models.live.source import MOST_ITEMS, SourceAddress
from wrenchsight.models.robot.robot import Robot

ROBOTS = ("iiwa", "panda")
_PANDA_RUNS = (1, 2, 3)  # idle, move, guiding, as libfranka's RobotMode
_PANDA_MODES = {0: "other", 4: "reflex", 5: "user stop", 6: "error recovery"}
_DAMAGED = (ValueError, struct.error, IndexError, OverflowError, MemoryError, TypeError)


def open_lcm(address: SourceAddress) -> DrakeLcmInterface:
    """LCM at the address's url.

    Raises:
        InputError: there is no such.
    """
    if not address.place or not address.place.isprintable() or len(address.place) > 63:
        raise InputError("lcm://", "", "names no channel", "such as lcm://IIWA_STATUS")
    try:
        return DrakeLcm(address.options.get("url", ""))
    except RuntimeError as error:
        raise InputError("lcm://", "url", f"cannot be opened ({error})") from None


class LcmSource:
    """Reads one channel.

    Args:
        lcm: where it is.
        channel: its name.
        kind: whose status it bears, one of ROBOTS.
        external: whether effort is the external torque.
    """

    rate = 1.0
    step = None

    def __init__(
        self, lcm: DrakeLcmInterface, channel: str, kind: str, external: bool = False
    ) -> None:
        self._lcm, self._kind, self._external = lcm, kind, external
        self._items: list[Sample | StreamEvent] = []
        self._seen = self._closed = False
        self._damaged = 0
        self._channel = channel
        self._subscribed = False  # only when it is first read: what waited till then would be old

    @classmethod
    def open(cls, address: SourceAddress, robot: Robot) -> "LcmSource":
        """As `SourceOpener`."""
        address.require_known("robot", "url", "torque")
        kind, external = address.choice("robot", ROBOTS), address.wants_external_torque()
        return cls(open_lcm(address), address.place, kind, external)

    def read(self, timeout: float) -> list[Sample | StreamEvent]:
        """As the protocol."""
        if self._closed:
            return []
        if not self._subscribed:
            self._subscribed = True
            self._lcm.Subscribe(self._channel, self._take)
        self._lcm.HandleSubscriptions(max(0, round(1e3 * timeout)))
        items, self._items = self._items[:MOST_ITEMS], self._items[MOST_ITEMS:]
        return items

    def close(self) -> None:
        """As the protocol."""
        self._closed = True

    def _take(self, data: bytes) -> None:
        now = time.monotonic()
        if len(self._items) >= 2 * MOST_ITEMS:
            return  # nobody reads
        try:
            sample = self._sample(data, now)
        except _DAMAGED:
            self._damaged += 1
            text = f"{self._channel}: a message that is no status of {self._kind}; it is left out"
            self._items.append(StreamEvent(EventKind.RECIPE, text, now, self._damaged))
            return
        if not self._seen:
            self._seen = True
            text = f"{self._channel}: {self._kind}, {len(sample.q)} joints"
            self._items.append(StreamEvent(EventKind.CONNECTED, text, now))
        self._items.append(sample)

    def _sample(self, data: bytes, now: float) -> Sample:
        """The sample of a message; a Panda states its external torque with the other sign.

        Its effort is the joint torque, and the external torque comes with it, with its sign as
        sent; or, if the source was opened so, the effort is the external torque, positive along the
        motion that it causes.

        Args:
            now: s, when it was received.

        Raises:
            ValueError: signals of different lengths.
        """
        running, state = True, ""  # an iiwa's status has no mode
        if self._kind == "iiwa":
            message = lcmt_iiwa_status.decode(data)
            signals = (
                message.joint_position_measured,
                message.joint_velocity_estimated,
                message.joint_torque_measured,
            )
        else:
            message = lcmt_panda_status.decode(data)
            signals = (message.joint_position, message.joint_velocity, message.joint_torque)
            running = message.robot_mode in _PANDA_RUNS
            mode = f"mode {message.robot_mode}"
            state = "" if running else _PANDA_MODES.get(message.robot_mode, mode)
        q, v, tau = (np.array(signal, float) for signal in signals)
        if not q.shape == v.shape == tau.shape:
            raise ValueError("signals of different lengths")
        stated_external = np.array(message.joint_torque_external, float)  # its sign as sent
        sample = Sample(
            t=1e-6 * message.utime,
            received=now,
            q=q,
            v=v,
            effort=tau,
            is_torque=True,
            running=running,
            state=state,
        )
        if not self._external:
            return replace(sample, more={"external_torque": stated_external})
        if stated_external.shape != q.shape:
            raise ValueError("no external torque of each joint")
        tau_ext = -stated_external if self._kind == "panda" else stated_external
        return replace(sample, effort=tau_ext, is_external=True)


class LcmPublisher:
    """Sends valid readings.

    Args:
        lcm: where to.
        channel: its name.

    Attributes:
        lost: readings that could not be sent.
    """

    def __init__(self, lcm: DrakeLcmInterface, channel: str) -> None:
        self._lcm, self._channel = lcm, channel
        self.lost = 0

    @classmethod
    def open(cls, address: SourceAddress, robot: Robot) -> "LcmPublisher":
        """From its address.

        Raises:
            InputError: as `open_lcm`.
        """
        address.require_known("url")
        return cls(open_lcm(address), address.place)

    def send(self, reading: Reading) -> None:
        """As `publishers.Publisher`."""
        if not reading.valid:
            return
        message = lcmt_force_torque()
        message.timestamp = round(1e6 * reading.t)
        message.tx, message.ty, message.tz, message.fx, message.fy, message.fz = (
            reading.wrench.tolist()
        )
        try:
            self._lcm.Publish(self._channel, message.encode())
        except (RuntimeError, struct.error):
            self.lost += 1

    def close(self) -> None:
        """As `publishers.Publisher`."""
