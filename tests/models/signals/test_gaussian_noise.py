"""Unit Gaussian noise by counter: distribution, whiteness, repeatability."""

import numpy as np
import pytest
from scipy.stats import kstest

from wrenchsight.models.signals.gaussian_noise import gaussian_noise


def draw(seed, num_ticks, size, first=0):
    noise = np.empty((num_ticks, size))
    for k in range(num_ticks):
        gaussian_noise(seed, first + k, noise[k])
    return noise


@pytest.mark.parametrize("channel", [0, 1, 4])
def test_every_channel_is_a_unit_gaussian(channel):
    # A false alarm once in 10,000 seeds; this seed is fixed.
    assert kstest(draw(1, 20000, 5)[:, channel], "norm").pvalue > 1e-4


def test_channels_ticks_and_seeds_are_independent():
    N = 20000
    noise = draw(1, N, 7)
    limit = 5.0 / np.sqrt(N)  # five standard deviations of a correlation of independent draws
    correlation = np.corrcoef(np.hstack([noise, draw(2, N, 7)]).T) - np.eye(14)
    assert np.abs(correlation).max() < limit
    for lag in (1, 2, 7):
        assert np.abs((noise[lag:] * noise[:-lag]).mean(axis=0)).max() < limit


def test_neighbouring_seeds_and_ticks_do_not_repeat_each_other():
    """A seed must not be another seed's stream, shifted."""
    values = np.concatenate([draw(seed, 200, 4).ravel() for seed in range(20)])
    assert np.unique(values).size == values.size


def test_the_same_seed_and_tick_give_the_same_draw_from_any_start():
    np.testing.assert_array_equal(draw(5, 50, 6)[30:], draw(5, 20, 6, first=30))
    assert not np.array_equal(draw(5, 5, 6), draw(6, 5, 6))
