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
from wrenchsight.analyses.output.progress import ProgressCallback
from wrenchsight.diagrams.placement.placement_program import PlacementProgram
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import one_thread
from wrenchsight.models.numerics.ties import better, in_order
from wrenchsight.models.planning.placement.placements import (
    Placement,
    PlacementBatch,
    on_all_branches,
)

UNREACHED_COST = 1e4  # of a path that cannot be followed
_MIN_AXIS_LENGTH = 1e-9  # of a rotation's axis that is divided by its length
MAX_STEP_SHARE = 0.2  # of the range of each coordinate, of a particle in one iteration


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
    program: PlacementProgram,
    seed: int = 0,
    config: SwarmConfig | None = None,
    progress: ProgressCallback = lambda fraction, message: None,
) -> SearchResult:
    """Places a path by PSO-GA; an interrupt (KeyboardInterrupt) ends it with the best so far.

    Args:
        program: robot, measure, bounds, path and cell; only these are used of it. A placement that
            comes too near to something counts as not reached.
        seed: of the particles' random numbers.
        progress: called with the share done and the best cost so far.

    Returns:
        One optimum, whose `starts` is the number of particles whose best place is a path that can
        be followed; none where no particle found one. `evaluations` counts particles.
    """
    config = config or SwarmConfig()
    cost = ParticleCost(program)
    rng = np.random.default_rng(seed)
    lower, upper = cost.lower, cost.upper
    count = config.num_particles
    # Particles x (count, 10) and their velocities; of each, the best place where it has been.
    x = rng.uniform(lower, upper, (count, len(lower)))
    v = np.zeros_like(x)
    max_step = MAX_STEP_SHARE * (upper - lower)
    result = SearchResult(num_starts=count)
    began = time.perf_counter()
    best_x, best_cost = x.copy(), np.full(count, np.inf)
    leader = _Leader(math.inf, None)  # kept by `evaluate`, so that an interrupt finds it

    def evaluate(points: Array) -> Array:
        """The costs (N,) of particles (N, 10), also of children; the best of all so far leads."""
        nonlocal leader
        costs, placement_of = cost(points)
        result.evaluations += len(points)
        best_row = int(np.argmin(costs))
        if costs[best_row] < min(leader.cost, UNREACHED_COST):
            leader = _Leader(float(costs[best_row]), placement_of(best_row))
            result.history.append((time.perf_counter() - began, leader.cost))
        return costs

    try:
        for iteration in range(config.num_iterations):
            costs = evaluate(x)
            is_better = costs < best_cost
            best_x[is_better], best_cost[is_better] = x[is_better], costs[is_better]
            # GA: children of the best places take those of the worst, in `best_x` and `best_cost`.
            _breed(rng, config, evaluate, best_x, best_cost, cost)
            # PSO: each is drawn to its best place, a child's perhaps, and to the swarm's.
            share = iteration / max(1, config.num_iterations - 1)
            inertia = config.inertia[0] + share * (config.inertia[1] - config.inertia[0])
            pull = config.attraction * rng.uniform(size=(2, *x.shape))
            swarm_best = best_x[int(np.argmin(best_cost))]
            v = inertia * v + pull[0] * (best_x - x) + pull[1] * (swarm_best - x)
            v = np.clip(v, -max_step, max_step)
            x = np.clip(x + v, lower, upper)
            progress((iteration + 1) / config.num_iterations, f"best {leader.cost:.4g}")
    except KeyboardInterrupt:
        result.interrupted = True
    if leader.placement is not None:
        values = program.measure.values(leader.placement.q)
        num_reached = int(np.sum(best_cost < UNREACHED_COST))
        result.optima = [
            Optimum(
                placement=leader.placement,
                cost=float(np.mean(values)),
                values=values,
                starts=num_reached,
                status="",  # no solver
            )
        ]
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
    is_better = costs < best_cost[worst]
    best_x[worst[is_better]], best_cost[worst[is_better]] = children[is_better], costs[is_better]


class ParticleCost:
    """Cost of particles (N, 10): n, m, theta, r."""

    def __init__(self, program: PlacementProgram) -> None:
        self._program = program
        bounds = program.bounds
        ones = np.ones(3)
        self.lower = np.concatenate([-ones, bounds.p_lower, [bounds.angle_lower], -ones])
        self.upper = np.concatenate([ones, bounds.p_upper, [bounds.angle_upper], ones])

    def __call__(self, x: Array) -> tuple[Array, Callable[[int], Placement]]:
        """The costs (N,) of N particles, and a function that gives the placement of one of them.

        A particle's cost is that of its best branch of the inverse kinematics: the mean of the
        measure along the path, at most UNREACHED_COST, which stands for a path that cannot be
        followed, breaks a bound or collides.

        Args:
            x: (N, 10) direction of the path n (3), its midpoint m (3) in m, and the tool's rotation
                by theta rad (1) about an axis r (3) of any length.
        """
        program, bounds = self._program, self._program.bounds
        direction, midpoint, angle, axis = np.split(x, [3, 6, 7], axis=1)
        axis = axis / np.maximum(np.linalg.norm(axis, axis=1), _MIN_AXIS_LENGTH)[:, np.newaxis]
        R_WE = Rotation.from_rotvec(angle * axis).as_matrix()
        n_W = bounds.allowed_directions(direction, R_WE[:, :, 2])
        # Of each particle one path a branch of the inverse kinematics: whether it can be followed,
        # and whose it is.
        paths = on_all_branches(
            program.robot,
            n_W,
            midpoint,
            R_WE,
            program.path_length,
            program.num_segments,
            bounds.max_joint_step,
        )
        batch, reached = paths.placements, paths.is_reached
        q = batch.q
        reached &= np.all((q >= bounds.q_lower) & (q <= bounds.q_upper), axis=(1, 2))
        if bounds.tool_direction is not None:
            reached &= batch.R_WE[:, :, 2] @ bounds.tool_direction >= math.cos(bounds.tool_tilt)
        path_costs = np.full(len(q), UNREACHED_COST)
        if np.any(reached):
            mean = np.mean(program.measure.values(q[reached]), axis=1)
            path_costs[reached] = np.minimum(mean, UNREACHED_COST)
        costs = np.full(len(x), UNREACHED_COST)
        chosen = np.zeros(len(x), dtype=int)  # each particle's path, its place in the batch
        # The best path first, so that each particle takes its first path that does not collide.
        # Costs that differ by rounding alone are equal: that of the path with the lower index comes
        # first. A path that is not better than the chosen one is not even checked for collisions.
        for path in in_order(path_costs):
            particle = paths.path_index[path]
            if not better(path_costs[path], costs[particle]):
                continue
            if self._collides(batch, int(path)):
                continue
            costs[particle], chosen[particle] = path_costs[path], path
        return costs, lambda particle: batch.one(int(chosen[particle]))

    def _collides(self, batch: PlacementBatch, index: int) -> bool:
        cell = self._program.cell
        return cell is not None and cell.deficit(batch.one(index)) > 0.0
