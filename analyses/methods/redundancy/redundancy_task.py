"""The task of `redundancy --task`: a surface or its points, and the direction of the tool.

    surface: {blade: {}, start: [0.75, 0.15], end: [0.75, 0.85], num_samples: 121}
    workpiece: {xyz: [0.45, -0.25, 0.25], rpy: [0, 0, 0]}
    tool_axis: [0.7071, 0, 0.7071]
    initial_angle_deg: 60

or, in the place of the surface, `csv: points.csv` with the columns x,y,z,nx,ny,nz.
"""

from dataclasses import dataclass, field
from pathlib import Path

from wrenchsight.models.files.configuration import REQUIRED
from wrenchsight.models.planning.motion.workpieces import BladeShapeConfig, PlateShapeConfig
from wrenchsight.models.robot.robot_config import PoseConfig


@dataclass
class PatchPathConfig:
    """A path on a bundled workpiece, straight in its parameters; one of plate and blade."""

    plate: PlateShapeConfig | None = None
    blade: BladeShapeConfig | None = None
    start: list[float] = field(default_factory=list, metadata=REQUIRED)
    """(u, v)"""
    end: list[float] = field(default_factory=list, metadata=REQUIRED)
    """(u, v)"""
    num_samples: int = 121
    """along the path"""


@dataclass
class RedundancyClearance:
    """Distance of the arm from itself, the floor and, but for the tool, the workpiece."""

    distance: float = 0.005
    """m"""
    floor: float | None = None
    """m, height of the floor in W; None: what robot.yaml states"""
    approach: float = 0.05
    """m, that E comes and goes along the normal at both ends"""


@dataclass
class RedundancyTask:
    """The task of `redundancy --task`."""

    surface: PatchPathConfig | None = None
    """this, or"""
    csv: Path | None = None
    """x,y,z,nx,ny,nz in the workpiece's frame; beside the task's file"""
    workpiece: PoseConfig = field(default_factory=PoseConfig)
    """its frame in W"""
    tool_axis: list[float] = field(default_factory=lambda: [0.0, 0.0, 1.0])
    """working direction of the tool in axes of E; it points into the surface"""
    objective: str = "jcn"
    """or force-sd"""
    model: Path | None = None
    """of force-sd: model.yaml of `identify`; without it the nominal one"""
    initial_angle_deg: float = 0.0
    """of the trajectory to compare with, about the normal"""
    limit_margin_deg: float = 3.0
    """kept from every joint limit"""
    joint_ranges_deg: dict[str, list[float]] = field(default_factory=dict)
    """narrower limits of joints by their names, [lower, upper] (m of prismatic ones); so a branch
    can be ruled out, such as an elbow that would hang into the workpiece"""
    max_joint_step_deg: float = 6.0
    """from one sample to the next"""
    smoothness: float = 0.002
    """weight of the joints' motion, objective per rad^2"""
    num_angles: int = 72
    """of the grid"""
    clearance: RedundancyClearance | None = field(default_factory=RedundancyClearance)
    """distances to keep; none: the arm only must not overlap itself, the floor or the workpiece"""


@dataclass
class RedundancySettings:
    """All that a run of `redundancy` depends on, as its config.yaml holds it."""

    command: str = "redundancy"
    """which wrote it"""
    task: str = ""
    """a bundled task such as blade_path, or a YAML file"""
    robot: str = "sts_sre4_600"
    """a bundled robot's name, or the path of a robot.yaml"""
    task_content: RedundancyTask | None = None
    """overrides what `task` names"""
