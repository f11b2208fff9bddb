"""The files of a placement: metrics, postures, figures and the page on which the arm moves."""

from pathlib import Path
from typing import Any

import numpy as np

from wrenchsight.analyses.methods.place.place_settings import PlaceSettings
from wrenchsight.analyses.methods.place.placement_result import PlacementResult, Profile
from wrenchsight.analyses.output.axes import log_scale
from wrenchsight.analyses.output.figures import COLOUR, SERIES, legend_on_top, new_figure
from wrenchsight.analyses.output.outputs import OutputFolder
from wrenchsight.diagrams.pages.cell_picture import cell_picture
from wrenchsight.diagrams.pages.path_page import PathMotion, write_path_page
from wrenchsight.models.planning.motion.posture_cost import (
    PostureMeasure,
)


def write_placement(folder: OutputFolder, result: PlacementResult, settings: PlaceSettings) -> None:
    """Writes metrics, configuration, times, the postures, figures and the recording."""
    folder.write_json("metrics.json", result.metrics())
    folder.write_settings("config.yaml", settings)
    folder.write_json(
        "timings.json",
        {
            "search_seconds": round(result.seconds, 3),
            "history": [[round(t, 4), cost] for t, cost in result.search.history],
        },
    )
    folder.write_text("postures.csv", _postures_csv(result))
    draw_profiles(folder, "path", result.initial, result.best, result.measure)
    figure, axes = new_figure(1, 1, height=3.0)
    draw_history(axes[0, 0], result.search.history, COLOUR["after"], result.solver)
    axes[0, 0].set_xlabel("time [s]")
    axes[0, 0].set_ylabel(f"best mean of the\n{result.measure.label}")
    folder.write_figure("convergence", figure)
    # A workpiece stands where the best path is; the initial one would run through it.
    alone = result.task.clearance is not None
    write_placement_page(result, folder / "recording.html", "Placement", with_initial=not alone)


def write_placement_page(
    result: PlacementResult, path: Path, title: str, *, with_initial: bool = True
) -> None:
    """Writes the web page in which the arm follows the initial and the best path."""
    motions = []
    if with_initial and result.initial is not None:
        motions.append(PathMotion("initial", result.initial.fine.q, result.initial.fine_jcn))
    motions.append(PathMotion("optimised", result.best.fine.q, result.best.fine_jcn))
    write_path_page(
        result.robot,
        motions,
        path,
        title,
        workpiece=cell_picture(result.task.clearance, result.best.placement),
    )


def draw_profiles(
    folder: OutputFolder,
    name: str,
    initial: Profile | None,
    best: Profile,
    measure: PostureMeasure,
) -> Path:
    """Draws condition number and objective along both paths, joints along the best one (Fig. 8).

    Args:
        name: of the figure's file.
        initial: None: there is none.
        measure: the objective, which has a panel unless it is the condition number.

    Returns:
        The figure's file.
    """
    has_objective = measure.key != "jcn"
    rows = 3 if has_objective else 2
    figure, axes = new_figure(rows, 1, height=2.5 * rows, share_x=True)
    cases = [("initial", initial, COLOUR["before"])] if initial is not None else []
    cases.append(("optimised", best, COLOUR["after"]))
    # Parts of the path at the fine points, of which every profile has as many (FINE_POINTS).
    fine = np.linspace(0.0, 1.0, len(best.fine.q))
    for label, profile, colour in cases:
        mean, largest = np.mean(profile.jcn), np.max(profile.fine_jcn)
        axes[0, 0].plot(
            fine,
            profile.fine_jcn,
            color=colour,
            label=f"{label} (mean {mean:.2f}, largest {largest:.2f})",
        )
        if has_objective:
            axes[1, 0].plot(fine, profile.fine_measure, color=colour)
    log_scale(axes[0, 0], "y")
    axes[0, 0].set_ylabel("condition number of J")
    if has_objective:
        axes[1, 0].set_ylabel(measure.label)
    ax = axes[rows - 1, 0]
    for joint in range(best.fine.q.shape[1]):
        colour = SERIES[joint % len(SERIES)]
        ax.plot(fine, best.fine.q[:, joint], color=colour, label=f"$q_{{{joint + 1}}}$")
    ax.set_ylabel("optimised joints [rad]")
    ax.set_xlabel("part of the path")
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    legend_on_top(figure, axes[0, 0], ncols=len(cases))
    return folder.write_figure(name, figure)


def draw_history(ax: Any, history: list[tuple[float, float]], colour: str, label: str) -> None:
    """Draws the best cost over time, as steps, on a logarithmic axis of time."""
    if not history:
        return
    t = np.array([max(time_, 1e-3) for time_, _ in history])
    cost = np.array([cost for _, cost in history])
    ax.step(
        np.append(t, 1.3 * t[-1]),
        np.append(cost, cost[-1]),
        where="post",
        color=colour,
        label=label,
    )
    ax.set_xscale("log")


def _postures_csv(result: PlacementResult) -> str:
    fine, jcn = result.best.fine, result.best.fine_jcn
    names = [f"{name}_rad" for name in result.robot.joint_names]
    lines = [",".join(["s", "x_m", "y_m", "z_m", *names, "jcn"])]
    _, p = result.robot.chain.pose(fine.q)
    for i, row in enumerate(fine.q):
        numbers = [i / (len(fine.q) - 1), *p[i], *row, jcn[i]]
        lines.append(",".join(repr(float(number)) for number in numbers))
    return "\n".join(lines) + "\n"
