"""When a log's friction contradicts the model, and when something else does."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from wrenchsight.models.calibration.friction_drift_criterion import friction_disagreements
from wrenchsight.models.calibration.friction_refresh import FrictionRefresh, refresh_friction
from wrenchsight.models.calibration.residual_noise import ResidualRows
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous

LAW = CoulombViscous(np.array([15.0, 3.0]), np.array([20.0, 3.0]), np.zeros(2))
NAMES = ("shoulder", "wrist")


def rows(change, seed=0, duration=20.0, extra=0.0):
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, duration, 0.1)
    phase = rng.uniform(0.0, 2.0 * np.pi, (3, 2))
    v = sum(0.4 * np.sin(1.7 * (k + 1) * t[:, None] + phase[k]) for k in range(3))
    sliding = np.stack([np.sign(v), v, np.ones_like(v)], axis=2)
    residual_rows = ResidualRows(
        t,
        v,
        np.zeros_like(v),
        LAW.coulomb * np.sign(v),
        LAW.viscous * v,
        np.broadcast_to(LAW.coulomb, v.shape),
        sliding,
        np.array([1.0, 0.2]),
    )
    residual = np.einsum("mjk,jk->mj", sliding, np.asarray(change)) + extra * v
    for j in range(2):
        lower = np.linalg.cholesky(residual_rows.covariance(j))
        residual[:, j] += lower @ rng.normal(size=len(t))
    return replace(residual_rows, residual=residual)


@pytest.mark.long
def test_unchanged_friction_gives_no_warning():
    logs = [rows(np.zeros((2, 3)), seed) for seed in range(60)]
    # Two joints, three coefficients each, at 6e-5 each: 0.02 alarms expected in 60 logs.
    assert not [disagreement for log in logs for disagreement in friction_disagreements(log, LAW)]


def test_more_viscous_friction_is_named():
    (disagreement,) = friction_disagreements(rows([[0.0, 6.0, 0.0], [0.0, 0.0, 0.0]]), LAW)
    assert (disagreement.joint, disagreement.term.name) == (0, "viscous")
    assert disagreement.standard_errors > 4.0
    assert disagreement.torque > disagreement.stated
    line = disagreement.sentence(NAMES)
    assert "shoulder" in line
    assert "viscous +" in line
    assert "identify --refresh" in line


def test_a_joint_of_one_speed_shows_that_its_friction_is_larger_and_not_which() -> None:
    """At +-.4 rad/s Coulomb and viscous friction are one torque: 1 N m and 2.5 N m s/rad more."""
    log = rows(np.zeros((2, 3)))
    v = 0.4 * np.sign(log.v)
    sliding = np.stack([np.sign(v), v, np.ones_like(v)], axis=2)
    drift = np.sign(v) + 2.5 * v
    residual = log.residual + drift * [1.0, 0.0]
    log = replace(log, v=v, sliding=sliding, viscous=LAW.viscous * v, residual=residual)
    refresh = refresh_friction(log, LAW)
    assert np.abs(refresh.standard_errors[0, :2]).max() < 4.0
    (disagreement,) = friction_disagreements(log, LAW)
    assert disagreement.joint == 0
    # Both add 2 N m; noise and prior are worth a fifth of it.
    np.testing.assert_allclose(disagreement.torque, 2.0, rtol=0.2)


def test_errors_of_a_pair_are_those_of_one_number_that_is_as_improbable() -> None:
    """Independent: of two standard normal numbers, |z| beyond r has probability exp(-r^2 / 2)."""
    covariance = np.tile(np.diag([1.0, 4.0, 1.0]), (3, 1, 1))
    change = np.array([[0.0, 0.0, 9.0], [3.0, 8.0, 0.0], [50.0, 0.0, 0.0]])
    refresh = FrictionRefresh(LAW, change, covariance, np.ones((3, 3)), np.ones(3))
    expected = norm.isf(0.5 * np.exp(-0.5 * 25.0))  # (3 / 1)^2 + (8 / 2)^2
    np.testing.assert_allclose(refresh.sliding_errors[:2], [0.0, expected], rtol=1e-9, atol=1e-9)
    assert refresh.sliding_errors[2] > 30.0  # beyond the least probability that is a number


def test_rest_in_stiction_hides_no_change():
    """Three quarters of the log at rest, with 8 and 1.5 N m held: motion alone is judged."""
    log = rows([[0.0, 6.0, 0.0], [0.0, 0.0, 0.0]])
    (moving,) = friction_disagreements(log, LAW)
    rows_at_rest = 3 * len(log.t)
    still = np.zeros((rows_at_rest, 2))
    rested = ResidualRows(
        np.concatenate([log.t, log.t[-1] + 0.1 * np.arange(1, rows_at_rest + 1)]),
        np.vstack([log.v, still]),
        np.vstack([log.residual, np.tile([8.0, 1.5], (rows_at_rest, 1))]),
        np.vstack([log.dry, still]),
        np.vstack([log.viscous, still]),
        np.broadcast_to(LAW.coulomb, (4 * len(log.t), 2)),
        np.concatenate([log.sliding, np.stack([still, still, still + 1.0], axis=2)]),
        log.sd,
    )
    (disagreement,) = friction_disagreements(rested, LAW)
    assert disagreement.joint == 0
    np.testing.assert_allclose(disagreement.torque, moving.torque, rtol=0.05)


def test_a_change_below_what_the_model_misses_anyhow_is_no_news():
    # 1.5 of 20 N m s/rad in a minute of motion: clear, but 0.7 N m where 1 is stated.
    log = rows([[0.0, 1.5, 0.0], [0.0, 0.0, 0.0]], duration=120.0)
    assert friction_disagreements(log, LAW) == []


def test_a_load_is_not_called_friction():
    """15 N m that follow the arm's posture, not a joint's direction."""
    log = rows(np.zeros((2, 3)))
    gravity = 15.0 * np.sin(np.cumsum(log.v[:, 0]) * 0.1 + 0.4)
    loaded = replace(log, residual=log.residual + np.column_stack([gravity, gravity]))
    assert friction_disagreements(loaded, LAW) == []


def test_too_few_rows_say_nothing():
    assert friction_disagreements(rows([[0.0, 9.0, 0.0]] * 2, duration=1.5), LAW) == []
