"""Friction found anew: known changes come back within the stated errors, and no further."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchsight.models.calibration import residual_noise
from wrenchsight.models.calibration.friction_refresh import (
    FrictionDrift,
    FrictionRefresh,
    refresh_friction,
)
from wrenchsight.models.calibration.residual_noise import ResidualRows
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous

LAW = CoulombViscous(np.array([15.0, 3.0]), np.array([20.0, 3.0]), np.array([0.1, 0.0]))
SD = np.array([1.0, 0.2])
SEEDS = 300


def quiet_rows(duration=3.0, amplitude=(0.5, 0.4), seed=0):
    """Rows of a motion without any residual: two joints, a few harmonics, 10 a second."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, duration, 0.1)
    v = np.zeros((len(t), 2))
    for k in (1, 2, 3):
        phase = rng.uniform(0.0, 2.0 * np.pi, 2)
        v += np.asarray(amplitude) * np.sin(1.7 * k * t[:, None] + phase)
    sliding = np.stack([np.sign(v), v, np.ones_like(v)], axis=2)
    level = np.broadcast_to(LAW.coulomb, v.shape)
    return ResidualRows(
        t, v, np.zeros_like(v), LAW.coulomb * np.sign(v), LAW.viscous * v, level, sliding, SD
    )


def noisy(rows, change, rng):
    """The same with a change of friction and a residual of the stated covariance."""
    residual = np.einsum("mjk,jk->mj", rows.sliding, change)
    for j in range(2):
        lower = np.linalg.cholesky(rows.covariance(j))
        residual[:, j] += lower @ rng.normal(size=len(rows.t))
    return replace(rows, residual=residual)


def test_changes_lie_within_the_stated_errors():
    """Changes drawn from the prior, residuals from the stated covariance: 300 logs of 3 s."""
    drift = FrictionDrift()
    z = []
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        rows = quiet_rows(seed=seed)
        change = drift.deviation(rows, LAW) * rng.normal(size=(2, 3))
        refresh = refresh_friction(noisy(rows, change, rng), LAW, drift)
        z.append((refresh.change - change) / refresh.standard_deviation)
    scores = np.array(z)
    inside = (np.abs(scores) < 1.96).mean(axis=0)
    # 95 % of 300 logs: 1.3 % sd of the share; four of those. The scale's own uncertainty costs
    # less than that.
    np.testing.assert_allclose(inside, 0.95, atol=4.0 * np.sqrt(0.95 * 0.05 / SEEDS))
    np.testing.assert_allclose(scores.mean(axis=0), 0.0, atol=4.0 / np.sqrt(SEEDS))


def test_independent_rows_would_state_errors_that_are_too_small(monkeypatch):
    """Why the residual's correlation counts: without it the same logs miss by far."""
    drift = FrictionDrift(10.0, 10.0, 10.0)
    misses = []
    for seed in range(100):
        rng = np.random.default_rng(seed)
        rows = noisy(quiet_rows(duration=8.0, seed=seed), np.zeros((2, 3)), rng)
        with monkeypatch.context() as white:
            white.setattr(residual_noise, "WHITE_SHARE", 0.8)
            for name in ("SLOW_SHARE", "REVERSAL_RATIO", "COULOMB_SHARE", "VISCOUS_SHARE"):
                white.setattr(residual_noise, name, 0.0)
            refresh = refresh_friction(rows, LAW, drift)
        misses.append(np.abs(refresh.standard_errors) > 1.96)
    assert np.mean(misses) > 0.2  # stated: 0.05


def test_a_joint_that_hardly_moves_keeps_its_numbers():
    rows = quiet_rows(amplitude=(0.5, 0.002))
    rng = np.random.default_rng(1)
    refresh = refresh_friction(noisy(rows, np.zeros((2, 3)), rng), LAW)
    assert (refresh.determined_share[0, :2] > 0.3).all()
    # The second joint rests nearly all the time: its standard errors are those of the prior.
    assert (refresh.determined_share[1] < 0.1).all()
    assert (np.abs(refresh.change[1]) < refresh.prior_deviation[1]).all()


def test_four_seconds_do_not_throw_a_joint_away():
    """A joint that moves one way, at one speed: Coulomb, viscous and offset look the same."""
    rows = quiet_rows()
    v = np.column_stack([rows.v[:, 0], np.full(len(rows.t), 0.5)])
    sliding = np.stack([np.sign(v), v, np.ones_like(v)], axis=2)
    rows = replace(
        rows, v=v, sliding=sliding, dry=LAW.coulomb * np.sign(v), viscous=LAW.viscous * v
    )
    change = np.array([[0.0, 0.0, 0.0], [0.0, 1.5, 0.0]])
    refresh = refresh_friction(noisy(rows, change, np.random.default_rng(3)), LAW)
    # What is told is the sum at this speed, 0.75 N m; the prior gives it to the viscous part, which
    # drifts most. 0.2 N m: three standard errors of a residual of 0.2 N m over 3 s.
    assert refresh.change[1] @ [1.0, 0.5, 1.0] == pytest.approx(0.75, abs=0.2)
    assert (np.abs(refresh.change[1]) < 3.0 * refresh.prior_deviation[1]).all()
    # Told apart they are not, and the errors say so.
    assert refresh.standard_deviation[1, 0] > 0.8 * refresh.prior_deviation[1, 0]


def test_before_and_after_are_the_laws_coefficients():
    rows = quiet_rows(duration=20.0)
    change = np.array([[0.5, 4.0, 0.1], [-0.1, -0.4, 0.02]])
    refresh = refresh_friction(noisy(rows, change, np.random.default_rng(7)), LAW)
    assert refresh.model_law is LAW
    coefficients_after = np.stack(
        [refresh.after.coulomb, refresh.after.viscous, refresh.after.offset], axis=1
    )
    coefficients_before = np.stack([LAW.coulomb, LAW.viscous, LAW.offset], axis=1)
    np.testing.assert_allclose(coefficients_after - coefficients_before, refresh.change)
    np.testing.assert_allclose(refresh.standard_errors, refresh.change / refresh.standard_deviation)
    assert refresh.standard_errors[0, 1] > 3.0


def test_the_work_of_friction_is_a_share_of_the_models():
    rows = quiet_rows()
    shares = np.array([-0.5, 0.2])  # half of the friction is gone; a fifth has come
    change = np.stack([shares * LAW.coulomb, shares * LAW.viscous, np.ones(2)], axis=1)
    refresh = FrictionRefresh(LAW, change, np.zeros((2, 3, 3)), np.ones((2, 3)), np.ones(2))
    np.testing.assert_allclose(refresh.work_share(rows), [0.5, 1.2], rtol=1e-12)  # rounding
    at_rest = replace(rows, v=np.zeros_like(rows.v))
    np.testing.assert_array_equal(refresh.work_share(at_rest), 1.0)


def test_a_frictionless_model_has_a_prior_of_its_residual():
    rows = quiet_rows()
    bare = CoulombViscous.zero(2)
    rows = replace(rows, dry=np.zeros_like(rows.dry), viscous=np.zeros_like(rows.viscous))
    np.testing.assert_allclose(
        FrictionDrift(0.05, 0.3, 0.02).deviation(rows, bare), np.outer(SD, [0.05, 0.3, 0.02])
    )
