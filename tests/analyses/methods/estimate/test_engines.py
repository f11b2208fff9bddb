"""The second moment of a wrench about a reading that is not its mean."""

import numpy as np

from wrenchsight.analyses.methods.estimate.engines import covariance_about, with_band_of
from wrenchsight.models.estimation.estimator import EstimateBatch


def test_the_second_moment_is_that_of_draws():
    """40,000 draws tell a variance to .7 %."""
    rng = np.random.default_rng(0)
    root, mean, reading = rng.normal(size=(6, 6)), rng.normal(size=6), rng.normal(size=6)
    draws = mean + rng.normal(size=(40_000, 6)) @ root.T - reading
    found = covariance_about(reading[None], mean[None], (root @ root.T)[None])[0]
    expected = draws.T @ draws / len(draws)
    np.testing.assert_allclose(found, expected, atol=0.03 * np.diag(found).max())
    np.testing.assert_array_equal(found, found.T)


def batch(rng, valid):
    """Two samples of a six-joint arm; every array another one."""
    shapes = {"wrench": (2, 6), "covariance": (2, 6, 6), "torque_sd": (2, 6), "tau_ext": (2, 6)}
    arrays = {name: rng.random(shapes.get(name, 2)) for name in EstimateBatch._fields}
    return EstimateBatch(**arrays | {"valid": np.array(valid)})


def test_another_band_does_not_change_the_reading():
    """Only its band, the joints' sds and what is valid are those of the model that knows more."""
    rng = np.random.default_rng(1)
    known = batch(rng, [True, True, False])
    wide = batch(rng, [True, False, True])
    found = with_band_of(known, wide)
    off = known.wrench[1] - wide.wrench[1]
    np.testing.assert_allclose(
        found.covariance[1], wide.covariance[1] + np.outer(off, off), rtol=1e-12
    )
    np.testing.assert_array_equal(found.torque_sd, wide.torque_sd)
    np.testing.assert_array_equal(found.valid, [True, False, False])
    for name in set(EstimateBatch._fields) - {"covariance", "torque_sd", "valid"}:
        np.testing.assert_array_equal(getattr(found, name), getattr(known, name), err_msg=name)
