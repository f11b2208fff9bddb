import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.planning.motion.path_postures import correct_paths, track_paths
from wrenchsight.models.planning.motion.posture_measures import ConditionNumber
from wrenchsight.models.planning.placement.placement_descent import PlacementDescent
from wrenchsight.models.planning.placement.placement_program import PlacementBatch, PlacementBounds
from wrenchsight.models.robot.robot import Robot

LENGTH = 0.6


def starts(robot: Robot, count: int, seed: int = 0) -> PlacementBatch:
    rng = np.random.default_rng(seed)
    q_mid = rng.uniform(-1.2, 1.2, (60 * count, 6))
    n_W = rng.normal(size=(len(q_mid), 3))
    n_W /= np.linalg.norm(n_W, axis=1)[:, np.newaxis]
    q, reached = track_paths(robot.chain, q_mid, n_W, LENGTH, 10)
    R_WE, p_WM = robot.chain.pose(q_mid)
    batch = PlacementBatch(q, n_W, p_WM, R_WE)[reached]
    assert len(batch) >= count
    return batch[:count]


def bounds_of(robot: Robot, **changes: object) -> PlacementBounds:
    base = {
        "q_lower": robot.position_lower,
        "q_upper": robot.position_upper,
        "p_lower": np.full(3, -2.0),
        "p_upper": np.full(3, 2.0),
    }
    return PlacementBounds(**(base | changes))  # type: ignore[arg-type]


def strict(robot: Robot) -> PlacementBounds:
    """Bounds that every random start breaks in all ways."""
    return bounds_of(
        robot,
        q_lower=np.full(6, -0.2),
        q_upper=np.full(6, 0.2),
        p_lower=np.full(3, 0.1),
        p_upper=np.full(3, 0.2),
        angle_lower=0.3,
        angle_upper=0.5,
        max_joint_step=0.02,
        in_surface=True,
        tool_direction=np.array([0.6, 0.0, -0.8]),
        tool_tilt=0.2,
    )


@pytest.mark.parametrize("which", ["free", "strict"])
def test_the_gradient_is_that_of_the_cost_with_its_penalties(sts: Robot, which: str) -> None:
    bounds = bounds_of(sts) if which == "free" else strict(sts)
    descent = PlacementDescent(sts.chain, ConditionNumber(sts.chain), bounds, LENGTH)
    descent.penalty_weight = 10.0
    batch = starts(sts, 6)
    at = descent.evaluate(batch)

    def cost(step: Array) -> Array:
        n_W = batch.n_W + step[6:]
        n_W /= np.linalg.norm(n_W, axis=1)[:, np.newaxis]
        turn = Rotation.from_rotvec(step[:3]).as_matrix()
        moved = PlacementBatch(batch.q.copy(), n_W, batch.p_WM + step[3:6], turn @ batch.R_WE)
        assert correct_paths(sts.chain, moved.q, n_W, moved.p_WM, moved.R_WE, LENGTH).all()
        return descent.evaluate(moved).cost

    h = 1e-6
    expected = np.stack([(cost(h * d) - cost(-h * d)) / (2.0 * h) for d in np.eye(9)], axis=1)
    scale = np.max(np.abs(expected), axis=1, keepdims=True)
    np.testing.assert_allclose(at.gradient / scale, expected / scale, atol=1e-5)


def test_descents_only_go_down_and_stay_on_their_paths(sts: Robot) -> None:
    descent = PlacementDescent(sts.chain, ConditionNumber(sts.chain), bounds_of(sts), LENGTH)
    batch = starts(sts, 12)
    before = np.mean(ConditionNumber(sts.chain).values(batch.q), axis=1)
    after, values = descent.run(batch, 25)
    assert np.all(values <= before + 1e-9)
    assert np.median(values / before) < 0.7
    np.testing.assert_allclose(
        values, np.mean(ConditionNumber(sts.chain).values(after.q), axis=1), rtol=1e-12
    )
    np.testing.assert_allclose(np.linalg.norm(after.n_W, axis=1), 1.0, atol=1e-12)
    along = np.linspace(-0.5, 0.5, 11)[:, np.newaxis] * LENGTH
    R, p = sts.chain.pose(after.q)
    np.testing.assert_allclose(
        p, after.p_WM[:, np.newaxis] + along * after.n_W[:, np.newaxis], atol=1e-9
    )
    np.testing.assert_allclose(R, np.broadcast_to(after.R_WE[:, np.newaxis], R.shape), atol=1e-9)
    # A branch is kept: no joint has jumped anywhere along the path.
    assert np.max(np.abs(np.diff(after.q, axis=1))) < 1.0


def test_penalties_bring_placements_within_their_bounds(sts: Robot) -> None:
    lower, upper = np.array([0.25, -0.3, 0.3]), np.array([0.5, 0.3, 0.6])
    bounds = bounds_of(sts, p_lower=lower, p_upper=upper)
    descent = PlacementDescent(sts.chain, ConditionNumber(sts.chain), bounds, LENGTH)
    batch = starts(sts, 12, seed=1)
    outside = np.any((batch.p_WM < lower - 0.02) | (batch.p_WM > upper + 0.02), axis=1)
    assert np.sum(outside) >= 6
    after, _ = descent.run(batch, 60)
    # A penalty gives way a little; the program holds the bound exactly.
    off = np.maximum(np.max(lower - after.p_WM, axis=1), np.max(after.p_WM - upper, axis=1))
    assert np.median(off[outside]) < 0.01


def test_a_start_is_not_changed_by_its_neighbours(sts: Robot) -> None:
    descent = PlacementDescent(sts.chain, ConditionNumber(sts.chain), bounds_of(sts), LENGTH)
    # The weight of the penalties follows from all starts; within the bounds it does not matter.
    batch = starts(sts, 6)
    inside = np.array([i for i in range(6) if np.max(np.abs(batch.q[i])) < 2.0])
    _, together = descent.run(batch[inside], 8)
    _, alone = descent.run(batch[inside[:1]], 8)
    assert alone[0] == pytest.approx(together[0], rel=1e-9)


def test_the_same_for_another_length(sts: Robot) -> None:
    descent = PlacementDescent(sts.chain, ConditionNumber(sts.chain), bounds_of(sts), 1.0)
    shorter = descent.of_length(LENGTH)
    batch = starts(sts, 3)
    _, values = shorter.run(batch, 3)
    assert np.all(np.isfinite(values))
    assert math.isclose(shorter.path_length, LENGTH)
