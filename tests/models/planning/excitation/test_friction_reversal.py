"""Friction by reversal: the planner keeps eq. 16, the separation gives friction back."""

import numpy as np
import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.planning.excitation.friction_reversal import (
    FilteredMotion,
    reversal_motion,
    separate,
)


def friction(v):
    """Odd part and an offset that eq. 15 assumes away."""
    return np.tanh(v / 0.004) * (5.0 + 3.0 * np.exp(-((v / 0.1) ** 2))) + 4.0 * v, 0.7


def test_passes_have_opposite_velocities_and_no_acceleration(sts):
    speeds, way = np.array([0.01, 0.2]), np.array([1.0, -0.5, 0.0, 1.0, 1.0, 1.0])
    motion = reversal_motion(sts, way, sts.home, speeds, period=1.5)
    start = 1.5 * (2.0 * np.arange(2) + 1.0)
    q, v, vdot = motion.sample(start[:, None] + [0.0, 0.75, 1.5])  # (K, 3, n)
    np.testing.assert_allclose(q, np.broadcast_to(sts.home, q.shape), atol=1e-9)
    expected = speeds[:, None, None] * np.array([1.0, -1.0, 1.0])[:, None] * way
    np.testing.assert_allclose(v, expected, atol=1e-9)
    np.testing.assert_allclose(vdot, 0.0, atol=1e-9)


def test_the_plan_starts_and_ends_at_rest_and_is_smooth(sts):
    motion = reversal_motion(sts, np.eye(6)[2], sts.home, [0.05, 0.3])
    np.testing.assert_allclose(motion.v[[0, -1]], 0.0, atol=1e-12)
    difference = np.gradient(motion.q[:, 2], motion.t)
    np.testing.assert_allclose(difference[1:-1], motion.v[1:-1, 2], atol=1e-4)
    difference = np.gradient(motion.v[:, 2], motion.t)
    np.testing.assert_allclose(difference[1:-1], motion.vdot[1:-1, 2], atol=1e-3)


def test_friction_comes_back_from_planned_passes(sts):
    """All joints together."""
    way = np.array([1.0, -1, 1, -1, 1, -1])
    motion = reversal_motion(sts, way, sts.home, [0.02, 0.1, 0.4])
    t, q, v, vdot = motion.t, motion.q, motion.v, motion.vdot
    odd, offset = friction(v)
    tau = sts.chain.inverse_dynamics(q, v, vdot) + odd + offset
    for joint in range(6):
        separated = separate(
            sts.chain, FilteredMotion(t, q, v, vdot, tau), joint, rest_speed=1e-3, settle=0.05
        )
        assert len(separated.speed) > 100
        # The speeds of the two passes differ, most in the weaker stretches between the planned
        # passes, and friction is not linear.
        np.testing.assert_allclose(separated.symmetric, friction(separated.speed)[0], atol=0.05)
        assert np.median(separated.asymmetric) == pytest.approx(offset, abs=0.01)


def test_friction_comes_back_from_a_log(sts):
    """Also where the inertias in use are wrong in all that the passes cancel: gravity."""
    t = np.arange(0.0, 20.0, 1e-3)
    q = np.tile(sts.home, (len(t), 1))
    v, vdot = np.zeros_like(q), np.zeros_like(q)
    size, omega = 0.4 * np.linspace(0.2, 1.0, 5).repeat(4000), 2 * np.pi / 4.0
    q[:, 1] += size * np.sin(omega * t)
    v[:, 1] = size * omega * np.cos(omega * t)
    vdot[:, 1] = -size * omega**2 * np.sin(omega * t)
    odd, offset = friction(v)
    tau = sts.chain.inverse_dynamics(q, v, vdot) + odd + offset
    separated = separate(
        sts.chain, FilteredMotion(t, q, v, vdot, tau), 1, rest_speed=1e-3, settle=0.1
    )
    assert len(separated.speed) > 500
    # Speeds of the two passes differ where the amplitude steps; friction is not linear.
    np.testing.assert_allclose(separated.symmetric, friction(separated.speed)[0], atol=0.05)
    np.testing.assert_allclose(separated.asymmetric, offset, atol=0.05)
    heavier = sts.chain.with_inertial_parameters(
        1.3 * sts.chain.inertial_parameters, 1.3 * sts.chain.reflected_inertia
    )
    wrong = separate(heavier, FilteredMotion(t, q, v, vdot, tau), 1, rest_speed=1e-3, settle=0.1)
    np.testing.assert_allclose(wrong.symmetric, separated.symmetric, atol=0.05)
    assert np.abs(wrong.asymmetric - offset).max() > 1.0


def test_a_log_that_never_turns_has_no_pairs(sts):
    t = np.arange(0.0, 1.0, 1e-3)
    q = sts.home + 0.2 * t[:, None]
    v = np.full_like(q, 0.2)
    tau = np.zeros_like(q)
    assert len(separate(sts.chain, FilteredMotion(t, q, v, tau, tau), 0).speed) == 0


@pytest.mark.parametrize(
    ("posture", "speeds", "message"),
    [
        ([2.9, 0, 0, 0, 0, 0], [2.0], "joint_1: position"),
        ([0.0] * 6, [20.0], "joint_1: "),
        ([0.0] * 6, [0.0], "positive"),
        ([0.0] * 5, [0.1], "6 joints"),
    ],
)
def test_bad_plans_are_one_line(sts, posture, speeds, message):
    with pytest.raises(InputError, match=message):
        reversal_motion(sts, np.eye(6)[0], posture, speeds)
