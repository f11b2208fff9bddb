import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wrenchsight.diagrams.distances.placement_cell import (
    PlacementCell,
    obstacle_corners,
    workpiece_corners,
    workpiece_rotation,
)
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.planning.placement.placement_program import (
    PlacementBatch,
    quaternion_from,
    rotation_of,
)
from wrenchsight.models.planning.placement.placement_task import (
    ClearanceConfig,
    ObstacleConfig,
    WorkpieceConfig,
)
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.robot_config import PoseConfig

# A posture with the tool straight down, well clear of itself.
Q_DOWN = np.array([0.3, -1.07999, -0.12099, 0.0, -0.3698163267948966, 0.2])


def table(height: float) -> ObstacleConfig:
    """A table whose top is at a height."""
    return ObstacleConfig("table", [3.0, 3.0, 0.1], PoseConfig([0.0, 0.0, height - 0.05]))


def shared(robot: Robot, q: Array) -> tuple[Array, Array, Array]:
    """Direction, midpoint and quaternion of a path through E, in the tool's xy plane."""
    R, p = robot.chain.pose(q)
    return R[:, 0], p, quaternion_from(R)


def test_the_distance_to_a_table_is_that_of_the_tools_ball(sts: Robot) -> None:
    R, p = sts.chain.pose(Q_DOWN)
    assert R[2, 2] < -1.0 + 1e-12
    for gap in (0.025, 0.015, 0.0105, -0.004):
        config = ClearanceConfig(0.01, [table(p[2] - gap)])
        cell = PlacementCell(sts, config)
        # E is the lowest point of the tool's ball; distances are exact to some micrometres.
        measured = cell.distances(Q_DOWN[np.newaxis], *shared(sts, Q_DOWN))[0]
        assert measured == pytest.approx(gap, abs=2e-5)
        expected = max(0.0, 0.01 - gap)
        deficit = cell.deficit(Q_DOWN[np.newaxis], *shared(sts, Q_DOWN))
        assert deficit == pytest.approx(expected, abs=2e-5)
        margin = cell.margins_and_gradients(Q_DOWN[np.newaxis], *shared(sts, Q_DOWN))[0][0]
        assert (margin > 0.0) == (gap > 0.011)
        distance, index, *names = cell.closest(Q_DOWN[np.newaxis], *shared(sts, Q_DOWN))
        assert (distance, index) == (measured, 0)
        assert set(names) == {"table", "polishing_tool"}


def test_the_tools_ball_may_touch_the_workpiece_and_nothing_else_may(sts: Robot) -> None:
    board = ClearanceConfig(0.01, [], WorkpieceConfig([0.5, 0.3, 0.02]))
    cell = PlacementCell(sts, board)
    # The ball touches the board, which does not count: the nearest pair is one of the wrist's.
    distance, _, *names = cell.closest(Q_DOWN[np.newaxis], *shared(sts, Q_DOWN))
    assert distance > 0.02
    assert "workpiece" not in names
    # A board through the forearm is noticed.
    n_W, p_WM, quaternion = shared(sts, Q_DOWN)
    elbow = p_WM + np.array([0.0, 0.0, 0.25])
    distance, _, *names = cell.closest(Q_DOWN[np.newaxis], n_W, elbow, quaternion)
    assert distance < 0.0
    assert "workpiece" in names


def test_an_arm_folded_into_itself_collides(sts: Robot) -> None:
    cell = PlacementCell(sts, ClearanceConfig(0.01))
    folded = np.array([0.0, -2.58383, 2.95106, 0.0, -1.93803, 0.0])  # elbow turned right over
    q = np.array([Q_DOWN, folded])
    distances = cell.distances(q, *shared(sts, Q_DOWN))
    assert distances[0] > 0.01
    assert distances[1] < 0.0


def test_pairs_that_are_near_by_construction_are_named(sts: Robot) -> None:
    cell = PlacementCell(sts, ClearanceConfig(0.01))
    assert cell.notices == (
        "link_4 and link_6 are nearer than 10 mm at home, two joints apart by construction: their "
        "distance is not checked",
    )
    assert PlacementCell(sts, ClearanceConfig(0.005)).notices == ()


@pytest.fixture(scope="module")
def crowded(sts: Robot) -> tuple[PlacementCell, Array, Array, Array, Array]:
    """A cell in which table and board are near, and postures along a path in it."""
    n_W, p_WM, quaternion = shared(sts, Q_DOWN)
    config = ClearanceConfig(0.02, [table(p_WM[2] - 0.03)], WorkpieceConfig([0.5, 0.3, 0.02]))
    tilted = quaternion_from(
        rotation_of(quaternion) @ Rotation.from_euler("xyz", [0.2, 0.25, 0.4]).as_matrix()
    )
    rng = np.random.default_rng(0)
    q = Q_DOWN + rng.uniform(-0.05, 0.05, (8, 6))
    n_W = n_W + np.array([0.1, 0.2, 0.05])
    return PlacementCell(sts, config), q, n_W / np.linalg.norm(n_W), p_WM, tilted


def test_gradients_of_the_margins_are_those_of_finite_differences(
    crowded: tuple[PlacementCell, Array, Array, Array, Array],
) -> None:
    cell, q, n_W, p_WM, quaternion = crowded
    margins, gradients = cell.margins_and_gradients(q, n_W, p_WM, quaternion)
    assert np.sum(margins < 0.4) >= 6  # something is near
    x = np.concatenate([n_W, p_WM, quaternion])

    def moved(step: Array) -> Array:
        shared = x + step[6:]
        return cell.margins_and_gradients(q + step[:6], shared[:3], shared[3:6], shared[6:])[0]

    h = 1e-4
    steps = h * np.eye(16)
    ahead = np.stack([(moved(d) - margins) / h for d in steps], axis=1)
    behind = np.stack([(margins - moved(-d)) / h for d in steps], axis=1)
    # Drake's distances are exact to a micrometre only, hence the long steps: they carry 1 % of
    # noise into the differences. Where another pair of edges becomes the nearest within a step,
    # forward and backward differences disagree, and nothing is to be compared.
    scale = np.max(np.abs(ahead + behind), axis=1, keepdims=True) / 2.0 + 1e-9
    smooth = np.all(np.abs(ahead - behind) < 0.03 * scale, axis=1)
    # Where the wrist's own parts, always alike, are the nearest, there is no gradient but noise.
    smooth &= scale[:, 0] > 1.0
    assert np.sum(smooth) >= 4
    error = np.abs(gradients - (ahead + behind) / 2.0) / scale
    assert np.max(error[smooth]) < 0.02


def test_penalties_have_the_gradient_that_a_descent_needs(
    crowded: tuple[PlacementCell, Array, Array, Array, Array],
) -> None:
    cell, q, n_W, p_WM, quaternion = crowded
    R = rotation_of(quaternion)

    def batch(step: Array) -> PlacementBatch:
        turn = Rotation.from_rotvec(step[:3]).as_matrix()
        return PlacementBatch(
            q[np.newaxis], (n_W + step[6:])[np.newaxis], (p_WM + step[3:6])[np.newaxis],
            (turn @ R)[np.newaxis],
        )  # fmt: skip

    penalty, by_q, by_path = cell.penalties(batch(np.zeros(9)))
    assert penalty[0] > 0.0
    assert by_q.shape == (1, 8, 6)
    h = 1e-4
    expected = [
        (cell.penalties(batch(h * d))[0][0] - cell.penalties(batch(-h * d))[0][0]) / (2.0 * h)
        for d in np.eye(9)
    ]
    scale = np.max(np.abs(expected))
    np.testing.assert_allclose(by_path[0] / scale, np.array(expected) / scale, atol=0.02)


def test_the_workpiece_lies_under_the_path() -> None:
    quaternion = quaternion_from(np.diag([1.0, -1.0, -1.0]))  # tool straight down
    R = workpiece_rotation(np.array([0.0, 1.0, 0.0]), quaternion)
    np.testing.assert_allclose(R, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-12)
    config = ClearanceConfig(workpiece=WorkpieceConfig([1.0, 0.2, 0.05]))
    corners = workpiece_corners(
        config, np.array([0.0, 1.0, 0.0]), np.array([0.3, 0.0, 0.4]), quaternion
    )
    np.testing.assert_allclose(corners.min(axis=0), [0.2, -0.5, 0.35], atol=1e-12)
    np.testing.assert_allclose(corners.max(axis=0), [0.4, 0.5, 0.4], atol=1e-12)
    box = obstacle_corners(ObstacleConfig("b", [0.2, 0.4, 0.6], PoseConfig([1.0, 2.0, 3.0])))
    np.testing.assert_allclose(box.min(axis=0), [0.9, 1.8, 2.7])
    np.testing.assert_allclose(box.max(axis=0), [1.1, 2.2, 3.3])
