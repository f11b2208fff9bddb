"""The zero-phase low-pass and the derivative, against closed forms."""

import numpy as np
import pytest

from wrenchsight.models.signals.zero_phase import ZeroPhaseLowPass, derivative

STEP = 0.01
T = np.arange(0.0, 20.0, STEP)
MIDDLE = slice(400, -400)  # clear of the transients at both ends


@pytest.mark.parametrize("frequency", [0.5, 2.0, 5.0, 8.0])
def test_amplitude_is_the_squared_butterworth_and_there_is_no_delay(frequency):
    wave = np.cos(2 * np.pi * frequency * T)[:, None]
    out = ZeroPhaseLowPass(5.0, STEP, 5)(wave)
    # Bilinear transform: frequencies enter through tan(pi f T).
    ratio = np.tan(np.pi * frequency * STEP) / np.tan(np.pi * 5.0 * STEP)
    amplitude = 1.0 / (1.0 + ratio**10)
    # 1e-6: what is left of the transients after 4 s.
    np.testing.assert_allclose(out[MIDDLE], amplitude * wave[MIDDLE], atol=1e-6)


def test_filter_runs_along_time_whatever_the_other_axes():
    x = np.random.default_rng(0).normal(size=(500, 2, 3))
    low_pass = ZeroPhaseLowPass(5.0, STEP)
    out = low_pass(x)
    for i in range(2):
        # The same arithmetic, so to rounding.
        np.testing.assert_allclose(out[:, i], low_pass(x[:, i]), rtol=1e-12, atol=1e-12)


def test_derivative_is_exact_for_quartics_inside():
    t = np.linspace(-1.0, 1.0, 101)
    # Five-point differences are exact up to degree 4; 1e-11: rounding over a step of 0.02.
    np.testing.assert_allclose(
        derivative(t**4 - t**2, 0.02)[2:-2], (4 * t**3 - 2 * t)[2:-2], atol=1e-11
    )


def test_derivative_of_a_sine_is_short_by_what_the_docstring_says():
    wave = np.sin(2 * np.pi * 5.0 * T)
    gain = derivative(wave, STEP)[2:-2] @ np.cos(2 * np.pi * 5.0 * T)[2:-2]
    gain /= (2 * np.pi * 5.0) * np.sum(np.cos(2 * np.pi * 5.0 * T)[2:-2] ** 2)
    assert 1.0 - gain == pytest.approx(0.0003, abs=0.00005)
