"""The keys of a robot.yaml."""

from dataclasses import dataclass, field
from pathlib import Path

from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.tree import UniformGravityFieldElement

from wrenchsight.models.files.configuration import REQUIRED
from wrenchsight.models.robot.truth_config import SimulatedTruthConfig

# m/s^2, of an arm whose file states none; a payload's weight is by standard gravity
# (`models.estimation.wrench_prior`)
DEFAULT_GRAVITY: float = UniformGravityFieldElement.kDefaultStrength


@dataclass
class PoseConfig:
    """Pose of a frame in its parent: X = translation(xyz) RollPitchYaw(rpy), as in URDF."""

    xyz: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    """m"""
    rpy: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    """rad"""


@dataclass
class ShapeConfig:
    """One solid of the tool; exactly one of sphere, cylinder and box."""

    sphere: float | None = None
    """radius, m"""
    cylinder: list[float] | None = None
    """radius, length along z, m"""
    box: list[float] | None = None
    """sides along x, y, z, m"""
    pose: PoseConfig = field(default_factory=PoseConfig)
    """of its centre, in the flange"""
    rgba: list[float] = field(default_factory=lambda: [0.3, 0.3, 0.32, 1.0])
    """colour, 0 to 1"""


@dataclass
class ToolConfig:
    """The rigid body on the flange; all of it in axes of the flange."""

    name: str = "tool"
    """of its link"""
    mass: float = field(default=0.0, metadata=REQUIRED)
    """kg"""
    com: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    """m, from the flange"""
    inertia: list[float] = field(default_factory=list, metadata=REQUIRED)
    """about its centre of mass: ixx, iyy, izz, ixy, ixz, iyz, kg m^2"""
    visual: list[ShapeConfig] = field(default_factory=list)
    """what is drawn"""
    collision: list[ShapeConfig] = field(default_factory=list)
    """what it collides with"""


@dataclass
class DriveConfig:
    """Motor, gear and current loop of one joint."""

    joint: str = field(default="", metadata=REQUIRED)
    """its name in the URDF"""
    torque_per_ampere: float | None = None
    """N m/A on the joint side; or the next two"""
    torque_constant: float | None = None
    """N m/A of the motor"""
    gear_ratio: float | None = None
    """motor turns per joint turn"""
    rotor_inertia: float = field(default=0.0, metadata=REQUIRED)
    """kg m^2"""
    rotor_inertia_side: str = "motor"
    """"motor" (times gear_ratio^2), or "joint" (reflected already)"""
    current_sign: int = 1
    """+1 or -1: sign of the torque that a positive current gives"""
    current_resolution: float = 0.0
    """A, step of the measured current"""
    current_noise_sd: float = 0.0
    """A, of one sample"""
    q_offset: float = 0.0
    """rad (m), added to the joint's logged positions: its zero, where it is off"""
    position_resolution: float | None = None
    """rad (m), step of the measured position, seen from the joint; without it: the log's"""
    current_bandwidth: float | None = None
    """Hz, of the measurement; without it: not limited"""
    effort_limit: float | None = None
    """N m; without it: the URDF's"""
    rest_friction_share: float = 0.25
    """of its friction that a joint keeps once it rests"""
    rest_torque_per_ampere: float | None = None
    """N m/A that the joint shows at rest, where a calibration found another one in motion"""


@dataclass
class RobotConfig:
    """The contents of a robot.yaml."""

    name: str = field(default="", metadata=REQUIRED)
    """models and logs name the robot by it"""
    urdf: Path = field(default=Path(), metadata=REQUIRED)
    """beside the robot.yaml, or absolute"""
    base_link: str = field(default="", metadata=REQUIRED)
    """W is its frame"""
    flange: str = field(default="", metadata=REQUIRED)
    """the link that carries the tool"""
    tool_frame: PoseConfig = field(default_factory=PoseConfig)
    """E in the flange"""
    tool: ToolConfig | None = None
    gravity: list[float] = field(default_factory=lambda: [0.0, 0.0, -DEFAULT_GRAVITY])
    """in W, m/s^2"""
    floor: float | None = 0.0
    """m, its height in W; null where no floor is near the arm"""
    locked_joints: dict[str, float] = field(default_factory=dict)
    """rad or m"""
    possible_inertias: bool = False
    """take the nearest possible one for each rotational inertia of the URDF that no body has"""
    home: list[float] = field(default_factory=list, metadata=REQUIRED)
    """rad or m"""
    payload: float = field(default=0.0, metadata=REQUIRED)
    """kg, rated"""
    drives: list[DriveConfig] = field(default_factory=list, metadata=REQUIRED)
    coupling: list[list[float]] = field(default_factory=list)
    """n rows of n: q_joint = coupling q_motor, motors behind their gears; without it: each its
    own"""
    simulated_truth: SimulatedTruthConfig = field(default_factory=SimulatedTruthConfig)
    """What only the simulation knows; no model or estimator reads it."""


def pose_of(config: PoseConfig) -> RigidTransform:
    """The transform that a PoseConfig states."""
    return RigidTransform(RollPitchYaw(config.rpy), config.xyz)
