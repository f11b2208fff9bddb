"""False alarms of twins are counted log by log and day by day, at every rate."""

from dataclasses import replace

import pytest
from sample_models import torque_error

from wrenchsight.analyses.experiments.contact_detection import contact_free_twins
from wrenchsight.analyses.experiments.contact_detection.contact_free_twins import (
    alarms_of_twins,
    model_of_twins,
)
from wrenchsight.models.identification.identified_model import IdentifiedModel

N = 6


def model_with_sd(robot, sd):
    """Of the nominal arm, without friction, so that it reads the twin's friction as contact."""
    error = torque_error(N, constant=sd, fitted_speed=0.0, fitted_load=0.0)
    return replace(IdentifiedModel.nominal(robot), torque_error=error)


def test_alarms_are_those_of_a_model_that_errs_more_than_it_says(ur10e, swing):
    logs, rates = dict.fromkeys(("one", "other"), swing), (1.0, 100.0)
    good, bad = (model_with_sd(ur10e, sd) for sd in (1e3, 0.5))
    hours, alarms, by_log = alarms_of_twins(logs, ur10e, good, rates, 2)
    assert hours == pytest.approx(4 * 400 * 0.01 / 3600.0, rel=0.01)
    assert alarms == {1.0: 0, 100.0: 0}
    assert by_log == {"one": 0, "other": 0}
    _, alarms, by_log = alarms_of_twins(logs, ur10e, bad, rates, 1)
    assert alarms[1.0] == sum(by_log.values()) >= 2
    assert by_log["one"] == by_log["other"]  # of one day and one seed


def test_the_first_log_of_the_fit_is_of_a_day_of_its_own(ur10e, swing, monkeypatch):
    days = []

    def twin_log(recording, robot, day, seed):
        days.append((day, seed))
        return recording

    monkeypatch.setattr(contact_free_twins, "twin_log", twin_log)
    monkeypatch.setattr(
        contact_free_twins,
        "identify",
        lambda logs, *rest: type("Result", (), {"model": len(logs)}),
    )
    assert model_of_twins([swing] * 3, ur10e) == 3
    assert days == [(1, 0), (2, 1), (2, 2)]
    assert min(days)[0] > 0
    assert max(days)[0] < contact_free_twins.FIRST_DAY
