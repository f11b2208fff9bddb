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


def _block(
    tau_ext: np.ndarray, known: bool = True, sd: float = _SD, rigid: np.ndarray | float = 0.0
) -> Block:
    H = np.zeros((2, 6))
    H[:, 0] = _H
    torque = np.broadcast_to(rigid, (2,))
    return Block(tau_ext, H, np.full(2, sd), 0.1, np.zeros(2), known, torque)


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
        F, P, _ = contact.read(late)
        mean, sd = _conditioned(y, until, until - late)
        assert F[0] == pytest.approx(mean, rel=1e-9)
        assert np.sqrt(P[0, 0]) >= sd * (1.0 - 1e-9)  # larger where innovations are


def test_the_filter_s_own_band_holds_what_comes_from_its_model() -> None:
    rng, inside = np.random.default_rng(2), []
    for _ in range(20):
        contact = _filter(innovation_share=0.0)
        force, error = rng.normal(0.0, 61.0), rng.normal(0.0, _SD, 2)
        decay = np.exp(-_PERIOD / ContactConfig().error_time)
        for _ in range(60):
            force += rng.normal(0.0, 18.0 * np.sqrt(_PERIOD))
            error = decay * error + np.sqrt(1.0 - decay**2) * rng.normal(0.0, _SD, 2)
            contact.take(_block(_H * force + error + rng.normal(0.0, _WHITE, 2)))
            F, P, _ = contact.read(0)
            inside.append(abs(F[0] - force) <= 1.96 * np.sqrt(P[0, 0]))
    # The band is wider where innovations are large by chance: a little above 95 %.
    assert 0.93 < np.mean(inside) < 0.995


@pytest.mark.parametrize("is_resting", [False, True])
def test_small_innovations_do_not_narrow_the_band(is_resting: bool) -> None:
    """Innovations do not show errors that last, nor the friction that a joint at rest holds."""
    contact = _filter()
    for _ in range(100):
        contact.take(_block(_H * 20.0)._replace(is_resting=is_resting))
    stated = contact._P[:6, :6] * (ContactConfig().rest_share ** 2 if is_resting else 1.0)
    # The first innovation, of 20 N, is 2 s old: 20 N squared times exp(-2 / 0.1) is 1e-6 N^2.
    np.testing.assert_allclose(contact.read(0).covariance, stated, atol=2e-6)


def test_the_band_holds_a_force_that_bounces() -> None:
    """20 N at 5 Hz behind torque that vibrates: the filter follows a part and misses the rest."""
    inside = {}
    for share in (0.0, ContactConfig().innovation_share):
        contact, hits = _filter(0.06, innovation_share=share), []
        force = 60.0 + 20.0 * np.sin(2.0 * np.pi * 5.0 * _PERIOD * np.arange(300))
        error = np.random.default_rng(3).normal(0.0, _WHITE, (300, 2))
        for k in range(300):
            block = _block(_H * force[k] + error[k])
            contact.take(block._replace(spread=np.full(2, 8.0)))
            if k >= 50:
                F, P, _ = contact.read(3)
                hits.append(abs(F[0] - force[k - 3]) <= 1.96 * np.sqrt(P[0, 0]))
        inside[share] = np.mean(hits)
    assert inside[ContactConfig().innovation_share] > 0.95  # measured 1.0
    assert inside[0.0] < 0.8  # measured .6: the case is one that the filter alone misses


def test_after_a_gap_the_force_may_be_any() -> None:
    contact = _filter()
    for _ in range(20):
        contact.take(_block(_H * 30.0))
    before = contact.read(0).covariance[0, 0]
    for _ in range(4):
        contact.take(_block(np.zeros(2), known=False))
    F, P, _ = contact.read(0)
    assert F[0] == pytest.approx(30.0, abs=3.0)  # nothing was read
    assert P[0, 0] > before + 61.0**2
    contact.take(_block(_H * 80.0))
    assert contact.read(0).F[0] == pytest.approx(80.0, abs=8.0)


def test_what_a_joint_at_rest_held_is_gone_once_it_slides() -> None:
    """A large error at rest must not stay in the reading where the stated sd has fallen."""
    contact = _filter(offset_sd=0.0)
    for _ in range(30):
        contact.take(_block(_H * 20.0 + np.array([4.0, -3.0]), sd=5.0))
    contact.take(_block(_H * 20.0, sd=0.2))
    F, P, _ = contact.read(0)
    assert F[0] == pytest.approx(20.0, abs=0.3)
    assert np.sqrt(P[0, 0]) < 1.0  # the band of a sliding joint, not of one at rest: 4 N


def test_a_force_that_moves_faster_than_it_wanders_is_not_explained() -> None:
    """Its innovations lie along the force; as large ones across it are the joints' noise."""
    for direction, is_explained in ((_H, False), (np.array([_H[1], -_H[0]]), True)):
        contact = _filter()
        for k in range(60):
            swing = 40.0 * np.sign(np.sin(2.0 * np.pi * k / 8.0))
            contact.take(_block(_H * 60.0 + direction * swing))
            if k == 0:
                assert contact.read(0).is_explained  # one block says nothing yet
        assert contact.read(0).is_explained == is_explained
        for _ in range(60):  # and it is explained again once it stands for four times misfit_time
            contact.take(_block(_H * 60.0))
        assert contact.read(0).is_explained


@pytest.mark.parametrize("jump", [4.0, 30.0, 500.0])
def test_the_band_grows_with_the_innovations(jump: float) -> None:
    """By their misfit where that is above 1, and by a share of their RMS along the force.

    An impact counts as the force's prior at the most, and its misfit as 50.
    """
    config = ContactConfig()
    contact, predicted = _filter(), _filter()
    for one in (contact, predicted):
        for _ in range(40):
            one.take(_block(_H * 60.0))
    contact.take(_block(_H * (60.0 + jump)))
    predicted._predict(_block(_H * 60.0))
    H = np.hstack([np.outer(_H, np.eye(6)[0]), np.eye(2), np.eye(2)])
    S = H @ predicted._P @ H.T + _WHITE**2 * np.eye(2)
    information = _H @ np.linalg.solve(S, _H)  # of the innovation along the force, 1/N^2
    misfit_pole = np.exp(-_PERIOD / config.misfit_time)
    new_misfit = min(jump**2 * information / 2.0, 50.0)
    misfit = misfit_pole**41 + (1.0 - misfit_pole) * new_misfit  # begins at 1
    assert (misfit > 1.0) == (jump > 10.0)
    along_force = min(jump * information / (information + 1.0 / 61.0**2), 61.0)
    square = (1.0 - np.exp(-_PERIOD / config.innovation_time)) * along_force**2
    variance = max(misfit, 1.0) * contact._P[0, 0] + config.innovation_share**2 * square
    # The other innovations are nearly zero: the first one, of 60 N, is 0.8 s old.
    assert contact.read(0).covariance[0, 0] == pytest.approx(variance, rel=0.02)


def test_a_change_of_the_rigid_torque_is_no_force() -> None:
    """At a corner the drive errs by a share of the torque's change, and for as long as it rings."""
    read = {}
    for rigid in (0.0, 40.0):
        contact = _filter()
        for _ in range(40):
            contact.take(_block(_H * 20.0))
        contact.take(_block(_H * 20.0 + np.array([20.0, 15.0]), rigid=rigid))
        contact.take(_block(_H * 20.0 - np.array([8.0, 6.0]), rigid=rigid))
        read[rigid] = contact.read(0)
    known, plain = (abs(read[rigid].F[0] - 20.0) for rigid in (40.0, 0.0))
    assert known < 0.3 * plain
    assert read[40.0].is_explained and not read[0.0].is_explained


def test_a_motion_that_hides_the_force_leaves_it_open() -> None:
    """A jump of the rigid torque by 1000 N m: 0.3 of it is 300 N on a lever of 0.86 m."""
    contact = _filter()
    for _ in range(40):
        contact.take(_block(_H * 20.0))
    for _ in range(4):  # the gap lasts 0.05 s
        contact.take(_block(_H * 80.0, rigid=1000.0))
    F, P, is_explained = contact.read(0)
    assert abs(F[0] - 80.0) < 1.96 * np.sqrt(P[0, 0]) and np.sqrt(P[0, 0]) > 61.0 / 4.0
    assert not is_explained
    read = []
    for _ in range(60):
        contact.take(_block(_H * 80.0, rigid=1000.0))
        read.append(contact.read(0))
    # 300 N fade to 61 N / 4 within 0.31 s, of which 0.08 s are over; then come misfit_time.
    first = next(k for k, reading in enumerate(read) if reading.is_explained)
    assert first * _PERIOD == pytest.approx(0.24 + 0.3, abs=0.06)
    assert read[first].F[0] == pytest.approx(80.0, abs=3.0)


def test_the_band_of_an_arm_at_rest_is_narrower_from_its_first_resting_block_on() -> None:
    moving, resting = (_filter(0.06, innovation_share=0.0) for _ in range(2))
    share = ContactConfig().rest_share ** 2
    for k in range(12):
        block = _block(_H * 20.0)
        moving.take(block)
        resting.take(block._replace(is_resting=k >= 10))
    for past in range(4):
        ratio = resting.read(past).covariance[0, 0] / moving.read(past).covariance[0, 0]
        assert ratio == pytest.approx(share if past < 2 else 1.0, rel=1e-12)


def test_a_gap_is_no_change_of_the_rigid_torque() -> None:
    contact, plain = _filter(), _filter()
    for one, rigid in ((contact, 100.0), (plain, 0.0)):
        one.take(_block(_H * 20.0))
        one.take(_block(np.zeros(2), known=False))
        one.take(_block(_H * 20.0, rigid=rigid))
    np.testing.assert_array_equal(contact.read(0).covariance, plain.read(0).covariance)


def test_a_standing_tool_is_held_across_the_more_the_harder_it_presses() -> None:
    """A third joint, which the force across loads: its torque is not taken for an error."""
    H = np.zeros((3, 6))
    H[:, 0], H[:, 1] = (-0.7, -0.6, -0.2), (-0.1, -0.6, -0.35)
    errs = {}
    for held in (0.0, 0.15):
        config = ContactConfig(lag=0.0, offset_sd=0.0, held_across=held)
        contact = ContactFilter(config, 61.0, 3, _PERIOD)
        for _ in range(100):
            tau_ext = H[:, 0] * 60.0 + H[:, 1] * 15.0
            contact.take(
                Block(tau_ext, H, np.array([3.0, 3.0, 1.0]), 0.0, np.zeros(3), True, np.zeros(3))
            )
        F, P, _ = contact.read(0)
        errs[held] = abs(F[0] - 60.0)
        if held:
            assert errs[held] < 1.96 * np.sqrt(P[0, 0])
    assert errs[0.15] < 0.6 * errs[0.0]


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
