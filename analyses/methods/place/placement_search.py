"""Global search for the best placement of a straight path, by many starts of one program.

The cost has many local optima, and the best one's basin can be narrow. So

1. postures are drawn at random over the joint limits; each gives a midpoint, an orientation and a
   branch, and with a random direction a candidate path (moved into the box where it must). All of
   them are carried along their paths, and those that are reached are ranked; where few are, a part
   of the path's length will do for a start;
2. the best poses, and the task's own initial guess, are tried on every branch that inverse
   kinematics finds; of all these candidates the best ones that differ become starts;
3. a coarse program, with every few points of the path, is solved from each start roughly;
4. in some more rounds the best ends that differ are varied, the tool turned about the path in even
   steps, again on every branch, and the program is solved from what is reached: a basin that a
   random start rarely meets is often the neighbour, in this sense, of one that is easily met;
5. the ends are grouped by the measure's course over the points, and the program of all points is
   solved from the best of each kind;
6. what differs of these is taken to the optimum's exact place, and to the one member of its family
   that stands for all (`placement_refinement`): the same from any start and on any machine.

Two optima count as one if they have the same measure at every point of the path (or of the path
backwards): where a measure does not see a rotation of the base or of the tool, optima come in
families whose members are equally good.

Before all this, some starts are brought to any placement that keeps the constraints, at every few
points of the path only. Where none comes there, no placement of the whole path can be found either,
and `infeasibility` explains what is missing.
"""

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from wrenchsight.analyses.methods.place.placement_refinement import finished
from wrenchsight.diagrams.placement.placement_program import PlacementProgram, PlacementSolution
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.numerics.kernel import one_thread
from wrenchsight.models.numerics.ties import in_order
from wrenchsight.models.planning.motion.path_postures import solve_poses, track_paths, wrap_within
from wrenchsight.models.planning.placement.placements import (
    Placement,
    PlacementBatch,
    between_points,
    interpolated,
    on_all_branches,
    placement_on_path,
)
from wrenchsight.models.robot.robot import Robot

# m and rad, of every constraint; postures are then corrected to rounding
CONSTRAINT_TOLERANCE = 1e-7
# rad and m, of joint limits between the points; clearance there is kept in full
BETWEEN_TOLERANCE = 1e-3
OPTIMUM_TOLERANCE = 0.01  # relative, of the measure at every point: one optimum
_ROUGH_END_TOLERANCE = 0.02  # the same of two ends that have not come to their optimum
_MIN_STARTS = 30  # random placements; with fewer a part of the path's length will do
_STAGE_SHARES = (0.6, 0.2, 0.02)  # of its length
_TRIED_PER_START = 4  # candidates whose distances are looked at
_DEFICIT_WEIGHT = 10.0  # of the cost by m; a posture through the floor is worth little
_FINISHED_WITH_CELL = 2  # optima; with distances the last steps take seconds
_OTHER_KIND = 0.06  # the same of two that are worth varying
_ROUGHLY_FEASIBLE = 1e-4  # m and rad, of a rough solve's end
_ROUGH_OPTIONS = {
    "Major optimality tolerance": 1e-3,
    "Major feasibility tolerance": 1e-6,
    "Major iterations limit": 120,
    "Iterations limit": 6000,
}


_LOOSE_OPTIONS = {  # by solver; of a second solve from an end that breaks a constraint
    "snopt": {"Major optimality tolerance": 1e-2},
    "ipopt": {"tol": 1e-2},
}
_FEASIBILITY_OPTIONS = {
    "Major feasibility tolerance": 1e-6,
    "Major iterations limit": 60,
    "Iterations limit": 3000,
}


@dataclass(frozen=True)
class SearchEffort:
    """Size of a search.

    Attributes:
        num_samples: random candidates.
        num_poses: candidates that are tried on all branches.
        num_starts: solves of a round.
        num_rounds: rounds after the first.
        num_kinds: ends that a round varies.
        num_turns: turns of the tool about the path, for each of these ends.
        num_solves: largest number of fine solves.
        num_feasibility: starts of which one must come to keep all constraints.
    """

    num_samples: int = 8000
    num_poses: int = 24
    num_starts: int = 48
    num_rounds: int = 3
    num_kinds: int = 14
    num_turns: int = 8
    num_solves: int = 5
    num_feasibility: int = 40


@dataclass(frozen=True)
class Optimum:
    """One local optimum of the program.

    Attributes:
        placement: the path and its postures.
        cost: mean of the measure.
        values: (k + 1,) the measure at its points.
        starts: number of the search's starts that ended at it.
        status: status of the solver.
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
        num_starts: rough solves, each from another start.
        num_unassigned: starts that ended at none of the optima.
        evaluations: evaluations of a path's measure, all stages.
        interrupted: whether it was ended early.
        history: (seconds, cost) of each better path that keeps the limits.
        nearest: where no start could keep all constraints, their ends at the coarse points, best
            first; where the path could not be followed between these, the same.
    """

    optima: list[Optimum] = field(default_factory=list)
    num_candidates: int = 0
    num_reached: int = 0
    num_starts: int = 0
    num_unassigned: int = 0
    evaluations: int = 0
    interrupted: bool = False
    history: list[tuple[float, float]] = field(default_factory=list)
    nearest: list[PlacementSolution] = field(default_factory=list)

    @property
    def best(self) -> Optimum | None:
        """The best optimum; None where nothing was found."""
        return self.optima[0] if self.optima else None


class _Source(NamedTuple):
    """Values of the measure where a fine solve began (at the coarse points) and where it ended."""

    start: Array
    end: Array


class PlacementSearch:
    """A search for one robot and one program.

    Attributes:
        program: measure, bounds and path.

    Args:
        robot: the arm.
        program: as the attribute.
        initial: the task's guess as (n_W, p_WM, R_WE), tried on all branches; None for none.
        others: placements to start from, before any other.
    """

    def __init__(
        self,
        robot: Robot,
        program: PlacementProgram,
        initial: tuple[Array, Array, Array] | None = None,
        others: tuple[Placement, ...] = (),
    ) -> None:
        self._robot, self.program, self._initial = robot, program, initial
        self._others = others
        self._posture = program.measure
        self._stride = coarse_stride(program.num_segments)
        self._coarse = self._coarse_program(has_cost=True)

    def run(
        self,
        seed: int = 0,
        solver: str = "snopt",
        effort: SearchEffort | None = None,
        progress: Callable[[float, str], None] = lambda fraction, message: None,
    ) -> SearchResult:
        """Searches; an interrupt (KeyboardInterrupt) ends it with the best placement so far.

        Args:
            seed: seed of the random candidates.
            solver: one of `placement_program.SOLVERS`, for the fine solves; the rough ones are
                SNOPT's.
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
        """Searches; an interrupt ends it with what is found so far.

        Rough solves from many starts, in rounds, give ends; each later round starts from variations
        of the best ends so far. Those ends that keep the constraints and differ are solved with
        `solver`, and the best of these again to the last digits.
        """
        result = SearchResult()  # counts and history grow in it along the way
        clock = _Clock(result)
        # These grow solve by solve, so that an interrupt leaves what there is.
        ends: list[PlacementSolution] = []  # of the rough solves, in the order of their starts
        solutions: list[PlacementSolution] = []  # of the fine solves that keep all constraints
        sources: list[_Source] = []  # of these
        try:
            progress(0.02, "looking at random placements")
            starts = [*self._others, *self.starts(seed, effort, result)]
            progress(0.04, "looking for a placement that keeps the constraints")
            ends = self._feasibility(starts[: effort.num_feasibility])
            result.num_starts = len(ends)
            if not ends or not self._is_kept(ends[-1]):  # it ends with the first that keeps all
                result.nearest = sorted(ends, key=self._violation_of)
                return result
            starts, ends = starts[: len(self._others) + effort.num_starts], []
            self._rough_rounds(starts, ends, effort, result, clock, progress)
            result.num_starts = len(ends)
            kept = [end for end in ends if self._is_kept(end)]
            result.nearest = [] if kept else sorted(ends, key=self._violation_of)
            different_ends = self._different(kept, effort.num_solves)
            for count, end in enumerate(different_ends):
                share = count / len(different_ends)
                progress(0.7 + 0.25 * share, f"{solver}, {count + 1}/{len(different_ends)}")
                solution = self._solve(end, solver, result, clock)
                if solution is None:  # it cannot be followed between the coarse points
                    result.nearest.append(end)
                else:
                    solutions.append(solution)
                    start_values = self._posture.values(end.placement.q)
                    end_values = self._posture.values(solution.placement.q)
                    sources.append(_Source(start_values, end_values))
            progress(0.95, "the last steps")
            kinds = self._kinds(solutions)
            num_finished = len(kinds) if self.program.cell is None else _FINISHED_WITH_CELL
            solutions = [
                self._finished(solution, result, clock) for solution in kinds[:num_finished]
            ] + kinds[num_finished:]
        except KeyboardInterrupt:
            result.interrupted = True
        result.num_starts = len(ends)
        self._sort(solutions, ends, sources, result)
        fallback = None if result.optima else self._best_corrected(ends, clock)
        if fallback is not None:
            # Interrupted early, or no fine solve kept all constraints: the best rough end.
            values = self._posture.values(fallback.q)
            result.optima.append(Optimum(fallback, float(np.mean(values)), values, 0, "rough"))
        progress(1.0, "done")
        return result

    def _coarse_program(self, *, has_cost: bool) -> PlacementProgram:
        """The program at every few points of the path; what it keeps, every placement must keep."""
        program = self.program
        bounds = replace(
            program.bounds, max_joint_step=self._stride * program.bounds.max_joint_step
        )
        size = (program.path_length, program.num_segments // self._stride)
        return PlacementProgram(self._robot, program.measure, bounds, *size, program.cell, has_cost)

    def _feasibility(self, starts: list[Placement]) -> list[PlacementSolution]:
        """Ends of the coarse program without a cost, up to the first that keeps all constraints."""
        program, ends = self._coarse_program(has_cost=False), list[PlacementSolution]()
        for start in starts:
            coarse_start = replace(start, q=start.q[:: self._stride])
            ends.append(program.solve(coarse_start, options=_FEASIBILITY_OPTIONS))
            if self._is_kept(ends[-1]):
                break
        return ends

    def _rough_rounds(
        self,
        starts: list[Placement],
        ends: list[PlacementSolution],
        effort: SearchEffort,
        result: SearchResult,
        clock: "_Clock",
        progress: Callable[[float, str], None],
    ) -> None:
        """Rounds of rough solves, each after the first from variations of the best ends so far.

        They end early where no end so far keeps the constraints.

        Args:
            starts: of the first round.
            ends: grows by the end of each solve.
            result: its counts grow.
            clock: records the better ones.
        """
        for number in range(1 + effort.num_rounds):
            for count, end in enumerate(self._rough(starts, ends, result)):
                fraction = (number + count / len(starts)) / (1 + effort.num_rounds)
                message = f"round {number + 1}, start {count + 1}/{len(starts)}"
                progress(0.05 + 0.65 * fraction, message)
                self._record(end, clock)
            if not any(self._is_kept(end) for end in ends):
                break
            if number < effort.num_rounds:
                starts = self._varied(ends, effort, result)

    def _rough(
        self,
        starts: list[Placement],
        ends: list[PlacementSolution],
        result: SearchResult,
    ) -> Iterator[PlacementSolution]:
        """Solves the coarse program from each start; adds each end to `ends` and yields it."""
        for start in starts:
            coarse_start = replace(start, q=start.q[:: self._stride])
            end = self._coarse.solve(coarse_start, options=_ROUGH_OPTIONS)
            result.evaluations += end.evaluations
            ends.append(end)
            yield end

    def _violation_of(self, end: PlacementSolution) -> float:
        return self._coarse.violation(end.placement)

    def _is_kept(self, end: PlacementSolution) -> bool:
        return self._violation_of(end) < _ROUGHLY_FEASIBLE

    def _with_all_points(self, end: PlacementSolution) -> Placement | None:
        """The end of a rough solve at all points of the path; None where its branch ends there."""
        return between_points(self._robot, end.placement, self.program.path_length, self._stride)

    def _record(self, end: PlacementSolution, clock: "_Clock") -> None:
        """Records an end that keeps all constraints, put on its path to rounding."""
        if self._is_kept(end) and end.cost < 1.1 * clock.cost:
            placement = self._with_all_points(end)
            placement = None if placement is None else self.corrected(placement)
            if placement is not None:
                clock.better(self.program.cost(placement.q), placement)

    def _best_corrected(self, ends: list[PlacementSolution], clock: "_Clock") -> Placement | None:
        """The best end of the rough solves that keeps all constraints, also between points."""
        if clock.best is not None and self.corrected(clock.best) is not None:
            return clock.best
        for index in in_order([end.cost for end in ends]):
            placement = self._with_all_points(ends[index])
            placement = None if placement is None else self.corrected(placement)
            if placement is not None:
                return placement
        return None

    def starts(self, seed: int, effort: SearchEffort, result: SearchResult) -> list[Placement]:
        """The starts: the task's guess, then random paths on various branches, the best first.

        Random paths are drawn, shorter ones as well where the arm follows too few: with all points
        of the path on a part of its length, they are a guess for the solver, which stretches them.
        The best poses among them are tried on all branches. Of each bin (`_cells`) the best path
        comes first, then each one's second. Where something must not be hit (`program.cell`), the
        most promising are ranked again by what their distances lack. Most paths can be followed;
        where none can and the task has no guess, postures are returned that need not reach the
        path. What the search was given to start from (`others`) is put before these by `run`.

        Args:
            result: its counts grow.
        """
        rng = np.random.default_rng(seed)
        guesses = self.initial_guess()
        length = self.program.path_length
        # Costs are positive, and infinite where a limit is passed by far: such paths count as none.
        # `in_order` puts them last, `best_of_each` leaves them out.
        random_paths = self.draw(rng, effort.num_samples, length, result)
        for share in _STAGE_SHARES:
            if np.sum(np.isfinite(self._costs(random_paths))) >= _MIN_STARTS:
                break
            shorter = self.draw(rng, effort.num_samples, share * length, result)
            random_paths = PlacementBatch.joined([random_paths, shorter])
        costs = self._costs(random_paths)
        order = in_order(costs)
        poses = random_paths[order[: effort.num_poses]]
        branches = self._on_all_branches(poses.n_W, poses.p_WM, poses.R_WE, result)
        candidates = PlacementBatch.joined([random_paths[order], branches])
        costs = self._costs(candidates)
        result.evaluations += len(random_paths) + len(candidates)
        bins = self._cells(candidates)
        count = max(effort.num_starts, effort.num_feasibility)  # as many as either stage takes
        if self.program.cell is not None:
            tried = best_of_each(bins, costs, _TRIED_PER_START * count)  # distances take time
            candidates, bins, costs = candidates[tried], bins[tried], costs[tried]
            costs = costs * (1.0 + _DEFICIT_WEIGHT * self._deficits(candidates))
        chosen = best_of_each(bins, costs, count)
        starts = PlacementBatch.joined([guesses, candidates[chosen]])
        if len(starts) == 0:  # the solver may come to the path, and says what it misses
            starts = self._unreached(rng, effort.num_starts)
        return [starts.one(index) for index in range(len(starts))]

    def _deficits(self, batch: PlacementBatch) -> Array:
        """(N,) m, what the worst pair of shapes lacks at both ends and in the middle of a path."""
        assert self.program.cell is not None
        points = [0, self.program.num_segments // 2, self.program.num_segments]
        return np.array(
            [
                self.program.cell.deficit(replace(placement, q=placement.q[points]))
                for placement in (batch.one(index) for index in range(len(batch)))
            ]
        )

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

    def draw(
        self, rng: np.random.Generator, count: int, path_length: float, result: SearchResult
    ) -> PlacementBatch:
        """Random placements that the arm can follow, their midpoints in the box."""
        bounds, chain = self.program.bounds, self._robot.chain
        (q, n_W, p_WM, R_WE), is_moved = self._random_poses(rng, count)
        if np.any(is_moved):
            q[is_moved], is_reached = solve_poses(
                chain, R_WE[is_moved], p_WM[is_moved], q[is_moved]
            )
            q[is_moved] = wrap_within(q[is_moved], bounds.q_lower, bounds.q_upper, chain.prismatic)
            is_solved = np.ones(count, dtype=bool)
            is_solved[np.flatnonzero(is_moved)[~is_reached]] = False
            q, n_W, p_WM, R_WE = q[is_solved], n_W[is_solved], p_WM[is_solved], R_WE[is_solved]
        return self._track(q, n_W, p_WM, R_WE, result, path_length)

    def _unreached(self, rng: np.random.Generator, count: int) -> PlacementBatch:
        """Random placements with one posture each, which need not reach any point of the path."""
        (q, n_W, p_WM, R_WE), _ = self._random_poses(rng, count)
        q = np.repeat(q[:, np.newaxis], self.program.num_segments + 1, axis=1)
        return PlacementBatch(q, n_W, p_WM, R_WE)

    def _random_poses(self, rng: np.random.Generator, count: int) -> tuple[PlacementBatch, Flags]:
        """Random postures q (N, n) with a path each, and (N,) whether E is not where that is.

        The path's midpoint and the tool's rotation are E's where the bounds allow it, and are moved
        within the bounds elsewhere.
        """
        bounds, chain = self.program.bounds, self._robot.chain
        lower = np.where(np.isfinite(bounds.q_lower), bounds.q_lower, -math.pi)
        upper = np.where(np.isfinite(bounds.q_upper), bounds.q_upper, math.pi)
        q = rng.uniform(lower, upper, (count, len(lower)))
        n_W = rng.normal(size=(count, 3))
        allowed_points = rng.uniform(bounds.p_lower, bounds.p_upper, (count, 3))
        allowed_angles = rng.uniform(bounds.angle_lower, bounds.angle_upper, count)
        R_WE, p_WM = chain.pose(q)
        is_outside = np.any((p_WM < bounds.p_lower) | (p_WM > bounds.p_upper), axis=1)
        p_WM[is_outside] = allowed_points[is_outside]
        # The angle of the tool's rotation is bounded; its axis stays.
        turn = Rotation.from_matrix(R_WE).as_rotvec()
        angle = np.linalg.norm(turn, axis=1)
        is_angle_off = (angle < bounds.angle_lower) | (angle > bounds.angle_upper)
        factor = allowed_angles / np.maximum(angle, 1e-12)
        turn[is_angle_off] *= factor[is_angle_off, np.newaxis]
        R_WE[is_angle_off] = Rotation.from_rotvec(turn[is_angle_off]).as_matrix()
        is_turned = self._lean(rng, R_WE)  # into the tool's cone
        is_moved = is_outside | is_angle_off | is_turned
        n_W = bounds.allowed_directions(n_W, R_WE[:, :, 2])
        return PlacementBatch(q, n_W, p_WM, R_WE), is_moved

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
        self, ends: list[PlacementSolution], effort: SearchEffort, result: SearchResult
    ) -> list[Placement]:
        """The next round's starts, the best first.

        They are the best ends that differ, with the tool turned about the path, on all branches;
        without those that are, to the measure, like an end or an earlier start.

        Args:
            ends: of all rough solves so far.
            result: its counts grow.
        """
        kept = [end for end in ends if self._is_kept(end)]
        kinds = [end.placement for end in self._different(kept, effort.num_kinds, _OTHER_KIND)]
        angles = np.linspace(0.0, 2.0 * math.pi, effort.num_turns, endpoint=False)
        n_W = np.repeat([kind.n_W for kind in kinds], len(angles), axis=0)
        turns = Rotation.from_rotvec(np.tile(angles, len(kinds))[:, np.newaxis] * n_W)
        R_WE = turns.as_matrix() @ np.repeat([kind.R_WE for kind in kinds], len(angles), axis=0)
        p_WM = np.repeat([kind.p_WM for kind in kinds], len(angles), axis=0)
        varied = self._on_all_branches(n_W, p_WM, R_WE, result)
        result.evaluations += len(varied)
        costs = self._costs(varied)
        varied, costs = varied[np.isfinite(costs)], costs[np.isfinite(costs)]
        # Compared at the coarse points, at which the ends are solved.
        profiles = self._posture.values(varied.q)[:, :: self._stride]
        known = [self._posture.values(end.placement.q) for end in kept]
        starts: list[Placement] = []
        for index in in_order(costs):
            if len(starts) == effort.num_starts:
                break
            if (
                not known
                or profile_gaps(profiles[index], np.array(known)).min() > OPTIMUM_TOLERANCE
            ):
                known.append(profiles[index])
                starts.append(varied.one(int(index)))
        return starts

    def _different(
        self, ends: list[PlacementSolution], count: int, gap: float = _ROUGH_END_TOLERANCE
    ) -> list[PlacementSolution]:
        """The best ends, one of each kind; kinds differ in their profiles by `gap`."""
        profiles = [self._posture.values(end.placement.q) for end in ends]
        chosen: list[int] = []
        for index in in_order([end.cost for end in ends]):
            if len(chosen) == count:
                break
            known = np.array([profiles[other] for other in chosen])
            if not chosen or profile_gaps(profiles[index], known).min() > gap:
                chosen.append(int(index))
        return [ends[index] for index in chosen]

    def _solve(
        self, end: PlacementSolution, solver: str, result: SearchResult, clock: "_Clock"
    ) -> PlacementSolution | None:
        """Solves the program from the end of a rough solve; None if it breaks a constraint."""
        start = self._with_all_points(end)
        if start is None:  # the solver may find a way from one branch to the other
            start = replace(end.placement, q=interpolated(end.placement.q, self._stride))
        solution = self.program.solve(start, solver)
        result.evaluations += solution.evaluations
        placement = self.corrected(solution.placement)
        if placement is None:  # at the optimum within the solver's rounding, or not at all
            solution = self.program.solve(solution.placement, solver, _LOOSE_OPTIONS[solver])
            result.evaluations += solution.evaluations
            placement = self.corrected(solution.placement)
        if placement is None:
            return None
        cost = self.program.cost(placement.q)
        clock.better(cost, placement)
        return replace(solution, placement=placement, cost=cost)

    def _finished(
        self, solution: PlacementSolution, result: SearchResult, clock: "_Clock"
    ) -> PlacementSolution:
        refined_solution = finished(self._robot, self.program, solution, self.corrected)
        result.evaluations += refined_solution.evaluations - solution.evaluations
        clock.better(refined_solution.cost, refined_solution.placement)
        return refined_solution

    def corrected(self, placement: Placement) -> Placement | None:
        """The placement with its postures exactly on the path; None if it breaks a constraint.

        Joint limits, continuity and clearance are checked between the points too.
        """
        program = self.program
        exact = placement_on_path(self._robot, placement, program.path_length)
        if exact is None or np.max(np.abs(exact.q - placement.q)) > 1e-3:
            return None
        if program.violation(exact) > CONSTRAINT_TOLERANCE:
            return None
        fine = between_points(self._robot, exact, program.path_length)
        if fine is None or program.violation_between(fine) > BETWEEN_TOLERANCE:
            return None
        return exact

    def _kinds(self, solutions: list[PlacementSolution]) -> list[PlacementSolution]:
        """Solutions that differ in their profiles, best first."""
        kinds: list[PlacementSolution] = []
        profiles: list[Array] = []
        for index in in_order([solution.cost for solution in solutions]):
            values = self._posture.values(solutions[index].placement.q)
            if all(
                float(profile_gaps(values, profile)) > OPTIMUM_TOLERANCE for profile in profiles
            ):
                kinds.append(solutions[index])
                profiles.append(values)
        return kinds

    def _sort(
        self,
        solutions: list[PlacementSolution],
        ends: list[PlacementSolution],
        sources: list[_Source],
        result: SearchResult,
    ) -> None:
        """Writes the distinct optima, best first, with the number of starts that ended at each.

        Args:
            solutions: of the fine solves.
            ends: of the rough ones, each of one start; where only some ends were solved further, an
                end counts with the optimum that a fine solve from a like end came to.
            sources: where the fine solves began and ended.
            result: gets the optima and the number of ends that belong to none.
        """
        kinds = self._kinds(solutions)
        profiles = [self._posture.values(solution.placement.q) for solution in kinds]
        num_starts = np.zeros(len(kinds), dtype=int)
        for end in ends:
            kind = self._kind_of(end, sources, profiles)
            if kind is None:
                result.num_unassigned += 1
            else:
                num_starts[kind] += 1
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

    def _kind_of(
        self, end: PlacementSolution, sources: list[_Source], profiles: list[Array]
    ) -> int | None:
        """The optimum that a fine solve came to from an end like this one; None for none."""
        if not self._is_kept(end):
            return None
        values = self._posture.values(end.placement.q)
        for source in sources:
            if profile_gaps(values, source.start) < 2.0 * _ROUGH_END_TOLERANCE:
                gaps = [float(profile_gaps(source.end, profile)) for profile in profiles]
                if gaps and min(gaps) < OPTIMUM_TOLERANCE:
                    return int(np.argmin(gaps))
        return None


class _Clock:
    """Records the best placement so far, and when each better one was found."""

    def __init__(self, result: SearchResult) -> None:
        self._began = time.perf_counter()
        self._result = result
        self.cost = math.inf
        self.best: Placement | None = None

    def better(self, cost: float, placement: Placement) -> None:
        """Records a placement, if it is better than the best so far."""
        if cost < self.cost:
            self.cost, self.best = cost, placement
            self._result.history.append((time.perf_counter() - self._began, cost))


def coarse_stride(num_segments: int) -> int:
    """The largest stride of at most 4 that divides the number of segments."""
    return next(stride for stride in (4, 3, 2, 1) if num_segments % stride == 0)


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
