"""Super-twisting observer: closed form of its approach, finite time, no chatter, its ODE."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from wrenchsight.models.observers.observer import (
    CTV,
    GRAVITY,
    MOMENTUM,
    NUM_SIGNALS,
    TAU_EXT,
    TAU_F,
    TAU_J,
    ModelKnowledge,
    WrenchPrior,
)
from wrenchsight.models.observers.super_twisting_observer import (
    LEVANT_1,
    LEVANT_2,
    RATE,
    SuperTwistingObserver,
    SuperTwistingObserverConfig,
)

T = 1e-3
L = 40.0  # N m/s
CONFIG = SuperTwistingObserverConfig([L], T)
NO_J = np.zeros((6, 1))


def read(observer: SuperTwistingObserver, impulse: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """tau_ext (rows, n) of an arm that an external torque has given these momenta (rows, n), beside
    gravity and motor torque that vary; and which rows are fresh."""
    rows, n = impulse.shape
    t = T * np.arange(rows)[:, None]
    signals = np.zeros((rows, NUM_SIGNALS, n))
    signals[:, GRAVITY], signals[:, CTV] = 5.0 * np.sin(3.0 * t), 0.3 * np.cos(7.0 * t)
    signals[:, TAU_F], signals[:, TAU_J] = 2.0, 20.0 * np.sign(np.sin(40.0 * t))
    model = signals[:, CTV] - signals[:, GRAVITY] - signals[:, TAU_F]
    u = T * (0.5 * (model[1:] + model[:-1]) + signals[:-1, TAU_J])  # torque is held
    signals[:, MOMENTUM] = impulse
    signals[1:, MOMENTUM] += np.cumsum(u, axis=0)
    state, fresh = observer.initial_state(), np.empty(rows, bool)
    for k in range(rows):
        fresh[k] = observer.kernels.output(observer.table, state, signals[k], NO_J)
        observer.kernels.update(observer.table, state, signals[k], NO_J)
    return signals[:, TAU_EXT], fresh


def test_a_step_is_approached_at_k2_and_then_held_exactly() -> None:
    tau, rows = 5.0, 2000
    t = T * np.arange(rows)[:, None]
    found, fresh = read(SuperTwistingObserver(CONFIG, 1), tau * t)
    k_2 = LEVANT_2 * L
    approach = int(tau / k_2 / T)  # e is positive until tau_ext_hat is tau, and after
    line = k_2 * t[: approach + 1]
    np.testing.assert_allclose(found[: approach + 1], line, atol=1e-9)
    assert not fresh[: approach + 1].any()
    # The overshoot ends: error and e are zero, and stay so to rounding. No chatter of k_2 T.
    settled = found[1000:, 0]
    np.testing.assert_allclose(settled, tau, atol=1e-9)
    assert fresh[1000:].all()


def test_it_is_its_differential_equation() -> None:
    """Against the continuous observer (adaptive Runge-Kutta), before e reaches zero again."""
    tau = 5.0
    k_1, k_2 = LEVANT_1 * np.sqrt(L), LEVANT_2 * L

    def flow(_: float, x: np.ndarray) -> list[float]:
        e, estimate = x
        side = np.sign(e)
        return [tau - estimate - k_1 * np.sqrt(abs(e)) * side, k_2 * side]

    stop = 0.15
    exact = solve_ivp(flow, (0.0, stop), [1e-12, 0.0], rtol=1e-9, atol=1e-12, max_step=1e-3)
    t = T * np.arange(int(stop / T) + 1)
    found, _ = read(SuperTwistingObserver(CONFIG, 1), tau * t[:, None])
    expected = np.interp(t, exact.t, exact.y[1])
    # A first-order method: one period's change.
    np.testing.assert_allclose(found[:, 0], expected, atol=2.0 * k_2 * T)


@pytest.mark.parametrize("share", [0.3, 0.95])
def test_what_changes_slower_than_its_bound_is_read_without_a_lag(share: float) -> None:
    t = T * np.arange(4000)[:, None]
    rate = 2.0 * np.pi * 1.0
    size = share * L / rate
    truth = size * np.sin(rate * t)
    found, fresh = read(SuperTwistingObserver(CONFIG, 1), size / rate * (1.0 - np.cos(rate * t)))
    error = np.abs(found - truth)[2000:]
    # The estimate is of the mean over the last period: half a period's change, L T / 2 at most.
    assert error.max() < 0.51 * share * L * T
    assert fresh[2000:].all()


def test_what_changes_faster_is_read_late() -> None:
    t = T * np.arange(3000)[:, None]
    pushed = np.maximum(t - 1.0, 0.0)
    found, fresh = read(SuperTwistingObserver(CONFIG, 1), 20.0 * pushed)
    assert fresh[900:1000].all() and not fresh[1020:1200].any()  # and it knows
    k_2 = LEVANT_2 * L
    np.testing.assert_allclose(found[1200, 0], 0.2 * k_2, rtol=0.01)  # a step is a ramp of k_2


def test_a_hole_holds_the_estimate_and_costs_two_rows() -> None:
    t = T * np.arange(3000)[:, None]
    impulse = 5.0 * t
    impulse[1500] = np.nan
    found, fresh = read(SuperTwistingObserver(CONFIG, 1), impulse)
    np.testing.assert_allclose(found[1400:], 5.0, atol=1e-9)
    np.testing.assert_array_equal(np.flatnonzero(~fresh[1400:]) + 1400, [1500, 1501])


def test_its_rate_comes_from_the_torque_error_or_is_stated() -> None:
    sd = np.array([1.0, 0.2])
    known = ModelKnowledge(None, sd, np.ones(2), WrenchPrior(1.0, 1.0, 1.0, 1.0))
    own = SuperTwistingObserver(SuperTwistingObserverConfig(), 2).informed(known)
    np.testing.assert_allclose(own.torque_rate, RATE * sd)
    stated = SuperTwistingObserver(CONFIG, 2).informed(known)
    np.testing.assert_allclose(stated.torque_rate, L)
    other = own.with_parameters({"torque_rate": np.array([7.0, 9.0])})
    np.testing.assert_allclose(other.parameters["torque_rate"], [7.0, 9.0])


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"torque_rate": [-1.0]}, "torque_rate must be positive"),
        ({"torque_rate": [1.0, 2.0, 3.0]}, "1 or 2 values"),
        ({"time_step": 0.0}, "time_step must be positive"),
        ({"torque_samples": "seldom"}, "torque_samples must be held or trapezoidal"),
    ],
)
def test_bad_settings(change: dict[str, object], problem: str) -> None:
    with pytest.raises(ValueError, match=problem):
        SuperTwistingObserver(replace(CONFIG, **change), 2)  # type: ignore[arg-type]
