"""What a drive reports of its current: lag, noise, rounding."""

import numpy as np

from wrenchsight.models.signals.current_measurement import (
    measure_current,
    report_current,
    update_lag,
)


def lag(bandwidth, time_step, current_true):
    state = np.full(current_true.shape[1], np.nan)
    lagged = []
    for sample in current_true:
        update_lag(np.full(state.shape, bandwidth), time_step, sample, state)
        lagged.append(state.copy())
    return np.array(lagged)


def test_the_lag_is_the_exact_response_to_a_held_step():
    bandwidth, T = 40.0, 1e-3
    steps = np.vstack([np.zeros((1, 2)), np.tile([1.0, -3.0], (50, 1))])
    lagged = lag(bandwidth, T, steps)
    # The tick that brings the step ends after T: its reading is that of a continuous lag at T.
    t = np.arange(51)[:, None] * T
    expected = (1.0 - np.exp(-2.0 * np.pi * bandwidth * t)) * [1.0, -3.0]
    np.testing.assert_allclose(lagged, expected, rtol=0.0, atol=1e-14)


def test_the_lag_starts_at_rest_at_the_first_current_and_inf_is_no_lag():
    np.testing.assert_array_equal(lag(10.0, 1e-3, np.full((4, 1), 7.0)), np.full((4, 1), 7.0))
    moving = np.arange(8.0).reshape(4, 2)
    np.testing.assert_array_equal(lag(np.inf, 1e-3, moving), moving)


def test_a_broken_current_keeps_the_lag_and_is_reported_as_it_is():
    state = np.array([1.0, 2.0])
    broken = np.array([np.nan, 4.0])
    update_lag(np.full(2, np.inf), 1e-3, broken, state)
    np.testing.assert_array_equal(state, [1.0, 4.0])
    report_current(np.zeros(2), np.full(2, 0.5), broken, np.zeros(2), state)
    np.testing.assert_array_equal(state, [np.nan, 4.0])


def test_noise_is_scaled_then_the_sum_is_rounded_to_the_resolution():
    current = np.array([1.0, 1.0, 1.0])
    report_current(
        np.array([0.2, 0.0, 0.2]),
        np.array([0.0, 0.3, 0.25]),
        np.ones(3),
        np.array([-1.0, 5.0, 1.0]),
        current,
    )
    np.testing.assert_allclose(current, [0.8, 0.9, 1.25], rtol=0.0, atol=1e-15)


def test_a_measurement_is_lag_noise_and_resolution_and_leaves_the_state():
    rng, T = np.random.default_rng(5), 1e-3
    table = np.array([[100.0, np.inf, 30.0], [0.1, 0.0, 0.2], [0.01, 0.5, 0.0]])
    true, noise, state = rng.normal(size=(3, 3))
    before, current = state.copy(), np.empty(3)
    measure_current(table, T, true, noise, state, current)
    np.testing.assert_array_equal(state, before)
    pole = np.exp(-2.0 * np.pi * table[0] * T)
    value = pole * before + (1.0 - pole) * true + table[1] * noise
    steps = np.array([0.01, 0.5, 1.0])
    expected = np.where(table[2] > 0.0, np.rint(value / steps) * steps, value)
    np.testing.assert_allclose(current, expected, atol=1e-14)
