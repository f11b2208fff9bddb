"""A log of an arm that a hand leads: the drives hold gravity, and a share of the rest."""

import math
from dataclasses import replace

import numpy as np
import pytest

from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.hypotheses import effort_gain, led_arm
from wrenchsight.models.hypotheses.judgement import SURE_ODDS, judge_log
from wrenchsight.models.identification.identified_model import (
    IdentifiedModel,
    LogSource,
    Provenance,
)
from wrenchsight.models.recordings.recording import Recording

COULOMB = np.array([8.0, 8.5, 6.0, 2.0, 2.2, 1.9])  # N m
RATE = 2.0 * np.pi * np.array([0.11, 0.13, 0.17, 0.19, 0.23, 0.29])  # rad/s
CENTRE = np.array([0.0, -0.8, 1.0, -0.5, 1.0, 0.0])  # rad
ERROR_SHARE = 0.02  # of Coulomb friction, noise of the torque


def judged(robot, share):
    """The judgement of a log whose arm is led from 4 to 20 s of 24 s.

    Args:
        share: of friction and of inertial torque, which the drives supply there.
    """
    t = np.arange(0.0, 24.0, 0.02)
    angle = t[:, None] * RATE
    q, v = CENTRE + 0.7 * np.sin(angle), 0.7 * RATE * np.cos(angle)
    vdot = -0.7 * RATE**2 * np.sin(angle)
    gravity = robot.chain.gravity_torque(q)
    rest = robot.chain.inverse_dynamics(q, v, vdot) - gravity + COULOMB * np.tanh(v / 0.01)
    is_led = (t > 4.0) & (t < 20.0)
    tau = gravity + np.where(is_led, share, 1.0)[:, None] * rest
    tau += ERROR_SHARE * COULOMB * np.random.default_rng(3).normal(size=q.shape)
    model = replace(
        IdentifiedModel.nominal(robot),
        friction=SemiParametricFriction(CoulombViscous(COULOMB, np.zeros(6), np.zeros(6))),
        residual_covariance=np.diag((0.05 * COULOMB) ** 2),
        provenance=Provenance(logs=[LogSource(name="a.csv")]),
    )
    return judge_log([Recording(t, q, v, robot.motor_current(tau), "log.csv")], robot, model)


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_a_led_arm_is_likelier_than_any_fault(ur10e, share):
    judgement = judged(ur10e, share)
    assert judgement.fault is None, judgement.sentence()
    assert max(judgement.log_odds, key=lambda name: judgement.log_odds[name]) == led_arm.NAME
    # Against the log as it is a gain had odds of 1e13 to 1 at half a share.
    assert judgement.log_odds[effort_gain.NAME] < 0.0


def test_drives_that_do_all_give_it_no_odds_that_could_hide_a_fault(ur10e):
    assert judged(ur10e, 1.0).log_odds[led_arm.NAME] < math.log(SURE_ODDS)
