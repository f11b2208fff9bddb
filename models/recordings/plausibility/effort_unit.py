"""Whether what a log calls effort is torque in N m or current in A: gravity says.

ROS' JointState says N m, and drivers of some arms (Universal Robots', by version) put amperes
there. Held still or moved slowly, a joint's motor torque is about its gravity torque G. The ratio
of effort to G, by least squares a joint, is

    about 1      the effort is in N m
    about 1 / K  it is in A, with K the torque per ampere of robot.yaml

A joint is asked if K is far from one, gravity loads it and the effort follows gravity.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.recordings.log_words import IN_AMPERES, IN_NEWTON_METRES
from wrenchsight.models.recordings.plausibility.product_sums import (
    FOLLOWS,
    LEAST_GRAVITY,
    GravitySums,
    telling_joints,
)
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot

NEARER = 0.7  # natural logarithm by which one ratio must be nearer than the other, joints' mean
_LEAST_SAMPLES = 20
NAMES = {"N m": IN_NEWTON_METRES, "A": IN_AMPERES}
"""Words of --log-format that decide it, by unit."""
REMEDIES = {unit: f"--log-format {word}" for unit, word in NAMES.items()}
"""Options that decide it, by unit."""


@dataclass(frozen=True, eq=False)
class EffortUnit:
    """What gravity says of a log's effort.

    Attributes:
        unit: "N m", "A", or "" where it cannot be told.
        ratio: (n,) effort over gravity torque.
        asked: (n,) the joints that were asked.
    """

    unit: str
    ratio: Array
    asked: Flags

    def sentence(self, robot: Robot, remedies: Mapping[str, str] = REMEDIES) -> str:
        """What the effort is read as, why, and by which option to have it otherwise."""
        other = remedies["N m" if self.unit == "A" else "A"]
        if not self.unit:
            why = "gravity does not tell in this log whether it is amperes"
            if robot.has_inertias and not telling_joints(robot).any():
                why = "torque_per_ampere is near 1 in robot.yaml, so that gravity cannot tell"
            return (
                f"effort is read as joint torque in N m: {why}; of a driver that reports amperes "
                f"add {other}"
            )
        joints = np.flatnonzero(self.asked)
        shown = ", ".join(f"{robot.joint_names[j]} {self.ratio[j]:.2g}" for j in joints)
        if self.unit == "A":
            return (
                f"effort is read as motor current in A: it is {shown} of the gravity torque, as "
                f"robot.yaml's torque_per_ampere has it; {other} reads it as N m"
            )
        return (
            f"effort is read as joint torque in N m: it is {shown} of the gravity torque; "
            f"{other} reads it as motor current"
        )


def effort_unit(recordings: Iterable[Recording], robot: Robot) -> EffortUnit:
    """Decides by logs whose `tau_J` holds their effort.

    Args:
        recordings: parts of the logs; samples that lack a number are passed over.
        robot: whose gravity torque and torque per ampere count.
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
    ratio = np.abs(sums.ratio())
    loaded = sums.gravity() > LEAST_GRAVITY
    asked = loaded & telling_joints(robot) & (np.abs(sums.cosine()) > FOLLOWS)
    if not asked.any():
        return unknown
    K = robot.torque_per_ampere
    # How much nearer, by factors, the ratio is to that of N m than to that of A.
    nearer = (np.abs(np.log((ratio * K)[asked])) - np.abs(np.log(ratio[asked]))).mean()
    unit = "" if abs(nearer) < NEARER else "N m" if nearer > 0.0 else "A"
    return EffortUnit(unit, ratio, asked)
