"""Why a task has no placement: what the best that was reached lacks, and what is in the way.

The ends of the search's first stage break as little of the constraints as the solver could bring
about. The best of them says which constraints do not hold, and by how much. Then each of the task's
own constraints is taken away alone, and the program is solved again from the best ends: those
without which all others can be kept are the ones to loosen.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from wrenchsight.analyses.methods.place.placement_search import SearchResult, coarse_stride
from wrenchsight.diagrams.placement.placement_program import PlacementProgram, PlacementSolution
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.planning.placement.placement_task import PlacementTask
from wrenchsight.models.planning.placement.placements import PlacementBounds, pose_errors

_CONSTRAINT_TOLERANCE = 1e-4  # m and rad, of a constraint at the end of a solve
_TRIED_ENDS = 2  # of the search, from which the program without a constraint is solved
_WIDE_STEP = math.pi / 3.0  # rad, the task's default
_MAX_NAMED_CONSTRAINTS = 3  # constraints in the sentence
_SOLVER_OPTIONS = {
    "Major feasibility tolerance": 1e-6,
    "Major iterations limit": 60,
    "Iterations limit": 3000,
}


def infeasible(
    task: PlacementTask, source: Path | str, program: PlacementProgram, search: SearchResult
) -> InputError:
    """The error line of a task for which a search found nothing.

    Args:
        task: as read from `source`.
        program: with all constraints.
        search: its `nearest` are ends of the program, the best first.
    """
    name = program.robot.name
    if not search.nearest:  # of a swarm, which knows of no program
        return InputError(
            source,
            "path_length, midpoint_lower, midpoint_upper",
            f"no particle of the swarm found a path that {name} can follow within all limits",
            "try --solver snopt, which says what is in the way",
        )
    best = search.nearest[0]
    shortfalls = _shortfalls(program, best)
    if not shortfalls:
        return InputError(
            source,
            "path_length",
            f"{name} keeps all constraints at {len(best.placement.q)} points of the path and not "
            "between them: its best branches end, or leave the joint limits, on the way",
            "shorten the path, raise num_segments, or choose another --seed",
        )
    loosened = [key for key, other in _without(task, program) if _is_kept(other, search)]
    if loosened:
        remedy = f"all else can be kept {' or '.join(map(_taken_away, loosened))}: loosen that"
    else:
        remedy = "no constraint is to blame alone: shorten the path, or loosen several"
    return InputError(
        source,
        loosened[0] if loosened else "path_length",
        f"{name} has no placement that keeps all constraints (searched from {search.num_starts} "
        "starts); the best that was reached misses "
        f"{'; '.join(shortfalls[:_MAX_NAMED_CONSTRAINTS])} "
        f"(not kept: {', '.join(best.infeasible_names[:_MAX_NAMED_CONSTRAINTS])})",
        remedy,
    )


def _taken_away(key: str) -> str:
    return "with half the path_length" if key == "path_length" else f"without {key}"


def _shortfalls(program: PlacementProgram, end: PlacementSolution) -> list[str]:
    """What an end lacks of each constraint, the largest first."""
    placement = end.placement
    errors = np.abs(pose_errors(program.robot.chain, placement, program.path_length))
    k = len(errors) - 1
    found: list[tuple[float, str]] = []
    turn, offset = np.linalg.norm(errors[:, :3], axis=1), np.linalg.norm(errors[:, 3:], axis=1)
    if offset.max() > _CONSTRAINT_TOLERANCE:
        share = 100.0 * float(np.argmax(offset)) / k
        found.append(
            (float(offset.max()),
             f"the path (position of E) by {1e3 * offset.max():.0f} mm at {share:.0f} % of it")
        )  # fmt: skip
    if turn.max() > _CONSTRAINT_TOLERANCE:
        share = 100.0 * float(np.argmax(turn)) / k
        found.append(
            (float(turn.max()),
             f"the tool's rotation by {math.degrees(turn.max()):.1f} degrees at {share:.0f} % "
             "of the path")
        )  # fmt: skip
    bounds = _coarse_bounds(program, program.bounds)
    for key, value in bounds.violations(placement).items():
        if value > _CONSTRAINT_TOLERANCE:
            amount = f"{math.degrees(value):.1f} degrees"
            if key.startswith("midpoint"):
                amount = f"{1e3 * value:.0f} mm"
            found.append((value, f"{key} by {amount}"))
    if program.cell is not None:
        pair = program.cell.closest(placement)
        if pair is not None and pair.slack < -_CONSTRAINT_TOLERANCE:
            found.append(
                (-pair.slack,
                 f"clearance by {-1e3 * pair.slack:.0f} mm ({pair.first} and {pair.second})")
            )  # fmt: skip
    return [text for _, text in sorted(found, reverse=True)]


def _without(
    task: PlacementTask, program: PlacementProgram
) -> Iterator[tuple[str, PlacementProgram]]:
    """Coarse programs that each lack one of the task's constraints, with the keys of that one."""
    bounds = program.bounds
    changes: list[tuple[str, PlacementBounds]] = []
    if task.limit_margin_deg > 0.0:
        lower, upper = program.robot.position_lower, program.robot.position_upper
        changes.append(("limit_margin_deg", replace(bounds, q_lower=lower, q_upper=upper)))
    if bounds.tool_direction is not None:
        changes.append(("tool_direction, tool_tilt_deg", replace(bounds, tool_direction=None)))
    if bounds.angle_upper < math.pi:
        changes.append(("angle_upper_deg", replace(bounds, angle_upper=math.pi)))
    if bounds.angle_lower > 0.0:
        changes.append(("angle_lower_deg", replace(bounds, angle_lower=0.0)))
    if bounds.path_direction is not None:
        keys = "path_direction, path_angle_lower_deg, path_angle_upper_deg"
        changes.append((keys, replace(bounds, path_direction=None)))
    if bounds.in_surface and (task.clearance is None or task.clearance.workpiece is None):
        changes.append(("path_in_surface", replace(bounds, in_surface=False)))
    if bounds.max_joint_step < _WIDE_STEP:
        changes.append(("max_joint_step_deg", replace(bounds, max_joint_step=_WIDE_STEP)))
    anywhere = np.full(3, np.inf)
    box = replace(bounds, p_lower=-anywhere, p_upper=anywhere)
    changes.append(("midpoint_lower, midpoint_upper", box))
    for key, changed in changes:
        yield key, _coarse(program, changed, program.path_length, with_cell=True)
    if program.cell is not None:
        key = "clearance" if task.clearance is not None else "overlap of the arm"
        yield key, _coarse(program, bounds, program.path_length, with_cell=False)
    yield "path_length", _coarse(program, bounds, 0.5 * program.path_length, with_cell=True)


def _coarse(
    program: PlacementProgram, bounds: PlacementBounds, path_length: float, *, with_cell: bool
) -> PlacementProgram:
    count = program.num_segments // coarse_stride(program.num_segments)
    cell, coarse_bounds = program.cell if with_cell else None, _coarse_bounds(program, bounds)
    return PlacementProgram(
        program.robot, program.measure, coarse_bounds, path_length, count, cell, has_cost=False
    )


def _coarse_bounds(program: PlacementProgram, bounds: PlacementBounds) -> PlacementBounds:
    stride = coarse_stride(program.num_segments)
    return replace(bounds, max_joint_step=stride * bounds.max_joint_step)


def _is_kept(program: PlacementProgram, search: SearchResult) -> bool:
    """Whether a program can be kept from one of the search's best ends."""
    for end in search.nearest[:_TRIED_ENDS]:
        if not _is_finite(end.placement.q):
            continue
        solution = program.solve(end.placement, options=_SOLVER_OPTIONS)
        if program.violation(solution.placement) < _CONSTRAINT_TOLERANCE:
            return True
    return False


def _is_finite(q: Array) -> bool:
    return bool(np.isfinite(q).all())
