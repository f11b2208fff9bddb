"""The article's solver of eq. 27, PSO-GA, as a baseline: a swarm with crossover and mutation.

The article names the algorithm and gives no constants. Here: the usual swarm (Shi and Eberhart,
1998, inertia falling from 0.9 to 0.4, both attractions 1.5), and after each step of the swarm a
genetic one on its best-known positions: arithmetic crossover of tournament winners and Gaussian
mutation, children taking the place of the worst particles. No maintained library offers this
hybrid; its two halves are some lines each.

A particle is the article's unknowns: n, m, theta and r. Its cost is the mean of the measure over
the path on its best branch within the limits; a path that no branch follows costs `UNREACHED`.
"""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import one_thread
from wrenchsight.models.numerics.ties import better, in_order
from wrenchsight.models.planning.placement.placement_program import (
    Placement,
    PlacementBatch,
    PlacementProgram,
    on_all_branches,
)
from wrenchsight.models.planning.placement.placement_search import Optimum, SearchResult
from wrenchsight.models.robot.robot import Robot

UNREACHED = 1e4  # of a path that cannot be followed


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


@one_thread()
def place_by_swarm(
    robot: Robot,
    program: PlacementProgram,
    seed: int = 0,
    config: SwarmConfig | None = None,
    progress: Callable[[float, str], None] = lambda fraction, what: None,
) -> SearchResult:
    """Places a path by PSO-GA; an interrupt (KeyboardInterrupt) ends it with the best so far.

    Args:
        program: measure, bounds, path and clearance; only these are used of it. A placement that
            misses the clearance's distance counts as not reached.
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
    leader: tuple[float, Placement | None] = (math.inf, None)

    def look(points: Array) -> Array:
        nonlocal leader
        costs, placements = cost(points)
        result.evaluations += len(points)
        first = int(np.argmin(costs))
        if costs[first] < min(leader[0], UNREACHED):
            leader = (float(costs[first]), placements(first))
            result.history.append((time.perf_counter() - began, leader[0]))
        return costs

    try:
        for iteration in range(config.num_iterations):
            costs = look(x)
            better = costs < best_cost
            best_x[better], best_cost[better] = x[better], costs[better]
            _breed(rng, config, look, best_x, best_cost, lower, upper)
            share = iteration / max(1, config.num_iterations - 1)
            inertia = config.inertia[0] + share * (config.inertia[1] - config.inertia[0])
            pull = config.attraction * rng.uniform(size=(2, *x.shape))
            swarm_best = best_x[int(np.argmin(best_cost))]
            v = inertia * v + pull[0] * (best_x - x) + pull[1] * (swarm_best - x)
            v = np.clip(v, -0.2 * (upper - lower), 0.2 * (upper - lower))
            x = np.clip(x + v, lower, upper)
            progress((iteration + 1) / config.num_iterations, f"best {leader[0]:.4g}")
    except KeyboardInterrupt:
        result.interrupted = True
    if leader[1] is not None:
        values = program.measure.values(leader[1].q)
        result.optima = [
            Optimum(
                leader[1], float(np.mean(values)), values, int(np.sum(best_cost < UNREACHED)), ""
            )
        ]
    return result


def _breed(
    rng: np.random.Generator,
    config: SwarmConfig,
    look: Callable[[Array], Array],
    best_x: Array,
    best_cost: Array,
    lower: Array,
    upper: Array,
) -> None:
    """Puts children of good particles in the place of the worst, where they are better."""
    count = max(2, round(config.crossovers * len(best_x)))
    rivals = rng.integers(len(best_x), size=(2, 2, count))
    first, second = (np.where(best_cost[a] < best_cost[b], a, b) for a, b in (rivals[0], rivals[1]))
    weight = rng.uniform(size=(count, 1))
    children = weight * best_x[first] + (1.0 - weight) * best_x[second]
    mutated = rng.uniform(size=children.shape) < config.mutations
    children += mutated * rng.normal(size=children.shape) * config.mutation_sd * (upper - lower)
    children = np.clip(children, lower, upper)
    costs = look(children)
    worst = np.argsort(-best_cost, kind="stable")[:count]
    better = costs < best_cost[worst]
    best_x[worst[better]], best_cost[worst[better]] = children[better], costs[better]


class ParticleCost:
    """Cost of particles (N, 10): n, m, theta, r."""

    def __init__(self, robot: Robot, program: PlacementProgram) -> None:
        self._robot, self._program = robot, program
        bounds = program.bounds
        one = np.ones(3)
        self.lower = np.concatenate([-one, bounds.p_lower, [bounds.angle_lower], -one])
        self.upper = np.concatenate([one, bounds.p_upper, [bounds.angle_upper], one])

    def __call__(self, x: Array) -> tuple[Array, Callable[[int], Placement]]:
        n_W = x[:, :3] / np.maximum(np.linalg.norm(x[:, :3], axis=1), 1e-9)[:, np.newaxis]
        axis = x[:, 7:] / np.maximum(np.linalg.norm(x[:, 7:], axis=1), 1e-9)[:, np.newaxis]
        R_WE = Rotation.from_rotvec(x[:, 6:7] * axis).as_matrix()
        program, bounds = self._program, self._program.bounds
        if bounds.in_surface:
            z = R_WE[:, :, 2]
            n_W = n_W - np.einsum("nc,nc->n", n_W, z)[:, np.newaxis] * z
            n_W /= np.maximum(np.linalg.norm(n_W, axis=1), 1e-9)[:, np.newaxis]
        size = program.path_length, program.num_segments, bounds.max_joint_step
        batch, reached, row = on_all_branches(self._robot, n_W, x[:, 3:6], R_WE, *size)
        costs = np.full(len(x), UNREACHED)
        chosen = np.zeros(len(x), dtype=int)
        q = batch.q
        reached &= np.all((q >= bounds.q_lower) & (q <= bounds.q_upper), axis=(1, 2))
        values = np.full(len(q), UNREACHED)
        if np.any(reached):
            mean = np.mean(program.measure.values(q[reached]), axis=1)
            values[reached] = np.minimum(mean, UNREACHED)
        for index in in_order(values):
            if not better(values[index], costs[row[index]]):
                continue
            if self._collides(batch, int(index)):
                continue
            costs[row[index]], chosen[row[index]] = values[index], index
        return costs, lambda particle: batch.one(int(chosen[particle]))

    def _collides(self, batch: PlacementBatch, index: int) -> bool:
        if self._program.clearance is None:
            return False
        one = batch.one(index)
        return self._program.clearance.deficit(one.q, one.n_W, one.p_WM, one.quaternion) > 0.0
