"""What needs six joints, on an arm whose tool is turned on its flange.

The bundled arms' tools stand straight, and their ranges are symmetric: what forgets the one or the
other works with them. The oracle is pinocchio, which reads the UR10e's URDF as it stands, with the
tool's pose on its flange as the fixture states it.
"""

import dataclasses
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from wrenchsight.analyses.methods.jcn_map.jcn_map import sample
from wrenchsight.analyses.methods.place.placement import PlacementRequest, place
from wrenchsight.analyses.methods.place.placement_search import SearchEffort
from wrenchsight.analyses.methods.redundancy.redundancy import find_redundancy
from wrenchsight.analyses.methods.redundancy.redundancy_task import RedundancyTask
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.planning.placement.placement_task import load_task
from wrenchsight.models.robot.robot import Robot

_SMALL = SearchEffort(
    num_samples=2000, num_poses=6, num_starts=10, num_rounds=1, num_kinds=4, num_solves=2
)
_LOWER, _UPPER = -0.6, 2.8  # rad, of the first joint
_DOWN = np.array([0.0, 0.0, -1.0])


def _pose_of_E(robot: Robot, q: Array) -> tuple[Array, Array]:
    """R_WE (N, 3, 3) and p_WE (N, 3) at q (N, 6)."""
    model = pin.buildModelFromUrdf(str(robot.source.with_name(str(robot.config.urdf))))
    data, flange = model.createData(), model.getFrameId(robot.config.flange)
    X_FE = pin.SE3(pin.rpy.rpyToMatrix(0.5, -0.4, 0.9), np.array([0.05, -0.04, 0.12]))
    poses = []
    for row in q:
        pin.framesForwardKinematics(model, data, row)
        poses.append((data.oMf[flange] * X_FE).homogeneous)
    return np.array(poses)[:, :3, :3], np.array(poses)[:, :3, 3]


@pytest.mark.long
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
    result = place(task, source, ur10e_turned, PlacementRequest(effort=_SMALL))
    placement, q = result.best.placement, result.best.fine.q
    R, p = _pose_of_E(ur10e_turned, q)
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
    R, p = _pose_of_E(ur10e_turned, q)
    np.testing.assert_allclose(p, points, atol=1e-6)
    np.testing.assert_allclose(R @ axis, -normals, atol=1e-6)
    assert np.all((q[:, 0] >= _LOWER) & (q[:, 0] <= _UPPER))


@pytest.mark.parametrize("within_limits", [False, True])
def test_the_map_is_of_the_turned_tool(ur10e_turned: Robot, within_limits: bool) -> None:
    samples = sample(ur10e_turned, 2000, 0, within_limits=within_limits)
    np.testing.assert_allclose(samples.p_WE, _pose_of_E(ur10e_turned, samples.q)[1], atol=1e-9)
    low, high = (_LOWER, _UPPER) if within_limits else (-np.pi, np.pi)
    first = samples.q[:, 0]
    assert np.all((first >= low) & (first <= high))
    np.testing.assert_allclose([first.min(), first.max()], [low, high], atol=0.02)
