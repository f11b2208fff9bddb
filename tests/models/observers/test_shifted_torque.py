"""Late and early currents in the torques of an arm in motion, and pushes, which are neither."""

import numpy as np
import pytest
from numpy.typing import NDArray

from wrenchsight.models.observers.shifted_torque import (
    SHIFTS,
    are_shifted,
    initial_shift_state,
    shift_numbers,
)

Array = NDArray[np.float64]
K_0 = 20.0  # 1/s
BEGIN, END = 2.0, 4.0  # s of the shift
SD = np.array([1.0, 1.0, 0.5, 0.5, 0.3, 0.3])  # N m


def _need(t: Array) -> Array:
    """(N, 6) N m that an arm in motion takes."""
    rates, phases = np.array([0.9, 0.7, 1.3, 1.6, 1.1, 1.9]), np.arange(6.0)
    return 40.0 * SD * np.sin(1.5 * rates * t[:, None] + phases)


def _found(need: Array, tau_J: Array, step: float, missing: slice = slice(0)) -> NDArray[np.bool_]:
    """(N,) whether each sample is found to be shifted, behind an observer."""
    numbers, poles = shift_numbers(step, min_square=27.0), np.full(6, np.exp(-K_0 * step))
    state, tau_ext, found = initial_shift_state(numbers, 6), np.zeros(6), []
    is_measured = np.ones(len(need), bool)
    is_measured[missing] = False
    for k in range(len(need)):
        tau_ext = poles * tau_ext + (1.0 - poles) * (need[k] - tau_J[k])
        found.append(
            are_shifted(numbers, poles, state, tau_ext, SD, tau_J[k], bool(is_measured[k]))
        )
    return np.array(found)


def _shifted(delay: float, step: float) -> tuple[Array, Array, Array]:
    """Times, need, and currents that are late by `delay` s from BEGIN to END."""
    t = step * np.arange(round(6.0 / step))
    is_wrong = (t >= BEGIN) & (t < END)
    return t, _need(t), _need(np.where(is_wrong, t - delay, t))


@pytest.mark.parametrize("step", [0.001, 0.002, 0.008, 0.01])
@pytest.mark.parametrize("delay", [0.1, 0.23, 0.5, 0.75, 1.0, -0.1, -0.23, -0.5, -0.75, -1.0])
def test_a_shift_is_found(delay: float, step: float) -> None:
    """Late currents at once, within the observer's lag; early ones once the lead has passed."""
    t, need, tau_J = _shifted(delay, step)
    found = _found(need, tau_J, step)
    shows = BEGIN + max(0.0, -delay)
    assert not found[t < BEGIN].any()
    assert found[(t > shows + 0.15) & (t < END)].mean() > 0.95
    # After its end the torques of before are compared for as long as the longest shift.
    assert not found[t > END + SHIFTS[-1] + 0.15].any()


@pytest.mark.parametrize("delay", [0.0, 0.02, -0.02])
def test_a_small_shift_is_none(delay: float) -> None:
    assert not _found(*_shifted(delay, 0.002)[1:], 0.002).any()


@pytest.mark.parametrize("frequency", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("scale", [0.0, 0.3, 1.0])
def test_a_push_does_not_foretell_the_motion(frequency: float, scale: float) -> None:
    t = 0.002 * np.arange(3000)
    along = np.array([15.0, 25.0, -20.0, 8.0, 12.0, 3.0])
    push = along * np.sin(2.0 * np.pi * frequency * t[:, None])
    need = scale * _need(t)
    assert not _found(need, need - push, 0.002).any()


def test_a_push_that_moves_the_arm_is_not_early() -> None:
    """What the arm takes changes with the sign of the push, after it; the drives hold the rest."""
    t = 0.002 * np.arange(3000)
    swell = np.clip((t - 2.0) / 0.3, 0.0, 1.0)[:, None]
    later = np.clip((t - 2.3) / 0.3, 0.0, 1.0)[:, None]
    push = 20.0 * SD * [1.0, -1.0, 1.0, 1.0, -1.0, 1.0]
    need = 0.5 * later * push
    assert not _found(need, need - swell * push, 0.002).any()
    foretold = -later * push  # as early currents would, of all joints
    assert _found(foretold, foretold - swell * push, 0.002).any()


def test_samples_that_are_missing_have_their_time() -> None:
    """What was measured before a gap is as old as it is."""
    step = 0.002
    t, need, tau_J = _shifted(-0.3, step)
    found = _found(need, tau_J, step, slice(round(2.6 / step), round(2.8 / step)))
    assert found[(t > 3.3) & (t < END)].mean() > 0.95


def test_what_is_not_measured_is_not_kept() -> None:
    numbers = shift_numbers(0.002, min_square=27.0)
    state, poles = initial_shift_state(numbers, 6), np.full(6, 0.96)
    for is_measured in (True, False):
        for _ in range(1000):
            are_shifted(numbers, poles, state, 5.0 * SD, SD, 9.0 * SD, is_measured)
        assert np.isnan(state.torques[1:]).all() == (not is_measured)


def test_a_shift_is_found_beside_the_error_of_the_model() -> None:
    """Where a tenth of the torque's square is left, but no more than the error's own variance."""
    t, need, tau_J = _shifted(0.2, 0.002)
    error = 0.8 * SD * [1.0, 1.0, -1.0, 1.0, -1.0, 1.0]
    found = _found(0.4 * need, 0.4 * tau_J - error, 0.002)
    assert found[(t > BEGIN + 0.15) & (t < END)].mean() > 0.95
    assert not found[t < BEGIN].any()
