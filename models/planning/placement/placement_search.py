"""Global search for the best placement of a straight path.

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
   that stands for all (`models.planning.placement.placement_refinement`): the same from any start
   and on any machine.

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

from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.numerics.kernel import one_thread
from wrenchsight.models.numerics.ties import in_order
from wrenchsight.models.planning.motion.path_postures import solve_poses, track_paths, wrap_within
from wrenchsight.models.planning.placement.placement_descent import DescentEnds, PlacementDescent
from wrenchsight.models.planning.placement.placement_program import (
    Placement,
    PlacementBatch,
    PlacementProgram,
    Solution,
    between_points,
    on_all_branches,
    on_path,
)
from wrenchsight.models.planning.placement.placement_refinement import finished
from wrenchsight.models.robot.robot import Robot

FEASIBLE = 1e-7  # m and rad, of every constraint; postures are then corrected to rounding
BETWEEN = 1e-3  # rad and m, of joint limits between the points; clearance there is kept in full
SAME = 0.01  # relative, of the measure at every point: one optimum
_ALIKE = 0.02  # the same of two descents that have not come to their end
_NUM_CHECKED = 3  # of a batch, after each step
_FEW = 30  # random placements; below it a shorter path is made longer
_GROWTH = (0.55, 0.7, 0.8, 0.87, 0.91, 0.94, 0.96, 0.98, 0.99, 1.0)  # of its length
_OTHER_KIND = 0.06  # the same of two that are worth varying


@dataclass(frozen=True)
class SearchEffort:
    """Size of a search.

    Attributes:
        num_samples: random candidates.
        num_poses: candidates that are tried on all branches.
        num_starts: descents of a round.
        num_rounds: rounds after the first.
        num_kinds: ends that a round varies.
        num_turns: turns of the tool about the path, for each of these ends.
        num_steps: steps of each descent.
        num_solves: largest number of solves of the program.
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
        placement: the path and its postures.
        cost: mean of the measure.
        values: (k + 1,) the measure at its points.
        starts: number of the search's starts that ended at it.
        status: of the solver.
    """

    placement: Placement
    cost: float
    values: Array
    starts: int
    status: str


@dataclass
class SearchResult:
    """The state of a search, and its result at the end.

    Attributes:
        optima: distinct optima, best first; each keeps every constraint.
        num_candidates: paths of the global stage.
        num_reached: candidates that the arm can follow.
        num_starts: descents, each from another start.
        num_unassigned: starts that ended at none of the optima.
        evaluations: of a path's measure, all stages.
        interrupted: whether it was ended early.
        history: (seconds, cost) of each better path that keeps the limits.
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
        initial: the task's guess as (n_W, p_WM, R_WE), tried on all branches; None for none.
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
        progress: Callable[[float, str], None] = lambda fraction, message: None,
    ) -> SearchResult:
        """Searches; an interrupt (KeyboardInterrupt) ends it with the best placement so far.

        Args:
            seed: of the random candidates.
            solver: one of `placement_program.SOLVERS`.
            effort: size of the search; None: the default.
            progress: called with the fraction done and a message.
        """
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
        ends: list[DescentEnds] = []
        solutions: list[Solution] = []
        try:
            progress(0.02, "looking at random placements")
            starts = self.starts(seed, effort, result)
            if len(starts) == 0:
                return result
            for number in range(1 + effort.num_rounds):
                fraction = 0.1 + 0.5 * number / (1 + effort.num_rounds)
                progress(fraction, f"round {number + 1}, {len(starts)} starts descend")
                ends.append(self._descend(starts, effort.num_steps, result, clock))
                if number < effort.num_rounds:
                    starts = self._varied(_joined(ends), effort, result)
            # A start that ranks low may only have had fewer steps.
            joined = _joined(ends)
            starts = joined.batch[self._different(joined, 20)]
            last_ends = self._descend(starts, 2 * effort.num_steps, result, clock)
            chosen = self._different(last_ends, effort.num_solves)
            for count, index in enumerate(chosen):
                progress(0.6 + 0.4 * count / len(chosen), f"{solver}, {count + 1}/{len(chosen)}")
                solution = self._solve(last_ends.batch, int(index), solver, result, clock)
                if solution is not None:
                    solutions.append(solution)
            progress(0.97, "the last steps")
            solutions = [
                self._finished(solution, result, clock) for solution in self._kinds(solutions)
            ]
        except KeyboardInterrupt:
            result.interrupted = True
        result.num_starts = sum(len(descents.batch) for descents in ends)
        self._sort(solutions, ends, result)
        fallback = None if result.optima else self._best_corrected(ends, clock)
        if fallback is not None:
            # Interrupted early, or no solve kept all constraints: the best of the descents.
            values = self._posture.values(fallback.q)
            result.optima.append(Optimum(fallback, float(np.mean(values)), values, 0, "descent"))
        progress(1.0, "done")
        return result

    def _best_corrected(self, ends: list[DescentEnds], clock: "_Clock") -> Placement | None:
        """The best placement of the descents that keeps all constraints, also between points."""
        if clock.best is not None and self.corrected(clock.best) is not None:
            return clock.best
        if not ends:
            return None
        joined = _joined(ends)
        for index in in_order(joined.measure):
            if not np.isfinite(joined.measure[index]):
                break
            placement = self.corrected(joined.batch.one(int(index)))
            if placement is not None:
                return placement
        return None

    def starts(self, seed: int, effort: SearchEffort, result: SearchResult) -> PlacementBatch:
        """The starts of the descents: paths that the arm can follow, on various branches."""
        rng = np.random.default_rng(seed)
        guesses = self.initial_guess()
        random_paths = self.draw(rng, effort.num_samples, self.program.path_length, result)
        if np.sum(np.isfinite(self._costs(random_paths))) < _FEW:
            random_paths = PlacementBatch.joined([random_paths, self.grown(rng, effort, result)])
        costs = self._costs(random_paths)
        order = in_order(costs)
        poses = random_paths[order[: effort.num_poses]]
        branches = self._on_all_branches(poses.n_W, poses.p_WM, poses.R_WE, result)
        candidates = PlacementBatch.joined([random_paths[order], branches])
        costs = self._costs(candidates)
        result.evaluations += len(random_paths) + len(candidates)
        chosen = best_of_each(self._cells(candidates), costs, effort.num_starts)
        return PlacementBatch.joined([guesses, candidates[chosen]])

    def _cells(self, batch: PlacementBatch) -> NDArray[np.intp]:
        """(N,) one number a placement for the half of its range that each joint is in.

        It is that at the midpoint. Branches of one pose lie in different halves, and so do the
        ends of their descents.
        """
        bounds = self.program.bounds
        middle = 0.5 * (bounds.q_lower + bounds.q_upper)
        middle = np.where(np.isfinite(middle), middle, 0.0)
        halves = batch.q[:, batch.q.shape[1] // 2] > middle
        return np.asarray(halves @ (1 << np.arange(halves.shape[1])), dtype=np.intp)

    def initial_guess(self) -> PlacementBatch:
        """The task's guess on each branch on which it can be followed; empty without one."""
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
        paths, is_reached, _ = on_all_branches(
            self._robot,
            n_W,
            p_WM,
            R_WE,
            program.path_length,
            program.num_segments,
            program.bounds.max_joint_step,
        )
        return self._counted(paths, is_reached, result)

    def _track(
        self,
        q_mid: Array,
        n_W: Array,
        p_WM: Array,
        R_WE: Array,
        result: SearchResult,
        path_length: float,
    ) -> PlacementBatch:
        """The paths that can be followed from their postures `q_mid` at the midpoint."""
        program = self.program
        q, is_reached = track_paths(
            self._robot.chain,
            q_mid,
            n_W,
            path_length,
            program.num_segments,
            program.bounds.max_joint_step,
        )
        paths = PlacementBatch(q, n_W, p_WM, R_WE)
        if path_length != program.path_length:
            return paths[is_reached]
        return self._counted(paths, is_reached, result)

    @staticmethod
    def _counted(paths: PlacementBatch, is_reached: Flags, result: SearchResult) -> PlacementBatch:
        result.num_candidates += len(is_reached)
        result.num_reached += int(np.sum(is_reached))
        return paths[is_reached]

    def grown(
        self, rng: np.random.Generator, effort: SearchEffort, result: SearchResult
    ) -> PlacementBatch:
        """Placements of a path that few postures can follow: shorter paths, made longer by steps.

        A descent leads away from postures in which the arm is stretched out, and so makes room.
        """
        length = self.program.path_length
        batch = self.draw(rng, effort.num_samples, _GROWTH[0] * length, result)
        batch = batch[best_of_each(self._cells(batch), self._costs(batch), 2 * effort.num_starts)]
        for share, next_share in pairwise(_GROWTH):
            if len(batch) == 0:
                break
            batch = self._descent.of_length(share * length).run(batch, effort.num_steps).batch
            q_mid, is_reached = solve_poses(
                self._robot.chain, batch.R_WE, batch.p_WM, batch.q[:, batch.q.shape[1] // 2]
            )
            batch = batch[is_reached]
            batch = self._track(
                q_mid[is_reached], batch.n_W, batch.p_WM, batch.R_WE, result, next_share * length
            )
        return batch

    def draw(
        self, rng: np.random.Generator, count: int, path_length: float, result: SearchResult
    ) -> PlacementBatch:
        """Random placements that the arm can follow, their midpoints in the box."""
        bounds, chain = self.program.bounds, self._robot.chain
        lower = np.where(np.isfinite(bounds.q_lower), bounds.q_lower, -math.pi)
        upper = np.where(np.isfinite(bounds.q_upper), bounds.q_upper, math.pi)
        q = rng.uniform(lower, upper, (count, len(lower)))
        n_W = rng.normal(size=(count, 3))
        box_points = rng.uniform(bounds.p_lower, bounds.p_upper, (count, 3))
        angles = rng.uniform(bounds.angle_lower, bounds.angle_upper, count)
        R_WE, p_WM = chain.pose(q)
        is_outside = np.any((p_WM < bounds.p_lower) | (p_WM > bounds.p_upper), axis=1)
        p_WM[is_outside] = box_points[is_outside]
        turn = Rotation.from_matrix(R_WE).as_rotvec()
        angle = np.linalg.norm(turn, axis=1)
        is_angle_off = (angle < bounds.angle_lower) | (angle > bounds.angle_upper)
        turn[is_angle_off] *= (angles / np.maximum(angle, 1e-12))[is_angle_off, np.newaxis]
        R_WE[is_angle_off] = Rotation.from_rotvec(turn[is_angle_off]).as_matrix()
        is_turned = self._lean(rng, R_WE)
        is_moved = is_outside | is_angle_off | is_turned
        if np.any(is_moved):
            q[is_moved], is_reached = solve_poses(
                chain, R_WE[is_moved], p_WM[is_moved], q[is_moved]
            )
            q[is_moved] = wrap_within(q[is_moved], bounds.q_lower, bounds.q_upper, chain.prismatic)
            is_solved = np.ones(count, dtype=bool)
            is_solved[np.flatnonzero(is_moved)[~is_reached]] = False
            q, n_W, p_WM, R_WE = q[is_solved], n_W[is_solved], p_WM[is_solved], R_WE[is_solved]
        if bounds.in_surface:
            z = R_WE[:, :, 2]
            n_W -= np.einsum("nc,nc->n", n_W, z)[:, np.newaxis] * z
        n_W /= np.linalg.norm(n_W, axis=1)[:, np.newaxis]
        return self._track(q, n_W, p_WM, R_WE, result, path_length)

    def _lean(self, rng: np.random.Generator, R_WE: Array) -> Flags:
        """Turns tools that point out of their cone into it, in place; returns which ones (N,)."""
        bounds = self.program.bounds
        if bounds.tool_direction is None:
            return np.zeros(len(R_WE), dtype=bool)
        z, direction = R_WE[:, :, 2], bounds.tool_direction
        angle = np.arccos(np.clip(z @ direction, -1.0, 1.0))
        target = bounds.tool_tilt * np.sqrt(rng.uniform(size=len(R_WE)))
        is_turned = angle > bounds.tool_tilt
        axis = np.cross(z, direction)
        axis[np.linalg.norm(axis, axis=1) < 1e-9] = R_WE[0, :, 0]
        axis /= np.linalg.norm(axis, axis=1)[:, np.newaxis]
        turn = Rotation.from_rotvec(axis * (angle - target)[:, np.newaxis]).as_matrix()
        R_WE[is_turned] = turn[is_turned] @ R_WE[is_turned]
        return np.asarray(is_turned)

    def _costs(self, batch: PlacementBatch) -> Array:
        """(N,) the mean measure, raised where a limit is passed, infinite where it is by far."""
        if len(batch) == 0:
            return np.empty(0)
        bounds = self.program.bounds
        mean = np.mean(self._posture.values(batch.q), axis=1)
        excess = np.maximum(bounds.q_lower - batch.q, batch.q - bounds.q_upper)
        excess = np.maximum(np.max(excess, axis=(1, 2)), 0.0)
        if bounds.tool_direction is not None:
            cosine = np.clip(batch.R_WE[:, :, 2] @ bounds.tool_direction, -1.0, 1.0)
            excess = np.maximum(excess, np.arccos(cosine) - bounds.tool_tilt)
        return np.asarray(np.where(excess < 0.5, mean * (1.0 + 2.0 * excess), np.inf))

    def _varied(
        self, ends: DescentEnds, effort: SearchEffort, result: SearchResult
    ) -> PlacementBatch:
        """The best kinds of placements with the tool turned about the path, on all branches."""
        kinds = ends.batch[self._different(ends, effort.num_kinds, _OTHER_KIND)]
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
        return varied[self._different(DescentEnds(varied, costs), effort.num_starts, SAME)]

    def _descend(
        self, starts: PlacementBatch, num_steps: int, result: SearchResult, clock: "_Clock"
    ) -> DescentEnds:
        def record_step(step: int, values: Array, batch: PlacementBatch) -> None:
            result.evaluations += len(batch)
            clock.look(batch, values, self.program.violation)

        return self._descent.run(starts, num_steps, watch=record_step)

    def _different(self, ends: DescentEnds, count: int, gap: float = _ALIKE) -> NDArray[np.intp]:
        """Indices of the best ends, one of each kind; kinds differ in their profiles by `gap`."""
        profiles = self._posture.values(ends.batch.q)
        chosen: list[int] = []
        for index in in_order(ends.measure):
            if len(chosen) == count:
                break
            if not chosen or profile_gaps(profiles[index], profiles[chosen]).min() > gap:
                chosen.append(int(index))
        return np.array(chosen, dtype=np.intp)

    def _solve(
        self,
        batch: PlacementBatch,
        index: int,
        solver: str,
        result: SearchResult,
        clock: "_Clock",
    ) -> Solution | None:
        """Solves the program from an end of the descents; None if it breaks a constraint."""
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
        refined_solution = finished(self._robot, self.program, solution, self.corrected)
        result.evaluations += refined_solution.evaluations - solution.evaluations
        clock.better(refined_solution.cost, refined_solution.placement)
        return refined_solution

    def corrected(self, placement: Placement) -> Placement | None:
        """The placement with its postures exactly on the path; None if it breaks a constraint.

        Joint limits, continuity and clearance are checked between the points too.
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

    def _kinds(self, solutions: list[Solution]) -> list[Solution]:
        """Solutions that differ in their profiles, best first."""
        kinds: list[Solution] = []
        profiles: list[Array] = []
        for index in in_order([solution.cost for solution in solutions]):
            values = self._posture.values(solutions[index].placement.q)
            if all(float(profile_gaps(values, profile)) > SAME for profile in profiles):
                kinds.append(solutions[index])
                profiles.append(values)
        return kinds

    def _sort(
        self, solutions: list[Solution], ends: list[DescentEnds], result: SearchResult
    ) -> None:
        """Writes the distinct optima, best first, with the number of starts that ended at each."""
        kinds = self._kinds(solutions)
        profiles = [self._posture.values(solution.placement.q) for solution in kinds]
        num_starts = np.zeros(len(kinds), dtype=int)
        for descents in ends:
            for values in self._posture.values(descents.batch.q):
                gaps = [float(profile_gaps(values, profile)) for profile in profiles]
                if gaps and min(gaps) < 2.0 * _ALIKE:
                    num_starts[int(np.argmin(gaps))] += 1
                else:
                    result.num_unassigned += 1
        result.optima = [
            Optimum(
                placement=solution.placement,
                cost=solution.cost,
                values=profiles[index],
                starts=int(num_starts[index]),
                status=solution.status,
            )
            for index, solution in enumerate(kinds)
        ]


class _Clock:
    """Records the best placement so far, and when each better one was found."""

    def __init__(self, result: SearchResult) -> None:
        self._began = time.perf_counter()
        self._result = result
        self._cost = math.inf
        self.best: Placement | None = None

    def look(
        self, batch: PlacementBatch, values: Array, violation: Callable[[Placement], float]
    ) -> None:
        """Records the best of a batch that keeps the constraints, if it is among the first few."""
        for index in np.argsort(values, kind="stable")[:_NUM_CHECKED]:
            if not values[index] < self._cost:
                return
            placement = batch.one(int(index))
            if violation(placement) < FEASIBLE:
                self.better(float(values[index]), placement)
                return

    def better(self, cost: float, placement: Placement) -> None:
        """Records a placement, if it is better than the best so far."""
        if cost < self._cost:
            self._cost, self.best = cost, placement
            self._result.history.append((time.perf_counter() - self._began, cost))


def _joined(ends: list[DescentEnds]) -> DescentEnds:
    """The ends of several rounds of descents."""
    return DescentEnds(
        PlacementBatch.joined([descents.batch for descents in ends]),
        np.concatenate([descents.measure for descents in ends]),
    )


def best_of_each(cells: NDArray[np.intp], costs: Array, count: int) -> NDArray[np.intp]:
    """Indices of up to `count` finite costs: the best of each cell, then each one's second..."""
    order = in_order(costs)
    order = order[np.isfinite(costs[order])]
    rank = np.empty(len(order), dtype=int)
    counts: dict[int, int] = {}
    for position, index in enumerate(order):
        cell = int(cells[index])
        rank[position] = counts.get(cell, 0)
        counts[cell] = rank[position] + 1
    return np.asarray(order[np.argsort(rank, kind="stable")][:count])


def profile_gaps(profile: Array, profiles: Array) -> Array:
    """The difference of profiles (..., k + 1) from one: the largest relative one of all points.

    The path may run in either direction. Ten times the relative difference of their means counts
    too: two optima may look alike at every point and yet not be the same.
    """
    forward = np.max(np.abs(profiles - profile) / np.minimum(profiles, profile), axis=-1)
    reversed_profile = profile[::-1]
    backward = np.max(
        np.abs(profiles - reversed_profile) / np.minimum(profiles, reversed_profile), axis=-1
    )
    mean = np.mean(profile)
    means = 10.0 * np.abs(np.mean(profiles, axis=-1) - mean) / mean
    return np.asarray(np.maximum(np.minimum(forward, backward), means))
