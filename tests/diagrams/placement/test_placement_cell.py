import dataclasses

import numpy as np
import pytest
from pydrake.autodiffutils import ExtractGradient, InitializeAutoDiff
from scipy.spatial.transform import Rotation

from wrenchsight.diagrams.placement.placement_cell import (
    PlacementCell,
    obstacle_corners,
    workpiece_corners,
)
from wrenchsight.diagrams.placement.placement_plant import path_pose, path_rotation
from wrenchsight.diagrams.placement.placement_program import PlacementProgram
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.planning.motion.posture_cost import ConditionNumber
from wrenchsight.models.planning.placement.placement_task import (
    ClearanceConfig,
    ObstacleConfig,
    WorkpieceConfig,
)
from wrenchsight.models.planning.placement.placements import (
    Placement,
    PlacementBounds,
    quaternion_from,
    rotation_of,
)
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.robot_config import PoseConfig

# A posture with the tool straight down, well clear of itself.
Q_DOWN = np.array([0.3, -1.07999, -0.12099, 0.0, -0.3698163267948966, 0.2])


def table(height: float) -> ObstacleConfig:
    """A table whose top is at a height."""
    return ObstacleConfig("table", [3.0, 3.0, 0.1], PoseConfig([0.0, 0.0, height - 0.05]))


def placement_at(robot: Robot, q: Array) -> Placement:
    """A path through E at q, along the tool's x axis."""
    R, p = robot.chain.pose(q)
    return Placement(q[np.newaxis], R[:, 0], p, quaternion_from(R))


def test_the_distance_to_a_table_is_that_of_the_tools_ball(sts: Robot) -> None:
    R, p = sts.chain.pose(Q_DOWN)
    assert R[2, 2] < -1.0 + 1e-12
    for gap in (0.025, 0.015, 0.0105, -0.004):
        cell = PlacementCell(sts, ClearanceConfig(0.01, [table(p[2] - gap)]))
        # E is the lowest point of the tool's ball; distances are exact to some micrometres.
        placed = placement_at(sts, Q_DOWN)
        assert cell.smallest_distance(placed.q, placed) == pytest.approx(gap, abs=2e-5)
        assert cell.deficit(placed) == pytest.approx(max(0.0, 0.01 - gap), abs=2e-5)
        closest = cell.closest(placed)
        assert closest is not None
        assert {closest.first, closest.second} == {"table", "polishing_tool"}


def test_the_tools_ball_may_touch_the_workpiece_and_nothing_else_may(sts: Robot) -> None:
    board = ClearanceConfig(0.01, [], WorkpieceConfig([0.5, 0.3, 0.02]))
    cell = PlacementCell(sts, board)
    # The ball touches the board, which does not count.
    placed = placement_at(sts, Q_DOWN)
    assert cell.smallest_distance(placed.q, placed) > 0.01
    # A board through the forearm is noticed.
    elbow = dataclasses.replace(placed, p_WM=placed.p_WM + np.array([0.0, 0.0, 0.25]))
    closest = cell.closest(elbow)
    assert closest is not None and closest.distance < 0.0
    assert "workpiece" in (closest.first, closest.second)


def test_an_arm_folded_into_itself_collides(sts: Robot) -> None:
    cell = PlacementCell(sts, ClearanceConfig(0.01))
    folded = np.array([0.0, -2.58383, 2.95106, 0.0, -1.93803, 0.0])  # elbow turned right over
    placed = placement_at(sts, Q_DOWN)
    assert cell.smallest_distance(Q_DOWN[np.newaxis], placed) > 0.01
    assert cell.smallest_distance(folded[np.newaxis], placed) < 0.0


def test_pairs_that_are_near_by_construction_are_named() -> None:
    panda = Robot.load("panda")
    (notice,) = PlacementCell(panda, ClearanceConfig(0.01)).notices
    assert notice.startswith("panda_link5 and panda_link7 are near each other at home")
    assert PlacementCell(panda, ClearanceConfig(0.001)).notices == ()


def test_a_base_that_stands_in_a_table_is_named() -> None:
    """The UR5e's base is flat at z = 0: it reaches as deep into a table as that stands higher."""
    arm = Robot.load("ur5e")
    for top, notices in ((0.0, 0), (0.04, 1)):
        table = ObstacleConfig("table", [1.6, 1.6, 0.1], PoseConfig([0.2, 0.0, top - 0.05]))
        found = PlacementCell(arm, ClearanceConfig(0.01, [table])).notices
        assert len(found) == notices
    assert found[0].startswith("base_link, which stands still, reaches 40 mm into table")


def test_gradients_of_the_distances_are_those_of_finite_differences(sts: Robot) -> None:
    """A table and a board are near; the path's body and the arm move."""
    placed = placement_at(sts, Q_DOWN)
    config = ClearanceConfig(
        0.02, [table(placed.p_WM[2] - 0.03)], WorkpieceConfig([0.5, 0.3, 0.02])
    )
    cell = PlacementCell(sts, config)
    name, constraint = next(cell.constraints(cell.new_context()))
    assert name == "clearance"
    tilted = (
        rotation_of(placed.quaternion) @ Rotation.from_euler("xyz", [0.2, 0.25, 0.4]).as_matrix()
    )
    quaternion = quaternion_from(tilted)
    held = np.concatenate([quaternion, np.zeros(3)])
    path = path_pose(dataclasses.replace(placed, quaternion=quaternion))
    rng, compared = np.random.default_rng(0), 0
    for q in Q_DOWN + rng.uniform(-0.05, 0.05, (8, 6)):
        x = cell.parts.positions(q, path, held)
        gradient = np.asarray(ExtractGradient(constraint.Eval(InitializeAutoDiff(x)[:, 0])))
        h = 1e-4
        here = constraint.Eval(x)
        ahead = np.array([(constraint.Eval(x + d) - here)[0] for d in h * np.eye(len(x))]) / h
        behind = np.array([(here - constraint.Eval(x - d))[0] for d in h * np.eye(len(x))]) / h
        # Drake's distances are exact to a micrometre only, hence the long steps: they carry 1 % of
        # noise into the differences. Where another pair of edges becomes the nearest within a step,
        # forward and backward differences disagree, and nothing is to be compared.
        scale = np.max(np.abs(ahead + behind)) / 2.0
        if scale < 1.0 or np.max(np.abs(ahead - behind)) > 0.03 * scale:
            continue
        assert np.max(np.abs(gradient[0] - (ahead + behind) / 2.0)) < 0.02 * scale
        compared += 1
    assert compared >= 4


@pytest.mark.parametrize("name", ["ur5e", "panda", "ur10e"])
def test_a_flange_without_a_tool_may_stand_on_a_workpiece(name: str) -> None:
    """The flange's shape begins a millimetre before E or behind it; it is what works."""
    robot = Robot.load(name)
    q = np.array(robot.home)
    for distance in (0.0, 0.01):
        cell = PlacementCell(
            robot, ClearanceConfig(distance, [], WorkpieceConfig([0.2, 0.1, 0.02]))
        )
        worst = cell.worst(q[np.newaxis], placement_at(robot, q))
        assert worst is None or "workpiece" not in (worst.first, worst.second) or worst.slack > 0.0
        # A board in the base is noticed.
        below = dataclasses.replace(placement_at(robot, q), p_WM=np.array([0.0, 0.0, 0.1]))
        through = cell.worst(q[np.newaxis], below)
        assert through is not None and through.slack < 0.0


def test_a_workpiece_may_lie_on_a_table_and_not_in_it(sts: Robot) -> None:
    placed = placement_at(sts, Q_DOWN)
    for gap, is_kept in ((0.025, True), (0.015, False)):  # below E; the board is 20 mm thick
        board = WorkpieceConfig([0.2, 0.1, 0.02])
        cell = PlacementCell(sts, ClearanceConfig(0.0, [table(placed.p_WM[2] - gap)], board))
        worst = cell.worst(Q_DOWN[np.newaxis], placed)
        if is_kept:
            assert worst is None or worst.slack > 0.0
        else:
            assert worst is not None and {worst.first, worst.second} == {"workpiece", "table"}
            assert worst.slack == pytest.approx(gap - 0.02, abs=1e-5)


def test_a_program_with_distances_keeps_them(sts: Robot) -> None:
    """A table that is 4 mm too high: the path moves off it, by as little as it must."""
    placed = placement_at(sts, Q_DOWN)
    cell = PlacementCell(sts, ClearanceConfig(0.01, [table(placed.p_WM[2] - 0.006)]))
    box = np.array([0.02, 0.02, 0.02])
    bounds = PlacementBounds(
        sts.position_lower, sts.position_upper, placed.p_WM - box, placed.p_WM + box
    )
    measure = ConditionNumber(sts.chain)
    program = PlacementProgram(sts, measure, bounds, 0.05, 2, cell, has_cost=False)
    begin = dataclasses.replace(placed, q=np.tile(Q_DOWN, (3, 1)))
    solution = program.solve(begin)
    assert solution.converged
    assert program.violation(solution.placement) < 1e-6
    _, p = sts.chain.pose(solution.placement.q)
    # E is the lowest point of the tool's ball where the tool is upright; a lean lifts it by less.
    assert np.all(p[:, 2] > placed.p_WM[2] + 0.003)


def test_the_workpiece_lies_under_the_path() -> None:
    quaternion = quaternion_from(np.diag([1.0, -1.0, -1.0]))  # tool straight down
    R = path_rotation(np.array([0.0, 1.0, 0.0]), rotation_of(quaternion))
    np.testing.assert_allclose(R, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-12)
    config = ClearanceConfig(workpiece=WorkpieceConfig([1.0, 0.2, 0.05]))
    placed = Placement(
        np.zeros((1, 6)), np.array([0.0, 1.0, 0.0]), np.array([0.3, 0.0, 0.4]), quaternion
    )
    corners = workpiece_corners(config, placed)
    np.testing.assert_allclose(corners.min(axis=0), [0.2, -0.5, 0.35], atol=1e-12)
    np.testing.assert_allclose(corners.max(axis=0), [0.4, 0.5, 0.4], atol=1e-12)
    box = obstacle_corners(ObstacleConfig("b", [0.2, 0.4, 0.6], PoseConfig([1.0, 2.0, 3.0])))
    np.testing.assert_allclose(box.min(axis=0), [0.9, 1.8, 2.7])
    np.testing.assert_allclose(box.max(axis=0), [1.1, 2.2, 3.3])
