"""A serial arm: its URDF, its drives and its tool, to be added to a MultibodyPlant.

A robot is a `robot.yaml` beside a URDF. The URDF is read once, checked, and turned into one
self-contained text (`Robot.urdf_text`) that Drake and any other URDF reader load alike: base link
as root, locked joints fixed, the tool and the frame E added, visuals that Drake cannot draw
dropped.
"""

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JointIndex, ModelInstanceIndex

from wrenchsight.models.files.bundled_files import bundled_files, named_file
from wrenchsight.models.files.configuration import load_configuration, nearest, save_configuration
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.plausible_numbers import LARGEST, check_numbers
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.robot.coupling import coupling_notice, coupling_of, is_coupled, motor_rates
from wrenchsight.models.robot.drake_parsing import add_model
from wrenchsight.models.robot.effective_urdf import EffectiveUrdf, JointLimits
from wrenchsight.models.robot.motors import motor_gain
from wrenchsight.models.robot.robot_config import (
    DriveConfig,
    PoseConfig,
    RobotConfig,
    ToolConfig,
)
from wrenchsight.models.robot.truth_config import JointFrictionConfig, SimulatedTruthConfig
from wrenchsight.models.robot.urdf import read_urdf

# Limits that no robot exceeds: a number beyond is a wrong unit or a typing error.
_FAR = (-1e3, 1e3)  # m, rad, m/s^2
_SIZE = (1e-9, 1e3)  # m
_HEAVY = 1e5  # kg, kg m^2
_WEAK, _STRONG = 1e-5, 1e6  # N m, N m/A
_LIMITS = {
    **dict.fromkeys(("xyz", "rpy", "gravity", "floor", "locked_joints", "com"), _FAR),
    **dict.fromkeys(("home", "mass", "inertia"), (-_HEAVY, _HEAVY)),
    **dict.fromkeys(("sphere", "cylinder", "box"), _SIZE),
    **dict.fromkeys(("rotor_inertia", "current_resolution", "current_noise_sd"), (0.0, 1e3)),
    **dict.fromkeys(("rgba", "rest_friction_share"), (0.0, 1.0)),
    "payload": (1e-3, _HEAVY),  # kg
    "position_resolution": (0.0, 0.1),  # rad (m)
    "gear_ratio": (1e-3, 1e5),
    "current_bandwidth": (1e-3, LARGEST),  # Hz
    **dict.fromkeys(("effort_limit", "rest_torque_per_ampere"), (_WEAK, _STRONG)),
}


@dataclass(frozen=True)
class RobotInPlant:
    """The parts of a robot after `Robot.add_to_plant`."""

    model_instance: ModelInstanceIndex
    frame_E: Any  # Frame
    joints: tuple[Any, ...]  # Joint, base to tool
    actuators: tuple[Any, ...]  # JointActuator, in the order of the joints
    tool_weld: JointIndex | None  # the weld of the tool to the flange; None without a tool


class Robot:
    """A serial arm with its drives and its tool; immutable once loaded.

    W is the frame of `config.base_link`, E the tool centre point. Arrays are (n,) in the order of
    `joint_names`, from base to tool, in SI units and radians.
    """

    def __init__(self, config: RobotConfig, source: Path, urdf: EffectiveUrdf) -> None:
        self.config = config
        self.source = source
        self.name = config.name
        self._urdf = urdf
        self.joint_names: tuple[str, ...] = tuple(joint.name for joint in urdf.joints)
        self.num_joints = len(self.joint_names)
        self.notices: tuple[str, ...] = urdf.notices
        self.payload = config.payload
        self.gravity = _frozen(config.gravity)
        self.floor = config.floor  # m, its height in W; None: none is near
        drives = _ordered_drives(config, source, self.joint_names)
        self._drives = drives
        self.torque_per_ampere = _frozen([_torque_per_ampere(d, source) for d in drives])
        self.reflected_inertia = _frozen([_reflected_inertia(d, source) for d in drives])
        self.current_sign = _frozen([float(d.current_sign) for d in drives])
        self._motor_gain = motor_gain(self.torque_per_ampere, self.current_sign)
        self.coupling = coupling_of(config.coupling, self.num_joints, source)
        self.coupling.setflags(write=False)
        if self.is_coupled:
            self.notices += (coupling_notice(self.coupling, self.joint_names),)
        self.current_resolution = _frozen([d.current_resolution for d in drives])
        self.current_noise_sd = _frozen([d.current_noise_sd for d in drives])
        self.rest_friction_share = _frozen([d.rest_friction_share for d in drives])
        at_rest = [d.rest_torque_per_ampere for d in drives]
        moving = self.torque_per_ampere.tolist()
        self.rest_torque_per_ampere = _frozen(
            [k if r is None else r for k, r in zip(moving, at_rest, strict=True)]
        )
        self.position_resolution = _frozen(  # nan: not known
            [math.nan if d.position_resolution is None else d.position_resolution for d in drives]
        )
        self.current_bandwidth = _frozen([d.current_bandwidth or math.inf for d in drives])
        self.effort_limit = _frozen(
            [_effort_limit(d, j, urdf.source) for d, j in zip(drives, urdf.joints, strict=True)]
        )
        self.velocity_limit = _frozen([joint.velocity for joint in urdf.joints])
        self.position_lower = _frozen([joint.lower for joint in urdf.joints])
        self.position_upper = _frozen([joint.upper for joint in urdf.joints])
        self.home = _frozen(self._checked_home())
        self.truth = _true_friction(config.simulated_truth.friction, source, self.num_joints)

    @classmethod
    def load(cls, name_or_path: "str | Path") -> "Robot":
        """Loads a bundled robot by its name, or any robot by the path of its robot.yaml.

        Raises:
            InputError: robot.yaml or the URDF is wrong; the line says what and where.
        """
        path = _robot_file(name_or_path)
        config = load_configuration(path, RobotConfig)
        return cls._read(config, path)

    @classmethod
    def _read(cls, config: RobotConfig, source: Path) -> "Robot":
        _check_config(config, source)
        return cls(config, source, read_urdf(_urdf_path(config, source), config, source))

    def with_tool(self, tool: ToolConfig | None, tool_frame: PoseConfig) -> "Robot":
        """The same robot with another tool (None: without one), and E elsewhere in the flange.

        Raises:
            InputError: a list has another length than it should.
        """
        return self._read(replace(self.config, tool=tool, tool_frame=tool_frame), self.source)

    @property
    def urdf_text(self) -> str:
        """The effective URDF: all that Drake or another reader needs, in one text."""
        return self._urdf.text(self.name)

    @cached_property
    def chain(self) -> SerialChain:
        """The arm's batched kernels, read from a plant of its own (URDF values)."""
        plant = MultibodyPlant(0.0)
        parts = self.add_to_plant(plant)
        plant.Finalize()
        chain = SerialChain.from_plant(plant, parts.model_instance, parts.frame_E)
        if not self.is_coupled:
            return chain
        return replace(
            chain, reflected_inertia=self.reflected_inertia, motor_rates=self.motor_rates
        )

    @property
    def is_coupled(self) -> bool:
        """Whether a motor moves more joints than its own."""
        return is_coupled(self.coupling)

    @cached_property
    def motor_rates(self) -> Array:
        """(n, n) with v_motor = motor_rates v_joint, motors behind their gears."""
        return _frozen(motor_rates(self.coupling))

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

    @property
    def has_inertias(self) -> bool:
        """Whether the URDF states inertias that its links can have."""
        return self._urdf.inertia_fault is None

    def require_inertias(self, source: str) -> None:
        """Checks that the URDF states inertias that its links can have.

        Args:
            source: the command or file that needs them, for the error line.

        Raises:
            InputError: the URDF's fault.
        """
        fault = self._urdf.inertia_fault
        if fault is not None:
            problem = f"needs the inertias of {self.name}: {fault}"
            remedy = (
                "correct the link's <inertial> in the URDF (CAD, data sheet); `jcn-map`, `place`, "
                "`redundancy` and `excite` need none"
            )
            raise InputError(source, "", problem, remedy)

    @cached_property
    def unusable_collisions(self) -> tuple[str, ...]:
        """Links with a collision shape that no distance can be taken to, each with the reason."""
        return self._urdf.meshes.unusable()

    @cached_property
    def kinematics_digest(self) -> str:
        """Short hash of the kinematics: names, kinds, frames and axes of the joints."""
        chain = self.chain
        digest = hashlib.sha256("\n".join(self.joint_names).encode())
        for array in (chain.R_PJ, chain.p_PJ, chain.axis, chain.prismatic):
            # Rounded, and without the sign of zero, so that the hash does not depend on the last
            # bit of a machine's sine.
            digest.update((np.round(np.asarray(array, dtype=np.float64), 9) + 0.0).tobytes())
        return digest.hexdigest()[:16]

    def save(self, path: Path) -> None:
        """Writes robot.yaml, with its URDF by absolute path."""
        urdf = _urdf_path(self.config, self.source).resolve()
        save_configuration(replace(self.config, urdf=urdf), path)

    def with_torque_per_ampere(
        self, values: Sequence[float], at_rest: Sequence[float] | None = None
    ) -> "Robot":
        """Returns the same robot with other torques per ampere.

        Args:
            values: (n,) N m/A on the joint side.
            at_rest: (n,) N m/A that the joints show at rest; None: the same.
        """
        moving = dict(zip(self.joint_names, values, strict=True))
        same: list[float | None] = [None] * self.num_joints
        resting = dict(
            zip(self.joint_names, same if at_rest is None else list(at_rest), strict=True)
        )
        drives = [
            replace(
                drive,
                torque_per_ampere=float(moving[drive.joint]),
                torque_constant=None,
                rest_torque_per_ampere=resting[drive.joint],
            )
            for drive in self.config.drives
        ]
        return self.with_drives(drives)

    def with_drives(self, drives: list[DriveConfig]) -> "Robot":
        """Returns the same robot with other drives.

        Raises:
            InputError: a drive is missing, or a number of it out of range.
        """
        config = replace(self.config, drives=drives)
        _check_config(config, self.source)
        return Robot(config, self.source, self._urdf)

    def with_truth(self, truth: SimulatedTruthConfig) -> "Robot":
        """Returns the same robot with another simulated truth.

        Raises:
            InputError: a list has another length than it should, or a value is out of range.
        """
        return Robot(replace(self.config, simulated_truth=truth), self.source, self._urdf)

    def without_coupling(self) -> "Robot":
        """Returns the robot with one rotor for each joint, as Drake models it."""
        return Robot(replace(self.config, coupling=[]), self.source, self._urdf)

    def with_moved_joints(self, translation: Array, rotation: Array) -> "Robot":
        """Returns the robot with the frames of its joints moved: another arm of the same make.

        Args:
            translation: (n, 3) m, in axes of each joint's frame.
            rotation: (n, 3) rad, rotation vectors in them.
        """
        poses = {name: (translation[i], rotation[i]) for i, name in enumerate(self.joint_names)}
        return Robot(self.config, self.source, self._urdf.with_moved_joints(poses))

    def add_to_plant(
        self, plant: Any, name: str | None = None, hulls: bool = False
    ) -> RobotInPlant:
        """Adds the arm to a plant that is not finalized yet, and welds its base to the world.

        Sets the plant's gravity, one actuator per joint with rotor inertia, gear ratio and effort
        limit, and the home posture as default positions. Friction is not added.

        Args:
            plant: with or without a SceneGraph.
            name: of the model instance; None: the robot's.
            hulls: with collision meshes that Drake does not read as their convex hulls: for
                distances. In a simulation hulls of neighbours, which overlap, would push.
        """
        text = self._urdf.text(name or self.name, hulls)
        try:
            instance = add_model(plant, text, "urdf")
        except (RuntimeError, ValueError) as error:
            raise InputError(self._urdf.source, "", f"Drake cannot take it: {error}") from error
        base = plant.GetFrameByName(self.config.base_link, instance)
        plant.WeldFrames(plant.world_frame(), base)
        plant.mutable_gravity_field().set_gravity_vector(self.gravity)
        joints = tuple(plant.GetJointByName(joint, instance) for joint in self.joint_names)
        actuators = []
        # The plant knows a rotor's inertia about its own joint only: see `motor_rates`.
        rotors = np.square(self.motor_rates).T @ self.reflected_inertia
        for i, (joint, drive) in enumerate(zip(joints, self._drives, strict=True)):
            actuator = plant.AddJointActuator(joint.name(), joint, float(self.effort_limit[i]))
            # Without a gear ratio the inertia is given on the joint side: a ratio of one.
            ratio = drive.gear_ratio if drive.gear_ratio is not None else 1.0
            actuator.set_default_gear_ratio(ratio)
            actuator.set_default_rotor_inertia(float(rotors[i]) / ratio**2)
            joint.set_default_positions([float(self.home[i])])
            actuators.append(actuator)
        tool_weld = None
        if self.config.tool is not None:
            tool_weld = plant.GetJointByName("tool_mount", instance).index()
        return RobotInPlant(
            model_instance=instance,
            frame_E=plant.GetFrameByName("E", instance),
            joints=joints,
            actuators=tuple(actuators),
            tool_weld=tool_weld,
        )

    def _checked_home(self) -> list[float]:
        home = self.config.home
        if len(home) != self.num_joints:
            raise InputError(
                self.source, "home", f"{len(home)} positions, expected {self.num_joints}"
            )
        for joint, position in zip(self._urdf.joints, home, strict=True):
            if not joint.lower <= position <= joint.upper:
                problem = (
                    f"{joint.name} = {position:g} lies outside its limits "
                    f"[{joint.lower:g}, {joint.upper:g}]"
                )
                raise InputError(self.source, "home", problem)
        return home


def bundled_robots() -> list[str]:
    """Names of the robots that come with the package."""
    return list(bundled_files("robots"))


def _robot_file(name_or_path: "str | Path") -> Path:
    path = named_file(name_or_path, "robots", "robot")
    if (path / "robot.yaml").is_file():
        return path / "robot.yaml"
    if path.suffix in {".urdf", ".xacro", ".sdf", ".xml"}:
        draft = f"draft one: wrenchsight robot {path} --out robot.yaml"
        raise InputError(path, "", "describes the robot's links, and is no robot.yaml", draft)
    return path


def _urdf_path(config: RobotConfig, source: Path) -> Path:
    return config.urdf if config.urdf.is_absolute() else source.parent / config.urdf


def _frozen(values: Sequence[float] | Array) -> Array:
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


def _check_config(config: RobotConfig, source: Path) -> None:
    """Checks sizes of numbers and lengths of lists, which the YAML schema cannot state."""
    checked_config = replace(config, simulated_truth=SimulatedTruthConfig())  # which may hold inf
    check_numbers(checked_config, str(source), _LIMITS)

    def expect(values: Sequence[float], length: int, key: str) -> None:
        if len(values) != length:
            raise InputError(source, key, f"{len(values)} numbers, expected {length}")

    expect(config.tool_frame.xyz, 3, "tool_frame.xyz")
    expect(config.tool_frame.rpy, 3, "tool_frame.rpy")
    expect(config.gravity, 3, "gravity")
    if config.tool is None:
        return
    expect(config.tool.com, 3, "tool.com")
    expect(config.tool.inertia, 6, "tool.inertia (ixx, iyy, izz, ixy, ixz, iyz)")
    for kind in ("visual", "collision"):
        for index, shape in enumerate(getattr(config.tool, kind)):
            shape_key = f"tool.{kind}[{index}]"
            expect(shape.pose.xyz, 3, f"{shape_key}.pose.xyz")
            expect(shape.pose.rpy, 3, f"{shape_key}.pose.rpy")
            expect(shape.rgba, 4, f"{shape_key}.rgba")
            kinds = [n for n in ("sphere", "cylinder", "box") if getattr(shape, n) is not None]
            if len(kinds) != 1:
                raise InputError(source, shape_key, "expected one of sphere, cylinder and box")
            if shape.cylinder is not None:
                expect(shape.cylinder, 2, f"{shape_key}.cylinder (radius, length)")
            if shape.box is not None:
                expect(shape.box, 3, f"{shape_key}.box")


def _ordered_drives(
    config: RobotConfig, source: Path, joint_names: tuple[str, ...]
) -> list[DriveConfig]:
    """The drives in joint order, each checked."""
    by_joint: dict[str, DriveConfig] = {}
    for index, drive in enumerate(config.drives):
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
    if not _WEAK <= value <= _STRONG:
        problem = f"{value:g} N m/A, expected a positive number, {_WEAK:g} to {_STRONG:g}"
        raise InputError(source, key, problem, "the sign belongs in current_sign")
    return value


def _reflected_inertia(drive: DriveConfig, source: Path) -> float:
    if drive.rotor_inertia_side == "joint":
        return drive.rotor_inertia
    if drive.gear_ratio is None:
        if drive.rotor_inertia == 0.0:
            return 0.0
        problem = "rotor_inertia is on the motor side, and gear_ratio is missing"
        raise InputError(
            source, f"drive of {drive.joint}", problem, "add it, or set rotor_inertia_side: joint"
        )
    reflected = drive.rotor_inertia * drive.gear_ratio**2
    if reflected > _STRONG:
        problem = f"a rotor inertia of {reflected:.3g} kg m^2 on the joint side"
        raise InputError(source, f"drive of {drive.joint}", problem, "rotor_inertia is in kg m^2")
    return reflected


def _effort_limit(drive: DriveConfig, joint: JointLimits, urdf: Path) -> float:
    if drive.effort_limit is not None:
        return drive.effort_limit
    if joint.effort is None:
        problem = f'joint "{joint.name}" has no effort limit above 0'
        remedy = 'add effort="..." (N m) to its <limit>, or effort_limit to its drive in robot.yaml'
        raise InputError(urdf, f"line {joint.line}" if joint.line else "", problem, remedy)
    return joint.effort


def _true_friction(
    friction: JointFrictionConfig, source: Path, num_joints: int
) -> JointFrictionConfig:
    """The friction with all its numbers, checked."""
    checked: dict[str, Array] = {}
    for field in fields(JointFrictionConfig):
        values: Array = getattr(friction, field.name)
        key = f"simulated_truth.friction.{field.name}"
        if not values.size:
            # One rad/s, so that no kernel divides by a Stribeck velocity of zero.
            values = np.full(num_joints, 1.0 if field.name == "stribeck_velocity" else 0.0)
        if values.shape != (num_joints,):
            raise InputError(source, key, f"{len(values)} numbers, expected {num_joints}")
        if not np.all((values >= 0.0) & (values <= _STRONG)):
            problem = f"{values.tolist()}, expected numbers of 0 to {_STRONG:g}"
            raise InputError(source, key, problem)
        checked[field.name] = _frozen(values)
    if np.any(checked["stiction"] < checked["coulomb"]) and friction.stiction.size:
        raise InputError(
            source, "simulated_truth.friction.stiction", "below coulomb", "stiction >= coulomb"
        )
    return JointFrictionConfig(**checked)
