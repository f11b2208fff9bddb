"""Placement of a straight path, and the arm's postures along it (sections 3.2 and 4.3).

Command `place --task T.yaml`. The result is a path in its place, the tool's rotation, and postures
on one branch along it. Beside it stand the local optima of the search and the result of the task's
initial guess.
"""

import math
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from wrenchsight.analyses.methods.place.particle_swarm import SwarmConfig, place_by_swarm
from wrenchsight.analyses.methods.place.place_settings import PlaceSettings
from wrenchsight.analyses.methods.place.placement_files import write_placement
from wrenchsight.analyses.methods.place.placement_result import PlacementResult, Profile
from wrenchsight.analyses.output.result_folder import result_folder
from wrenchsight.diagrams.distances.coming_and_going import (
    distance_of_ends,
    sentence_of_ends,
    with_floor,
)
from wrenchsight.diagrams.distances.placement_cell import PlacementCell
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig, live_prior
from wrenchsight.models.files.configuration import nearest
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.ties import first_of_least
from wrenchsight.models.planning.motion.branches import is_closed_form
from wrenchsight.models.planning.motion.posture_measures import (
    ConditionNumber,
    ForceSd,
    PostureMeasure,
)
from wrenchsight.models.planning.placement.placement_program import (
    SOLVERS,
    Placement,
    PlacementProgram,
    between_points,
    on_all_branches,
)
from wrenchsight.models.planning.placement.placement_search import (
    FEASIBLE,
    PlacementSearch,
    SearchEffort,
    SearchResult,
)
from wrenchsight.models.planning.placement.placement_task import (
    ClearanceConfig,
    PlacementTask,
    check_task,
    load_task,
)
from wrenchsight.models.robot.robot import Robot

OBJECTIVES = ("jcn", "force-sd")
PLACE_SOLVERS = (*SOLVERS, "pso-ga")
_FREE_SEEDS = 3  # searches for a placement with a free path, approach and retreat
FINE = 10  # points between two of the path's, for distances and largest values

EFFORT = SearchEffort()
EFFORT_QUICK = SearchEffort(num_samples=3000, num_starts=24, num_rounds=2, num_solves=3)
# Distances cost a hundred times what the measure does.
EFFORT_WITH_CLEARANCE = SearchEffort(num_starts=16, num_rounds=3, num_steps=25, num_solves=6)
# Without a closed form every pose is searched numerically, and so are longer vectors of postures.
EFFORT_NUMERIC = SearchEffort(
    num_samples=6000, num_poses=8, num_starts=24, num_rounds=1, num_kinds=4, num_turns=4
)


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
    progress: Callable[[float, str], None] = lambda fraction, message: None,
) -> PlacementResult:
    """Places a path.

    Args:
        task: as read from `source`, which error messages name.
        objective: one of OBJECTIVES.
        solver: one of PLACE_SOLVERS.
        seed: of the random starts.
        model: of force-sd: whose residual covariance counts; None for the robot's nominal one.
        method: of force-sd: how wrenches are reconstructed.
        effort: size of the search; None for what suits task and arm.
        swarm: of pso-ga.

    Raises:
        InputError: no placement can be followed, or none keeps all constraints.
    """
    _check_choice("--objective", objective, OBJECTIVES)
    _check_choice("--solver", solver, PLACE_SOLVERS)
    check_task(task, source, robot)
    measure, notices = measure_of(robot, objective, model, method)
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
        robot.chain, measure, bounds, task.path_length, task.num_segments, cell
    )
    began = time.perf_counter()
    if solver == "pso-ga":
        result = place_by_swarm(robot, program, seed, swarm, progress)
    else:
        guess = task.initial_path()
        start = None if guess is None else (guess.n_W, guess.p_WM, guess.R_WE)
        search = PlacementSearch(robot, program, start)
        result = search.run(seed, solver, effort or _effort(robot, cell), progress)
    seconds = time.perf_counter() - began
    if result.best is None:
        _explain_nothing(task, source, robot, result)
    assert result.best is not None
    best = result.best.placement
    profile = _profile(task, robot, measure, cell, best)
    if profile is None:
        problem = "the best path changes its branch between two points"
        raise InputError(source, "", problem, "choose another --seed or --solver")
    initial = _initial_profile(task, robot, measure, cell)
    if task.initial is not None and initial is None:
        notices.append("no branch follows the task's guess within the joint limits")
    if result.interrupted:
        notices.append("interrupted: this is the best placement so far")
    return PlacementResult(
        task=task,
        robot=robot,
        objective=objective,
        solver=solver,
        seed=seed,
        measure=measure,
        initial=initial,
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
    progress: Callable[[float, str], None] = lambda fraction, message: None,
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
    progress: Callable[[float, str], None] = lambda fraction, message: None,
) -> PlacementResult:
    """The result with its smallest distance; where its arm overlaps, the best free placement."""
    robot = result.robot
    config = with_floor(robot, ClearanceConfig())
    cell = PlacementCell(robot, config)
    best = _profile(result.task, robot, result.measure, cell, result.best.placement)
    if best is None or best.smallest_distance is None:
        return result
    result = replace(result, best=best)
    end_distance = distance_of_ends(robot, cell, best.fine)
    if min(best.smallest_distance, end_distance) >= 0.0:
        return result
    collision = f"on approach or retreat {sentence_of_ends(end_distance)}"
    if best.smallest_distance < 0.0:
        overlap = -1e3 * best.smallest_distance
        collision = f"the arm overlaps itself or the floor by {overlap:.0f} mm"
    notices = [f"{collision}: the task asks for no clearance; state one in the task's file"]
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
                progress=lambda fraction, message: progress(
                    fraction, f"free of collision: {message}"
                ),
            ).best
        except InputError as error:
            notices.append(f"no collision-free placement: {error}")
            break
        end_distance = distance_of_ends(robot, cell, outcome.fine)
        if free is None or end_distance >= 0.0:
            free = outcome
        if end_distance >= 0.0:
            break
    else:
        notices.append(
            "the collision-free placement is so along its path only: on approach or retreat "
            f"{sentence_of_ends(end_distance)}"
        )
    return replace(result, free=free, notices=(*result.notices, *notices))


def _check_choice(option: str, value: str, choices: tuple[str, ...]) -> None:
    if value not in choices:
        remedy = nearest(value, choices) or f"choose one of {', '.join(choices)}"
        raise InputError(option, "", f'"{value}" is not known', remedy)


def measure_of(
    robot: Robot, objective: str, model: IdentifiedModel | None, method: str = "bayesian"
) -> tuple[PostureMeasure, list[str]]:
    """The measure of an objective, with notices on it; see `place`."""
    if objective == "jcn":
        return ConditionNumber(robot.chain), []
    notices = []
    if model is None:
        model = IdentifiedModel.nominal(robot)
        notices.append(
            "no model given: the torque's covariance is the nominal one, 2 % of each effort limit; "
            "for the arm's own, pass --model"
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
    branches, reached, _ = on_all_branches(
        robot,
        path.n_W[np.newaxis],
        path.p_WM[np.newaxis],
        path.R_WE[np.newaxis],
        path.path_length,
        path.num_segments,
        math.pi / 2,
    )
    q = branches.q
    bounds = task.bounds(robot)
    within = np.all(
        (q >= bounds.q_lower - FEASIBLE) & (q <= bounds.q_upper + FEASIBLE), axis=(1, 2)
    )
    good = np.flatnonzero(reached & within)
    if len(good) == 0:
        return None
    if task.initial.posture is not None:
        k = path.num_segments
        middle = 0.5 * (q[:, k // 2] + q[:, (k + 1) // 2])
        off = np.max(np.abs(middle[good] - task.initial.posture), axis=1)
        chosen = good[int(first_of_least(off))]
    else:
        chosen = good[int(first_of_least(np.mean(measure.values(q[good]), axis=1)))]
    return _profile(task, robot, measure, cell, branches.one(chosen))


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
        f"{result.num_reached} placements can be followed, and none of them keeps all of joint "
        "limits, angle range, steps and clearance",
        "loosen one of them",
    )
