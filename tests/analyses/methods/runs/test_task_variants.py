"""What is made with the truth beside the variants: lag, and friction without it."""

from types import SimpleNamespace

import numpy as np
import pytest

from analyses.methods.reading.force_errors import ForceReading
from analyses.methods.runs.task_variants import against_lagged, lag_alone

FREQUENCY, AMPLITUDE, K_0 = 2.0, 10.0, 20.0


@pytest.fixture
def run():
    """A sine of 2 Hz along Y, told by a perfect sensor."""
    t = np.arange(20_000) / 1000.0
    wrench = np.zeros((len(t), 6))
    wrench[:, 4] = AMPLITUDE * np.sin(2 * np.pi * FREQUENCY * t)
    recording = SimpleNamespace(t=t, time_step=1e-3)
    return SimpleNamespace(recording=recording, wrench_true=wrench, reference=wrench[:, 3:])


def response():
    s = 2j * np.pi * FREQUENCY
    return K_0 / (s + K_0)


def test_the_lag_of_a_sine_is_that_of_eq_30(run):
    figures = lag_alone(run, K_0)
    expected = AMPLITUDE / np.sqrt(2.0) * abs(1.0 - response())
    # The first period is still settling, and a tick of 1 ms is a hundredth of the lag.
    assert figures["rmse_y_n"] == pytest.approx(expected, rel=0.02)
    assert figures["correlation_y"] == pytest.approx(np.cos(np.angle(response())), abs=0.01)
    assert figures["rmse_x_n"] == 0.0
    assert not any(key.startswith("share") for key in figures)


def test_a_reading_that_lags_as_the_observer_does_errs_by_nothing_else(run):
    t = run.recording.t
    lagged = AMPLITUDE * np.imag(response() * np.exp(2j * np.pi * FREQUENCY * t))
    force = np.zeros((len(t), 3))
    force[:, 1] = lagged + 1.5
    late = t > 1.0  # where the low-pass has settled
    ones = np.ones_like(force)
    reading = ForceReading("a", t, force, ones, run.reference, ones[:, 0]).part(late)
    figures = against_lagged(reading, run, K_0)
    assert figures["bias_y_n"] == pytest.approx(1.5, abs=0.02)
    assert figures["rmse_y_n"] == pytest.approx(1.5, rel=0.02)
