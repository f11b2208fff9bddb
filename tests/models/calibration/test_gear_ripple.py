"""When a log shows that gears ripple as they did not at the identification."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import multivariate_normal

from wrenchsight.models.calibration import gear_ripple
from wrenchsight.models.calibration.gear_ripple import GearRipple, find_ripple
from wrenchsight.models.calibration.residual_noise import ResidualRows
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.numerics.arrays import Array

N = 3
LAW = CoulombViscous(np.array([12.0, 5.0, 2.5]), np.array([20.0, 12.0, 3.0]), np.zeros(N))
NAMES = ("shoulder", "elbow", "wrist")
SD = np.array([1.0, 0.4, 0.25])  # N m, of the model's residual
KNOWN_SD = 0.5 * SD
RATE = np.full(N, 20.0)  # 1/s
STEP = 0.002  # s, of the exact low-pass


def motion(seed: int, duration: float = 20.0, span: float = 0.3) -> tuple[Array, Array, Array]:
    """t, q and v of slow motion to and fro, every STEP; each joint turns by `span` rad."""
    rng = np.random.default_rng([seed, 1])
    t = np.arange(0.0, duration, STEP)
    omega, phase = 2.0 * np.pi / rng.uniform(7.0, 12.0, N), rng.uniform(0.0, 6.0, N)
    angle = omega * t[:, None] + phase
    return t, 0.5 * span * np.sin(angle), 0.5 * span * omega * np.cos(angle)


def seen(torque: Array) -> Array:
    """A torque (N, n) through the observer's low-pass, step by step."""
    keep = np.exp(-RATE * STEP)
    parts = [
        lfilter([1.0 - keep[j]], [1.0, -keep[j]], part, zi=[keep[j] * part[0]])[0]
        for j, part in enumerate(torque.T)
    ]
    return np.column_stack(parts)


def rows_of(
    seed: int, amplitude: Array, periods: float = 50.0, **kind: float
) -> tuple[ResidualRows, Array]:
    """Rows at 10 Hz with noise of their stated covariance, and a ripple; their angles."""
    t, q, v = motion(seed, **kind)
    ripple = seen(amplitude * np.sin(periods * q + np.arange(N)))
    at = slice(round(0.5 / STEP), None, round(0.1 / STEP))
    t, q, v, ripple = t[at], q[at], v[at], ripple[at]
    sliding = np.stack([np.sign(v), v, np.ones_like(v)], axis=2)
    rows = ResidualRows(
        t,
        v,
        ripple,
        LAW.coulomb * np.sign(v),
        LAW.viscous * v,
        np.broadcast_to(LAW.coulomb, v.shape),
        sliding,
        SD,
    )
    rng, residual = np.random.default_rng([seed, 2]), ripple.copy()
    for j in range(N):
        # At rest any torque within the stiction: here none, so that white and slow noise remain.
        moving = replace(rows, stiction=np.zeros_like(v))
        residual[:, j] += np.linalg.cholesky(moving.covariance(j)) @ rng.normal(size=len(t))
    return replace(rows, residual=residual), q


def found(rows: ResidualRows, q: Array, known_sd: Array = KNOWN_SD) -> GearRipple:
    other = np.cos(q)[:, :, None] * np.array([1.0, 0.0])  # gravity of an uncertain mass
    return find_ripple(rows, q, LAW, known_sd, RATE, other, 0.1 * np.ones(2))


def test_gears_that_do_not_ripple_are_not_said_to() -> None:
    """Told at odds of 100 with a prior of 1/30: of 20 logs 20 / 3000 at most are expected."""
    for seed in range(20):
        assert not found(*rows_of(seed, np.zeros(N))).is_shown


def test_ripple_is_named_with_its_size_and_number() -> None:
    amplitude = np.array([2.5, 1.0, 0.0])
    for seed in range(5):
        ripple = found(*rows_of(seed, amplitude))
        assert ripple.is_shown
        assert (ripple.probability[:2] > 0.99).all() and ripple.probability[2] < 0.5
        # The mean square of an amplitude holds its variance; 4 standard errors of ten numbers.
        error = ripple.amplitude[:2] - amplitude[:2]
        assert (np.abs(error) < 4.0 * ripple.amplitude_sd[:2] + 0.1 * amplitude[:2]).all()
        np.testing.assert_allclose(ripple.periods[:2], 50.0, atol=4.0)
        np.testing.assert_allclose(
            ripple.torque_sd[:2], np.sqrt(0.5 * ripple.probability[:2]) * ripple.amplitude[:2]
        )
        line = ripple.sentence(NAMES)
        assert "shoulder 2." in line and "times a turn" in line and "elbow" in line
        assert "wrist" not in line


def test_less_than_a_period_is_shown_by_all_joints_together() -> None:
    """.11 rad are .9 periods of 50 a turn: no joint shows it alone, and three do."""
    shown = 0
    for seed in range(6):
        rows, q = rows_of(seed, np.array([2.0, 0.8, 0.5]), duration=12.0, span=0.11)
        shown += found(rows, q).is_shown
    assert shown >= 5


def test_periods_are_no_surer_than_the_angle_turns() -> None:
    """A tenth of a period over the joint's angle, however small the noise."""
    rows, q = rows_of(0, np.array([2.5, 1.0, 0.6]))
    ripple = found(rows, q)
    assert (ripple.periods_sd >= 0.1 * 2.0 * np.pi / np.ptp(q, axis=0)).all()


def test_what_the_model_states_already_is_not_told() -> None:
    """A model of logs with ripple has it in its error's constant part: 2.5 / sqrt(2) N m."""
    rows, q = rows_of(0, np.array([2.5, 1.0, 0.6]))
    assert found(rows, q).is_shown
    assert not found(rows, q, known_sd=np.array([2.0, 0.8, 0.5])).is_shown


def test_other_things_that_depend_on_the_angle_are_no_ripple() -> None:
    """A mass that is off, friction that has drifted, and an offset."""
    for seed in range(5):
        rows, q = rows_of(seed, np.zeros(N))
        more = 0.3 * SD * np.sign(rows.v) + 2.0 * SD * np.cos(q + 0.5) + SD
        assert not found(replace(rows, residual=rows.residual + more), q).is_shown


@pytest.mark.parametrize("periods", [30.0, 50.0, 80.0])
def test_factor_is_the_ratio_of_normal_likelihoods(periods: float) -> None:
    """Against multivariate normal densities of the same rows, written out in full."""
    rows, q = rows_of(3, np.array([1.0, 0.0, 0.0]), duration=6.0)
    j, column_sd = 0, np.array([0.6, 6.0, 3.0])
    columns = rows.drift[:, j]
    log_factor, square, variance = gear_ripple._joint_ripple(
        rows,
        j,
        q=q[:, j],
        rate=RATE[j],
        columns=columns,
        column_sd=column_sd,
        periods=np.array([periods]),
    )
    C = rows.covariance(j)
    lower = np.linalg.cholesky(C)
    scale, _ = gear_ripple._fitted(
        np.linalg.solve(lower, columns) * column_sd, np.linalg.solve(lower, rows.residual[:, j])
    )
    wave = np.exp(1j * periods * q[:, j]) / (1.0 + 1j * periods * rows.v[:, j] / RATE[j])
    fast = np.abs(rows.v[:, j])
    wave = np.where((fast >= 0.01) & (periods * fast <= 15.0), wave, 0.0)
    W = np.column_stack([wave.real, wave.imag])
    without = scale**2 * C + (columns * column_sd**2) @ columns.T
    with_ripple = without + SD[j] ** 2 * W @ W.T
    residual = rows.residual[:, j]
    expected = [
        multivariate_normal(np.zeros(len(residual)), V).logpdf(residual)
        for V in (with_ripple, without)
    ]
    np.testing.assert_allclose(log_factor[0], expected[0] - expected[1], rtol=1e-6, atol=1e-8)
    # Mean and covariance of the two amplitudes, by conditioning.
    gain = SD[j] ** 2 * W.T @ np.linalg.inv(with_ripple)
    covariance = SD[j] ** 2 * (np.eye(2) - gain @ W)
    np.testing.assert_allclose(
        square[0], np.sum((gain @ residual) ** 2) + np.trace(covariance), rtol=1e-6
    )
    np.testing.assert_allclose(variance[0], 0.5 * np.trace(covariance), rtol=1e-6)


def test_joints_at_rest_say_nothing() -> None:
    rows, q = rows_of(0, np.array([2.5, 1.0, 0.6]))
    still = replace(rows, v=np.zeros_like(rows.v))
    ripple = found(still, np.zeros_like(q))
    assert not ripple.is_shown
    np.testing.assert_allclose(ripple.log_odds, np.log(gear_ripple.PRIOR_ODDS), atol=1e-9)
