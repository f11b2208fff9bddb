"""The unit of effort, N m or A, as gravity decides it."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchsight.models.recordings.plausibility.effort_unit import effort_unit
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot


def _log(robot: Robot, unit: str, speed: float = 0.1) -> Recording:
    t = np.linspace(0.0, 20.0, 400)
    phase = np.outer(t, 0.3 + 0.05 * np.arange(robot.num_joints))
    q = robot.home + 0.4 * np.sin(phase)
    v = speed * np.cos(phase)
    tau = np.asarray(robot.chain.gravity_torque(q)) + 0.03 * robot.effort_limit * np.sign(v)
    effort = tau if unit == "N m" else robot.motor_current(tau)
    return Recording(t, q, v, np.zeros_like(q), "log", tau_J=effort)


@pytest.mark.parametrize("unit", ["N m", "A"])
def test_gravity_determines_the_unit(bundled_arm: Robot, unit: str) -> None:
    decision = effort_unit([_log(bundled_arm, unit)], bundled_arm)
    assert decision.unit == unit
    sentence = decision.sentence(bundled_arm)
    assert f"in {unit}" in sentence
    other = "effort-in-newton-metres" if unit == "A" else "effort-in-amperes"
    assert f"--log-format {other}" in sentence


def test_a_unit_that_gravity_cannot_tell_is_reported(ur10e: Robot) -> None:
    robot = ur10e.with_torque_per_ampere([1.0] * 6)
    decision = effort_unit([_log(robot, "A")], robot)
    assert decision.unit == ""
    assert "torque_per_ampere is near 1" in decision.sentence(robot)
    decision = effort_unit([_log(ur10e, "A", speed=50.0)], ur10e)  # never slow
    assert decision.unit == ""
    assert "--log-format effort-in-amperes" in decision.sentence(ur10e)


def test_effort_between_both_units_is_not_decided(ur10e: Robot) -> None:
    log = _log(ur10e, "N m")
    effort = log.tau_J / np.sqrt(ur10e.torque_per_ampere)  # type: ignore[operator]
    ambiguous_log = Recording(log.t, log.q, log.v, log.current, "log", tau_J=effort)
    assert effort_unit([ambiguous_log], ur10e).unit == ""


@pytest.mark.parametrize("size", [0.0, 1e-4])  # of the gravity torque
def test_an_effort_that_is_not_filled_is_no_external_torque(ur10e: Robot, size: float) -> None:
    log = _log(ur10e, "N m")
    log = Recording(log.t, log.q, log.v, log.current, "log", tau_J=size * log.tau_J)  # type: ignore[operator]
    sentence = effort_unit([log], ur10e).sentence(ur10e)
    assert "does not fill it" in sentence
    assert "external" not in sentence


def test_an_effort_far_from_gravitys_torque_is_not_said_to_be_about_it(bundled_arm: Robot) -> None:
    log = _log(bundled_arm, "N m")
    assert log.tau_J is not None
    for size, words in ((1.0, "is about 1;"), (100.0, "is far from 1: it may be in another unit")):
        scaled = replace(log, tau_J=size * log.tau_J)
        assert words in effort_unit([scaled], bundled_arm).sentence(bundled_arm)
