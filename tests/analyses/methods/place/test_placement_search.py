import dataclasses
from typing import Any

import numpy as np
import pytest

from wrenchsight.analyses.methods.place.placement_search import (
    _LOOSE_OPTIONS,
    PlacementSearch,
    SearchEffort,
    SearchResult,
    best_of_each,
    coarse_stride,
    profile_gaps,
)
from wrenchsight.diagrams.placement.placement_program import (
    SOLVERS,
    PlacementProgram,
    PlacementSolution,
)
from wrenchsight.models.planning.motion.posture_cost import ConditionNumber
from wrenchsight.models.planning.placement.placement_task import PlacementTask, load_task
from wrenchsight.models.planning.placement.placements import (
    Placement,
    between_points,
    quaternion_from,
)
from wrenchsight.models.robot.robot import Robot

pytestmark = pytest.mark.long  # placements are searched for

SMALL = SearchEffort(
    num_samples=2000, num_poses=6, num_starts=24, num_rounds=1, num_kinds=4, num_solves=2
)


_FEW_ITERATIONS = {"snopt": {"Major iterations limit": 2}, "ipopt": {"max_iter": 2}}


@pytest.fixture(scope="module")
def task() -> PlacementTask:
    return load_task("linear_path")[0]


def search_of(robot: Robot, task: PlacementTask, guided: bool = True) -> PlacementSearch:
    measure, size = ConditionNumber(robot.chain), (task.path_length, task.num_segments)
    program = PlacementProgram(robot, measure, task.bounds(robot), *size)
    return PlacementSearch(program, task.initial_path() if guided else None)


@pytest.mark.parametrize("seed", [None, 3, 4, 11])
def test_the_narrow_optimum_is_found_from_the_guess_and_from_any_seed(
    sts: Robot, task: PlacementTask, seed: int | None
) -> None:
    search = search_of(sts, task, guided=seed is None)
    result = search.run(seed or 0)
    assert result.best is not None
    assert result.best.cost <= 10.976
    costs = [optimum.cost for optimum in result.optima]
    assert costs == sorted(costs)
    assert len(costs) >= 2
    # The wide basin beside it, which swarms end in.
    assert any(cost == pytest.approx(11.0279, abs=1e-3) for cost in costs)
    assert result.num_starts == result.num_unassigned + sum(o.starts for o in result.optima)
    assert all(o.starts > 0 for o in result.optima[:2])
    times, history = zip(*result.history, strict=True)
    assert list(times) == sorted(times)
    assert list(history) == sorted(history, reverse=True)
    # The last steps may give back what the smoothing of the measure costs.
    assert history[-1] == pytest.approx(result.best.cost, rel=1e-6)


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_second_solve_has_options_that_its_solver_knows(
    sts: Robot, task: PlacementTask, solver: str
) -> None:
    path = task.initial_path()
    assert path is not None
    q = np.tile(sts.home, (task.num_segments + 1, 1))  # off the path, as a start may be
    start = Placement(q, path.n_W, path.p_WM, quaternion_from(path.R_WE))
    options = _LOOSE_OPTIONS[solver] | _FEW_ITERATIONS[solver]
    solution = search_of(sts, task).program.solve(start, solver, options)
    assert np.isfinite(solution.cost)


def test_a_search_repeats_itself(sts: Robot, task: PlacementTask) -> None:
    first, again = (search_of(sts, task, guided=False).run(5, effort=SMALL) for _ in range(2))
    assert first.best is not None
    assert again.best is not None
    np.testing.assert_array_equal(first.best.placement.q, again.best.placement.q)
    assert [o.starts for o in first.optima] == [o.starts for o in again.optima]
    assert first.evaluations == again.evaluations


def test_optima_keep_all_constraints_also_between_the_points(
    sts: Robot, task: PlacementTask
) -> None:
    strict = dataclasses.replace(
        task,
        midpoint_lower=[0.25, -0.05, 0.3],  # rarely met by a random posture: they are moved there
        midpoint_upper=[0.35, 0.05, 0.4],
        limit_margin_deg=3.0,
        path_in_surface=True,
        tool_direction=[0.0, 0.0, -1.0],
        tool_tilt_deg=10.0,
        angle_upper_deg=175.0,
    )
    search = search_of(sts, strict, guided=False)
    result = search.run(0, effort=SMALL)
    assert result.optima
    bounds = strict.bounds(sts)
    for optimum in result.optima:
        assert bounds.violation(optimum.placement) < 1e-6
        fine = between_points(sts, optimum.placement, 1.0)
        assert fine is not None
        assert fine.q.shape == (201, 6)
        np.testing.assert_allclose(fine.q[::10], optimum.placement.q, atol=1e-9)
        _, p = sts.chain.pose(fine.q)
        expected = fine.p_WM + np.linspace(-0.5, 0.5, 201)[:, np.newaxis] * optimum.placement.n_W
        np.testing.assert_allclose(p, expected, atol=1e-9)


def test_paths_that_few_postures_follow_start_from_shorter_ones(
    sts: Robot, task: PlacementTask
) -> None:
    """No random posture of forty can follow 1.2 m; a part of it will do to start from."""
    long = dataclasses.replace(task, path_length=1.2)
    search = search_of(sts, long, guided=False)
    few = dataclasses.replace(SMALL, num_samples=40)
    starts = search.starts(0, few, SearchResult())
    lengths = [np.linalg.norm(np.diff(sts.chain.pose(s.q[[0, -1]])[1], axis=0)) for s in starts]
    assert len(starts) > 5
    assert max(lengths) < 1.0
    best = search.run(0, effort=few).best
    assert best is not None
    _, p = sts.chain.pose(best.placement.q)
    assert np.linalg.norm(p[-1] - p[0]) == pytest.approx(1.2, abs=1e-9)


@pytest.mark.parametrize(
    ("num_solves", "largest_cost"),
    [
        (1, np.inf),  # it finds out whether the task can be kept: any placement
        (4, 17.0),  # three more, rough ones from the guess, which has 17.1
    ],
)
def test_an_interrupt_keeps_the_best_so_far(
    sts: Robot,
    task: PlacementTask,
    monkeypatch: pytest.MonkeyPatch,
    num_solves: int,
    largest_cost: float,
) -> None:
    solve, count = PlacementProgram.solve, 0

    def interrupted(*arguments: Any, **options: Any) -> PlacementSolution:
        nonlocal count
        count += 1
        if count > num_solves:
            raise KeyboardInterrupt
        return solve(*arguments, **options)

    search = search_of(sts, task)
    monkeypatch.setattr(PlacementProgram, "solve", interrupted)
    result = search.run(0, effort=SMALL)
    assert result.interrupted
    assert result.best is not None
    assert result.best.cost < largest_cost
    assert search.program.violation(result.best.placement) < 1e-7


def test_without_a_solve_the_best_path_that_keeps_its_branch_between_points_is_taken(
    sts: Robot, task: PlacementTask, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No solve keeps all constraints, and the best descents jump between two points."""
    search = search_of(sts, task)
    corrected = search.corrected
    monkeypatch.setattr(search, "_record", lambda *_: None)
    monkeypatch.setattr(search, "_solve", lambda *_: None)
    result = search.run(0, effort=SMALL)
    assert result.best is not None
    assert result.best.status == "rough"
    assert corrected(result.best.placement) is not None
    monkeypatch.setattr(search, "corrected", lambda placement: None)
    assert search.run(0, effort=SMALL).best is None


def test_a_jump_to_another_branch_is_seen_between_the_points(
    sts: Robot, task: PlacementTask
) -> None:
    path = task.initial_path()
    assert path is not None
    guess = search_of(sts, task).initial_guess()
    one, other = guess.q[0], guess.q[1]
    assert np.max(np.abs(one - other)) > 1.0
    placement = Placement(one, path.n_W, path.p_WM, np.array([0.0, 1.0, 0.0, 1.0]) / np.sqrt(2.0))
    assert between_points(sts, placement, 1.0) is not None
    mixed = np.concatenate([one[:10], other[10:]])
    assert between_points(sts, dataclasses.replace(placement, q=mixed), 1.0) is None


@pytest.mark.parametrize(("segments", "stride"), [(20, 4), (21, 3), (10, 2), (7, 1)])
def test_coarse_points_are_points_of_the_path(segments: int, stride: int) -> None:
    assert coarse_stride(segments) == stride


def test_the_best_of_each_cell_comes_first() -> None:
    cells = np.array([7, 7, 3, 7, 3, 5])
    costs = np.array([1.0, 2.0, 9.0, 3.0, 8.0, np.inf])
    assert best_of_each(cells, costs, 3).tolist() == [0, 4, 1]
    assert best_of_each(cells, costs, 10).tolist() == [0, 4, 1, 2, 3]


def test_profiles_are_alike_in_either_direction_and_apart_by_their_means() -> None:
    profile = np.array([10.0, 11.0, 14.0])
    assert profile_gaps(profile, profile[::-1]) == 0.0
    assert profile_gaps(profile, profile * 1.001) == pytest.approx(0.01)
    assert profile_gaps(
        profile, np.stack([profile, profile + np.array([0.0, 1.1, 0.0])])
    ) == pytest.approx([0.0, 10.0 * 1.1 / 35.0])
