"""Choice of the free angle about the normal of a surface (section 4.4).

Three ways along one path are compared: at a constant angle (initial), by the local method that the
article uses, and the optimum (dynamic programming over a grid of angles and all branches, then
refined continuously).
"""

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pydrake.math import RollPitchYaw

from wrenchsight.analyses.methods.place.placement import OBJECTIVES, measure_of
from wrenchsight.analyses.methods.redundancy.free_redundancy import (
    best_free,
    clear_of_all,
    surroundings,
)
from wrenchsight.analyses.methods.redundancy.redundancy_task import (
    PatchPathConfig,
    RedundancyClearance,
    RedundancyTask,
)
from wrenchsight.analyses.output.progress import ProgressCallback
from wrenchsight.diagrams.distances.clearance import ClosestPair
from wrenchsight.diagrams.pages.path_page import TriangleMesh
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.plausible_numbers import check_numbers
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.ties import better, beyond_rounding, first_of_least
from wrenchsight.models.planning.motion.branches import is_closed_form
from wrenchsight.models.planning.motion.joint_ranges import narrowed_limits
from wrenchsight.models.planning.motion.posture_cost import PostureMeasure, check_joints
from wrenchsight.models.planning.motion.redundancy import (
    Candidates,
    RedundancyProblem,
    Trajectory,
    at_constant_angle,
    best_on_grid,
    candidates,
    local_descent,
    refine,
    task,
)
from wrenchsight.models.planning.motion.surface_path import SurfacePath
from wrenchsight.models.planning.motion.workpieces import Surface, mesh
from wrenchsight.models.robot.robot import Robot

POSE_ROUNDING = 1e-9  # m and rad, of position and normal
_CONSTRAINT_TOLERANCE = 1e-7  # rad and m; the local method's way counts where it keeps them to that
_SAME_MEASURE = 1e-6  # range of the measure over postures, below which all count as equal
_SAME_ANGLE_DEG = 1e-6  # deg, of the angle that is kept from the one that the task states


@dataclass(frozen=True, eq=False)
class RedundancyResult:
    """The result of `find_redundancy`.

    Attributes:
        initial: at a constant angle; None if none can be kept.
        local: the baseline, from the initial trajectory's first posture; None where it fails.
        on_grid: the optimum over the grid and all branches.
        optimised: the refined one.
        constant_angles: (K,) mean measure at each constant angle of the grid, NaN where it cannot
            be kept.
        notices: sentences for the user.
        clearance: clearance of each checked way, by its name, the pair of shapes with the least
            slack; None where nothing is near.
        free: the best way on which nothing is nearer than it may be, where on the optimised one
            something is.
    """

    problem: RedundancyProblem
    initial: Trajectory | None
    local: Trajectory | None
    on_grid: Trajectory
    optimised: Trajectory
    constant_angles: Array
    workpiece: TriangleMesh | None
    notices: tuple[str, ...]
    clearance: dict[str, ClosestPair | None] = field(default_factory=dict)
    free: Trajectory | None = None

    @property
    def way(self) -> Trajectory:
        """The way that is written: the best one that keeps the clearance, as far as one is known.

        Where none is known, the optimised way overlaps nothing, or is an error.
        """
        return self.optimised if self.free is None else self.free

    def metrics(self) -> dict[str, Any]:
        """Nested figures, as written to metrics.json; `<key>` is the measure's, with its unit.

        Below the name of a way, mean and largest measure over its N samples; ways that there are
        not (`RedundancyResult`) have no key. `samples_lower` counts where the optimised way is
        better than the initial one. `constant_angle` is NaN where no angle can be kept.
        """
        problem, key = self.problem, self.problem.measure.key
        optimised = problem.measure.values(self.optimised.q)
        error, _ = task(problem, self.optimised.q)  # (N, 5): 2 of rotation, rad, 3 of position, m
        means_of_angles = self.constant_angles[np.isfinite(self.constant_angles)]
        best, median, worst = math.nan, math.nan, math.nan
        if means_of_angles.size:
            best, worst = float(np.min(means_of_angles)), float(np.max(means_of_angles))
            median = float(np.median(means_of_angles))
        metrics: dict[str, Any] = {
            "samples": problem.path.num_samples,
            "path_length_m": float(problem.path.distance[-1]),
            "grid": self._figures(self.on_grid),
            "optimised": {
                **self._figures(self.optimised),
                "position_error_m": beyond_rounding(
                    np.max(np.linalg.norm(error[:, 2:], axis=1)), POSE_ROUNDING
                ),
                "normal_error_rad": beyond_rounding(
                    np.max(np.linalg.norm(error[:, :2], axis=1)), POSE_ROUNDING
                ),
                "max_joint_step_deg": math.degrees(
                    float(np.max(np.abs(np.diff(self.optimised.q, axis=0))))
                ),
                "angle_range_deg": math.degrees(float(np.ptp(self.optimised.psi))),
            },
            "constant_angle": {
                f"best_mean_{key}": best,
                f"median_mean_{key}": median,
                f"worst_mean_{key}": worst,
                "angles_kept": int(means_of_angles.size),
            },
        }
        if self.initial is not None:
            initial = problem.measure.values(self.initial.q)
            metrics["initial"] = self._figures(self.initial)
            ratio = float(np.mean(optimised) / np.mean(initial))
            metrics["reduction_mean_pct"] = 100.0 * (1.0 - ratio)
            metrics["samples_lower"] = int(np.count_nonzero(optimised < initial))
        if self.local is not None:
            metrics["local"] = self._figures(self.local)
        if self.free is not None:
            metrics["free"] = self._figures(self.free)
        if self.clearance:
            metrics["clearance"] = {
                name: _pair_metrics(pair) for name, pair in self.clearance.items()
            }
        return metrics

    def _figures(self, trajectory: Trajectory) -> dict[str, float]:
        values, key = self.problem.measure.values(trajectory.q), self.problem.measure.key
        return {f"mean_{key}": float(np.mean(values)), f"max_{key}": float(np.max(values))}


def _pair_metrics(pair: ClosestPair | None) -> dict[str, Any] | None:
    if pair is None:
        return None
    return {"shapes": [pair.first, pair.second], "slack_m": round(pair.slack, 6)}


def find_redundancy(
    robot: Robot,
    config: RedundancyTask,
    source: Path | None = None,
    progress: ProgressCallback = lambda fraction, message: None,
) -> RedundancyResult:
    """Chooses a posture at each sample of the task's path.

    The optimum over a grid of angles and branches (dynamic programming) is refined; where it hits
    something, a free way is searched beside it. Interrupted while it refines, it returns the
    optimum on the grid.

    Args:
        source: the task's file; relative paths in it start from its folder.

    Raises:
        InputError: the task contradicts itself, or a sample is out of reach.
    """
    problem, workpiece = make_problem(robot, config, source)
    notices = []
    if not is_closed_form(robot):
        notices.append(
            f"{robot.name} has no known analytic inverse kinematics: postures are searched "
            "numerically, and the optimum is that of those found"
        )
    grid = candidates(problem, lambda f: progress(0.6 * f, "postures on the grid"))
    progress(0.6, "dynamic programming")
    on_grid = best_on_grid(problem, grid)
    baselines = _baselines(problem, config, grid, progress)
    initial, local = baselines.initial, baselines.local
    notices += baselines.notices
    try:
        optimised = _refined(problem, on_grid, local, progress)
    except KeyboardInterrupt:
        optimised = on_grid
        notices.append("interrupted: this is the optimum on the grid of angles, not refined")
    first_postures = grid.q[0][np.isfinite(grid.q[0, :, :, 0])]  # at the first sample of the path
    if np.ptp(problem.measure.values(first_postures)) < _SAME_MEASURE:
        notices.append(f"{problem.measure.label} is the same at all angles and branches")
    check = _check_clearance(problem, config, grid, initial, optimised, progress)
    notices += check.notices
    closest = check.pairs.get("optimised")  # None: nothing near, or not checked
    # Without a free way, the optimum may come nearer than it should, but not overlap anything.
    if check.free is None and closest is not None and closest.distance < 0.0:
        raise InputError(
            source or "task",
            "",
            f"no collision-free trajectory: on the best one {closest.first} and {closest.second} "
            f"overlap by {-1e3 * closest.distance:.0f} mm, approach and retreat included",
            "move the workpiece to where this arm reaches it from outside",
        )
    progress(1.0, "done")
    return RedundancyResult(
        problem=problem,
        initial=initial,
        local=local,
        on_grid=on_grid,
        optimised=optimised,
        constant_angles=_constant_angles(problem, grid),
        workpiece=workpiece,
        notices=tuple(notices),
        clearance=check.pairs,
        free=check.free,
    )


class _Baselines(NamedTuple):
    """Ways to compare the optimum with; None where a method fails, of which a notice says why."""

    initial: Trajectory | None
    local: Trajectory | None
    notices: list[str]


def _baselines(
    problem: RedundancyProblem,
    config: RedundancyTask,
    grid: Candidates,
    progress: ProgressCallback,
) -> _Baselines:
    """The ways at a constant angle and by the local method, which starts where the first one does.

    A notice says where one fails, or another angle than the task's is kept.
    """
    notices: list[str] = []
    try:
        initial = at_constant_angle(problem, grid, np.array(problem.robot.home))
    except InputError as error:
        notices.append(f"no initial trajectory to compare with: {error}")
        return _Baselines(None, None, notices)
    offset = math.degrees(abs(initial.psi[0] - problem.first_angle))
    if offset > _SAME_ANGLE_DEG:
        notices.append(
            f"the initial angle of {config.initial_angle_deg:g} deg cannot be kept from end to "
            f"end; compared is {math.degrees(initial.psi[0]):g} deg"
        )
    progress(0.7, "local method")
    try:
        local = local_descent(problem, initial.q[0])
    except InputError as error:
        notices.append(str(error))
        return _Baselines(initial, None, notices)
    return _Baselines(initial, local, notices)


class _ClearanceCheck(NamedTuple):
    """Distances along the ways.

    Attributes:
        pairs: of each checked way, by its name, the pair of shapes with the least slack; None
            where nothing is near. Empty where nothing was checked.
        free: the best way that is free, where the optimum is not; None where none was found either.
        notices: sentences on what is not checked, and what is too near.
    """

    pairs: dict[str, ClosestPair | None]
    free: Trajectory | None
    notices: list[str]


def _check_clearance(
    problem: RedundancyProblem,
    config: RedundancyTask,
    grid: Candidates,
    initial: Trajectory | None,
    optimised: Trajectory,
    progress: ProgressCallback,
) -> _ClearanceCheck:
    """Checks two ways for collisions; searches a free one where the optimised one is not.

    Nothing is checked of an arm without usable collision shapes. The free way is the best one on
    the grid.

    Args:
        initial: the way at a constant angle; None: no such way can be followed.
        progress: called with shares of the whole work, of which this is the last twentieth.
    """
    robot = problem.robot
    # A task that asks for no clearance may come as near as it likes, and not through anything.
    clearance = config.clearance or RedundancyClearance(distance=0.0, approach=0.0)
    if robot.unusable_collisions:
        links = ", ".join(robot.unusable_collisions)
        sentence = f"no usable collision shape for {links}: clearance is not checked"
        return _ClearanceCheck({}, None, [sentence])
    cell = surroundings(robot, config, clearance)
    if not cell.clearance.has_shapes:
        sentence = f"{robot.name} has no collision shapes: clearance is not checked"
        return _ClearanceCheck({}, None, [sentence])
    notices: list[str] = []
    if config.surface is None:
        notices.append(
            "the shape of a CSV's workpiece is unknown: clearance from it is not checked"
        )
    progress(0.95, "clearance")
    closest_pairs: dict[str, ClosestPair | None] = {}
    if initial is not None:
        closest_pairs["initial"] = clear_of_all(cell, problem, initial).worst
    check = clear_of_all(cell, problem, optimised)
    closest_pairs["optimised"] = check.worst
    if check.is_free:
        return _ClearanceCheck(closest_pairs, None, notices)
    shapes = ""
    if check.worst is not None:  # else E cannot come or go, and nothing is near
        pair = check.worst
        shapes = f" ({pair.first} and {pair.second}: {1e3 * pair.distance:.0f} mm)"
    ends = ", approach and retreat included" if clearance.approach > 0.0 else ""
    notices.append(
        f"the optimum keeps less than {1e3 * clearance.distance:.0f} mm from the arm itself, the "
        f"floor or the workpiece{ends}{shapes}"
    )
    free_way = best_free(cell, problem, grid, lambda f: progress(0.95 + 0.05 * f, "clearance"))
    if free_way is None:
        notices.append(
            "no collision-free trajectory on the grid; move the workpiece, or lower the clearance"
        )
    else:
        closest_pairs["free"] = clear_of_all(cell, problem, free_way).worst
    return _ClearanceCheck(closest_pairs, free_way, notices)


def _refined(
    problem: RedundancyProblem,
    on_grid: Trajectory,
    local: Trajectory | None,
    progress: ProgressCallback,
) -> Trajectory:
    """The best way refined from the grid's and the local one, by the problem's cost.

    In its mean measure it is never worse than the local method.

    Args:
        local: counts only where it keeps all constraints.
    """

    def mean(trajectory: Trajectory) -> float:
        return float(np.mean(problem.measure.values(trajectory.q)))

    refined = [refine(problem, on_grid.q, progress=lambda f: progress(0.8 + 0.1 * f, "refinement"))]
    if local is not None and problem.violation(local.q) > _CONSTRAINT_TOLERANCE:
        local = None
    if local is not None:
        refined.append(
            refine(problem, local.q, progress=lambda f: progress(0.9 + 0.05 * f, "refinement"))
        )
    best = refined[int(first_of_least([problem.cost(way.q) for way in refined]))]
    if local is not None and better(mean(local), mean(best)):
        # The cost holds smoothness, too: the best way may be smoother than the local one and its
        # measure a little worse. Here the measure comes first.
        refined.append(local)
        best = refined[int(first_of_least([mean(way) for way in refined]))]
    return best


def _constant_angles(problem: RedundancyProblem, grid: Candidates) -> Array:
    """(K,) mean measure at each constant angle, on its best branch that can be kept."""
    means = np.full(len(grid.psi), np.nan)
    for k in range(len(grid.psi)):
        column = Candidates(grid.psi[k : k + 1], np.ascontiguousarray(grid.q[:, k : k + 1]))
        if not np.all(np.any(np.isfinite(column.q[..., 0]), axis=(1, 2))):
            continue
        try:
            way = best_on_grid(problem, column)
        except InputError:
            continue
        means[k] = float(np.mean(problem.measure.values(way.q)))
    return means


def make_problem(
    robot: Robot, config: RedundancyTask, source: Path | None = None
) -> tuple[RedundancyProblem, TriangleMesh | None]:
    """The problem that a task states, and its workpiece to draw in W (None for a CSV's).

    P is the workpiece's frame, in which its surface or the points of its CSV are given.

    Args:
        source: the task's file; relative paths in it start from its folder.

    Raises:
        InputError: the task contradicts itself.
    """
    check_joints(robot.chain, robot.name)
    name = str(source) if source else "task"
    folder = source.parent if source else Path()
    _check_task(config, name)
    pose = config.workpiece
    R_WP = np.asarray(RollPitchYaw(pose.rpy).ToRotationMatrix().matrix(), dtype=np.float64)
    p_WP = np.array(pose.xyz, dtype=np.float64)
    workpiece = None
    if config.csv is not None:
        path = SurfacePath.read_csv(folder / config.csv, R_WP, p_WP)
    else:
        patch = config.surface
        assert patch is not None  # `_check_task`: one of csv and surface
        surface = _surface(patch, name)
        start, end = (patch.start[0], patch.start[1]), (patch.end[0], patch.end[1])
        path = SurfacePath.on_surface(
            surface, start, end, patch.num_samples, R_WP, p_WP, f"{name}: surface"
        )
        vertices, triangles = mesh(surface)
        workpiece = TriangleMesh(vertices @ R_WP.T + p_WP, triangles)
    # rad; a joint that slides may move by the same number of m, but has no margin, which is an
    # angle.
    step = math.radians(config.max_joint_step_deg)
    margins = np.where(robot.chain.prismatic, 0.0, math.radians(config.limit_margin_deg))
    lower, upper = robot.position_lower + margins, robot.position_upper - margins
    lower, upper = narrowed_limits(robot, config.joint_ranges_deg, lower, upper, name)
    if np.any(lower >= upper):
        joint = robot.joint_names[int(np.argmax(lower - upper))]
        raise InputError(name, "limit_margin_deg, joint_ranges_deg", f"leave {joint} no range")
    axis = np.array(config.tool_axis)
    problem = RedundancyProblem(
        robot=robot,
        path=path,
        tool_axis_E=axis / np.linalg.norm(axis),
        measure=_measure(robot, config, folder),
        lower=lower,
        upper=upper,
        max_step=np.full(robot.num_joints, step),
        smoothness=config.smoothness,
        num_angles=config.num_angles,
        first_angle=math.radians(config.initial_angle_deg),
    )
    return problem, workpiece


def _check_task(config: RedundancyTask, name: str) -> None:
    check_numbers(config, name)
    if (config.surface is None) == (config.csv is None):
        raise InputError(name, "", "expected one of surface and csv")
    if config.objective not in OBJECTIVES:
        expected = " or ".join(OBJECTIVES)
        raise InputError(name, "objective", f'expected {expected}, found "{config.objective}"')
    if len(config.tool_axis) != 3 or not np.linalg.norm(config.tool_axis) > 1e-9:
        raise InputError(name, "tool_axis", "expected three numbers that make a direction")
    if len(config.workpiece.xyz) != 3 or len(config.workpiece.rpy) != 3:
        raise InputError(name, "workpiece", "xyz and rpy take three numbers each")
    if config.surface is not None:
        for key in ("start", "end"):
            if len(getattr(config.surface, key)) != 2:
                raise InputError(name, f"surface.{key}", "expected the two numbers u, v")
    for key, low, high in (
        ("limit_margin_deg", 0.0, 90.0),
        ("max_joint_step_deg", 0.01, 60.0),
        ("smoothness", 0.0, 1e6),
        ("num_angles", 4, 720),
    ):
        value = getattr(config, key)
        if not low <= value <= high:
            raise InputError(name, key, f"{value:g}, expected {low:g} to {high:g}")


def _surface(patch: PatchPathConfig, name: str) -> Surface:
    if patch.plate is not None and patch.blade is None:
        return patch.plate.surface()
    if patch.blade is not None and patch.plate is None:
        return patch.blade.surface()
    raise InputError(name, "surface", "expected one of plate and blade")


def _measure(robot: Robot, config: RedundancyTask, folder: Path) -> PostureMeasure:
    model = None
    if config.objective != "jcn" and config.model is not None:
        model = IdentifiedModel.load(folder / config.model, robot)
    return measure_of(robot, config.objective, model)[0]
