"""The contact filter against dense Gaussian conditioning, and its frame against virtual work."""

import numpy as np
import pytest

from wrenchsight.models.estimation.contact_filter import (
    Block,
    ContactConfig,
    ContactFilter,
    ContactFrame,
)
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.robot.robot import Robot

_PERIOD = 0.02
_H = np.array([-0.7, -0.5])  # N m per newton along the axis
_SD = 1.5  # N m, of the joints' error
_WHITE = 0.1 * _SD  # N m, the filter's least noise of a block


def _block(tau_ext: np.ndarray, known: bool = True, sd: float = _SD) -> Block:
    H = np.zeros((2, 6))
    H[:, 0] = _H
    return Block(tau_ext, H, np.full(2, sd), 0.1, np.zeros(2), known)


def _filter(lag: float = 0.0, **changes: float) -> ContactFilter:
    config = ContactConfig(lag=lag, **{"offset_sd": 0.0, **changes})
    return ContactFilter(config, 61.0, 2, _PERIOD)


def _conditioned(y: np.ndarray, until: int, k: int) -> tuple[float, float]:
    """Mean and sd of the force of block k given y up to block `until`, by one dense Gaussian."""
    config, N = ContactConfig(), until + 1
    first = 61.0**2 + config.force_rate**2 * _PERIOD
    force = first + config.force_rate**2 * _PERIOD * np.minimum.outer(np.arange(N), np.arange(N))
    apart = np.abs(np.subtract.outer(np.arange(N), np.arange(N)))
    error = _SD**2 * np.exp(-_PERIOD / config.error_time) ** apart
    S = np.kron(force, np.outer(_H, _H)) + np.kron(error, np.eye(2))
    S += _WHITE**2 * np.eye(2 * N)
    cross = np.kron(force[k], _H)
    gain = np.linalg.solve(S, cross)
    return float(gain @ y[:N].ravel()), float(np.sqrt(force[k, k] - gain @ cross))


@pytest.mark.parametrize("lag", [0.0, 0.06])
def test_the_reading_is_the_conditional_mean(lag: float) -> None:
    y = np.random.default_rng(1).normal(0.0, 2.0, (25, 2)) - np.array([14.0, 10.0])
    contact = _filter(lag)
    late = round(lag / _PERIOD)
    for until in range(25):
        contact.take(_block(y[until]))
        if until < late:
            continue
        F, P = contact.read(late)
        mean, sd = _conditioned(y, until, until - late)
        assert F[0] == pytest.approx(mean, rel=1e-9)
        assert np.sqrt(P[0, 0]) >= sd * (1.0 - 1e-9)  # larger where innovations are


def test_the_band_holds_what_comes_from_its_model() -> None:
    rng, inside = np.random.default_rng(2), []
    for _ in range(20):
        contact, force, error = _filter(), rng.normal(0.0, 61.0), rng.normal(0.0, _SD, 2)
        decay = np.exp(-_PERIOD / ContactConfig().error_time)
        for _ in range(60):
            force += rng.normal(0.0, 18.0 * np.sqrt(_PERIOD))
            error = decay * error + np.sqrt(1.0 - decay**2) * rng.normal(0.0, _SD, 2)
            contact.take(_block(_H * force + error + rng.normal(0.0, _WHITE, 2)))
            F, P = contact.read(0)
            inside.append(abs(F[0] - force) <= 1.96 * np.sqrt(P[0, 0]))
    # The band is wider where innovations are large by chance: a little above 95 %.
    assert 0.93 < np.mean(inside) < 0.995


def test_after_a_gap_the_force_may_be_any() -> None:
    contact = _filter()
    for _ in range(20):
        contact.take(_block(_H * 30.0))
    before = contact.read(0)[1][0, 0]
    for _ in range(4):
        contact.take(_block(np.zeros(2), known=False))
    F, P = contact.read(0)
    assert F[0] == pytest.approx(30.0, abs=3.0)  # nothing was read
    assert P[0, 0] > before + 61.0**2
    contact.take(_block(_H * 80.0))
    assert contact.read(0)[0][0] == pytest.approx(80.0, abs=8.0)


def test_what_a_joint_at_rest_held_is_gone_once_it_slides() -> None:
    """A large error at rest must not stay in the reading where the stated sd has fallen."""
    contact = _filter(offset_sd=0.0)
    for _ in range(30):
        contact.take(_block(_H * 20.0 + np.array([4.0, -3.0]), sd=5.0))
    contact.take(_block(_H * 20.0, sd=0.2))
    F, P = contact.read(0)
    assert F[0] == pytest.approx(20.0, abs=0.3)
    assert np.sqrt(P[0, 0]) < 0.5  # the band of a sliding joint, not of one at rest


@pytest.mark.parametrize("axis", ["tool_z", "-tool_z", "tool_x", "0,0,-2", "1,-1,0.5"])
def test_a_force_at_the_point_does_the_same_work(axis: str, ur10e: Robot) -> None:
    """J at the contact, by moving E there, against J at E with the map."""
    config = ContactConfig(axis=axis, point=[0.02, -0.03, 0.1])
    q = np.array([[0.3, -1.2, 1.4, -0.8, -1.1, 0.4]])
    R_WE, _ = ur10e.chain.pose(q)
    A = ContactFrame.of(config).wrench_map(R_WE)[0]
    press = np.array([float(x) for x in axis.split(",")]) if "," in axis else None
    if press is None:
        press = R_WE[0][:, "xyz".index(axis[-1])] * (-1.0 if axis[0] == "-" else 1.0)
    press = press / np.linalg.norm(press)
    lever = R_WE[0] @ np.array(config.point)
    np.testing.assert_allclose(A[3:, 0], -press, atol=1e-12)  # on the robot, against it
    np.testing.assert_allclose(A[:3, 0], np.cross(lever, -press), atol=1e-12)
    np.testing.assert_allclose(A[3:, :3].T @ A[3:, :3], np.eye(3), atol=1e-12)
    np.testing.assert_allclose(A[:3, 3:].T @ A[:3, 3:], np.eye(3), atol=1e-12)
    assert not A[3:, 3:].any()


@pytest.mark.parametrize("axis", ["tool_w", "", "0,0,0", "1,2", "nan,0,1", "up"])
def test_an_axis_that_is_none_is_one_line(axis: str) -> None:
    with pytest.raises(InputError, match="--contact-axis"):
        ContactFrame.of(ContactConfig(axis=axis))


def test_a_point_has_three_numbers() -> None:
    with pytest.raises(InputError, match="--contact-point"):
        ContactFrame.of(ContactConfig(axis="tool_z", point=[0.1, 0.2]))
