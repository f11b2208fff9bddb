"""The emulator against figures that are known, and its draws against posteriors in closed form."""

import numpy as np
import pytest
from scipy.stats import norm

from wrenchsight.analyses.campaign.posterior import FEWEST, Emulator

ALL = np.ones(1, bool)


def emulator(drawn, off, ranges):
    return Emulator(drawn, off, np.sqrt(np.mean(np.nan_to_num(off) ** 2, axis=1)), ranges)


def test_of_a_linear_figure_with_noise_the_posterior_is_gaussian():
    """off = 3 x - 1.2 + .3 N in tolerances: x is Gaussian about .4, sqrt(1 + .3^2) / 3."""
    rng = np.random.default_rng(0)
    x = rng.uniform(-2.0, 2.0, (400, 1))
    off = 3.0 * x - 1.2 + 0.3 * rng.standard_normal(x.shape)
    item = emulator(x, off, np.array([[-2.0, 2.0]]))
    assert item.error[0] == pytest.approx(0.3, rel=0.15)  # four standard errors of 400
    draws = item.draws(ALL)[:, 0]
    for q in (0.05, 0.25, 0.5, 0.75, 0.95):
        expected = 0.4 + norm.ppf(q) * np.hypot(1.0, 0.3) / 3.0
        # Of 1500 steps 1200 count; near ones correlate: some 300 independent ones, .03 in the tail
        assert np.quantile(draws, q) == pytest.approx(expected, abs=0.15)
    np.testing.assert_array_equal(draws, item.draws(ALL)[:, 0])  # the same again
    sharp = item.draws(ALL, 25.0)[:, 0]  # a fifth as wide
    assert np.std(sharp) == pytest.approx(np.hypot(1.0, 0.3) / 15.0, rel=0.4)
    assert np.mean(sharp) == pytest.approx(0.4, abs=0.03)


def test_a_parameter_that_no_figure_determines_keeps_its_prior_range():
    rng = np.random.default_rng(1)
    ranges = np.array([[0.5, 1.5], [1.0, 3.0]])
    drawn = rng.uniform(*ranges.T, (300, 2))
    draws = emulator(drawn, np.log(drawn[:, :1] / 0.8) / 0.1, ranges).draws(ALL)
    assert np.ptp(np.quantile(draws[:, 0], [0.05, 0.95])) < 0.4  # 3.3 sd of .08 are .26
    assert np.median(draws[:, 0]) == pytest.approx(0.8, abs=0.04)
    assert np.ptp(np.quantile(draws[:, 1], [0.05, 0.95])) > 0.7 * 0.9 * 2.0
    assert np.all((draws > ranges[:, 0]) & (draws < ranges[:, 1]))


def test_squares_and_products_are_emulated():
    def off(u):
        return (1.0 + u[:, 0] - 2.0 * u[:, 0] * u[:, 1] + 1.5 * u[:, 1] ** 2)[:, None]

    rng = np.random.default_rng(2)
    ranges = np.array([[2.0, 4.0], [-1.0, 3.0]])
    u, other = rng.uniform(-1.0, 1.0, (80, 2)), rng.uniform(-1.0, 1.0, (50, 2))

    def drawn(u):
        return ranges.mean(axis=1) + 0.5 * np.ptp(ranges, axis=1) * u

    item = emulator(drawn(u), off(u), ranges)
    np.testing.assert_allclose(item.off(drawn(other)), off(other), atol=0.02)  # the least ridge
    assert item.error[0] < 0.02


def test_figures_that_no_draw_reaches_keep_the_parameters_in_their_ranges():
    rng = np.random.default_rng(3)
    drawn = rng.uniform(0.5, 1.5, (60, 4))
    off = 3.0 + drawn @ rng.normal(size=(4, 30))
    draws = emulator(drawn, off, np.tile([[0.5, 1.5]], (4, 1))).draws(np.ones(30, bool))
    assert np.isfinite(draws).all()
    assert draws.min() > 0.5 and draws.max() < 1.5


def test_a_figure_that_few_arms_have_is_emulated_from_these():
    rng = np.random.default_rng(4)
    drawn = rng.uniform(-1.0, 1.0, (100, 1))
    off = np.hstack([drawn, 2.0 * drawn - 1.0])
    off[20:, 1] = np.nan
    ranges = np.array([[-1.0, 1.0]])
    item = emulator(drawn, off, ranges)
    assert item.off(np.array([[0.25]]))[0] == pytest.approx([0.25, -0.5], abs=0.05)
    # Of one figure alone the other's zero, .5, is no aim
    alone = item.draws(np.array([True, False]))[:, 0]
    assert abs(np.median(alone)) < 0.2 < np.median(item.draws(np.array([False, True])))
    off[FEWEST - 1 :, 1] = np.nan
    with pytest.raises(ValueError, match="fewer than 12"):
        emulator(drawn, off, ranges)
