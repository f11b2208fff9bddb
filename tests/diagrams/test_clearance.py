"""Clearance: distances, gradient, proof over a whole motion."""

import numpy as np
import pytest

from diagrams.clearance import INFLUENCE, Clearance
from models.robot import Robot


@pytest.fixture(scope="module")
def robot():
    return Robot.load("sts_sre4_600")


@pytest.fixture(scope="module")
def clearance(robot):
    return Clearance(robot, margin=0.02)


def near_floor(robot, clearance):
    """A posture whose smallest slack is that of a tool near the floor."""
    q = robot.home.copy()
    for q[1] in np.linspace(-0.26, -1.9, 200):
        if clearance.slack(q) < 0.01:
            return q
    raise AssertionError("the arm never comes down")


def test_home_is_clear_and_a_folded_arm_is_not(robot, clearance):
    assert clearance.has_shapes and clearance.overlapping == ()
    assert clearance.slack(robot.home) > 0.0
    folded = robot.home.copy()
    folded[4] = 2.9  # the tool in the forearm
    assert clearance.slack(folded) < 0.0


def test_the_floor_counts(robot):
    q = near_floor(robot, Clearance(robot))
    assert Clearance(robot).slack(q) < Clearance(robot, floor=-0.1).slack(q)
    low = Clearance(robot, floor=0.3)
    assert low.slack(q) < 0.0


def test_the_smooth_slack_is_below_the_true_one_and_has_its_gradient(robot, clearance):
    q = near_floor(robot, clearance)
    value, gradient = clearance.smooth_slack(q)
    slack = clearance.slack(q)
    assert slack - 0.01 < value <= slack
    e = 1e-4
    difference = [
        (clearance.smooth_slack(q + e * axis)[0] - clearance.smooth_slack(q - e * axis)[0])
        / (2 * e)
        for axis in np.eye(6)
    ]
    # Distances between curved shapes are found iteratively, to some 1e-6 m.
    np.testing.assert_allclose(gradient, difference, atol=0.02)
    assert np.abs(gradient).max() > 0.1


def test_a_contact_between_samples_is_found(robot, clearance):
    """A dip of 30 ms into the floor, where samples a tenth of a second apart see nothing."""
    q = near_floor(robot, clearance)
    high = robot.home

    def position(t):
        dip = np.exp(-(((t - 0.55) / 0.015) ** 2))
        return high + dip * 1.3 * (q - high)

    speed = 1.3 * np.abs(q - high) / 0.015
    clear, closest = clearance.certify(position, speed, 1.0)
    assert not clear
    assert closest is not None and abs(closest.time - 0.55) < 0.05

    def harmless(t):
        return high + 0.05 * np.sin(t) * np.ones(6)

    clear, closest = clearance.certify(harmless, np.full(6, 0.05), 6.0)
    assert clear
    lowest = min(clearance.slack(harmless(t)) for t in np.linspace(0, 6, 300))
    assert (closest.slack if closest else INFLUENCE) < lowest + 2e-3
