"""Finds the best placement of a straight path from any start: a global stage, then the program.

The cost has many local optima, and the best one's basin can be narrow. So

1. postures are drawn at random over the joint limits; each gives a midpoint, an orientation and a
   branch, and with a random direction a candidate path (moved into the box where it must). One
   kernel call carries all of them along their paths, and those that are reached are ranked;
2. the best poses, and the task's own initial guess, are tried on every branch that inverse
   kinematics finds; of all these candidates the best ones that differ become starts;
3. all starts descend side by side for a while (`PlacementDescent`);
4. in some more rounds the best ends that differ are varied, the tool turned about the path in even
   steps, again on every branch, and what is reached descends: a basin that a random start rarely
   meets is often the neighbour, in this sense, of one that is easily met;
5. the ends are grouped by the measure's course over the points; the best of each kind descends
   some more, and the best of these are brought to an optimum of the `MathematicalProgram`;
6. what differs of these is taken to the optimum's exact place, and to the one member of its family
   that stands for all (`models.placement.placement_refinement`): the same from any start and on any
   machine.

Two optima count as one if they have the same measure at every point of the path (or of the path
backwards): where a measure does not see a rotation of the base or of the tool, optima come in
families whose members are equally good.
"""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from wrenchsight.models.arrays import Array, Flags
from wrenchsight.models.kernel import one_thread
from wrenchsight.models.motion.path_postures import solve_poses, track_paths, wrap_within
from wrenchsight.models.placement.placement_descent import PlacementDescent
from wrenchsight.models.placement.placement_program import (
    Placement,
    PlacementBatch,
    PlacementProgram,
    Solution,
    between_points,
    on_all_branches,
    on_path,
)
from wrenchsight.models.placement.placement_refinement import finished
from wrenchsight.models.rigid_body.ties import in_order
from wrenchsight.models.robot.robot import Robot

FEASIBLE = 1e-7  # m and rad, of every constraint; postures are then corrected to rounding
BETWEEN = 1e-3  # rad and m, of joint limits between the points; clearance there is kept in full
SAME = 0.01  # relative, of the measure at every point: one optimum
_ALIKE = 0.02  # the same of two descents that have not come to their end
_LOOKED_AT = 3  # of a batch, after each step
_FEW = 30  # random placements; below it a shorter path is made longer
_GROWTH = (0.55, 0.7, 0.8, 0.87, 0.91, 0.94, 0.96, 0.98, 0.99, 1.0)  # of its length
_OTHER_KIND = 0.06  # the same of two that are worth varying


@dataclass(frozen=True)
class SearchEffort:
    """How hard to search.

    Attributes:
        num_samples: random candidates.
        num_poses: of them, tried on all branches.
        num_starts: descents of a round.
        num_rounds: after the first.
        num_kinds: ends that a round varies.
        num_turns: of the tool about the path, of each of these.
        num_steps: of each descent.
        num_solves: of the program, at most.
    """

    num_samples: int = 8000
    num_poses: int = 24
    num_starts: int = 48
    num_rounds: int = 3
    num_kinds: int = 14
    num_turns: int = 8
    num_steps: int = 30
    num_solves: int = 4


@dataclass(frozen=True)
class Optimum:
    """One local optimum of the program.

    Attributes:
        placement: it.
        cost: of the measure.
        values: (k + 1,) of the measure at its points.
        starts: how many of the search's starts came to it.
        status: of the solver.
    """

    placement: Placement
    cost: float
    values: Array
    starts: int
    status: str


@dataclass
class SearchResult:
    """What a search has found so far.

    Attributes:
        optima: distinct ones, best first; each keeps every constraint.
        num_candidates: paths looked at in the global stage, `num_reached` of them reached.
        num_starts: descents and solves, each from a start of its own.
        num_unassigned: starts that came to none of the optima.
        evaluations: of a path's measure, all stages.
        interrupted: whether it was ended early.
        history: (seconds, cost) whenever a better path that keeps the limits was known.
    """

    optima: list[Optimum] = field(default_factory=list)
    num_candidates: int = 0
    num_reached: int = 0
    num_starts: int = 0
    num_unassigned: int = 0
    evaluations: int = 0
    interrupted: bool = False
    history: list[tuple[float, float]] = field(default_factory=list)

    @property
    def best(self) -> Optimum | None:
        """The best optimum; None where nothing was found."""
        return self.optima[0] if self.optima else None


class PlacementSearch:
    """A search for one robot and one program.

    Attributes:
        program: measure, bounds and path.

    Args:
        robot: the arm.
        program: as the attribute.
        initial: the task's own guess as (n_W, p_WM, R_WE), tried on all branches; None for none.
    """

    def __init__(
        self,
        robot: Robot,
        program: PlacementProgram,
        initial: tuple[Array, Array, Array] | None = None,
    ) -> None:
        self._robot, self.program, self._initial = robot, program, initial
        self._posture = program.measure
        self._descent = PlacementDescent(
            robot.chain, program.measure, program.bounds, program.path_length, program.clearance
        )

    def run(
        self,
        seed: int = 0,
        solver: str = "snopt",
        effort: SearchEffort | None = None,
        progress: Callable[[float, str], None] = lambda fraction, what: None,
    ) -> SearchResult:
        """Searches; an interrupt (KeyboardInterrupt) ends it with the best found so far."""
        with one_thread():
            return self._run(seed, solver, effort or SearchEffort(), progress)

    def _run(
        self,
        seed: int,
        solver: str,
        effort: SearchEffort,
        progress: Callable[[float, str], None],
    ) -> SearchResult:
        result = SearchResult()
        clock = _Clock(result)
        ends: list[tuple[PlacementBatch, Array]] = []
        found: list[Solution] = []
        try:
            progress(0.02, "looking at random placements")
            starts = self.starts(seed, effort, result)
            if len(starts) == 0:
                return result
            for number in range(1 + effort.num_rounds):
                begun = 0.1 + 0.5 * number / (1 + effort.num_rounds)
                progress(begun, f"round {number + 1}, {len(starts)} starts descend")
                ends.append(self._descend(starts, effort.num_steps, result, clock))
                if number < effort.num_rounds:
                    starts = self._varied(*_joined(ends), effort, result)
            batch, values = _joined(ends)
            # A start that ranks behind may only have had fewer steps.
            batch = batch[self._different(batch, values, 20)]
            batch, values = self._descend(batch, 2 * effort.num_steps, result, clock)
            chosen = self._different(batch, values, effort.num_solves)
            for count, index in enumerate(chosen):
                progress(0.6 + 0.4 * count / len(chosen), f"{solver}, {count + 1}/{len(chosen)}")
                solution = self._solve(batch, int(index), solver, result, clock)
                if solution is not None:
                    found.append(solution)
            progress(0.97, "the last steps")
            found = [self._finished(solution, result, clock) for solution in self._kinds(found)]
        except KeyboardInterrupt:
            result.interrupted = True
        result.num_starts = sum(len(batch) for batch, _ in ends)
        self._sort(found, ends, result)
        known = None if result.optima else self._known(ends, clock)
        if known is not None:
            # Interrupted early, or no solve kept all constraints: what the descents had.
            values = self._posture.values(known.q)
            result.optima.append(Optimum(known, float(np.mean(values)), values, 0, "descent"))
        progress(1.0, "done")
        return result

    def _known(self, ends: list[tuple[PlacementBatch, Array]], clock: "_Clock") -> Placement | None:
        """The best placement without a solve that keeps all constraints between its points, too."""
        if clock.best is not None and self.corrected(clock.best) is not None:
            return clock.best
        if not ends:
            return None
        batch, values = _joined(ends)
        for index in in_order(values):
            if not np.isfinite(values[index]):
                break
            placement = self.corrected(batch.one(int(index)))
            if placement is not None:
                return placement
        return None

    def starts(self, seed: int, effort: SearchEffort, result: SearchResult) -> PlacementBatch:
        """The starts of the descents: reached paths, best first, each on its own branch."""
        rng = np.random.default_rng(seed)
        own = self.initial_guess()
        drawn = self.draw(rng, effort.num_samples, self.program.path_length, result)
        if np.sum(np.isfinite(self._costs(drawn))) < _FEW:
            drawn = PlacementBatch.joined([drawn, self.grown(rng, effort, result)])
        costs = self._costs(drawn)
        order = in_order(costs)
        poses = drawn[order[: effort.num_poses]]
        others = self._on_all_branches(poses.n_W, poses.p_WM, poses.R_WE, result)
        pool = PlacementBatch.joined([drawn[order], others])
        costs = self._costs(pool)
        result.evaluations += len(drawn) + len(pool)
        chosen = best_of_each(self._cells(pool), costs, effort.num_starts)
        return PlacementBatch.joined([own, pool[chosen]])

    def _cells(self, batch: PlacementBatch) -> NDArray[np.intp]:
        """Which half of its range each joint is in at the midpoint, as one number a placement.

        Branches of one pose lie in different halves, and so does what they descend to.
        """
        bounds = self.program.bounds
        middle = 0.5 * (bounds.q_lower + bounds.q_upper)
        middle = np.where(np.isfinite(middle), middle, 0.0)
        halves = batch.q[:, batch.q.shape[1] // 2] > middle
        return np.asarray(halves @ (1 << np.arange(halves.shape[1])), dtype=np.intp)

    def initial_guess(self) -> PlacementBatch:
        """The task's own guess on each branch on which it can be followed; empty without one."""
        if self._initial is None:
            return self._empty()
        n_W, p_WM, R_WE = self._initial
        return self._on_all_branches(n_W[None], p_WM[None], R_WE[None], SearchResult())

    def _empty(self) -> PlacementBatch:
        k, n = self.program.num_segments, self._robot.num_joints
        return PlacementBatch(
            np.empty((0, k + 1, n)), np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 3, 3))
        )

    def _on_all_branches(
        self, n_W: Array, p_WM: Array, R_WE: Array, result: SearchResult
    ) -> PlacementBatch:
        """Every branch of every midpoint pose that can be followed along the whole path."""
        if len(n_W) == 0:
            return self._empty()
        program = self.program
        size = program.path_length, program.num_segments, program.bounds.max_joint_step
        paths, reached, _ = on_all_branches(self._robot, n_W, p_WM, R_WE, *size)
        return self._counted(paths, reached, result)

    def _track(
        self,
        q_mid: Array,
        n_W: Array,
        p_WM: Array,
        R_WE: Array,
        result: SearchResult,
        path_length: float,
    ) -> PlacementBatch:
        program = self.program
        size = path_length, program.num_segments, program.bounds.max_joint_step
        q, reached = track_paths(self._robot.chain, q_mid, n_W, *size)
        paths = PlacementBatch(q, n_W, p_WM, R_WE)
        if path_length != program.path_length:
            return paths[reached]
        return self._counted(paths, reached, result)

    @staticmethod
    def _counted(paths: PlacementBatch, reached: Flags, result: SearchResult) -> PlacementBatch:
        result.num_candidates += len(reached)
        result.num_reached += int(np.sum(reached))
        return paths[reached]

    def grown(
        self, rng: np.random.Generator, effort: SearchEffort, result: SearchResult
    ) -> PlacementBatch:
        """Placements of a path that few postures can follow: of a shorter one, made longer.

        A descent leads away from where the arm is stretched out, and so makes room.
        """
        length = self.program.path_length
        batch = self.draw(rng, effort.num_samples, _GROWTH[0] * length, result)
        batch = batch[best_of_each(self._cells(batch), self._costs(batch), 2 * effort.num_starts)]
        for share, longer in pairwise(_GROWTH):
            if len(batch) == 0:
                break
            batch, _ = self._descent.of_length(share * length).run(batch, effort.num_steps)
            q_mid, reached = solve_poses(
                self._robot.chain, batch.R_WE, batch.p_WM, batch.q[:, batch.q.shape[1] // 2]
            )
            batch = batch[reached]
            batch = self._track(
                q_mid[reached], batch.n_W, batch.p_WM, batch.R_WE, result, longer * length
            )
        return batch

    def draw(
        self, rng: np.random.Generator, count: int, path_length: float, result: SearchResult
    ) -> PlacementBatch:
        """Random placements that are reached, their midpoints in the box."""
        bounds, chain = self.program.bounds, self._robot.chain
        lower = np.where(np.isfinite(bounds.q_lower), bounds.q_lower, -math.pi)
        upper = np.where(np.isfinite(bounds.q_upper), bounds.q_upper, math.pi)
        q = rng.uniform(lower, upper, (count, len(lower)))
        n_W = rng.normal(size=(count, 3))
        inside = rng.uniform(bounds.p_lower, bounds.p_upper, (count, 3))
        angles = rng.uniform(bounds.angle_lower, bounds.angle_upper, count)
        R_WE, p_WM = chain.pose(q)
        outside = np.any((p_WM < bounds.p_lower) | (p_WM > bounds.p_upper), axis=1)
        p_WM[outside] = inside[outside]
        turn = Rotation.from_matrix(R_WE).as_rotvec()
        angle = np.linalg.norm(turn, axis=1)
        beyond = (angle < bounds.angle_lower) | (angle > bounds.angle_upper)
        turn[beyond] *= (angles / np.maximum(angle, 1e-12))[beyond, np.newaxis]
        R_WE[beyond] = Rotation.from_rotvec(turn[beyond]).as_matrix()
        leant = self._lean(rng, R_WE)
        moved = outside | beyond | leant
        if np.any(moved):
            q[moved], reached = solve_poses(chain, R_WE[moved], p_WM[moved], q[moved])
            q[moved] = wrap_within(q[moved], bounds.q_lower, bounds.q_upper, chain.prismatic)
            keep = np.ones(count, dtype=bool)
            keep[np.flatnonzero(moved)[~reached]] = False
            q, n_W, p_WM, R_WE = q[keep], n_W[keep], p_WM[keep], R_WE[keep]
        if bounds.in_surface:
            z = R_WE[:, :, 2]
            n_W -= np.einsum("nc,nc->n", n_W, z)[:, np.newaxis] * z
        n_W /= np.linalg.norm(n_W, axis=1)[:, np.newaxis]
        return self._track(q, n_W, p_WM, R_WE, result, path_length)

    def _lean(self, rng: np.random.Generator, R_WE: Array) -> Flags:
        """Turns tools that point out of their cone into it, in place; which ones."""
        bounds = self.program.bounds
        if bounds.tool_direction is None:
            return np.zeros(len(R_WE), dtype=bool)
        z, direction = R_WE[:, :, 2], bounds.tool_direction
        angle = np.arccos(np.clip(z @ direction, -1.0, 1.0))
        target = bounds.tool_tilt * np.sqrt(rng.uniform(size=len(R_WE)))
        leant = angle > bounds.tool_tilt
        axis = np.cross(z, direction)
        axis[np.linalg.norm(axis, axis=1) < 1e-9] = R_WE[0, :, 0]
        axis /= np.linalg.norm(axis, axis=1)[:, np.newaxis]
        turn = Rotation.from_rotvec(axis * (angle - target)[:, np.newaxis]).as_matrix()
        R_WE[leant] = turn[leant] @ R_WE[leant]
        return np.asarray(leant)

    def _costs(self, batch: PlacementBatch) -> Array:
        """The mean measure, infinite where a limit is passed by far: descents bring it back."""
        if len(batch) == 0:
            return np.empty(0)
        bounds = self.program.bounds
        mean = np.mean(self._posture.values(batch.q), axis=1)
        over = np.maximum(bounds.q_lower - batch.q, batch.q - bounds.q_upper)
        over = np.maximum(np.max(over, axis=(1, 2)), 0.0)
        if bounds.tool_direction is not None:
            cosine = np.clip(batch.R_WE[:, :, 2] @ bounds.tool_direction, -1.0, 1.0)
            over = np.maximum(over, np.arccos(cosine) - bounds.tool_tilt)
        return np.asarray(np.where(over < 0.5, mean * (1.0 + 2.0 * over), np.inf))

    def _varied(
        self, batch: PlacementBatch, values: Array, effort: SearchEffort, result: SearchResult
    ) -> PlacementBatch:
        """The best kinds of placements with the tool turned about the path, on all branches."""
        kinds = batch[self._different(batch, values, effort.num_kinds, _OTHER_KIND)]
        angles = np.linspace(0.0, 2.0 * math.pi, effort.num_turns, endpoint=False)
        n_W = np.repeat(kinds.n_W, len(angles), axis=0)
        turns = Rotation.from_rotvec(np.tile(angles, len(kinds))[:, np.newaxis] * n_W)
        R_WE = turns.as_matrix() @ np.repeat(kinds.R_WE, len(angles), axis=0)
        p_WM = np.repeat(kinds.p_WM, len(angles), axis=0)
        varied = self._on_all_branches(n_W, p_WM, R_WE, result)
        result.evaluations += len(varied)
        costs = self._costs(varied)
        varied, costs = varied[np.isfinite(costs)], costs[np.isfinite(costs)]
        # Turned wrists are the same to the measure.
        return varied[self._different(varied, costs, effort.num_starts, SAME)]

    def _descend(
        self, starts: PlacementBatch, num_steps: int, result: SearchResult, clock: "_Clock"
    ) -> tuple[PlacementBatch, Array]:
        def watch(step: int, values: Array, batch: PlacementBatch) -> None:
            result.evaluations += len(batch)
            clock.look(batch, values, self.program.violation)

        return self._descent.run(starts, num_steps, watch=watch)

    def _different(
        self, batch: PlacementBatch, values: Array, count: int, gap: float = _ALIKE
    ) -> NDArray[np.intp]:
        """Indices of the best descents, of each kind one, kinds told apart by their profiles."""
        profiles = self._posture.values(batch.q)
        kept: list[int] = []
        for index in in_order(values):
            if len(kept) == count:
                break
            if not kept or profile_gaps(profiles[index], profiles[kept]).min() > gap:
                kept.append(int(index))
        return np.array(kept, dtype=np.intp)

    def _solve(
        self,
        batch: PlacementBatch,
        index: int,
        solver: str,
        result: SearchResult,
        clock: "_Clock",
    ) -> Solution | None:
        start = batch.one(index)
        solution = self.program.solve(start, solver)
        result.evaluations += solution.evaluations
        placement = self.corrected(solution.placement)
        if placement is None:
            return None
        cost = self.program.cost(placement.q)
        clock.better(cost, placement)
        return replace(solution, placement=placement, cost=cost)

    def _finished(self, solution: Solution, result: SearchResult, clock: "_Clock") -> Solution:
        done = finished(self._robot, self.program, solution, self.corrected)
        result.evaluations += done.evaluations - solution.evaluations
        clock.better(done.cost, done.placement)
        return done

    def corrected(self, placement: Placement) -> Placement | None:
        """The placement with postures on their path to rounding; None if it breaks a constraint.

        Joint limits, continuity and clearance are looked at between the points too.
        """
        program = self.program
        exact = on_path(self._robot, placement, program.path_length)
        if exact is None or np.max(np.abs(exact.q - placement.q)) > 1e-3:
            return None
        if program.violation(exact) > FEASIBLE:
            return None
        fine = between_points(self._robot, exact, program.path_length)
        if fine is None or program.violation_between(fine) > BETWEEN:
            return None
        return exact

    def _kinds(self, found: list[Solution]) -> list[Solution]:
        """Solutions that differ in their profiles, best first."""
        kinds: list[tuple[Solution, Array]] = []
        for index in in_order([solution.cost for solution in found]):
            values = self._posture.values(found[index].placement.q)
            if all(float(profile_gaps(values, other)) > SAME for _, other in kinds):
                kinds.append((found[index], values))
        return [solution for solution, _ in kinds]

    def _sort(
        self,
        found: list[Solution],
        ends: list[tuple[PlacementBatch, Array]],
        result: SearchResult,
    ) -> None:
        """Distinct optima, best first, and the starts that came to each."""
        kinds = [(one, self._posture.values(one.placement.q)) for one in self._kinds(found)]
        counts = np.zeros(len(kinds), dtype=int)
        for batch, _ in ends:
            for profile in self._posture.values(batch.q):
                gaps = [float(profile_gaps(profile, values)) for _, values in kinds]
                if gaps and min(gaps) < 2.0 * _ALIKE:
                    counts[int(np.argmin(gaps))] += 1
                else:
                    result.num_unassigned += 1
        result.optima = [
            Optimum(solution.placement, solution.cost, values, int(count), solution.status)
            for (solution, values), count in zip(kinds, counts, strict=True)
        ]


class _Clock:
    """Notes when a better placement was known, and keeps it."""

    def __init__(self, result: SearchResult) -> None:
        self._began = time.perf_counter()
        self._result = result
        self._cost = math.inf
        self.best: Placement | None = None

    def look(
        self, batch: PlacementBatch, values: Array, violation: Callable[[Placement], float]
    ) -> None:
        """Notes the best of a batch that keeps the constraints, if it is among the first few."""
        for index in np.argsort(values, kind="stable")[:_LOOKED_AT]:
            if not values[index] < self._cost:
                return
            placement = batch.one(int(index))
            if violation(placement) < FEASIBLE:
                self.better(float(values[index]), placement)
                return

    def better(self, cost: float, placement: Placement) -> None:
        """Notes a placement, if it is better than what was known."""
        if cost < self._cost:
            self._cost, self.best = cost, placement
            self._result.history.append((time.perf_counter() - self._began, cost))


def _joined(ends: list[tuple[PlacementBatch, Array]]) -> tuple[PlacementBatch, Array]:
    batches = PlacementBatch.joined([batch for batch, _ in ends])
    return batches, np.concatenate([values for _, values in ends])


def best_of_each(cells: NDArray[np.intp], costs: Array, count: int) -> NDArray[np.intp]:
    """Indices of up to `count` finite costs: the best of each cell, then each one's second..."""
    order = in_order(costs)
    order = order[np.isfinite(costs[order])]
    rank = np.empty(len(order), dtype=int)
    seen: dict[int, int] = {}
    for position, index in enumerate(order):
        cell = int(cells[index])
        rank[position] = seen.get(cell, 0)
        seen[cell] = rank[position] + 1
    return np.asarray(order[np.argsort(rank, kind="stable")][:count])


def profile_gaps(profile: Array, others: Array) -> Array:
    """How unlike profiles (..., k + 1) are: their largest relative difference point by point.

    The path may run in either direction. Ten times the relative difference of their means counts
    too: two optima may look alike at every point and yet not be the same.
    """
    forward = np.max(np.abs(others - profile) / np.minimum(others, profile), axis=-1)
    turned = profile[::-1]
    backward = np.max(np.abs(others - turned) / np.minimum(others, turned), axis=-1)
    mean = np.mean(profile)
    means = 10.0 * np.abs(np.mean(others, axis=-1) - mean) / mean
    return np.asarray(np.maximum(np.minimum(forward, backward), means))
