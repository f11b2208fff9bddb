"""What smoothing leaves out of a fast force, from the causal reading; against the force itself."""

import numpy as np
import pytest

from wrenchsight.models.estimation.smoothing_error import MissingForce
from wrenchsight.models.observers.lag import NATURAL_FREQUENCY_HZ

STEP, K_0, BAND = 0.01, 20.0, 3.0
N = 3000


def low_passed(force: np.ndarray) -> np.ndarray:
    """As the observer reads it: a period counts with the mean of its ends."""
    out, pole = np.zeros_like(force), np.exp(-K_0 * STEP)
    for k in range(1, len(force)):
        out[k] = pole * out[k - 1] + (1.0 - pole) * 0.5 * (force[k] + force[k - 1])
    return out


def sine(frequency: float) -> np.ndarray:
    force = np.zeros((N, 6))
    force[:, 5] = 30.0 * np.sin(2.0 * np.pi * frequency * STEP * np.arange(N))
    return force


def sd_of(causal: np.ndarray, smoothed: np.ndarray, sd: float, parts: int = 1) -> np.ndarray:
    """(N, 6) sd of what is missing."""
    missing = MissingForce(K_0, STEP, BAND)
    covariance = [
        missing.covariance(
            causal[rows], smoothed[rows], np.full((len(rows), 6), sd**2), np.ones(len(rows), bool)
        )
        for rows in np.array_split(np.arange(N), parts)
    ]
    return np.sqrt(np.diagonal(np.concatenate(covariance), axis1=1, axis2=2))


@pytest.mark.parametrize(("frequency", "kept"), [(1.0, 0.5), (2.0, 0.0), (3.0, 0.7)])
def test_what_is_left_out_is_held(frequency: float, kept: float) -> None:
    """A share of a sine is kept: the rest has a size, and its power holds it."""
    force = sine(frequency)
    error = (1.0 - kept) * force[:, 5]
    sd = sd_of(low_passed(force), kept * force, 1.0)[:, 5]
    inside = np.abs(error) <= 1.96 * np.hypot(sd, 1.0)
    assert inside[50:-50].mean() > 0.9
    # Not wider than the error's own size by more than a third.
    assert np.sqrt(np.mean(sd[50:-50] ** 2)) < 1.35 * np.sqrt(np.mean(error**2))


def test_what_is_read_whole_lacks_nothing() -> None:
    force = sine(2.0)
    sd = sd_of(low_passed(force), force, 1.0)[50:]
    assert sd[:, :3].max() < 0.05
    # But springs: F'' / w_s^2 of a force of the stated bandwidth is 4.2 N.
    assert sd.max() < 4.2


@pytest.mark.parametrize(("frequency", "kept"), [(2.0, 1.0), (2.0, 0.5), (3.0, 0.5)])
def test_what_springs_turn_into_another_direction_is_held(frequency: float, kept: float) -> None:
    """At the assumed natural frequency F - F'' / w_s^2 is read, here all of F'' along x.

    What both readings show across the force, no smoothing distinguishes from a force there.
    """
    read = sine(frequency)
    turned = (frequency / NATURAL_FREQUENCY_HZ) ** 2 * read[:, 5]
    read[:, 3] = turned
    smoothed = np.array([0, 0, 0, 1.0, 0, kept]) * read
    sd = sd_of(low_passed(read), smoothed, 0.3)
    z = np.abs(turned)[50:-50] / np.hypot(sd[50:-50, 3], 0.3)
    assert np.mean(z < 1.96) > 0.95
    assert np.mean(z > 3.0) < 0.01
    # Not wider than twice the error: the share is that of the stated bandwidth.
    assert np.sqrt(np.mean(sd[:, 3] ** 2)) < 2.0 * np.sqrt(np.mean(turned**2))
    assert not sd[:, :3].any()  # moments are read as without springs


def test_noise_of_the_stated_sd_adds_little() -> None:
    """Behind K_0 the noise of the causal reading; the smoothed one has half of its sd."""
    rng = np.random.default_rng(4)
    noise = low_passed(rng.normal(size=(N, 6)))
    noise *= 2.0 / noise.std()
    sd = sd_of(noise, np.zeros((N, 6)), 2.0)
    assert np.sqrt(np.mean(sd**2)) < 0.8 * 2.0


def test_readings_that_are_no_force_and_gaps_do_not_count() -> None:
    causal, smoothed = sine(2.0), np.zeros((N, 6))
    causal[100] = np.nan
    missing = MissingForce(K_0, STEP, BAND)
    variance = np.ones((N, 6))
    assert not missing.covariance(causal, smoothed, variance, np.zeros(N, bool)).any()
    assert np.isfinite(missing.covariance(causal, smoothed, variance, np.ones(N, bool))).all()
    assert missing.covariance(causal[:0], smoothed[:0], variance[:0], np.ones(0, bool)).shape == (
        (0, 6, 6)
    )


def test_parts_show_at_their_ends_alone() -> None:
    force = sine(2.0)
    whole, parts = (sd_of(low_passed(force), 0.5 * force, 1.0, parts) for parts in (1, 2))
    away = np.abs(np.arange(N) - N // 2) > 60
    np.testing.assert_allclose(parts[away], whole[away], rtol=0.02, atol=1e-3)


def test_without_a_bandwidth_nothing_is_added() -> None:
    missing = MissingForce(K_0, STEP, 0.0)
    added = missing.covariance(sine(2.0), np.zeros((N, 6)), np.ones((N, 6)), np.ones(N, bool))
    assert not added.any()
