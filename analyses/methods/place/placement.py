"""Placement of a straight path, and the arm's postures along it (sections 3.2 and 4.3).

Command `place --task T.yaml`. The result is a path in its place, the tool's rotation, and postures
on one branch along it. Beside it stand the local optima of the search and the result of the task's
initial guess.
"""

import math
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from wrenchsight.analyses.methods.place.infeasibility import infeasible
from wrenchsight.analyses.methods.place.particle_swarm import SwarmConfig, place_by_swarm
from wrenchsight.analyses.methods.place.place_settings import PlaceSettings
from wrenchsight.analyses.methods.place.placement_files import write_placement
from wrenchsight.analyses.methods.place.placement_refinement import CONSTRAINT_TOLERANCE
from wrenchsight.analyses.methods.place.placement_result import PlacementResult, Profile
from wrenchsight.analyses.methods.place.placement_search import (
    PlacementSearch,
    SearchEffort,
    SearchResult,
)
from wrenchsight.analyses.output.progress import ProgressCallback
from wrenchsight.analyses.output.result_folder import result_folder
from wrenchsight.diagrams.placement.coming_and_going import distance_of_ends, sentence_of_ends
from wrenchsight.diagrams.placement.placement_cell import PlacementCell
from wrenchsight.diagrams.placement.placement_program import SOLVERS, PlacementProgram
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.estimation.wrench_methods import METHODS
from wrenchsight.models.estimation.wrench_prior import live_prior
from wrenchsight.models.files.configuration import nearest
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.ties import first_of_least
from wrenchsight.models.planning.motion.branches import is_closed_form
from wrenchsight.models.planning.motion.posture_cost import (
    ConditionNumber,
    ForceSd,
    PostureMeasure,
)
from wrenchsight.models.planning.placement.placement_task import (
    ClearanceConfig,
    PlacementTask,
    check_task,
    load_task,
)
from wrenchsight.models.planning.placement.placements import (
    Placement,
    between_points,
    on_all_branches,
)
from wrenchsight.models.robot.robot import Robot

OBJECTIVES = ("jcn", "force-sd")
PLACE_SOLVERS = (*SOLVERS, "pso-ga")
FINE_POINTS = 10  # parts of each segment of the path, for distances and largest values
# rad or m between two points of the task's guess: a branch is followed however it turns, since a
# guess need not keep the task's own limit
_MAX_GUESS_STEP = math.pi / 2

DEFAULT_EFFORT = SearchEffort()
EFFORT_QUICK = SearchEffort(num_samples=3000, num_starts=24, num_rounds=1, num_solves=2)
# Distances cost ten times what all else does.
EFFORT_WITH_CLEARANCE = SearchEffort(num_starts=32, num_rounds=2, num_solves=3, num_feasibility=16)
EFFORT_QUICK_WITH_CLEARANCE = SearchEffort(
    num_samples=3000, num_starts=8, num_rounds=0, num_solves=2, num_feasibility=16
)
# Without a closed form every pose is searched numerically, and so are longer vectors of postures.
EFFORT_NUMERIC = SearchEffort(
    num_samples=6000, num_poses=8, num_starts=16, num_rounds=1, num_kinds=4, num_turns=4
)
EFFORT_QUICK_NUMERIC = SearchEffort(
    num_samples=2000, num_poses=4, num_starts=8, num_rounds=0, num_solves=1, num_feasibility=16
)
EFFORT_NUMERIC_WITH_CLEARANCE = replace(
    EFFORT_NUMERIC, num_starts=16, num_rounds=0, num_solves=2, num_feasibility=16
)
QUICK_SWARM = SwarmConfig(num_particles=30, num_iterations=40)


@dataclass(frozen=True)
class PlacementRequest:
    """What makes a placement good, and how it is searched for.

    Attributes:
        objective: one of OBJECTIVES.
        solver: one of PLACE_SOLVERS.
        seed: seed of the random starts.
        model: model whose residual covariance counts for force-sd; None for the robot's nominal
            one.
        method: how wrenches are reconstructed, for force-sd.
        effort: size of the search; None for what suits task and arm.
        quick: a smaller search, where no effort or swarm is stated.
        may_overlap: whether the arm may overlap itself and the floor where the task asks for no
            clearance: kinematics alone, as in the article.
        swarm: settings of pso-ga; None for the article's.
    """

    objective: str = "jcn"
    solver: str = "snopt"
    seed: int = 0
    model: IdentifiedModel | None = None
    method: str = "bayesian"
    effort: SearchEffort | None = None
    swarm: SwarmConfig | None = None
    quick: bool = False
    may_overlap: bool = False


def place(
    task: PlacementTask,
    source: Path | str,
    robot: Robot,
    request: PlacementRequest = PlacementRequest(),
    progress: ProgressCallback = lambda fraction, message: None,
) -> PlacementResult:
    """Places a path where the arm can follow it.

    Without a clearance in the task the arm may come as near to itself and to the floor as it likes,
    and may not overlap them, unless the request lets it. Where the best placement does, another one
    is searched that does not, and the best one is only there to compare with. An interrupted search
    gives what it has found, overlap or not, and no second one begins.

    Args:
        task: as read from `source`, which error messages name.
        request: objective and search.

    Raises:
        InputError: no placement can be followed, or none keeps all constraints.
    """
    _check_choice("--objective", request.objective, OBJECTIVES)
    _check_choice("--solver", request.solver, PLACE_SOLVERS)
    _check_choice("--method", request.method, METHODS)
    check_task(task, source, robot)
    measure, notices = measure_of(robot, request.objective, request.model, request.method)
    cell = PlacementCell(robot, task.clearance or ClearanceConfig(distance=0.0))
    notices += _arm_notices(robot, cell)

    def program_with(cell: PlacementCell | None) -> PlacementProgram:
        bounds, length = task.bounds(robot), task.path_length
        return PlacementProgram(robot, measure, bounds, length, task.num_segments, cell)

    began = time.perf_counter()
    program = program_with(None if task.clearance is None else cell)
    search = _search(task, program, request, progress)
    best = _best_profile(task, source, program, cell, search)
    unconstrained: Profile | None = None
    # With a clearance in the task, the first search has kept it already.
    may_overlap = request.may_overlap or task.clearance is not None
    if best.is_overlapping and not may_overlap and not search.interrupted:
        unconstrained = best
        first_optima = tuple(optimum.placement for optimum in search.optima)
        program = program_with(cell)
        search = _search(
            task,
            program,
            request,
            lambda fraction, message: progress(fraction, f"without overlap: {message}"),
            others=first_optima,
        )
        best = _best_profile(task, source, program, cell, search)
        notices.append(
            "unconstrained, the arm would overlap: "
            f"{unconstrained.overlap}; that placement is only there to compare with"
        )
    seconds = time.perf_counter() - began
    end_distance = distance_of_ends(robot, cell, best.fine)
    if end_distance < 0.0:
        notices.append(
            "the placement is free of overlap along its path only: on approach or retreat "
            f"{sentence_of_ends(end_distance)}"
        )
    initial = _initial_profile(task, robot, measure, cell)
    if task.initial is not None and initial is None:
        notices.append("no branch follows the task's guess within the joint limits")
    if search.interrupted:
        notices.append("interrupted: this is the best placement so far")
    return PlacementResult(
        task=task,
        robot=robot,
        objective=request.objective,
        solver=request.solver,
        seed=request.seed,
        measure=measure,
        initial=initial,
        best=best,
        search=search,
        seconds=seconds,
        largest_violation=program.violation(best.placement),
        notices=tuple(notices),
        unconstrained=unconstrained,
    )


def _best_profile(
    task: PlacementTask,
    source: Path | str,
    program: PlacementProgram,
    cell: PlacementCell,
    search: SearchResult,
) -> Profile:
    """The best optimum of a search.

    Raises:
        InputError: the search found none, or one that no branch follows from end to end.
        KeyboardInterrupt: it was interrupted before it found any.
    """
    if search.best is None:
        if search.interrupted:
            raise KeyboardInterrupt
        raise infeasible(task, source, program, search)
    best = _profile(task, program.robot, program.measure, cell, search.best.placement)
    if best is None:
        problem = "the best path changes its branch between two points"
        raise InputError(source, "", problem, "choose another --seed or --solver")
    return best


def _arm_notices(robot: Robot, cell: PlacementCell) -> list[str]:
    """Sentences on shapes that are missing and branches that may be."""
    notices = list(cell.notices)
    if not is_closed_form(robot):
        notices.append(
            f"{robot.name} has no known analytic inverse kinematics: branches are searched "
            "numerically, and some may be missed"
        )
    return notices


def _search(
    task: PlacementTask,
    program: PlacementProgram,
    request: PlacementRequest,
    progress: ProgressCallback,
    others: tuple[Placement, ...] = (),
) -> SearchResult:
    """Searches with the solver that is requested; all but pso-ga also start from a guess.

    Args:
        others: placements to start from, before any other; pso-ga takes none.
    """
    if request.solver == "pso-ga":
        swarm = request.swarm or (QUICK_SWARM if request.quick else SwarmConfig())
        return place_by_swarm(program, request.seed, swarm, progress)
    effort = request.effort or _effort(program.robot, program.cell is not None, request.quick)
    return PlacementSearch(program, task.initial_path(), others).run(
        request.seed, request.solver, effort, progress
    )


def place_task(
    settings: PlaceSettings,
    out: Path,
    progress: ProgressCallback = lambda fraction, message: None,
) -> PlacementResult:
    """The command `place`: reads the task, places its path and writes the results.

    Raises:
        InputError: as `place` and `result_folder`; the task, the robot or the model cannot be
            read.
    """
    with result_folder(out, "place") as folder:
        task, source = settings.task_content, Path(settings.task)
        if task is None:
            task, source = load_task(settings.task)
        robot = Robot.load(settings.robot)
        request = PlacementRequest(
            objective=settings.objective,
            solver=settings.solver,
            seed=settings.seed,
            model=None
            if settings.model is None
            else IdentifiedModel.load(Path(settings.model), robot),
            method=settings.method,
            quick=settings.quick,
        )
        result = place(task, source, robot, request, progress)
        write_placement(folder, result, replace(settings, task_content=task))
    return result


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


def _effort(robot: Robot, has_clearance: bool, quick: bool) -> SearchEffort:
    if not is_closed_form(robot) and quick:
        return EFFORT_QUICK_NUMERIC
    if not is_closed_form(robot):
        return EFFORT_NUMERIC_WITH_CLEARANCE if has_clearance else EFFORT_NUMERIC
    if has_clearance:
        return EFFORT_QUICK_WITH_CLEARANCE if quick else EFFORT_WITH_CLEARANCE
    return EFFORT_QUICK if quick else DEFAULT_EFFORT


def _profile(
    task: PlacementTask,
    robot: Robot,
    measure: PostureMeasure,
    cell: PlacementCell,
    placement: Placement,
) -> Profile | None:
    """A placement with its measures; None where its branch ends between two points."""
    fine = between_points(robot, placement, task.path_length, FINE_POINTS)
    if fine is None:
        return None
    jcn = ConditionNumber(robot.chain)
    distance, worst = None, None
    if cell.clearance.has_shapes:
        distance, worst = cell.smallest_distance(fine.q, fine), cell.worst(fine.q, fine)
    return Profile(
        placement=placement,
        fine=fine,
        jcn=jcn.values(placement.q),
        measure=measure.values(placement.q),
        fine_jcn=jcn.values(fine.q),
        fine_measure=measure.values(fine.q),
        smallest_distance=distance,
        worst=worst,
    )


def _initial_profile(
    task: PlacementTask, robot: Robot, measure: PostureMeasure, cell: PlacementCell
) -> Profile | None:
    """The task's guess on the branch that it names, or on its best one.

    None without a guess, or where no branch follows it within the joint limits. A posture in the
    task, (n,) at the middle of the path, names the branch that is nearest to it there.
    """
    path = task.initial_path()
    if path is None or task.initial is None:
        return None
    # q (B, k + 1, n): one path, on each of B branches.
    paths = on_all_branches(
        robot,
        path.n_W[np.newaxis],
        path.p_WM[np.newaxis],
        path.R_WE[np.newaxis],
        path.path_length,
        path.num_segments,
        _MAX_GUESS_STEP,
    )
    q = paths.placements.q
    bounds = task.bounds(robot)
    within = np.all(
        (q >= bounds.q_lower - CONSTRAINT_TOLERANCE) & (q <= bounds.q_upper + CONSTRAINT_TOLERANCE),
        axis=(1, 2),
    )
    followed = np.flatnonzero(paths.is_reached & within)  # indices of branches
    if len(followed) == 0:
        return None
    if task.initial.posture is not None:
        k = path.num_segments
        middle = 0.5 * (q[:, k // 2] + q[:, (k + 1) // 2])  # (B, n): k may be odd
        distance = np.max(np.abs(middle[followed] - task.initial.posture), axis=1)
        chosen = followed[int(first_of_least(distance))]
    else:
        mean = np.mean(measure.values(q[followed]), axis=1)
        chosen = followed[int(first_of_least(mean))]
    return _profile(task, robot, measure, cell, paths.placements.one(chosen))
