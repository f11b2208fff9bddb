"""Placements of a straight path: the path in its place, the tool's rotation, and the postures.

    p_WE(q_i) = m + (i/k - 1/2) a n,  R_WE(q_i) = R          i = 0..k

with the path's direction n, midpoint m and length a, and one rotation R of the tool (Lu et al.,
eqs. 23-27). Whatever solves for placements (a program over a plant, a swarm) states them so.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.planning.motion.branches import all_branches
from wrenchsight.models.planning.motion.path_postures import correct_paths, track_paths
from wrenchsight.models.rigid_body.rotations import quaternion_of
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.robot.robot import Robot

_TURNS_OF_DIRECTION = 4  # into one range and then into the other, over and over


@dataclass(frozen=True)
class Placement:
    """A placed path, and the postures along it.

    Attributes:
        q: (k + 1, n) joint positions at the path's points.
        n_W: (3,) unit direction.
        p_WM: (3,) midpoint, m.
        quaternion: (4,) orientation of E in W: w, x, y, z; unit.
    """

    q: Array
    n_W: Array
    p_WM: Array
    quaternion: Array

    @property
    def R_WE(self) -> Array:
        """(3, 3) orientation of E in W."""
        return rotation_of(self.quaternion)


@dataclass
class PlacementBatch:
    """Many placements: q (N, k + 1, n), n_W (N, 3), p_WM (N, 3), R_WE (N, 3, 3)."""

    q: Array
    n_W: Array
    p_WM: Array
    R_WE: Array

    def __len__(self) -> int:
        return len(self.q)

    def __getitem__(self, index: "NDArray[np.intp] | Flags | slice") -> "PlacementBatch":
        return PlacementBatch(
            q=self.q[index], n_W=self.n_W[index], p_WM=self.p_WM[index], R_WE=self.R_WE[index]
        )

    @classmethod
    def joined(cls, batches: "Sequence[PlacementBatch]") -> "PlacementBatch":
        """All placements of several batches."""
        return cls(
            q=np.concatenate([batch.q for batch in batches]),
            n_W=np.concatenate([batch.n_W for batch in batches]),
            p_WM=np.concatenate([batch.p_WM for batch in batches]),
            R_WE=np.concatenate([batch.R_WE for batch in batches]),
        )

    def one(self, index: int) -> Placement:
        """One of the placements."""
        quaternion = quaternion_from(self.R_WE[index])
        return Placement(self.q[index], self.n_W[index], self.p_WM[index], quaternion)


@dataclass(frozen=True)
class PlacementBounds:
    """The bounds of a placement.

    Attributes:
        q_lower, q_upper: (n,) joint limits, margin already taken off.
        p_lower, p_upper: (3,) box of the midpoint in W, m.
        angle_lower, angle_upper: of the tool's rotation from W, within [0, pi] rad.
        max_joint_step: rad or m, from one point to the next.
        in_surface: whether the path is perpendicular to the tool's z axis.
        tool_direction: (3,) unit, in W; None where the tool may point anywhere.
        tool_tilt: rad, largest angle of the tool's z axis from there.
        path_direction: (3,) unit, in W; None where the path may point anywhere.
        path_angle_lower, path_angle_upper: of the path from there, within [0, pi] rad.
    """

    q_lower: Array
    q_upper: Array
    p_lower: Array
    p_upper: Array
    angle_lower: float = 0.0
    angle_upper: float = math.pi
    max_joint_step: float = 1.0
    in_surface: bool = False
    tool_direction: Array | None = None
    tool_tilt: float = math.pi
    path_direction: Array | None = None
    path_angle_lower: float = 0.0
    path_angle_upper: float = math.pi

    def w_range(self) -> tuple[float, float]:
        """The range of the quaternion's w for the range of the angle; both signs where possible."""
        low = math.cos(0.5 * self.angle_lower)
        # Q and -Q are one rotation: only an upper end of the angle needs w to have a sign.
        return (-low if self.angle_upper >= math.pi else math.cos(0.5 * self.angle_upper)), low

    def allowed_directions(self, n_W: Array, z_W: Array) -> Array:
        """Directions (N, 3) turned into their range, and across the tools' z axes where so stated.

        Where both are stated, both are nearly kept.
        """
        n_W = n_W / np.maximum(np.linalg.norm(n_W, axis=1), 1e-9)[:, np.newaxis]
        for _ in range(_TURNS_OF_DIRECTION):
            if self.path_direction is not None:
                cosine = np.clip(n_W @ self.path_direction, -1.0, 1.0)
                angle = np.clip(np.arccos(cosine), self.path_angle_lower, self.path_angle_upper)[
                    :, np.newaxis
                ]
                across = n_W - cosine[:, np.newaxis] * self.path_direction
                across /= np.maximum(np.linalg.norm(across, axis=1), 1e-9)[:, np.newaxis]
                n_W = np.cos(angle) * self.path_direction + np.sin(angle) * across
            if self.in_surface:
                n_W = n_W - np.einsum("nc,nc->n", n_W, z_W)[:, np.newaxis] * z_W
            n_W = n_W / np.maximum(np.linalg.norm(n_W, axis=1), 1e-9)[:, np.newaxis]
        return n_W

    def violations(self, placement: Placement) -> dict[str, float]:
        """Violations of all bounds by their keys in the task's file, rad and m; 0 where kept."""
        q, p = placement.q, placement.p_WM
        w = abs(float(placement.quaternion[0])) / float(np.linalg.norm(placement.quaternion))
        angle = 2.0 * math.acos(min(1.0, w))
        excess = {key: np.max(joints) for key, joints in self._joint_excess(q).items()} | {
            "midpoint_lower, midpoint_upper": max(
                np.max(self.p_lower - p), np.max(p - self.p_upper)
            ),
            "angle_lower_deg": self.angle_lower - angle,
            "angle_upper_deg": angle - self.angle_upper,
        }
        if self.in_surface:
            excess["path_in_surface"] = abs(float(placement.n_W @ placement.R_WE[:, 2]))
        if self.tool_direction is not None:
            tilt = _angle_between(placement.R_WE[:, 2], self.tool_direction)
            excess["tool_direction, tool_tilt_deg"] = tilt - self.tool_tilt
        if self.path_direction is not None:
            turn = _angle_between(placement.n_W, self.path_direction)
            excess["path_angle_lower_deg"] = self.path_angle_lower - turn
            excess["path_angle_upper_deg"] = turn - self.path_angle_upper
        return {name: max(0.0, float(value)) for name, value in excess.items()}

    def worst_joint(self, key: str, placement: Placement) -> int | None:
        """Index of the joint that breaks a bound the most; None for a bound that is no joint's.

        Args:
            key: of `violations`.
        """
        joints = self._joint_excess(placement.q).get(key)
        return None if joints is None else int(np.argmax(joints))

    def _joint_excess(self, q: Array) -> dict[str, Array]:
        """What each joint is beyond its bounds (n,), rad (sliding: m), by `violations`' keys.

        It is negative within them.

        Args:
            q: (k + 1, n) positions at the path's points.
        """
        return {
            "joint limits": np.max(np.maximum(self.q_lower - q, q - self.q_upper), axis=0),
            "max_joint_step_deg": (
                np.max(np.abs(np.diff(q, axis=0)), axis=0) - self.max_joint_step
            ),
        }

    def violation(self, placement: Placement) -> float:
        """The largest violation, rad and m; zero within the bounds."""
        return max(self.violations(placement).values())


def _angle_between(a: Array, b: Array) -> float:
    """rad; exact at small angles, too."""
    return math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b))


def pose_errors(chain: SerialChain, placement: Placement, path_length: float) -> Array:
    """(k + 1, 6) rotation vector (rad) and position (m) of E from the path's points, in W."""
    R, p = chain.pose(placement.q)
    turn = Rotation.from_matrix(R @ placement.R_WE.T).as_rotvec()
    along = path_length * (np.linspace(0.0, 1.0, len(p)) - 0.5)[:, np.newaxis]
    return np.hstack([turn, p - placement.p_WM - along * placement.n_W])


def rotation_of(quaternion: Array) -> Array:
    """(3, 3) rotation matrix of a quaternion (w, x, y, z), made unit first."""
    w, x, y, z = quaternion / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion_from(R: Array) -> Array:
    """Unit quaternion (w, x, y, z) of a rotation matrix, w >= 0."""
    quaternion = np.empty(4)
    quaternion_of(np.ascontiguousarray(R, dtype=np.float64), quaternion)
    quaternion /= np.linalg.norm(quaternion)
    return -quaternion if quaternion[0] < 0.0 else quaternion


class PathsOnBranches(NamedTuple):
    """M placements of some paths, one on each branch of the inverse kinematics at its midpoint.

    Attributes:
        placements: the M placements.
        is_reached: (M,) whether the whole path can be followed.
        path_index: (M,) index of the path that each is of.
    """

    placements: PlacementBatch
    is_reached: Flags
    path_index: NDArray[np.intp]


def on_all_branches(
    robot: Robot,
    n_W: Array,
    p_WM: Array,
    R_WE: Array,
    path_length: float,
    num_segments: int,
    max_joint_step: float,
) -> PathsOnBranches:
    """N paths from every posture in which E is at their midpoints; joint limits count only there.

    Args:
        n_W, p_WM, R_WE: (N, 3), (N, 3) m, (N, 3, 3) of the paths.
    """
    q = all_branches(robot, R_WE, p_WM)
    is_posture = np.all(np.isfinite(q), axis=2)
    row = np.nonzero(is_posture)[0]
    q, is_reached = track_paths(
        robot.chain, q[is_posture], n_W[row], path_length, num_segments, max_joint_step
    )
    return PathsOnBranches(PlacementBatch(q, n_W[row], p_WM[row], R_WE[row]), is_reached, row)


def placement_on_path(robot: Robot, placement: Placement, path_length: float) -> Placement | None:
    """The same placement with each posture moved onto its point exactly; None if one cannot be."""
    q = placement.q[np.newaxis].copy()
    is_reached = correct_paths(
        robot.chain,
        q,
        placement.n_W[np.newaxis],
        placement.p_WM[np.newaxis],
        placement.R_WE[np.newaxis],
        path_length,
    )
    if not is_reached[0]:
        return None
    return Placement(q[0], placement.n_W, placement.p_WM, placement.quaternion)


def interpolated(q: Array, parts: int) -> Array:
    """(parts k + 1, n) postures on straight lines in the joints between postures q (k + 1, n)."""
    k = len(q) - 1
    index = np.linspace(0.0, k, parts * k + 1)
    lower = np.minimum(index.astype(int), k - 1)
    fraction = (index - lower)[:, np.newaxis]
    return np.asarray((1.0 - fraction) * q[lower] + fraction * q[lower + 1])


def between_points(
    robot: Robot, placement: Placement, path_length: float, parts: int = 10
) -> Placement | None:
    """The placement with `parts` times as many points; None where the postures do not continue.

    Each new posture is the one nearest to the straight line in the joints between two points. If
    from one to the next no joint takes more than three times its share of the step between the
    points (and a rounding), all of them lie on one branch.
    """
    fine = placement_on_path(
        robot, replace(placement, q=interpolated(placement.q, parts)), path_length
    )
    if fine is None:
        return None
    steps = np.max(np.abs(np.diff(placement.q, axis=0)))
    if np.max(np.abs(np.diff(fine.q, axis=0))) > 3.0 * steps / parts + 1e-6:
        return None
    return fine
