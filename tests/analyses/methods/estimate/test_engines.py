"""The second moment of a wrench about a reading that is not its mean."""

import numpy as np

from wrenchsight.analyses.methods.estimate.engines import covariance_about, with_band_of
from wrenchsight.models.estimation.estimator import EstimateBatch


def test_the_second_moment_is_that_of_draws():
    """40,000 draws tell a variance to .7 %."""
    rng = np.random.default_rng(0)
    root, mean, reading = rng.normal(size=(6, 6)), rng.normal(size=6), rng.normal(size=6)
    draws = mean + rng.normal(size=(40_000, 6)) @ root.T - reading
    covariance = covariance_about(reading[None], mean[None], (root @ root.T)[None])[0]
    expected = draws.T @ draws / len(draws)
    np.testing.assert_allclose(covariance, expected, atol=0.03 * np.diag(covariance).max())
    np.testing.assert_array_equal(covariance, covariance.T)


def batch(rng, valid):
    """Two samples of a six-joint arm; every array another one."""
    shapes = {"wrench": (2, 6), "covariance": (2, 6, 6), "torque_sd": (2, 6), "tau_ext": (2, 6)}
    arrays = {name: rng.random(shapes.get(name, 2)) for name in EstimateBatch._fields}
    return EstimateBatch(**arrays | {"invalid": np.where(valid, 0, 1)})


def test_another_band_does_not_change_the_reading():
    """Only its band, the joints' sds and what is valid are those of the model that knows more."""
    rng = np.random.default_rng(1)
    known = batch(rng, [True, True, False])
    with_drift = batch(rng, [True, False, True])
    combined = with_band_of(known, with_drift)
    off = known.wrench[1] - with_drift.wrench[1]
    np.testing.assert_allclose(
        combined.covariance[1], with_drift.covariance[1] + np.outer(off, off), rtol=1e-12
    )
    np.testing.assert_array_equal(combined.torque_sd, with_drift.torque_sd)
    np.testing.assert_array_equal(combined.valid, [True, False, False])
    for name in set(EstimateBatch._fields) - {"covariance", "torque_sd", "invalid"}:
        np.testing.assert_array_equal(getattr(combined, name), getattr(known, name), err_msg=name)
