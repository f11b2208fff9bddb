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
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from wrenchsight.analyses.methods.place.placement_refinement import (
    CONSTRAINT_TOLERANCE,
    finished,
)
from wrenchsight.analyses.output.progress import ProgressCallback
from wrenchsight.diagrams.placement.placement_program import PlacementProgram, PlacementSolution
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.numerics.kernel import one_thread
from wrenchsight.models.numerics.ties import in_order
from wrenchsight.models.planning.motion.path_postures import solve_poses, track_paths, wrap_within
from wrenchsight.models.planning.motion.paths import StraightPath
from wrenchsight.models.planning.placement.placements import (
    Placement,
    PlacementBatch,
    PlacementBounds,
    between_points,
    interpolated,
    on_all_branches,
    placement_on_path,
)

T = TypeVar("T")

# rad and m, of joint limits between the points; clearance there is kept in full
BETWEEN_TOLERANCE = 1e-3
# Gaps of two profiles, see `profile_gaps`: up to these they are one optimum, one rough end (which
# has not come to its optimum), one end that is worth varying.
OPTIMUM_TOLERANCE = 0.01
_ROUGH_END_TOLERANCE = 0.02
_VARIED_END_TOLERANCE = 0.06
# Gap up to which an end belongs to the optimum that a fine solve from another end came to: an end
# that was left out lies within one tolerance of the one that was solved.
_LIKE_START_TOLERANCE = 2.0 * _ROUGH_END_TOLERANCE
_MIN_STARTS = 30  # random placements; with fewer a part of the path's length will do
_LENGTH_SHARES = (0.6, 0.2, 0.02)  # of the path's length, tried in turn until there are enough
_TRIED_PER_START = 4  # candidates whose distances are looked at
_DEFICIT_WEIGHT = 10.0  # of the cost by m; a posture through the floor is worth little
_EXCESS_WEIGHT = 2.0  # of the cost by rad (m) beyond a limit: a little is left to the solver
_FAR_EXCESS = 0.5  # rad (m) beyond a limit, from which a path is no start
_NUM_FINISHED_WITH_CELL = 2  # optima; with distances the last steps take seconds
ROUGH_TOLERANCE = 1e-4  # m and rad, of every constraint at the end of a rough solve
_MIN_ANGLE = 1e-12  # rad, that is divided by: a rotation by 0, which has no axis, stays one
# Of a rough end's cost over the best so far, up to which it is put on its path: the mean over all
# points may be lower than that over the coarse ones.
_PROMISING_COST = 1.1
# rad or m, by which exact inverse kinematics may move a solver's posture: farther away is another
# branch, or the solver did not come to the path.
_MAX_CORRECTION = 1e-3
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
FEASIBILITY_OPTIONS = {  # of a solve without a cost
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
        num_starts: rough solves, each from another start; where no start could keep all
            constraints, the solves that found that out.
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


class _FineSolve(NamedTuple):
    """A solve of the program of all points.

    Attributes:
        end: of the rough solve, from which it began.
        solution: None where it breaks a constraint.
    """

    end: PlacementSolution
    solution: PlacementSolution | None


class _RandomPoses(NamedTuple):
    """N random postures with a path each.

    Attributes:
        q: (N, n) rad (m).
        n_W, p_WM, R_WE: (N, 3), (N, 3) m and (N, 3, 3), of the paths, see `Placement`.
        is_moved: (N,) whether the bounds moved the path away from where E is at q.
    """

    q: Array
    n_W: Array
    p_WM: Array
    R_WE: Array
    is_moved: Flags


class PlacementSearch:
    """A search for one program.

    Attributes:
        program: robot, measure, bounds and path.

    Args:
        program: as the attribute.
        initial: the task's guess, tried on all branches; None for none.
        others: placements to start from, before any other.
    """

    def __init__(
        self,
        program: PlacementProgram,
        initial: StraightPath | None = None,
        others: tuple[Placement, ...] = (),
    ) -> None:
        self._robot, self.program, self._initial = program.robot, program, initial
        self._others = others
        self._measure = program.measure
        self._stride = coarse_stride(program.num_segments)
        self._coarse = coarse_program(program, has_cost=True)

    def run(
        self,
        seed: int = 0,
        solver: str = "snopt",
        effort: SearchEffort | None = None,
        progress: ProgressCallback = lambda fraction, message: None,
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
        progress: ProgressCallback,
    ) -> SearchResult:
        """Searches; an interrupt ends it with what is found so far.

        Rough solves from many starts give ends. Those that keep the constraints and differ are
        solved with `solver`, and the best of these solutions again to the last digits.
        """
        result = SearchResult()  # its counts and history grow along the way
        clock = _Clock(result)
        # Each stage yields solve by solve, so that an interrupt leaves what there is.
        feasibility_ends: list[PlacementSolution] = []
        ends: list[PlacementSolution] = []  # of the rough solves, in the order of their starts
        fine_solves: list[_FineSolve] = []
        kinds: list[PlacementSolution] = []  # of the fine solves, best first
        finished_solutions: list[PlacementSolution] = []  # of the first kinds
        try:
            progress(0.02, "looking at random placements")
            # The best first: both stages that begin from them take those at the front.
            starts = [*self._others, *self.starts(seed, effort, result)]
            progress(0.04, "looking for a placement that keeps the constraints")
            _collect(self._feasibility(starts[: effort.num_feasibility]), feasibility_ends)
            if not any(self._is_kept(end) for end in feasibility_ends):
                result.num_starts = len(feasibility_ends)
                result.nearest = sorted(feasibility_ends, key=self._violation_of)
                return result
            first_starts = starts[: len(self._others) + effort.num_starts]
            _collect(self._rough_ends(first_starts, effort, result, clock, progress), ends)
            _collect(self._fine_solves(ends, solver, effort, result, clock, progress), fine_solves)
            progress(0.95, "the last steps")
            kinds = self._kinds(_solutions(fine_solves))
            _collect(self._finished(kinds, result, clock), finished_solutions)
        except KeyboardInterrupt:
            result.interrupted = True
        # From here on nothing is solved; what an interrupt has left is put in order.
        result.num_starts = len(ends)
        result.nearest = self._nearest(ends, fine_solves)
        if not kinds:  # interrupted before
            kinds = self._kinds(_solutions(fine_solves))
        # Those that were taken to the last digits stand for themselves.
        unfinished = kinds[len(finished_solutions) :]
        result.optima = self._optima([*finished_solutions, *unfinished])
        self._count_starts(ends, fine_solves, result)  # of these optima
        if not result.optima:
            # Interrupted early, or no fine solve kept all constraints: the best rough end. The
            # search for any placement ended with the first that keeps them.
            rough = self._rough_optimum([*ends, *feasibility_ends[-1:]], clock)
            result.optima = [] if rough is None else [rough]
        progress(1.0, "done")
        return result

    def _at_coarse_points(self, start: Placement) -> Placement:
        return replace(start, q=start.q[:: self._stride])

    def _feasibility(self, starts: list[Placement]) -> Iterator[PlacementSolution]:
        """Ends of the coarse program without a cost, up to the first that keeps all constraints."""
        program = coarse_program(self.program, has_cost=False)
        for start in starts:
            end = program.solve(self._at_coarse_points(start), options=FEASIBILITY_OPTIONS)
            yield end
            if self._is_kept(end):
                break

    def _rough_ends(
        self,
        starts: list[Placement],
        effort: SearchEffort,
        result: SearchResult,
        clock: "_Clock",
        progress: ProgressCallback,
    ) -> Iterator[PlacementSolution]:
        """Ends of rough solves, in rounds; each later one varies the best ends of all so far.

        The rounds end early where no end so far keeps the constraints.

        Args:
            starts: of the first round.
            result: its counts grow.
            clock: records the better ones.
        """
        ends: list[PlacementSolution] = []
        for number in range(1 + effort.num_rounds):
            for count, start in enumerate(starts):
                end = self._coarse.solve(self._at_coarse_points(start), options=_ROUGH_OPTIONS)
                result.evaluations += end.evaluations
                ends.append(end)
                yield end  # first of all: whoever takes it has it when an interrupt comes
                fraction = (number + count / len(starts)) / (1 + effort.num_rounds)
                message = f"round {number + 1}, start {count + 1}/{len(starts)}"
                progress(0.05 + 0.65 * fraction, message)
                self._record(end, clock)
            if not any(self._is_kept(end) for end in ends):
                break
            if number < effort.num_rounds:
                starts = self._varied(ends, effort, result)

    def _fine_solves(
        self,
        ends: list[PlacementSolution],
        solver: str,
        effort: SearchEffort,
        result: SearchResult,
        clock: "_Clock",
        progress: ProgressCallback,
    ) -> Iterator[_FineSolve]:
        """Solves the program of all points from the best ends that keep the constraints and differ.

        Args:
            ends: of all rough solves.
            result: its counts grow.
            clock: records the better ones.
        """
        kept = [end for end in ends if self._is_kept(end)]
        different_ends = self._different(kept, effort.num_solves)
        for count, end in enumerate(different_ends):
            share = count / len(different_ends)
            progress(0.7 + 0.25 * share, f"{solver}, {count + 1}/{len(different_ends)}")
            yield _FineSolve(end, self._solve(end, solver, result, clock))

    def _nearest(
        self, ends: list[PlacementSolution], fine_solves: list[_FineSolve]
    ) -> list[PlacementSolution]:
        """Ends that came nearest to a placement: see `SearchResult.nearest`."""
        if any(self._is_kept(end) for end in ends):
            return [end for end, solution in fine_solves if solution is None]
        return sorted(ends, key=self._violation_of)

    def _violation_of(self, end: PlacementSolution) -> float:
        return self._coarse.violation(end.placement)

    def _is_kept(self, end: PlacementSolution) -> bool:
        return self._violation_of(end) < ROUGH_TOLERANCE

    def _with_all_points(self, end: PlacementSolution) -> Placement | None:
        """The end of a rough solve at all points of the path; None where its branch ends there."""
        return between_points(self._robot, end.placement, self.program.path_length, self._stride)

    def _record(self, end: PlacementSolution, clock: "_Clock") -> None:
        """Records an end that keeps all constraints, put on its path to rounding."""
        if self._is_kept(end) and end.cost < _PROMISING_COST * clock.cost:
            placement = self._with_all_points(end)
            placement = None if placement is None else self.corrected(placement)
            if placement is not None:
                clock.better(self.program.cost(placement.q), placement)

    def _rough_optimum(self, ends: list[PlacementSolution], clock: "_Clock") -> Optimum | None:
        """The best end of coarse solves, put on its path; no fine solve ended at it.

        None where none keeps all constraints, also between the points.
        """
        placement = self._best_corrected(ends, clock)
        if placement is None:
            return None
        values = self._measure.values(placement.q)
        return Optimum(
            placement=placement,
            cost=float(np.mean(values)),
            values=values,
            starts=0,
            status="rough",
        )

    def _best_corrected(self, ends: list[PlacementSolution], clock: "_Clock") -> Placement | None:
        """The best end of coarse solves that keeps all constraints, also between points."""
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

        The best poses among random paths are tried on all branches. Of each bin (`_bins`) the best
        path comes first, then each one's second. Where something must not be hit (`program.cell`),
        the most promising are ranked again by what their distances lack. Most paths can be
        followed; where none can and the task has no guess, postures are returned that need not
        reach the path. What the search was given to start from (`others`) is put before these by
        `run`.

        Args:
            result: `evaluations`, `num_candidates` and `num_reached` grow.

        Returns:
            The guess on each of its branches, whatever it costs, and as many more as the larger of
            the two stages takes that begin from them (feasibility, rough solves).
        """
        rng = np.random.default_rng(seed)
        guesses = self.initial_guess()
        candidates, costs = self._random_candidates(rng, effort, result)
        bins = self._bins(candidates)
        count = max(effort.num_starts, effort.num_feasibility)
        if self.program.cell is not None:
            # Distances take time: only of the most promising.
            tried = best_of_each(bins, costs, _TRIED_PER_START * count)
            candidates, bins, costs = candidates[tried], bins[tried], costs[tried]
            costs = costs * (1.0 + _DEFICIT_WEIGHT * self._deficits(candidates))
        chosen = best_of_each(bins, costs, count)
        starts = PlacementBatch.joined([guesses, candidates[chosen]])
        if len(starts) == 0:  # the solver may come to the path, and says what it misses
            starts = self._unreached(rng, effort.num_starts)
        return [starts.one(index) for index in range(len(starts))]

    def _random_candidates(
        self, rng: np.random.Generator, effort: SearchEffort, result: SearchResult
    ) -> tuple[PlacementBatch, Array]:
        """Random paths, the best first, then poses of the best on all branches; and their costs.

        Costs are infinite where a limit is passed by far: `in_order` puts such paths last,
        `best_of_each` leaves them out.

        Args:
            result: as `starts`.
        """
        random_paths = self._random_paths(rng, effort, result)
        order = in_order(self._costs(random_paths))
        poses = random_paths[order[: effort.num_poses]]
        branches = self._on_all_branches(poses.n_W, poses.p_WM, poses.R_WE, result)
        candidates = PlacementBatch.joined([random_paths[order], branches])
        costs = self._costs(candidates)
        result.evaluations += len(random_paths) + len(candidates)
        return candidates, costs

    def _random_paths(
        self, rng: np.random.Generator, effort: SearchEffort, result: SearchResult
    ) -> PlacementBatch:
        """Random paths that the arm can follow, also shorter ones where it follows too few.

        A shorter one has all points of the path, on a part of its length: a guess that the solver
        stretches.
        """
        paths = self.draw(rng, effort.num_samples, self.program.path_length, result)
        for share in _LENGTH_SHARES:
            if np.sum(np.isfinite(self._costs(paths))) >= _MIN_STARTS:
                break
            length = share * self.program.path_length
            shorter = self.draw(rng, effort.num_samples, length, result)
            paths = PlacementBatch.joined([paths, shorter])
        return paths

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

    def _bins(self, batch: PlacementBatch) -> NDArray[np.intp]:
        """(N,) the bin of each placement: bit j says in which half of its range joint j is.

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
        path = self._initial
        return self._on_all_branches(
            path.n_W[np.newaxis], path.p_WM[np.newaxis], path.R_WE[np.newaxis], SearchResult()
        )

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
        paths = on_all_branches(
            self._robot,
            n_W,
            p_WM,
            R_WE,
            program.path_length,
            program.num_segments,
            program.bounds.max_joint_step,
        )
        return self._counted(paths.placements, paths.is_reached, result)

    def _track(
        self,
        q_mid: Array,
        n_W: Array,
        p_WM: Array,
        R_WE: Array,
        result: SearchResult,
        path_length: float,
    ) -> PlacementBatch:
        """The paths that can be followed from their postures at the midpoint, counted.

        Those of a part of the path's length are not counted: they are no candidates, but guesses
        that the solver stretches.

        Args:
            q_mid: (N, n) rad (m).
            n_W, p_WM, R_WE: (N, ...) of the paths, see `Placement`.
            result: its counts grow.
            path_length: m, the program's or a part of it.
        """
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
        """The paths that can be followed; all are counted in the result."""
        result.num_candidates += len(is_reached)
        result.num_reached += int(np.sum(is_reached))
        return paths[is_reached]

    def draw(
        self, rng: np.random.Generator, count: int, path_length: float, result: SearchResult
    ) -> PlacementBatch:
        """Random placements that the arm can follow, their midpoints in the box.

        Args:
            count: postures that are drawn; fewer paths come back.
            path_length: m, the path's or a part of it.
            result: its counts grow.
        """
        bounds, chain = self.program.bounds, self._robot.chain
        q, n_W, p_WM, R_WE, is_moved = self._random_poses(rng, count)
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
        poses = self._random_poses(rng, count)
        q = np.repeat(poses.q[:, np.newaxis], self.program.num_segments + 1, axis=1)
        return PlacementBatch(q, poses.n_W, poses.p_WM, poses.R_WE)

    def _random_poses(self, rng: np.random.Generator, count: int) -> _RandomPoses:
        """Random postures over the joint limits, each with a path through where E is.

        The path's midpoint and the tool's rotation are E's where the bounds allow it, and are moved
        within the bounds elsewhere. A joint without limits is drawn over one turn.
        """
        bounds, chain = self.program.bounds, self._robot.chain
        # Each draw is for all rows, used or not: which rows the bounds move changes no number of
        # the others.
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
        factor = allowed_angles / np.maximum(angle, _MIN_ANGLE)
        turn[is_angle_off] *= factor[is_angle_off, np.newaxis]
        R_WE[is_angle_off] = Rotation.from_rotvec(turn[is_angle_off]).as_matrix()
        is_turned = self._lean(rng, R_WE)  # into the tool's cone, in place
        is_moved = is_outside | is_angle_off | is_turned
        n_W = bounds.allowed_directions(n_W, R_WE[:, :, 2])
        return _RandomPoses(q, n_W, p_WM, R_WE, is_moved)

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
        """(N,) the mean measure, raised where a limit is passed, infinite where it is by far.

        Limits are those of the joints and the tool's cone; other bounds are left to the solver.
        """
        if len(batch) == 0:
            return np.empty(0)
        bounds = self.program.bounds
        mean = np.mean(self._measure.values(batch.q), axis=1)
        excess = np.maximum(bounds.q_lower - batch.q, batch.q - bounds.q_upper)
        excess = np.maximum(np.max(excess, axis=(1, 2)), 0.0)
        if bounds.tool_direction is not None:
            cosine = np.clip(batch.R_WE[:, :, 2] @ bounds.tool_direction, -1.0, 1.0)
            excess = np.maximum(excess, np.arccos(cosine) - bounds.tool_tilt)
        raised = mean * (1.0 + _EXCESS_WEIGHT * excess)
        return np.asarray(np.where(excess < _FAR_EXCESS, raised, np.inf))

    def _varied(
        self, ends: list[PlacementSolution], effort: SearchEffort, result: SearchResult
    ) -> list[Placement]:
        """The next round's starts, the best first, at most `num_starts`.

        They are the best ends that differ, with the tool turned about the path, on all branches;
        without those that are, to the measure, like an end or an earlier start.

        Args:
            ends: of all rough solves so far, of which one or more keep the constraints.
            result: its counts grow.
        """
        kept = [end for end in ends if self._is_kept(end)]
        different_ends = self._different(kept, effort.num_kinds, _VARIED_END_TOLERANCE)
        kinds = [end.placement for end in different_ends]
        angles = np.linspace(0.0, 2.0 * math.pi, effort.num_turns, endpoint=False)
        # A row for each end and angle, those of one end together; R_WE turned about the row's n_W.
        n_W = np.repeat([kind.n_W for kind in kinds], len(angles), axis=0)
        turns = Rotation.from_rotvec(np.tile(angles, len(kinds))[:, np.newaxis] * n_W)
        R_WE = turns.as_matrix() @ np.repeat([kind.R_WE for kind in kinds], len(angles), axis=0)
        p_WM = np.repeat([kind.p_WM for kind in kinds], len(angles), axis=0)
        varied = self._on_all_branches(n_W, p_WM, R_WE, result)
        result.evaluations += len(varied)
        costs = self._costs(varied)
        varied, costs = varied[np.isfinite(costs)], costs[np.isfinite(costs)]
        # Compared at the coarse points, at which the ends are solved: every stride-th.
        profiles = self._measure.values(varied.q)[:, :: self._stride]
        known = [self._measure.values(end.placement.q) for end in kept]
        starts: list[Placement] = []
        for index in in_order(costs):
            if len(starts) == effort.num_starts:
                break
            if profile_gaps(profiles[index], np.array(known)).min() > OPTIMUM_TOLERANCE:
                known.append(profiles[index])
                starts.append(varied.one(int(index)))
        return starts

    def _different(
        self, ends: list[PlacementSolution], count: int, gap: float = _ROUGH_END_TOLERANCE
    ) -> list[PlacementSolution]:
        """The best ends, one of each kind, up to `count`.

        Kinds differ in their profiles by more than `gap`, see `profile_gaps`.
        """
        profiles = [self._measure.values(end.placement.q) for end in ends]
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
        self, kinds: list[PlacementSolution], result: SearchResult, clock: "_Clock"
    ) -> Iterator[PlacementSolution]:
        """The exact optima, as standard members of their families; of the best few, with a cell.

        Args:
            kinds: solutions that differ, best first.
            result: its counts grow.
            clock: records the better ones.
        """
        count = len(kinds) if self.program.cell is None else _NUM_FINISHED_WITH_CELL
        for solution in kinds[:count]:
            exact = finished(self.program, solution, self.corrected)
            result.evaluations += exact.evaluations - solution.evaluations
            clock.better(exact.cost, exact.placement)
            yield exact

    def corrected(self, placement: Placement) -> Placement | None:
        """The placement with its postures exactly on the path; None if it breaks a constraint.

        Joint limits, continuity and clearance are checked between the points too.
        """
        program = self.program
        exact = placement_on_path(self._robot, placement, program.path_length)
        if exact is None or np.max(np.abs(exact.q - placement.q)) > _MAX_CORRECTION:
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
            values = self._measure.values(solutions[index].placement.q)
            if all(
                float(profile_gaps(values, profile)) > OPTIMUM_TOLERANCE for profile in profiles
            ):
                kinds.append(solutions[index])
                profiles.append(values)
        return kinds

    def _optima(self, solutions: list[PlacementSolution]) -> list[Optimum]:
        """The distinct optima among solutions, best first; no start is counted yet."""
        return [
            Optimum(
                placement=solution.placement,
                cost=solution.cost,
                values=self._measure.values(solution.placement.q),
                starts=0,
                status=solution.status,
            )
            for solution in self._kinds(solutions)
        ]

    def _count_starts(
        self, ends: list[PlacementSolution], fine_solves: list[_FineSolve], result: SearchResult
    ) -> None:
        """Counts the starts of each optimum of the result, and those that belong to none.

        Only some ends were solved further: an end counts with the optimum that a fine solve from a
        like end came to.

        Args:
            ends: of the rough solves, each of one start.
            fine_solves: of the ends that differ.
        """
        profiles = [optimum.values for optimum in result.optima]
        # Values where a fine solve began (at the coarse points), and the index of the optimum that
        # it came to.
        came_to: list[tuple[Array, int]] = []
        for end, solution in fine_solves:
            if solution is not None:
                values = self._measure.values(solution.placement.q)
                gaps = [float(profile_gaps(values, profile)) for profile in profiles]
                if min(gaps) < OPTIMUM_TOLERANCE:
                    begin_values = self._measure.values(end.placement.q)
                    came_to.append((begin_values, int(np.argmin(gaps))))
        num_starts = np.zeros(len(profiles), dtype=int)
        for end in ends:
            optimum = self._optimum_of(end, came_to)
            if optimum is None:
                result.num_unassigned += 1
            else:
                num_starts[optimum] += 1
        result.optima = [
            replace(optimum, starts=int(count))
            for optimum, count in zip(result.optima, num_starts, strict=True)
        ]

    def _optimum_of(self, end: PlacementSolution, came_to: list[tuple[Array, int]]) -> int | None:
        """Index of the optimum that a fine solve came to from an end like this one.

        None where there was no such solve, or the end breaks a constraint.

        Args:
            came_to: of each fine solve the values where it began, and the index of its optimum.
        """
        if not self._is_kept(end):
            return None
        values = self._measure.values(end.placement.q)
        for begin_values, optimum in came_to:
            if profile_gaps(values, begin_values) < _LIKE_START_TOLERANCE:
                return optimum
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


def _collect(items: Iterator[T], held: list[T]) -> None:
    """Adds each item to a list as soon as it comes: an interrupt leaves those before it."""
    for item in items:
        held.append(item)  # noqa: PERF402 - `extend` promises nothing of an interrupt


def _solutions(fine_solves: list[_FineSolve]) -> list[PlacementSolution]:
    """The solutions that keep all constraints."""
    return [solution for _, solution in fine_solves if solution is not None]


def coarse_stride(num_segments: int) -> int:
    """The largest stride of at most 4 that divides the number of segments."""
    return next(stride for stride in (4, 3, 2, 1) if num_segments % stride == 0)


def coarse_bounds(program: PlacementProgram, bounds: PlacementBounds) -> PlacementBounds:
    """Bounds for every few points of a program's path, whose joint steps are longer."""
    stride = coarse_stride(program.num_segments)
    return replace(bounds, max_joint_step=stride * bounds.max_joint_step)


def coarse_program(
    program: PlacementProgram,
    *,
    has_cost: bool,
    bounds: PlacementBounds | None = None,
    path_length: float | None = None,
    with_cell: bool = True,
) -> PlacementProgram:
    """A program at every few points of the path; what it keeps, every placement must keep.

    Args:
        has_cost: as `PlacementProgram`.
        bounds: of all points, in the place of the program's.
        path_length: m, in the place of the program's.
        with_cell: whether the program's distances are kept.
    """
    return PlacementProgram(
        program.robot,
        program.measure,
        coarse_bounds(program, program.bounds if bounds is None else bounds),
        program.path_length if path_length is None else path_length,
        program.num_segments // coarse_stride(program.num_segments),
        program.cell if with_cell else None,
        has_cost,
    )


def best_of_each(bins: NDArray[np.intp], costs: Array, count: int) -> NDArray[np.intp]:
    """Indices of up to `count` finite costs: the best of each bin, then each one's second..."""
    order = in_order(costs)
    order = order[np.isfinite(costs[order])]
    # Of each cost its rank within its bin.
    rank = np.empty(len(order), dtype=int)
    counts: dict[int, int] = {}
    for position, index in enumerate(order):
        bin_ = int(bins[index])
        rank[position] = counts.get(bin_, 0)
        counts[bin_] = rank[position] + 1
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
