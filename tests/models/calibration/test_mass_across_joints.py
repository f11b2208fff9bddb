"""A load is one that several joints show."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from ur10e_logs import LAW, quiet_rows

from wrenchsight.models.calibration.load_identification import LoadPrior, estimate_load
from wrenchsight.models.calibration.load_or_drift import MAX_OTHER_PROBABILITY, weigh
from wrenchsight.models.calibration.load_parameters import body_parameters
from wrenchsight.models.calibration.mass_across_joints import mass_sd_across_joints

PRIOR = LoadPrior(mass=12.5)


def log_of(robot, seed, mass, joints=range(6), duration=5.0, moving=range(6)):
    """Rows with a correlated residual and a load whose torque reaches some joints alone."""
    rng = np.random.default_rng(seed)
    log = quiet_rows(robot, rng, duration, moving=moving)
    residual = np.zeros_like(log.rows.residual)
    load = body_parameters(mass, np.array([0.03, -0.06, 0.05]), 0.004 * np.eye(3))
    for j in range(6):
        residual[:, j] += (log.load[:, j] @ load) * (j in joints)
        lower = np.linalg.cholesky(log.rows.covariance(j))
        residual[:, j] += lower @ rng.normal(size=len(log.rows.t))
    return replace(log, rows=replace(log.rows, residual=residual))


@pytest.mark.parametrize("seed", range(6))
def test_seconds_determine_a_load_with_its_error(ur10e, seed):
    weighed = weigh(log_of(ur10e, seed, 2.0), LAW, PRIOR)
    assert weighed.is_shown
    assert abs(weighed.load.mass - 2.0) < 3.0 * weighed.mass_sd
    assert weighed.mass_sd < 0.6


@pytest.mark.parametrize("joint", [1, 2])
def test_torque_of_one_joint_alone_is_no_load(ur10e, joint):
    # An error of the one joint that moves has the shape of a load; the others rest in stiction.
    log = log_of(ur10e, 1, 3.0, joints=[joint], duration=20.0, moving=[joint])
    weighed = weigh(log, LAW, PRIOR)
    assert weighed.load.is_present
    assert weighed.is_steady
    assert weighed.probability["load"] + weighed.probability["both"] > 1.0 - MAX_OTHER_PROBABILITY
    assert not weighed.is_shown


def test_the_error_of_the_gains_counts_in_full(ur10e):
    log = log_of(ur10e, 1, 2.0, duration=25.0)
    load = estimate_load(log, LAW, PRIOR)
    assert mass_sd_across_joints(log, LAW, PRIOR, load) > 1.05 * load.sd.mass
    assert mass_sd_across_joints(log, LAW, PRIOR, load) > PRIOR.gain * load.mass


def test_one_joint_alone_determines_no_load(ur10e):
    log = log_of(ur10e, 1, 2.0)
    load = estimate_load(log, LAW, PRIOR)
    one_joint = SimpleNamespace(rows=SimpleNamespace(num_joints=1))
    assert mass_sd_across_joints(one_joint, LAW, PRIOR, load) == np.inf


@pytest.mark.parametrize("seed", range(4))
def test_no_load_is_claimed_where_there_is_none(ur10e, seed):
    assert not weigh(log_of(ur10e, seed, 0.0), LAW, PRIOR).is_shown


def test_too_few_rows_say_nothing(ur10e):
    assert weigh(log_of(ur10e, 1, 2.0, duration=3.0), LAW, PRIOR) is None
