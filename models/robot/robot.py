"""A serial arm: its URDF, its drives and its tool, to be added to a MultibodyPlant.

A robot is a `robot.yaml` beside a URDF. The URDF is read once, checked, and turned into one
self-contained text (`Robot.urdf_text`) that Drake and any other URDF reader load alike: base link
as root, locked joints fixed, the tool and the frame E added, visuals that Drake cannot draw
dropped.
"""

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JointIndex, ModelInstanceIndex, RigidBody

from wrenchsight.models.files.bundled_files import bundled_files, named_file
from wrenchsight.models.files.configuration import load_configuration, save_configuration
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.plausible_numbers import MAX_NUMBER, check_numbers
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.robot.arm import Arm, frozen
from wrenchsight.models.robot.coupling import coupling_notice
from wrenchsight.models.robot.drake_parsing import add_model
from wrenchsight.models.robot.effective_urdf import EffectiveUrdf, JointLimits
from wrenchsight.models.robot.robot_config import (
    DriveConfig,
    PoseConfig,
    RobotConfig,
    ToolConfig,
)
from wrenchsight.models.robot.truth_config import JointFrictionConfig, SimulatedTruthConfig
from wrenchsight.models.robot.urdf import read_urdf

# Limits that no robot exceeds: a number beyond is a wrong unit or a typing error.
_COORDINATE_RANGE = (-1e3, 1e3)  # m, rad, m/s^2
_SIZE_RANGE = (1e-9, 1e3)  # m
_MAX_MASS = 1e5  # kg, kg m^2
_MIN_TORQUE, _MAX_TORQUE = 1e-5, 1e6  # N m, N m/A
_KEY_RANGES = {
    "q_offset": (-7.0, 7.0),
    **dict.fromkeys(("xyz", "rpy", "gravity", "floor", "locked_joints", "com"), _COORDINATE_RANGE),
    **dict.fromkeys(("home", "mass", "inertia"), (-_MAX_MASS, _MAX_MASS)),
    **dict.fromkeys(("sphere", "cylinder", "box"), _SIZE_RANGE),
    **dict.fromkeys(("rotor_inertia", "current_resolution", "current_noise_sd"), (0.0, 1e3)),
    **dict.fromkeys(("rgba", "rest_friction_share"), (0.0, 1.0)),
    "payload": (1e-3, _MAX_MASS),  # kg
    "position_resolution": (0.0, 0.1),  # rad (m)
    "gear_ratio": (1e-3, 1e5),
    "current_bandwidth": (1e-3, MAX_NUMBER),  # Hz
    **dict.fromkeys(("effort_limit", "rest_torque_per_ampere"), (_MIN_TORQUE, _MAX_TORQUE)),
}


@dataclass(frozen=True)
class RobotInPlant:
    """The parts of a robot after `Robot.add_to_plant`."""

    model_instance: ModelInstanceIndex
    frame_E: Any  # Frame
    joints: tuple[Any, ...]  # Joint, base to tool
    actuators: tuple[Any, ...]  # JointActuator, in the order of the joints
    tool_weld: JointIndex | None  # the weld of the tool to the flange; None without a tool

    def tool_body(self, plant: MultibodyPlant) -> RigidBody:
        """The body that the environment touches: the tool, or what E is fixed to without one."""
        if self.tool_weld is None:
            return self.frame_E.body()
        return plant.get_joint(self.tool_weld).child_body()


class Robot(Arm):
    """A serial arm with its drives and its tool; immutable once loaded.

    W is the frame of `config.base_link`, E the tool centre point. Arrays are (n,) in the order of
    `joint_names`, from base to tool, in SI units and radians.
    """

    def __init__(self, config: RobotConfig, source: Path, urdf: EffectiveUrdf) -> None:
        self._urdf_source = urdf.source
        Arm.__init__(
            self, config.name, source, urdf.joints, config.drives, config.coupling, config.payload
        )
        self.config = config
        self._urdf = urdf
        self.notices: tuple[str, ...] = urdf.notices
        if self.is_coupled:
            self.notices += (coupling_notice(self.coupling, self.joint_names),)
        self.gravity = frozen(config.gravity)
        self.floor = config.floor  # m, its height in W; None: none is near
        self.home = frozen(self._checked_home())
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

    @property
    def urdf_element(self) -> ET.Element:
        """The <robot> of the effective URDF, to be changed: `drake:` and such stay in the names."""
        return self._urdf.element(self.name)

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
    def chain_from_base(self) -> SerialChain:
        """As `chain`: the base's frame is W."""
        return self.chain

    def _effort_limit(self, drive: DriveConfig, joint: JointLimits) -> float:
        if drive.effort_limit is not None:
            return drive.effort_limit
        if joint.effort is None:
            problem = f'joint "{joint.name}" has no effort limit above 0'
            remedy = 'add effort="..." (N m) to its <limit>, or effort_limit to its drive in '
            raise InputError(self._urdf_source, joint.place, problem, f"{remedy}robot.yaml")
        return joint.effort

    @property
    def has_inertias(self) -> bool:
        """Whether the URDF states inertias that its links can have."""
        return self._urdf.inertia_fault is None

    @property
    def inertias_may_be_mended(self) -> bool:
        """Whether `possible_inertias` in robot.yaml gives inertias to a robot that has none."""
        return not self.has_inertias and self._urdf.inertias_may_be_mended

    @property
    def massless_joints(self) -> tuple[int, ...]:
        """The joints whose links the URDF gives no mass, where that is all that dynamics lack."""
        return self._urdf.massless_joints

    def with_assumed_masses(self) -> "Robot":
        """As simulations have it: with `link_masses` of its truth where the URDF has no masses.

        Raises:
            InputError: `link_masses` are not as many as the joints, or one that is needed is not
                above 0.
        """
        masses, missing = self.config.simulated_truth.link_masses, self.massless_joints
        if not (masses and missing):
            return self
        key = "simulated_truth.link_masses"
        if len(masses) != self.num_joints:
            problem = f"{len(masses)} numbers, expected {self.num_joints}"
            raise InputError(self.source, key, problem)
        needed = [masses[j] for j in missing]
        if not all(0.0 < mass <= _MAX_MASS for mass in needed):
            problem = f"{needed}, expected numbers above 0 of at most {_MAX_MASS:g} kg"
            raise InputError(self.source, key, problem)
        ends = np.concatenate([self.chain.p_PJ[1:], self.chain.p_LE[np.newaxis]])
        return Robot(self.config, self.source, self._urdf.with_rods(masses, ends))

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
            remedy = f"correct the link's <inertial> in {self._urdf.source.name} (CAD, data sheet)"
            if self.inertias_may_be_mended:
                remedy += (
                    f", or set possible_inertias: true in {self.source.name}, which takes the "
                    "nearest possible ones"
                )
            if self.massless_joints and source == "simulate":
                remedy += (
                    f", or state link_masses, kg, under simulated_truth in {self.source.name}, of "
                    "which simulations make even rods"
                )
            remedy += "; `jcn-map`, `place`, `redundancy` and `excite` need none"
            raise InputError(source, "", problem, remedy)

    @cached_property
    def unusable_collisions(self) -> tuple[str, ...]:
        """Links with a collision shape that no distance can be taken to, each with the reason."""
        return self._urdf.meshes.unusable()

    @property
    def collision_mesh_lengths(self) -> dict[str, float]:
        """m, the longest side of each link's collision meshes of which hulls are made, by link."""
        return self._urdf.meshes.lengths()

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
        self,
        plant: Any,
        name: str | None = None,
        hulls: bool = False,
        X_WB: RigidTransform | None = None,
    ) -> RobotInPlant:
        """Adds the arm to a plant that is not finalized yet, and welds its base to the world.

        Sets one actuator per joint with rotor inertia, gear ratio and effort limit, and the home
        posture as default positions. Friction is not added.

        Args:
            plant: with or without a SceneGraph.
            name: name of the model instance; None: the robot's.
            hulls: with collision meshes that Drake does not read as their convex hulls: for
                distances. In a simulation hulls of neighbours, which overlap, would push.
            X_WB: pose of the base in the plant's World, whose gravity stays as it is. None: the
                base's frame is World, and the plant's gravity becomes that of robot.yaml, which is
                stated in the base's axes.
        """
        text = self._urdf.text(name or self.name, hulls)
        try:
            instance = add_model(plant, text, "urdf")
        except (RuntimeError, ValueError) as error:
            raise InputError(self._urdf.source, "", f"Drake cannot take it: {error}") from error
        base = plant.GetFrameByName(self._urdf.base_link, instance)
        plant.WeldFrames(plant.world_frame(), base, X_WB or RigidTransform())
        if X_WB is None:
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


def _check_config(config: RobotConfig, source: Path) -> None:
    """Checks sizes of numbers and lengths of lists, which the YAML schema cannot state.

    Numbers of the simulated truth are checked where a truth is made of them.

    Args:
        config: of robot.yaml.
        source: the robot.yaml, for error lines.

    Raises:
        InputError: a number out of the range of its key, a list of another length, or a shape of
            the tool that is none or several of sphere, cylinder and box.
    """
    checked_config = replace(config, simulated_truth=SimulatedTruthConfig())  # which may hold inf
    check_numbers(checked_config, str(source), _KEY_RANGES)

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
        if not np.all((values >= 0.0) & (values <= _MAX_TORQUE)):
            problem = f"{values.tolist()}, expected numbers of 0 to {_MAX_TORQUE:g}"
            raise InputError(source, key, problem)
        checked[field.name] = frozen(values)
    if np.any(checked["stiction"] < checked["coulomb"]) and friction.stiction.size:
        raise InputError(
            source, "simulated_truth.friction.stiction", "below coulomb", "stiction >= coulomb"
        )
    return JointFrictionConfig(**checked)
