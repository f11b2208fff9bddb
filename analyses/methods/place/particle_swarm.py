"""The article's solver of eq. 27, PSO-GA, as a baseline: a swarm with crossover and mutation.

The article names the algorithm and gives no constants. Here: the usual swarm (Shi and Eberhart,
1998), with an inertia that falls from 0.9 to 0.4 and both attractions 1.5. After each step of the
swarm comes a genetic one on its best positions: arithmetic crossover of tournament winners and
Gaussian mutation, children taking the place of the worst particles. No maintained library offers
this hybrid. Its two halves are some lines each.

A particle is the article's unknowns: n, m, theta and r. Its cost is the mean of the measure over
the path on its best branch within the limits; a path that no branch follows costs `UNREACHED_COST`.
"""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from wrenchsight.analyses.methods.place.placement_search import Optimum, SearchResult
from wrenchsight.diagrams.placement.placement_program import PlacementProgram
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import one_thread
from wrenchsight.models.numerics.ties import better, in_order
from wrenchsight.models.planning.placement.placements import (
    Placement,
    PlacementBatch,
    on_all_branches,
)
from wrenchsight.models.robot.robot import Robot

UNREACHED_COST = 1e4  # of a path that cannot be followed


@dataclass(frozen=True)
class SwarmConfig:
    """Size and constants of the swarm."""

    num_particles: int = 60
    num_iterations: int = 120
    inertia: tuple[float, float] = (0.9, 0.4)  # at the first and at the last iteration
    attraction: float = 1.5  # to a particle's own best, and to the swarm's
    crossovers: float = 0.2  # of the swarm, each iteration
    mutations: float = 0.1  # of a child's coordinates
    mutation_sd: float = 0.1  # of the coordinate's range


class _Leader(NamedTuple):
    """The best placement so far, with its cost."""

    cost: float
    placement: Placement | None


@one_thread()
def place_by_swarm(
    robot: Robot,
    program: PlacementProgram,
    seed: int = 0,
    config: SwarmConfig | None = None,
    progress: Callable[[float, str], None] = lambda fraction, message: None,
) -> SearchResult:
    """Places a path by PSO-GA; an interrupt (KeyboardInterrupt) ends it with the best so far.

    Args:
        program: measure, bounds, path and cell; only these are used of it. A placement that comes
            too near to something counts as not reached.
    """
    config = config or SwarmConfig()
    cost = ParticleCost(robot, program)
    rng = np.random.default_rng(seed)
    lower, upper = cost.lower, cost.upper
    count = config.num_particles
    x = rng.uniform(lower, upper, (count, len(lower)))
    v = np.zeros_like(x)
    result = SearchResult(num_starts=count)
    began = time.perf_counter()
    best_x, best_cost = x.copy(), np.full(count, np.inf)
    leader = _Leader(math.inf, None)

    def evaluate(points: Array) -> Array:
        nonlocal leader
        costs, placements = cost(points)
        result.evaluations += len(points)
        best_row = int(np.argmin(costs))
        if costs[best_row] < min(leader.cost, UNREACHED_COST):
            leader = _Leader(float(costs[best_row]), placements(best_row))
            result.history.append((time.perf_counter() - began, leader.cost))
        return costs

    try:
        for iteration in range(config.num_iterations):
            costs = evaluate(x)
            better = costs < best_cost
            best_x[better], best_cost[better] = x[better], costs[better]
            _breed(rng, config, evaluate, best_x, best_cost, cost)
            share = iteration / max(1, config.num_iterations - 1)
            inertia = config.inertia[0] + share * (config.inertia[1] - config.inertia[0])
            pull = config.attraction * rng.uniform(size=(2, *x.shape))
            swarm_best = best_x[int(np.argmin(best_cost))]
            v = inertia * v + pull[0] * (best_x - x) + pull[1] * (swarm_best - x)
            v = np.clip(v, -0.2 * (upper - lower), 0.2 * (upper - lower))
            x = np.clip(x + v, lower, upper)
            progress((iteration + 1) / config.num_iterations, f"best {leader.cost:.4g}")
    except KeyboardInterrupt:
        result.interrupted = True
    if leader.placement is not None:
        values = program.measure.values(leader.placement.q)
        num_reached = int(np.sum(best_cost < UNREACHED_COST))
        mean = float(np.mean(values))
        result.optima = [Optimum(leader.placement, mean, values, num_reached, "")]
    return result


def _breed(
    rng: np.random.Generator,
    config: SwarmConfig,
    evaluate: Callable[[Array], Array],
    best_x: Array,
    best_cost: Array,
    bounds: "ParticleCost",
) -> None:
    """Puts children of good particles in the place of the worst, where they are better."""
    lower, upper = bounds.lower, bounds.upper
    count = max(2, round(config.crossovers * len(best_x)))
    rivals = rng.integers(len(best_x), size=(2, 2, count))
    mothers, fathers = (
        np.where(best_cost[a] < best_cost[b], a, b) for a, b in (rivals[0], rivals[1])
    )
    weight = rng.uniform(size=(count, 1))
    children = weight * best_x[mothers] + (1.0 - weight) * best_x[fathers]
    mutated = rng.uniform(size=children.shape) < config.mutations
    children += mutated * rng.normal(size=children.shape) * config.mutation_sd * (upper - lower)
    children = np.clip(children, lower, upper)
    costs = evaluate(children)
    worst = np.argsort(-best_cost, kind="stable")[:count]
    better = costs < best_cost[worst]
    best_x[worst[better]], best_cost[worst[better]] = children[better], costs[better]


class ParticleCost:
    """Cost of particles (N, 10): n, m, theta, r."""

    def __init__(self, robot: Robot, program: PlacementProgram) -> None:
        self._robot, self._program = robot, program
        bounds = program.bounds
        ones = np.ones(3)
        self.lower = np.concatenate([-ones, bounds.p_lower, [bounds.angle_lower], -ones])
        self.upper = np.concatenate([ones, bounds.p_upper, [bounds.angle_upper], ones])

    def __call__(self, x: Array) -> tuple[Array, Callable[[int], Placement]]:
        axis = x[:, 7:] / np.maximum(np.linalg.norm(x[:, 7:], axis=1), 1e-9)[:, np.newaxis]
        R_WE = Rotation.from_rotvec(x[:, 6:7] * axis).as_matrix()
        program, bounds = self._program, self._program.bounds
        n_W = bounds.allowed_directions(x[:, :3], R_WE[:, :, 2])
        batch, reached, row = on_all_branches(
            self._robot,
            n_W,
            x[:, 3:6],
            R_WE,
            program.path_length,
            program.num_segments,
            bounds.max_joint_step,
        )
        costs = np.full(len(x), UNREACHED_COST)
        chosen = np.zeros(len(x), dtype=int)
        q = batch.q
        reached &= np.all((q >= bounds.q_lower) & (q <= bounds.q_upper), axis=(1, 2))
        if bounds.tool_direction is not None:
            reached &= batch.R_WE[:, :, 2] @ bounds.tool_direction >= math.cos(bounds.tool_tilt)
        values = np.full(len(q), UNREACHED_COST)
        if np.any(reached):
            mean = np.mean(program.measure.values(q[reached]), axis=1)
            values[reached] = np.minimum(mean, UNREACHED_COST)
        for index in in_order(values):
            if not better(values[index], costs[row[index]]):
                continue
            if self._collides(batch, int(index)):
                continue
            costs[row[index]], chosen[row[index]] = values[index], index
        return costs, lambda particle: batch.one(int(chosen[particle]))

    def _collides(self, batch: PlacementBatch, index: int) -> bool:
        cell = self._program.cell
        return cell is not None and cell.deficit(batch.one(index)) > 0.0
