"""Map of the best posture at each point of a plane: it shows where to put a table.

At each point the tool may point anywhere within a cone and turn about its axis; all branches of the
inverse kinematics are tried for a set of directions, and the best direction is then refined.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.numerics.ties import TIE_TOLERANCE, first_of_least
from wrenchsight.models.planning.motion.branches import all_branches
from wrenchsight.models.planning.motion.posture_cost import PostureMeasure
from wrenchsight.models.planning.motion.surface_path import frame_about, rotation_about
from wrenchsight.models.robot.robot import Robot

# tried at each point: directions in the cone, turns about the tool
_NUM_DIRECTIONS, _NUM_TURNS = 37, 8
# round the best one, and how often, each time nearer
_NUM_REFINED_DIRECTIONS, _NUM_REFINEMENTS = 6, 3
_BLOCK_POSES = 20_000  # poses solved at a time
_MOST_CHECKED = 60  # postures of a point, best first, that may hit something


@dataclass(frozen=True)
class PostureMap:
    """The best posture at each of N points.

    Attributes:
        p_WE: (N, 3) m.
        best: (N,) smallest measure; NaN where the tool cannot reach within the cone.
        direction_W: (N, 3) of the tool there.
        q: (N, n) the posture there.
        hits: (N,) whether the tool reaches the point, but every checked posture hits something.
    """

    p_WE: Array
    best: Array
    direction_W: Array
    q: Array
    hits: Flags


@dataclass(frozen=True)
class ToolCone:
    """The directions in which the tool may point.

    Attributes:
        axis_W: (3,) where the tool points in the cone's middle.
        angle: between the cone's axis and its side, rad.
        tool_axis_E: (3,) direction of the tool in E.
    """

    axis_W: ArrayLike
    angle: float
    tool_axis_E: ArrayLike = (0.0, 0.0, 1.0)


def best_postures(
    robot: Robot,
    measure: PostureMeasure,
    p_WE: ArrayLike,
    cone: ToolCone,
    progress: Callable[[float], None] = lambda fraction: None,
    is_free: Callable[[Array], bool] | None = None,
) -> PostureMap:
    """The best posture within the joint limits at each point.

    Directions are tried on an even spread over the cone, each with eight turns about the tool (with
    one where the last joint turns about the tool and no measure of J can depend on it); then, three
    times, six directions round the best one, ever nearer to it.

    Args:
        robot: its joint limits count.
        measure: of a posture; the smallest is the best.
        p_WE: (N, 3) points, m.
        cone: of the tool's directions.
        progress: called with the share that is done.
        is_free: whether the arm hits nothing at q (n,); other postures are passed over.
    """
    points = np.asarray(p_WE, dtype=np.float64).reshape(-1, 3)
    search = _Search(robot, measure, points, cone, is_free)
    turns = 1 if turns_with_last_joint(robot, cone.tool_axis_E) else _NUM_TURNS
    spread = _cap(_NUM_DIRECTIONS if cone.angle > 0.0 else 1, cone.angle)
    rounds = 1 + (_NUM_REFINEMENTS if cone.angle > 0.0 or turns > 1 else 0)
    # The steps about the best direction and turn in the next round, rad: at first the spacing of
    # the spread.
    tilt_step = cone.angle / math.sqrt(_NUM_DIRECTIONS)
    turn_step = 2.0 * math.pi / turns
    N = len(points)
    for round_number in range(rounds):
        if round_number == 0:
            rows = np.arange(N)  # of the points; tilts (N, D, 2) and angles (N, D): D tries of each
            tilts = np.tile(np.repeat(spread, turns, axis=0), (N, 1, 1))
            angles = np.tile(np.arange(turns) * turn_step, (N, len(spread)))
        else:
            rows = np.flatnonzero(np.isfinite(search.best))
            tilts, angles = _around(
                search.tilt[rows],
                search.turn[rows],
                size=tilt_step,
                turn_size=turn_step,
                limit=cone.angle,
                turns=turns,
            )
            tilt_step, turn_step = 0.5 * tilt_step, 0.5 * turn_step
        per_block = max(1, _BLOCK_POSES // tilts.shape[1])
        for start in range(0, len(rows), per_block):
            block = slice(start, start + per_block)
            search.try_orientations(rows[block], tilts[block], angles[block])
            progress((round_number + min(start + per_block, len(rows)) / len(rows)) / rounds)
    return search.result()


class _Search:
    """The best posture so far at each of N points.

    Args:
        points: (N, 3) m.
        is_free: as in `best_postures`.

    Attributes:
        best: (N,) smallest measure; NaN where there is none yet.
        tilt: (N, 2) rotation vector of the tool there from the cone's axis, in the cone's frame.
        turn: (N,) rad of the tool there about its axis.
    """

    def __init__(
        self,
        robot: Robot,
        measure: PostureMeasure,
        points: Array,
        cone: ToolCone,
        is_free: Callable[[Array], bool] | None,
    ) -> None:
        self._robot, self._measure, self._is_free = robot, measure, is_free
        self._points = points
        self._R_WC = frame_about(np.asarray(cone.axis_W, dtype=np.float64), "cone_axis_W")
        self._R_ET = frame_about(np.asarray(cone.tool_axis_E, dtype=np.float64))
        N = len(points)
        self.best: Array = np.full(N, np.nan)
        self.tilt, self.turn = np.zeros((N, 2)), np.zeros(N)
        self._q: Array = np.full((N, robot.num_joints), np.nan)
        self._is_reached = np.zeros(N, dtype=np.bool_)

    def try_orientations(self, rows: NDArray[np.intp], tilts: Array, angles: Array) -> None:
        """Tries D orientations at each of M points, on all branches, and keeps what is better.

        Args:
            rows: (M,) of the points.
            tilts: (M, D, 2) rotation vectors of the tool from the cone's axis, in the cone's frame.
            angles: (M, D) turns of the tool about its axis, rad.
        """
        num_tries = tilts.shape[1]
        R = self._R_WC @ _tilted(tilts, angles) @ self._R_ET.T
        p = np.repeat(self._points[rows], num_tries, axis=0)
        postures = all_branches(self._robot, R.reshape(-1, 3, 3), p)  # (M D, branches, n)
        is_posture = np.isfinite(postures[..., 0])
        all_values: Array = np.full(is_posture.shape, np.inf)
        all_values[is_posture] = self._measure.values(postures[is_posture])
        # A row a point; its tries one after another, and of each try all branches.
        values = all_values.reshape(len(rows), -1)
        postures = postures.reshape(len(rows), -1, self._robot.num_joints)
        if values.shape[1] == 0:
            return
        best = self.best[rows]  # NaN where there is none yet
        self._is_reached[rows] |= np.isfinite(values).any(axis=1)
        if self._is_free is not None:
            # Writes inf for those that hit something: they are reached, but not chosen. Those that
            # are no better than `best` are not looked at.
            _pass_over_hits(values, postures, best, self._is_free)
        choice = first_of_least(values)
        indices = np.arange(len(rows))
        lowest = values[indices, choice]
        # By more than rounding: a later round must not change a point for nothing.
        is_better = lowest < np.where(np.isnan(best), np.inf, best * (1.0 - TIE_TOLERANCE))
        target, source = rows[is_better], indices[is_better]
        num_branches = values.shape[1] // num_tries
        pose = choice[is_better] // num_branches  # the try that the best posture is of
        self.best[target] = lowest[is_better]
        self._q[target] = postures[source, choice[is_better]]
        self.tilt[target] = tilts[source, pose]
        self.turn[target] = angles[source, pose]

    def result(self) -> PostureMap:
        """The map of what was tried so far."""
        direction = (self._R_WC @ _tilted(self.tilt, self.turn))[..., 2]
        is_empty = np.isnan(self.best)
        direction[is_empty] = np.nan
        hits = self._is_reached & is_empty
        return PostureMap(self._points, self.best, direction, self._q, hits)


def _pass_over_hits(values: Array, q: Array, best: Array, is_free: Callable[[Array], bool]) -> None:
    """Writes inf into values (M, K), of postures q (M, K, n), that hit something before a free one.

    Only values below `best` (M,), NaN for none, are checked: others change nothing.
    """
    for row, postures, best_so_far in zip(values, q, best, strict=True):
        for _ in range(_MOST_CHECKED):
            k = int(first_of_least(row))
            if not np.isfinite(row[k]) or row[k] >= best_so_far or is_free(postures[k]):
                break
            row[k] = np.inf
        else:
            row[:] = np.inf


def turns_with_last_joint(robot: Robot, tool_axis_E: ArrayLike) -> bool:
    """Whether a turn of the tool about its axis through E moves the last joint alone."""
    chain = robot.chain
    if chain.prismatic[-1]:
        return False
    tool = np.asarray(tool_axis_E, dtype=np.float64)
    tool_L = chain.R_LE @ tool / np.linalg.norm(tool)
    axis = chain.axis[-1]
    aligned = np.linalg.norm(np.cross(axis, tool_L)) < 1e-9
    return bool(aligned and np.linalg.norm(np.cross(axis, chain.p_LE)) < 1e-9)


def _cap(count: int, angle: float) -> Array:
    """(count, 2) tilts spread evenly over a cone of this angle, axis and rim included."""
    if count == 1:
        return np.zeros((1, 2))
    i = np.arange(count)
    # Even in area, by the golden angle (Vogel, 1979): 1 - cos(tilt) grows evenly.
    tilt = np.arccos(1.0 - (1.0 - math.cos(angle)) * i / (count - 1))
    azimuth = i * math.pi * (3.0 - math.sqrt(5.0))
    return np.stack([tilt * np.cos(azimuth), tilt * np.sin(azimuth)], axis=1)


def _around(
    tilt: Array, turn: Array, size: float, turn_size: float, limit: float, turns: int
) -> tuple[Array, Array]:
    """Tilts (M, D, 2) and turns (M, D) near those given, the tilts within the cone.

    Args:
        tilt, turn: (M, 2) and (M,) rad, of which the tilt changes alone, then the turn alone.
        size, turn_size: rad, of a change of the tilt, and twice that of the turn.
        limit: rad, of the cone.
        turns: number of turns that are tried; with one the turn stays.
    """
    azimuth = np.arange(_NUM_REFINED_DIRECTIONS) * 2.0 * math.pi / _NUM_REFINED_DIRECTIONS
    offsets = size * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    tilts = tilt[:, np.newaxis] + offsets
    if turns > 1:
        tilts = np.concatenate([tilts, np.repeat(tilt[:, np.newaxis], 2, axis=1)], axis=1)
    angles = np.repeat(turn[:, np.newaxis], tilts.shape[1], axis=1)
    if turns > 1:
        angles[:, -2] += 0.5 * turn_size
        angles[:, -1] -= 0.5 * turn_size
    length = np.linalg.norm(tilts, axis=2, keepdims=True)
    return tilts * np.minimum(1.0, limit / np.maximum(length, 1e-12)), angles


def _tilted(tilt: Array, turn: Array) -> Array:
    """Rotations (..., 3, 3): a turn about z, then a tilt by the vector [-t_y, t_x, 0]."""
    length = np.linalg.norm(tilt, axis=-1)
    unit = tilt / np.maximum(length, 1e-12)[..., np.newaxis]
    tilt_axis = np.stack([-unit[..., 1], unit[..., 0], np.zeros_like(length)], axis=-1)
    return rotation_about(tilt_axis, length) @ rotation_about(np.array([0.0, 0.0, 1.0]), turn)
