"""Fourier trajectories: derivatives, rest, bounds between samples, files."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from wrenchsight.models.files.configuration import save_configuration
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.planning.excitation.fourier_trajectory import (
    FourierTrajectory,
    Stops,
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


def test_the_samples_of_a_motion_are_told_from_its_coefficients(tmp_path):
    """`excite` writes both, side by side."""
    save_configuration(trajectory().coefficients("arm", "a test"), tmp_path / "x.yaml")
    samples = tmp_path / "x.csv"
    samples.write_text("t,q1,q2\n" + "0,0,0\n" * 1000)
    with pytest.raises(InputError, match=r"expected its coefficients; give .*x\.yaml"):
        FourierTrajectory.load(samples)
    (tmp_path / "x.yaml").unlink()
    with pytest.raises(InputError, match="expected keys with values") as error:
        FourierTrajectory.load(samples)
    assert len(str(error.value)) < 300  # not the whole file


def test_the_joint_trajectory_follows_it():
    series = trajectory()
    motion = series.joint_trajectory(2)
    assert motion.duration == pytest.approx(2 * series.period)
    t = np.linspace(0.0, 2 * series.period, 777)
    for sampled, expected in zip(motion.sample(t), series.sample(t), strict=True):
        # Quintic interpolation over 10 ms of 1 Hz: h^6 w^6 / 46080 and its derivatives.
        np.testing.assert_allclose(sampled, expected, atol=1e-3 * np.abs(expected).max())


def stopping(number: int = 2, rest: float = 1.5, ramp: float = 0.8) -> FourierTrajectory:
    rng = np.random.default_rng(2)
    sine, cosine = 0.1 * rng.normal(size=(2, 3, 4))
    return FourierTrajectory(0.1, np.zeros(3), sine, cosine, Stops(number, rest, ramp))


def test_a_motion_with_stops_rests_on_its_path() -> None:
    """v and vdot against differences of the table; each of six stops lasts as long as stated."""
    series, step = stopping(), 1e-3
    motion = series.joint_trajectory(3, step)
    assert motion.t[-1] == pytest.approx(30.0 + 6 * (1.5 + 0.8))
    assert series.duration(3) == pytest.approx(motion.t[-1])
    # Central differences err by step^2 / 6 times the third derivative, here some 20 rad/s^3.
    slope = np.gradient(motion.q, step, axis=0)[1:-1]
    np.testing.assert_allclose(motion.v[1:-1], slope, atol=1e-4)
    bend = np.gradient(motion.v, step, axis=0)[1:-1]
    # Where a ramp begins or ends, the third derivative jumps by up to 6 / ramp^2 of the speed.
    np.testing.assert_allclose(motion.vdot[1:-1], bend, atol=3e-3)
    still = (np.abs(motion.v) < 1e-12).all(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]))).reshape(-1, 2)
    rests = np.diff(edges, axis=1).ravel() * step
    assert len(rests) == 6
    np.testing.assert_allclose(rests, 1.5, atol=2.5 * step)
    # At six different places, and never faster than without stops.
    places = motion.q[edges[:, 0]]
    assert all(np.abs(places[k] - places[:k]).max(axis=1).min() > 0.02 for k in range(1, 6))
    plain = replace(series, stops=Stops()).joint_trajectory(3, step)
    assert (np.abs(motion.v).max(axis=0) <= np.abs(plain.v).max(axis=0) * (1.0 + 1e-6)).all()
    np.testing.assert_allclose(motion.q[-1], plain.q[-1], atol=1e-12)


def test_without_stops_the_motion_is_the_series() -> None:
    series = stopping(number=0)
    motion = series.joint_trajectory(2, 0.01)
    for found, expected in zip(
        (motion.q, motion.v, motion.vdot), series.sample(motion.t), strict=True
    ):
        np.testing.assert_array_equal(found, expected)


def test_stops_go_through_the_file_and_need_room() -> None:
    series = stopping()
    again = FourierTrajectory.from_coefficients(series.coefficients())
    assert again.stops == series.stops
    with pytest.raises(ValueError, match="longer ramps than a period holds"):
        stopping(number=7)
