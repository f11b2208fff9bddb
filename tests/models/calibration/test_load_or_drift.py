"""A load is told from friction that has drifted, and from neither."""

from dataclasses import replace

import numpy as np
import pytest
from ur10e_logs import LAW, quiet_rows

from wrenchsight.models.calibration.friction_refresh import FrictionDrift
from wrenchsight.models.calibration.load_identification import LoadPrior
from wrenchsight.models.calibration.load_or_drift import (
    MIN_ROWS,
    loaded_from,
    weigh,
    weigh_begin,
    without_load,
)
from wrenchsight.models.calibration.load_parameters import body_parameters

PRIOR = LoadPrior(mass=12.5)
LOAD = body_parameters(1.5, np.array([0.03, -0.06, 0.05]), 0.004 * np.eye(3))


def log_of(robot, seed, load=None, drift=0.0, duration=25.0, since=0.0):
    """Rows of 10 a second: a correlated residual, a load from `since` on, friction that drifted by
    `drift` of the prior's sds."""
    rng = np.random.default_rng(seed)
    log = quiet_rows(robot, rng, duration)
    rows, columns = log.rows, log.load
    change = drift * FrictionDrift().deviation(rows, LAW) * rng.choice([-1.0, 1.0], (6, 3))
    residual = np.einsum("mjk,jk->mj", rows.drift, change)
    if load is not None:
        residual += (columns @ load) * (rows.t >= since)[:, None]
    for j in range(6):
        lower = np.linalg.cholesky(rows.covariance(j))
        residual[:, j] += lower @ rng.normal(size=len(rows.t))
    return replace(log, rows=replace(rows, residual=residual))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    ("load", "drift", "expected"),
    [(None, 0.0, "none"), (None, 1.5, "drift"), (LOAD, 0.0, "load"), (LOAD, 1.5, "both")],
)
def test_the_true_hypothesis_has_the_odds(ur10e, seed, load, drift, expected):
    weighed = weigh(log_of(ur10e, seed, load, drift), LAW, PRIOR)
    assert sum(weighed.probability.values()) == pytest.approx(1.0)
    assert weighed.probability[expected] > 0.9
    assert weighed.is_shown == (load is not None)
    if load is not None:
        error = (weighed.load.mass - 1.5) / weighed.load.sd.mass
        assert abs(error) < 3.0
        line = weighed.sentence()
        assert line.startswith(f"unmodelled load at the tool: {weighed.load.mass:.3g} +- ")
        assert "mm from the flange, since the log's start" in line
        assert ("drifted friction" in line) == (expected == "both")


def test_a_force_from_half_way_is_no_load_since_the_start(ur10e):
    weighed = weigh(log_of(ur10e, 1, LOAD, since=12.5), LAW, PRIOR)
    assert not weighed.is_steady
    assert not weighed.is_shown


@pytest.mark.parametrize(
    ("seed", "since", "drift"), [(1, 12.5, 0.0), (2, 7.3, 1.5), (3, 18.0, 1.5)]
)
def test_a_load_that_is_taken_up_is_reported_with_its_time(ur10e, seed, since, drift):
    log = log_of(ur10e, seed, LOAD, drift, since=since)
    weighed = weigh_begin(log, LAW, PRIOR)
    assert weighed.is_shown
    assert weighed.begin == pytest.approx(since, abs=0.15)  # rows are .1 s apart
    assert weighed.begin_sd < 0.1
    assert abs(weighed.load.mass - 1.5) < 3.0 * weighed.load.sd.mass
    assert f"since t = {weighed.begin:.1f} +- 0.1 s" in weighed.sentence()
    assert weighed.metrics()["begin_s"] == weighed.begin
    row = int(np.searchsorted(log.rows.t, weighed.begin))
    remaining = without_load(loaded_from(log, row), weighed.load).rows.residual
    bare = log_of(ur10e, seed, None, drift).rows.residual
    assert np.linalg.norm(remaining - bare) < 0.2 * np.linalg.norm(log.rows.residual - bare)


@pytest.mark.parametrize("drift", [0.0, 1.5])
@pytest.mark.parametrize("seed", range(4))
def test_nothing_is_taken_up_in_a_log_without_a_load(ur10e, seed, drift):
    assert weigh_begin(log_of(ur10e, seed, None, drift), LAW, PRIOR) is None


@pytest.mark.long
def test_the_time_is_found_to_a_row_in_a_long_log(ur10e):
    weighed = weigh_begin(log_of(ur10e, 6, LOAD, duration=150.0, since=97.3), LAW, PRIOR)
    assert weighed.is_shown
    assert weighed.begin == pytest.approx(97.3, abs=0.15)


def test_a_force_that_ends_again_is_no_load_taken_up(ur10e):
    """A weight of a few seconds in the middle: the halves of what follows disagree."""
    log, gone = (log_of(ur10e, 4, LOAD, since=since) for since in (8.0, 14.0))
    torque = gone.rows.residual - log_of(ur10e, 4).rows.residual
    rows = replace(log.rows, residual=log.rows.residual - torque)
    assert not weigh_begin(replace(log, rows=rows), LAW, PRIOR).is_shown


def test_too_short_on_either_side_of_a_beginning(ur10e):
    assert weigh_begin(log_of(ur10e, 1, LOAD)[: 2 * MIN_ROWS], LAW, PRIOR) is None


def test_a_lifting_force_is_no_load(ur10e):
    assert not weigh(log_of(ur10e, 2, -LOAD), LAW, PRIOR).is_shown


def test_without_the_load_its_torque_is_gone(ur10e):
    log = log_of(ur10e, 3, LOAD)
    bare = log_of(ur10e, 3)
    remaining = without_load(log, weigh(log, LAW, PRIOR).load).rows.residual
    size = [
        np.linalg.norm(residual - bare.rows.residual) for residual in (log.rows.residual, remaining)
    ]
    assert size[1] < 0.2 * size[0]


def test_errors_of_the_arms_own_model_are_no_load(ur10e):
    """The last link's mass is off by what the model's standard error states."""
    log = log_of(ur10e, 4)
    model, sd = log.load[:, :, :1], np.array([0.1])
    rows = replace(log.rows, residual=log.rows.residual + 0.15 * model[:, :, 0])
    loose = weigh(replace(log, rows=rows, model=model, model_sd=sd), LAW, PRIOR)
    assert not loose.is_shown
    assert weigh(replace(log, rows=rows), LAW, PRIOR).is_shown


def test_a_log_of_seconds_is_not_judged(ur10e):
    log = log_of(ur10e, 5, LOAD)
    assert weigh(log[: MIN_ROWS - 1], LAW, PRIOR) is None
