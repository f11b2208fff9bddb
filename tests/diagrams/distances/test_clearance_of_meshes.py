"""Distances of robots with STL collision shapes, against coal and the meshes as they are.

coal takes the distance of the very triangles. Drake's hulls contain them, so that it may say less
and never more.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from package_meshes import PackageMeshes

from wrenchsight.diagrams.distances.arm_shapes import ArmShapes
from wrenchsight.diagrams.distances.clearance import Clearance
from wrenchsight.models.robot.robot import Robot


@pytest.fixture(scope="module")
def ur5(wheel_robot: Callable[[str], Robot]) -> Robot:
    return wheel_robot("ur5")


def test_hulls_are_never_farther_apart_than_their_meshes(ur5: Robot) -> None:
    meshes = PackageMeshes(ur5)
    assert meshes.by_construction == set()
    clearance, shapes = Clearance(ur5, floor=None), ArmShapes(ur5)
    assert ur5.unusable_collisions == ()
    assert clearance.has_shapes
    rng = np.random.default_rng(0)
    compared = num_collisions = 0
    for q in rng.uniform(-2.5, 2.5, (200, 6)):
        # Without the pairs that the home posture excuses: what is required counts, not they.
        hulls = min((pair.distance for pair in shapes.pairs(q, 0.1)), default=0.1)
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
    from wrenchsight.models.robot import collision_meshes
    from wrenchsight.models.robot.convex_hulls import UnusableMeshError, hull_file

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
