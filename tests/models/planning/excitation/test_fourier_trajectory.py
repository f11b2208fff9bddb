"""Fourier trajectories: derivatives, rest, bounds between samples, files."""

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from wrenchsight.models.files.configuration import save_configuration
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.planning.excitation.fourier_trajectory import (
    FourierTrajectory,
    between_samples,
)


def trajectory(seed=0, n=3, harmonics=5, base_frequency=0.2):
    rng = np.random.default_rng(seed)
    return FourierTrajectory(
        base_frequency,
        rng.normal(size=n),
        rng.normal(size=(n, harmonics)),
        rng.normal(size=(n, harmonics)),
    )


def test_velocity_and_acceleration_are_derivatives_of_the_position():
    series = trajectory()
    t = np.linspace(0.0, series.period, 2001)
    q, v, vdot = series.sample(t)
    spline = make_interp_spline(t, q, k=7)
    inside = slice(50, -50)  # the spline is worse at its ends
    np.testing.assert_allclose(v[inside], spline.derivative(1)(t)[inside], atol=1e-8)
    np.testing.assert_allclose(vdot[inside], spline.derivative(2)(t)[inside], atol=1e-6)


def test_it_repeats_and_holds_only_the_harmonics_it_says():
    series = trajectory()
    t = np.arange(64) * series.period / 64
    q = series.sample(t)[0]
    np.testing.assert_allclose(series.sample(t + series.period)[0], q, atol=1e-12)
    spectrum = np.fft.rfft(q[:, 0])
    np.testing.assert_allclose(spectrum[6:], 0.0, atol=1e-12)
    np.testing.assert_allclose(2.0 / 64 * spectrum[1:6].real, series.cosine[0], atol=1e-12)
    np.testing.assert_allclose(-2.0 / 64 * spectrum[1:6].imag, series.sine[0], atol=1e-12)


def test_samples_bound_what_lies_between_them():
    count, share = 40, between_samples(5, 40)
    worst = 0.0
    for seed in range(200):
        series = trajectory(seed, n=1)
        coarse = series.sample(np.arange(count) * series.period / count)[1]
        fine = series.sample(np.linspace(0.0, series.period, 4000))[1]
        worst = max(worst, float(np.abs(fine).max() / np.abs(coarse).max()))
    assert 1.0 < worst <= 1.0 / share
    with pytest.raises(ValueError, match="10 samples"):
        between_samples(5, 10)


def test_a_file_gives_back_every_digit(tmp_path):
    series = trajectory()
    path = tmp_path / "x.yaml"
    save_configuration(series.coefficients("arm", "a test"), path)
    back = FourierTrajectory.load(path, "arm")
    np.testing.assert_array_equal(back.sine, series.sine)
    np.testing.assert_array_equal(back.cosine, series.cosine)
    np.testing.assert_array_equal(back.centre, series.centre)
    with pytest.raises(InputError, match="made for 'arm', not for 'other'"):
        FourierTrajectory.load(path, "other")


def test_lists_that_do_not_fit_are_one_line(tmp_path):
    path = tmp_path / "x.yaml"
    path.write_text("base_frequency: 0.1\ncentre: [0, 0]\nsine: [[1, 2]]\ncosine: [[1, 2]]\n")
    with pytest.raises(InputError) as error:
        FourierTrajectory.load(path)
    assert "x.yaml" in str(error.value) and "\n" not in str(error.value)


def test_the_joint_trajectory_follows_it():
    series = trajectory()
    motion = series.joint_trajectory(2)
    assert motion.duration == pytest.approx(2 * series.period)
    t = np.linspace(0.0, 2 * series.period, 777)
    for sampled, expected in zip(motion.sample(t), series.sample(t), strict=True):
        # Quintic interpolation over 10 ms of 1 Hz: h^6 w^6 / 46080 and its derivatives.
        np.testing.assert_allclose(sampled, expected, atol=1e-3 * np.abs(expected).max())
