import math

import numpy as np
from scipy.spatial.transform import Rotation

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.planning.motion.posture_cost import ConditionNumber
from wrenchsight.models.planning.motion.posture_map import (
    ToolCone,
    best_postures,
    turns_with_last_joint,
)
from wrenchsight.models.robot.robot import Robot

DOWN = np.array([0.0, 0.0, -1.0])


def test_the_best_posture_is_within_the_cone_and_the_limits(sts: Robot) -> None:
    points = np.array([[0.4, 0.0, 0.3], [0.3, -0.3, 0.2], [0.1, 0.5, 0.4]])
    measure = ConditionNumber(sts.chain)
    postures = best_postures(sts, measure, points, ToolCone(DOWN, math.radians(30.0)))
    R_WE, p_WE = sts.chain.pose(postures.q)
    np.testing.assert_allclose(p_WE, points, rtol=0, atol=1e-9)
    np.testing.assert_allclose(R_WE[:, :, 2], postures.direction_W, rtol=0, atol=1e-9)
    lean = np.degrees(np.arccos(np.clip(postures.direction_W @ DOWN, -1.0, 1.0)))
    assert np.all(lean <= 30.0 + 1e-6)
    assert np.all(postures.q >= sts.position_lower) and np.all(postures.q <= sts.position_upper)
    np.testing.assert_allclose(
        postures.best, np.linalg.cond(sts.chain.jacobian(postures.q)), rtol=1e-9
    )


def test_hardly_any_of_many_random_directions_does_better(sts: Robot) -> None:
    from wrenchsight.models.planning.motion.branches import all_branches

    point, angle = np.array([0.42, 0.1, 0.25]), math.radians(40.0)
    measure = ConditionNumber(sts.chain)
    best = best_postures(sts, measure, point, ToolCone(DOWN, angle)).best[0]
    rng = np.random.default_rng(0)
    tilt, around = angle * np.sqrt(rng.uniform(0, 1, 3000)), rng.uniform(0, 2 * math.pi, 3000)
    axis = np.stack([np.cos(around), np.sin(around), np.zeros(3000)], axis=1)
    R_WE = (
        Rotation.from_rotvec(axis * tilt[:, np.newaxis]) * Rotation.from_euler("x", math.pi)
    ).as_matrix()
    q = all_branches(sts, R_WE, np.tile(point, (3000, 1)))
    lowest = np.min(measure.values(q[np.isfinite(q[..., 0])]))
    # Twenty times as many directions as are tried at a point gain no more than this.
    assert lowest > 0.995 * best


def test_out_of_reach_and_a_cone_without_width(sts: Robot) -> None:
    points = np.array([[2.0, 0.0, 0.3], [0.4, 0.0, 0.3]])
    postures = best_postures(sts, ConditionNumber(sts.chain), points, ToolCone(DOWN, 0.0))
    assert np.isnan(postures.best[0]) and np.all(np.isnan(postures.q[0]))
    assert np.all(np.isnan(postures.direction_W[0]))
    np.testing.assert_allclose(postures.direction_W[1], DOWN, atol=1e-12)


def test_a_tool_across_joint_6_is_turned_as_well(sts: Robot) -> None:
    assert turns_with_last_joint(sts, [0.0, 0.0, 1.0])
    assert turns_with_last_joint(sts, [0.0, 0.0, -2.0])
    assert not turns_with_last_joint(sts, [0.1, 0.0, 1.0])
    measure = ConditionNumber(sts.chain)
    point = np.array([0.4, 0.0, 0.3])
    postures = best_postures(sts, measure, point, ToolCone(DOWN, 0.0, tool_axis_E=[1.0, 0.0, 0.0]))
    R_WE, _ = sts.chain.pose(postures.q)
    np.testing.assert_allclose(R_WE[0] @ [1.0, 0.0, 0.0], DOWN, atol=1e-9)
    # A search over the turn alone, ten times as fine.
    from wrenchsight.models.planning.motion.branches import all_branches
    from wrenchsight.models.planning.motion.surface_path import frame_about, rotation_about

    turn = rotation_about(np.array([0.0, 0.0, 1.0]), np.linspace(0, 2 * math.pi, 120))
    R = frame_about(DOWN) @ turn @ frame_about(np.array([1.0, 0.0, 0.0])).T
    q = all_branches(sts, R, np.tile(point, (120, 1)))
    assert postures.best[0] < 1.02 * np.min(measure.values(q[np.isfinite(q[..., 0])]))


def test_postures_in_collision_are_skipped(sts: Robot) -> None:
    points = np.array([[0.4, 0.1, 0.3], [0.3, -0.3, 0.2], [2.0, 0.0, 0.3]])
    angle = math.radians(20.0)

    class WithoutElbowUp(ConditionNumber):
        """The oracle: what is not free is infinitely bad."""

        def values(self, q: Array) -> Array:
            return np.where(q[:, 2] > 0.0, super().values(q), np.inf)

    chosen = best_postures(sts, WithoutElbowUp(sts.chain), points, ToolCone(DOWN, angle))
    measure = ConditionNumber(sts.chain)
    whole = best_postures(sts, measure, points, ToolCone(DOWN, angle))
    free = best_postures(
        sts, measure, points, ToolCone(DOWN, angle), is_free=lambda q: bool(q[2] > 0.0)
    )
    np.testing.assert_array_equal(free.q, chosen.q)
    np.testing.assert_array_equal(free.best, chosen.best)
    assert np.all(free.q[:2, 2] > 0.0) and not np.all(whole.q[:2, 2] > 0.0)
    assert not free.hits.any() and not whole.hits.any()
    none = best_postures(sts, measure, points, ToolCone(DOWN, angle), is_free=lambda q: False)
    assert np.isnan(none.best).all()
    np.testing.assert_array_equal(none.hits, [True, True, False])
