"""A Franka arm as a source, by its control interface (FCI): `franka://HOST`.

Option `torque`: `measured`, the joint torque tau_J in N m (`torque_per_ampere: 1` in robot.yaml),
or `external`, what the arm reports of it: tau_ext_hat_filtered is what the arm exerts against the
outside, and is turned. States are read and nothing else; control is never asked for.
"""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from wrenchsight.models.files.input_error import InputError, needing_extra, printable
from wrenchsight.models.live.samples import EventKind, Sample, StreamEvent
from wrenchsight.models.live.source import RETRY_TIME, SourceAddress
from wrenchsight.models.robot.robot import Robot

FCI_PORT = 1337  # of every FCI
_NUM_JOINTS = 7
_RUNS = ("Idle", "Move", "Guiding")


def connect(host: str) -> Any:
    """A `pylibfranka.Robot`, without a real-time kernel: who only reads needs none.

    It waits, in all threads of its process, until the robot answers or the system gives up.
    """
    import pylibfranka

    return pylibfranka.Robot(host, pylibfranka.RealtimeConfig.kIgnore)


class FrankaSource:
    """Reads states, connects again where the robot is lost, and reports it.

    Args:
        host: host of the robot's control.
        external: whether effort is the external torque.
        opener: opens a connection with `read_once`.
    """

    rate = 1.0
    step = 0.001

    def __init__(self, host: str, external: bool, opener: Callable[[str], Any] = connect) -> None:
        self._host, self._external, self._opener = host, external, opener
        self._robot: Any = None
        self._closed = False
        self._next_try = 0.0
        self._refusal = ""

    @classmethod
    def open(cls, address: SourceAddress, robot: Robot) -> "FrankaSource":
        """As `SourceOpener`."""
        with needing_extra("franka", "franka://"):
            import pylibfranka  # noqa: F401

        address.require_known("torque")
        if robot.num_joints != _NUM_JOINTS:
            problem = f"has {_NUM_JOINTS} joints, {robot.name} has {robot.num_joints}"
            raise InputError("franka://", "", f"a robot of this kind {problem}", "name that robot")
        host, port = address.host(FCI_PORT)
        if port != FCI_PORT:
            raise InputError(
                "franka://", "", f"is port {port}, expected none: it is always {FCI_PORT}"
            )
        return cls(host, address.wants_external_torque())

    def read(self, timeout: float) -> list[Sample | StreamEvent]:
        """As the protocol; a state is waited for by the library, for a second at most."""
        if self._closed:
            return []
        if self._robot is None:
            return self._connect(timeout)
        try:
            state = self._robot.read_once()
        except Exception as error:  # of any kind of the library's
            self._robot, self._next_try = None, time.monotonic() + RETRY_TIME
            return [
                self._event(EventKind.LOST, f"is lost ({printable(str(error))}); connecting again")
            ]
        return [self._sample(state)]

    def close(self) -> None:
        """As the protocol."""
        self._closed, self._robot = True, None

    def _event(self, kind: EventKind, text: str) -> StreamEvent:
        return StreamEvent(kind, f"{self._host} {text}", time.monotonic())

    def _connect(self, timeout: float) -> list[Sample | StreamEvent]:
        wait = self._next_try - time.monotonic()
        if wait > 0.0:
            time.sleep(min(wait, timeout))
            return []
        try:
            self._robot = self._opener(self._host)
        except Exception as error:  # of any kind of the library's
            self._next_try = time.monotonic() + RETRY_TIME
            previous_refusal, self._refusal = self._refusal, str(error)
            if previous_refusal == self._refusal:
                return []  # reported already
            return [
                self._event(
                    EventKind.REFUSED,
                    f"cannot be read ({printable(str(error))}); it is tried again",
                )
            ]
        self._refusal = ""
        return [self._event(EventKind.CONNECTED, "is read by FCI")]

    def _sample(self, state: Any) -> Sample:
        now, mode = time.monotonic(), state.robot_mode.name
        q, v = np.array(state.q, float), np.array(state.dq, float)
        external = -np.array(state.tau_ext_hat_filtered, float)
        effort = external if self._external else np.array(state.tau_J, float)
        running = mode in _RUNS
        word = "" if running else mode
        t = state.time.to_sec()
        return Sample(t, now, q, v, effort, True, running, word, is_external=self._external)
