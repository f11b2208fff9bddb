"""What a cycle does not repeat: closed forms of the slip."""

import numpy as np
import pytest

from wrenchsight.models.identification.repetition_error import (
    REACH_CHOICES,
    RepetitionError,
    repetition_error,
    slip_along,
)

STEP = 1e-3
NOISE, LEVEL = np.array([0.3, 0.4]), np.array([5.0, 2.0])


def error(K_0=None, read_load=0.0, resolution=(0.0, 0.0)):
    return RepetitionError(NOISE, np.eye(2), LEVEL, np.array(resolution), K_0, read_load)


def there_and_back(N=1000, width=0.01):
    """(N, 2) q of a cycle that goes forward for its first half, and v."""
    phase = np.arange(N) * 2.0 * np.pi / N
    q = np.stack([width * (1.0 - np.cos(phase)), 0.5 * width * (1.0 - np.cos(phase))], axis=1)
    return q, np.gradient(q, STEP, axis=0)


def test_cycles_that_move_alike_have_noise_alone_through_their_turns_as_well():
    q, v = there_and_back()
    q, v = np.tile(q, (3, 1)), np.tile(v, (3, 1))  # the lead-in first: both cycles begin alike
    sd = error().sd(q, v, np.zeros((2000, 2)), 1000, STEP)
    np.testing.assert_allclose(sd[1000:], np.tile(NOISE, (1000, 1)), rtol=1e-12)


def test_a_joint_that_is_led_the_other_way_may_be_wrong_by_twice_its_level():
    q, v = there_and_back()
    other = q.copy()
    other[:500, 0] = q[0, 0] - q[:500, 0]  # joint 1 backwards; joint 2 as before
    samples = np.vstack([q, other])
    sd = error().sd(samples, np.vstack([v, v]), np.zeros((1000, 2)), 1000, STEP)
    # Well after the start, all elements of either cycle slide.
    np.testing.assert_allclose(sd[200:490, 0], np.hypot(NOISE[0], 2.0 * LEVEL[0]), rtol=1e-9)
    np.testing.assert_allclose(sd[200:490, 1], NOISE[1], rtol=1e-9)


def test_within_its_reach_a_joint_is_wrong_in_proportion_to_its_displacement():
    still = np.zeros((10, 2))
    moved = still.copy()
    moved[4:] = 2e-5  # beyond the first reach, within the others
    sd = error().sd(np.vstack([still, moved]), np.zeros((20, 2)), np.zeros((10, 2)), 10, STEP)
    share = np.mean([1.0, (2.0 / 3.0) ** 2, 0.2**2])  # of 1e-5, 3e-5 and 1e-4
    np.testing.assert_allclose(sd[4:], np.sqrt(NOISE**2 + LEVEL**2 * share) * np.ones((6, 1)))
    np.testing.assert_allclose(sd[:4], NOISE * np.ones((4, 1)))


def test_behind_a_low_pass_slip_fades_in_as_the_torque_does():
    K_0 = 20.0
    still = np.zeros((200, 2))
    moved = still.copy()
    moved[100:] = 1.0  # far beyond every reach
    q = np.vstack([still, moved])
    sd = error(K_0).sd(q, 0.0 * q, np.zeros((200, 2)), 200, STEP)
    rise = -np.expm1(-K_0 * STEP * np.arange(1, 101))
    expected = np.sqrt(NOISE**2 + (LEVEL * rise[:, np.newaxis]) ** 2)
    np.testing.assert_allclose(sd[100:], expected, rtol=1e-9)


def test_the_load_that_is_read_widens_the_joint_that_carries_it():
    q = np.zeros((20, 2))
    tau = np.zeros((10, 2))
    tau[:, 1] = -8.0
    sd = error(read_load=0.05).sd(q, q, tau, 10, STEP)
    np.testing.assert_allclose(sd[0], [NOISE[0], np.hypot(NOISE[1], 0.4)])


def test_an_encoder_that_flickers_between_two_steps_at_rest_turns_nothing_round():
    rng = np.random.default_rng(3)
    step = 1e-4
    q = step * rng.integers(0, 2, (400, 2)).astype(float)
    with_resolution = error(resolution=(step, step)).sd(q, 0.0 * q, np.zeros((200, 2)), 200, STEP)
    # The first steps of all say where between them the joint rests.
    np.testing.assert_allclose(with_resolution[20:], NOISE * np.ones((180, 1)), rtol=1e-9)
    fooled = error().sd(q, 0.0 * q, np.zeros((200, 2)), 200, STEP)
    assert fooled[20:].mean() > 2.0 * with_resolution[20:].mean()


def test_of_an_encoder_s_displacement_half_a_step_may_be_rounding():
    step = 4e-6
    still = np.zeros((10, 2))
    moved = still.copy()
    moved[4:] = 2.0 * step  # at the least 6e-6 from where it was
    q = np.vstack([still, moved])
    sd = error(resolution=(step, step)).sd(q, 0.0 * q, np.zeros((10, 2)), 10, STEP)
    share = np.mean((1.5 * step / np.array(REACH_CHOICES)) ** 2)
    np.testing.assert_allclose(sd[4:], np.sqrt(NOISE**2 + LEVEL**2 * share) * np.ones((6, 1)))


def test_a_sample_that_is_not_finite_leaves_the_slip_as_it_was():
    q = np.cumsum(np.full((8, 1), 4e-6), axis=0)
    z, whole = np.empty_like(q), np.empty_like(q)
    slip_along(q, 0.0 * q, np.zeros(1), STEP, REACH_CHOICES[1], whole)
    broken = q.copy()
    broken[3] = np.nan
    slip_along(broken, 0.0 * q, np.zeros(1), STEP, REACH_CHOICES[1], z)
    assert z[3] == whole[2]
    np.testing.assert_allclose(z[4:], whole[4:], rtol=1e-9)


def test_noise_is_about_zero_and_correlations_are_those_of_the_errors():
    rng = np.random.default_rng(5)
    samples = rng.normal(size=(40_000, 2))
    errors = 0.1 + samples @ np.array([[0.3, 0.2], [0.0, 0.4]])  # a lasting error is an error
    repetition = repetition_error(errors, LEVEL, np.zeros(2), 20.0)
    # 40,000 samples: a half percent
    np.testing.assert_allclose(repetition.noise, np.sqrt([0.01 + 0.09, 0.01 + 0.2]), rtol=0.02)
    expected = (0.01 + 0.06) / np.sqrt(0.1 * 0.21)
    assert repetition.correlation[0, 1] == pytest.approx(expected, abs=0.02)
    assert repetition.K_0 == 20.0
