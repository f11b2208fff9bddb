"""Where a force acts: found from torques with noise, and what its prior says."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchsight.models.estimation.point_of_action import find_point_of_action, jacobian_at


@pytest.fixture(scope="module")
def case(ur10e):
    """A force of mean (2, 0, -25) N with deviations of 3 N, 20 cm off the flange of a UR10e."""
    rng = np.random.default_rng(0)
    t = np.linspace(0.0, 10.0, 300)[:, None]
    q = np.array([0.0, -1.2, 1.4, 0.3, 0.8, 0.0]) + 0.5 * np.sin(
        np.array([0.7, 0.9, 1.1, 1.3, 1.7, 1.9]) * t + np.arange(6)
    )
    J, (R, _) = ur10e.chain.jacobian(q), ur10e.chain.pose(q)
    p_EP = np.array([0.03, 0.18, 0.05])
    force = np.array([2.0, 0.0, -25.0]) + rng.normal(scale=3.0, size=(300, 3))
    Sigma = np.diag(np.array([1.0, 1.0, 0.5, 0.2, 0.2, 0.2]) ** 2)
    tau = np.einsum("kij,ki->kj", jacobian_at(J, R, p_EP)[:, 3:], force)
    tau += rng.multivariate_normal(np.zeros(6), 1.5**2 * Sigma, 300)
    return ur10e, q, J, R, p_EP, tau, Sigma


def test_jacobian_at_a_point_is_that_of_a_moved_tool(case):
    robot, q, J, R, p_EP, _, _ = case
    chain = robot.chain
    moved = replace(chain, p_LE=chain.p_LE + chain.R_LE @ p_EP)
    np.testing.assert_allclose(jacobian_at(J, R, p_EP), moved.jacobian(q), atol=1e-12)


def test_point_mean_and_sds_come_back(case):
    _, _, J, R, p_EP, tau, Sigma = case
    estimate = find_point_of_action(J, R, tau, Sigma)
    # 300 samples of 3 N deviations and about 1 N m of noise on 25 N: some millimetres, 0.2 N.
    np.testing.assert_allclose(estimate.p_EP, p_EP, atol=0.01)
    np.testing.assert_allclose(estimate.mean_force_W, [2.0, 0.0, -25.0], atol=1.0)
    assert estimate.force_sd == pytest.approx(3.0, rel=0.15)
    assert estimate.noise_scale == pytest.approx(1.5, rel=0.1)
    assert estimate.moment_sd < 0.3


def test_a_force_at_the_flange_is_found_there(case):
    _, _, J, R, _, _, Sigma = case
    rng = np.random.default_rng(5)
    force = np.array([0.0, 10.0, -30.0])
    tau = np.einsum("kij,i->kj", J[:, 3:], force) + 0.3 * rng.normal(size=(300, 6))
    estimate = find_point_of_action(J, R, tau, Sigma)
    np.testing.assert_allclose(estimate.p_EP, 0.0, atol=0.01)
    np.testing.assert_allclose(estimate.mean_force_W, force, atol=0.5)


def test_bad_input_is_refused(case):
    _, _, J, R, _, tau, Sigma = case
    with pytest.raises(ValueError, match="expected J"):
        find_point_of_action(J, R[:10], tau, Sigma)
    broken = tau.copy()
    broken[3, 2] = np.nan
    with pytest.raises(ValueError, match="not finite"):
        find_point_of_action(J, R, broken, Sigma)
