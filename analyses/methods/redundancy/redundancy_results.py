"""Files of `redundancy`: joints along the path, figures (Figs. 11 to 13) and a page."""

import csv
import io
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from wrenchsight.analyses.methods.redundancy.redundancy import RedundancyResult, find_redundancy
from wrenchsight.analyses.methods.redundancy.redundancy_task import (
    RedundancySettings,
    RedundancyTask,
)
from wrenchsight.analyses.output.axes import log_scale
from wrenchsight.analyses.output.figures import (
    COLOUR,
    SERIES,
    legend_on_top,
    new_figure,
    save_figure,
)
from wrenchsight.analyses.output.progress import ProgressCallback
from wrenchsight.analyses.output.result_folder import result_folder
from wrenchsight.analyses.study.experiment import (
    FigureFile,
)
from wrenchsight.diagrams.pages.path_page import PathMotion, write_path_page
from wrenchsight.models.files.bundled_files import task_file
from wrenchsight.models.files.configuration import load_configuration
from wrenchsight.models.planning.motion.redundancy import (
    Trajectory,
)
from wrenchsight.models.robot.robot import Robot

_NUM_DRAWN_POSES = 13  # at both ends and every twelfth of the path
_DRAWN_AXIS_SHARE = 0.14  # of the path's largest extent


def draw(result: RedundancyResult, out: Path) -> tuple[list[FigureFile], list[FigureFile]]:
    """Writes figures and the recording below `out`.

    Returns:
        Figures and pages, with paths relative to `out` and captions, for an experiment's report.
    """
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
        for name, trajectory in (("initial", result.initial), (_name_of_way(result), result.way))
        if trajectory is not None
    ]
    label = "JCN" if result.problem.measure.key == "jcn" else "force sd [N]"  # the two measures
    write_path_page(
        result.problem.robot,
        motions,
        out / "recording.html",
        "Path on the surface",
        label=label,
        workpiece=result.workpiece,
    )
    caption = "The arm on the initial and on the optimised trajectory; the path's colour: " + label
    return figures, [FigureFile(Path("recording.html"), caption + ".")]


class _DrawnWay(NamedTuple):
    name: str
    trajectory: Trajectory
    colour: str


def _ways(result: RedundancyResult, with_local: bool = True) -> list[_DrawnWay]:
    ways = []
    if result.initial is not None:
        ways.append(_DrawnWay("initial, constant angle", result.initial, COLOUR["before"]))
    if with_local and result.local is not None:
        ways.append(_DrawnWay("local method", result.local, COLOUR["article"]))
    return [*ways, _DrawnWay(_name_of_way(result), result.way, COLOUR["after"])]


def _name_of_way(result: RedundancyResult) -> str:
    return "optimised" if result.free is None else "optimised, with clearance"


def _draw_measure(result: RedundancyResult, path: Path) -> tuple[Path, str]:
    figure, axes = new_figure(2, 1, height=5.0, share_x=True)
    distance, measure = result.problem.path.distance, result.problem.measure
    for name, way, colour in _ways(result):
        values = measure.values(way.q)
        label = f"{name} (mean {np.mean(values):.2f})"
        axes[0, 0].plot(distance, values, color=colour, label=label)
        axes[1, 0].plot(distance, np.degrees(way.psi), color=colour)
    axes[0, 0].set_ylabel(measure.label)
    log_scale(axes[0, 0], "y")
    axes[1, 0].set_ylabel("angle about the normal [deg]")
    axes[1, 0].set_xlabel("distance along the path [m]")
    legend_on_top(figure, axes[0, 0], ncols=3)
    save_figure(figure, path)
    return path, "Measure and angle about the normal along the path (Fig. 11)."


def _draw_poses(result: RedundancyResult, path: Path) -> tuple[Path, str]:
    """The tool's axes at some samples, seen from above and from ahead; its file and caption.

    A row of panels is a way, the initial one first; an axis is drawn as a line from E to its tip.
    """
    ways = _ways(result, with_local=False)
    figure, axes = new_figure(len(ways), 2, height=3.0 * len(ways))
    p = result.problem.path.p_WS
    shown = np.linspace(0, len(p) - 1, _NUM_DRAWN_POSES).round().astype(int)
    length = _DRAWN_AXIS_SHARE * float(np.max(np.ptp(p, axis=0)))  # m
    for row, (name, way, _) in enumerate(ways):
        R_WE, p_WE = result.problem.robot.chain.pose(way.q[shown])
        for column, (i, j) in enumerate(((0, 1), (1, 2))):  # axes of W to the right and up
            ax = axes[row, column]
            ax.plot(p[:, i], p[:, j], color=COLOUR["truth"], linewidth=0.8)
            for axis in range(3):
                tip = p_WE + length * R_WE[:, :, axis]
                ax.plot(
                    np.stack([p_WE[:, i], tip[:, i]]),
                    np.stack([p_WE[:, j], tip[:, j]]),
                    color=SERIES[axis],
                    linewidth=1.4,
                )
                ax.plot([], [], color=SERIES[axis], label="xyz"[axis] + " of the tool")
            ax.set_aspect("equal", adjustable="datalim")
            ax.set_title(f"{name}, {'from above' if column == 0 else 'from ahead'}")
            ax.set_xlabel(f"{'xyz'[i]} [m]")
            ax.set_ylabel(f"{'xyz'[j]} [m]")
    legend_on_top(figure, axes[0, 0], ncols=3)
    save_figure(figure, path)
    # Every twelfth: _NUM_DRAWN_POSES less one.
    return path, "The tool's axes at every twelfth of the path, before and after (Fig. 12)."


def _draw_joints(result: RedundancyResult, path: Path) -> tuple[Path, str]:
    ways = _ways(result, with_local=False)
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
    legend_on_top(figure, axes[0, 0], ncols=7)
    save_figure(figure, path)
    return path, "Joint positions along the path, before and after (Fig. 13)."


def redundancy(
    settings: RedundancySettings,
    out: Path,
    progress: ProgressCallback = lambda fraction, message: None,
) -> RedundancyResult:
    """The command `redundancy`: writes trajectory.csv (of the best way that keeps the
    clearance), metrics.json, config.yaml, figures and recording.html into `out`.

    Args:
        settings: its `task_content` is used instead of the content of the task that it names.

    Raises:
        InputError: see `find_redundancy`; or `out` cannot be written to.
    """
    with result_folder(out, "redundancy") as folder:
        robot = Robot.load(settings.robot)
        source = task_file(settings.task, "redundancy")
        config = settings.task_content or load_configuration(source, RedundancyTask)
        result = find_redundancy(robot, config, source, progress)
        folder.write_text("trajectory.csv", trajectory_csv(result, result.way))
        draw(result, folder.path)
        metrics = {**result.metrics(), "notices": list(result.notices)}
        folder.write_json("metrics.json", metrics)
        folder.write_settings("config.yaml", replace(settings, task_content=config))
    return result


def trajectory_csv(result: RedundancyResult, way: Trajectory) -> str:
    """One row a sample of a way: place, angle about the normal, joint positions, its measure and
    that of the initial way.

    Distances in m, angles in rad.
    """
    problem, path = result.problem, result.problem.path
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    key = problem.measure.key
    joints = [f"q{j + 1}" for j in range(problem.robot.num_joints)]
    writer.writerow(["s", "x", "y", "z", "nx", "ny", "nz", "psi", *joints, key, f"{key}_initial"])
    measure = problem.measure.values(way.q)
    initial_measure = np.full(len(measure), np.nan)
    if result.initial is not None:
        initial_measure = problem.measure.values(result.initial.q)
    columns = (path.distance, path.p_WS, path.n_W, way.psi, way.q)
    rows = np.column_stack([*columns, measure, initial_measure])
    writer.writerows([[repr(float(value)) for value in row] for row in rows])
    return text.getvalue()
