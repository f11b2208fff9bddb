"""The experiment `bandwidth`."""

import numpy as np
import pytest

from wrenchsight.analyses.experiments.bandwidth.experiment import (
    OBSERVER_GAINS,
    first_order,
    measure_response,
    sampled_first_order,
    sweep_frequencies,
)

OPTIONS = {"seed": 3, "quick": True}


def gain(metrics, K_0):
    return metrics[f"K0_{K_0:g}"]


def test_formulas():
    """Eq. 30 at its corner, and the sampled observer's as its step response says."""
    corner = 20.0 / (2.0 * np.pi)
    assert first_order(20.0, corner) == pytest.approx((1.0 - 1.0j) / 2.0, abs=1e-15)
    K_0, T, f = 100.0, 1e-3, 79.6
    # A filter of the tick's mean, run in time.
    t = np.arange(4000) * T
    w = 2.0 * np.pi * f
    mean = np.concatenate([[0.0], (np.cos(w * t[:-1]) - np.cos(w * t[1:])) / (w * T)])
    a, out = np.exp(-K_0 * T), np.zeros(t.size)
    for k in range(1, t.size):
        out[k] = a * out[k - 1] + (1.0 - a) * mean[k]
    late = slice(1000, None)
    basis = np.column_stack([np.sin(w * t), np.cos(w * t)])[late]
    (inphase, quadrature), *_ = np.linalg.lstsq(basis, out[late])
    assert sampled_first_order(K_0, f, T) == pytest.approx(inphase + 1j * quadrature, abs=1e-9)
    # It tends to eq. 30 as the tick gets short.
    assert sampled_first_order(K_0, f, 1e-6) == pytest.approx(first_order(K_0, f), abs=1e-6)


@pytest.mark.parametrize("lowest", [0.1, 0.5])
def test_the_sweep_covers_every_gain_with_orthogonal_tones(lowest):
    frequency = sweep_frequencies(OBSERVER_GAINS, lowest)
    assert frequency[0] == pytest.approx(lowest)
    np.testing.assert_allclose(frequency / lowest, np.round(frequency / lowest), atol=1e-9)
    assert frequency[-1] < 500.0  # half the sampling frequency
    for K_0 in OBSERVER_GAINS:
        of_gain = sweep_frequencies([K_0], lowest)
        assert set(of_gain.round(6)) <= set(frequency.round(6)) | set(of_gain[:-1].round(6))
        assert 5.0 * K_0 / (2.0 * np.pi) <= of_gain[-1] <= 5.0 * K_0 / (2.0 * np.pi) + lowest
        assert of_gain[-1] in frequency


def test_amplitude_and_phase_are_those_of_eq_30(metrics):
    """The figures to reach: 1 % and 1 degree, from the lowest tone to five times the corner."""
    assert metrics["max_amplitude_error_pct"] < 1.0
    assert metrics["max_phase_error_deg"] < 1.0
    for K_0 in OBSERVER_GAINS:
        gain_metrics = gain(metrics, K_0)
        f = np.array(gain_metrics["frequency_hz"])
        assert f[-1] >= 5.0 * K_0 / (2.0 * np.pi)
        exact = 1.0 / (1.0 + 2j * np.pi * f / K_0)
        np.testing.assert_allclose(gain_metrics["amplitude"], np.abs(exact), rtol=0.01)
        np.testing.assert_allclose(gain_metrics["phase_deg"], np.angle(exact, deg=True), atol=1.0)
        # Nothing is hidden in the tolerance: what is left is the sampling, known in closed form.
        assert gain_metrics["max_deviation_from_sampled_pct"] < 0.01


def test_one_tick_of_delay_would_be_seen(sts):
    """At 1 kHz and 80 Hz a tick is 29 degrees; ten times slower sampling shows its own formula."""
    (response,) = measure_response(sts, [20.0], 2.0, time_step=5e-3)
    sampled = np.angle(response.sampled_formula / response.formula, deg=True)
    measured = np.angle(response.response / response.formula, deg=True)
    np.testing.assert_allclose(measured, sampled, atol=0.05)
    assert np.abs(sampled).max() > 0.2


def test_step_ramp_and_sine(metrics):
    for K_0 in OBSERVER_GAINS:
        gain_metrics = gain(metrics, K_0)
        assert gain_metrics["step"]["time_constant_s"] == pytest.approx(1.0 / K_0, rel=0.01)
        assert gain_metrics["step"]["rise_time_s"] == pytest.approx(np.log(9.0) / K_0, rel=0.01)
        assert gain_metrics["ramp"]["lag_n"] == pytest.approx(10.0 / K_0, rel=0.01)
        exact = K_0 / (K_0 + 2j * np.pi * 2.0)
        assert gain_metrics["sine"]["amplitude"] == pytest.approx(abs(exact), rel=0.01)
        assert gain_metrics["sine"]["phase_deg"] == pytest.approx(
            np.angle(exact, deg=True), abs=0.5
        )


def test_noise_grows_with_the_gain_as_the_current_says(metrics):
    sds = np.array([gain(metrics, K_0)["noise_sd_n"] for K_0 in OBSERVER_GAINS])
    assert np.all(np.diff(sds, axis=0) > 0.0)
    for K_0, sd in zip(OBSERVER_GAINS, sds, strict=True):
        # Independent samples of a low-passed noise: about K_0 / 2 a second, for four seconds.
        tolerance = 4.0 / np.sqrt(2.0 * 2.0 * K_0)
        np.testing.assert_allclose(sd, gain(metrics, K_0)["formula_noise_sd_n"], rtol=tolerance)
