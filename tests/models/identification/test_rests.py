"""Rests in logs: counted joint by joint, with the friction that they held."""

import numpy as np
import pytest

from wrenchsight.models.identification.rests import arm_rests, rests_along, unseen_rests
from wrenchsight.models.identification.torque_error_model import (
    MIN_HELD_RATIO,
    UNSEEN_HELD,
    ConstantTorqueError,
)

STEP = 0.01


def log() -> tuple[np.ndarray, np.ndarray]:
    """Two joints over 6 s: the first stops twice, the second only slows down; and noise."""
    t = STEP * np.arange(600)
    moves = (t < 1.0) | ((t >= 2.0) & (t < 3.0)) | (t >= 3.2)  # the stop of .2 s is none
    moves &= t < 5.0
    q = np.stack([0.3 * np.cumsum(moves) * STEP, 5e-3 * t], axis=1)
    friction = np.where(t < 2.0, -9.0, 4.0)[:, None] * np.ones(2)
    noise = np.random.default_rng(0).normal(size=friction.shape)
    return np.round(q + 2e-5 * noise, 4), friction + 0.2 * noise


def test_rests_are_counted_with_the_friction_that_they_held() -> None:
    q, friction = log()
    rests = rests_along(q, friction, np.full(q.shape, 10.0), STEP, np.full(2, 1e-4))
    np.testing.assert_array_equal(rests.count, [2.0, 0.0])
    # -9 and 4 N m of 10, each the mean of 100 samples of sd .2: within 3 sd of .02.
    np.testing.assert_allclose(rests.held, [0.9, 0.0], atol=0.006)
    both = rests.joined(rests_along(q, 2.0 * friction, np.full(q.shape, 10.0), STEP, np.zeros(2)))
    np.testing.assert_array_equal(both.count, [4.0, 0.0])
    np.testing.assert_allclose(both.held, [1.8, 0.0], atol=0.012)


def test_a_log_shorter_than_a_rest_and_lost_positions_hold_none() -> None:
    q, friction = log()
    short = rests_along(q[:20], friction[:20], np.ones((20, 2)), STEP, np.zeros(2))
    lost = rests_along(np.full(q.shape, np.nan), friction, np.ones(q.shape), STEP, np.zeros(2))
    np.testing.assert_array_equal(short.count + lost.count, 0.0)


@pytest.mark.parametrize(
    ("count", "begin"),
    [([0.0, 0.0], "no joint rested in"), ([3.0, 0.0], "elbow never rested in"), ([1.0, 2.0], None)],
)
def test_the_user_is_told_of_joints_that_never_rested(
    count: list[float], begin: str | None
) -> None:
    error = ConstantTorqueError.of(np.eye(2)).with_rests(np.array(count), np.zeros(2))
    np.testing.assert_array_equal(
        error.held, np.where(np.array(count) > 0.0, MIN_HELD_RATIO, UNSEEN_HELD)
    )
    sentences = unseen_rests(error, ["shoulder", "elbow"])
    assert [sentence.startswith(begin or "") for sentence in sentences] == [True] * (
        begin is not None
    )
    assert all("record a motion that stops" in sentence for sentence in sentences)


def test_rests_of_the_whole_arm_last_a_second_and_allow_creep() -> None:
    t = STEP * np.arange(900)
    v = np.full((900, 2), 0.2)
    v[100:250], v[400:480] = 0.004, 0.0  # 1.5 s of creep, .8 s of rest; .2 s of margin
    v[600:800, 0] = 0.0  # of one joint alone
    np.testing.assert_array_equal(arm_rests(v, STEP), (t >= 0.795) & (t < 2.695))
