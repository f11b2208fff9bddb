"""Decides from gravity whether the effort of a log is torque in N m or current in A.

ROS' JointState defines effort in N m, but drivers of some arms (Universal Robots', by version)
report amperes. At rest or in slow motion, a joint's motor torque is about its gravity torque G. The
ratio of effort to G, by least squares for each joint, is

    about 1      if the effort is in N m
    about 1 / K  if it is in A, with K the torque per ampere of robot.yaml

Only joints count whose K is far from one, that gravity loads, and whose effort follows gravity.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.recordings.log_words import IN_AMPERES, IN_NEWTON_METRES
from wrenchsight.models.recordings.plausibility.product_sums import (
    LEAST_GRAVITY,
    MIN_COSINE,
    MIN_UNIT_RATIO,
    GravitySums,
    telling_joints,
)
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot

# By how much nearer to 0 the logarithm of one ratio must be than that of the other: a factor of 2.
MIN_LOG_DIFFERENCE = 0.7
_FAR_LOG_RATIO = 1.5  # of all ratios' logarithms: 4.5 times more or less than gravity's torque
NO_GRAVITY = "effort holds no gravity torque"
"""Begin of the sentence on an effort from which gravity is taken; what it is follows a colon."""
_LEAST_SAMPLES = 20  # slow ones
_LOADED_SHARE = 0.1  # of the effort limit, from which gravity shows beside friction
_WITHOUT_GRAVITY = 0.25  # part of the gravity torque, below which an effort does not hold it
_LEAST_FRICTION = 1e-3  # of the gravity torque of all loaded joints: drives' torques have more
_LARGEST_FRICTION = 0.4  # of the gravity torque of all loaded joints
NAMES = {"N m": IN_NEWTON_METRES, "A": IN_AMPERES}
"""Words of --log-format that state the unit, by unit."""
REMEDIES = {unit: f"--log-format {word}" for unit, word in NAMES.items()}
"""Options that state the unit, by unit."""


@dataclass(frozen=True, eq=False)
class EffortUnit:
    """The unit of a log's effort, and the ratios that decided it.

    Attributes:
        unit: "N m", "A", or "" where gravity does not decide.
        ratio: (n,) effort over gravity torque.
        is_telling: (n,) whether the joint's ratio counted.
    """

    unit: str
    ratio: Array
    is_telling: Flags
    without_gravity: str = ""  # how small the effort is beside gravity's torque, if it holds none
    is_empty: bool = False  # whether such an effort is too small for friction, too

    def sentence(self, robot: Robot, remedies: Mapping[str, str] = REMEDIES) -> str:
        """Says in which unit the effort is read, why, and how to state the other one.

        Args:
            robot: that the log was decided with.
            remedies: what to add for effort in N m and in A, by unit.
        """
        if self.is_empty:
            return (
                f"{NO_GRAVITY} and no friction ({self.without_gravity}): the driver does not fill "
                "it, or with another quantity; record the motor currents or joint torques"
            )
        if self.without_gravity:
            return (
                f"{NO_GRAVITY} ({self.without_gravity}): it is torque from which "
                "the driver took gravity, or the external torque, which `estimate --torque "
                "external` reads as it is; here it is read as joint torque in N m"
            )
        if not self.unit:
            reason = "gravity does not show in this log whether it is in amperes"
            if robot.has_inertias and not telling_joints(robot).any():
                reason = "torque_per_ampere is near 1 in robot.yaml, so gravity cannot show it"
            return (
                f"effort is read as joint torque in N m: {reason}; if the driver reports amperes, "
                f"add {remedies['A']}"
            )
        ratios = ", ".join(
            f"{robot.joint_names[j]} {self.ratio[j]:.2g}" for j in np.flatnonzero(self.is_telling)
        )
        if self.unit == "A":
            return (
                f"effort is read as motor current in A: its ratio to the gravity torque ({ratios}) "
                "agrees with torque_per_ampere in robot.yaml; if the driver reports N m, add "
                f"{remedies['N m']}"
            )
        if np.abs(np.log(self.ratio[self.is_telling])).min() > _FAR_LOG_RATIO:
            return (
                f"effort is read as joint torque in N m, but its ratio to the gravity torque "
                f"({ratios}) is far from 1: it may be in another unit (motor_torque: {{gain: [N m "
                "of one]} in a description)"
            )
        return (
            f"effort is read as joint torque in N m: its ratio to the gravity torque ({ratios}) is "
            f"about 1; if the driver reports amperes, add {remedies['A']}"
        )


def effort_unit(recordings: Iterable[Recording], robot: Robot) -> EffortUnit:
    """The unit of the effort of logs of a robot, from its ratio to the gravity torque.

    The ratio is 1 for torque in N m, and 1 / K for amperes, with K the torque per ampere. A joint
    tells which where gravity loads it, its effort follows gravity, and K is not near 1.

    Args:
        recordings: parts of the logs, with their effort in `tau_J`; samples that lack a number are
            skipped.
        robot: with its gravity torque and torque per ampere.

    Returns:
        unit "N m" or "A"; "" where too little of the log tells, or both fit alike.
    """
    n = robot.num_joints
    unknown = EffortUnit("", np.full(n, np.nan), np.zeros(n, np.bool_))
    if not robot.has_inertias or robot.is_coupled:
        return unknown
    sums = GravitySums(robot)
    for recording in recordings:
        if recording.tau_J is not None:
            sums.add_slow(recording.q, recording.v, recording.tau_J)
    if sums.count[0] < _LEAST_SAMPLES:
        return unknown
    without_gravity = _without_gravity(sums, robot)
    if without_gravity:
        is_empty = _size_beside_gravity(sums, sums.gravity() > LEAST_GRAVITY) < _LEAST_FRICTION
        return replace(unknown, without_gravity=without_gravity, is_empty=is_empty)
    ratio = np.abs(sums.ratio())  # of effort to G, by least squares; its cosine: how it follows G
    is_loaded = sums.gravity() > LEAST_GRAVITY
    is_telling = is_loaded & telling_joints(robot) & (np.abs(sums.cosine()) > MIN_COSINE)
    if not is_telling.any():
        return unknown
    # How far the ratio is from either, by its logarithm; the mean of the joints that tell.
    K = robot.torque_per_ampere
    distance_to_amperes = np.abs(np.log((ratio * K)[is_telling]))
    distance_to_newton_metres = np.abs(np.log(ratio[is_telling]))
    difference = (distance_to_amperes - distance_to_newton_metres).mean()
    unit = ""
    if abs(difference) >= MIN_LOG_DIFFERENCE:
        unit = "N m" if difference > 0.0 else "A"
    return EffortUnit(unit, ratio, is_telling)


def _without_gravity(sums: GravitySums, robot: Robot) -> str:
    """How small torques are beside gravity's, in words; empty where they may hold gravity.

    A current follows gravity's torque with the ratio 1 / K, at joints where K is far from one.
    """
    gravity = sums.gravity()
    effort = np.sqrt(sums.yy / np.maximum(sums.count, 1.0))
    limit = np.where(np.isfinite(robot.effort_limit), robot.effort_limit, 0.0)
    loaded = gravity > np.maximum(LEAST_GRAVITY, _LOADED_SHARE * limit)
    ratio = np.abs(sums.ratio())
    may_be_current = telling_joints(robot) & (np.abs(sums.cosine()) > MIN_COSINE)
    may_be_current &= np.abs(np.log(np.maximum(ratio, 1e-9) * robot.torque_per_ampere)) < np.log(
        MIN_UNIT_RATIO
    )
    holds_gravity = may_be_current | (ratio > _WITHOUT_GRAVITY)
    # Friction is there still: at a wrist it is as large as gravity, over all joints it is not.
    size = _size_beside_gravity(sums, loaded)
    if not loaded.any() or (loaded & holds_gravity).any() or size > _LARGEST_FRICTION:
        return ""
    j = int(np.argmax(np.where(loaded, gravity, 0.0)))
    return f"{effort[j]:.2g} N m where gravity is {gravity[j]:.2g} N m, {robot.joint_names[j]}"


def _size_beside_gravity(sums: GravitySums, joints: Flags) -> float:
    """The effort over the gravity torque, root mean squares of these joints together."""
    effort = np.sqrt(sums.yy / np.maximum(sums.count, 1.0))[joints]
    gravity = sums.gravity()[joints]
    return float(np.linalg.norm(effort)) / max(float(np.linalg.norm(gravity)), 1e-9)
