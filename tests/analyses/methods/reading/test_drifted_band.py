"""The second moment of a wrench about a reading that is not its mean."""

import numpy as np

from analyses.methods.reading.drifted_band import covariance_about


def test_the_second_moment_is_that_of_draws() -> None:
    """40,000 draws tell a variance to .7 %."""
    rng = np.random.default_rng(0)
    root, mean, reading = rng.normal(size=(6, 6)), rng.normal(size=6), rng.normal(size=6)
    draws = mean + rng.normal(size=(40_000, 6)) @ root.T - reading
    found = covariance_about(reading[None], mean[None], (root @ root.T)[None])[0]
    expected = draws.T @ draws / len(draws)
    np.testing.assert_allclose(found, expected, atol=0.03 * np.diag(found).max())
    np.testing.assert_array_equal(found, found.T)
