"""The pieces of the statistic against numpy: whitening, misfit, torque jumps."""

import numpy as np
import pytest

from wrenchsight.models.detection.contact_detector import upper_whitening
from wrenchsight.models.detection.contact_statistic import (
    UNKNOWN_MOMENT,
    misfit_square,
    torque_jumps,
)


def covariance(n, seed=0):
    spread = np.random.default_rng(seed).normal(size=(n, n))
    R = spread @ spread.T + n * np.eye(n)
    size = np.sqrt(np.diag(R))
    return R / np.outer(size, size)


@pytest.mark.parametrize("n", [1, 6, 7])
def test_the_last_whitened_entries_depend_on_the_last_joints_alone(n):
    R = covariance(n)
    U = upper_whitening(R)
    np.testing.assert_allclose(U @ R @ U.T, np.eye(n), atol=1e-12)
    np.testing.assert_array_equal(U, np.triu(U))
    z = np.random.default_rng(1).normal(size=n)
    y = U @ z
    for k in range(n):
        alone = z[k:] @ np.linalg.solve(R[k:, k:], z[k:])
        assert y[k:] @ y[k:] == pytest.approx(alone, rel=1e-12)


def least_squares_misfit(R, J, s, tau, moment_sd):
    """min_F |U (tau - J^T F) / s|^2 + |moment / moment_sd|^2, by stacking; forces are free."""
    white = np.linalg.inv(np.linalg.cholesky(R)) / s
    rows, target = white @ J.T, white @ tau
    if moment_sd == 0.0:
        rows = rows[:, 3:]
    else:
        known = np.hstack([np.eye(3) / moment_sd, np.zeros((3, 3))])
        rows, target = np.vstack([rows, known]), np.concatenate([target, np.zeros(3)])
    F, *_ = np.linalg.lstsq(rows, target, rcond=None)
    return np.sum((target - rows @ F) ** 2)


@pytest.mark.parametrize("moment_sd", [0.0, 1.0, 50.0])
@pytest.mark.parametrize("n", [6, 7])
def test_misfit_is_the_residual_of_least_squares(n, moment_sd):
    rng = np.random.default_rng(4)
    R, s = covariance(n, 2), rng.uniform(0.1, 2.0, n)
    U = upper_whitening(R)
    for _ in range(5):
        J, tau = rng.normal(size=(6, n)), 5.0 * rng.normal(size=n)
        square = misfit_square(U, J, s, U @ (tau / s), moment_sd)
        # A force of 10 N beside the 10 kN that stand for unknown: 1e-6 of what it explains.
        expected = least_squares_misfit(R, J, s, tau, moment_sd)
        assert square == pytest.approx(expected, rel=1e-3, abs=1e-3)


def test_a_force_at_e_is_no_misfit_and_six_joints_explain_any_wrench():
    rng = np.random.default_rng(5)
    J, s, U = rng.normal(size=(6, 6)), np.full(6, 0.3), np.eye(6)
    at_E = J.T @ [0.0, 0.0, 0.0, 20.0, -10.0, 5.0]
    assert misfit_square(U, J, s, at_E / s, 0.0) < 1e-3
    anything = rng.normal(size=6)
    assert misfit_square(U, J, s, anything / s, UNKNOWN_MOMENT) < 1e-3
    assert misfit_square(U, J, s, anything / s, 0.0) > 1.0


def test_a_jolt_is_the_second_difference_of_momentum_and_fades_with_the_pole():
    momentum = np.zeros((50, 2))
    momentum[20:, 0] = 0.4  # a stop from one sample to the next
    momentum[:, 1] = 0.3 * np.arange(50)  # steady torque: no torque jump
    jumps = torque_jumps(momentum, np.full((50, 2), 7.0), np.array([0.8, 0.8]), 0.01)
    np.testing.assert_allclose(jumps[:, 1], 0.0, atol=1e-12)
    raw = 0.2 * 0.4 / 0.01
    assert jumps[19, 0] == 0.0
    assert jumps[20, 0] == pytest.approx(raw)
    assert jumps[21, 0] == pytest.approx(raw * np.sqrt(1.0 + 0.64))
    assert jumps[30, 0] == pytest.approx(jumps[21, 0] * 0.8**9)


def test_a_jump_of_held_torque_is_a_torque_jump():
    """The mean of a period is anywhere between its ends: D^2 / 3 about the first of them."""
    torque = np.zeros((50, 2))
    torque[20:, 0] = 30.0
    jumps = torque_jumps(np.zeros((50, 2)), torque, np.array([0.8, 0.8]), 0.01)
    np.testing.assert_array_equal(jumps[:, 1], 0.0)
    assert jumps[20, 0] == 0.0  # known with the next sample
    anywhere = np.linspace(0.0, 30.0, 100_001)
    raw = 0.2 * np.sqrt(np.mean(anywhere**2))
    assert jumps[21, 0] == pytest.approx(raw, rel=1e-4)
    assert jumps[31, 0] == pytest.approx(jumps[21, 0] * 0.8**10)
