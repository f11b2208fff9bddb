"""The encoders' step from a log: known steps, none, joints that hardly move."""

import numpy as np
import pytest

from wrenchsight.models.recordings.position_resolution import position_resolution


def motion(samples: int = 4000, joints: int = 3) -> np.ndarray:
    t = np.linspace(0.0, 20.0, samples)[:, None]
    return 0.7 * np.sin((1.0 + 0.3 * np.arange(joints)) * t)


def rounded(q: np.ndarray, step: float) -> np.ndarray:
    return np.asarray(np.round(q / step) * step)


@pytest.mark.parametrize("step", [1e-4, 1.7e-5, 2.0 * np.pi / 2**17])
def test_a_rounding_step_is_found(step: float) -> None:
    resolution = position_resolution(rounded(motion(), step))
    np.testing.assert_allclose(resolution, step, rtol=1e-3)


def test_a_step_is_found_in_single_precision() -> None:
    q = rounded(motion(), 1e-4).astype(np.float32)
    np.testing.assert_allclose(position_resolution(q), 1e-4, rtol=1e-2)


def test_smooth_positions_have_no_step() -> None:
    np.testing.assert_array_equal(position_resolution(motion()), 0.0)
    rng = np.random.default_rng(0)
    noisy = motion() + rng.normal(scale=1e-4, size=(4000, 3))
    np.testing.assert_array_equal(position_resolution(noisy), 0.0)


def test_a_resampled_log_has_no_step() -> None:
    q, t = rounded(motion(), 1e-4), np.arange(4000.0)
    other = np.stack([np.interp(t + 0.37, t, column) for column in q.T], axis=1)
    np.testing.assert_array_equal(position_resolution(other[:-1]), 0.0)


def test_a_flickering_joint_at_rest_shows_its_step() -> None:
    q = np.full((1000, 2), 0.3)
    q[::3] += 1e-4
    np.testing.assert_allclose(position_resolution(q), 1e-4, rtol=1e-9)


def test_a_joint_that_hardly_moves_is_given_the_step_of_the_others() -> None:
    q = rounded(motion(), 1e-4)
    q[:, 1] = 0.25
    np.testing.assert_allclose(position_resolution(q), 1e-4, rtol=1e-3)
    np.testing.assert_array_equal(position_resolution(np.full((500, 3), 0.25)), 0.0)


def test_rows_that_are_not_finite_do_not_count() -> None:
    q = rounded(motion(), 1e-4)
    q[100:110] = np.nan
    np.testing.assert_allclose(position_resolution(q), 1e-4, rtol=1e-3)
