import dataclasses
import math

import numpy as np
import pytest
from pydrake.autodiffutils import ExtractGradient, InitializeAutoDiff
from scipy.spatial.transform import Rotation

from wrenchsight.models.planning.motion.path_postures import track_paths
from wrenchsight.models.planning.motion.posture_measures import ConditionNumber
from wrenchsight.models.planning.placement.placement_program import (
    Placement,
    PlacementBounds,
    PlacementProgram,
    quaternion_from,
    rotation_of,
)
from wrenchsight.models.planning.placement.placement_search import FEASIBLE
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
    return PlacementProgram(robot.chain, ConditionNumber(robot.chain), bounds, 1.0, segments)


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
    )
    program = program_of(sts, everything, segments=4)
    rng = np.random.default_rng(0)
    x = program.pack(start(sts, segments=4))
    x = x + 0.03 * rng.normal(size=len(x))  # on no constraint
    values = np.empty(len(x))
    values[program.program.FindDecisionVariableIndices(program.variables)] = x
    bindings = [
        *program.program.generic_constraints(),
        *program.program.quadratic_constraints(),
        *program.program.generic_costs(),
    ]
    assert len(bindings) == 6  # poses, surface, cone; two unit norms; cost
    for binding in bindings:
        evaluator = binding.evaluator()
        at = values[program.program.FindDecisionVariableIndices(binding.variables())]
        gradient = ExtractGradient(evaluator.Eval(InitializeAutoDiff(at)[:, 0]))
        h = 1e-6
        steps = h * np.eye(len(at))
        expected = np.stack(
            [(evaluator.Eval(at + d) - evaluator.Eval(at - d)) / (2.0 * h) for d in steps], axis=-1
        )
        scale = 1.0 + np.max(np.abs(expected))
        np.testing.assert_allclose(gradient, expected, rtol=0, atol=1e-6 * scale)
        pattern = evaluator.gradient_sparsity_pattern()
        if pattern is not None:
            outside = np.ones(gradient.shape, dtype=bool)
            outside[tuple(np.array(pattern).T)] = False
            assert np.all(gradient[outside] == 0.0)


def test_pose_errors_vanish_on_the_path_and_measure_what_is_off(
    sts: Robot, bounds: PlacementBounds
) -> None:
    program = program_of(sts, bounds)
    placement = start(sts)
    errors, _ = program.pose_errors(program.pack(placement))
    assert np.max(np.abs(errors)) < 1e-10
    same = dataclasses.replace(placement, quaternion=-placement.quaternion)
    np.testing.assert_allclose(program.pose_errors(program.pack(same))[0], errors, atol=1e-10)
    higher = dataclasses.replace(placement, p_WM=placement.p_WM + np.array([0, 0, 0.01]))
    errors, _ = program.pose_errors(program.pack(higher))
    np.testing.assert_allclose(
        errors.reshape(-1, 6), np.tile([0, 0, 0, 0, 0, -0.01], (21, 1)), atol=1e-10
    )
    # E itself is turned by a centiradian about its own z axis.
    turned = R_WE @ Rotation.from_rotvec([0.0, 0.0, 0.01]).as_matrix()
    other = dataclasses.replace(placement, quaternion=quaternion_from(turned))
    errors, _ = program.pose_errors(program.pack(other))
    size = np.linalg.norm(errors.reshape(-1, 6)[:, :3], axis=1)
    np.testing.assert_allclose(size, 0.01, rtol=1e-4)
    # Half a turn off is as wrong as can be, not zero.
    flipped = dataclasses.replace(
        placement, quaternion=quaternion_from(R_WE @ np.diag([1.0, -1.0, -1.0]))
    )
    errors, _ = program.pose_errors(program.pack(flipped))
    np.testing.assert_allclose(np.linalg.norm(errors.reshape(-1, 6)[:, :3], axis=1), 2.0, rtol=1e-6)


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


@pytest.mark.parametrize("moved", [0.0, 1e-12, -1e-12])
def test_ipopt_solves_the_same_program(sts: Robot, bounds: PlacementBounds, moved: float) -> None:
    """From a start that is no optimum, wherever the last bits of its numbers send the iterations.

    It ends where its cost changes by less than 1e-5 of itself from one iteration to the next: some
    of these together are 1e-3. The constraints hold as every placement's must.
    """
    program = program_of(sts, bounds)
    begin = start(sts)
    begin = dataclasses.replace(begin, p_WM=begin.p_WM + moved)
    near = program.solve(begin, options={"Major iterations limit": 10})
    assert near.cost > NARROW + 0.1
    solution = program.solve(near.placement, "ipopt")
    assert solution.converged
    assert solution.cost == pytest.approx(NARROW, rel=1e-3)
    assert program.violation(solution.placement) < FEASIBLE


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
