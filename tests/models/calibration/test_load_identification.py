"""Loads of known mass, centre of mass and inertia come back within the stated errors."""

from dataclasses import replace

import numpy as np
import pytest
from ur10e_logs import LAW, quiet_rows

from wrenchsight.models.calibration.friction_refresh import FrictionDrift
from wrenchsight.models.calibration.load_identification import (
    LoadPrior,
    estimate_load,
)
from wrenchsight.models.calibration.load_parameters import body_parameters

SEEDS = 60
EXACT = LoadPrior(mass=12.5, gain=0.0)


def quiet(robot, seed=0, duration=20.0, amplitude=0.5, only=range(6)):
    """An arm's rows without residual; `only` lets these joints move alone."""
    return quiet_rows(robot, np.random.default_rng(seed), duration, amplitude, only)


def body(rng):
    """A random body of one to six kilograms within a hand's breadth or two of the flange."""
    mass = rng.uniform(1.0, 6.0)
    com = rng.normal(size=3) * 0.1
    points = rng.normal(size=(5, 3)) * 0.05 * mass ** (1.0 / 3.0)
    points -= points.mean(axis=0)
    second_moments = mass / 5.0 * points.T @ points
    return mass, com, np.trace(second_moments) * np.eye(3) - second_moments


def measured(log, load, rng, gains=None, drift=True):
    """The same rows with a load's torque, friction that drifted, and a correlated residual."""
    residual = log.load @ load
    if gains is not None:
        residual = residual * gains  # a drive that gives more torque than stated shows less current
    rows = log.rows
    change = np.zeros((6, 3))
    if drift:
        change = FrictionDrift().deviation(rows, LAW) * rng.normal(size=(6, 3))
    residual = residual + np.einsum("mjk,jk->mj", rows.drift, change)
    for j in range(6):
        residual[:, j] += np.linalg.cholesky(rows.covariance(j)) @ rng.normal(size=len(rows.t))
    return replace(log, rows=replace(rows, residual=residual))


def scores(estimate, mass, com, inertia):
    places = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    error = np.r_[
        estimate.mass - mass,
        estimate.com - com,
        [estimate.inertia[place] - inertia[place] for place in places],
    ]
    return error / np.r_[estimate.sd.mass, estimate.sd.com, estimate.sd.inertia]


@pytest.mark.long
def test_loads_lie_within_the_stated_errors(ur10e):
    z = []
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        mass, com, inertia = body(rng)
        log = quiet(ur10e, seed)
        log = measured(log, body_parameters(mass, com, inertia), rng)
        z.append(scores(estimate_load(log, LAW, EXACT), mass, com, inertia))
    inside = np.abs(np.array(z)) < 1.96
    # Mass and centre of mass, 240 scores: 1.4 % sd of the share; three of those.
    assert inside[:, :4].mean() == pytest.approx(0.95, abs=0.042)
    # The inertia's prior is a guess at bodies, not where these are drawn from: not below, but it
    # may be above.
    assert inside[:, 4:].mean() > 0.9


@pytest.mark.long
def test_torque_constants_that_are_off_are_in_the_stated_error(ur10e):
    prior = LoadPrior(mass=12.5, gain=0.03)
    z = []
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        mass, com, inertia = body(rng)
        log = quiet(ur10e, seed)
        gains = 1.0 + 0.03 * rng.normal(size=6)
        log = measured(log, body_parameters(mass, com, inertia), rng, gains)
        z.append(scores(estimate_load(log, LAW, prior), mass, com, inertia)[:4])
    inside = np.abs(np.array(z)) < 1.96
    # 60 logs, four numbers each that share their gains: as if 120 independent scores, sd 2 %.
    assert inside.mean() == pytest.approx(0.95, abs=0.06)


@pytest.mark.long
def test_errors_of_the_arms_own_model_are_in_the_stated_error(ur10e):
    """The model's last link weighs other than it says, by what its standard error states."""
    z = []
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        mass, com, inertia = body(rng)
        log = quiet(ur10e, seed)
        sd = np.array([0.2, 0.02, 0.02, 0.02])
        wrong = np.r_[sd * rng.normal(size=4), np.zeros(6)]
        log = replace(log, model=log.load[:, :, :4], model_sd=sd)
        log = measured(log, body_parameters(mass, com, inertia) + wrong, rng)
        z.append(scores(estimate_load(log, LAW, EXACT), mass, com, inertia)[:4])
    assert (np.abs(np.array(z)) < 1.96).mean() == pytest.approx(0.95, abs=0.06)


def test_a_log_without_the_load_takes_the_models_errors_off(ur10e):
    rng = np.random.default_rng(4)
    mass, com, inertia = 2.0, np.array([0.02, 0.05, 0.1]), 0.01 * np.eye(3)
    wrong = body_parameters(0.5, np.array([0.0, 0.1, 0.0]), 0.01 * np.eye(3))
    laden = quiet(ur10e, 1)
    bare = measured(quiet(ur10e, 2), wrong, rng, drift=False)
    laden = measured(laden, body_parameters(mass, com, inertia) + wrong, rng, drift=False)
    alone = estimate_load(laden, LAW, EXACT)
    paired = estimate_load(laden, LAW, EXACT, bare)
    assert alone.mass == pytest.approx(2.5, abs=4.0 * alone.sd.mass)
    assert paired.mass == pytest.approx(2.0, abs=4.0 * paired.sd.mass)
    np.testing.assert_allclose(paired.com, com, atol=4.0 * float(paired.sd.com.max()))


def test_parameters_state_the_same_body(ur10e):
    rng = np.random.default_rng(9)
    mass, com, inertia = body(rng)
    estimate = estimate_load(
        measured(quiet(ur10e, 9), body_parameters(mass, com, inertia), rng), LAW, EXACT
    )
    expected_parameters = body_parameters(estimate.mass, estimate.com, estimate.inertia)
    np.testing.assert_allclose(estimate.parameters, expected_parameters, atol=1e-9)
    assert estimate.is_present
    assert estimate.sd.mass < 0.1


def test_no_load_is_found_in_a_log_without_one(ur10e):
    estimate = estimate_load(
        measured(quiet(ur10e, 5), np.zeros(10), np.random.default_rng(5)), LAW, EXACT
    )
    assert not estimate.is_present
    assert abs(estimate.mass) < 3.0 * estimate.sd.mass


def test_parameters_that_the_motion_does_not_determine_have_wide_errors(ur10e):
    """Joint 1 alone, about a vertical axis: gravity never changes, so neither does what it says."""
    log = quiet(ur10e, 3, only=[0])
    estimate = estimate_load(
        measured(
            log,
            body_parameters(3.0, np.array([0.0, 0.0, 0.1]), 0.01 * np.eye(3)),
            np.random.default_rng(3),
        ),
        LAW,
        EXACT,
    )
    moving = estimate_load(
        measured(
            quiet(ur10e, 3),
            body_parameters(3.0, np.array([0.0, 0.0, 0.1]), 0.01 * np.eye(3)),
            np.random.default_rng(3),
        ),
        LAW,
        EXACT,
    )
    # Joints 2 to 6 rest: each carries what its stiction takes.
    assert estimate.sd.mass > 5.0 * moving.sd.mass
    assert estimate.sd.com.max() > 5.0 * moving.sd.com.max()
    assert (estimate.inertia_determined_share <= moving.inertia_determined_share + 0.01).all()
