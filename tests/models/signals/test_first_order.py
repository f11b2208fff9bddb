"""The low-pass of an observer's pole, against scipy's."""

import numpy as np
from scipy.signal import lfilter

from wrenchsight.models.signals.first_order import low_pass


def test_low_pass_is_scipys():
    x = np.random.default_rng(0).normal(size=(50, 2, 3))
    keep = np.array([0.9, 0.5])
    smoothed = x.copy()
    low_pass(keep, np.full((2, 3), np.nan), smoothed)
    for j in range(2):
        b, a = [1.0 - keep[j]], [1.0, -keep[j]]
        expected = lfilter(b, a, x[1:, j], axis=0, zi=keep[j] * x[:1, j])[0]
        np.testing.assert_allclose(smoothed[1:, j], expected, rtol=1e-12)
        np.testing.assert_array_equal(smoothed[0, j], x[0, j])


def test_the_filter_holds_over_values_that_are_not_finite():
    x = np.array([np.nan, 1.0, np.nan, 2.0, np.inf]).reshape(5, 1, 1)
    memory = np.full((1, 1), np.nan)
    low_pass(np.array([0.5]), memory, x)
    np.testing.assert_array_equal(x.ravel(), [0.0, 1.0, 1.0, 1.5, 1.5])
    assert memory[0, 0] == 1.5
