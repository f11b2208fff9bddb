"""False alarms of twins are counted log by log and day by day, at every rate."""

from dataclasses import replace

import numpy as np
import pytest
from sample_models import torque_error

from wrenchsight.analyses.experiments.contact_detection import contact_free_twins
from wrenchsight.analyses.experiments.contact_detection.contact_free_twins import (
    alarms_of_twins,
    model_of_twins,
)
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot

N = 6


@pytest.fixture(scope="module")
def robot():
    return Robot.load("ur10e")


@pytest.fixture(scope="module")
def log(robot):
    t = 0.01 * np.arange(600)
    s = 1 - np.cos(2 * np.pi * t / 3.0)
    q = np.round(np.asarray(robot.home) + 0.2 * s[:, None], 4)
    v = np.gradient(q, 0.01, axis=0)
    return Recording(t=t, q=q, v=v, current=np.zeros_like(q), source="real")


def model_with_sd(robot, sd):
    """Of the nominal arm, without friction, so that it reads the twin's friction as contact."""
    error = torque_error(N, constant=sd, fitted_speed=0.0, fitted_load=0.0)
    return replace(IdentifiedModel.nominal(robot), torque_error=error)


def test_alarms_are_those_of_a_model_that_errs_more_than_it_says(robot, log):
    logs, rates = {"one": log, "other": log}, (1.0, 100.0)
    good, bad = model_with_sd(robot, 1e3), model_with_sd(robot, 0.5)
    hours, alarms, by_log = alarms_of_twins(logs, robot, good, rates, 2, 0.01, 20.0)
    assert hours == pytest.approx(4 * 600 * 0.01 / 3600.0, rel=0.01)
    assert alarms == {1.0: 0, 100.0: 0}
    assert by_log == {"one": 0, "other": 0}
    told = []
    _, alarms, by_log = alarms_of_twins(
        *(logs, robot, bad, rates, 1, 0.01, 20.0), lambda share, what: told.append(share)
    )
    assert alarms[1.0] == sum(by_log.values()) >= 2
    assert by_log["one"] == by_log["other"]  # of one day and one seed
    assert told == [0.0, 0.5]


def test_the_first_log_of_the_fit_is_of_a_day_of_its_own(robot, log, monkeypatch):
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
    assert model_of_twins([log] * 3, robot) == 3
    assert days == [(1, 0), (2, 1), (2, 2)]
    assert min(days)[0] > 0
    assert max(days)[0] < contact_free_twins.FIRST_DAY
