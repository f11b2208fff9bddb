"""Exceedances of known distributions happen as often as the fitted tail says."""

import numpy as np
import pytest
from scipy.stats import chi, genpareto

from wrenchsight.models.signals.exceedance_tail import (
    MIN_EXCURSION_GAP,
    SHAPE_SD,
    ExceedanceTail,
    fit_exceedances,
    gaussian_tail,
    peaks_above,
)

T = 0.1


def spaced(rng, draws):
    """Independent values, one in ten samples, so far apart that each is an excursion."""
    series = np.zeros(10 * len(draws))
    series[::10] = draws
    return series


def test_the_level_of_a_rate_is_that_of_scipy():
    tail = ExceedanceTail(level=3.0, rate_per_hour=500.0, scale=0.7, shape=0.2)
    for rate in (400.0, 1.0, 0.01):
        level = tail.level_at(rate)
        assert 500.0 * genpareto.sf(level - 3.0, 0.2, scale=0.7) == pytest.approx(rate, rel=1e-9)
    exponential = ExceedanceTail(level=3.0, rate_per_hour=500.0, scale=0.7)
    assert exponential.level_at(5.0) == pytest.approx(3.0 + 0.7 * np.log(100.0))
    assert tail.level_at(1e4) == 3.0  # more often than anything was looked at


def test_an_excursion_counts_once():
    series = np.zeros(100)
    series[[10, 12, 40, 41]] = [4.0, 5.0, 6.0, 3.5]
    assert pytest.approx(5 * T) == MIN_EXCURSION_GAP
    np.testing.assert_array_equal(peaks_above(series, 3.0, T), [5.0, 6.0])
    assert len(peaks_above(series, 9.0, T)) == 0


def test_an_exponential_tail_is_found_and_reaches_a_thousand_times_further():
    rng = np.random.default_rng(3)
    runs = [spaced(rng, rng.exponential(0.8, 500)) for _ in range(4)]
    tail = fit_exceedances(runs, T)
    # 2,000 values of which two in a hundred samples are looked at: 400 excursions, 5 % of sd.
    assert tail.scale == pytest.approx(0.8, rel=0.15)
    hours = 4 * 5000 * T / 3600.0
    true_rate = 2000 / hours * np.exp(-tail.level_at(1.0) / 0.8)
    assert 0.2 < true_rate < 1.5  # no more often than stated, but for the scale's error


def test_a_shape_is_believed_as_far_as_the_excursions_show_it():
    rng = np.random.default_rng(4)
    many = fit_exceedances([spaced(rng, genpareto.rvs(0.3, size=8000, random_state=rng))], T)
    # Some 1,600 excursions tell the shape within .03.
    assert many.shape == pytest.approx(0.3, abs=0.1)
    # 30 of them, exponential, whose most likely shape is .3 by chance, tell it within .25.
    draws = 1.0 + genpareto.ppf((np.arange(30) + 0.5) / 30, 0.3)
    alone, _, _ = genpareto.fit(draws - draws.min(), floc=0.0)
    few = fit_exceedances([spaced(rng, rng.permutation(draws))], T)
    assert alone > 0.15
    assert few.shape < 0.5 * alone


def test_shape_and_scale_are_the_most_likely_ones_of_a_shape_known_within_its_sd():
    draws = 1.0 + genpareto.ppf((np.arange(400) + 0.5) / 400, 0.3)
    tail = fit_exceedances([spaced(np.random.default_rng(6), draws)], T)
    excess = draws[draws > tail.level] - tail.level
    shapes, scales = np.linspace(0.01, 0.5, 50), np.geomspace(0.5, 2.0, 60) * tail.scale
    cost = [
        [0.5 * (c / SHAPE_SD) ** 2 - genpareto.logpdf(excess, c, scale=s).sum() for s in scales]
        for c in shapes
    ]
    best = np.unravel_index(np.argmin(cost), (50, 60))
    assert tail.shape == pytest.approx(shapes[best[0]], abs=0.01)  # a step of the grid
    assert tail.scale == pytest.approx(scales[best[1]], rel=0.025)


def test_few_excursions_widen_the_tail_and_too_few_say_nothing():
    rng = np.random.default_rng(5)
    few = fit_exceedances([spaced(rng, rng.exponential(1.0, 30))], T)
    assert few.shape >= 1.0 / 30
    assert fit_exceedances([spaced(rng, rng.exponential(1.0, 5))], T) is None
    assert fit_exceedances([np.empty(0)], T) is None


def test_the_gaussian_tail_is_exceeded_less_often_than_it_says():
    tail = gaussian_tail(6, 0.2)
    for rate in (100.0, 1.0, 0.1):
        level = tail.level_at(rate)
        assert chi.sf(level, 6) * level**2 * 3600.0 / 0.2 <= rate
    # and is not far: at a level a fourth lower it would be ten times as often.
    low = 0.75 * tail.level_at(1.0)
    assert chi.sf(low, 6) * low**2 * 3600.0 / 0.2 > 10.0


@pytest.mark.parametrize("size", [1, 6, 7])
def test_the_gaussian_tail_begins_with_level_and_slope_of_chi(size):
    """Level and rate as stated; the rate's logarithm has the slope of level^2 sf(level) there."""
    tail = gaussian_tail(size, 0.2)
    assert chi.sf(tail.level, size) == pytest.approx(1e-3, rel=1e-9)
    assert tail.rate_per_hour == pytest.approx(3600.0 * 1e-3 * tail.level**2 / 0.2)
    h = 1e-4
    above, below = (np.log(x**2 * chi.sf(x, size)) for x in (tail.level + h, tail.level - h))
    # Central difference: its own error is near h^2.
    assert tail.scale == pytest.approx(-2.0 * h / (above - below), rel=1e-6)


@pytest.mark.parametrize("values", [(1.0, 1.0, 0.0, 0.0), (np.nan, 1.0, 1.0, 0.0), (1, -1, 1, 0)])
def test_an_invalid_tail_is_refused(values):
    with pytest.raises(ValueError, match="expected"):
        ExceedanceTail(*values).check()
