"""The covariance that readings of a task state: from slow samples, lasting errors included."""

import numpy as np

from analyses.methods.arms.arm_models import covariance_at_speed


def test_only_slow_samples_count_for_a_joints_sd():
    rng = np.random.default_rng(0)
    v = rng.uniform(-1.0, 1.0, (50_000, 2))
    slow = np.abs(v) <= 0.1
    tau_ext = rng.normal(size=v.shape) * np.where(slow, [3.0, 0.5], [1.0, 2.0])
    covariance = covariance_at_speed(tau_ext, v, 0.1)
    # 5,000 slow samples a joint: 1 % standard error of an sd.
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), [3.0, 0.5], rtol=0.04)


def test_a_lasting_error_is_an_error():
    rng = np.random.default_rng(0)
    v = np.zeros((20_000, 2))
    tau_ext = rng.normal(size=v.shape) * [1.0, 2.0] + [4.0, -3.0]
    covariance = covariance_at_speed(tau_ext, v, 0.1)
    expected = [[17.0, -12.0], [-12.0, 13.0]]
    np.testing.assert_allclose(covariance, expected, rtol=0.03)


def test_it_is_positive_definite_and_falls_back_where_nothing_is_slow():
    rng = np.random.default_rng(0)
    mixing = rng.normal(size=(6, 6))
    tau_ext = rng.normal(size=(5000, 6)) @ mixing
    v = rng.uniform(0.5, 1.0, tau_ext.shape)
    covariance = covariance_at_speed(tau_ext, v, 0.1)
    np.testing.assert_allclose(covariance, tau_ext.T @ tau_ext / len(tau_ext), rtol=1e-12)
    assert np.linalg.eigvalsh(covariance).min() > 0.0
