"""Balanced weights of `force_only`: closed form, Monte Carlo, stiction, singular postures."""

from typing import Any

import numpy as np
import pytest

from wrenchsight.models.estimation.wrench import (
    WrenchEstimate,
    WrenchReconstruction,
    WrenchReconstructionConfig,
)
from wrenchsight.models.estimation.wrench_prior import UNKNOWN_SD
from wrenchsight.models.numerics.arrays import Array

N = 7
SD = np.array([2.5, 0.4, 1.1, 0.3, 0.9, 0.2, 1.6])  # N m, of the sample
USUAL = np.array([0.5, 1.2, 1.0, 0.8, 0.3, 0.7, 0.6])  # N m, over all states


def correlation() -> Array:
    A = np.random.default_rng(3).normal(size=(N, N))
    R = A @ A.T + 3.0 * np.eye(N)
    size = np.sqrt(np.diag(R))
    return np.asarray(R / np.outer(size, size))


def posture(seed: int = 4) -> Array:
    return np.random.default_rng(seed).normal(size=(6, N))


def read(
    J: Array, tau: Array, held: Array | None = None, usual: Any = USUAL, **settings: float
) -> WrenchEstimate:
    config = WrenchReconstructionConfig("force_only", **settings)
    lead = tau.shape[:-1]
    reconstruction = WrenchReconstruction(config, correlation(), usual)
    return reconstruction.reconstruct(
        np.broadcast_to(J, (*lead, 6, N)), tau, np.broadcast_to(SD, tau.shape), held
    )


def balanced_gain(J: Array, force_sd: float = np.inf) -> Array:
    """(3, N), by the normal equations."""
    weights = np.sqrt(SD * USUAL)
    precision = np.linalg.inv(np.outer(weights, weights) * correlation())
    A = J[3:]
    return np.asarray(np.linalg.solve(A @ precision @ A.T + np.eye(3) / force_sd**2, A @ precision))


def test_the_force_is_weighted_by_the_means_and_its_covariance_is_that_of_the_sample() -> None:
    J, tau = posture(), np.random.default_rng(5).normal(size=N)
    reading = read(J, tau)
    gain, errors = balanced_gain(J), np.outer(SD, SD) * correlation()
    np.testing.assert_allclose(reading.wrench[3:], gain @ tau, rtol=1e-9)
    np.testing.assert_allclose(reading.covariance[3:, 3:], gain @ errors @ gain.T, rtol=1e-9)
    assert not reading.wrench[:3].any()
    assert not reading.covariance[:3].any() and not reading.covariance[:, :3].any()


def test_the_stated_covariance_is_that_of_many_readings() -> None:
    """20,000 draws tell a variance to 1 %; 5 % is five times that."""
    J, rng, force = posture(), np.random.default_rng(6), np.array([10.0, -20.0, 5.0])
    root = SD[:, None] * np.linalg.cholesky(correlation())
    tau = J[3:].T @ force + rng.normal(size=(20_000, N)) @ root.T
    reading = read(J, tau)
    error = reading.wrench[:, 3:] - force
    np.testing.assert_allclose(error.mean(axis=0), 0.0, atol=5.0 * error.std(axis=0).max() / 141.0)
    stated = reading.covariance[0, 3:, 3:]
    ratios = np.linalg.eigvals(np.linalg.solve(stated, error.T @ error / len(error)))
    np.testing.assert_allclose(ratios, 1.0, atol=0.05)
    # The information that the weights claim is not that of these errors.
    weights = np.sqrt(SD * USUAL)
    claimed = J[3:] @ np.linalg.inv(np.outer(weights, weights) * correlation()) @ J[3:].T
    assert np.abs(np.linalg.eigvals(claimed @ stated) - 1.0).max() > 0.3


def test_usual_sds_in_proportion_to_the_samples_are_full_weights() -> None:
    J, tau = posture(), np.random.default_rng(5).normal(size=N)
    full, alike = read(J, tau, usual=None), read(J, tau, usual=3.0 * SD)
    np.testing.assert_allclose(alike.wrench, full.wrench, rtol=1e-9)
    np.testing.assert_allclose(alike.covariance, full.covariance, rtol=1e-9)


def test_a_joint_that_is_off_by_more_than_its_state_says_moves_the_force_less() -> None:
    """The last joint but one states .2 N m where .7 are usual, and is off by 3."""
    J, tau = posture(), np.zeros(N)
    tau[5] = 3.0
    full, balanced = read(J, tau, usual=None), read(J, tau)
    assert np.linalg.norm(balanced.wrench) < 0.9 * np.linalg.norm(full.wrench)


def test_what_stiction_feigns_goes_through_the_balanced_gain() -> None:
    J, held = posture(), SD * np.linspace(0.2, 0.9, N)
    live = {"live_force_sd": 60.0, "live_moment_sd": 3.0, "max_force_sd": 1e3}
    gain = balanced_gain(J, 60.0)
    feigned = float(np.sqrt(3.0 * np.linalg.eigvalsh(gain @ np.diag(held**2) @ gain.T)[-1]))
    for limit, expected in ((1.0001 * feigned, True), (0.9999 * feigned, False)):
        reading = read(J, np.ones(N), held, max_stiction_force=limit, **live)
        assert bool(reading.valid) is expected


def test_valid_rests_on_the_live_prior_and_on_the_samples_errors() -> None:
    J = posture()
    gain, errors = balanced_gain(J, 60.0), np.outer(SD, SD) * correlation()
    left = np.eye(3) - gain @ J[3:].T
    worst = float(np.sqrt(np.linalg.eigvalsh(gain @ errors @ gain.T + 60.0**2 * left @ left.T)[-1]))
    for limit, expected in ((1.0001 * worst, True), (0.9999 * worst, False)):
        reading = read(J, np.ones(N), live_force_sd=60.0, live_moment_sd=3.0, max_force_sd=limit)
        assert bool(reading.valid) is expected


def test_a_direction_that_no_joint_feels_stays_unknown() -> None:
    J, blind = posture(), np.array([0.0, 0.0, 0.0, 0.0, 0.6, 0.8])
    J = J - np.outer(blind, blind @ J)
    reading = read(J, np.ones(N), live_force_sd=60.0, live_moment_sd=3.0)
    assert np.isfinite(reading.wrench).all()
    assert abs(blind @ reading.wrench) < 0.1  # of an sd of 1e6: rounding of a gain of 1e12
    # Rounding of J, 1e-16, beside 1e-6: a hundredth of the variance, also by full weights.
    assert blind @ reading.covariance @ blind == pytest.approx(UNKNOWN_SD**2, rel=0.03)
    assert not reading.valid


@pytest.mark.parametrize("usual", [0.0, -1.0, np.nan, np.inf])
def test_usual_sds_must_be_numbers_above_zero(usual: float) -> None:
    usual_sd = USUAL.copy()
    usual_sd[2] = usual
    with pytest.raises(ValueError, match="usual_sd"):
        WrenchReconstruction(WrenchReconstructionConfig("force_only"), correlation(), usual_sd)
