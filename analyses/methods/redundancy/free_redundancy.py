"""Collisions of the arm along a path, and the best way without any.

All links, the tool and the surroundings count; the tool alone may touch the workpiece. At both ends
of the path E also comes and goes along the normal, `approach` far.

The search uses the grid of `models.planning.motion.redundancy`. A coarse part of its postures is
checked, and those around a collision are left out. Each posture of the best way through the others
is checked again, until a way is free from end to end. That way is refined; where the refined way is
not free any more, the way of the grid stays.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from wrenchsight.analyses.methods.redundancy.redundancy_task import (
    RedundancyClearance,
    RedundancyTask,
)
from wrenchsight.diagrams.distances.clearance import Clearance, ClosestPair
from wrenchsight.diagrams.distances.moved_along import moved_along
from wrenchsight.diagrams.scenario import BladeConfig, PlateConfig
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.planning.motion.redundancy import (
    Candidates,
    RedundancyProblem,
    Trajectory,
    best_on_grid,
    refine,
)
from wrenchsight.models.robot.robot import Robot

_SAMPLES_APART, _ANGLES_APART = 4, 2  # of the coarse part
_NEAR_POSTURE = 0.3  # rad (m) of each joint, within which postures around a collision are left out
_SAME_DISTANCE = 1e-12  # rad (m), of postures as near to the way: rounding must not choose
_MOST_ROUNDS = 60
_REPORTED_DISTANCE = 0.02  # m beyond the distance to keep, within which a pair is reported
_PLATE_THICKNESS = 0.02  # m


@dataclass(frozen=True, eq=False)
class Surroundings:
    """The surroundings that a way along a path must not hit.

    Attributes:
        robot: the arm.
        clearance: distances in the cell.
        approach: m, along the normal at both ends.
    """

    robot: Robot
    clearance: Clearance
    approach: float

    def worst(self, q: Array) -> ClosestPair | None:
        """The pair with the least slack over q (N, n); None where nothing is near."""
        result: ClosestPair | None = None
        for row in q:
            for pair in self.clearance.slacks(row, self.clearance.margin + _REPORTED_DISTANCE):
                if result is None or pair.slack < result.slack:
                    result = pair
        return result

    def free(self, q: Array) -> bool:
        """Whether all distances at q (n,) are as large as they must be."""
        return self.clearance.is_free(q)

    def with_ends(self, problem: RedundancyProblem, q: Array) -> Array:
        """q (N, n) with the postures in which E comes and goes along the normal.

        Raises:
            InputError: the arm cannot come or go that far.
        """
        if self.approach == 0.0:
            return q
        approach, retreat = (
            moved_along(self.robot, q[k], problem.path.n_W[k], self.approach)[1:] for k in (0, -1)
        )
        rows = np.vstack([approach, retreat])
        if (rows < problem.lower).any() or (rows > problem.upper).any():
            raise InputError("approach", "", f"cannot go {self.approach:g} m off the surface")
        return np.vstack([approach[::-1], q, retreat])


def surroundings(robot: Robot, task: RedundancyTask, config: RedundancyClearance) -> Surroundings:
    """The surroundings of a task; the body of a CSV's workpiece is unknown."""
    piece: PlateConfig | BladeConfig | None = None
    if task.surface is not None and task.surface.plate is not None:
        plate = task.surface.plate
        piece = PlateConfig(task.workpiece, [plate.length, plate.width, _PLATE_THICKNESS])
    elif task.surface is not None and task.surface.blade is not None:
        piece = BladeConfig(pose=task.workpiece, **vars(task.surface.blade))
    floor = robot.floor if config.floor is None else config.floor
    clearance = Clearance(robot, config.distance, floor, piece)
    return Surroundings(robot, clearance, config.approach)


class WayCheck(NamedTuple):
    """Whether a way is free, and its pair of shapes with the least slack (None: nothing near)."""

    is_free: bool
    worst: ClosestPair | None


def clear_of_all(cell: Surroundings, problem: RedundancyProblem, way: Trajectory) -> WayCheck:
    """Checks a way for collisions, approach and lift included."""
    try:
        q = cell.with_ends(problem, way.q)
    except InputError:
        return WayCheck(False, cell.worst(way.q))
    worst = cell.worst(q)
    return WayCheck(worst is None or worst.slack >= 0.0, worst)


def best_free(
    cell: Surroundings,
    problem: RedundancyProblem,
    grid: Candidates,
    progress: Callable[[float], None] = lambda fraction: None,
) -> Trajectory | None:
    """The best way that is free from end to end; None where the search finds none.

    Postures that collide are left out of the grid, first those at every few samples and angles,
    then what the best way through the rest meets, up to _MOST_ROUNDS rounds.

    Args:
        cell: of what must not be hit; states how far E comes and goes along the normal.
        problem: path and limits.
        grid: postures on the path, q (N, K, B, n): samples, angles, branches, joints; NaN where
            there is none. It is not changed.
        progress: called with the share done.
    """
    q = _coarsely_free(cell, grid, lambda fraction: progress(0.6 * fraction))
    # The best way through what is left is looked at sample by sample; what collides becomes NaN in
    # q, until nothing does.
    for number in range(_MOST_ROUNDS):
        if not np.isfinite(q[..., 0]).any(axis=(1, 2)).all():  # a sample without postures
            return None
        try:
            way = best_on_grid(problem, Candidates(grid.psi, q))
        except InputError:  # no way leads through the postures left
            return None
        colliding = _colliding_samples(cell, problem, way)
        if not colliding:
            refined = refine(problem, way.q)
            return refined if clear_of_all(cell, problem, refined).is_free else way
        # Of a sample that collides the posture nearest to the way is left out, with its equals.
        for i in colliding:
            distance = np.abs(q[i] - way.q[i]).max(axis=-1)  # (K, B) from the way's posture
            nearest = np.nanmin(distance, initial=np.inf)
            q[i][distance <= nearest + _SAME_DISTANCE] = np.nan
        progress(0.6 + 0.4 * (number + 1) / _MOST_ROUNDS)
    return None


def _coarsely_free(
    cell: Surroundings, grid: Candidates, progress: Callable[[float], None]
) -> Array:
    """q (N, K, B, n) of the grid, NaN where a posture collides or is near one that does.

    Only postures at every few samples and angles are checked.
    """
    q = grid.q.copy()
    N, K = q.shape[:2]
    samples = np.unique(np.r_[np.arange(0, N, _SAMPLES_APART), N - 1])
    for count, i in enumerate(samples):
        for k in range(0, K, _ANGLES_APART):
            for b in np.flatnonzero(np.isfinite(q[i, k, :, 0])):
                # An earlier posture that collides may have left this one out, too.
                if not np.isfinite(q[i, k, b, 0]) or cell.free(q[i, k, b]):
                    continue
                angles = np.arange(k, min(k + _ANGLES_APART, K))
                _leave_out(q, grid.q, i, angles, int(b))
        progress((count + 1) / len(samples))
    return q


def _colliding_samples(
    cell: Surroundings, problem: RedundancyProblem, way: Trajectory
) -> list[int]:
    """Samples whose postures collide; the first and last where only coming or going fails."""
    first_and_last = [0, len(way.q) - 1]
    try:
        colliding = [i for i in range(len(way.q)) if not cell.free(way.q[i])]
        with_ends = cell.with_ends(problem, way.q)
    except InputError:  # the arm cannot come or go that far from here
        return first_and_last
    # The first and last few postures, in which E comes and goes.
    coming_and_going = np.vstack([with_ends[:4], with_ends[-4:]])
    if not colliding and not all(cell.free(posture) for posture in coming_and_going):
        return first_and_last
    return colliding


def _leave_out(q: Array, whole: Array, i: int, angles: Array, branch: int) -> None:
    """Leaves out a posture that collides, and those near it on samples and angles around.

    Args:
        q: (N, K, B, n) postures, set to NaN where they are left out.
        whole: (N, K, B, n) all postures.
        i: sample of the posture that collides.
        angles: indices of the angles whose postures may go; the first is that of the posture.
        branch: index of its branch.
    """
    posture = whole[i, angles[0], branch]
    for sample in range(max(0, i - 1), min(len(q), i + _SAMPLES_APART)):
        for angle in angles:
            near = np.abs(whole[sample, angle] - posture).max(axis=-1) < _NEAR_POSTURE
            q[sample, angle][near] = np.nan
