"""What needs six joints, on an arm whose tool is turned on its flange.

The bundled arms' tools stand straight, and their ranges are symmetric: what forgets the one or the
other works with them. The oracle is the UR10e's published DH table, multiplied up, and the tool's
pose on its flange as the fixture states it.
"""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from wrenchsight.analyses.methods.planning.jcn_map import sample
from wrenchsight.analyses.methods.planning.placement import place
from wrenchsight.analyses.methods.planning.redundancy import find_redundancy
from wrenchsight.analyses.methods.planning.redundancy_task import RedundancyTask
from wrenchsight.models.arrays import Array
from wrenchsight.models.placement.placement_search import SearchEffort
from wrenchsight.models.placement.placement_task import load_task
from wrenchsight.models.robot.robot import Robot

_SMALL = SearchEffort(
    num_samples=2000, num_poses=6, num_starts=10, num_rounds=1, num_kinds=4, num_steps=12,
    num_solves=2,
)  # fmt: skip
_LOWER, _UPPER = -0.6, 2.8  # rad, of the first joint
_DOWN = np.array([0.0, 0.0, -1.0])


def _pose_of_E(q: Array) -> tuple[Array, Array]:
    """R_WE (N, 3, 3) and p_WE (N, 3) at q (N, 6)."""
    alpha = np.array([np.pi / 2, 0, 0, np.pi / 2, -np.pi / 2, 0])
    a = np.array([0, -0.6127, -0.57155, 0, 0, 0])
    d = np.array([0.1807, 0, 0, 0.17415, 0.11985, 0.11655])
    (cr, cp, cy), (sr, sp, sy) = np.cos([0.5, -0.4, 0.9]), np.sin([0.5, -0.4, 0.9])
    X_FE = np.eye(4)
    X_FE[:3, :3] = (
        np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
        @ np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
        @ np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    )
    X_FE[:3, 3] = [0.05, -0.04, 0.12]
    found = []
    for row in q:
        X = np.diag([-1.0, -1.0, 1.0, 1.0])  # base_link is the DH base turned by 180 degrees
        for al, ai, di, th in zip(alpha, a, d, row, strict=True):
            ca, sa, ct, st = np.cos(al), np.sin(al), np.cos(th), np.sin(th)
            X = X @ np.array(
                [
                    [ct, -st * ca, st * sa, ai * ct],
                    [st, ct * ca, -ct * sa, ai * st],
                    [0, sa, ca, di],
                    [0, 0, 0, 1],
                ]
            )
        found.append(X @ X_FE)
    poses = np.array(found)
    return poses[:, :3, :3], poses[:, :3, 3]


def test_a_path_is_placed_for_the_tool_as_it_is_turned(ur10e_turned: Robot) -> None:
    """Straight, in one orientation, E's z axis within 15 degrees of straight down."""
    task, source = load_task("linear_path")
    task = dataclasses.replace(
        task,
        initial=None,
        path_length=0.6,
        path_in_surface=True,
        tool_direction=_DOWN.tolist(),
        tool_tilt_deg=15.0,
    )
    result = place(task, source, ur10e_turned, effort=_SMALL)
    placement, q = result.best.placement, result.best.fine.q
    R, p = _pose_of_E(q)
    along = np.linspace(-0.3, 0.3, len(q))[:, np.newaxis]
    np.testing.assert_allclose(p, placement.p_WM + along * placement.n_W, atol=1e-7)
    np.testing.assert_allclose(R, np.broadcast_to(placement.R_WE, R.shape), atol=1e-7)
    assert R[0, :, 2] @ _DOWN >= np.cos(np.radians(15.0)) - 1e-7
    assert abs(R[0, :, 2] @ placement.n_W) < 1e-7
    assert np.all((q[:, 0] >= _LOWER) & (q[:, 0] <= _UPPER))


def test_a_surface_is_followed_by_the_axis_of_the_turned_tool(
    ur10e_turned: Robot, tmp_path: Path
) -> None:
    """The tool's axis, not the flange's, stands on the surface, whatever the angle about it."""
    axis = np.array([0.6, 0.0, 0.8])
    points = np.column_stack([np.linspace(0.55, 0.75, 15), np.full(15, 0.2), np.full(15, 0.3)])
    normals = np.tile([0.0, 0.28, 0.96], (15, 1))
    table = np.hstack([points, normals])
    file = tmp_path / "path.csv"
    np.savetxt(file, table, delimiter=",", header="x,y,z,nx,ny,nz", comments="")
    task = RedundancyTask(csv=str(file), tool_axis=axis.tolist(), num_angles=24)
    q = find_redundancy(ur10e_turned, task).optimised.q
    R, p = _pose_of_E(q)
    np.testing.assert_allclose(p, points, atol=1e-6)
    np.testing.assert_allclose(R @ axis, -normals, atol=1e-6)
    assert np.all((q[:, 0] >= _LOWER) & (q[:, 0] <= _UPPER))


@pytest.mark.parametrize("within_limits", [False, True])
def test_the_map_is_of_the_turned_tool(ur10e_turned: Robot, within_limits: bool) -> None:
    samples = sample(ur10e_turned, 2000, 0, within_limits=within_limits)
    np.testing.assert_allclose(samples.p_WE, _pose_of_E(samples.q)[1], atol=1e-9)
    low, high = (_LOWER, _UPPER) if within_limits else (-np.pi, np.pi)
    first = samples.q[:, 0]
    assert np.all((first >= low) & (first <= high))
    np.testing.assert_allclose([first.min(), first.max()], [low, high], atol=0.02)
