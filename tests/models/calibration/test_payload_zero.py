"""A payload zeroed in some postures: its weight in others, within the stated errors."""

import numpy as np
import pytest

from wrenchsight.models.calibration.payload_zero import PayloadZero, weight_columns

T, SD, STICTION = 0.01, 0.5, np.array([9.0, 9.0, 4.0, 1.5, 1.5, 1.2])


def visit(robot, rng, postures, rest=1.5, move=1.5):
    """q, v (N, 6)."""
    corners = robot.home + rng.uniform(-0.8, 0.8, (postures, 6))
    q = []
    for k, posture in enumerate(corners):
        q.append(np.tile(posture, (round(rest / T), 1)))
        if k + 1 < postures:
            s = np.linspace(0.0, 1.0, round(move / T), endpoint=False)[:, None]
            q.append(posture + (corners[k + 1] - posture) * (10 * s**3 - 15 * s**4 + 6 * s**5))
    q = np.vstack(q)
    return q, np.gradient(q, T, axis=0)


def reading(robot, rng, q, v, mass, com):
    """What an observer reads of a weight: white noise in motion, one stiction a rest and joint."""
    J, R_WE = robot.chain.jacobian(q), robot.chain.pose(q)[0]
    gravity = np.asarray(robot.gravity)
    columns = weight_columns(J, R_WE, gravity)
    rests = np.abs(v) < 0.01
    tau = columns @ np.array([mass, *(mass * np.asarray(com))])
    tau = tau + SD * rng.normal(size=q.shape)
    for j in range(6):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], rests[:, j].astype(int), [0]])))
        for begin, end in edges.reshape(-1, 2):
            tau[begin:end, j] += rng.uniform(-1.0, 1.0) * STICTION[j]
    sd = np.where(rests, np.hypot(SD, STICTION / np.sqrt(3.0)), SD)
    return J, R_WE, tau, sd


def zeroed(robot, q, v, J, R_WE, tau, sd, rows=slice(None)):
    zero = PayloadZero(robot.payload, np.asarray(robot.gravity), T, np.full(6, T))
    is_valid = np.ones(len(q), bool)[rows]
    zero.add(q[rows], v[rows], J[rows], R_WE[rows], tau[rows], sd[rows], is_valid)
    return zero.result()


def test_columns_are_a_bodys_weight(ur10e):
    """Against the arm's own gravity with the body on its last link."""
    rng = np.random.default_rng(0)
    q = ur10e.home + rng.uniform(-1.0, 1.0, (20, 6))
    mass, com = 2.0, np.array([0.05, -0.1, 0.08])
    chain = ur10e.chain
    J, R_WE = chain.jacobian(q), chain.pose(q)[0]
    payload = weight_columns(J, R_WE, np.asarray(ur10e.gravity)) @ np.array([mass, *(mass * com)])
    # By virtual work: the torque is mass times g along the change of the body's place.
    step = 1e-6
    for j in range(6):
        ends = []
        for sign in (1.0, -1.0):
            moved = q.copy()
            moved[:, j] += sign * step
            R, p = chain.pose(moved)
            ends.append(p + R @ com)
        slope = (ends[0] - ends[1]) / (2.0 * step)
        expected = mass * slope @ np.asarray(ur10e.gravity)
        np.testing.assert_allclose(payload[:, j], expected, atol=1e-5)


def test_three_postures_and_the_motion_between_them_determine_the_payload(ur10e):
    gravity = np.asarray(ur10e.gravity)
    scores, worst = [], 0.0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        mass, com = rng.uniform(0.5, 2.0), rng.uniform(-0.1, 0.1, 3)
        q, v = visit(ur10e, rng, 3)
        payload = zeroed(ur10e, q, v, *reading(ur10e, rng, q, v, mass, com))
        truth = np.array([mass, *(mass * com)])
        scores.append(
            np.linalg.solve(np.linalg.cholesky(payload.covariance), payload.parameters - truth)
        )
        worst = max(worst, 9.81 * abs(payload.mass - mass))
        assert payload.postures == 3
        other = ur10e.home + rng.uniform(-1.0, 1.0, (5, 6))
        J, R_WE = ur10e.chain.jacobian(other), ur10e.chain.pose(other)[0]
        torque, columns = payload.torque(J, R_WE)
        np.testing.assert_allclose(torque, columns @ payload.parameters)
        np.testing.assert_allclose(columns, weight_columns(J, R_WE, gravity))
    assert np.mean(np.abs(scores) < 1.96) > 0.85
    assert worst < 2.0  # N


def test_a_rest_counts_once_however_long_it_lasts(ur10e):
    """Stiction hides one torque: ten seconds of it tell no more than one."""
    rng = np.random.default_rng(3)
    q = np.tile(ur10e.home + 0.3, (1000, 1))
    v = np.zeros_like(q)
    signals = reading(ur10e, rng, q, v, 1.0, np.array([0.0, 0.0, 0.05]))
    short, long = (zeroed(ur10e, q, v, *signals, slice(0, n)) for n in (100, 1000))
    np.testing.assert_allclose(long.covariance, short.covariance, rtol=0.01)
    assert long.postures == 1
    assert np.sqrt(long.covariance[0, 0]) > 0.1  # kg
    assert "zeroed in 1 posture: payload of" in long.sentence()


def test_joints_that_move_tell_more_the_longer_they_do(ur10e):
    rng = np.random.default_rng(4)
    q, v = visit(ur10e, rng, 4)
    signals = reading(ur10e, rng, q, v, 1.0, np.array([0.02, 0.0, 0.05]))
    sds = [
        np.sqrt(zeroed(ur10e, q, v, *signals, slice(0, n)).covariance[0, 0])
        for n in (150, 300, 900)
    ]
    assert sds[0] > 2.0 * sds[1] > 2.0 * sds[2]
    nothing = PayloadZero(ur10e.payload, np.asarray(ur10e.gravity), T, np.full(6, T)).result()
    assert nothing.mass == 0.0
    assert np.sqrt(nothing.covariance[0, 0]) == pytest.approx(ur10e.payload)
