"""Figures of force errors against closed forms; nothing lost in what is drawn."""

import numpy as np
import pytest

from wrenchsight.analyses.methods.reference_sensor.force_errors import (
    VariantReading,
    envelope,
    force_metrics,
    reductions,
    variants_figure,
)


def test_rmse_maximum_and_bias_of_a_known_error():
    t = np.arange(20000) / 1000.0
    reference = np.stack([np.sin(t), np.zeros_like(t), np.cos(t)], axis=1)
    error = np.stack([np.full_like(t, -2.0), 3.0 * np.sin(2 * np.pi * t), np.zeros_like(t)], axis=1)
    figures = force_metrics(reference + error, np.ones_like(error), reference)
    assert figures["rmse_x_n"] == pytest.approx(2.0)
    assert figures["bias_x_n"] == pytest.approx(-2.0)
    assert figures["rmse_y_n"] == pytest.approx(3.0 / np.sqrt(2.0))  # whole periods of a sine
    assert figures["max_error_y_n"] == pytest.approx(3.0, rel=1e-4)
    assert figures["bias_y_n"] == pytest.approx(0.0, abs=1e-9)
    assert figures["rmse_z_n"] == figures["max_error_z_n"] == 0.0


def test_correlation_of_signals_whose_correlation_is_known():
    t = np.arange(10000) / 1000.0
    reference = np.stack([np.sin(2 * np.pi * t)] * 2 + [np.zeros_like(t)], axis=1)
    lagged = np.sin(2 * np.pi * t - 1.0)  # correlation cos(1) over whole periods
    force = np.stack([lagged, -reference[:, 1], lagged], axis=1)
    figures = force_metrics(force, np.ones_like(force), reference)
    assert figures["correlation_x"] == pytest.approx(np.cos(1.0), abs=1e-9)
    assert figures["correlation_y"] == pytest.approx(-1.0)
    assert "correlation_z" not in figures  # its reference does not vary


def test_shares_inside_the_bands_of_a_gaussian_and_of_a_band_that_is_wrong():
    rng = np.random.default_rng(0)
    sd = np.tile([1.0, 2.0, 0.5], (200_000, 1))
    error = rng.normal(size=sd.shape) * sd * [1.0, 1.0, 2.0]  # Z is twice as bad as it says
    figures = force_metrics(error, sd, np.zeros_like(error))
    # Four standard errors of a share of 200,000 draws: 0.004.
    for axis in "xy":
        assert figures[f"share_in_68_band_{axis}"] == pytest.approx(0.6827, abs=4e-3)
        assert figures[f"share_in_95_band_{axis}"] == pytest.approx(0.9500, abs=4e-3)
    assert figures["share_in_95_band_z"] == pytest.approx(0.6729, abs=4e-3)  # 0.98 sd
    mean = np.mean([figures[f"share_in_95_band_{axis}"] for axis in "xyz"])
    assert figures["share_in_95_band"] == pytest.approx(mean)


def test_reductions_are_positive_when_the_error_falls():
    before = {f"{key}_{axis}_n": 4.0 for key in ("rmse", "max_error") for axis in "xyz"}
    after = before | {"rmse_y_n": 3.0, "max_error_z_n": 6.0}
    figures = reductions(before, after)
    assert figures["reduction_rmse_y_pct"] == pytest.approx(25.0)
    assert figures["reduction_max_z_pct"] == pytest.approx(-50.0)
    assert figures["reduction_rmse_x_pct"] == 0.0


def test_an_envelope_loses_no_peak():
    t = np.arange(100_000) / 1000.0
    x = np.zeros_like(t)
    x[54_321], x[77_777] = 5.0, -7.0
    at, low, high = envelope(t, x)
    assert len(at) < 2000
    assert low.min() == -7.0
    assert high.max() == 5.0
    assert at[np.argmax(high)] <= 54.321 < at[np.argmax(high) + 1]


def test_errors_are_reading_minus_reference_and_rows_keep_their_order():
    three = np.ones((5, 3))
    reading = VariantReading("a", np.arange(5.0), 3 * three, three, three)
    assert (reading.error == 2.0).all()
    metrics = {name: reading.metrics() for name in ("first", "second")}
    figure = variants_figure(metrics, {"first": "first", "second": "second"}, "title")
    axis = figure.axes[0]
    assert [label.get_text() for label in axis.get_yticklabels()] == ["first", "second"]
    assert axis.yaxis_inverted()  # the first row is on top
