"""Refinement of a placement: the exact optimum, and the standard member of its family.

A solver's end is as near to the optimum as its tolerance, and where a measure has kinks the solver
stops where it meets one. Whatever starts from such an end (a simulation, a reading) then has other
digits from another start or on another machine. So

1. the program is solved again from there, to a tighter tolerance, with the measure smoothed and the
   smoothing taken back step by step (`wrenchsight.models.planning.motion.posture_cost`);
2. of a family of placements that measure and constraints do not tell apart, one stands for all: the
   first joint is turned to the middle of its range at the path's midpoint, the last one too, wrist
   and elbow are those nearest to the middle of theirs, and the path runs towards the positive side
   of the axis of W that it is most along.
"""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from wrenchsight.diagrams.placement.placement_program import PlacementProgram, PlacementSolution
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.ties import TIE_TOLERANCE, first_of_least
from wrenchsight.models.planning.motion.posture_cost import smoothed
from wrenchsight.models.planning.placement.placements import (
    Placement,
    on_all_branches,
    quaternion_from,
)

MEASURE_SHARPNESSES = (1e2, 1e3, 1e4, 1e5)  # of the smoothed measure, one solve each
_NO_WORSE = 1e-6  # relative; what an exact optimum may lose by the remaining smoothing
_SAME_DISTANCE = 1e-6  # relative, of two postures' distances from the middle
CONSTRAINT_TOLERANCE = 1e-7  # m and rad, of every constraint of a placement that is finished
_MAX_VIOLATION = 1e-6  # m and rad; a solve that ends farther off its constraints has failed
_TIGHT_OPTIONS = {
    "Major optimality tolerance": 1e-8,
    "Major feasibility tolerance": 1e-10,
    "Major iterations limit": 200,
}


def finished(
    program: PlacementProgram,
    solution: PlacementSolution,
    corrected: Callable[[Placement], Placement | None],
) -> PlacementSolution:
    """The optimum that a solution is near to, as the member of its family that stands for all.

    Args:
        solution: on its path to rounding, keeping all constraints.
        corrected: puts a placement on its path to rounding; None if it breaks a constraint.

    Returns:
        The optimum, its evaluations counted with the solution's. Where no optimum that keeps all
        constraints and costs no more is found, the standard member of the solution's family.
    """
    refined_placement, evaluations = refined(program, solution.placement)
    exact = corrected(refined_placement)
    if exact is None or program.cost(exact.q) > solution.cost * (1.0 + _NO_WORSE):
        exact = solution.placement
    # The standard member was checked at the points of the path; `corrected` checks between them.
    placement = corrected(standard_member(program, exact)) or exact
    return replace(
        solution,
        placement=placement,
        cost=program.cost(placement.q),
        evaluations=solution.evaluations + evaluations,
    )


def refined(program: PlacementProgram, placement: Placement) -> tuple[Placement, int]:
    """The optimum near a placement; its postures are on the path within the solver's tolerance.

    Each sharper measure starts where the last one ended. A measure without kinks is solved once.

    Returns:
        The placement, and the number of evaluations of cost and gradient.
    """
    evaluations = 0
    for sharpness in MEASURE_SHARPNESSES:
        measure = smoothed(program.robot.chain, program.measure, sharpness)
        solution = program.solve(placement, options=_TIGHT_OPTIONS, measure=measure)
        evaluations += solution.evaluations
        if program.violation(solution.placement) > _MAX_VIOLATION:
            break
        placement = solution.placement
        if measure is program.measure:
            break
    return placement, evaluations


def standard_member(program: PlacementProgram, placement: Placement) -> Placement:
    """The standard member of a family of equal placements; the placement itself if it is alone.

    Equal are placements with the same measure at every point, to 1e-9 of it, that keep all
    constraints: the same path on other branches, and turns of it by the first and last joint that
    put these at the middle of their range. Of them the one nearest to the middle of all joints'
    ranges is the standard; of several as near, the first in the order of the inverse kinematics.
    It runs so that the largest component of its direction is positive, where that is equal, too.

    Args:
        placement: on its path to rounding, keeping all constraints.

    Returns:
        Postures on the path to rounding, too; between its points nothing was checked.
    """
    branches = _branches(program, placement)
    equal_placements = [placement]
    equal_placements += [branch for branch in branches if _equal(program, placement, branch)]
    members = [_turned(program, equal) for equal in equal_placements]
    middle = 0.5 * (program.robot.position_lower + program.robot.position_upper)
    middle = np.where(np.isfinite(middle), middle, 0.0)
    distances = [float(np.linalg.norm(_at_midpoint(member.q) - middle)) for member in members]
    placement = members[int(first_of_least(distances, tolerance=_SAME_DISTANCE))]
    largest_axis = int(first_of_least(-np.abs(placement.n_W)))
    reversed_path = Placement(
        placement.q[::-1].copy(), -placement.n_W, placement.p_WM, placement.quaternion
    )
    if placement.n_W[largest_axis] < 0.0 and _equal(program, placement, reversed_path):
        return reversed_path
    return placement


def _turned(program: PlacementProgram, placement: Placement) -> Placement:
    """The placement with the first and last joint at the middle of their range, where allowed.

    That is at the path's midpoint; a turn is made only where the placement stays equal.
    """
    robot = program.robot
    for joint in (0, robot.num_joints - 1):
        if robot.chain.prismatic[joint]:
            continue
        lower, upper = robot.position_lower[joint], robot.position_upper[joint]
        middle = 0.5 * (lower + upper) if math.isfinite(lower + upper) else 0.0
        q = placement.q.copy()
        q[:, joint] += middle - _at_midpoint(q)[joint]
        R, p = robot.chain.pose(q)
        along = p[-1] - p[0]
        candidate = Placement(
            q,
            along / np.linalg.norm(along),
            0.5 * (p[0] + p[-1]),
            quaternion_from(R[len(q) // 2]),
        )
        if _equal(program, placement, candidate):
            placement = candidate
    return placement


def _at_midpoint(q: Array) -> Array:
    k = len(q) - 1
    return np.asarray(0.5 * (q[k // 2] + q[(k + 1) // 2]))


def _branches(program: PlacementProgram, placement: Placement) -> list[Placement]:
    """The same path on every branch on which it can be followed."""
    paths = on_all_branches(
        program.robot,
        placement.n_W[np.newaxis],
        placement.p_WM[np.newaxis],
        placement.R_WE[np.newaxis],
        program.path_length,
        program.num_segments,
        program.bounds.max_joint_step,
    )
    return [replace(placement, q=q) for q in paths.placements.q[paths.is_reached]]


def _equal(program: PlacementProgram, placement: Placement, candidate: Placement) -> bool:
    """Whether two placements are equal in measure and constraints, whichever way they run."""
    if program.violation(candidate) > max(CONSTRAINT_TOLERANCE, program.violation(placement)):
        return False
    profile = program.measure.values(placement.q)
    other_profile = program.measure.values(candidate.q)
    return np.allclose(other_profile, profile, rtol=TIE_TOLERANCE, atol=0.0) or np.allclose(
        other_profile[::-1], profile, rtol=TIE_TOLERANCE, atol=0.0
    )
