"""The contact filter against dense Gaussian conditioning, and against motions of its own model."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchsight.models.contact.contact_force import (
    SIGMA_95,
    ContactForceConfig,
    FrictionErrorConfig,
    TorqueBlocks,
    read_contact_force,
)

_PERIOD = 0.02
_NO_JUMPS = 1e-30  # 1/s


def _blocks(tau_ext: np.ndarray, **changes: object) -> TorqueBlocks:
    """Two joints that slide steadily on one side under a force along the tool alone."""
    N, n = tau_ext.shape
    H = np.zeros((n, 6))
    H[:, 0] = (-0.7, -0.5)
    plain = TorqueBlocks(
        t=_PERIOD * np.arange(N),
        tau_ext=tau_ext,
        H=np.broadcast_to(H, (N, n, 6)),
        v=np.full((N, n), 0.3),
        tool_speed=np.full(N, 0.1),
        level=np.full((N, n), 10.0),
        slip=np.ones((N, n)),
        friction=np.full((N, n), 10.0),
        inertial=np.zeros((N, n)),
        spread=np.zeros((N, n)),
        known=np.ones(N, bool),
        period=_PERIOD,
    )
    return replace(plain, **changes)


def _config(lag: float = 0.0, **friction: float) -> ContactForceConfig:
    """Of a filter that knows its model: no jumps, nothing considered."""
    own = FrictionErrorConfig(offset=0.0, common=0.0, slow=0.0, **friction)
    return ContactForceConfig(jump_rate=_NO_JUMPS, lag=lag, friction=own)


def _conditioned(y: np.ndarray, config: ContactForceConfig, until: int, k: int) -> np.ndarray:
    """Mean and sd of the force of block k given y up to block `until`, by one dense Gaussian."""
    N, n = until + 1, y.shape[1]
    h = np.array([-0.7, -0.5])
    first = config.normal_sd**2 + config.normal_rate**2 * _PERIOD
    steps = np.minimum.outer(np.arange(N), np.arange(N))
    force = first + config.normal_rate**2 * _PERIOD * steps
    decay = np.exp(-_PERIOD / config.friction.sliding_time)
    sd = config.friction.sliding * 10.0
    error = sd**2 * decay ** np.abs(np.subtract.outer(np.arange(N), np.arange(N)))
    S = np.kron(force, np.outer(h, h)) + np.kron(error, np.eye(n))
    S += config.white**2 * np.eye(N * n)
    cross = np.kron(force[k], h)
    gain = np.linalg.solve(S, cross)
    mean = gain @ y[:N].ravel()
    return np.array([mean, np.sqrt(force[k, k] - gain @ cross)])


@pytest.mark.parametrize("lag", [0.0, 0.06])
def test_the_reading_is_the_conditional_mean(lag: float) -> None:
    y = np.random.default_rng(1).normal(0.0, 2.0, (25, 2)) - np.array([14.0, 10.0])
    config = _config(lag)
    force = read_contact_force(_blocks(y), config)
    for k in (0, 7, 24):
        until = min(k + round(lag / _PERIOD), 24)
        mean, sd = _conditioned(y, config, until, k)
        assert force.normal[k] == pytest.approx(mean, rel=1e-9)
        assert force.normal_sd[k] >= sd * (1.0 - 1e-9)  # larger where innovations are


def test_the_band_holds_what_comes_from_its_own_model() -> None:
    rng = np.random.default_rng(2)
    config = _config(0.06)
    inside = []
    for _ in range(40):
        N = 100
        force = 30.0 + np.cumsum(rng.normal(0.0, config.normal_rate * np.sqrt(_PERIOD), N))
        decay = np.exp(-_PERIOD / config.friction.sliding_time)
        sd = config.friction.sliding * 10.0
        e = np.zeros((N, 2))
        e[0] = rng.normal(0.0, sd, 2)
        for k in range(1, N):
            e[k] = decay * e[k - 1] + rng.normal(0.0, sd * np.sqrt(1.0 - decay**2), 2)
        y = np.outer(force, [-0.7, -0.5]) + e + rng.normal(0.0, config.white, (N, 2))
        read = read_contact_force(_blocks(y), config)
        inside.append(np.abs(read.normal - force) < SIGMA_95 * read.normal_sd)
    # 40 logs of some 10 independent errors: 95 % within 2 %; the misfit only widens.
    assert 0.93 < np.mean(inside) < 0.99


def test_what_is_considered_never_averages_out() -> None:
    """An offset of one joint of sd 0.75 N m is 0.75 / 0.7 N, however long the log."""
    own = FrictionErrorConfig(sliding=0.01, offset=0.75, common=0.0, slow=0.0)
    config = ContactForceConfig(jump_rate=_NO_JUMPS, normal_rate=0.1, white=0.01, friction=own)
    y = np.zeros((800, 2))
    one = np.zeros((800, 2, 6))
    one[:, 0, 0] = -0.7
    force = read_contact_force(_blocks(y, H=one), config)
    assert force.normal_sd[-100] == pytest.approx(0.75 / 0.7, rel=0.05)


def test_a_force_that_comes_at_once_is_read_at_once() -> None:
    y = np.zeros((60, 2))
    y[30:] = np.array([-0.7, -0.5]) * 100.0
    force = read_contact_force(_blocks(y))
    assert np.flatnonzero(force.jump).tolist() == [30]
    np.testing.assert_allclose(force.normal[33:], 100.0, atol=1.0)
    np.testing.assert_allclose(force.normal[:30], 0.0, atol=1.0)


def test_the_force_starts_afresh_after_a_gap() -> None:
    y = np.zeros((60, 2))
    y[40:] = np.array([-0.7, -0.5]) * 50.0
    known = np.ones(60, bool)
    known[20:40] = False
    force = read_contact_force(_blocks(y, known=known))
    assert not force.jump[40]
    np.testing.assert_allclose(force.normal[40:], 50.0, atol=3.0)
    assert force.normal_sd[30] > force.normal_sd[10]
    assert not force.valid[30]  # nothing is known there


def test_a_joint_at_rest_says_little() -> None:
    still = np.zeros((60, 2))
    y = np.tile(np.array([-0.7, -0.5]) * 20.0, (60, 1))
    config = _config(0.06)
    sliding = read_contact_force(_blocks(y), config)
    standing = _blocks(y, v=still, tool_speed=np.zeros(60), slip=still, friction=still)
    resting = read_contact_force(standing, config)
    assert resting.normal_sd[-1] > 2.0 * sliding.normal_sd[-1]


def test_a_reading_whose_band_holds_zero_is_not_valid() -> None:
    y = np.tile(np.array([-0.7, -0.5]) * 1.0, (60, 1))
    assert not read_contact_force(_blocks(y)).valid.any()
    assert read_contact_force(_blocks(30.0 * y)).valid[10:].all()
