"""The inverse of a first-order low-pass, against the recursion itself."""

import numpy as np

from wrenchsight.models.signals.undone_low_pass import undone_low_pass


def test_the_inverse_restores_the_filters_input() -> None:
    x = np.random.default_rng(3).normal(size=(50, 2))
    pole = np.array([0.96, 0.5])
    y = np.zeros_like(x)
    for k in range(1, 50):
        y[k] = pole * y[k - 1] + (1.0 - pole) * x[k]
    known = np.ones(50, bool)
    known[20:23] = False
    y[20:23] = np.nan
    back, both = undone_low_pass(y, pole, known)
    assert not both[[0, 20, 21, 22, 23]].any() and both.sum() == 45
    np.testing.assert_allclose(back[both], x[both], atol=1e-12)
    assert not back[~both].any()
