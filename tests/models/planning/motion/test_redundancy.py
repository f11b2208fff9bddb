import dataclasses
import itertools
import math

import numpy as np
import pinocchio
import pytest

from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.planning.motion.posture_cost import ConditionNumber, ForceSd
from wrenchsight.models.planning.motion.redundancy import (
    RedundancyProblem,
    at_constant_angle,
    best_on_grid,
    candidates,
    local_descent,
    null_space,
    refine,
    task,
)
from wrenchsight.models.planning.motion.surface_path import SurfacePath
from wrenchsight.models.planning.motion.workpieces import BladeShapeConfig, Plate
from wrenchsight.models.robot.robot import Robot

INCLINED = np.array([math.sqrt(0.5), 0.0, math.sqrt(0.5)])


def make_problem(robot: Robot, num_samples: int = 31, **changes: object) -> RedundancyProblem:
    path = SurfacePath.on_surface(
        BladeShapeConfig().surface(),
        (0.75, 0.15),
        (0.75, 0.85),
        num_samples,
        None,
        np.array([0.45, -0.25, 0.25]),
    )
    problem = RedundancyProblem(
        robot=robot,
        path=path,
        tool_axis_E=INCLINED,
        measure=ConditionNumber(robot.chain),
        lower=robot.position_lower + 0.05,
        upper=robot.position_upper - 0.05,
        max_step=np.full(robot.num_joints, 0.3),
        num_angles=36,
        first_angle=1.0,
    )
    return dataclasses.replace(problem, **changes)  # type: ignore[arg-type]


def assert_follows(problem: RedundancyProblem, q: Array, psi: Array | None = None) -> None:
    """Position and normal, by pinocchio, to within rounding of the solver."""
    model = pinocchio.buildModelFromXML(problem.robot.urdf_text)
    data, frame = model.createData(), model.getFrameId("E")
    axis = problem.tool_axis_E / np.linalg.norm(problem.tool_axis_E)
    for i, row in enumerate(q):
        pinocchio.framesForwardKinematics(model, data, row)
        pose = data.oMf[frame]
        assert np.linalg.norm(pose.translation - problem.path.p_WS[i]) < 1e-6
        assert np.linalg.norm(pose.rotation @ axis + problem.path.n_W[i]) < 1e-6
        if psi is not None:
            R = problem.path.orientations(psi, problem.tool_axis_E)[i]
            np.testing.assert_allclose(pose.rotation, R, rtol=0, atol=1e-8)


def test_the_grids_optimum_is_that_of_trying_everything(sts: Robot) -> None:
    problem = make_problem(sts, 3, num_angles=9, smoothness=0.5, max_step=np.full(6, 0.9))
    grid = candidates(problem)
    layers = [grid.q[i][np.isfinite(grid.q[i, :, :, 0])] for i in range(3)]
    measures = [problem.measure.values(layer) for layer in layers]
    steps = []
    for a, b in itertools.pairwise(layers):
        step = b[np.newaxis] - a[:, np.newaxis]
        step[..., 5] -= 2 * math.pi * np.round(step[..., 5] / (2 * math.pi))  # joint 6 turns freely
        cost = problem.smoothness * 2 * np.sum(step**2, axis=2)
        cost[np.any(np.abs(step) > 0.9, axis=2)] = np.inf
        steps.append(cost)
    total = (
        measures[0][:, np.newaxis, np.newaxis] / 3
        + steps[0][:, :, np.newaxis]
        + measures[1][np.newaxis, :, np.newaxis] / 3
        + steps[1][np.newaxis]
        + measures[2] / 3
    )
    optimum = best_on_grid(problem, grid)
    assert problem.cost(optimum.q) == pytest.approx(float(np.min(total)), rel=1e-12)
    assert_follows(problem, optimum.q, optimum.psi)


def test_refinement_goes_down_and_keeps_everything(sts: Robot) -> None:
    problem = make_problem(sts)
    start = best_on_grid(problem, candidates(problem))
    optimum = refine(problem, start.q)
    assert problem.cost(optimum.q) < problem.cost(start.q)
    assert problem.violation(optimum.q) <= 1e-7
    assert_follows(problem, optimum.q, optimum.psi)
    # At the optimum the objective's slope along every null space vanishes where no bound holds it.
    basis = null_space(task(problem, optimum.q)[1])[:, :, 0]
    _, gradient = problem.measure.values_and_gradients(optimum.q)
    slope = np.sum(basis * gradient, axis=1) / len(basis)
    change = np.diff(optimum.q, axis=0)
    weight = 2.0 * problem.smoothness * (len(basis) - 1)
    slope[:-1] -= weight * np.sum(basis[:-1] * change, axis=1)
    slope[1:] += weight * np.sum(basis[1:] * change, axis=1)
    _, begin = problem.measure.values_and_gradients(start.q)
    along = null_space(task(problem, start.q)[1])[:, :, 0]
    assert np.max(np.abs(slope)) < 0.02 * np.max(np.abs(np.sum(along * begin, axis=1)) / len(basis))


def test_bounds_that_bind_are_kept(sts: Robot) -> None:
    free = make_problem(sts)
    optimum = refine(free, best_on_grid(free, candidates(free)).q)
    step = np.max(np.abs(np.diff(optimum.q, axis=0)))
    middle = float(np.median(optimum.q[:, 5]))
    tight = dataclasses.replace(
        free,
        upper=np.array([*free.upper[:5], middle]),
        max_step=np.full(6, 0.9 * step),
        num_angles=180,
    )
    held = refine(tight, best_on_grid(tight, candidates(tight)).q)
    assert tight.violation(held.q) <= 1e-7
    assert np.max(np.abs(np.diff(held.q, axis=0))) <= 0.9 * step + 1e-7
    assert free.cost(held.q) >= free.cost(optimum.q) - 1e-6
    assert_follows(tight, held.q)


def test_the_local_method_goes_down_from_the_initial_trajectory(sts: Robot) -> None:
    problem = make_problem(sts)
    grid = candidates(problem)
    initial = at_constant_angle(problem, grid, np.array(sts.home))
    np.testing.assert_allclose(initial.psi, problem.first_angle)
    assert_follows(problem, initial.q, initial.psi)
    local = local_descent(problem, initial.q[0])
    assert_follows(problem, local.q)
    before, after = (float(np.mean(problem.measure.values(t.q))) for t in (initial, local))
    optimum = refine(problem, best_on_grid(problem, grid).q)
    assert float(np.mean(problem.measure.values(optimum.q))) < after < before
    # The local method cannot leave its branch; the optimum here lies on another one.
    assert np.max(np.abs(np.diff(local.q, axis=0))) <= 0.3 + 1e-9


def test_a_path_along_joint_6_depends_on_no_angle(sts: Robot) -> None:
    problem = make_problem(sts, 5, tool_axis_E=np.array([0.0, 0.0, 1.0]), num_angles=12)
    grid = candidates(problem)
    values = np.where(
        np.isfinite(grid.q[..., 0]), problem.measure.values(np.nan_to_num(grid.q)), np.nan
    )
    # Each branch has the same condition number at all twelve angles.
    least = np.nanmin(values, axis=2)
    np.testing.assert_allclose(least, np.tile(least[:, :1], (1, 12)), rtol=1e-6)


def test_the_stated_force_sd_is_another_objective(sts: Robot) -> None:
    sd = ForceSd(
        sts.chain,
        np.diag([3.3, 3.6, 2.3, 0.53, 0.78, 0.36]) ** 2,
        WrenchReconstructionConfig().with_prior(20.0, 1.0),
    )
    problem = make_problem(sts, 11, measure=sd, num_angles=24)
    start = best_on_grid(problem, candidates(problem))
    optimum = refine(problem, start.q)
    assert problem.cost(optimum.q) <= problem.cost(start.q)
    jcn = make_problem(sts, 11, num_angles=24)
    other = refine(jcn, best_on_grid(jcn, candidates(jcn)).q)
    assert np.mean(sd.values(optimum.q)) < np.mean(sd.values(other.q))


def test_the_first_sample_out_of_reach_is_named(sts: Robot) -> None:
    path = SurfacePath.on_surface(
        Plate(2.0, 0.2), (0.5, 0.5), (1.0, 0.5), 21, None, np.array([0.3, 0.0, 0.3])
    )
    problem = make_problem(sts, 3, path=path, num_angles=12)
    with pytest.raises(InputError) as caught:
        candidates(problem)
    line = str(caught.value)
    named = int(line.partition("sample ")[2].partition(":")[0])
    grid = candidates(dataclasses.replace(problem, path=_first(path, named)))
    assert len(grid.q) == named > 2
    assert "cannot reach" in line


def _first(path: SurfacePath, count: int) -> SurfacePath:
    return SurfacePath(path.p_WS[:count], path.n_W[:count])


def test_steps_that_are_too_large_name_the_sample(sts: Robot) -> None:
    problem = make_problem(sts, 5, max_step=np.full(6, 0.001))
    with pytest.raises(InputError, match=r"sample 1.*joint steps"):
        best_on_grid(problem, candidates(problem))


def test_a_joint_with_two_turns_of_room_may_pass_half_a_turn(ur10e: Robot) -> None:
    """Joints of the UR10e have two turns each way; the grid knows each angle once only."""
    angle = np.linspace(0.0, 1.5 * math.pi, 61)
    centre = np.array([0.0, 0.0, 0.4])
    p = centre + 0.6 * np.stack([np.cos(angle), np.sin(angle), np.zeros(61)], axis=1)
    path = SurfacePath(p, np.tile([0.0, 0.0, 1.0], (61, 1)))
    problem = RedundancyProblem(
        robot=ur10e,
        path=path,
        tool_axis_E=np.array([0.0, 0.0, 1.0]),
        measure=ConditionNumber(ur10e.chain),
        lower=np.array(ur10e.position_lower),
        upper=np.array(ur10e.position_upper),
        max_step=np.full(6, 0.25),
        num_angles=24,
    )
    optimum = best_on_grid(problem, candidates(problem))
    assert problem.violation(optimum.q) == 0.0
    assert abs(optimum.q[-1, 0] - optimum.q[0, 0]) > 4.0
    assert_follows(problem, optimum.q)


def test_a_seven_joint_arm_uses_all_its_freedom(seven: Robot) -> None:
    path = SurfacePath.on_surface(
        Plate(0.3, 0.2), (0.1, 0.5), (0.9, 0.5), 15, None, np.array([0.45, 0.0, 0.25])
    )
    problem = RedundancyProblem(
        robot=seven,
        path=path,
        tool_axis_E=INCLINED,
        measure=ConditionNumber(seven.chain),
        lower=np.array(seven.position_lower),
        upper=np.array(seven.position_upper),
        max_step=np.full(7, 0.3),
        num_angles=24,
    )
    start = best_on_grid(problem, candidates(problem))
    optimum = refine(problem, start.q)
    assert problem.violation(optimum.q) <= 1e-7
    assert problem.cost(optimum.q) < problem.cost(start.q)
    assert_follows(problem, optimum.q)
    assert null_space(task(problem, optimum.q)[1]).shape == (15, 7, 2)
