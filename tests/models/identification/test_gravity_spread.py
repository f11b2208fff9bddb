"""What logs leave open of gravity: the jackknife's spread, posture by posture."""

import numpy as np
import pytest

from wrenchsight.models.identification.gravity_spread import (
    MAX_DIRECTIONS,
    jackknife,
    largest_spread,
    spread_beyond,
    spread_table,
    strongest,
)
from wrenchsight.models.robot.robot import Robot


@pytest.fixture
def fits(ur10e: Robot) -> np.ndarray:
    """(4, n, 5) parameters of four fits that differ."""
    n = ur10e.num_joints
    rng = np.random.default_rng(1)
    parameters = np.zeros((n, 5))
    parameters[:, :4] = ur10e.chain.inertial_parameters[:, :4]
    return parameters + rng.normal(0.0, [0.3, 0.05, 0.05, 0.05, 0.2], (4, n, 5))


@pytest.fixture
def q(ur10e: Robot) -> np.ndarray:
    return np.random.default_rng(2).uniform(-2.0, 2.0, (20, ur10e.num_joints))


def _torque(robot: Robot, parameters: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Gravity of a whole chain with these parameters, and the offset."""
    inertial = robot.chain.inertial_parameters.copy()
    inertial[:, :4] = parameters[:, :4]
    chain = robot.chain.with_inertial_parameters(inertial, robot.chain.reflected_inertia)
    return np.asarray(chain.gravity_torque(q)) + parameters[:, 4]


def _variance(table: np.ndarray, q: np.ndarray) -> np.ndarray:
    variance = np.empty_like(q)
    for k, row in enumerate(q):
        spread_beyond(table, row, variance[k])
    return variance


def test_the_spread_is_the_jackknife_of_the_torques(
    ur10e: Robot, fits: np.ndarray, q: np.ndarray
) -> None:
    """Gravity is linear: the variance of the fits' torques is that of their parameters' torque."""
    torques = np.stack([_torque(ur10e, fit, q) for fit in fits])
    expected = (len(fits) - 1) * torques.var(axis=0)
    table = spread_table(ur10e.chain, jackknife(fits), np.zeros(ur10e.num_joints))
    np.testing.assert_allclose(_variance(table, q), expected, rtol=1e-9)
    largest = largest_spread(ur10e.chain, jackknife(fits), q)
    np.testing.assert_allclose(largest, np.sqrt(expected.max(axis=0)), rtol=1e-9)


def test_postures_of_the_fitted_logs_have_none_beyond(
    ur10e: Robot, fits: np.ndarray, q: np.ndarray
) -> None:
    spread = jackknife(fits)
    fitted = largest_spread(ur10e.chain, spread, q[:10])
    table = spread_table(ur10e.chain, spread, fitted)
    assert _variance(table, q[:10]).max() <= 1e-12
    outside = largest_spread(ur10e.chain, spread, q[10:])
    beyond = np.maximum(0.0, outside**2 - fitted**2)
    assert beyond.max() > 0.1
    np.testing.assert_allclose(_variance(table, q[10:]).max(axis=0), beyond, rtol=1e-9, atol=1e-12)


def test_fewer_directions_hold_the_same_spread(
    ur10e: Robot, fits: np.ndarray, q: np.ndarray
) -> None:
    spread = jackknife(fits)
    fewer = strongest(ur10e.chain, spread, np.ones(ur10e.num_joints))
    assert len(fewer) == len(fits) - 1  # four about their mean
    zero = np.zeros(ur10e.num_joints)
    np.testing.assert_allclose(
        _variance(spread_table(ur10e.chain, fewer, zero), q),
        _variance(spread_table(ur10e.chain, spread, zero), q),
        rtol=1e-6,
    )
    many = np.concatenate([fits + k * 0.1 * fits for k in range(4)])
    assert len(strongest(ur10e.chain, jackknife(many), zero + 1.0)) <= MAX_DIRECTIONS


def test_fits_that_agree_leave_no_direction(ur10e: Robot, fits: np.ndarray) -> None:
    same = jackknife(np.stack([fits[0]] * 3))
    none = strongest(ur10e.chain, same, np.ones(ur10e.num_joints))
    assert none.shape == (0, ur10e.num_joints, 5)
    assert spread_table(ur10e.chain, none, 0.0).shape == (ur10e.num_joints, 0)


def test_a_posture_that_is_not_known_has_none(
    ur10e: Robot, fits: np.ndarray, q: np.ndarray
) -> None:
    table = spread_table(ur10e.chain, jackknife(fits), np.zeros(ur10e.num_joints))
    q[0, 3] = np.nan
    assert not _variance(table, q[:1]).any()
