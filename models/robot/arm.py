"""A serial arm with its drives: what estimator and identification know of a robot."""

import hashlib
import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path

import numpy as np

from wrenchsight.models.files.configuration import nearest
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.robot.coupling import coupling_of, is_coupled, motor_rates
from wrenchsight.models.robot.effective_urdf import JointLimits
from wrenchsight.models.robot.motors import motor_gain
from wrenchsight.models.robot.robot_config import DriveConfig

MIN_TORQUE_PER_AMPERE, MAX_TORQUE_PER_AMPERE = 1e-5, 1e6  # N m/A
MAX_REFLECTED_INERTIA = 1e6  # kg m^2


class Arm(ABC):
    """A serial arm with its drives, wherever its links are described.

    `Robot` is read from a robot.yaml, `diagrams.arm_in_plant.ArmInPlant` from a MultibodyPlant.
    Arrays are (n,) in the order of `joint_names`, from base to tool, in SI units and radians.

    Args:
        name: by which models and logs name the arm.
        source: where it is described, for messages.
        limits: limits of the moving joints, base to tool.
        drives: one a joint, in any order.
        coupling: n rows of n: q_joint = coupling q_motor; empty: each motor moves its own joint.
        payload: kg, rated.

    Attributes:
        torque_per_ampere: N m/A on the joint side.
        current_sign: 1 or -1, of the torque that a positive current gives.
        reflected_inertia: kg m^2, of the rotors behind their gears.
        effort_limit, velocity_limit, position_lower, position_upper: of the joints.
        position_resolution: rad (m), step of the encoders; NaN: not known.
        q_offset, rest_friction_share, rest_torque_per_ampere: see `DriveConfig`.
        gravity: (3,) m/s^2, in the frame W of the arm's wrenches.
        current_is_measured: whether the motors' current is read from drives, and so may be wrong;
            False of a simulated arm, whose "current" is the torque that acts.

    Raises:
        InputError: a drive is missing or stands twice, or a number of it is out of range.
    """

    gravity: Array
    current_is_measured = True

    def __init__(
        self,
        name: str,
        source: Path,
        limits: Sequence[JointLimits],
        drives: Sequence[DriveConfig],
        coupling: list[list[float]],
        payload: float,
    ) -> None:
        """Gathers drives and limits in joint order, all (n,) and read-only.

        Args:
            name, source: of the robot, and its robot.yaml for error lines.
            limits: of the joints, base to tool.
            drives: of robot.yaml, in any order.
            coupling: rows of the matrix C of q_joint = C q_motor; empty: each motor moves its
                joint.
            payload: kg, rated.

        Raises:
            InputError: drives or coupling that do not fit the joints.
        """
        self.name, self.source, self.payload = name, source, payload
        self.joint_names: tuple[str, ...] = tuple(joint.name for joint in limits)
        self.num_joints = len(self.joint_names)
        self._drives = ordered = _ordered_drives(drives, source, self.joint_names)
        self.torque_per_ampere = frozen([_torque_per_ampere(d, source) for d in ordered])
        self.reflected_inertia = frozen([_reflected_inertia(d, source) for d in ordered])
        self.current_sign = frozen([float(d.current_sign) for d in ordered])
        self._motor_gain = motor_gain(self.torque_per_ampere, self.current_sign)
        self.coupling = coupling_of(coupling, self.num_joints, source)
        self.coupling.setflags(write=False)
        self.current_resolution = frozen([d.current_resolution for d in ordered])
        self.current_noise_sd = frozen([d.current_noise_sd for d in ordered])
        self.q_offset = frozen([d.q_offset for d in ordered])
        self.rest_friction_share = frozen([d.rest_friction_share for d in ordered])
        # Left out, a drive at rest gives as much torque per ampere as in motion.
        at_rest = [d.rest_torque_per_ampere for d in ordered]
        moving = self.torque_per_ampere.tolist()
        self.rest_torque_per_ampere = frozen(
            [k if r is None else r for k, r in zip(moving, at_rest, strict=True)]
        )
        self.position_resolution = frozen(
            [math.nan if d.position_resolution is None else d.position_resolution for d in ordered]
        )
        self.current_bandwidth = frozen([d.current_bandwidth or math.inf for d in ordered])
        self.velocity_limit = frozen([joint.velocity for joint in limits])
        self.position_lower = frozen([joint.lower for joint in limits])
        self.position_upper = frozen([joint.upper for joint in limits])
        # By the kind of arm. Its own constructor sets what its `_effort_limit` reads before it
        # calls this one, and all else after.
        self.effort_limit = frozen(
            [self._effort_limit(d, j) for d, j in zip(ordered, limits, strict=True)]
        )

    @abstractmethod
    def _effort_limit(self, drive: DriveConfig, joint: JointLimits) -> float:
        """N m, of a joint with its drive."""

    @property
    @abstractmethod
    def chain(self) -> SerialChain:
        """Kinematics and nominal inertias, from the frame W of the arm's wrenches to E."""

    @property
    @abstractmethod
    def chain_from_base(self) -> SerialChain:
        """The same from the arm's base frame."""

    @property
    def is_coupled(self) -> bool:
        """Whether a motor moves more joints than its own."""
        return is_coupled(self.coupling)

    @cached_property
    def motor_rates(self) -> Array:
        """(n, n) with v_motor = motor_rates v_joint, motors behind their gears."""
        return frozen(motor_rates(self.coupling))

    def joint_torque(self, current: Array) -> Array:
        """tau_J (..., n) in N m on the joints, of the motors' current (..., n) in A."""
        tau_motor = np.asarray(current, float) * self._motor_gain
        return tau_motor @ self.motor_rates if self.is_coupled else tau_motor

    @property
    def current_limit(self) -> Array:
        """(n,) A, currents of the motors at the joints' effort limits."""
        effort = self.effort_limit
        if self.is_coupled:
            effort = np.abs(self.coupling.T) @ effort
        return np.asarray(effort / self.torque_per_ampere)

    def motor_current(self, tau_J: Array) -> Array:
        """The motors' current (..., n) in A that puts tau_J (..., n) in N m on the joints."""
        tau_motor = np.asarray(tau_J, float) @ self.coupling if self.is_coupled else tau_J
        return np.asarray(tau_motor, float) / self._motor_gain

    @cached_property
    def kinematics_digest(self) -> str:
        """Short hash of the kinematics from the base on: names, kinds, frames, axes of joints."""
        chain = self.chain_from_base
        digest = hashlib.sha256("\n".join(self.joint_names).encode())
        for array in (chain.R_PJ, chain.p_PJ, chain.axis, chain.prismatic):
            # Rounded, and without the sign of zero, so that the hash does not depend on the last
            # bit of a machine's sine.
            digest.update((np.round(np.asarray(array, dtype=np.float64), 9) + 0.0).tobytes())
        return digest.hexdigest()[:16]


def frozen(values: Sequence[float] | Array) -> Array:
    """A copy that cannot be written to."""
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


def _ordered_drives(
    drives: Sequence[DriveConfig], source: Path, joint_names: tuple[str, ...]
) -> list[DriveConfig]:
    """The drives in joint order, each checked.

    Args:
        drives: of robot.yaml, in any order.
        source: the robot.yaml, for error lines.
        joint_names: moving joints, base to tool.

    Raises:
        InputError: a joint without a drive or with two, a drive of no moving joint, or a sign or
            side that is none.
    """
    by_joint: dict[str, DriveConfig] = {}
    for index, drive in enumerate(drives):
        key = f"drives[{index}]"
        if drive.joint not in joint_names:
            hint = nearest(drive.joint, joint_names) or f"it has {', '.join(joint_names)}"
            problem = f'"{drive.joint}" is no moving joint of the arm'
            raise InputError(source, key, problem, hint)
        if drive.joint in by_joint:
            raise InputError(source, key, f'a second drive for "{drive.joint}"')
        by_joint[drive.joint] = drive
        if drive.current_sign not in (-1, 1):
            problem = f"{drive.current_sign}, expected 1 or -1"
            raise InputError(source, f"{key}.current_sign", problem)
        if drive.rotor_inertia_side not in ("motor", "joint"):
            problem = f'"{drive.rotor_inertia_side}", expected "motor" or "joint"'
            raise InputError(source, f"{key}.rotor_inertia_side", problem)
    missing = [name for name in joint_names if name not in by_joint]
    if missing:
        problem = f"no drive for {', '.join(missing)}"
        remedy = "add one, or name the joint under locked_joints"
        raise InputError(source, "drives", problem, remedy)
    return [by_joint[name] for name in joint_names]


def _torque_per_ampere(drive: DriveConfig, source: Path) -> float:
    key = f"drive of {drive.joint}"
    if drive.torque_per_ampere is not None:
        if drive.torque_constant is not None:
            raise InputError(source, key, "gives torque_per_ampere and torque_constant", "drop one")
        value = drive.torque_per_ampere
    elif drive.torque_constant is not None and drive.gear_ratio is not None:
        value = drive.torque_constant * drive.gear_ratio
    else:
        raise InputError(source, key, "needs torque_per_ampere, or torque_constant with gear_ratio")
    if not MIN_TORQUE_PER_AMPERE <= value <= MAX_TORQUE_PER_AMPERE:
        expected = f"{MIN_TORQUE_PER_AMPERE:g} to {MAX_TORQUE_PER_AMPERE:g}"
        problem = f"{value:g} N m/A, expected a positive number, {expected}"
        raise InputError(source, key, problem, "the sign belongs in current_sign")
    return value


def _reflected_inertia(drive: DriveConfig, source: Path) -> float:
    reflected = drive.rotor_inertia
    if drive.rotor_inertia_side == "motor" and reflected != 0.0:
        if drive.gear_ratio is None:
            problem = "rotor_inertia is on the motor side, and gear_ratio is missing"
            remedy = "add it, or set rotor_inertia_side: joint"
            raise InputError(source, f"drive of {drive.joint}", problem, remedy)
        reflected *= drive.gear_ratio**2
    if not 0.0 <= reflected <= MAX_REFLECTED_INERTIA:  # NaN neither
        problem = f"a rotor inertia of {reflected:.3g} kg m^2 on the joint side"
        raise InputError(source, f"drive of {drive.joint}", problem, "rotor_inertia is in kg m^2")
    return reflected
