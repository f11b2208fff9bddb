import numpy as np
import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.planning.motion.paths import (
    JointTrajectory,
    StraightPath,
    TimeLaw,
    constant_speed,
    joint_trajectory,
    steady_speed,
    there_and_back,
    thirds,
    uniform_acceleration,
)
from wrenchsight.models.robot.robot import Robot

PATH = StraightPath(
    n_W=np.array([0.0, 2.0, 0.0]),
    p_WM=np.array([0.5, 0.0, 0.45]),
    R_WE=np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]]),
    path_length=0.6,
    num_segments=4,
)
LAWS = [
    uniform_acceleration,
    thirds,
    constant_speed,
    there_and_back(thirds),
    steady_speed(0.02),
    steady_speed(0.5),
]
LAW_NAMES = ["uniform", "thirds", "constant", "back", "short ramps", "half"]


def test_points_are_those_of_equation_24() -> None:
    n, m, a, k = PATH.n_W, PATH.p_WM, PATH.path_length, PATH.num_segments
    expected = [m + (2 * i - k) / (2 * k) * a * n for i in range(k + 1)]
    np.testing.assert_allclose(PATH.points(), expected, atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(PATH.n_W), 1.0)


def test_poses_keep_the_orientation() -> None:
    R_WE, p_WE = PATH.poses(np.array([0.0, 0.25, 1.0]))
    assert R_WE.shape == (3, 3, 3)
    np.testing.assert_array_equal(R_WE[1], PATH.R_WE)
    np.testing.assert_allclose(p_WE, [[0.5, -0.3, 0.45], [0.5, -0.15, 0.45], [0.5, 0.3, 0.45]])


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"n_W": np.zeros(3)}, "n_W: .* has no direction"),
        ({"n_W": np.ones(2)}, "n_W and p_WM take 3 numbers"),
        ({"R_WE": np.diag([1.0, 1.0, -1.0])}, "R_WE: is no rotation matrix"),
        ({"R_WE": 2 * np.eye(3)}, "R_WE: is no rotation matrix"),
        ({"path_length": 0.0}, "must be above 0"),
        ({"num_segments": 0}, "must be above 0"),
    ],
)
def test_a_path_that_is_none(changes: dict, expected: str) -> None:
    good = {"n_W": PATH.n_W, "p_WM": PATH.p_WM, "R_WE": PATH.R_WE}
    with pytest.raises(InputError, match=expected):
        StraightPath(**(good | changes))


@pytest.mark.parametrize("law", LAWS, ids=LAW_NAMES)
def test_a_law_runs_from_end_to_end_and_its_derivatives_are_its_own(law: TimeLaw) -> None:
    u = np.linspace(0.0, 1.0, 1201)
    s, ds, d2s = law(u)
    assert s[0] == 0.0
    assert np.max(s) == pytest.approx(1.0, abs=1e-12)
    assert s.min() >= 0.0
    assert abs(ds[0]) < 1e-12
    assert abs(ds[-1]) < 1e-12
    # Central differences, away from the corners of the acceleration; h is 1e-6.
    h = 1e-6
    inner = (u > 2 * h) & (u < 1 - 2 * h)
    for corner in (0.02, 0.98, 0.1, 1 / 6, 1 / 3, 0.5, 2 / 3, 5 / 6, 0.9):
        inner &= np.abs(u - corner) > 2 * h
    before, after = law(u[inner] - h), law(u[inner] + h)
    np.testing.assert_allclose((after.s - before.s) / (2 * h), ds[inner], atol=1e-6)
    np.testing.assert_allclose((after.ds_du - before.ds_du) / (2 * h), d2s[inner], atol=1e-4)


def test_the_laws_are_their_formulas() -> None:
    u = np.array([0.0, 0.25, 0.5, 0.75, 1.0])
    np.testing.assert_allclose(uniform_acceleration(u).s, [0, 1 / 8, 1 / 2, 7 / 8, 1])
    np.testing.assert_allclose(uniform_acceleration(u).d2s_du2[1:4:2], [4.0, -4.0])
    u = np.array([0.1, 0.4, 0.6, 0.9])
    np.testing.assert_allclose(thirds(u).d2s_du2, [4.5, 0.0, 0.0, -4.5])
    np.testing.assert_allclose(thirds(u).ds_du[1:3], [1.5, 1.5])
    u = np.linspace(0.1, 0.9, 30)
    np.testing.assert_allclose(constant_speed(u).ds_du, 1 / 0.9)
    np.testing.assert_allclose(constant_speed(np.array([0.0, 1.0])).d2s_du2, 0.0, atol=1e-12)
    round_trip = there_and_back(thirds)
    u = np.linspace(0.0, 0.5, 40)
    np.testing.assert_allclose(round_trip(u).s, thirds(2 * u).s)
    np.testing.assert_allclose(round_trip(1 - u).s, round_trip(u).s, atol=1e-15)
    np.testing.assert_allclose(round_trip(1 - u[:-1]).ds_du, -round_trip(u[:-1]).ds_du, atol=1e-12)


@pytest.mark.parametrize("law", LAWS, ids=LAW_NAMES)
def test_a_law_rests_outside_of_its_time(law: TimeLaw) -> None:
    before, after = law(np.array([-0.5])), law(np.array([1.5]))
    assert before.s == 0.0
    for progress in (before, after):
        assert progress.ds_du == pytest.approx(0.0, abs=1e-12)
        assert progress.d2s_du2 == pytest.approx(0.0, abs=1e-12)


def test_sampling_a_quintic_gives_it_back() -> None:
    coefficients = np.array([[0.3, -1.0, 0.5, 2.0, -0.7, 0.2], [1.0, 0.0, 0.0, 0.1, 0.2, -0.3]])
    polynomials = [np.polynomial.Polynomial(c) for c in coefficients]

    def exact(t: np.ndarray, order: int) -> np.ndarray:
        return np.stack([p.deriv(order)(t) if order else p(t) for p in polynomials], axis=-1)

    knots = np.array([0.0, 0.4, 0.5, 1.3])
    trajectory = JointTrajectory(knots, exact(knots, 0), exact(knots, 1), exact(knots, 2))
    t = np.linspace(0.0, 1.3, 57)
    for order, sampled in enumerate(trajectory.sample(t)):
        np.testing.assert_allclose(sampled, exact(t, order), atol=1e-11)  # rounding
    q, v, vdot = trajectory.sample(0.7)
    np.testing.assert_allclose(q, exact(np.array(0.7), 0))
    assert q.shape == v.shape == vdot.shape == (2,)


def test_the_joints_rest_before_and_after() -> None:
    t = np.array([1.0, 2.0])
    trajectory = JointTrajectory(t, np.array([[1.0], [3.0]]), np.ones((2, 1)), np.ones((2, 1)))
    for time, position in ((0.0, 1.0), (5.0, 3.0)):
        q, v, vdot = trajectory.sample(time)
        assert (q, v, vdot) == (position, 0.0, 0.0)


def test_a_spline_through_positions() -> None:
    t = np.linspace(0.0, 2.0, 41)
    q = np.column_stack([np.sin(t) ** 3, (t * (2 - t)) ** 3])
    trajectory = JointTrajectory.from_positions(t, q)
    np.testing.assert_allclose(trajectory.q, q, atol=1e-12)
    np.testing.assert_allclose(trajectory.v[[0, -1]], 0.0, atol=1e-9)
    np.testing.assert_allclose(trajectory.vdot[[0, -1]], 0.0, atol=1e-8)
    # The second column is a sextic at rest at both ends: the spline is exact to its step^4.
    fine = np.linspace(0.0, 2.0, 301)
    exact = 3 * (fine * (2 - fine)) ** 2 * (2 - 2 * fine)
    np.testing.assert_allclose(trajectory.sample(fine)[1][:, 1], exact, atol=1e-4)


@pytest.mark.parametrize(
    ("t", "q"),
    [([0.0], [[0.0]]), ([0.0, 0.0], [[0.0], [1.0]]), ([0.0, 1.0], [[0.0], [1.0], [2.0]])],
)
def test_a_trajectory_that_is_none(t: list, q: list) -> None:
    with pytest.raises(ValueError, match="must"):
        JointTrajectory(np.array(t), np.array(q), np.array(q), np.array(q))


def test_the_joints_take_the_tool_along_the_path(sts: Robot) -> None:
    duration = 2.0
    trajectory = joint_trajectory(
        sts, PATH, there_and_back(constant_speed), duration, sts.home - [0.6, 0, 0, 0, 0, 0]
    )
    assert trajectory.duration == duration
    t = np.linspace(0.0, duration, 137)
    q, v, vdot = trajectory.sample(t)
    progress = there_and_back(constant_speed)(t / duration)
    R_WE, p_WE = sts.chain.pose(q)
    # Interpolation between 201 points of the path, and quintics over 10 ms.
    np.testing.assert_allclose(p_WE, PATH.positions(progress.s), atol=1e-6)
    np.testing.assert_allclose(R_WE, np.broadcast_to(PATH.R_WE, R_WE.shape), atol=1e-6)
    V_WE = np.einsum("tij,tj->ti", sts.chain.jacobian(q), v)
    speed = progress.ds_du / duration * PATH.path_length
    np.testing.assert_allclose(V_WE[:, 3:], speed[:, None] * PATH.n_W, atol=1e-5)
    np.testing.assert_allclose(V_WE[:, :3], 0.0, atol=1e-5)
    # vdot is the derivative of v, where no corner of the law lies between.
    h = 1e-4
    ahead, behind = trajectory.sample(t + h)[1], trajectory.sample(t - h)[1]
    inner = slice(3, -3)
    np.testing.assert_allclose(
        (ahead - behind)[inner] / (2 * h), vdot[inner], atol=2e-3 * np.max(np.abs(vdot))
    )


def test_a_steady_speed_has_the_ramps_that_are_asked_for():
    law = steady_speed(0.02)
    np.testing.assert_allclose(law(np.linspace(0.02, 0.98, 9)).ds_du, 1 / 0.98)
    assert law(np.array([0.019])).ds_du[0] < 1 / 0.98
    u = np.linspace(0.0, 1.0, 101)
    np.testing.assert_array_equal(steady_speed(0.1)(u).s, constant_speed(u).s)
    for ramp in (0.0, 0.6):
        with pytest.raises(ValueError, match="ramp"):
            steady_speed(ramp)
