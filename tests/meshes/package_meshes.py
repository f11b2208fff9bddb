"""The collision meshes of a robot's own package, in pinocchio and coal: the triangles, no hulls.

Pairs of one link, and of links that a joint connects, are left out; so are pairs that overlap in
every posture, whose meshes are made that way (`by_construction`).
"""

from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import ConvexHull

from wrenchsight.models.robot.robot import Robot

_POSTURES = 60  # that tell whether a pair always overlaps


class PackageMeshes:
    """What moves, what it may hit, and how low it hangs.

    Args:
        robot: with the names of the joints, their limits, W and the locked joints.
        urdf: of the same arm, with its meshes; robot.yaml's where None.
    """

    def __init__(self, robot: Robot, urdf: Path | None = None) -> None:
        path = urdf or (robot.source.parent / robot.config.urdf)
        packages = [str(folder) for folder in path.resolve().parents[1:5]]
        self._model = pinocchio.buildModelFromUrdf(str(path))
        kind = pinocchio.GeometryType.COLLISION
        self._shapes = pinocchio.buildGeomFromUrdf(self._model, str(path), kind, None, packages)
        self._data = self._model.createData()
        joints = [self._model.getJointId(name) for name in robot.joint_names]
        locked = {
            self._model.getJointId(name): value
            for name, value in robot.config.locked_joints.items()
            if self._model.existJointName(name)
        }
        self._joints, self._locked = joints, locked
        self._base = self._model.getFrameId(robot.config.base_link)
        self.level = [self._level(shape.parentJoint) for shape in self._shapes.geometryObjects]
        for i, first in enumerate(self.level):
            for k, second in enumerate(self.level[:i]):
                if abs(first - second) > 1:
                    self._shapes.addCollisionPair(pinocchio.CollisionPair(k, i))
        self._placed = pinocchio.GeometryData(self._shapes)
        rng = np.random.default_rng(0)
        low, high = (np.clip(x, -3.1, 3.1) for x in (robot.position_lower, robot.position_upper))
        seen = [self._hit(q) for q in rng.uniform(low, high, (_POSTURES, robot.num_joints))]
        self.by_construction = set.intersection(*seen)

    def _level(self, joint: int) -> int:
        while joint and joint not in self._joints:
            joint = self._model.parents[joint]
        return self._joints.index(joint) + 1 if joint else 0

    def _place(self, q: ArrayLike) -> None:
        full = pinocchio.neutral(self._model)
        values = {**dict(zip(self._joints, np.asarray(q, float), strict=True)), **self._locked}
        for joint, value in values.items():
            at = self._model.joints[joint].idx_q
            if self._model.joints[joint].nq == 2:  # a continuous joint: a point of the circle
                full[at : at + 2] = np.cos(value), np.sin(value)
            else:
                full[at] = value
        pinocchio.updateGeometryPlacements(
            self._model, self._data, self._shapes, self._placed, full
        )

    def _hit(self, q: ArrayLike) -> set[str]:
        self._place(q)
        pinocchio.computeCollisions(self._shapes, self._placed, False)
        parts = self._shapes.geometryObjects
        return {
            f"{parts[pair.first].name} and {parts[pair.second].name}"
            for pair, result in zip(
                self._shapes.collisionPairs, self._placed.collisionResults, strict=True
            )
            if result.isCollision()
        }

    def collisions(self, q: NDArray[np.float64]) -> dict[str, int]:
        """Over q (N, n): at how many samples which pair overlaps."""
        counts: dict[str, int] = {}
        for row in q:
            for pair in self._hit(row) - self.by_construction:
                counts[pair] = counts.get(pair, 0) + 1
        return counts

    def smallest(self, q: ArrayLike) -> float:
        """Smallest distance of any pair that counts at q (n,), m."""
        self._place(q)
        distances = [np.inf]
        for i, pair in enumerate(self._shapes.collisionPairs):
            parts = (
                self._shapes.geometryObjects[pair.first],
                self._shapes.geometryObjects[pair.second],
            )
            if f"{parts[0].name} and {parts[1].name}" not in self.by_construction:
                distances.append(
                    pinocchio.computeDistance(self._shapes, self._placed, i).min_distance
                )
        return float(min(distances))

    def lowest(self, q: NDArray[np.float64]) -> float:
        """Height in W of the lowest point of a moving link over q (N, n), m."""
        corners = [self._corners(shape.geometry) for shape in self._shapes.geometryObjects]
        low = np.inf
        for row in q:
            self._place(row)
            pinocchio.updateFramePlacements(self._model, self._data)
            X_BW = self._data.oMf[self._base].inverse()
            for level, points, X_WG in zip(self.level, corners, self._placed.oMg, strict=True):
                if level:
                    X = X_BW * X_WG
                    low = min(low, float((points @ X.rotation[2]).min() + X.translation[2]))
        return low

    @staticmethod
    def _corners(shape: Any) -> NDArray[np.float64]:
        """(V, 3), the outermost of a mesh; of another solid the corners of its bounding box."""
        if isinstance(shape, coal.BVHModelBase):
            points = np.asarray(shape.vertices())
            return np.asarray(points[ConvexHull(points).vertices])
        shape.computeLocalAABB()
        box = shape.aabb_local
        low, high = np.asarray(box.min_), np.asarray(box.max_)
        return np.array(
            [
                [x, y, z]
                for x in (low[0], high[0])
                for y in (low[1], high[1])
                for z in (low[2], high[2])
            ]
        )
