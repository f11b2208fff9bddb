"""Distances of robots with STL collision shapes, against coal and the meshes as they are.

coal takes the distance of the very triangles. Drake's hulls contain them, so that it may say less
and never more.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio
import pytest

from diagrams.distances.clearance import Clearance
from models.robot.robot import Robot


class _Meshes:
    """The robot's collision shapes in pinocchio and coal."""

    def __init__(self, robot: Robot, urdf: Path, package: Path) -> None:
        self.model = pinocchio.buildModelFromUrdf(str(urdf))
        kind = pinocchio.GeometryType.COLLISION
        self.shapes = pinocchio.buildGeomFromUrdf(self.model, str(urdf), kind, None, [str(package)])
        self.data = self.model.createData()
        self.placed = pinocchio.GeometryData(self.shapes)
        ids = [self.model.getJointId(name) for name in robot.joint_names]
        self.moving = set(ids)
        self.index = [self.model.joints[i].idx_q for i in ids]

    def _joint(self, joint: int) -> int:
        while joint and joint not in self.moving:
            joint = self.model.parents[joint]
        return int(joint)

    def smallest(self, q: np.ndarray) -> float:
        """Of all pairs but those of one body or of neighbours, m."""
        full = pinocchio.neutral(self.model)
        full[self.index] = q
        pinocchio.updateGeometryPlacements(self.model, self.data, self.shapes, self.placed, full)
        found = [np.inf]
        parts = list(self.shapes.geometryObjects)
        for i, first in enumerate(parts):
            for k, second in enumerate(parts[:i]):
                a, b = self._joint(first.parentJoint), self._joint(second.parentJoint)
                if a == b or self._joint(self.model.parents[max(a, b)]) == min(a, b):
                    continue
                found.append(self._distance(first, self.placed.oMg[i], second, self.placed.oMg[k]))
        return min(found)

    @staticmethod
    def _distance(first: Any, X_1: Any, second: Any, X_2: Any) -> float:
        places = [coal.Transform3s(X.rotation, X.translation) for X in (X_1, X_2)]
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        a, b = first.geometry, second.geometry
        return float(coal.distance(a, places[0], b, places[1], request, result))


@pytest.fixture(scope="module")
def ur5(wheel_robot: Callable[[str], Robot]) -> Robot:
    return wheel_robot("ur5")


def test_hulls_are_never_farther_apart_than_their_meshes(ur5: Robot, wheel_robots: Path) -> None:
    urdf = wheel_robots / "ur_description/urdf/ur5_robot.urdf"
    meshes = _Meshes(ur5, urdf, wheel_robots.parents[1])
    clearance = Clearance(ur5, floor=None)
    assert ur5.unusable_collisions == ()
    assert clearance.has_shapes
    rng = np.random.default_rng(0)
    compared = num_collisions = 0
    for q in rng.uniform(-2.5, 2.5, (200, 6)):
        # Without the pairs that the home posture excuses: what is required counts, not they.
        hulls = min((pair.distance for pair in clearance._pairs(q, 0.1)), default=0.1)
        true = meshes.smallest(q)
        assert hulls <= max(true, 0.0) + 1e-5 or hulls >= 0.1
        compared += 0.0 < true < 0.1
        num_collisions += true <= 0.0
        if true <= 0.0:
            assert clearance.slack(q) < 0.0
    assert compared > 50
    assert num_collisions > 10  # what was let pass before


def test_a_shape_that_is_lost_is_named(
    wheel_robot: Callable[[str], Robot], monkeypatch: pytest.MonkeyPatch
) -> None:
    from models.robot import collision_meshes
    from models.robot.convex_hulls import UnusableMeshError, hull_file

    def without_forearm(mesh: Path) -> Path:
        if mesh.name == "forearm.stl":
            raise UnusableMeshError("its points lie in a plane")
        return hull_file(mesh)

    monkeypatch.setattr(collision_meshes, "hull_file", without_forearm)
    robot = wheel_robot("ur5")
    assert robot.unusable_collisions == ("forearm_link (its points lie in a plane)",)


def test_a_simulation_does_not_collide_with_hulls(ur5: Robot) -> None:
    assert "_hull_" not in ur5.urdf_text
    assert any("count as their convex hulls" in notice for notice in ur5.notices)
