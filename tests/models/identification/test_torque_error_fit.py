"""The fit of the torque error's sds: what was put in comes out."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from sample_models import torque_sds

from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.presliding_friction import PreslidingFriction
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification import torque_error_fit
from wrenchsight.models.identification.torque_error_fit import (
    HeldOutReading,
    _correlation,
    _minus_log_likelihood,
    correlated_samples,
    fit_torque_error,
)
from wrenchsight.models.identification.torque_error_model import TorqueErrorModel
from wrenchsight.models.numerics.arrays import Array

N = 2
STEP = 0.01
K_0 = np.full(N, 20.0)


def law() -> PreslidingFriction:
    sliding = CoulombViscous(np.zeros(N), np.array([20.0, 3.0]), np.zeros(N))
    return PreslidingFriction(
        SemiParametricFriction(sliding),
        coulomb=np.array([20.0, 2.5]),
        stribeck=np.zeros(N),
        stribeck_velocity=np.ones(N),
        load=np.zeros(N),
        cubic=np.zeros(N),
        weight=np.ones((N, 1)),
        displacement=np.full((N, 1), 1e-4),
    )


def truth(**changes: Any) -> TorqueErrorModel:
    values: dict[str, Any] = {
        "constant": np.array([0.8, 0.12]),
        "speed": np.array([1.2, 0.2]),
        "load": np.array([0.0, 0.06]),
        "acceleration": np.zeros(N),
        "reversal": np.array([0.7, 0.4]),
        "correlation": np.array([[1.0, 0.4], [0.4, 1.0]]),
        "correlation_time": np.full(N, 0.01),
        "lasting": np.zeros(N),
        "fitted_speed": np.zeros(N),
        "fitted_load": np.zeros(N),
        "K_0": K_0,
        "resolution": np.full(N, 1e-4),
        "drift": 0.0,
    }
    return TorqueErrorModel(**(values | changes))


def reading(
    seed: int, error_model: TorqueErrorModel | None = None, T: float = 0.0
) -> HeldOutReading:
    """Errors drawn with the sds of the model, with correlation time T."""
    error_model = error_model or truth()
    rng = np.random.default_rng(seed)
    t = STEP * np.arange(6000)
    phase = rng.uniform(0.0, 6.0, 2)
    q = np.stack([0.8 * np.sin(1.1 * t + phase[0]), 0.7 * np.sin(1.7 * t + phase[1])], axis=1)
    v = np.gradient(q, STEP, axis=0)
    load = np.stack([30.0 * np.sin(0.7 * t), 5.0 * np.cos(0.5 * t + phase[0])], axis=1)
    q = np.round(q, 4)
    sd, _ = torque_sds(error_model, law(), q, v, load, STEP)
    noise = rng.normal(size=q.shape) @ np.linalg.cholesky(error_model.correlation).T
    if T > 0.0:
        a = np.exp(-STEP / T)
        for k in range(1, len(noise)):
            noise[k] = a * noise[k - 1] + np.sqrt(1.0 - a * a) * noise[k]
    return HeldOutReading(sd * noise, q, v, load, t > 1.0, law(), STEP, K_0, np.full(N, 1e-4))


def fitted(readings: list[HeldOutReading], **changes: Any) -> TorqueErrorModel:
    return fit_torque_error(readings, **changes)


def test_known_sds_are_recovered() -> None:
    error_model = fitted([reading(seed) for seed in range(3)])
    expected = truth()
    # Eighteen thousand samples: an sd is known to half a percent, a part of it to ten.
    np.testing.assert_allclose(error_model.constant, expected.constant, rtol=0.1)
    np.testing.assert_allclose(error_model.speed, expected.speed, rtol=0.1)
    assert (
        error_model.load[0] * 30.0 < 0.4 * error_model.constant[0]
    )  # none was put in: a tenth of the variance
    assert error_model.load[1] == pytest.approx(0.06, rel=0.1)
    np.testing.assert_allclose(error_model.reversal, expected.reversal, rtol=0.25)
    assert error_model.correlation[0, 1] == pytest.approx(0.4 * 0.98, abs=0.03)
    new = reading(9)
    sd, _ = torque_sds(replace(error_model, drift=0.0), law(), new.q, new.v, new.transmitted, STEP)
    inside = np.mean(np.abs(new.tau_ext) < 1.96 * sd, axis=0)
    np.testing.assert_allclose(inside, 0.95, atol=0.01)
    for low, high in ((0.0, 0.05), (0.05, 0.5), (0.5, 5.0)):
        speed = np.abs(new.v)
        chosen = (speed >= low) & (speed < high)
        share = (chosen & (np.abs(new.tau_ext) < 1.96 * sd)).sum() / chosen.sum()
        assert share == pytest.approx(0.95, abs=0.02)


def test_a_part_of_many_samples_locates_the_minimum(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same top is reached with a fraction of the work, whatever the number that is enough."""
    many = [reading(seed, T=0.02) for seed in range(8)]
    likelihood, looked_at = torque_error_fit._minus_log_likelihood, list[int]()

    def counted(A: Array, *others: Array) -> float:
        looked_at.append(len(A))
        return float(likelihood(A, *others))

    monkeypatch.setattr(torque_error_fit, "_minus_log_likelihood", counted)
    sds, work = [], []
    for enough in (10**9, torque_error_fit._ROUGH_FIT_SAMPLES):
        monkeypatch.setattr(torque_error_fit, "_ROUGH_FIT_SAMPLES", enough)
        looked_at.clear()
        fitted_model = fitted(many)
        new = reading(9)
        sds.append(torque_sds(fitted_model, law(), new.q, new.v, new.transmitted, STEP)[0])
        work.append(sum(looked_at))
    # Climbs end where a sample's likelihood grows by 1e-9, that is, of a rare state's sd by .4 %;
    # forty thousand samples know it to a percent.
    np.testing.assert_allclose(sds[0], sds[1], rtol=0.01)
    assert work[1] < 0.6 * work[0]


@pytest.mark.parametrize("size", [1.0, 1e-80, 1e80])
def test_the_fit_maximises_the_likelihood_in_any_unit(size: float) -> None:
    """Of variances so small or large that a product of few of them is no number any more."""
    rng = np.random.default_rng(3)
    A, c = rng.uniform(0.1, 2.0, (3000, 5)), rng.uniform(0.1, 2.0, 5)
    fixed, squares = size * rng.uniform(0.0, 1.0, 3000), size * rng.normal(size=3000) ** 2
    slope = np.empty(5)
    value = _minus_log_likelihood(size * A, fixed, squares, c, slope)
    s = size * A @ c + fixed
    assert value == pytest.approx(0.5 * float(np.sum(np.log(s) + squares / s)), rel=1e-12)
    expected = 0.5 * (1.0 / s - squares / s**2) @ (size * A)
    np.testing.assert_allclose(slope, expected, rtol=1e-9)


def test_the_ranges_are_those_of_the_samples_that_count() -> None:
    log, used = reading(0), np.zeros(6000, bool)
    used[1000:3000] = True
    fitted_model = fitted([replace(log, used=used)])
    np.testing.assert_array_equal(fitted_model.fitted_speed, np.abs(log.v[1000:3000]).max(axis=0))
    np.testing.assert_array_equal(
        fitted_model.fitted_load, np.abs(log.transmitted[1000:3000]).max(axis=0)
    )


def between(share: float) -> TorqueErrorModel:
    """Of two joints whose errors correlate so."""
    return truth(correlation=np.array([[1.0, share], [share, 1.0]]))


def test_what_one_motion_does_to_two_joints_is_not_the_arms() -> None:
    """Passes in lockstep turn both joints' friction round at once, here the same way, there not."""
    motions = [reading(0, between(0.9)), reading(1, between(-0.9)), reading(2, between(-0.2))]
    assert fitted(motions).correlation[0, 1] == 0.0
    assert fitted(motions[:1]).correlation[0, 1] == pytest.approx(0.9 * 0.98, abs=0.02)


def test_of_a_correlation_the_share_that_motions_have_in_common_is_left() -> None:
    error_model = fitted([reading(0, between(0.8)), reading(1, between(0.2))])
    # mean .5, its standard error .3; 6,000 samples know each to .005 and .013
    expected = 0.5 * (1.0 - (0.3 / 0.5) ** 2) * 0.98
    assert error_model.correlation[0, 1] == pytest.approx(expected, abs=0.05)


def test_a_long_log_of_one_motion_outweighs_no_other() -> None:
    """Four logs, of which the longest has ten times the samples."""
    drawn = [reading(seed, between(0.3)) for seed in range(3)]
    short = [replace(log, used=log.used & (np.arange(6000) < 700)) for log in drawn]
    long = reading(3, between(0.5))
    # mean .35, its standard error .05 and that of 600 samples, .02
    expected = 0.35 * (1.0 - (0.05 / 0.35) ** 2) * 0.98
    assert fitted([*short, long]).correlation[0, 1] == pytest.approx(expected, abs=0.05)


def test_correlations_that_do_not_fit_each_other_leave_an_inverse() -> None:
    """One joint shares .6 with three others, whose own correlations differ from log to log."""
    logs = []
    for i, j in ((1, 2), (1, 3), (2, 3)):
        R = np.full((4, 4), 0.36)
        R[0], R[:, 0] = 0.6, 0.6
        R[i, j] = R[j, i] = -0.28
        R[np.arange(4), np.arange(4)] = 1.0
        values, vectors = np.linalg.eigh(R)
        logs.append((vectors * np.sqrt(np.maximum(values, 0.0))).T)  # its squares' sum is R
    correlation = _correlation(logs)
    np.testing.assert_array_equal(correlation[1:, 1:], np.eye(3))
    # Undisturbed the smallest eigenvalue were 1 - .6 sqrt 3 = -.04.
    assert np.linalg.eigvalsh(correlation)[0] == pytest.approx(0.02, abs=1e-9)
    assert 0.5 < correlation[0, 1] < 0.6


def test_correlation_time_and_correlated_error() -> None:
    drawn = [reading(seed, T=0.3) for seed in range(3)]
    fitted_model = fitted(drawn)
    # 180 s hold 300 correlation times: some 10 % of one.
    np.testing.assert_allclose(fitted_model.correlation_time, 0.3, rtol=0.3)
    assert (fitted_model.lasting < 0.06).all()
    sd, _ = torque_sds(truth(), law(), drawn[0].q, drawn[0].v, drawn[0].transmitted, STEP)
    shifted = [
        replace(log, tau_ext=log.tau_ext + sign * 0.7 * sd)
        for log, sign in zip(drawn, (1.0, -1.0, 1.0), strict=True)
    ]
    assert (fitted(shifted).lasting > 0.15).all()


@pytest.mark.parametrize("T", [0.0, 0.2])
def test_samples_that_count_for_one(T: float) -> None:
    """Of a process of first order with the pole a they are (1 + a) / (1 - a)."""
    rng = np.random.default_rng(4)
    a = np.exp(-STEP / T) if T > 0.0 else 0.0
    logs = []
    for _ in range(20):
        x = rng.normal(size=6000)
        for k in range(1, len(x)):
            x[k] = a * x[k - 1] + np.sqrt(1.0 - a * a) * x[k]
        logs.append(x)
    # Logs of 150 and more correlation times; the sum up to the first zero is cut early by some.
    assert correlated_samples(logs) == pytest.approx((1.0 + a) / (1.0 - a), rel=0.1)
    assert correlated_samples([np.zeros(10)]) == 1.0


def test_a_short_log_does_not_call_slow_motion_exact() -> None:
    """Five seconds of an error that neither speed nor load nor acceleration makes."""
    white = truth(speed=np.zeros(N), load=np.zeros(N), reversal=np.zeros(N))
    five_seconds = (np.arange(6000) >= 1000) & (np.arange(6000) < 1500)
    shares = []
    for seed in range(20):
        log = reading(seed, white, T=0.3)
        error = fitted([replace(log, used=five_seconds)])
        rms = np.sqrt(np.mean(log.tau_ext[five_seconds] ** 2, axis=0))
        shares.append(error.constant / rms)
    # Eight independent samples and one of the prior: without it a third are below a tenth.
    assert np.min(shares) > 0.25
    assert np.mean(shares) > 0.6


def test_rest_is_wider_than_all_that_was_fitted() -> None:
    """The logs hold no rest; there the band is the law's."""
    error_model = fitted([reading(seed) for seed in range(2)])
    q = np.full((200, N), 0.1)
    _, stiction = torque_sds(error_model, law(), q, np.zeros_like(q), np.zeros_like(q), STEP)
    np.testing.assert_allclose(stiction[-1], np.array([20.0, 2.5]) / np.sqrt(3.0))


def test_without_any_error_the_floor_is_left() -> None:
    silent = replace(reading(0), tau_ext=np.zeros((6000, N)))
    floor_model = fitted([silent], least=np.array([0.01, 0.002]))
    np.testing.assert_array_equal(floor_model.constant, [0.01, 0.002])
    for share in (floor_model.speed, floor_model.load, floor_model.acceleration):
        np.testing.assert_allclose(share, 0.0, atol=1e-4)


def test_too_few_samples_and_readings_that_disagree_are_refused() -> None:
    log = reading(0)
    with pytest.raises(ValueError, match="no held-out"):
        fitted([])
    few = np.zeros(6000, bool)
    few[:50] = True
    with pytest.raises(ValueError, match="50 samples"):
        fitted([replace(log, used=few)])
    with pytest.raises(ValueError, match="disagree"):
        fitted([log, replace(log, K_0=np.full(N, 10.0))])
