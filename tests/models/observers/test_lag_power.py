"""The lateness of a low-pass behind a force of known bandwidth, against the force itself."""

import numpy as np
import pytest
from scipy.signal import lfilter

from wrenchsight.models.observers.lag_power import LAG_POWER_SHARE, LagPower

STEP, BAND, K_0 = 1e-3, 3.0, 20.0


@pytest.fixture(scope="module")
def force():
    """(N, 6) with a spectrum that is flat up to BAND, and nothing above; 10 N each."""
    N = 200_000
    rng = np.random.default_rng(2)
    f = np.fft.rfftfreq(N, STEP)
    spectrum = (rng.normal(size=(6, len(f))) + 1j * rng.normal(size=(6, len(f)))) * (f <= BAND)
    x = np.fft.irfft(spectrum, N).T
    return 10.0 * x / x.std(axis=0)


def low_passed(x, K_0=K_0):
    pole = np.exp(-K_0 * STEP)
    return lfilter([1.0 - pole], [1.0, -pole], x, axis=0)


def added(wrench, noise, K_0=K_0, parts=1):
    lag, covariance = LagPower(K_0, STEP, BAND), np.zeros((len(wrench), 6, 6))
    for rows in np.array_split(np.arange(len(wrench)), parts):
        part = slice(rows[0], rows[-1] + 1)
        lag.add(wrench[part], noise[part], covariance[part])
    return covariance


def test_share_is_the_integral_that_it_stands_for():
    x = (np.arange(100_000) + 0.5) / 100_000
    assert pytest.approx(np.mean(x**2 / (1.0 + x**2)) / np.mean(x**2), rel=1e-6) == LAG_POWER_SHARE


def test_the_stated_power_is_that_of_the_lateness_and_holds_most_of_it(force):
    read = low_passed(force)
    covariance = added(read, np.zeros_like(read))
    late = (force - read)[1000:]
    variance = np.diagonal(covariance, axis1=1, axis2=2)[1000:]
    # 200 s at 3 Hz: 1,200 independent values an axis, 2 % of their power; the discrete poles 1 %
    np.testing.assert_allclose(variance.mean(axis=0), np.mean(late**2, axis=0), rtol=0.08)
    inside = np.mean(np.abs(late) <= 1.96 * np.sqrt(variance))
    # .886: the power of a third of a second is itself uncertain; .72 with f of the instant.
    assert 0.86 < inside < 0.98


def test_forces_that_change_together_are_late_together(force):
    read = low_passed(np.repeat(force[:20_000, :1], 6, axis=1))
    last = added(read, np.zeros_like(read))[-1]
    np.testing.assert_allclose(last, last[0, 0])


def test_forces_that_change_against_each_other_are_late_against_each_other(force):
    read = low_passed(force[:20_000, :1]) * [1.0, -1.0, 2.0, 0.0, 1.0, -1.0]
    last = added(read, np.zeros_like(read))[-1]
    signs = np.outer([1.0, -1.0, 2.0, 0.0, 1.0, -1.0], [1.0, -1.0, 2.0, 0.0, 1.0, -1.0])
    np.testing.assert_allclose(last, last[0, 0] * signs)


def test_a_step_is_late_from_its_own_sample_on_and_what_lasts_is_not():
    read = np.full((3, 6), 7.0)
    read[1:] += 2.0
    noise = np.full((3, 6), 0.5)
    variance = added(read, noise)[:, 0, 0] * LAG_POWER_SHARE
    omega = 2.0 * np.pi * BAND
    pole, factor = np.exp(-omega * STEP), omega / K_0
    first, second = ((factor * 2.0 * pole**k) ** 2 - 0.5 for k in (1, 2))
    power = (1.0 - pole) * first
    np.testing.assert_allclose(
        variance, [0.0, power, pole * power + (1.0 - pole) * second], rtol=1e-12
    )


def test_noise_does_not_count_as_lag(force):
    read = low_passed(force)[:5000]
    loud = np.full_like(read, 1e4)
    assert not added(read, loud).any()


def test_without_a_low_pass_nothing_is_late(force):
    assert not added(force[:5000], np.zeros((5000, 6)), K_0=None).any()


def test_a_log_in_parts_gives_the_same(force):
    read = low_passed(force)[:5000]
    noise = np.full_like(read, 0.5)
    np.testing.assert_array_equal(added(read, noise), added(read, noise, parts=7))


def test_a_missing_sample_costs_no_more_than_itself(force):
    read = low_passed(force)[:5000]
    noise = np.zeros_like(read)
    broken = read.copy()
    broken[2000] = np.nan
    both = added(read, noise), added(broken, noise)
    assert np.isfinite(both[1]).all()
    np.testing.assert_allclose(both[1][-1], both[0][-1], rtol=1e-6)
