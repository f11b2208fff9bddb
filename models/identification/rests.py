"""Rests of joints in logs: how often each joint rested, and what its friction held there.

A joint rests where its position stays within twice MIN_PLAY (`torque_error_model`) or its encoder's
step for REST_TIME. At rest friction balances motor torque and gravity,

    f = tau_J - G(q) - offset,

anything within the level at rest. Each rest counts with the mean of f, over the level.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrenchsight.models.identification.torque_error_model import (
    MIN_HELD_RATIO,
    MIN_PLAY,
    TorqueErrorModel,
)
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.numerics.stretches import stretches

REST_TIME = 0.3  # s, shortest rest of a joint
ARM_REST = 1.0  # s, shortest rest of all joints whose samples say nothing of sliding friction
REST_MARGIN = 0.2  # s, of a low-pass of 5 Hz
REST_SPEED = 0.01  # rad/s (m/s), of a joint that rests but for what its controller does


@dataclass(frozen=True, eq=False)
class Rests:
    """Rests of n joints.

    Attributes:
        count: (n,) of each joint.
        held: (n,) largest |f| over the level of sliding; 0 for a joint that never rested.
    """

    count: Array
    held: Array

    def joined(self, other: "Rests") -> "Rests":
        """The rests of both."""
        return Rests(self.count + other.count, np.maximum(self.held, other.held))


def unseen_rests(error: TorqueErrorModel, joint_names: Sequence[str]) -> tuple[str, ...]:
    """A sentence for the user about the joints that rested in no log; none if all did."""
    count = np.asarray(error.rests)
    unseen = [name for name, times in zip(joint_names, count, strict=True) if times == 0.0]
    if not unseen:
        return ()
    subject = "no joint rested"
    if len(unseen) < len(joint_names):
        subject = f"{', '.join(unseen)} never rested"
    return (
        f"{subject} in the logs of the model: contact at rest cannot be told from friction there, "
        f"and is not reported; a torque beyond {MIN_HELD_RATIO:g} times the joint's friction "
        "makes the "
        "reading not valid (unseen_rest); record a motion that stops for some seconds, as "
        "`wrenchsight excite` plans it, and identify again",
    )


def rests_along(
    q: Array, friction: Array, level: Array, time_step: float, resolution: Array
) -> Rests:
    """The rests in a log on a uniform grid.

    Args:
        q: (N, n) rad (m).
        friction: (N, n) N m, f.
        level: (N, n) N m, of the friction law at rest.
        time_step: s.
        resolution: (n,) rad, steps of the encoders.
    """
    n = q.shape[1]
    count, held = np.zeros(n), np.zeros(n)
    still = _still(q, max(2, round(REST_TIME / time_step)), np.maximum(resolution, MIN_PLAY))
    for j in range(n):
        for rest in stretches(still[:, j]):
            count[j] += 1.0
            torque, largest = np.mean(friction[rest, j]), np.mean(level[rest, j])
            if largest > 0.0 and np.isfinite(torque):
                held[j] = max(held[j], abs(torque) / largest)
    return Rests(count, held)


def arm_rests(v: Array, time_step: float) -> Flags:
    """(N,) samples of rests of the whole arm: all joints slower than REST_SPEED for ARM_REST s.

    With REST_MARGIN s before and after, where a low-pass blurs the steps of friction. A controller
    lets joints creep at rest, so positions may change by more than an encoder's step. v (N, n)
    rad/s, low-passed.
    """
    slow = (np.abs(v) < REST_SPEED).all(axis=1)
    rests = np.zeros(len(v), bool)
    margin = round(REST_MARGIN / time_step)
    for rest in stretches(np.asarray(slow)):
        if (rest.stop - rest.start) * time_step >= ARM_REST:
            rests[max(rest.start - margin, 0) : rest.stop + margin] = True
    return rests


def _still(q: Array, size: int, play: Array) -> Flags:
    """(N, n) samples within some `size` samples in which a joint stays within 2 play."""
    still = np.zeros(q.shape, bool)
    if len(q) < size:
        return still
    windows = np.lib.stride_tricks.sliding_window_view(q, size, axis=0)
    rests = windows.max(axis=2) - windows.min(axis=2) <= 2.0 * play  # NaN: no rest
    for k in range(size):
        still[k : k + len(rests)] |= rests
    return still
