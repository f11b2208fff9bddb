"""The evidence of gravity, inertia and friction for the signs of drives."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.plausibility.drive_evidence import (
    CORRELATION,
    SURE,
    odds_text,
    recordings_sign_evidence,
)
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_checks import RecordingChecks
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.robot.robot import Robot

COULOMB = np.array([8.0, 8.5, 6.0, 2.0, 2.2, 1.9])


def motion(robot: Robot, amplitude: float, duration: float = 20.0) -> Recording:
    """An arm that swings about a posture out of which gravity pulls, with Coulomb friction."""
    t = np.arange(0.0, duration, 0.01)
    rate = 2.0 * np.pi * np.array([0.11, 0.13, 0.17, 0.19, 0.23, 0.29])
    centre = np.array([0.0, -0.8, 1.0, -0.5, 1.0, 0.0])
    q = centre + amplitude * np.sin(t[:, None] * rate)
    v = amplitude * rate * np.cos(t[:, None] * rate)
    vdot = -amplitude * rate**2 * np.sin(t[:, None] * rate)
    torque = robot.chain.inverse_dynamics(q, v, vdot) + COULOMB * np.sign(v)
    current = torque / (robot.current_sign * robot.torque_per_ampere)
    return Recording(t, q, v, current, "log.csv")


def test_a_turned_torque_gives_the_opposite_odds(ur10e: Robot) -> None:
    log = motion(ur10e, 0.5)
    right = recordings_sign_evidence([log], ur10e)
    wrong = recordings_sign_evidence([replace(log, current=-log.current)], ur10e)
    assert right.total > 100.0
    assert not len(right.contradicted())
    # Turning the torque exchanges the two fits: but for rounding the logarithm changes its sign.
    np.testing.assert_allclose(wrong.log_odds, -right.log_odds, rtol=1e-6, atol=1e-6)
    np.testing.assert_array_equal(wrong.contradicted(), np.arange(6))
    assert (right.samples <= log.duration / CORRELATION + 1).all()


def test_the_odds_are_those_of_the_definition(ur10e: Robot) -> None:
    """Both fits of a joint anew, from the samples themselves."""
    log = motion(ur10e, 0.5, 5.0)
    evidence = recordings_sign_evidence([log], ur10e)
    inner = slice(3, -3)
    vdot = (log.v[6:] - log.v[:-6]) / (log.t[6:] - log.t[:-6])[:, None]
    q, v = log.q[inner], log.v[inner]
    gravity = ur10e.chain.gravity_torque(q)
    inertial = ur10e.chain.inverse_dynamics(q, v, vdot) - gravity
    torque = ur10e.joint_torque(log.current[inner])
    turn = 0.02 * ur10e.velocity_limit
    for j in range(6):
        x = np.stack([gravity, inertial, vdot, np.tanh(v / turn), v], axis=-1)[:, j]
        weight = np.where(np.abs(v[:, j]) > turn[j], 1.0 / 0.25, 1.0 / 2.5)
        weight = weight * (log.t[-1] - log.t[0]) / len(q)
        upper = [5.0, 5.0, np.inf, ur10e.effort_limit[j], np.inf]
        root = np.sqrt(weight)
        squares = [
            2.0 * lsq_linear(x * root[:, None], sign * torque[:, j] * root, (0.0, upper)).cost
            for sign in (1.0, -1.0)
        ]
        r = np.array(squares) / weight.sum() + (0.05 * ur10e.effort_limit[j]) ** 2
        odds = 0.5 * weight.sum() * np.log(r[1] / r[0])
        # 1e-3: two ways of bounded least squares; without their tolerance it is 1e-6.
        assert evidence.log_odds[j] == pytest.approx(odds, rel=1e-3, abs=1e-3)


def test_a_slope_across_a_gap_does_not_count(ur10e: Robot) -> None:
    """The arm moved in the gap: the change of v across it over time is no acceleration."""
    log = motion(ur10e, 0.5, 40.0)
    is_logged = (np.arange(len(log.t)) % 100) < 10
    of_whole_log = recordings_sign_evidence([log], ur10e)
    of_log_with_gaps = recordings_sign_evidence([log[is_logged]], ur10e)
    # The explained share stays .99 and more; a slope over 2 s does not follow the motion.
    np.testing.assert_allclose(of_log_with_gaps.right, of_whole_log.right, atol=2e-3)


def test_a_single_wrong_sign_is_found(ur10e: Robot) -> None:
    log = motion(ur10e, 0.5)
    turned = replace(log, current=log.current * [1, 1, 1, -1, 1, 1])
    evidence = recordings_sign_evidence([turned], ur10e)
    np.testing.assert_array_equal(evidence.contradicted(), [3])
    sentence = evidence.sentence("current", ur10e.joint_names)
    assert ur10e.joint_names[3] in sentence
    assert "all joints" not in sentence


def test_without_a_contradiction_there_is_no_sentence(ur10e: Robot) -> None:
    evidence = recordings_sign_evidence([motion(ur10e, 0.5)], ur10e)
    with pytest.raises(ValueError, match="no sign is contradicted"):
        evidence.sentence("current", ur10e.joint_names)


def test_a_vertical_axis_shows_its_sign_by_friction_and_inertia(ur10e: Robot) -> None:
    evidence = recordings_sign_evidence([motion(ur10e, 0.5)], ur10e)
    assert evidence.log_odds[0] > np.log(SURE)  # no weight acts on the first joint


def test_inertia_against_gravity_is_no_wrong_sign(ur10e: Robot) -> None:
    """A hanging arm swings quickly: the inertial torque opposes gravity, and exceeds it."""
    t = np.arange(0.0, 20.0, 0.01)
    rate = 2.0 * np.pi * 0.8
    hanging = np.array([0.0, np.pi / 2, 0.0, -np.pi / 2, 0.0, 0.0])
    direction = np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0])
    q = hanging + 0.12 * np.sin(rate * t)[:, None] * direction
    v = 0.12 * rate * np.cos(rate * t)[:, None] * direction
    vdot = -0.12 * rate**2 * np.sin(rate * t)[:, None] * direction
    torque = ur10e.chain.inverse_dynamics(q, v, vdot)
    gravity = ur10e.chain.gravity_torque(q)
    cosine = np.sum(torque[:, 1] * gravity[:, 1]) / np.linalg.norm(torque[:, 1])
    assert cosine / np.linalg.norm(gravity[:, 1]) < -0.5
    current = torque / (ur10e.current_sign * ur10e.torque_per_ampere)
    log = Recording(t, q, v, current, "log.csv")
    RecordingChecks(ur10e).feed(log)
    assert not len(recordings_sign_evidence([log], ur10e).contradicted())


def test_joints_at_rest_count_as_few_samples(ur10e: Robot) -> None:
    """Stiction may carry anything: minutes at rest are no more than a few independent samples."""
    log = motion(ur10e, 0.0)
    noise = np.random.default_rng(0).normal(size=log.q.shape)
    still = replace(log, v=0.0 * log.v, current=noise * 0.1)
    evidence = recordings_sign_evidence([still], ur10e)
    assert np.abs(evidence.log_odds).max() < np.log(SURE) / 2
    assert (evidence.samples < 10.0).all()


def test_accepted_signs_are_read_with_a_notice(ur10e: Robot, tmp_path: Path) -> None:
    log = motion(ur10e, 0.5)
    path = tmp_path / "turned.csv"
    columns = replace(log, current=-log.current).columns()
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="")
    with pytest.raises(InputError, match=r"odds of .* to 1.*--accept-signs"):
        read_recording(path, robot=ur10e)
    accepted = read_recording(path, robot=ur10e, accept_signs=True)
    assert any("accepted because of --accept-signs" in notice for notice in accepted.notices)
    np.testing.assert_allclose(accepted.current, -log.current)


def test_torque_in_place_of_current_is_refused_also_with_accepted_signs(ur10e: Robot) -> None:
    log = motion(ur10e, 0.5)
    for sign in (1.0, -1.0):
        torque = replace(log, current=sign * log.current * ur10e.torque_per_ampere)
        with pytest.raises(InputError, match=r"look like torques in N m|median torque"):
            RecordingChecks(ur10e, accept_signs=True).feed(torque)


@pytest.mark.parametrize(
    ("log_odds", "text"), [(np.log(150.0), "150 to 1"), (np.log(1e12), "1e12 to 1")]
)
def test_odds_are_printed_as_n_to_1(log_odds: float, text: str) -> None:
    assert odds_text(float(log_odds)) == text


@pytest.mark.parametrize(
    ("name", "least"),
    [
        ("ur10e_more/ur-20_01_17-p1.csv", 5.0),  # ten seconds at rest
        ("ur10e_more/ur-20_01_31-unload.csv", 300.0),
        ("ur10e/ur-20_02_19_14harm50secLoad.csv", 300.0),  # with a load that the robot's file lacks
    ],
)
def test_real_logs_confirm_the_signs(
    ur10e: Robot, data: Callable[[str], Path], name: str, least: float
) -> None:
    evidence = recordings_sign_evidence([read_recording(data(name), robot=ur10e)], ur10e)
    assert evidence.total > least
    assert evidence.log_odds.min() > -1.0
