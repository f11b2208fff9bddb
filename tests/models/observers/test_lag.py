"""Lag: J as the observer saw it, the band of a changing force, the scale."""

import numpy as np
import pytest
from sample_models import jacobian_seen

from wrenchsight.models.observers.lag import (
    LAG_POWER_SHARE,
    NATURAL_FREQUENCY_HZ,
    RATE_CORNERS,
    initial_lag_state,
    lag_settings,
    lag_tick,
    lag_update,
    observer_poles,
    see_jacobian_rows,
)
from wrenchsight.models.observers.momentum_observer import MomentumObserver, MomentumObserverConfig

STEP = 0.01
N = 4


def lag_log(settings, wrench, valid, covariance):
    """Lag and scale of samples, one after another; returns where the reading keeps pace."""
    state, keeps_pace = initial_lag_state(), np.empty(len(wrench), bool)
    for k in range(len(wrench)):
        keeps_pace[k] = lag_tick(settings, state, wrench[k], covariance[k], np.empty((2, 6)))
        lag_update(settings, state, wrench[k], valid[k])
    return keeps_pace


def motion(samples: int = 400) -> np.ndarray:
    """Some J that moves as an arm's does, up to 2 Hz."""
    rng = np.random.default_rng(0)
    t = STEP * np.arange(samples)[:, None, None]
    w, phase = rng.uniform(0.0, 12.0, (6, N)), rng.uniform(0.0, 6.0, (6, N))
    return np.asarray(np.sin(w * t + phase))


def observed(tau: np.ndarray, K_0: np.ndarray) -> np.ndarray:
    """What a momentum observer reads of an arm without inertia under a torque (N, n)."""
    config = MomentumObserverConfig(list(K_0), STEP, "trapezoidal")
    observer = MomentumObserver(config, N)
    zero = np.zeros_like(tau)
    seen, _ = observer.run(observer.initial_state(), zero, zero, zero, -tau, zero)
    return np.asarray(seen)


@pytest.mark.parametrize("K_0", [np.full(N, 15.0), np.array([5.0, 15.0, 20.0, 40.0])])
def test_a_constant_force_is_read_exactly_while_the_arm_moves(K_0: np.ndarray) -> None:
    F, J = np.array([0.3, -0.2, 0.1, 20.0, -10.0, 30.0]), motion()
    tau = np.einsum("kij,i->kj", J, F)
    seen = np.einsum("kij,i->kj", jacobian_seen(J, K_0, STEP), F)
    late = observed(tau, K_0)
    # The observer starts at zero, J_seen at J: that difference fades with the slowest pole.
    gone = int(12.0 / K_0.min() / STEP)
    np.testing.assert_allclose(seen[gone:], late[gone:], atol=1e-3)
    assert np.abs(tau[gone:] - late[gone:]).max() > 5.0


def test_an_observer_without_lag_sees_J() -> None:
    J, seen = motion(10), np.empty((10, 6, N))
    see_jacobian_rows(observer_poles(None, N, STEP), np.zeros((6, N)), J, seen)
    np.testing.assert_array_equal(seen, J)
    covariance = np.zeros((20, 6, 6))
    wrench = np.random.default_rng(1).normal(size=(20, 6))
    settings = lag_settings(None, STEP, 3.0, 0.05)
    lag_log(settings, wrench, np.ones(20, bool), covariance)
    expected = 0.05**2 * wrench[:, :, None] * wrench[:, None, :]
    np.testing.assert_allclose(covariance, expected, rtol=1e-12)


def test_a_J_that_is_lost_starts_anew() -> None:
    J = motion(30)
    J[10, 2, 1] = np.nan
    seen = jacobian_seen(J, 20.0, STEP)
    assert np.isnan(seen[10, 2, 1])
    assert np.isfinite(np.delete(seen[:, 2, 1], 10)).all()
    assert seen[11, 2, 1] == J[11, 2, 1]
    np.testing.assert_array_equal(seen[:, 0, 0], jacobian_seen(motion(30), 20.0, STEP)[:, 0, 0])


def band(
    wrench: np.ndarray, K_0: float = 20.0, bandwidth: float = 3.0, valid: bool = True
) -> np.ndarray:
    """(N, 6) sd that lag adds, without what springs do."""
    settings = lag_settings(K_0, STEP, bandwidth, 0.0)._replace(spring_share=0.0)
    covariance = np.zeros((len(wrench), 6, 6))
    lag_log(settings, wrench, np.full(len(wrench), valid), covariance)
    np.testing.assert_array_equal(covariance, covariance.transpose(0, 2, 1))
    return np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))


def low_passed(force: np.ndarray, K_0: float) -> np.ndarray:
    out, a = np.zeros_like(force), np.exp(-K_0 * STEP)
    for k in range(1, len(force)):
        out[k] = a * out[k - 1] + (1.0 - a) * 0.5 * (force[k] + force[k - 1])
    return out


@pytest.mark.parametrize("K_0", [10.0, 20.0])
def test_the_band_of_a_steady_rate_is_its_lag(K_0: float) -> None:
    t = STEP * np.arange(300)
    force = np.outer(t, [0.0, 0.0, 1.0, 40.0, 0.0, -25.0])
    read = low_passed(force, K_0)
    late = np.abs(force - read)[-1]
    # Two digital filters of one rate: half a step apart, 5 ms of 50.
    # The band's power is that of a force flat up to the bandwidth; a ramp loses nothing.
    np.testing.assert_allclose(
        band(read, K_0)[-1] * np.sqrt(LAG_POWER_SHARE), late, rtol=0.1, atol=1e-9
    )
    np.testing.assert_allclose(late[3], 40.0 / K_0, rtol=0.01)


def test_after_a_jump_the_band_holds_the_truth_from_the_time_constant_on() -> None:
    force = np.zeros((200, 6))
    force[50:, 4] = 30.0
    read = low_passed(force, 20.0)
    sd = band(read)
    inside = np.abs(force - read)[:, 4] <= 2.0 * sd[:, 4] + 1e-12
    assert inside[:50].all()
    assert inside[55:].all()
    assert not inside[50:52].any()
    assert sd[100, 4] < 0.3  # half a second later it is gone: e^-omega t of 30^2


def test_readings_that_are_not_valid_are_followed_slowly() -> None:
    wrench = np.zeros((100, 6))
    wrench[50:, 3] = 100.0
    assert band(wrench, valid=False)[60, 3] > 0.8 * 100.0 * 2.0 * np.pi * 3.0 / 20.0
    assert band(wrench)[60, 3] < 0.5 * band(wrench, valid=False)[60, 3]
    assert band(wrench)[80, 3] < 0.1 * band(wrench, valid=False)[80, 3]


def test_noise_is_not_counted_twice() -> None:
    """White torque of the stated sd adds a third, the worst case; a ramp far beyond it its lag."""
    rng = np.random.default_rng(5)
    settings = lag_settings(20.0, STEP, 3.0, 0.0)
    wrench = 2.0 * low_passed(rng.normal(size=(4000, 6)), 20.0)
    wrench /= np.std(wrench) / 2.0
    covariance = np.tile(4.0 * np.eye(6), (4000, 1, 1))
    lag_log(settings, wrench, np.ones(4000, bool), covariance)
    assert np.sqrt(np.mean(np.diagonal(covariance, axis1=1, axis2=2))) < 1.35 * 2.0
    t = STEP * np.arange(100)
    ramp = np.outer(t, np.full(6, 400.0))
    covariance = np.tile(4.0 * np.eye(6), (100, 1, 1))
    lag_log(settings, ramp, np.ones(100, bool), covariance)
    assert covariance[-1, 0, 0] == pytest.approx(
        (400.0 / 20.0) ** 2 / LAG_POWER_SHARE + 4.0, rel=0.05
    )


def test_share_is_the_integral_that_it_stands_for() -> None:
    x = (np.arange(100_000) + 0.5) / 100_000
    left = x**2 / (1.0 + (x / RATE_CORNERS) ** 2)
    assert pytest.approx(np.mean(left) / np.mean(x**2), rel=1e-6) == LAG_POWER_SHARE


def sine(frequency: float, size: float = 30.0, noise: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """A force along y, and its reading with noise of that sd behind the same low-pass."""
    t = STEP * np.arange(2000)
    force = np.zeros((2000, 6))
    force[:, 4] = size * np.sin(2.0 * np.pi * frequency * t)
    error = low_passed(np.random.default_rng(7).normal(size=(2000, 6)), 20.0)
    return force, low_passed(force, 20.0) + noise / error.std() * error


@pytest.mark.parametrize("frequency", [0.3, 1.0, 2.0, 3.0])
def test_a_sine_within_the_bandwidth_is_held_at_its_zero_crossings_too(frequency: float) -> None:
    """Its lag is of constant size, and f passes through zero: the power of a while holds it."""
    force, read = sine(frequency)
    covariance = np.tile(np.eye(6), (2000, 1, 1))
    settings = lag_settings(20.0, STEP, 3.0, 0.0)
    keeps_pace = lag_log(settings, read, np.ones(2000, bool), covariance)
    z = np.abs(read - force)[50:, 4] / np.sqrt(covariance[50:, 4, 4])
    assert np.mean(z < 1.96) > 0.93 and np.mean(z > 3.0) < 0.01
    assert keeps_pace[50:].mean() > 0.95
    # No wider than it has to be: a sine of this lag has the sd of its error within a third.
    error = np.sqrt(np.mean((read - force)[50:, 4] ** 2))
    assert np.sqrt(np.mean(covariance[50:, 4, 4])) < 1.35 * error + 0.2


@pytest.mark.parametrize(("frequency", "has_springs"), [(2.0, False), (2.0, True), (3.0, True)])
def test_springs_turn_a_part_of_the_force_and_the_band_holds_it(
    frequency: float, has_springs: bool
) -> None:
    """At the assumed natural frequency F - F'' / w_s^2 is read, here all of F'' along x."""
    force, read = sine(frequency, noise=0.3)
    share = (frequency / NATURAL_FREQUENCY_HZ) ** 2
    read[:, 3] += low_passed(share * force[:, [4]], 20.0)[:, 0]
    covariance = np.tile(0.3**2 * np.eye(6), (2000, 1, 1))
    settings = lag_settings(20.0, STEP, 3.0, 0.0)
    if not has_springs:
        settings = settings._replace(spring_share=0.0)
    lag_log(settings, read, np.ones(2000, bool), covariance)
    z = np.abs(read - force)[50:, 3] / np.sqrt(covariance[50:, 3, 3])
    assert (np.mean(z < 1.96) > 0.95 and np.mean(z > 3.0) < 0.01) == has_springs
    moment_sd = np.sqrt(covariance[50:, :3, :3].diagonal(axis1=1, axis2=2))
    assert moment_sd.mean() < 1.35 * 0.3  # moments are read as without springs
    # What the lag of 20 1/s has of them: w K_0 / w_s^2 at the stated 3 Hz.
    stated = 2.0 * np.pi * 3.0 * 20.0 / (2.0 * np.pi * NATURAL_FREQUENCY_HZ) ** 2
    assert settings.spring_share == pytest.approx(stated if has_springs else 0.0)


def test_a_force_that_is_faster_than_stated_is_not_kept_pace_with() -> None:
    _, read = sine(6.0)
    settings = lag_settings(20.0, STEP, 3.0, 0.0)
    covariance = np.tile(np.eye(6), (2000, 1, 1))
    assert lag_log(settings, read, np.ones(2000, bool), covariance)[50:].mean() < 0.05
    # A small one is lost in the noise, and in the band.
    force, read = sine(6.0, size=1.0)
    covariance = np.tile(np.eye(6), (2000, 1, 1))
    keeps_pace = lag_log(settings, read, np.ones(2000, bool), covariance)
    assert keeps_pace[50:].mean() > 0.95
    z = np.abs(read - force)[50:, 4] / np.sqrt(covariance[50:, 4, 4])
    assert np.mean(z < 1.96) > 0.9


def test_a_reading_that_lags_does_not_keep_pace_between_two_peaks_of_the_force() -> None:
    """A lag just above MAX_LAG_RATIO falls below it in each period, where the force is largest."""
    _, read = sine(9.0, size=10.0)
    settings = lag_settings(20.0, STEP, 3.0, 0.0)
    covariance = np.tile(np.eye(6), (2000, 1, 1))
    keeps_pace = lag_log(settings, read, np.ones(2000, bool), covariance)
    assert keeps_pace[50:].mean() < 0.01  # .23 with one limit for both ways
    # Once the force is gone, it keeps pace again.
    read[1000:] *= np.exp(-20.0 * STEP * np.arange(1000))[:, None]
    covariance = np.tile(np.eye(6), (2000, 1, 1))
    keeps_pace = lag_log(settings, read, np.ones(2000, bool), covariance)
    assert not keeps_pace[990:1000].any()
    assert keeps_pace[1050:].all()


def test_no_bandwidth_no_band() -> None:
    wrench = np.random.default_rng(3).normal(size=(50, 6))
    np.testing.assert_array_equal(band(wrench, bandwidth=0.0), 0.0)


@pytest.mark.parametrize(("bandwidth", "scale"), [(-1.0, 0.0), (np.nan, 0.0), (1.0, -0.1)])
def test_invalid_settings_are_refused(bandwidth: float, scale: float) -> None:
    with pytest.raises(ValueError, match="must be zero or more"):
        lag_settings(20.0, STEP, bandwidth, scale)
