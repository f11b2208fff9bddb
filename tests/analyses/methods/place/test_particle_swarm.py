import dataclasses

import numpy as np
import pytest

from wrenchsight.analyses.methods.place.particle_swarm import (
    UNREACHED_COST,
    ParticleCost,
    SwarmConfig,
    place_by_swarm,
)
from wrenchsight.diagrams.placement.placement_program import PlacementProgram
from wrenchsight.models.planning.motion.path_postures import track_paths
from wrenchsight.models.planning.motion.posture_cost import ConditionNumber
from wrenchsight.models.planning.placement.placement_task import PlacementTask, load_task
from wrenchsight.models.robot.robot import Robot

FEW = SwarmConfig(num_particles=40, num_iterations=12)


@pytest.fixture(scope="module")
def task() -> PlacementTask:
    return load_task("linear_path")[0]


def program_of(robot: Robot, task: PlacementTask) -> PlacementProgram:
    measure = ConditionNumber(robot.chain)
    return PlacementProgram(robot, measure, task.bounds(robot), task.path_length, 20)


def test_a_particle_costs_its_best_branch(sts: Robot, task: PlacementTask) -> None:
    cost = ParticleCost(program_of(sts, task))
    # The article's initial path: n, m, theta and r, of any length.
    axis = np.array([1.0, 0.0, 1.0])
    initial = np.concatenate([[0.0, 0.5, 0.0], [0.5, 0.0, 0.45], [np.pi], axis])
    nowhere = np.concatenate([[1.0, 0.0, 0.0], [0.6, 0.0, 0.9], [np.pi], axis])
    costs, placement = cost(np.array([initial, nowhere]))
    result = placement(0)
    values = ConditionNumber(sts.chain).values(result.q)
    assert costs[0] == pytest.approx(np.mean(values), rel=1e-12)
    # Of its two elbows the other one has 17.21.
    assert costs[0] == pytest.approx(17.0973, abs=1e-3)
    assert costs[1] == UNREACHED_COST
    q, reached = track_paths(sts.chain, result.q[10:11], result.n_W[np.newaxis], 1.0, 20)
    assert reached.all()
    np.testing.assert_allclose(q[0], result.q, atol=1e-9)


def test_the_swarm_gets_better_and_repeats_itself(sts: Robot, task: PlacementTask) -> None:
    program = program_of(sts, task)
    first, again = (place_by_swarm(program, seed=2, config=FEW) for _ in range(2))
    assert first.best is not None
    assert again.best is not None
    assert first.best.cost == again.best.cost
    assert 10.97 < first.best.cost < 12.5
    assert first.history[-1][1] < first.history[0][1]
    assert program.violation(first.best.placement) < 1e-9
    assert first.evaluations == 12 * (40 + 8)


def test_bounds_are_kept(sts: Robot, task: PlacementTask) -> None:
    strict = dataclasses.replace(
        task, midpoint_lower=[0.2, -0.1, 0.3], path_in_surface=True, limit_margin_deg=5.0
    )
    program = program_of(sts, strict)
    result = place_by_swarm(program, seed=0, config=FEW)
    assert result.best is not None
    assert program.violation(result.best.placement) < 1e-7


def test_an_interrupt_keeps_the_best_so_far(sts: Robot, task: PlacementTask) -> None:
    def progress(fraction: float, _: str) -> None:
        if fraction > 0.3:
            raise KeyboardInterrupt

    result = place_by_swarm(program_of(sts, task), seed=0, config=FEW, progress=progress)
    assert result.interrupted
    assert result.best is not None
