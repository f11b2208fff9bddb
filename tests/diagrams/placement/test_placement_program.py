import dataclasses
import math

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from pydrake.autodiffutils import ExtractGradient, InitializeAutoDiff
from pydrake.solvers import SnoptSolver
from scipy.spatial.transform import Rotation

from wrenchsight.analyses.methods.place.placement_refinement import CONSTRAINT_TOLERANCE
from wrenchsight.diagrams.placement.placement_program import PlacementProgram
from wrenchsight.models.planning.motion.path_postures import track_paths
from wrenchsight.models.planning.motion.posture_cost import ConditionNumber
from wrenchsight.models.planning.placement.placements import (
    Placement,
    PlacementBounds,
    pose_errors,
    quaternion_from,
    rotation_of,
)
from wrenchsight.models.robot.robot import Robot

# The article's initial path, on the branch from which the narrow optimum is downhill.
R_WE = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
POSTURE = np.array([0.0, -2.47202, 3.28638, 0.0, -0.81436, 0.0])
NARROW = 10.9748  # the best optimum known


@pytest.fixture(scope="module")
def bounds(sts: Robot) -> PlacementBounds:
    return PlacementBounds(
        sts.position_lower, sts.position_upper, np.array([-0.6, -0.6, 0.0]), np.full(3, 0.9)
    )


def program_of(robot: Robot, bounds: PlacementBounds, segments: int = 20) -> PlacementProgram:
    return PlacementProgram(robot, ConditionNumber(robot.chain), bounds, 1.0, segments)


def start(robot: Robot, segments: int = 20) -> Placement:
    n_W = np.array([0.0, 1.0, 0.0])
    q, reached = track_paths(
        robot.chain, POSTURE[np.newaxis], n_W[np.newaxis], 1.0, segments, max_joint_step=3.0
    )
    assert reached.all()
    R, p_WM = robot.chain.pose(POSTURE)
    return Placement(q[0], n_W, p_WM, quaternion_from(R))


def test_every_gradient_of_the_program_is_that_of_finite_differences(
    sts: Robot, bounds: PlacementBounds
) -> None:
    everything = dataclasses.replace(
        bounds,
        in_surface=True,
        tool_direction=np.array([0.0, 0.6, -0.8]),
        tool_tilt=0.4,
        angle_upper=3.0,
        path_direction=np.array([0.6, 0.8, 0.0]),
        path_angle_upper=0.4,
    )
    program = program_of(sts, everything, segments=4).program
    names = {binding.evaluator().get_description() for binding in program.generic_constraints()}
    assert {name for name in names if " at point" not in name} == {
        "unit quaternion",
        "path_in_surface",
        "tool_direction, tool_tilt_deg",
        "path_direction, path_angle_lower_deg, path_angle_upper_deg",
    }
    # On no constraint: the start's variables, all moved.
    x = 0.03 * np.random.default_rng(0).normal(size=program.num_vars())
    x += variables_of(sts, everything)
    for binding in [*program.generic_constraints(), *program.generic_costs()]:
        evaluator = binding.evaluator()
        at = x[program.FindDecisionVariableIndices(binding.variables())]
        gradient = ExtractGradient(evaluator.Eval(InitializeAutoDiff(at)[:, 0]))
        h = 1e-6
        steps = h * np.eye(len(at))
        expected = np.stack(
            [(evaluator.Eval(at + d) - evaluator.Eval(at - d)) / (2.0 * h) for d in steps], axis=-1
        )
        scale = 1.0 + np.max(np.abs(expected))
        np.testing.assert_allclose(gradient, expected, rtol=0, atol=1e-6 * scale)


def variables_of(robot: Robot, bounds: PlacementBounds) -> NDArray[np.float64]:
    """The start as the program's variables, in their order: its guess, after no step."""
    program = program_of(robot, bounds, segments=4)
    guesses: list[NDArray[np.float64]] = []
    engine = SnoptSolver.Solve
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            SnoptSolver,
            "Solve",
            lambda self, prog, guess, options: (
                guesses.append(guess) or engine(self, prog, guess, options)
            ),
        )
        program.solve(start(robot, segments=4), options={"Major iterations limit": 1})
    return guesses[0]


def test_pose_errors_vanish_on_the_path_and_measure_what_is_off(sts: Robot) -> None:
    placement = start(sts)
    assert np.max(np.abs(pose_errors(sts.chain, placement, 1.0))) < 1e-10
    same = dataclasses.replace(placement, quaternion=-placement.quaternion)
    assert np.max(np.abs(pose_errors(sts.chain, same, 1.0))) < 1e-10
    higher = dataclasses.replace(placement, p_WM=placement.p_WM + np.array([0, 0, 0.01]))
    np.testing.assert_allclose(
        pose_errors(sts.chain, higher, 1.0), np.tile([0, 0, 0, 0, 0, -0.01], (21, 1)), atol=1e-10
    )
    # E itself is turned by a centiradian about its own z axis.
    turned = R_WE @ Rotation.from_rotvec([0.0, 0.0, 0.01]).as_matrix()
    other = dataclasses.replace(placement, quaternion=quaternion_from(turned))
    size = np.linalg.norm(pose_errors(sts.chain, other, 1.0)[:, :3], axis=1)
    np.testing.assert_allclose(size, 0.01, rtol=1e-4)
    # Half a turn off is as wrong as can be, not zero.
    flipped = dataclasses.replace(
        placement, quaternion=quaternion_from(R_WE @ np.diag([1.0, -1.0, -1.0]))
    )
    size = np.linalg.norm(pose_errors(sts.chain, flipped, 1.0)[:, :3], axis=1)
    np.testing.assert_allclose(size, np.pi, rtol=1e-6)


def test_a_tool_turned_over_is_no_solution(sts: Robot, bounds: PlacementBounds) -> None:
    """Right angles alone would allow E's axes to point the opposite way, two at a time."""
    begin = start(sts, segments=4)
    flipped = quaternion_from(R_WE @ np.diag([1.0, -1.0, -1.0]))
    program = PlacementProgram(sts, ConditionNumber(sts.chain), bounds, 1.0, 4, has_cost=False)
    solution = program.solve(dataclasses.replace(begin, quaternion=flipped))
    # The solver turns the tool or the arm, or says that it did not come to an end.
    assert program.violation(solution.placement) < 1e-6 or not solution.converged


def test_a_path_beyond_reach_breaks_nothing_else(sts: Robot, bounds: PlacementBounds) -> None:
    """A path twice as long as the arm's reach misses its points, and no bound of the task."""
    program = PlacementProgram(sts, ConditionNumber(sts.chain), bounds, 3.0, 4, has_cost=False)
    solution = program.solve(start(sts, segments=4))
    assert not solution.converged
    errors = pose_errors(sts.chain, solution.placement, 3.0)
    assert np.max(np.abs(errors[:, 3:])) > 0.1
    assert bounds.violations(solution.placement)["midpoint_lower, midpoint_upper"] < 1e-6


def test_a_horizontal_line_can_be_stated(sts: Robot, bounds: PlacementBounds) -> None:
    """Perpendicular to the vertical to rounding, whichever way the start runs."""
    horizontal = dataclasses.replace(
        bounds,
        path_direction=np.array([0.0, 0.0, 1.0]),
        path_angle_lower=np.pi / 2,
        path_angle_upper=np.pi / 2,
    )
    program = program_of(sts, horizontal, segments=8)
    begin = start(sts, segments=8)
    tilted = dataclasses.replace(begin, n_W=np.array([0.0, np.cos(0.3), np.sin(0.3)]))
    solution = program.solve(tilted)
    assert program.violation(solution.placement) < 1e-7
    assert abs(solution.placement.n_W[2]) < 1e-9


def test_snopt_goes_from_the_articles_guess_to_the_narrow_optimum(
    sts: Robot, bounds: PlacementBounds
) -> None:
    program = program_of(sts, bounds)
    solution = program.solve(start(sts))
    assert solution.cost == pytest.approx(NARROW, abs=2e-4)
    assert program.violation(solution.placement) < 1e-7
    placement = solution.placement
    assert np.linalg.norm(placement.n_W) == pytest.approx(1.0, abs=1e-12)
    radius = float(np.hypot(placement.p_WM[0], placement.p_WM[1]))
    assert radius == pytest.approx(0.235, abs=2e-3)
    assert placement.p_WM[2] == pytest.approx(0.375, abs=2e-3)
    assert placement.R_WE[2, 2] < -0.999  # the tool points down
    R, p = sts.chain.pose(placement.q)
    along = np.linspace(-0.5, 0.5, 21)[:, np.newaxis] * placement.n_W
    np.testing.assert_allclose(p, placement.p_WM + along, atol=1e-7)
    np.testing.assert_allclose(R, np.broadcast_to(placement.R_WE, R.shape), atol=1e-7)


class FromPosture:
    """A measure with a closed-form optimum: the squared distance from a posture, mrad rad."""

    key, label = "distance", "squared distance"

    def __init__(self, posture: NDArray[np.float64]) -> None:
        self._posture = posture

    def values(self, q: ArrayLike) -> NDArray[np.float64]:
        return np.asarray(1e3 * np.sum((np.asarray(q) - self._posture) ** 2, axis=-1))

    def values_and_gradients(self, q: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return self.values(q), 2e3 * (np.asarray(q) - self._posture)


def test_a_short_path_lies_where_the_joints_move_least(sts: Robot, bounds: PlacementBounds) -> None:
    """The closed form: its midpoint is E's, its direction the last right singular vector of J^-1.

    With A the columns of J^-1 that turn a velocity of E into the joints', the ends of a path of
    length a have the squared distance |A n|^2 (a / 2)^2, the middle none: the mean is two thirds
    of it. What is left out is even in the path's length: (50 mm by an arm's .5 m)^2, a hundredth.
    """
    posture, length = POSTURE + np.array([0.0, 0.1, -0.2, 0.3, 0.4, 0.1]), 0.05
    A = np.linalg.inv(sts.chain.jacobian(posture))[:, 3:]
    _, sigma, directions = np.linalg.svd(A)
    R, p = sts.chain.pose(posture)
    program = PlacementProgram(sts, FromPosture(posture), bounds, length, 2)
    away = np.tile(posture + 0.05, (3, 1))
    begin = Placement(away, directions[0], p + 0.02, quaternion_from(R))
    solution = program.solve(begin)
    assert program.violation(solution.placement) < 1e-7
    assert solution.cost == pytest.approx(2e3 / 3.0 * (0.5 * length * sigma[-1]) ** 2, rel=0.02)
    assert abs(solution.placement.n_W @ directions[-1]) > 0.999
    np.testing.assert_allclose(solution.placement.p_WM, p, atol=2e-3)
    np.testing.assert_allclose(solution.placement.R_WE, R, atol=5e-3)


def test_bounds_are_kept_where_they_cost_something(sts: Robot, bounds: PlacementBounds) -> None:
    free = program_of(sts, bounds).solve(start(sts))
    narrow = dataclasses.replace(
        bounds,
        p_lower=np.array([0.3, -0.1, 0.4]),
        p_upper=np.array([0.5, 0.1, 0.5]),
        q_lower=bounds.q_lower + 0.05,
        q_upper=bounds.q_upper - 0.05,
        in_surface=True,
        max_joint_step=0.4,
        tool_direction=np.array([1.0, 0.0, 0.0]),
        tool_tilt=0.8,
    )
    program = program_of(sts, narrow)
    solution = program.solve(start(sts))
    assert solution.cost > free.cost + 0.01
    assert program.violation(solution.placement) < 1e-6
    placement = solution.placement
    assert np.all(placement.p_WM >= narrow.p_lower - 1e-7)
    assert np.all(placement.p_WM <= narrow.p_upper + 1e-7)
    assert abs(placement.n_W @ placement.R_WE[:, 2]) < 1e-7
    assert placement.R_WE[0, 2] >= math.cos(0.8) - 1e-7
    assert np.max(np.abs(np.diff(placement.q, axis=0))) <= 0.4 + 1e-7


def test_an_unknown_solver_is_refused(sts: Robot, bounds: PlacementBounds) -> None:
    """It was IPOPT."""
    with pytest.raises(ValueError, match="expected snopt or ipopt"):
        program_of(sts, bounds).solve(start(sts), "nlopt")


def test_a_measure_is_refused_where_nothing_is_minimised(
    sts: Robot, bounds: PlacementBounds
) -> None:
    """It was ignored."""
    measure = ConditionNumber(sts.chain)
    program = PlacementProgram(sts, measure, bounds, 1.0, 4, has_cost=False)
    with pytest.raises(ValueError, match="the program has no cost"):
        program.solve(start(sts, segments=4), measure=measure)


@pytest.mark.long
def test_ipopt_solves_the_same_program(sts: Robot, bounds: PlacementBounds) -> None:
    """From the end of a rough solve, as the search has it, wherever last bits send the iterations.

    It has no limit to its steps, and may leave the optimum for ever; then it says so.
    """
    program = program_of(sts, bounds)
    solutions = []
    for moved in (0.0, 1e-12, -1e-12):
        begin = start(sts)
        begin = dataclasses.replace(begin, p_WM=begin.p_WM + moved)
        near = program.solve(begin, options={"Major optimality tolerance": 1e-3})
        solutions.append(program.solve(near.placement, "ipopt"))
    converged = [solution for solution in solutions if solution.converged]
    assert converged
    for solution in converged:
        assert solution.cost == pytest.approx(NARROW, rel=1e-3)
        assert program.violation(solution.placement) < CONSTRAINT_TOLERANCE


@pytest.mark.parametrize(
    ("lower", "upper", "expected"),
    [
        (0.0, math.pi, (-1.0, 1.0)),
        (0.0, 1.0, (math.cos(0.5), 1.0)),
        (1.0, math.pi, (-math.cos(0.5), math.cos(0.5))),
        (1.0, 2.0, (math.cos(1.0), math.cos(0.5))),
    ],
)
def test_the_range_of_the_angle_is_one_of_the_quaternions_w(
    bounds: PlacementBounds, lower: float, upper: float, expected: tuple[float, float]
) -> None:
    ranged = dataclasses.replace(bounds, angle_lower=lower, angle_upper=upper)
    assert ranged.w_range() == pytest.approx(expected)


def test_violations_are_measured(sts: Robot, bounds: PlacementBounds) -> None:
    placement = start(sts)
    assert bounds.violation(placement) == 0.0
    cases = {
        "p_upper": np.array([0.45, 0.9, 0.9]),  # the midpoint is at 0.5
        "p_lower": np.array([0.55, 0.0, 0.0]),
        "angle_upper": math.pi - 0.05,  # the angle is half a turn
        "q_upper": np.full(6, float(np.max(placement.q)) - 0.05),
    }
    for name, value in cases.items():
        changed = dataclasses.replace(bounds, **{name: value})
        assert changed.violation(placement) == pytest.approx(0.05, abs=1e-5), (
            name
        )  # POSTURE has 6 digits
    tilted = dataclasses.replace(bounds, tool_direction=np.array([0.0, 0.0, 1.0]), tool_tilt=1.5)
    assert tilted.violation(placement) == pytest.approx(0.5 * math.pi - 1.5, abs=1e-5)


def test_rotations_and_quaternions() -> None:
    for R in Rotation.random(20, random_state=0).as_matrix():
        quaternion = quaternion_from(R)
        assert quaternion[0] >= 0.0
        np.testing.assert_allclose(rotation_of(3.0 * quaternion), R, atol=1e-12)
