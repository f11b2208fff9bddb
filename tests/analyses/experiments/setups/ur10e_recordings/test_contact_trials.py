"""Pushes put into a log are those that a force at the point exerts, and are counted once."""

from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest
from scipy.stats import poisson

from wrenchsight.analyses.experiments.setups.ur10e_recordings.contact_trials import (
    Tally,
    TrialLog,
    false_alarm_metrics,
    jacobian_on_link,
    onsets,
    put_in,
    schedule,
)
from wrenchsight.models.detection.contact_detector import Detection
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.recordings.recording import Recording

T = 0.01


def detection(contact, misfit=None, link=0):
    contact = np.asarray(contact, bool)
    misfit = np.zeros(len(contact), bool) if misfit is None else misfit
    links = np.where(misfit, link, 0).astype(np.int8)
    return Detection(1.0 * contact, contact, misfit, links, ~contact, ~contact)


@pytest.mark.parametrize("link", [2, 3, 4])
def test_a_force_on_a_link_loads_the_joints_before_it(sts, link):
    """Against pinocchio: the Jacobian of that very point, carried by that link's joint."""
    model = pin.buildModelFromUrdf(str(sts.source.with_name("robot.urdf")))
    data = model.createData()
    q = sts.home + np.array([0.2, -0.3, 0.4, 0.5, -0.6, 0.7])
    J = jacobian_on_link(sts.chain.jacobian(q[None]), link)[0]
    assert (J[:, link:] == 0.0).all()
    pin.computeJointJacobians(model, data, q)
    joint = pin.getJointJacobian(model, data, link, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
    # The point lies on the next joint's axis; find it from that joint's pose and E.
    _, p_WE = sts.chain.pose(q)
    axis = data.oMi[link + 1].rotation @ np.array([0.0, 0.0, 1.0])
    screw = sts.chain.jacobian(q)[:3, link]
    assert np.linalg.norm(np.cross(axis, screw)) < 1e-9  # joints turn about their z here
    origin = data.oMi[link + 1].translation
    point = origin + axis * (axis @ (p_WE - origin))
    offset = point - data.oMi[link].translation
    expected = joint[:3] + np.cross(joint[3:].T, offset).T
    np.testing.assert_allclose(J, expected, atol=1e-9)


def test_pushes_are_of_one_size_and_follow_the_jacobian():
    J = np.tile(np.eye(3), (50, 1, 1))
    tau = put_in([(10, 20), (30, 31)], J, 12.0, np.random.default_rng(0))
    sizes = np.linalg.norm(tau, axis=1)
    np.testing.assert_allclose(sizes[10:20], 12.0)
    np.testing.assert_allclose(sizes[30], 12.0)
    assert sizes[[9, 20, 29, 31]].tolist() == [0.0] * 4
    assert (tau[10:20] == tau[10]).all()
    assert not np.allclose(tau[10], tau[30])


def test_pushes_are_put_where_the_arm_moves():
    v = np.zeros((2000, 2))
    v[600:1200, 1] = -0.2
    spans = schedule(v, 0.5, 1.0, 2.0, T, 0.1)
    assert [end - begin for begin, end in spans] == [50] * len(spans)
    assert spans[0][0] >= 600
    assert spans[-1][1] <= 1200
    assert all(b[0] - a[1] >= 100 for a, b in pairwise(spans))
    assert schedule(0.0 * v, 0.5, 1.0, 2.0, T, 0.1) == []


def test_late_and_missed_contacts_are_reported():
    contact = np.zeros(1000, bool)
    contact[105:160] = True  # 5 samples after the first that shows the push
    contact[455:460] = True  # just after the end
    contact[690:760] = True  # there already: says nothing of the push
    misfit = np.zeros(1000, bool)
    misfit[110:150] = True
    detected = detection(contact, misfit, link=3)
    tally = Tally()
    for begin in (100, 400, 700, 800):
        tally.add(detected, begin, begin + 50, T, 3)
    metrics = tally.metrics()
    assert metrics["contacts"] == 3
    assert metrics["missed"] == 1
    assert metrics["delay_max_s"] == pytest.approx(0.56)
    assert min(tally.delays) == pytest.approx(0.06)
    assert (metrics["link_right"], metrics["link_wrong"]) == (1, 0)
    assert Tally().metrics()["delay_median_s"] is None


def test_the_rates_that_agree_are_those_of_poisson():
    metrics = false_alarm_metrics(3, 2.0)
    assert metrics["false_alarms_per_hour"] == 1.5
    assert poisson.cdf(3, 2.0 * metrics["false_alarms_per_hour_upper"]) == pytest.approx(0.05)
    assert poisson.sf(2, 2.0 * metrics["false_alarms_per_hour_lower"]) == pytest.approx(0.05)
    assert false_alarm_metrics(0, 2.0)["false_alarms_per_hour_lower"] == 0.0
    assert onsets(np.array([1, 1, 0, 1, 0], bool)).tolist() == [0, 3]


def test_the_push_reaches_the_reading(sts):
    """A nominal model and a noise-free motion: what is put in is read through K_0 / (s + K_0)."""
    t = np.arange(0.0, 3.0, T)
    phase = np.linspace(0.0, 2.0, 6)
    q = sts.home + 0.2 * np.sin(1.5 * t[:, None] + phase)
    v = 0.3 * np.cos(1.5 * t[:, None] + phase)
    vdot = -0.45 * np.sin(1.5 * t[:, None] + phase)
    torque = sts.chain.inverse_dynamics(q, v, vdot)
    current = torque / (sts.current_sign * sts.torque_per_ampere)
    log = TrialLog(
        Recording(t=t, q=q, v=v, current=current, source="free"),
        sts,
        IdentifiedModel.nominal(sts),
        T,
    )
    tau = put_in([(150, 250)], log.J[:, 3:], 30.0, np.random.default_rng(1))
    gain = sts.current_sign * sts.torque_per_ampere
    read = log.estimator.observe(log.q, log.v, log.current - tau / gain).tau_ext
    free = log.estimator.observe(log.q, log.v, log.current).tau_ext
    # 1 s is 20 time constants; the force then follows the moving J with a lag of 1 / K_0.
    np.testing.assert_allclose((read - free)[245], tau[245], atol=0.05 * np.abs(tau).max())
    assert log.hours == pytest.approx(3.0 / 3600.0)
