"""Velocities from positions: exact where they must be, without delay, the same in any chunks."""

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import savgol_coeffs

from wrenchsight.models.recordings.differentiation import HALF_WINDOW_S, with_velocities
from wrenchsight.models.recordings.recording import Recording, concatenated
from wrenchsight.models.recordings.recording_reader import read_recording


def _recording(t: np.ndarray, q: np.ndarray) -> Recording:
    return Recording(t=t, q=q, v=np.zeros_like(q), current=np.zeros_like(q), source="log")


def _velocities(recording: Recording, num_chunks: int = 1) -> np.ndarray:
    edges = np.linspace(0, recording.num_samples, num_chunks + 1).astype(int)
    chunks = [recording[a:b] for a, b in pairwise(edges)]
    again = concatenated(list(with_velocities(chunks)))
    np.testing.assert_array_equal(again.t, recording.t)
    np.testing.assert_array_equal(again.q, recording.q)
    return again.v


def test_the_velocity_of_an_even_motion_is_exact_at_any_sampling() -> None:
    rng = np.random.default_rng(0)
    t = np.cumsum(0.002 * rng.uniform(0.3, 1.7, 400))
    v = _velocities(_recording(t, np.outer(t, [0.5, -2.0]) + 1.0))
    # Positions round to 2e-16 of some 1 rad, steps are down to .6 ms: 4e-13 rad/s each.
    np.testing.assert_allclose(v, np.tile([0.5, -2.0], (400, 1)), rtol=1e-11)


def test_on_an_even_grid_it_equals_scipys_savitzky_golay_filter() -> None:
    step, half = 0.005, round(HALF_WINDOW_S / 0.005)
    t = step * np.arange(300)
    q = np.sin(3 * t) + 0.2 * np.cos(7 * t)
    v = _velocities(_recording(t, q[:, None]))[:, 0]
    weights = savgol_coeffs(2 * half + 1, 3, deriv=1, delta=step)
    expected = np.convolve(q, weights, "valid")
    np.testing.assert_allclose(v[half:-half], expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("frequency", [0.5, 2.0, 5.0])
def test_a_sine_keeps_its_phase(frequency: float) -> None:
    t = 0.001 * np.arange(4000)
    omega = 2 * np.pi * frequency
    v = _velocities(_recording(t, np.sin(omega * t)[:, None]))[100:-100, 0] / omega
    t = t[100:-100]
    basis = np.stack([np.cos(omega * t), np.sin(omega * t)], axis=1)
    in_phase, off_phase = np.linalg.lstsq(basis, v, rcond=None)[0]
    assert abs(off_phase) < 1e-6  # a delay of a millisecond at 5 Hz would be 0.03
    assert in_phase == pytest.approx(1.0, abs=0.03)  # at 5 Hz the window is a third of a period


@pytest.mark.parametrize("num_chunks", [2, 7, 150, 400])
def test_the_size_of_chunks_does_not_change_velocities(num_chunks: int) -> None:
    rng = np.random.default_rng(1)
    t = np.cumsum(0.01 * rng.uniform(0.9, 1.1, 400))
    recording = _recording(t, np.sin(np.outer(t, [2.0, 3.0])))
    whole = _velocities(recording)
    np.testing.assert_allclose(_velocities(recording, num_chunks), whole, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("size", [1, 2, 3, 5])
def test_a_log_of_a_few_samples_has_velocities(size: int) -> None:
    t = 0.01 * np.arange(size)
    v = _velocities(_recording(t, 2.0 * t[:, None]))
    np.testing.assert_allclose(v, np.full((size, 1), 2.0 if size > 2 else 0.0), rtol=1e-12)


def test_velocities_agree_with_those_of_a_ur10e_drive(data: Callable[[str], Path]) -> None:
    recording = read_recording(data("ur10e_more/ur-20_02_19_15harm50sec.csv"))
    error = _velocities(recording) - recording.v
    # The drive's own velocity is off by 2 to 3 mrad/s whatever filter it is held against.
    assert np.sqrt(np.mean(error**2, axis=0)).max() < 6e-3
