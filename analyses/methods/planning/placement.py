"""Where to put a straight path, and how the arm should stand (sections 3.2 and 4.3).

Command `place --task T.yaml`. The answer is a path in its place, the tool's rotation, and postures
on one branch along it; beside it stand the local optima that were met on the way and what the
task's own guess would have given.
"""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.analyses.methods.planning.particle_swarm import SwarmConfig, place_by_swarm
from wrenchsight.analyses.methods.planning.place_settings import PlaceSettings
from wrenchsight.analyses.output.axes import log_scale
from wrenchsight.analyses.output.figures import COLOUR, SERIES, new_figure
from wrenchsight.analyses.output.outputs import OutputFolder
from wrenchsight.analyses.output.result_folder import result_folder
from wrenchsight.diagrams.distances.coming_and_going import (
    distance_of_ends,
    sentence_of_ends,
    with_floor,
)
from wrenchsight.diagrams.distances.placement_cell import PlacementCell
from wrenchsight.diagrams.pages.cell_picture import cell_picture
from wrenchsight.diagrams.pages.path_page import PathMotion, write_path_page
from wrenchsight.models.arrays import Array
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig, live_prior
from wrenchsight.models.files.configuration import nearest
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.motion.branches import all_branches, is_closed_form
from wrenchsight.models.motion.path_postures import track_paths
from wrenchsight.models.motion.posture_measures import (
    ConditionNumber,
    ForceSd,
    PathMeasure,
    PostureMeasure,
)
from wrenchsight.models.placement.placement_descent import PlacementDescent
from wrenchsight.models.placement.placement_points import between_points
from wrenchsight.models.placement.placement_program import (
    SOLVERS,
    Placement,
    PlacementProgram,
    quaternion_from,
)
from wrenchsight.models.placement.placement_search import (
    FEASIBLE,
    PlacementSearch,
    SearchEffort,
    SearchResult,
)
from wrenchsight.models.placement.placement_task import (
    ClearanceConfig,
    PlacementTask,
    check_task,
    load_task,
)
from wrenchsight.models.rigid_body.ties import beyond_rounding, first_of_least
from wrenchsight.models.robot.robot import Robot

OBJECTIVES = ("jcn", "force-sd")
PLACE_SOLVERS = (*SOLVERS, "pso-ga")
_ROUNDING = 1e-9  # m and rad; constraints are kept to 1e-7
_HALF_TURN = 1e-9  # of a quaternion's w: a rotation by half a turn
_FREE_SEEDS = 3  # searches for a free placement that can also be come to and left
FINE = 10  # points between two of the path's, where it is looked at closely

EFFORT = SearchEffort()
EFFORT_QUICK = SearchEffort(num_samples=3000, num_starts=24, num_rounds=2, num_solves=3)
# Distances cost a hundred times what the measure does.
EFFORT_WITH_CLEARANCE = SearchEffort(num_starts=16, num_rounds=3, num_steps=25, num_solves=6)
# Without a closed form every pose is searched numerically, and so are longer vectors of postures.
EFFORT_NUMERIC = SearchEffort(
    num_samples=6000, num_poses=8, num_starts=24, num_rounds=1, num_kinds=4, num_turns=4
)


@dataclass(frozen=True)
class Profile:
    """A placed path, looked at closely.

    Attributes:
        placement: it, with its k + 1 points.
        fine: the same with FINE times as many points.
        jcn, measure: (k + 1,) condition number and the objective at the points.
        fine_jcn, fine_measure: at the points of `fine`.
        smallest_distance: m, of the clearance's pairs over `fine`; None without clearance.
    """

    placement: Placement
    fine: Placement
    jcn: Array
    measure: Array
    fine_jcn: Array
    fine_measure: Array
    smallest_distance: float | None = None

    def metrics(self, key: str) -> dict[str, Any]:
        """Means over the k + 1 points, largest values over the fine ones, and the placement."""
        w = min(1.0, abs(float(self.placement.quaternion[0])))
        theta = 2.0 * math.acos(w)
        axis = self.placement.quaternion[1:] * (1.0 if self.placement.quaternion[0] >= 0 else -1.0)
        if w < _HALF_TURN:  # both ways round are one rotation
            axis = axis * np.sign(axis[int(first_of_least(-np.abs(axis)))])
        length = float(np.linalg.norm(axis))
        metrics: dict[str, Any] = {
            "mean_jcn": float(np.mean(self.jcn)),
            "max_jcn": float(np.max(self.fine_jcn)),
            "mean_jcn_along_path": float(
                np.trapezoid(self.fine_jcn, np.linspace(0.0, 1.0, len(self.fine_jcn)))
            ),
            "direction": _digits(self.placement.n_W),
            "midpoint_m": _digits(self.placement.p_WM),
            "rotation": _digits(self.placement.R_WE),
            "angle_deg": float(_digits(math.degrees(theta))),
            "axis": _digits(axis / length if length > 1e-12 else np.array([0.0, 0.0, 1.0])),
            "midpoint_radius_m": float(np.hypot(*self.placement.p_WM[:2])),
            "joints_at_midpoint_rad": _digits(self.fine.q[len(self.fine.q) // 2]),
            "max_joint_step_rad": float(np.max(np.abs(np.diff(self.placement.q, axis=0)))),
        }
        if key != "jcn":
            metrics[f"mean_{key}"] = float(np.mean(self.measure))
            metrics[f"max_{key}"] = float(np.max(self.fine_measure))
        if self.smallest_distance is not None:
            metrics["smallest_distance_m"] = self.smallest_distance
        return metrics


@dataclass(frozen=True, eq=False)
class PlacementResult:
    """What `place` found.

    Attributes:
        initial: the task's guess on its branch; None without a guess that can be followed.
        best: the best placement.
        search: optima, starts and how the cost fell over time.
        seconds: of the search, without imports and compilation of kernels.
        largest_violation: of any constraint at the points, rad and m.
        notices: sentences for the user.
        free: the best placement whose arm hits nothing, where the task asks for no clearance and
            the best one overlaps itself; None elsewhere.
    """

    task: PlacementTask
    robot: Robot
    objective: str
    solver: str
    seed: int
    measure: PostureMeasure
    initial: Profile | None
    best: Profile
    search: SearchResult
    seconds: float
    largest_violation: float
    notices: tuple[str, ...] = field(default_factory=tuple)
    free: Profile | None = None

    def metrics(self) -> dict[str, Any]:
        """Nested figures and the search's counts; no times among them."""
        metrics = self.figures()
        counts = self.counts()
        for optimum, starts in zip(metrics["optima"], counts.pop("starts_of_optima"), strict=True):
            optimum["starts"] = starts
        return metrics | counts

    def counts(self) -> dict[str, Any]:
        """What the search has tried: counts that another machine's last bits may change."""
        return {
            "starts_of_optima": [optimum.starts for optimum in self.search.optima],
            "starts": self.search.num_starts,
            "starts_elsewhere": self.search.num_unassigned,
            "candidates": self.search.num_candidates,
            "candidates_reached": self.search.num_reached,
        }

    def figures(self) -> dict[str, Any]:
        """What was found, the same on every machine to the digits that anyone prints."""
        key = self.measure.key
        figures: dict[str, Any] = {
            "optimised": self.best.metrics(key),
            "optima": [{f"mean_{key}": optimum.cost} for optimum in self.search.optima],
            "largest_violation": beyond_rounding(self.largest_violation, _ROUNDING),
        }
        if self.initial is not None:
            figures["initial"] = self.initial.metrics(key)
        if self.free is not None:
            figures["free"] = self.free.metrics(key)
        return figures


def _digits(values: ArrayLike) -> Array:
    """Numbers to six decimals, and no zero with a sign: finer digits are the solver's alone."""
    return np.asarray(np.round(np.asarray(values, dtype=np.float64), 6) + 0.0)


def place(
    task: PlacementTask,
    source: Path | str,
    robot: Robot,
    *,
    objective: str = "jcn",
    solver: str = "snopt",
    seed: int = 0,
    model: IdentifiedModel | None = None,
    method: str = "bayesian",
    effort: SearchEffort | None = None,
    swarm: SwarmConfig | None = None,
    progress: Callable[[float, str], None] = lambda fraction, what: None,
) -> PlacementResult:
    """Places a path.

    Args:
        task: as read from `source`, which error messages name.
        objective: one of OBJECTIVES.
        solver: one of PLACE_SOLVERS.
        seed: of the random starts.
        model: of force-sd: whose residual covariance counts; None for the robot's nominal one.
        method: of force-sd: how wrenches are reconstructed.
        effort: how hard to search; None for what suits task and arm.
        swarm: of pso-ga.

    Raises:
        InputError: no placement can be followed, or none keeps all constraints.
    """
    _check_choice("--objective", objective, OBJECTIVES)
    _check_choice("--solver", solver, PLACE_SOLVERS)
    check_task(task, source, robot)
    notices = []
    measure, said = _measure(robot, objective, model, method)
    notices += said
    cell = None
    if task.clearance is not None:
        cell = PlacementCell(robot, task.clearance)
        notices += cell.notices
    if not is_closed_form(robot):
        notices.append(
            f"{robot.name} has no known analytic inverse kinematics: branches are searched "
            "numerically, and some may be missed"
        )
    bounds = task.bounds(robot)
    program = PlacementProgram(
        robot.chain, PathMeasure(measure), bounds, task.path_length, task.num_segments, cell
    )
    began = time.perf_counter()
    if solver == "pso-ga":
        result = place_by_swarm(robot, program, cell, seed, swarm, progress)
    else:
        descent = PlacementDescent(
            robot.chain,
            measure,
            bounds,
            task.path_length,
            None if cell is None else cell.penalties,
        )
        guess = task.initial_path()
        initial = None if guess is None else (guess.n_W, guess.p_WM, guess.R_WE)
        search = PlacementSearch(robot, program, descent, initial)
        result = search.run(seed, solver, effort or _effort(robot, cell), progress)
    seconds = time.perf_counter() - began
    if result.best is None:
        _explain_nothing(task, source, robot, result)
    assert result.best is not None
    best = result.best.placement
    profile = _profile(task, robot, measure, cell, best)
    if profile is None:
        problem = "the best path found changes its branch between two points"
        raise InputError(source, "", problem, "choose another --seed or --solver")
    entry = _initial_profile(task, robot, measure, cell)
    if task.initial is not None and entry is None:
        notices.append("the task's guess cannot be followed within the joint limits on any branch")
    if result.interrupted:
        notices.append("interrupted: the best found so far")
    return PlacementResult(
        task=task,
        robot=robot,
        objective=objective,
        solver=solver,
        seed=seed,
        measure=measure,
        initial=entry,
        best=profile,
        search=result,
        seconds=seconds,
        largest_violation=program.violation(best),
        notices=tuple(notices),
    )


def place_task(
    task_name: str | Path,
    out: Path,
    robot_name: str | Path = "sts_sre4_600",
    *,
    objective: str = "jcn",
    solver: str = "snopt",
    seed: int = 0,
    model_path: Path | None = None,
    method: str = "bayesian",
    quick: bool = False,
    content: PlacementTask | None = None,
    progress: Callable[[float, str], None] = lambda fraction, what: None,
) -> PlacementResult:
    """The command `place`: reads the task, places its path and writes the results.

    Args:
        content: used instead of the content of the task that `task_name` names.

    Raises:
        InputError: as `place` and `result_folder`; the task, the robot or the model cannot be
            read.
    """
    with result_folder(out, "place") as folder:
        task, source = load_task(task_name) if content is None else (content, Path(task_name))
        robot = Robot.load(robot_name)
        model = None if model_path is None else IdentifiedModel.load(model_path, robot)
        result = place(
            task,
            source,
            robot,
            objective=objective,
            solver=solver,
            seed=seed,
            model=model,
            method=method,
            effort=EFFORT_QUICK if quick and task.clearance is None else None,
            progress=progress,
        )
        if task.clearance is None and not quick:
            result = _with_free(result, source, model, method, progress)
        settings = PlaceSettings(
            task=str(task_name),
            robot=str(robot_name),
            objective=objective,
            solver=solver,
            model=None if model_path is None else str(model_path),
            method=method,
            seed=seed,
            quick=quick,
            task_content=task,
        )
        write_placement(folder, result, settings)
    return result


def _with_free(
    result: PlacementResult,
    source: Path | str,
    model: IdentifiedModel | None = None,
    method: str = "bayesian",
    progress: Callable[[float, str], None] = lambda fraction, what: None,
) -> PlacementResult:
    """The result with its smallest distance; where its arm overlaps, the best free placement."""
    robot = result.robot
    config = with_floor(robot, ClearanceConfig())
    cell = PlacementCell(robot, config)
    best = _profile(result.task, robot, result.measure, cell, result.best.placement)
    if best is None or best.smallest_distance is None:
        return result
    result = replace(result, best=best)
    comes = distance_of_ends(robot, cell, best.fine)
    if min(best.smallest_distance, comes) >= 0.0:
        return result
    notices = [f"coming or going {sentence_of_ends(comes)}: the task asks for no clearance"]
    if best.smallest_distance < 0.0:
        overlap = -1e3 * best.smallest_distance
        hit = f"the arm overlaps itself or the floor by {overlap:.0f} mm"
        notices = [f"{hit}: the task asks for no clearance"]
    task = replace(result.task, clearance=config)
    free: Profile | None = None
    for seed in range(result.seed, result.seed + _FREE_SEEDS):
        try:
            outcome = place(
                task,
                source,
                robot,
                objective=result.objective,
                solver=result.solver,
                seed=seed,
                model=model,
                method=method,
                progress=lambda fraction, what: progress(fraction, f"free of collision: {what}"),
            ).best
        except InputError as error:
            notices.append(f"no placement is free: {error}")
            break
        comes = distance_of_ends(robot, cell, outcome.fine)
        free = outcome if free is None or comes >= 0.0 else free
        if comes >= 0.0:
            break
    else:
        notices.append(
            f"the free placement is free along its path; coming or going {sentence_of_ends(comes)}"
        )
    return replace(result, free=free, notices=(*result.notices, *notices))


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
    axes[0, 0].set_ylabel(f"best {result.measure.label}, mean over the path")
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
    """Draws the condition number (and the objective) and the joints along both paths (Fig. 8)."""
    rows = 2 if measure.key == "jcn" else 3
    figure, axes = new_figure(rows, 1, height=2.5 * rows, share_x=True)
    cases = [("initial", initial, COLOUR["before"])] if initial is not None else []
    cases.append(("optimised", best, COLOUR["after"]))
    fine = np.linspace(0.0, 1.0, len(best.fine.q))
    for label, profile, colour in cases:
        if profile is None:
            continue
        mean, largest = np.mean(profile.jcn), np.max(profile.fine_jcn)
        axes[0, 0].plot(
            fine,
            profile.fine_jcn,
            color=colour,
            label=f"{label} (mean {mean:.2f}, largest {largest:.2f})",
        )
        if rows == 3:
            axes[1, 0].plot(fine, profile.fine_measure, color=colour)
    log_scale(axes[0, 0], "y")
    axes[0, 0].set_ylabel("condition number of J")
    if rows == 3:
        axes[1, 0].set_ylabel(measure.label)
    ax = axes[rows - 1, 0]
    for joint in range(best.fine.q.shape[1]):
        colour = SERIES[joint % len(SERIES)]
        ax.plot(fine, best.fine.q[:, joint], color=colour, label=f"$q_{{{joint + 1}}}$")
    ax.set_ylabel("optimised joints [rad]")
    ax.set_xlabel("part of the path")
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    figure.legend(
        *axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=len(cases)
    )
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


def _check_choice(option: str, value: str, known: tuple[str, ...]) -> None:
    if value not in known:
        remedy = nearest(value, known) or f"choose one of {', '.join(known)}"
        raise InputError(option, "", f'"{value}" is not known', remedy)


def _measure(
    robot: Robot, objective: str, model: IdentifiedModel | None, method: str
) -> tuple[PostureMeasure, list[str]]:
    if objective == "jcn":
        return ConditionNumber(robot.chain), []
    notices = []
    if model is None:
        model = IdentifiedModel.nominal(robot)
        notices.append(
            "no model given: the torque's covariance is the nominal one, 2 % of each effort limit"
        )
    config = WrenchReconstructionConfig(method=method).with_prior(*live_prior(robot.payload))
    return ForceSd(robot.chain, model.residual_covariance, config), notices


def _effort(robot: Robot, cell: PlacementCell | None) -> SearchEffort:
    if not is_closed_form(robot):
        return EFFORT_NUMERIC
    return EFFORT if cell is None else EFFORT_WITH_CLEARANCE


def _profile(
    task: PlacementTask,
    robot: Robot,
    measure: PostureMeasure,
    cell: PlacementCell | None,
    placement: Placement,
) -> Profile | None:
    fine = between_points(robot, placement, task.path_length, FINE)
    if fine is None:
        return None
    jcn = ConditionNumber(robot.chain)
    distance = None
    if cell is not None and not robot.unusable_collisions:
        distances = cell.distances(fine.q, fine.n_W, fine.p_WM, fine.quaternion)
        distance = float(np.min(distances))
    return Profile(
        placement,
        fine,
        jcn.values(placement.q),
        measure.values(placement.q),
        jcn.values(fine.q),
        measure.values(fine.q),
        distance,
    )


def _initial_profile(
    task: PlacementTask, robot: Robot, measure: PostureMeasure, cell: PlacementCell | None
) -> Profile | None:
    """The guess on the branch that it names, or on its best one."""
    path = task.initial_path()
    if path is None or task.initial is None:
        return None
    branches = all_branches(robot, path.R_WE[np.newaxis], path.p_WM[np.newaxis])[0]
    if len(branches) == 0:
        return None
    q, reached = track_paths(
        robot.chain,
        branches,
        np.tile(path.n_W, (len(branches), 1)),
        path.path_length,
        path.num_segments,
        math.pi / 2,
    )
    bounds = task.bounds(robot)
    within = np.all(
        (q >= bounds.q_lower - FEASIBLE) & (q <= bounds.q_upper + FEASIBLE), axis=(1, 2)
    )
    good = np.flatnonzero(reached & within)
    if len(good) == 0:
        return None
    if task.initial.posture is not None:
        off = np.max(np.abs(branches[good] - np.array(task.initial.posture)), axis=1)
        chosen = good[int(first_of_least(off))]
    else:
        chosen = good[int(first_of_least(np.mean(measure.values(q[good]), axis=1)))]
    placement = Placement(q[chosen], path.n_W, path.p_WM, quaternion_from(path.R_WE))
    return _profile(task, robot, measure, cell, placement)


def _explain_nothing(
    task: PlacementTask, source: Path | str, robot: Robot, result: SearchResult
) -> None:
    if result.interrupted:
        raise KeyboardInterrupt
    if result.num_reached == 0:
        raise InputError(
            source,
            "path_length, midpoint_lower, midpoint_upper",
            f"{robot.name} can follow a straight path of {task.path_length:g} m in this box in "
            f"none of {result.num_candidates} random postures",
            "shorten the path or widen the box",
        )
    raise InputError(
        source,
        "",
        f"{result.num_reached} placements can be followed, and none found keeps all of joint "
        "limits, angle range, steps and clearance",
        "loosen one of them",
    )


def _postures_csv(result: PlacementResult) -> str:
    fine, jcn = result.best.fine, result.best.fine_jcn
    names = [f"{name}_rad" for name in result.robot.joint_names]
    lines = [",".join(["s", "x_m", "y_m", "z_m", *names, "jcn"])]
    _, p = result.robot.chain.pose(fine.q)
    for i, row in enumerate(fine.q):
        numbers = [i / (len(fine.q) - 1), *p[i], *row, jcn[i]]
        lines.append(",".join(repr(float(number)) for number in numbers))
    return "\n".join(lines) + "\n"
