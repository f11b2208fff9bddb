"""Path on a surface: how to use the free angle about the normal (section 4.4, Figs. 11-13).

Command `redundancy --task T`, and experiment `surface-path`. Three ways along one path are
compared: at a constant angle (initial), by the local method that the article uses, and the optimum
(dynamic programming over a grid of angles and all branches, then refined continuously).

A task names a surface, where the workpiece stands, and how the tool is held (see `RedundancyTask`):

    surface: {blade: {}, start: [0.75, 0.15], end: [0.75, 0.85], num_samples: 121}
    workpiece: {xyz: [0.45, -0.25, 0.25], rpy: [0, 0, 0]}
    tool_axis: [0.7071, 0, 0.7071]
    initial_angle_deg: 60

or, in the place of the surface, `csv: points.csv` with the columns x,y,z,nx,ny,nz.
"""

import csv
import io
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RollPitchYaw

from analyses.output.figures import COLOUR, SERIES, new_figure, save_figure
from analyses.output.outputs import OutputFolder
from analyses.study.experiment import (
    ComparisonRow,
    Experiment,
    ExperimentContext,
    ExperimentResult,
    FigureFile,
)
from diagrams.pages.path_page import PathMotion, TriangleMesh, record_paths
from models.estimation.wrench import WrenchReconstructionConfig, live_prior
from models.files.configuration import REQUIRED, load_configuration
from models.files.input_error import InputError
from models.files.task_files import task_file
from models.identification.identified_model import IdentifiedModel
from models.motion.branches import is_closed_form
from models.motion.posture_measures import ConditionNumber, ForceSd, PostureMeasure
from models.motion.redundancy import (
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
from models.motion.surface_path import SurfacePath
from models.motion.workpieces import BladeSection, Plate, Surface, mesh
from models.rigid_body.ties import better, first_of_least
from models.robot.robot import PoseConfig, Robot

Array = NDArray[np.float64]
OBJECTIVES = ("jcn", "force-sd")


@dataclass
class PlateConfig:
    """A flat rectangle; m."""

    length: float = 0.4  # along x and u
    width: float = 0.3  # along y and v


@dataclass
class BladeConfig:
    """A section of a wind turbine blade; see `models.motion.workpieces.BladeSection`."""

    span: float = 0.5  # m, along y and v
    root_chord: float = 0.34  # m, along x
    tip_chord: float = 0.26  # m
    root_twist_deg: float = 10.0
    tip_twist_deg: float = 2.0
    thickness: float = 0.24  # of the chord
    camber: float = 0.05  # of the chord


@dataclass
class PatchPathConfig:
    """A path on a bundled workpiece, straight in its parameters; one of plate and blade."""

    plate: PlateConfig | None = None
    blade: BladeConfig | None = None
    start: list[float] = field(default_factory=list, metadata=REQUIRED)  # (u, v)
    end: list[float] = field(default_factory=list, metadata=REQUIRED)
    num_samples: int = 121


@dataclass
class RedundancyTask:
    """What `redundancy --task` reads."""

    surface: PatchPathConfig | None = None  # this, or
    csv: Path | None = None  # x,y,z,nx,ny,nz in the workpiece's frame; beside the task's file
    workpiece: PoseConfig = field(default_factory=PoseConfig)  # its frame in W
    tool_axis: list[float] = field(default_factory=lambda: [0.0, 0.0, 1.0])
    # working direction of the tool in axes of E; it points into the surface
    objective: str = "jcn"  # or force-sd
    model: Path | None = None  # of force-sd: model.yaml of `identify`; without it the nominal one
    initial_angle_deg: float = 0.0  # of the trajectory to compare with, about the normal
    limit_margin_deg: float = 3.0  # kept from every joint limit
    joint_ranges_deg: dict[str, list[float]] = field(default_factory=dict)
    # narrower limits of joints by their names, [lower, upper] (m of prismatic ones); so a branch
    # can be ruled out, such as an elbow that would hang into the workpiece
    max_joint_step_deg: float = 6.0  # from one sample to the next
    smoothness: float = 0.002  # weight of the joints' motion, objective per rad^2
    num_angles: int = 72  # of the grid


@dataclass(frozen=True, eq=False)
class RedundancyResult:
    """What `find_redundancy` found.

    Attributes:
        initial: at a constant angle; None if none can be kept.
        local: the baseline, from the initial trajectory's first posture; None where it fails.
        on_grid: the optimum over the grid and all branches.
        optimised: the refined one.
        constant_angles: (K,) mean measure at each constant angle of the grid, NaN where it cannot
            be kept.
        notices: sentences for the user.
    """

    problem: RedundancyProblem
    initial: Trajectory | None
    local: Trajectory | None
    on_grid: Trajectory
    optimised: Trajectory
    constant_angles: Array
    workpiece: TriangleMesh | None
    notices: tuple[str, ...]

    def metrics(self) -> dict[str, Any]:
        """Nested figures; the measure's key carries its unit."""
        problem, key = self.problem, self.problem.measure.key
        after = problem.measure.values(self.optimised.q)
        error, _ = task(problem, self.optimised.q)
        kept = self.constant_angles[np.isfinite(self.constant_angles)]
        best_kept = float(np.min(kept)) if kept.size else math.nan
        metrics: dict[str, Any] = {
            "samples": problem.path.num_samples,
            "path_length_m": float(problem.path.distance[-1]),
            "grid": self._figures(self.on_grid),
            "optimised": {
                **self._figures(self.optimised),
                "position_error_m": float(np.max(np.linalg.norm(error[:, 2:], axis=1))),
                "normal_error_rad": float(np.max(np.linalg.norm(error[:, :2], axis=1))),
                "max_joint_step_deg": math.degrees(
                    float(np.max(np.abs(np.diff(self.optimised.q, axis=0))))
                ),
                "angle_range_deg": math.degrees(float(np.ptp(self.optimised.psi))),
            },
            "constant_angle": {
                f"best_mean_{key}": best_kept,
                f"median_mean_{key}": float(np.median(kept)) if kept.size else math.nan,
                f"worst_mean_{key}": float(np.max(kept)) if kept.size else math.nan,
                "angles_kept": int(kept.size),
            },
        }
        if self.initial is not None:
            before = problem.measure.values(self.initial.q)
            metrics["initial"] = self._figures(self.initial)
            metrics["reduction_mean_pct"] = 100.0 * (1.0 - float(np.mean(after) / np.mean(before)))
            metrics["samples_lower"] = int(np.count_nonzero(after < before))
        if self.local is not None:
            metrics["local"] = self._figures(self.local)
        return metrics

    def _figures(self, trajectory: Trajectory) -> dict[str, float]:
        values, key = self.problem.measure.values(trajectory.q), self.problem.measure.key
        return {f"mean_{key}": float(np.mean(values)), f"max_{key}": float(np.max(values))}


def find_redundancy(
    robot: Robot,
    config: RedundancyTask,
    source: Path | None = None,
    progress: Callable[[float, str], None] = lambda fraction, what: None,
) -> RedundancyResult:
    """Chooses a posture at each sample of the task's path.

    Interrupted while it refines, it returns the optimum on the grid.

    Args:
        source: the task's file; relative paths in it start from its folder.

    Raises:
        InputError: the task contradicts itself, or a sample is out of reach.
    """
    problem, workpiece = make_problem(robot, config, source)
    notices = []
    if not is_closed_form(robot):
        notices.append(
            f"{robot.name} has no known analytic inverse kinematics: its postures are what a "
            "search found, so that the optimum is that of the postures found"
        )
    grid = candidates(problem, lambda f: progress(0.6 * f, "postures on the grid"))
    progress(0.6, "dynamic programming")
    on_grid = best_on_grid(problem, grid)
    initial = local = None
    try:
        initial = at_constant_angle(problem, grid, np.array(robot.home))
    except InputError as error:
        notices.append(f"no initial trajectory to compare with: {error}")
    else:
        offset = math.degrees(abs(initial.psi[0] - problem.first_angle))
        if offset > 1e-6:
            notices.append(
                f"the initial angle of {config.initial_angle_deg:g} deg cannot be kept from end to "
                f"end; compared is {math.degrees(initial.psi[0]):g} deg"
            )
        progress(0.7, "local method")
        try:
            local = local_descent(problem, initial.q[0])
        except InputError as error:
            notices.append(str(error))
    try:
        optimised = _refined(problem, on_grid, local, progress)
    except KeyboardInterrupt:
        optimised = on_grid
        notices.append("interrupted: this is the optimum on the grid of angles, not refined")
    if np.ptp(problem.measure.values(grid.q[0][np.isfinite(grid.q[0, :, :, 0])])) < 1e-6:
        notices.append("no angle and no branch makes a difference: " + problem.measure.label)
    progress(1.0, "done")
    return RedundancyResult(
        problem,
        initial,
        local,
        on_grid,
        optimised,
        _constant_angles(problem, grid),
        workpiece,
        tuple(notices),
    )


def _refined(
    problem: RedundancyProblem,
    on_grid: Trajectory,
    local: Trajectory | None,
    progress: Callable[[float, str], None],
) -> Trajectory:
    """The best of both starts; in its mean measure never worse than the local method."""

    def mean(trajectory: Trajectory) -> float:
        return float(np.mean(problem.measure.values(trajectory.q)))

    found = [refine(problem, on_grid.q, progress=lambda f: progress(0.8 + 0.1 * f, "refinement"))]
    if local is not None and problem.violation(local.q) <= 1e-7:
        found.append(
            refine(problem, local.q, progress=lambda f: progress(0.9 + 0.1 * f, "refinement"))
        )
    best = found[int(first_of_least([problem.cost(trajectory.q) for trajectory in found]))]
    if local is None or problem.violation(local.q) > 1e-7:
        return best
    if better(mean(local), mean(best)):
        # Smoother than the local one, and for that a little worse: here the measure comes first.
        found.append(local)
        best = found[int(first_of_least([mean(trajectory) for trajectory in found]))]
    return best


def _constant_angles(problem: RedundancyProblem, grid: Candidates) -> Array:
    """(K,) mean measure at each constant angle, on its best branch that can be kept."""
    means = np.full(len(grid.psi), np.nan)
    for k in range(len(grid.psi)):
        one = Candidates(grid.psi[k : k + 1], np.ascontiguousarray(grid.q[:, k : k + 1]))
        if not np.all(np.any(np.isfinite(one.q[..., 0]), axis=(1, 2))):
            continue
        try:
            kept = best_on_grid(problem, one)
        except InputError:
            continue
        means[k] = float(np.mean(problem.measure.values(kept.q)))
    return means


def make_problem(
    robot: Robot, config: RedundancyTask, source: Path | None = None
) -> tuple[RedundancyProblem, TriangleMesh | None]:
    """The problem that a task states, and its workpiece to draw (None for a CSV's).

    Raises:
        InputError: the task contradicts itself.
    """
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
        assert patch is not None
        surface = _surface(patch, name)
        start, end = (patch.start[0], patch.start[1]), (patch.end[0], patch.end[1])
        path = SurfacePath.on_surface(
            surface, start, end, patch.num_samples, R_WP, p_WP, f"{name}: surface"
        )
        vertices, triangles = mesh(surface)
        workpiece = TriangleMesh(vertices @ R_WP.T + p_WP, triangles)
    margin = math.radians(config.limit_margin_deg)
    step = math.radians(config.max_joint_step_deg)
    margins = np.where(robot.chain.prismatic, 0.0, margin)
    lower, upper = robot.position_lower + margins, robot.position_upper - margins
    for joint, limits in config.joint_ranges_deg.items():
        if joint not in robot.joint_names or len(limits) != 2 or not limits[0] < limits[1]:
            known = ", ".join(robot.joint_names)
            raise InputError(
                name, f"joint_ranges_deg.{joint}", "expected [lower, upper]", f"joints are {known}"
            )
        j = robot.joint_names.index(joint)
        unit = 1.0 if robot.chain.prismatic[j] else math.pi / 180.0
        lower[j], upper[j] = max(lower[j], unit * limits[0]), min(upper[j], unit * limits[1])
    if np.any(lower >= upper):
        joint = robot.joint_names[int(np.argmax(lower - upper))]
        raise InputError(name, "limit_margin_deg, joint_ranges_deg", f"leave {joint} no room")
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
    if (patch.plate is None) == (patch.blade is None):
        raise InputError(name, "surface", "expected one of plate and blade")
    if patch.plate is not None:
        return Plate(patch.plate.length, patch.plate.width)
    blade = patch.blade
    assert blade is not None
    return BladeSection(
        blade.span,
        blade.root_chord,
        blade.tip_chord,
        math.radians(blade.root_twist_deg),
        math.radians(blade.tip_twist_deg),
        blade.thickness,
        blade.camber,
    )


def _measure(robot: Robot, config: RedundancyTask, folder: Path) -> PostureMeasure:
    if config.objective == "jcn":
        return ConditionNumber(robot.chain)
    if config.model is not None:
        model = IdentifiedModel.load(folder / config.model, robot)
    else:
        model = IdentifiedModel.nominal(robot)
    prior = WrenchReconstructionConfig().with_prior(*live_prior(robot.payload))
    return ForceSd(robot.chain, model.residual_covariance, prior)


def redundancy(
    task_name: str | Path,
    robot_name: str,
    out: Path,
    progress: Callable[[float, str], None] = lambda fraction, what: None,
) -> RedundancyResult:
    """The command `redundancy`, for a bundled task or a task's file: writes trajectory.csv,
    metrics.json, config.yaml, figures and recording.html into `out`.

    Raises:
        InputError: see `find_redundancy`; or `out` cannot be written to.
    """
    folder = OutputFolder(out)
    robot = Robot.load(robot_name)
    source = task_file(task_name, "redundancy")
    config = load_configuration(source, RedundancyTask)
    result = find_redundancy(robot, config, source, progress)
    folder.write_text("trajectory.csv", trajectory_csv(result))
    draw(result, out)
    metrics = {**result.metrics(), "notices": list(result.notices)}
    folder.write_json("metrics.json", metrics)
    folder.write_yaml("config.yaml", {"robot": robot_name, "task": config})
    return result


def trajectory_csv(result: RedundancyResult) -> str:
    """One row a sample: place, angle about the normal, joint positions, measure before and after.

    Distances in m, angles in rad.
    """
    problem, path = result.problem, result.problem.path
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    key = problem.measure.key
    joints = [f"q{j + 1}" for j in range(problem.robot.num_joints)]
    writer.writerow(["s", "x", "y", "z", "nx", "ny", "nz", "psi", *joints, key, f"{key}_initial"])
    after = problem.measure.values(result.optimised.q)
    before = np.full(len(after), np.nan)
    if result.initial is not None:
        before = problem.measure.values(result.initial.q)
    columns = (path.distance, path.p_WS, path.n_W, result.optimised.psi, result.optimised.q)
    rows = np.column_stack([*columns, after, before])
    writer.writerows([[repr(float(value)) for value in row] for row in rows])
    return text.getvalue()


def draw(result: RedundancyResult, out: Path) -> tuple[list[FigureFile], list[FigureFile]]:
    """Writes figures and the recording below `out`; returns both lists."""
    figures = [
        FigureFile(path.relative_to(out), caption)
        for path, caption in (
            _draw_measure(result, out / "figures" / "measure.png"),
            _draw_poses(result, out / "figures" / "poses.png"),
            _draw_joints(result, out / "figures" / "joints.png"),
        )
    ]
    values = result.problem.measure.values
    motions = [
        PathMotion(name, trajectory.q, values(trajectory.q))
        for name, trajectory in (("initial", result.initial), ("optimised", result.optimised))
        if trajectory is not None
    ]
    label = "JCN" if result.problem.measure.key == "jcn" else "force sd [N]"
    record_paths(
        result.problem.robot,
        motions,
        out / "recording.html",
        "Path on the surface",
        label=label,
        workpiece=result.workpiece,
    )
    caption = "The arm on the initial and on the optimised trajectory; the path's colour: " + label
    return figures, [FigureFile(Path("recording.html"), caption + ".")]


def _ways(result: RedundancyResult) -> list[tuple[str, Trajectory, str]]:
    ways = [
        ("initial, constant angle", result.initial, COLOUR["before"]),
        ("local method", result.local, COLOUR["article"]),
        ("optimised", result.optimised, COLOUR["after"]),
    ]
    return [(name, way, colour) for name, way, colour in ways if way is not None]


def _draw_measure(result: RedundancyResult, path: Path) -> tuple[Path, str]:
    figure, axes = new_figure(2, 1, height=5.0, share_x=True)
    distance, measure = result.problem.path.distance, result.problem.measure
    for name, way, colour in _ways(result):
        values = measure.values(way.q)
        label = f"{name} (mean {np.mean(values):.2f})"
        axes[0, 0].plot(distance, values, color=colour, label=label)
        axes[1, 0].plot(distance, np.degrees(way.psi), color=colour)
    axes[0, 0].set_ylabel(measure.label)
    axes[0, 0].set_yscale("log")
    axes[0, 0].yaxis.set_major_formatter("{x:g}")
    axes[0, 0].yaxis.set_minor_formatter("{x:g}")
    axes[1, 0].set_ylabel("angle about the normal [deg]")
    axes[1, 0].set_xlabel("distance along the path [m]")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    save_figure(figure, path)
    return path, "Measure and angle about the normal along the path (Fig. 11)."


def _draw_poses(result: RedundancyResult, path: Path) -> tuple[Path, str]:
    """The tool's axes at some samples, seen from above and from the side."""
    ways = [way for way in _ways(result) if way[0] != "local method"]
    figure, axes = new_figure(len(ways), 2, height=3.0 * len(ways))
    p = result.problem.path.p_WS
    shown = np.linspace(0, len(p) - 1, 13).round().astype(int)
    length = 0.14 * float(np.max(np.ptp(p, axis=0)))
    for row, (name, way, _) in enumerate(ways):
        R_WE, p_WE = result.problem.robot.chain.pose(way.q[shown])
        for column, (first, second) in enumerate(((0, 1), (1, 2))):
            ax = axes[row, column]
            ax.plot(p[:, first], p[:, second], color=COLOUR["truth"], linewidth=0.8)
            for axis in range(3):
                tip = p_WE + length * R_WE[:, :, axis]
                ax.plot(
                    np.stack([p_WE[:, first], tip[:, first]]),
                    np.stack([p_WE[:, second], tip[:, second]]),
                    color=SERIES[axis],
                    linewidth=1.4,
                )
                ax.plot([], [], color=SERIES[axis], label="xyz"[axis] + " of the tool")
            ax.set_aspect("equal", adjustable="datalim")
            ax.set_title(f"{name}, {'from above' if column == 0 else 'from ahead'}")
            ax.set_xlabel(f"{'xyz'[first]} [m]")
            ax.set_ylabel(f"{'xyz'[second]} [m]")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    save_figure(figure, path)
    return path, "The tool's axes at every tenth of the path, before and after (Fig. 12)."


def _draw_joints(result: RedundancyResult, path: Path) -> tuple[Path, str]:
    ways = [way for way in _ways(result) if way[0] != "local method"]
    figure, axes = new_figure(1, len(ways), height=3.4, share_y=True)
    distance = result.problem.path.distance
    for column, (name, way, _) in enumerate(ways):
        ax = axes[0, column]
        for j, joint in enumerate(result.problem.robot.joint_names):
            colour = SERIES[j % len(SERIES)]
            ax.plot(distance, np.degrees(way.q[:, j]), color=colour, label=joint)
        ax.set_title(name)
        ax.set_xlabel("distance along the path [m]")
    axes[0, 0].set_ylabel("joint position [deg]")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=7)
    save_figure(figure, path)
    return path, "Joint positions along the path, before and after (Fig. 13)."


def run(context: ExperimentContext) -> ExperimentResult:
    """The experiment `surface-path` of `study`."""
    robot = Robot.load("sts_sre4_600")
    config = load_configuration(task_file("blade_path", "redundancy"), RedundancyTask)
    result = find_redundancy(robot, config, progress=context.progress)
    metrics = result.metrics()
    figures, recordings = draw(result, context.out)
    before, after = metrics["initial"]["mean_jcn"], metrics["optimised"]["mean_jcn"]
    constant = metrics["constant_angle"]
    return ExperimentResult(
        metrics=metrics,
        figures=figures,
        recordings=recordings,
        comparison=[
            ComparisonRow(
                "Samples with a lower JCN", "samples_lower", "", None, "the article: every one"
            ),
            ComparisonRow("Mean JCN on the surface, initial", "initial.mean_jcn", "", None),
            ComparisonRow("Mean JCN on the surface, optimised", "optimised.mean_jcn", "", None),
            ComparisonRow("Mean JCN on the surface, local method", "local.mean_jcn", "", None),
        ],
        notes=[
            f"The free angle about the normal takes the mean JCN from {before:.2f} to {after:.2f} "
            f"and lowers it at {metrics['samples_lower']} of {metrics['samples']} samples; the "
            f"local method that the article uses ends at {metrics['local']['mean_jcn']:.2f}.",
            "The initial trajectory keeps the angle 0, at which the tool leans along the path. No "
            "figure of the article says how good its own was. Of the angles on the grid "
            f"{constant['angles_kept']} can be kept from end to end: at the best of them, on its "
            f"best branch, the mean is {constant['best_mean_jcn']:.2f}, at the middle one "
            f"{constant['median_mean_jcn']:.2f}, at the worst {constant['worst_mean_jcn']:.2f}.",
            "Joint 3 is kept between -120 and 90 deg, so that the elbow stays above the blade: "
            "collisions are not checked otherwise.",
            "The tool is held at 45 deg to the surface's normal, as an inclined spindle is. Held "
            "along the normal, its axis would be that of joint 6, on which no JCN depends: then "
            "only the branch can be chosen.",
            "Position and normal hold to "
            f"{metrics['optimised']['position_error_m']:.1e} m and "
            f"{metrics['optimised']['normal_error_rad']:.1e} rad. On the grid of "
            f"{config.num_angles} angles the optimum's mean is {metrics['grid']['mean_jcn']:.3f}; "
            f"refined, {after:.3f}.",
            *result.notices,
        ],
        configuration={"robot": robot.name, "task": config},
    )


EXPERIMENT = Experiment(
    name="surface-path",
    title="A path on a curved surface, with the angle about the normal free",
    section="4.4, Figs. 11-13",
    run=run,
)
