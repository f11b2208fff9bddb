"""Contacts of a log judged as a whole: at E or on a link, and which readings that voids."""

import numpy as np
import pytest

from wrenchsight.analyses.methods.estimate.contact_places import (
    BASELINE_TIME,
    MAX_PIECE_TIME,
    ContactTorque,
    judge_places,
    torque_of_contacts,
)
from wrenchsight.models.detection.contact_detector import Detection
from wrenchsight.models.robot.robot import Robot

T = 0.01  # s
N = 1200
POSTURE = [0.062, 0.688, -0.079, -1.621, 0.028, 2.288, 0.847]  # rad
ON_LINK = np.array([-8.4, 5.3, -6.5, -4.9, -0.15, 0.0, 0.0])  # N m, of a touch of link 5
AT_E = np.array([4.0, -6.0, -12.0])  # N
CONTACTS = ((100, 150), (300, 900))


@pytest.fixture(scope="module")
def J() -> np.ndarray:
    at_posture = Robot.load("panda").chain.jacobian(np.array(POSTURE))
    return np.tile(at_posture, (N, 1, 1))


def detection(spans=CONTACTS) -> Detection:
    contact = np.zeros(N, bool)
    for begin, end in spans:
        contact[begin:end] = True
    none = np.zeros(N, bool)
    return Detection(np.where(contact, 3.0, 0.1), contact, none, none.astype(np.int8), none, none)


def test_a_touch_of_a_link_voids_its_samples_and_one_at_e_does_not(J):
    t, sd = T * np.arange(N), np.full((N, 7), 0.1)
    tau = np.zeros((N, 7))
    tau[100:150] = ON_LINK
    tau[300:900] = J[0, 3:].T @ AT_E
    placed, odds, may_be_valid = judge_places(detection(), ContactTorque(t, J, tau, sd))
    assert placed.misfit[100:150].all()
    assert placed.misfit.sum() == 50
    assert (placed.link[100:150] == 5).all()
    assert not may_be_valid[100:150].any()
    assert may_be_valid.sum() == N - 50
    np.testing.assert_allclose(odds[placed.contact].sum(axis=1), 1.0)
    assert not odds[~placed.contact].any()
    # The pieces of the long one add up: nothing is left of the links before the last.
    assert odds[500, :6].sum() < 0.02


def test_a_missing_value_of_one_sample_does_not_spoil_its_contact(J):
    t, sd = T * np.arange(N), np.full((N, 7), 0.1)
    tau = np.tile(ON_LINK, (N, 1))
    tau[120], J = np.nan, J.copy()
    J[130, 2, 2] = np.nan
    placed, odds, _ = judge_places(detection(((100, 150),)), ContactTorque(t, J, tau, sd))
    assert placed.misfit[100:150].all()
    assert np.isfinite(odds).all()
    tau[100:150] = np.nan  # nothing is known: every place is as likely
    placed, odds, may_be_valid = judge_places(
        detection(((100, 150),)), ContactTorque(t, J, tau, sd)
    )
    assert odds[120] == pytest.approx(1.0 / 8.0)
    assert not may_be_valid[100:150].any()


def test_a_contact_is_read_from_what_was_before_it():
    t, contact = T * np.arange(N), detection().contact
    tau = np.full((N, 7), 2.0)
    tau[contact] += 5.0
    tau[280] = 99.0  # within BASELINE_TIME of the second, but of one sample
    torque = torque_of_contacts(contact, t, tau)
    np.testing.assert_allclose(torque[100:150], 5.0)
    late = 300 + round(MAX_PIECE_TIME / T)
    baseline = tau[300 - round(BASELINE_TIME / T) : 295].mean()
    np.testing.assert_allclose(torque[300:late], 7.0 - baseline)
    np.testing.assert_allclose(torque[late:900], 7.0)  # what was before it has changed since
    np.testing.assert_array_equal(torque[~contact], tau[~contact])


@pytest.mark.parametrize("cut", [350, 480, 560, 640, 880, 899])
def test_what_a_log_holds_later_changes_verdicts_near_its_end_only(J, cut):
    """A contact of 6 s at E, in whose last 2 s somebody takes link 5."""
    t, sd = T * np.arange(N), np.full((N, 7), 0.1)
    tau = np.tile(J[0, 3:].T @ AT_E, (N, 1))
    tau[700:] = ON_LINK
    contact = detection(((300, 900),))
    whole = judge_places(contact, ContactTorque(t, J, tau, sd))
    # Without a change along the contact the test would show nothing.
    assert 0 < whole.may_be_valid[300:900].sum() < 600
    rows = slice(0, cut)
    part = judge_places(contact.rows(rows), ContactTorque(t[rows], J[rows], tau[rows], sd[rows]))
    # The last piece, up to 1.5 times as long, and the one before it, which it counts for.
    changed = max(300, cut - round(2.5 * MAX_PIECE_TIME / T))
    np.testing.assert_array_equal(part.may_be_valid[:changed], whole.may_be_valid[:changed])
    np.testing.assert_array_equal(part.odds[:changed], whole.odds[:changed])
