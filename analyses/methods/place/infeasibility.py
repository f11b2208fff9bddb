"""Why a task has no placement: what the best that was reached lacks, and what is in the way.

The ends of the search's first stage break as little of the constraints as the solver could bring
about. The best of them says which constraints do not hold, and by how much. Then each of the task's
own constraints is taken away alone, and the program is solved again from the best ends: those
without which all others can be kept are the ones to loosen. Halving tells by how little.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from wrenchsight.analyses.methods.place.placement_search import (
    FEASIBILITY_OPTIONS,
    ROUGH_TOLERANCE,
    SearchResult,
    coarse_bounds,
    coarse_program,
)
from wrenchsight.diagrams.placement.placement_program import PlacementProgram, PlacementSolution
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.planning.placement.placement_task import PlacementTask
from wrenchsight.models.planning.placement.placements import (
    Placement,
    PlacementBounds,
    pose_errors,
)

_TRIED_ENDS = 2  # of the search, from which the program without a constraint is solved
_LOOSENING_HALVINGS = 4  # of the range in which the least loosening lies
_WIDE_STEP = math.pi / 3.0  # rad, the task's default
_MAX_NAMED_CONSTRAINTS = 3  # constraints in the sentence


def infeasible(
    task: PlacementTask, source: Path | str, program: PlacementProgram, search: SearchResult
) -> InputError:
    """The error line of a task for which a search found nothing.

    It says by how much the best end misses each constraint, and which of them, loosened alone,
    would be enough.

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
    loosened = list(_least_loosened(task, program, search))  # key, and words on how far
    key = "path_length"
    remedy = "no constraint is to blame alone: shorten the path, or loosen several"
    if loosened:
        key, _ = loosened[0]  # the line names one place: the first, as `_loosenings` lists them
        remedy = f"all else can be kept {' or '.join(text for _, text in loosened)}"
    return InputError(
        source,
        key,
        f"{name} has no placement that keeps all constraints (searched from {search.num_starts} "
        "starts); the best that was reached misses "
        f"{'; '.join(shortfalls[:_MAX_NAMED_CONSTRAINTS])}",
        remedy,
    )


def _shortfalls(program: PlacementProgram, end: PlacementSolution) -> list[str]:
    """What an end lacks of each constraint, in words, the largest first (rad or m alike).

    Args:
        end: of the search's coarse program, whose steps from point to point are longer.
    """
    placement = end.placement
    # Of each point of the path: rotation error, rad, then position error, m.
    errors = np.abs(pose_errors(program.robot.chain, placement, program.path_length))
    turn, offset = np.linalg.norm(errors[:, :3], axis=1), np.linalg.norm(errors[:, 3:], axis=1)
    shortfalls: list[tuple[float, str]] = []

    def lacks(amount: float, text: str) -> None:
        """Adds a constraint that is missed by an amount, rad or m."""
        if amount > ROUGH_TOLERANCE:
            shortfalls.append((amount, text))

    def percent_of_path(sizes: Array) -> str:
        """Where along the path the largest one is."""
        return f"{100.0 * float(np.argmax(sizes)) / (len(sizes) - 1):.0f} %"

    far, turned = float(offset.max()), float(turn.max())
    lacks(far, f"the path (position of E) by {1e3 * far:.0f} mm at {percent_of_path(offset)} of it")
    lacks(
        turned,
        f"the tool's rotation by {math.degrees(turned):.1f} degrees at {percent_of_path(turn)} "
        "of the path",
    )
    bounds = coarse_bounds(program, program.bounds)  # as the end's own program had
    for key, value in bounds.violations(placement).items():
        joint = bounds.worst_joint(key, placement)
        slides = joint is not None and bool(program.robot.chain.prismatic[joint])
        is_length = slides or key.startswith("midpoint")
        amount = f"{1e3 * value:.0f} mm" if is_length else f"{math.degrees(value):.1f} degrees"
        lacks(value, f"{key} by {amount}")
    pair = None if program.cell is None else program.cell.closest(placement)
    if pair is not None:
        missing = -pair.slack
        lacks(missing, f"clearance by {1e3 * missing:.0f} mm ({pair.first} and {pair.second})")
    return [text for _, text in sorted(shortfalls, reverse=True)]


@dataclass(frozen=True)
class _Loosening:
    """One of the task's constraints, loosened while all others stay.

    Attributes:
        key: its keys in the task's file.
        program: the coarse program with the constraint loosened by an amount, rad or m.
        largest: the amount to begin with.
        violation: its key in `PlacementBounds.violations`; empty for what these do not hold.
        unit: of the amount, as the message states it; empty for a constraint without a number.
    """

    key: str
    program: Callable[[float], PlacementProgram]
    largest: float = math.inf
    violation: str = ""
    unit: str = ""

    def text(self, amount: float) -> str:
        """What to do, after "all else can be kept"."""
        if self.unit == "":
            return f"without {self.key}"
        number = math.degrees(amount) if self.unit == "degrees" else 1e3 * amount
        digit = 10.0 ** (math.floor(math.log10(number)) - 1)  # the second one
        return f"with {self.key} loosened by {digit * math.ceil(number / digit):g} {self.unit}"


def _least_loosened(
    task: PlacementTask, program: PlacementProgram, search: SearchResult
) -> Iterator[tuple[str, str]]:
    """Keys of the constraints that are to blame alone, each with how little it must be loosened."""
    for loosening in _loosenings(task, program):
        end = _kept_end(loosening, [end.placement for end in search.nearest[:_TRIED_ENDS]])
        if end is None:
            continue
        enough, too_little = loosening.largest, 0.0
        for _ in range(_LOOSENING_HALVINGS if loosening.unit else 0):
            if loosening.violation:
                bounds = coarse_bounds(program, program.bounds)
                enough = min(enough, bounds.violations(end)[loosening.violation])
            middle = 0.5 * (too_little + enough)
            closer = _kept_end(loosening, [end], middle)
            if closer is None:
                too_little = middle
            else:
                enough, end = middle, closer
        yield loosening.key, loosening.text(enough)


def _kept_end(
    loosening: _Loosening, starts: list[Placement], amount: float | None = None
) -> Placement | None:
    """What keeps all constraints, one of them loosened, from the first start that leads there."""
    program = loosening.program(loosening.largest if amount is None else amount)
    for start in starts:
        if np.isfinite(start.q).all():
            end = program.solve(start, options=FEASIBILITY_OPTIONS).placement
            if program.violation(end) < ROUGH_TOLERANCE:
                return end
    return None


def _loosenings(task: PlacementTask, program: PlacementProgram) -> Iterator[_Loosening]:
    """Each constraint that the task states, and that can be loosened (see `_Loosening`).

    The margin of the joint limits goes to the limits at most, an angle to its end (0 or 180
    degrees), the path to half of its length; the others go as far as one likes.
    """
    bounds, robot = program.bounds, program.robot

    def of_bounds(
        key: str, violation: str, unit: str, loosened: Callable[[float], PlacementBounds]
    ) -> _Loosening:
        """A constraint among the bounds; `loosened` gives them for an amount, rad or m."""

        def loosened_program(amount: float) -> PlacementProgram:
            return coarse_program(program, has_cost=False, bounds=loosened(amount))

        # As far as one likes: `loosened` itself stops where nothing is bounded any more.
        return _Loosening(
            key=key, program=loosened_program, largest=math.inf, violation=violation, unit=unit
        )

    if task.limit_margin_deg > 0.0:
        yield of_bounds(
            "limit_margin_deg", "joint limits", "degrees",
            lambda amount: replace(
                bounds,
                q_lower=np.maximum(robot.position_lower, bounds.q_lower - amount),
                q_upper=np.minimum(robot.position_upper, bounds.q_upper + amount),
            ),
        )  # fmt: skip
    # Keys of the task's file, the bound, and the value at which it bounds nothing.
    for key, name, end in (
        ("tool_direction, tool_tilt_deg", "tool_tilt", math.pi),
        ("angle_upper_deg", "angle_upper", math.pi),
        ("angle_lower_deg", "angle_lower", 0.0),
        ("path_angle_upper_deg", "path_angle_upper", math.pi),
        ("path_angle_lower_deg", "path_angle_lower", 0.0),
        ("max_joint_step_deg", "max_joint_step", _WIDE_STEP),
    ):
        if key in _stated(task):
            yield of_bounds(key, key, "degrees", partial(_moved, bounds, name, end))
    if bounds.in_surface and (task.clearance is None or task.clearance.workpiece is None):
        key = "path_in_surface"  # yes or no: without an amount
        yield of_bounds(key, "", "", lambda amount: replace(bounds, in_surface=False))
    key = "midpoint_lower, midpoint_upper"
    yield of_bounds(
        key, key, "mm",
        lambda amount: replace(
            bounds, p_lower=bounds.p_lower - amount, p_upper=bounds.p_upper + amount
        ),
    )  # fmt: skip
    if program.cell is not None:
        yield _Loosening(
            key="clearance" if task.clearance is not None else "overlap of the arm",
            program=lambda amount: coarse_program(program, has_cost=False, with_cell=False),
        )
    yield _Loosening(
        key="path_length",
        program=lambda amount: coarse_program(
            program, has_cost=False, path_length=program.path_length - amount
        ),
        largest=0.5 * program.path_length,
        unit="mm",
    )


def _stated(task: PlacementTask) -> set[str]:
    """Keys of the angles by which a task bounds anything."""
    stated = {
        "tool_direction, tool_tilt_deg": task.tool_direction is not None,
        "angle_upper_deg": task.angle_upper_deg < 180.0,
        "angle_lower_deg": task.angle_lower_deg > 0.0,
        "path_angle_upper_deg": task.path_angle_upper_deg < 180.0,
        "path_angle_lower_deg": task.path_angle_lower_deg > 0.0,
        "max_joint_step_deg": math.radians(task.max_joint_step_deg) < _WIDE_STEP,
    }
    return {key for key, is_stated in stated.items() if is_stated}


def _moved(bounds: PlacementBounds, name: str, end: float, amount: float) -> PlacementBounds:
    """Bounds of which one is moved by an amount towards an end."""
    value = getattr(bounds, name)
    return replace(
        bounds, **{name: value + math.copysign(min(amount, abs(end - value)), end - value)}
    )
