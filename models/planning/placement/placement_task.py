"""The task file of `place`: a straight path, its bounds, and what stands around it."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from wrenchsight.models.files.bundled_files import task_file
from wrenchsight.models.files.configuration import REQUIRED, load_configuration
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.plausible_numbers import check_numbers
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.planning.motion.paths import StraightPath
from wrenchsight.models.planning.motion.posture_cost import check_joints
from wrenchsight.models.planning.placement.placements import PlacementBounds
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.robot_config import PoseConfig

_DEGREES_ROUNDING = 1e-9  # degrees, by which two angles that are meant to be equal may differ
# Names of a cell's shapes that are none of the robot's: distances tell shapes by their names.
FLOOR, WORKPIECE = "floor", "workpiece"
_MIN_LENGTH = 1e-9  # of a vector that is to have a direction
_MAX_SEGMENTS = 500  # of a path; a program has n variables for each point


@dataclass
class GuessConfig:
    """A placement to start from and to compare with."""

    direction: list[float] = field(default_factory=list, metadata=REQUIRED)
    """in W; any length"""
    midpoint: list[float] = field(default_factory=list, metadata=REQUIRED)
    """in W, m"""
    rotation: list[list[float]] = field(default_factory=list, metadata=REQUIRED)
    """of E in W, row by row"""
    posture: list[float] | None = None
    """at the midpoint; names the branch to compare with, rad"""


@dataclass
class ObstacleConfig:
    """A box that stands still in the cell: a table, a fence."""

    name: str = field(default="", metadata=REQUIRED)
    """as messages call it; not floor or workpiece"""
    size: list[float] = field(default_factory=list, metadata=REQUIRED)
    """along x, y, z, m"""
    pose: PoseConfig = field(default_factory=PoseConfig)
    """of its centre in W"""


@dataclass
class WorkpieceConfig:
    """A board that moves with the path; the path runs along the middle of its upper face.

    Its x axis is the path's direction, its outward normal the opposite of E's z axis: the tool
    stands on it.
    """

    size: list[float] = field(default_factory=list, metadata=REQUIRED)
    """along the path, across it, and its thickness, m"""


@dataclass
class ClearanceConfig:
    """Distances to keep between robot, tool, obstacles and workpiece."""

    distance: float = 0.01
    """m"""
    obstacles: list[ObstacleConfig] = field(default_factory=list)
    workpiece: WorkpieceConfig | None = None


@dataclass
class PlacementTask:
    """What `place --task` reads. W is the robot's base frame."""

    path_length: float = field(default=0.0, metadata=REQUIRED)
    """m"""
    midpoint_lower: list[float] = field(default_factory=list, metadata=REQUIRED)
    """box in W, m"""
    midpoint_upper: list[float] = field(default_factory=list, metadata=REQUIRED)
    """m"""
    num_segments: int = 20
    """k; the path has k + 1 points"""
    angle_lower_deg: float = 0.0
    """of the tool's rotation from W (theta of eq. 27)"""
    angle_upper_deg: float = 180.0
    """of the same"""
    limit_margin_deg: float = 0.0
    """kept from every joint limit (of a prismatic joint: mm)"""
    max_joint_step_deg: float = 60.0
    """from one point to the next (60: 1.05 m of a prismatic joint)"""
    path_in_surface: bool = False
    """whether the path is perpendicular to the tool's z axis"""
    tool_direction: list[float] | None = None
    """in W, where E's z axis should point"""
    tool_tilt_deg: float = 0.0
    """how far it may lean from there (0: not at all)"""
    path_direction: list[float] | None = None
    """in W, from which the path's angle is measured"""
    path_angle_lower_deg: float = 0.0
    """of the path from there; 90 and 90: perpendicular to it"""
    path_angle_upper_deg: float = 180.0
    """of the same"""
    initial: GuessConfig | None = None
    clearance: ClearanceConfig | None = None
    """None: the arm only must not overlap itself or floor"""

    def initial_path(self) -> StraightPath | None:
        """The guess as a path; None without one."""
        if self.initial is None:
            return None
        return StraightPath(
            np.array(self.initial.direction),
            np.array(self.initial.midpoint),
            np.array(self.initial.rotation),
            self.path_length,
            self.num_segments,
        )

    def bounds(self, robot: Robot) -> PlacementBounds:
        """The bounds for an arm; checked by `check_task`."""
        margin = np.where(robot.chain.prismatic, 1e-3, math.radians(1.0)) * self.limit_margin_deg
        return PlacementBounds(
            q_lower=robot.position_lower + margin,
            q_upper=robot.position_upper - margin,
            p_lower=np.array(self.midpoint_lower),
            p_upper=np.array(self.midpoint_upper),
            angle_lower=math.radians(self.angle_lower_deg),
            angle_upper=math.radians(self.angle_upper_deg),
            max_joint_step=math.radians(self.max_joint_step_deg),
            in_surface=self.path_in_surface,
            tool_direction=None if self.tool_direction is None else _unit(self.tool_direction),
            tool_tilt=math.radians(self.tool_tilt_deg),
            path_direction=None if self.path_direction is None else _unit(self.path_direction),
            path_angle_lower=math.radians(self.path_angle_lower_deg),
            path_angle_upper=math.radians(self.path_angle_upper_deg),
        )


def load_task(name_or_path: str | Path) -> tuple[PlacementTask, Path]:
    """Reads a bundled task by its name, or a task file; returns it and its path.

    Raises:
        InputError: as `load_configuration`; or numbers that contradict each other.
    """
    path = task_file(name_or_path, "placement")
    task = load_configuration(path, PlacementTask)
    _check_numbers(task, path)
    return task, path


def check_task(task: PlacementTask, source: Path | str, robot: Robot) -> None:
    """Checks a task against an arm, before any search.

    Args:
        task: whose numbers each are in range.
        source: its file, for error lines.
        robot: that is to be placed.

    Raises:
        InputError: the path is longer than the arm can follow anywhere, or anywhere in the box, or
            must lie below the floor; the margin leaves a joint no range; the initial guess does not
            suit the arm.
    """
    check_joints(robot.chain, robot.name)
    bounds = task.bounds(robot)
    for name, lower, upper in zip(robot.joint_names, bounds.q_lower, bounds.q_upper, strict=True):
        if not lower < upper:
            raise InputError(
                source,
                "limit_margin_deg",
                f"{task.limit_margin_deg:g} leaves {name} no range "
                f"(from {lower:.3f} to {upper:.3f})",
                "make it smaller",
            )
    centre, reach = reach_ball(robot)  # W; all that E can reach lies within it, m
    if task.path_length > 2.0 * reach:
        raise InputError(
            source,
            "path_length",
            f"{task.path_length:g} m; all that {robot.name} reaches lies in a ball of "
            f"{2.0 * reach:.3f} m diameter",
            "shorten the path",
        )
    nearest_point = np.clip(centre, bounds.p_lower, bounds.p_upper)
    distance = float(np.linalg.norm(nearest_point - centre))
    # The longest chord of the ball whose middle is that far from its centre.
    longest_path = 2.0 * math.sqrt(max(0.0, reach**2 - distance**2))
    if task.path_length > longest_path:
        text = ", ".join(f"{value:.2f}" for value in nearest_point)
        if distance >= reach:
            problem = (
                f"the box excludes the workspace: its point nearest to {robot.name} is ({text}) m"
            )
        else:
            problem = (
                f"a path of {task.path_length:g} m fits nowhere in the box; "
                f"at most {longest_path:.3f} m do, at ({text}) m"
            )
        raise InputError(source, "midpoint_lower, midpoint_upper", problem, "move the box")
    _check_floor(task, source, robot)
    if task.initial is not None and task.initial.posture is not None:
        num_positions = len(task.initial.posture)
        if num_positions != robot.num_joints:
            raise InputError(
                source,
                "initial.posture",
                f"{num_positions} positions, {robot.name} has {robot.num_joints} joints",
            )


def _check_floor(task: PlacementTask, source: Path | str, robot: Robot) -> None:
    """Checks that the box of midpoints is not all below the floor."""
    if robot.floor is not None and task.midpoint_upper[2] < robot.floor:
        raise InputError(
            source,
            "midpoint_upper",
            f"z up to {task.midpoint_upper[2]:g} m; the floor of {robot.name} is at "
            f"{robot.floor:g} m, and E cannot go below it",
            "raise the box, or state another floor in robot.yaml",
        )


def reach_ball(robot: Robot) -> tuple[Array, float]:
    """A ball in W, centre (3,) and radius in m, that E cannot leave.

    Its centre is on the first joint's axis: the origin of the second joint where the first turns.
    """
    chain = robot.chain
    R, p = chain.R_PJ[0], chain.p_PJ[0]
    second = p + R @ chain.p_PJ[1]
    axis = R @ chain.axis[0]
    # The second joint's origin circles about the first axis.
    centre = p + axis * float(axis @ (second - p))
    reach = float(np.linalg.norm(second - centre))
    reach += float(np.sum(np.linalg.norm(chain.p_PJ[2:], axis=1)) + np.linalg.norm(chain.p_LE))
    slides = np.maximum(np.abs(robot.position_lower), np.abs(robot.position_upper))
    return centre, reach + float(np.sum(slides[chain.prismatic]))


def _unit(direction: list[float]) -> Array:
    vector = np.array(direction, dtype=np.float64)
    return np.asarray(vector / np.linalg.norm(vector))


def _check_numbers(task: PlacementTask, source: Path) -> None:
    """Raises InputError for a number out of range, or a list of a wrong length.

    Args:
        task: lengths in m, angles in degrees where the key says so; None: not asked for.
        source: its file, for error lines.
    """

    def expect(values: list[float], length: int, key: str) -> None:
        """Raises InputError unless these are so many finite numbers."""
        if len(values) != length:
            raise InputError(source, key, f"{len(values)} numbers, expected {length}")
        if not all(math.isfinite(value) for value in values):
            raise InputError(source, key, f"{values} is not finite")

    check_numbers(task, str(source))  # each number alone; below, their ranges and lengths
    if not 0.0 < task.path_length < math.inf:
        raise InputError(source, "path_length", f"{task.path_length:g}, expected m above 0")
    if not 2 <= task.num_segments <= _MAX_SEGMENTS:
        problem = f"{task.num_segments}, expected 2 to {_MAX_SEGMENTS}"
        raise InputError(source, "num_segments", problem)
    expect(task.midpoint_lower, 3, "midpoint_lower")
    expect(task.midpoint_upper, 3, "midpoint_upper")
    for axis, low, high in zip("xyz", task.midpoint_lower, task.midpoint_upper, strict=True):
        if low > high:
            raise InputError(
                source,
                "midpoint_lower, midpoint_upper",
                f"{axis} from {low:g} to {high:g}, expected the lower end first",
            )
    low, high = task.angle_lower_deg, task.angle_upper_deg
    if not 0.0 <= low <= high <= 180.0:
        raise InputError(
            source,
            "angle_lower_deg, angle_upper_deg",
            f"from {low:g} to {high:g}, expected a range within 0 to 180",
        )
    if not 0.0 <= task.limit_margin_deg < math.inf:
        raise InputError(source, "limit_margin_deg", f"{task.limit_margin_deg:g}, expected >= 0")
    if not 0.0 < task.max_joint_step_deg <= 180.0:
        raise InputError(
            source, "max_joint_step_deg", f"{task.max_joint_step_deg:g}, expected 0 to 180"
        )
    if task.tool_direction is not None:
        expect(task.tool_direction, 3, "tool_direction")
        if not np.linalg.norm(task.tool_direction) > _MIN_LENGTH:
            raise InputError(source, "tool_direction", f"{task.tool_direction} has no direction")
        if not 0.0 <= task.tool_tilt_deg <= 180.0:
            raise InputError(source, "tool_tilt_deg", f"{task.tool_tilt_deg:g}, expected 0 to 180")
    _check_path_angle(task, source, expect)
    _check_directions(task, source)  # of directions and angles that are checked by now
    if task.initial is not None:
        expect(task.initial.direction, 3, "initial.direction")
        expect(task.initial.midpoint, 3, "initial.midpoint")
        if len(task.initial.rotation) != 3:
            raise InputError(source, "initial.rotation", "expected 3 rows of 3 numbers")
        for index, row in enumerate(task.initial.rotation):
            expect(row, 3, f"initial.rotation[{index}]")
        try:
            task.initial_path()
        except InputError as error:
            raise InputError(source, "initial", str(error)) from error
    if task.clearance is not None:
        _check_clearance(task, task.clearance, source)


def _check_path_angle(
    task: PlacementTask, source: Path, expect: Callable[[list[float], int, str], None]
) -> None:
    low, high = task.path_angle_lower_deg, task.path_angle_upper_deg
    if not 0.0 <= low <= high <= 180.0:
        raise InputError(
            source,
            "path_angle_lower_deg, path_angle_upper_deg",
            f"from {low:g} to {high:g}, expected a range within 0 to 180",
        )
    if task.path_direction is None:
        if (low, high) != (0.0, 180.0):
            raise InputError(
                source,
                "path_direction",
                f"is missing; from what is the path at {low:g} to {high:g} degrees?",
                "state it, as in path_direction: [0, 0, 1]",
            )
        return
    expect(task.path_direction, 3, "path_direction")
    if not np.linalg.norm(task.path_direction) > 1e-9:
        raise InputError(source, "path_direction", f"{task.path_direction} has no direction")


def _check_directions(task: PlacementTask, source: Path) -> None:
    """Checks that some rotation of the tool and some direction of the path keep all angles.

    The tool points along its z within a cone of `tool_tilt_deg` about `tool_direction` (W), turned
    from W by `angle_upper_deg` at most. A rotation that takes z to a direction at the angle beta
    from z is itself by beta or more.

    With `path_in_surface` the path is perpendicular to the tool, and it is at
    `path_angle_lower_deg` to `path_angle_upper_deg` from `path_direction`. If the tool is at an
    angle zeta from that direction, paths perpendicular to it are at |90 - zeta| to
    180 - |90 - zeta| degrees from the direction.

    Raises:
        InputError: the angles contradict each other.
    """
    if task.tool_direction is None:
        return
    tool, tilt = _unit(task.tool_direction), task.tool_tilt_deg
    least_turn = _degrees_between(tool, np.array([0.0, 0.0, 1.0])) - tilt
    if task.angle_upper_deg < least_turn - _DEGREES_ROUNDING:
        raise InputError(
            source,
            "angle_upper_deg, tool_direction",
            f"contradict each other: in the cone the tool is turned by {least_turn:g} degrees or "
            f"more from W, angle_upper_deg allows {task.angle_upper_deg:g}",
            "raise angle_upper_deg or tool_tilt_deg, or turn tool_direction",
        )
    if not task.path_in_surface or task.path_direction is None:
        return
    between = _degrees_between(tool, _unit(task.path_direction))
    off_right_angle = max(0.0, abs(between - 90.0) - tilt)
    if (
        task.path_angle_upper_deg < off_right_angle - _DEGREES_ROUNDING
        or task.path_angle_lower_deg > 180.0 - off_right_angle + _DEGREES_ROUNDING
    ):
        raise InputError(
            source,
            "path_in_surface, path_direction, tool_direction",
            f"contradict each other: a path perpendicular to a tool in the cone is at "
            f"{off_right_angle:g} to {180.0 - off_right_angle:g} degrees from path_direction, "
            f"{task.path_angle_lower_deg:g} to {task.path_angle_upper_deg:g} are allowed",
            "widen path_angle_lower_deg, path_angle_upper_deg or tool_tilt_deg",
        )


def _degrees_between(a: Array, b: Array) -> float:
    return math.degrees(math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b)))


def _check_clearance(task: PlacementTask, clearance: ClearanceConfig, source: Path) -> None:
    """Raises InputError for a size out of range, a taken name, or a path off the workpiece.

    Args:
        task: whose path runs along the workpiece's face, if there is one.
        clearance: distance, obstacles and workpiece, in m.
        source: the task's file, for error lines.
    """
    if not 0.0 <= clearance.distance <= 1.0:
        raise InputError(source, "clearance.distance", f"{clearance.distance:g}, expected 0 to 1 m")
    # By key below `clearance`.
    sizes = [(f"obstacles[{i}]", o.size) for i, o in enumerate(clearance.obstacles)]
    names = [obstacle.name for obstacle in clearance.obstacles]
    for index, name in enumerate(names):
        if name in names[:index] or name in (FLOOR, WORKPIECE):
            raise InputError(
                source,
                f"clearance.obstacles[{index}]",
                f'the name "{name}" is taken',
                "give it another name",
            )
    if clearance.workpiece is not None:
        sizes.append(("workpiece", clearance.workpiece.size))
        if not task.path_in_surface:
            raise InputError(
                source,
                "path_in_surface",
                "the path runs along the workpiece's face, so it is perpendicular to the tool",
                "set it to true",
            )
    for key, size in sizes:
        if len(size) != 3 or not all(0.0 < side < math.inf for side in size):
            raise InputError(source, f"clearance.{key}.size", "expected 3 sides above 0, m")
