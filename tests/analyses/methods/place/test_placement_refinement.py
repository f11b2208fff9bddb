"""The last steps of a placement: from whatever start, the same optimum and the same member."""

import dataclasses

import numpy as np
import pytest

from wrenchsight.analyses.methods.place.placement_refinement import (
    finished,
    refined,
    standard_member,
)
from wrenchsight.diagrams.placement.placement_program import PlacementProgram, PlacementSolution
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.planning.motion.path_postures import track_paths
from wrenchsight.models.planning.motion.posture_cost import ConditionNumber, ForceSd
from wrenchsight.models.planning.placement.placement_task import load_task
from wrenchsight.models.planning.placement.placements import (
    Placement,
    placement_on_path,
    quaternion_from,
)
from wrenchsight.models.robot.robot import Robot

LENGTH, SEGMENTS = 1.0, 20
# A posture near the midpoint of the linear path's best place, found by any search.
NEAR = np.array([0.0, -2.42, 3.70, 0.0, -2.85, 0.0])


@pytest.fixture(scope="module")
def robot():
    return Robot.load("sts_sre4_600")


@pytest.fixture(scope="module")
def bounds(robot):
    task, _ = load_task("linear_path")
    return task.bounds(robot)


@pytest.fixture(scope="module")
def program(robot, bounds):
    measure = ConditionNumber(robot.chain)
    return PlacementProgram(robot, measure, bounds, LENGTH, SEGMENTS)


def placed(robot, posture):
    """The path along y of a robot turned by the posture's first joint."""
    n_W = np.array([-np.sin(posture[0]), np.cos(posture[0]), 0.0])
    q, reached = track_paths(robot.chain, posture[None], n_W[None], LENGTH, SEGMENTS, 1.0)
    assert reached.all()
    R, p = robot.chain.pose(posture)
    return Placement(q[0], n_W, p, quaternion_from(R))


def corrected(robot, program):
    def put(placement):
        exact = placement_on_path(robot, placement, LENGTH)
        return exact if exact is not None and program.violation(exact) < 1e-7 else None

    return put


def optimum(robot, program, placement):
    start = PlacementSolution(placement, program.cost(placement.q), False, "", 0)
    return finished(program, start, corrected(robot, program))


@pytest.fixture(scope="module")
def best(robot, program):
    return optimum(robot, program, placed(robot, NEAR))


STARTS = {
    "the last bit": [0.0, 1e-12, -1e-12, 1e-12, 0.0, 0.0],
    "another posture": [0.0, 0.02, -0.02, 0.0, 0.02, 0.0],
    "base and tool turned": [0.5, 0.01, 0.02, 0.0, -0.02, -1.3],
}


@pytest.mark.parametrize("start", STARTS)
def test_starts_near_an_optimum_end_in_the_same_digits(robot, program, best, start):
    """The measure has a kink there: by the program alone they end some 1e-4 apart."""
    refined_placement = optimum(robot, program, placed(robot, NEAR + STARTS[start]))
    # The solver's tolerance of 1e-8 over a curvature of 0.3 and more, times some.
    assert refined_placement.cost == pytest.approx(best.cost, rel=1e-9)
    np.testing.assert_allclose(refined_placement.placement.q, best.placement.q, atol=1e-5)
    np.testing.assert_allclose(refined_placement.placement.p_WM, best.placement.p_WM, atol=1e-6)
    np.testing.assert_allclose(refined_placement.placement.n_W, best.placement.n_W, atol=1e-6)
    jcn = ConditionNumber(robot.chain)
    np.testing.assert_allclose(
        jcn.values(refined_placement.placement.q), jcn.values(best.placement.q), rtol=1e-6
    )


def test_it_is_an_optimum(robot, program, best):
    """No placement near by costs less, whichever way it is moved."""
    rng = np.random.default_rng(0)
    n, q = best.placement.n_W, best.placement.q[SEGMENTS // 2]
    for size in (1e-4, 1e-3, 1e-2):
        for _ in range(10):
            posture = q + size * rng.normal(size=6)
            direction = n + size * rng.normal(size=3)
            direction /= np.linalg.norm(direction)
            path, reached = track_paths(
                robot.chain, posture[None], direction[None], LENGTH, SEGMENTS, 1.0
            )
            if reached.all():
                assert program.cost(path[0]) > best.cost * (1.0 - 1e-9)


def test_the_smoothing_costs_nothing_that_is_printed(robot, program, best):
    """The solver's own best of many runs, before there were last steps, was 10.974754731."""
    assert best.cost < 10.9747547


def family(robot, placement):
    """The same path with base and tool turned, on the other wrist, and backwards."""
    q = placement.q.copy()
    q[:, 0] += 0.7
    q[:, 5] -= 1.1
    R, p = robot.chain.pose(q)
    along = p[-1] - p[0]
    turned = Placement(
        q, along / np.linalg.norm(along), 0.5 * (p[0] + p[-1]), quaternion_from(R[0])
    )
    flipped = q * [1, 1, 1, 1, -1, 1] + [0, 0, 0, np.pi, 0, -np.pi]
    back = Placement(q[::-1].copy(), -turned.n_W, turned.p_WM, turned.quaternion)
    return {
        "turned": turned,
        "flipped": dataclasses.replace(turned, q=flipped),
        "back": back,
    }


@pytest.mark.parametrize("kind", ["turned", "flipped", "back"])
def test_one_member_stands_for_a_family(robot, program, best, kind):
    other = family(robot, best.placement)[kind]
    assert program.violation(other) < 1e-9
    member = standard_member(program, other)
    np.testing.assert_allclose(member.q, best.placement.q, atol=1e-9)
    np.testing.assert_allclose(member.p_WM, best.placement.p_WM, atol=1e-9)
    np.testing.assert_allclose(member.n_W, best.placement.n_W, atol=1e-9)
    np.testing.assert_allclose(member.R_WE, best.placement.R_WE, atol=1e-9)


def test_a_turn_that_a_constraint_forbids_is_not_made(robot, bounds, best):
    turned = family(robot, best.placement)["turned"]
    around = dataclasses.replace(bounds, p_lower=turned.p_WM - 0.01, p_upper=turned.p_WM + 0.01)
    measure = ConditionNumber(robot.chain)
    narrow = PlacementProgram(robot, measure, around, LENGTH, SEGMENTS)
    member = standard_member(narrow, turned)
    assert narrow.violation(member) < 1e-9
    np.testing.assert_allclose(member.p_WM, turned.p_WM, atol=1e-9)
    assert member.q[SEGMENTS // 2, 5] == pytest.approx(0.0, abs=1e-9)  # the tool may be turned


def test_a_turn_that_changes_the_measure_is_not_made(robot, bounds, best):
    """A stated covariance of a force is the same for a turned base; the tool's turn is not seen."""
    config = WrenchReconstructionConfig(method="force_only")
    covariance = np.diag([4.0, 3.0, 2.0, 1.0, 0.5, 0.2])
    measure = ForceSd(robot.chain, covariance, config)
    program = PlacementProgram(robot, measure, bounds, LENGTH, SEGMENTS)
    turned = family(robot, best.placement)["turned"]
    member = standard_member(program, turned)
    assert member.q[SEGMENTS // 2, 0] == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(measure.values(member.q), measure.values(turned.q), rtol=1e-8)


def test_a_measure_without_kinks_is_solved_once(robot, bounds):
    config = WrenchReconstructionConfig(method="force_only")
    measure = ForceSd(robot.chain, np.eye(6), config)
    program = PlacementProgram(robot, measure, bounds, LENGTH, SEGMENTS)
    start = placed(robot, NEAR)
    solution, evaluations = refined(program, start)
    assert 0 < evaluations < 500
    assert program.cost(solution.q) <= program.cost(start.q)
