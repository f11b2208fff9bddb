"""Statistics of logs that are made so that their values are known."""

from types import SimpleNamespace

import numpy as np
import pytest

from wrenchsight.analyses.experiments.realism.arm_statistics import (
    TorqueError,
    at_rest,
    correlation_time,
    current_noise,
    drift,
    load_statistics,
    pass_repeatability,
    residual_by_speed,
)
from wrenchsight.models.recordings.recording import Recording

STEP = 0.01
RNG = np.random.default_rng(2)


def of(v, error):
    t = STEP * np.arange(len(v))
    return TorqueError(t, v, error, SimpleNamespace(), np.ones(len(v), bool))


def test_errors_are_sorted_by_the_joints_own_speed():
    v = np.stack([np.r_[np.full(500, 0.02), np.full(500, 0.5)], np.full(1000, 0.005)], axis=1)
    error = np.stack([np.r_[np.full(500, 3.0), np.full(500, -1.0)], np.full(1000, 2.0)], axis=1)
    found = residual_by_speed([of(v, error)])
    np.testing.assert_allclose(found["10_to_30_mrad_per_s"], [3.0, np.nan])
    np.testing.assert_allclose(found["above_300_mrad_per_s"], [1.0, np.nan])
    np.testing.assert_allclose(found["below_10_mrad_per_s"], [np.nan, 2.0])
    np.testing.assert_allclose(found["all"], [np.sqrt(5.0), 2.0])


def test_correlation_of_a_first_order_process():
    kept, x = np.exp(-STEP / 0.3), np.zeros((60000, 1))
    for k in range(1, len(x)):
        x[k] = kept * x[k - 1] + RNG.normal()
    # 600 s hold 1000 independent values of .3 s both ways: some percent
    assert correlation_time([of(x, x)])[0] == pytest.approx(0.3, rel=0.15)


def test_drift_is_the_rms_over_days_of_what_is_put_in():
    v = np.sin(0.7 * STEP * np.arange(4000))[:, None]
    days = [of(v, k * 2.0 * v + k * 0.5 * np.tanh(v / 0.02) + 1.0) for k in (1.0, -1.0)]
    found = drift(days)
    assert found["viscous_nms_per_rad"][0] == pytest.approx(2.0)
    assert found["dry_nm"][0] == pytest.approx(0.5)


def test_what_a_load_adds_and_what_repeats(monkeypatch):
    """The same error with noise of its own, in a log that begins 1.3 s later."""
    t = STEP * np.arange(6000)
    v = np.stack([np.sin(0.5 * t), np.cos(0.8 * t)], axis=1)
    common = np.stack([np.sin(3.1 * t), np.cos(2.2 * t)], axis=1)
    free = of(v, common)
    late = 130
    loaded = of(v[:-late], 2.0 * common[:-late])
    loaded = TorqueError(loaded.t, v[late:], 2.0 * common[late:], loaded.residual, loaded.used)
    monkeypatch.setattr(TorqueError, "without_load", lambda self: self)
    found = load_statistics(free, loaded)
    np.testing.assert_allclose(found["over_unloaded"], 2.0, rtol=0.02)
    np.testing.assert_allclose(found["difference_nm"], 0.5, rtol=0.05)  # common's rms / sqrt 2


def test_passes_of_a_joint_differ_by_what_was_put_in(ur10e):
    t = STEP * np.arange(40000)
    period = 8.0
    q, v = np.zeros((2, len(t), 6))
    phase = (t % period) / period
    q[:, 1] = np.where(phase < 0.5, 2 * phase, 2 - 2 * phase)
    v[:, 1] = np.where(phase < 0.5, 0.25, -0.25)
    number = np.floor(2 * t / period).astype(int)
    offset = RNG.normal(0.0, 0.8, number.max() + 1)[number]
    current = np.zeros((len(t), 6))
    current[:, 1] = (5.0 * np.sign(v[:, 1]) + offset) / ur10e.torque_per_ampere[1]
    log = Recording(t=t, q=q, v=v, current=current, source="passes")
    # Of 100 passes: 7 %
    assert pass_repeatability(log, ur10e, 1) == pytest.approx(0.8, rel=0.2)
    assert np.isnan(pass_repeatability(log, ur10e, 2))


def test_only_joints_that_rest_are_judged_at_rest():
    v = np.stack([np.r_[np.zeros(600), np.full(400, 0.3)], np.full(1000, 0.3)], axis=1)
    error = np.stack([np.r_[np.full(600, 2.0), np.full(400, 9.0)], np.full(1000, 5.0)], axis=1)
    np.testing.assert_allclose(at_rest(of(v, error)), [2.0, np.nan])


def test_noise_is_found_in_its_band():
    t = STEP * np.arange(20000)
    v = np.full((len(t), 6), 0.2)
    current = np.zeros_like(v)
    current[:, 0] = 0.3 * np.sin(2 * np.pi * 18.0 * t)
    current[:, 1] = RNG.normal(0.0, 0.1, len(t))
    log = Recording(t=t, q=v * t[:, None], v=v, current=current, source="noise")
    found = current_noise([log], moving=True)
    assert found["12_to_25_hz_a"][0] == pytest.approx(0.3 / np.sqrt(2), rel=0.02)
    assert found["25_to_45_hz_a"][0] < 0.01
    assert found["25_to_45_hz_a"][1] == pytest.approx(0.1 * np.sqrt(20 / 50), rel=0.05)
    assert np.isnan(current_noise([log], moving=False)["5_to_12_hz_a"]).all()
