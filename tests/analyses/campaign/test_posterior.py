"""Rejection with regression against posteriors that are known in closed form."""

import numpy as np
import pytest
from scipy.stats import norm

from wrenchsight.analyses.campaign.posterior import FEWEST, approximate_posterior, weighted_quantile


def test_of_linear_figures_with_noise_it_is_the_gaussian_one():
    """y = 3 x + sd N, an even prior: x given y is Gaussian, mean y / 3, sd / 3."""
    rng = np.random.default_rng(0)
    x = rng.uniform(-2.0, 2.0, 6000)
    sd, seen = 0.3, 1.2
    off = (3.0 * x + sd * rng.standard_normal(len(x)) - seen)[:, None]
    ranges = np.array([[-2.0, 2.0]])
    found = approximate_posterior(x[:, None], off, ranges, 0.1)
    assert len(found.accepted) == 600
    assert found.weight.sum() == pytest.approx(1.0)
    adjusted = found.adjusted[:, 0]
    for q in (0.05, 0.25, 0.5, 0.75, 0.95):
        expected = seen / 3.0 + norm.ppf(q) * sd / 3.0
        # A quantile of 600 draws in the tail is known to .12 sd (one standard error), of .1
        assert weighted_quantile(adjusted, found.weight, q) == pytest.approx(expected, abs=0.03)
    # Without the regression they spread as far as the accepted distance lets them
    plain = x[found.accepted]
    assert np.std(plain) > 1.1 * np.std(adjusted)


def test_what_the_figures_do_not_say_stays_as_wide_as_it_was_drawn():
    rng = np.random.default_rng(1)
    drawn = rng.uniform([0.5, 1.0], [1.5, 3.0], (2000, 2))
    off = np.log(drawn[:, :1] / 0.8) / 0.1
    ranges = np.array([[0.5, 1.5], [1.0, 3.0]])
    found = approximate_posterior(drawn, off, ranges, 0.02)
    low, high = (weighted_quantile(found.adjusted[:, 0], found.weight, q) for q in (0.05, 0.95))
    assert low == pytest.approx(0.8, abs=0.02) and high == pytest.approx(0.8, abs=0.02)
    low, high = (weighted_quantile(found.adjusted[:, 1], found.weight, q) for q in (0.05, 0.95))
    assert high - low > 0.8 * 0.9 * 2.0
    assert np.all((found.adjusted > ranges[:, 0]) & (found.adjusted < ranges[:, 1]))


def test_figures_that_no_draw_reaches_keep_the_parameters_in_their_ranges():
    rng = np.random.default_rng(2)
    drawn = rng.uniform(0.5, 1.5, (60, 4))
    off = drawn @ rng.normal(size=(4, 30)) + 3.0  # far from zero, more figures than draws tell
    found = approximate_posterior(drawn, off, np.tile([[0.5, 1.5]], (4, 1)), 0.05)
    assert len(found.accepted) == FEWEST
    assert np.isfinite(found.adjusted).all()
    assert found.adjusted.min() > 0.5 and found.adjusted.max() < 1.5
    assert found.distance[found.accepted[0]] == found.distance.min()


def test_resampled_draws_are_as_likely_as_their_weights():
    rng = np.random.default_rng(3)
    drawn = rng.uniform(0.0, 1.0, (400, 1))
    found = approximate_posterior(drawn, (drawn - 0.3) / 0.05, np.array([[0.0, 1.0]]), 0.2)
    again = found.resampled(4000)[:, 0]
    for row, weight in zip(found.adjusted[:, 0], found.weight, strict=True):
        assert abs(np.sum(again == row) - 4000 * weight) <= 1.0


def test_weighted_quantiles_of_equal_weights_are_those_of_the_values():
    values = np.array([3.0, 1.0, 2.0, 4.0])
    assert weighted_quantile(values, np.ones(4), 0.5) == 2.5
    assert weighted_quantile(values, np.array([0.0, 1e9, 0.0, 0.0]), 0.5) == 1.0
