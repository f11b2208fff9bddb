"""Contact in an external torque of a made-up arm with an offset, noise, and what touches leave."""

import numpy as np
import pytest

from wrenchsight.models.detection.torque_contact import (
    CONTACT_LEVEL,
    TorqueContactDetector,
    first_baseline,
    learn_reported_torque_sd,
)

T = 0.01  # s
N = 3000
NOISE = 0.02  # N m
TOUCHES = tuple((200 + 100 * k, 245 + 100 * k) for k in range(20))


@pytest.fixture(scope="module")
def touched() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """t, tau_ext and J of seven joints at rest, touched by 4 N m; each touch shifts the offset."""
    rng = np.random.default_rng(2)
    t = T * np.arange(N)
    tau = 0.4 + NOISE * rng.normal(size=(N, 7))
    for begin, end in TOUCHES:
        press = np.sin(np.pi * np.arange(end - begin) / (end - begin))
        tau[begin:end, :2] += np.outer(press, [4.0, -2.0])
        tau[end:, :3] += 0.08 * rng.normal(size=3)
    J = np.broadcast_to(rng.normal(size=(6, 7)), (N, 6, 7)).copy()
    return t, tau, J


def found_in(t, tau, J, error=None):
    error = learn_reported_torque_sd(t, tau, J) if error is None else error
    return TorqueContactDetector(error, first_baseline(t, tau)).run(t, tau, J)


def spans(contact):
    return np.flatnonzero(np.diff(np.r_[0, contact.astype(int), 0])).reshape(-1, 2)


@pytest.mark.long
def test_every_touch_is_found_and_nothing_else(touched) -> None:
    contacts = found_in(*touched)
    assert len(spans(contacts.contact)) == len(TOUCHES)
    for (begin, end), (first, last) in zip(spans(contacts.contact), TOUCHES, strict=True):
        assert first <= begin <= first + 8
        assert last - 8 <= end <= last + 1
    assert not contacts.moving.any()
    assert (contacts.statistic[contacts.contact].max()) > 1.0


def test_the_error_is_noise_step_and_a_floor(touched) -> None:
    error = learn_reported_torque_sd(*touched)
    joint_sd = np.r_[np.full(3, np.hypot(NOISE, 0.08)), np.full(4, NOISE)]
    expected = np.sqrt(joint_sd**2 + np.mean(joint_sd**2))
    # Twenty steps tell their sd to a quarter; the baseline's own noise is on top.
    np.testing.assert_allclose(error.rest_sd, expected, rtol=0.35)
    np.testing.assert_array_equal(error.moving_sd, error.rest_sd)


def test_chunks_change_nothing(touched) -> None:
    t, tau, J = touched
    error = learn_reported_torque_sd(t, tau, J)
    whole = found_in(t, tau, J, error)
    detector = TorqueContactDetector(error, first_baseline(t, tau))
    parts = [detector.run(t[a:b], tau[a:b], J[a:b]) for a, b in ((0, 210), (210, 1700), (1700, N))]
    for name in whole._fields:
        joined = np.concatenate([getattr(part, name) for part in parts])
        np.testing.assert_array_equal(joined, getattr(whole, name))


def test_a_force_that_falls_slowly_stays_a_contact(touched) -> None:
    t, tau, J = touched
    error = learn_reported_torque_sd(t, tau, J)
    tau = tau.copy()
    tau[:] = 0.4
    tau[300:1300, 1] += np.linspace(10.0, 1.0, 1000)
    ((begin, end),) = spans(found_in(t, tau, J, error).contact)
    assert begin <= 302
    assert 1295 <= end <= 1301


def test_one_wild_sample_is_no_contact(touched) -> None:
    t, tau, J = touched
    error = learn_reported_torque_sd(t, tau, J)
    tau = np.full_like(tau, 0.4)
    tau[500, 2] += 50.0
    contacts = found_in(t, tau, J, error)
    assert contacts.statistic[500] > CONTACT_LEVEL
    assert not contacts.contact.any()


def test_missing_samples_are_skipped(touched) -> None:
    t, tau, J = touched
    tau = tau.copy()
    tau[:40] = np.nan
    tau[600:610, 4] = np.nan
    contacts = found_in(t, tau, J)
    assert np.isfinite(contacts.baseline).all()
    assert not contacts.contact[:190].any()
    assert len(spans(contacts.contact)) == len(TOUCHES)


def test_motion_has_an_error_of_its_own() -> None:
    rng = np.random.default_rng(3)
    t = T * np.arange(6000)
    J = np.tile(rng.normal(size=(6, 7)), (len(t), 1, 1))
    late = t >= 30.0
    J[late, 0] += 0.5 * np.sin(2.0 * (t[late, None] - 30.0))
    tau = NOISE * rng.normal(size=(len(t), 7))
    slow = np.sin(2.0 * np.pi * 0.8 * t[late])
    tau[late, 1] += slow
    error = learn_reported_torque_sd(t, tau, J)
    assert error.moving_sd[1] > 5.0 * error.rest_sd[1]
    assert not found_in(t, tau, J, error).contact.any()


def test_a_log_that_says_nothing_has_some_error() -> None:
    t, J = T * np.arange(10), np.zeros((10, 6, 7))
    error = learn_reported_torque_sd(t, np.full((10, 7), np.nan), J)
    assert (error.rest_sd > 0.0).all()
