"""Excitation: the measures' gradients, the program's limits, bad limits."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.planning.excitation.excitation_information import (
    MEASURES,
    ExcitationInformation,
    regressor_pull_back,
)
from wrenchsight.models.planning.excitation.excitation_limits import ExcitationLimits
from wrenchsight.models.planning.excitation.excitation_program import (
    UNSTATED_SPEED,
    ExcitationProgram,
    MotionBounds,
    ProgramSettings,
    torque_gradients,
)
from wrenchsight.models.planning.excitation.fourier_trajectory import FourierTrajectory


@pytest.fixture(scope="module")
def information(sts):
    return ExcitationInformation.of_chain(sts.chain, 1.0 / sts.effort_limit)


def motion(seed=0, samples=30):
    rng = np.random.default_rng(seed)
    return [rng.normal(size=(samples, 6)) for _ in range(3)]


def moved(signals, direction, step):
    """The signals q, v and vdot, each moved by `step` along its direction."""
    return [x + step * d for x, d in zip(signals, direction, strict=True)]


def test_the_regressor_is_the_torque(sts, information):
    q, v, vdot = motion()
    exact = replace(information, friction_velocity=0.0)
    n = sts.num_joints
    drive_parameters = np.stack(
        [sts.chain.reflected_inertia, np.full(n, 2.0), np.full(n, 3.0), np.full(n, 0.5)], axis=1
    )
    x = np.concatenate([sts.chain.inertial_parameters.ravel(), drive_parameters.ravel()])
    tau = sts.chain.inverse_dynamics(q, v, vdot) + 2.0 * np.sign(v) + 3.0 * v + 0.5
    W = exact.regressor(q, v, vdot)
    np.testing.assert_allclose(W @ x, (tau / sts.effort_limit).ravel(), atol=1e-12)


@pytest.mark.parametrize("measure", MEASURES)
def test_gradients_of_the_measures(information, measure):
    signals, direction = motion(), motion(1)
    _, *gradients = information.cost(measure, *signals)
    e = 1e-5
    ahead = information.cost(measure, *moved(signals, direction, e))
    behind = information.cost(measure, *moved(signals, direction, -e))
    slope = sum((g * d).sum() for g, d in zip(gradients, direction, strict=True))
    assert slope == pytest.approx((ahead[0] - behind[0]) / (2 * e), rel=1e-5)


def test_the_smooth_measure_is_a_bound_near_the_condition_number(information):
    q, v, vdot = motion(samples=100)
    W = information.regressor(q, v, vdot)[:, information.columns]
    condition = np.linalg.cond(W / np.linalg.norm(W, axis=0))
    smooth = np.exp(information.cost("condition_number", q, v, vdot)[0])
    assert condition <= smooth <= 1.5 * condition
    assert information.condition_number(q, v, vdot) == pytest.approx(condition, rel=1e-9)


def test_log_det_is_the_determinant(information):
    q, v, vdot = motion(samples=100)
    W = information.regressor(q, v, vdot)[:, information.columns]
    b = len(information.columns)
    expected = -np.linalg.slogdet(W.T @ W)[1] / (2 * b)
    assert information.cost("log_det", q, v, vdot)[0] == pytest.approx(expected, rel=1e-9)


def test_pull_back_is_linear_in_vdot(sts):
    q, v, vdot = motion(samples=3)
    weights = np.random.default_rng(5).normal(size=(3, 6, 60))
    by = regressor_pull_back(sts.chain, weights, q, v, vdot)[2]
    zero = sts.chain.regressor(q, v, np.zeros_like(v))
    for j in range(6):
        Y = sts.chain.regressor(q, v, np.eye(6)[j] + np.zeros_like(v)) - zero
        np.testing.assert_allclose(by[:, j], (weights * Y).sum(axis=(1, 2)), rtol=1e-9, atol=1e-9)


def test_torque_gradients(sts):
    q, v, vdot = motion(samples=4)
    by = torque_gradients(sts.chain, q, v, vdot)
    M = [sts.chain.terms(*row).M for row in zip(q, v, strict=True)]
    np.testing.assert_allclose(by[:, :, 12:], M, atol=1e-9)
    direction, e = motion(3, 4), 1e-6
    ahead = sts.chain.inverse_dynamics(*moved([q, v, vdot], direction, e))
    behind = sts.chain.inverse_dynamics(*moved([q, v, vdot], direction, -e))
    slope = np.einsum("kij,kj->ki", by, np.concatenate(direction, axis=1))
    np.testing.assert_allclose(slope, (ahead - behind) / (2 * e), rtol=1e-5, atol=1e-5)


def test_a_joint_that_stays_is_named(information):
    q, v, vdot = motion(samples=200)
    q[:, 2], v[:, 2], vdot[:, 2] = 0.3, 0.0, 0.0
    missing = information.undetermined(q, v, vdot)
    assert any("viscous[joint_3]" in name for name in missing)
    assert any("coulomb[joint_3]" in name for name in missing)
    assert not any("viscous[joint_2]" in name for name in missing)
    assert information.undetermined(*motion(samples=200)) == []


def test_random_and_solved_motions_keep_all_limits(sts, information):
    limits = ExcitationLimits(acceleration=[6.0], velocity_share=0.3, torque_share=0.4)
    bounds = MotionBounds.of_robot(sts, limits)
    program = ExcitationProgram(sts.chain, bounds, information, ProgramSettings(num_samples=40))
    start = program.random_feasible(np.random.default_rng(0))
    solution = program.solve(start, iterations=12)
    for series in (start, solution.trajectory):
        t = np.linspace(0.0, series.period, 5001)
        q, v, vdot = series.sample(t)
        slack = 1e-5  # the solver's own tolerance
        assert (q >= bounds.position_lower - slack).all()
        assert (q <= bounds.position_upper + slack).all()
        assert (np.abs(v) <= bounds.velocity + slack).all()
        assert (np.abs(vdot) <= bounds.acceleration + slack).all()
        torque = np.abs(sts.chain.inverse_dynamics(q, v, vdot)).max(axis=0)
        assert (torque <= 1.01 * bounds.torque).all()
        np.testing.assert_allclose(v[[0, -1]], 0.0, atol=1e-8)
        np.testing.assert_allclose(vdot[[0, -1]], 0.0, atol=1e-8)

    def condition(series):
        return information.condition_number(*series.sample(np.arange(200) * 0.05))

    assert condition(solution.trajectory) < 0.5 * condition(start)


def test_the_nearest_motion_within_the_limits_keeps_them_and_is_near(sts, information):
    """Of a random motion that is twice as large as speed, torque and a wall at joint 1 allow."""
    bounds = MotionBounds.of_robot(sts, ExcitationLimits(velocity_share=0.1, torque_share=0.4))

    def slack(q):
        return 0.1 * (1.0 - q[0]), -0.1 * np.eye(6)[0]  # m: a wall at 1 rad

    program = ExcitationProgram(
        sts.chain, bounds, information, ProgramSettings(num_samples=40), slack
    )
    start = program.random_feasible(np.random.default_rng(1))
    large = FourierTrajectory(
        start.base_frequency, start.centre, 2.0 * start.sine, 2.0 * start.cosine
    )
    near = program.nearest_within_limits(large)
    t = np.linspace(0.0, near.period, 5001)
    q, v, vdot = near.sample(t)
    assert (np.abs(large.sample(t)[1]) > bounds.velocity).any()
    assert (np.abs(v) <= bounds.velocity + 1e-5).all()  # + the solver's own tolerance
    assert (np.abs(vdot) <= bounds.acceleration + 1e-5).all()
    assert (np.abs(sts.chain.inverse_dynamics(q, v, vdot)) <= 1.01 * bounds.torque).all()
    assert (q[:, 0] <= 1.0).all()
    np.testing.assert_allclose(v[[0, -1]], 0.0, atol=1e-8)
    gaps = [
        np.abs(np.hstack([other.sine - large.sine, other.cosine - large.cosine])).max()
        for other in (near, start)
    ]
    assert gaps[0] < gaps[1]


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        (ExcitationLimits(position_margin=3.0), "position_margin: leaves joint_1 "),
        (ExcitationLimits(velocity_share=0.0), "velocity_share"),
        (ExcitationLimits(acceleration=[-1.0]), "acceleration: leaves joint_1 "),
        (ExcitationLimits(acceleration=[1.0, 2.0]), "2 numbers, expected 1 or 6"),
        (ExcitationLimits(torque_share=0.0), "torque_share"),
    ],
)
def test_limits_without_room_are_one_line(sts, limits, message):
    with pytest.raises(InputError, match=message) as error:
        MotionBounds.of_robot(sts, limits)
    assert "\n" not in str(error.value)


def test_torque_that_cannot_even_hold_the_arm(sts, information):
    bounds = MotionBounds.of_robot(sts, ExcitationLimits(torque_share=0.002))
    program = ExcitationProgram(sts.chain, bounds, information, ProgramSettings(num_samples=40))
    with pytest.raises(InputError, match="torque: no trajectory found"):
        program.random_feasible(np.random.default_rng(0), num_draws=5)


def test_a_joint_without_a_speed_limit_gets_one(serial_robot):
    """A URDF may state none; the motion then keeps to UNSTATED_SPEED."""
    robot = serial_robot([("revolute", "0 0 1", "0 0 0"), ("revolute", "0 1 0", "0 0 .3")])
    robot.velocity_limit.setflags(write=True)
    robot.velocity_limit[1] = np.inf
    bounds = MotionBounds.of_robot(robot, ExcitationLimits())
    np.testing.assert_allclose(bounds.velocity, [0.5, 0.5 * UNSTATED_SPEED])


def test_a_placeholder_of_speed_counts_as_none_and_a_short_slide_keeps_its_travel(serial_robot):
    robot = serial_robot([("revolute", "0 0 1", "0 0 0"), ("prismatic", "0 0 1", "0 0 .3")])
    for values in (robot.velocity_limit, robot.position_lower, robot.position_upper):
        values.setflags(write=True)
    robot.velocity_limit[0] = 1000.0
    robot.position_lower[1], robot.position_upper[1] = 0.0, 0.05
    bounds = MotionBounds.of_robot(robot, ExcitationLimits())
    assert bounds.velocity[0] == 0.5 * UNSTATED_SPEED
    np.testing.assert_allclose([bounds.position_lower[1], bounds.position_upper[1]], [0.005, 0.045])
