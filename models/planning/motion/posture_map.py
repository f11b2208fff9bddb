"""Map of the best posture at each point of a plane: it shows where to put a table.

At each point the tool may point anywhere within a cone and turn about its axis; all branches of the
inverse kinematics are tried for a set of directions, and the best direction is then refined.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.numerics.ties import SAME, first_of_least
from wrenchsight.models.planning.motion.branches import all_branches
from wrenchsight.models.planning.motion.posture_measures import PostureMeasure
from wrenchsight.models.planning.motion.surface_path import frame_about, rotation_about
from wrenchsight.models.robot.robot import Robot

_DIRECTIONS, _TURNS = 37, 8  # tried at each point: directions in the cone, turns about the tool
_REFINED_DIRECTIONS, _REFINEMENTS = 6, 3  # round the best one, and how often, each time nearer
_BLOCK = 20_000  # poses solved at a time
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


def best_postures(
    robot: Robot,
    measure: PostureMeasure,
    p_WE: ArrayLike,
    cone_axis_W: ArrayLike,
    cone_angle: float,
    tool_axis_E: ArrayLike = (0.0, 0.0, 1.0),
    progress: Callable[[float], None] = lambda fraction: None,
    is_free: Callable[[Array], bool] | None = None,
) -> PostureMap:
    """The best posture within the joint limits at each point.

    Directions are tried on an even spread over the cone, each with eight turns about the tool (with
    one where the last joint turns about the tool and no measure of J can depend on it); then, three
    times, six directions round the best one, ever nearer to it.

    Args:
        p_WE: (N, 3) points, m.
        cone_axis_W: (3,) where the tool points in the cone's middle.
        cone_angle: between the cone's axis and its side, rad.
        tool_axis_E: (3,) direction of the tool in E.
        is_free: whether the arm hits nothing at q (n,); other postures are passed over.
    """
    points = np.asarray(p_WE, dtype=np.float64).reshape(-1, 3)
    axis = np.asarray(cone_axis_W, dtype=np.float64)
    R_WC = frame_about(axis, "cone_axis_W")
    R_ET = frame_about(np.asarray(tool_axis_E, dtype=np.float64))
    turns = 1 if turns_with_last_joint(robot, tool_axis_E) else _TURNS
    spread = _cap(_DIRECTIONS if cone_angle > 0.0 else 1, cone_angle)
    N, n = len(points), robot.num_joints
    best: Array = np.full(N, np.nan)
    q: Array = np.full((N, n), np.nan)
    is_reached = np.zeros(N, dtype=np.bool_)
    tilt = np.zeros((N, 2))  # rotation vector of the tool from the cone's axis, in the cone's frame
    turn = np.zeros(N)
    rounds = 1 + (_REFINEMENTS if cone_angle > 0.0 or turns > 1 else 0)
    size = cone_angle / math.sqrt(_DIRECTIONS)
    turn_size = 2.0 * math.pi / turns
    for index in range(rounds):
        if index == 0:
            rows = np.arange(N)
            tilts = np.tile(np.repeat(spread, turns, axis=0), (N, 1, 1))
            angles = np.tile(np.arange(turns) * turn_size, (N, len(spread)))
        else:
            rows = np.flatnonzero(np.isfinite(best))
            tilts, angles = _around(tilt[rows], turn[rows], size, turn_size, cone_angle, turns)
            size, turn_size = 0.5 * size, 0.5 * turn_size
        num_tries = tilts.shape[1]
        per_block = max(1, _BLOCK // num_tries)
        for start in range(0, len(rows), per_block):
            block_rows = rows[start : start + per_block]
            part = slice(start, start + per_block)
            R = R_WC @ _tilted(tilts[part], angles[part]) @ R_ET.T
            p = np.repeat(points[block_rows], num_tries, axis=0)
            postures = all_branches(robot, R.reshape(-1, 3, 3), p)
            is_posture = np.isfinite(postures[..., 0])
            block_values: Array = np.full(is_posture.shape, np.inf)
            block_values[is_posture] = measure.values(postures[is_posture])
            values = block_values.reshape(len(block_rows), -1)
            postures = postures.reshape(len(block_rows), -1, n)
            if values.shape[1] == 0:
                continue
            is_reached[block_rows] |= np.isfinite(values).any(axis=1)
            if is_free is not None:
                _pass_over_hits(values, postures, best[block_rows], is_free)
            choice = first_of_least(values)
            indices = np.arange(len(block_rows))
            lowest = values[indices, choice]
            is_better = lowest < np.where(
                np.isnan(best[block_rows]), np.inf, best[block_rows] * (1.0 - SAME)
            )
            target, source = block_rows[is_better], indices[is_better]
            pose = choice[is_better] // (values.shape[1] // num_tries)
            best[target] = lowest[is_better]
            q[target] = postures[source, choice[is_better]]
            tilt[target] = tilts[part][source, pose]
            turn[target] = angles[part][source, pose]
            progress((index + (start + len(block_rows)) / max(len(rows), 1)) / rounds)
    direction = (R_WC @ _tilted(tilt, turn))[..., 2]
    direction[np.isnan(best)] = np.nan
    return PostureMap(points, best, direction, q, is_reached & np.isnan(best))


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
    """Tilts (M, D, 2) and turns (M, D) near those given, the tilts within the cone."""
    azimuth = np.arange(_REFINED_DIRECTIONS) * 2.0 * math.pi / _REFINED_DIRECTIONS
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
