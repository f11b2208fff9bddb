"""The moment's prior by a lever: found where a force acts beside E, and nowhere else."""

from typing import NamedTuple

import numpy as np
import pytest

from wrenchsight.models.estimation.lever_prior import find_lever
from wrenchsight.models.estimation.point_of_action import jacobian_at
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.robot import Robot

DURATION, N = 30.0, 600
SIGMA = np.diag(np.array([3.0, 3.0, 1.5, 0.6, 0.6, 0.6]) ** 2)


class Slide(NamedTuple):
    """A tool that presses while it slides: its Jacobian, pose, force (N, 3) and torque noise."""

    J: Array
    R_WE: Array
    force: Array
    noise: Array

    def torques(self, p_EP: Array) -> Array:
        """(N, 6) N m, with the force at P."""
        J_P = jacobian_at(self.J, self.R_WE, p_EP)
        return np.einsum("kij,ki->kj", J_P[:, 3:], self.force) + self.noise


@pytest.fixture(scope="module")
def slide(ur10e: Robot) -> Slide:
    rng = np.random.default_rng(0)
    t = np.linspace(0.0, DURATION, N)[:, None]
    rate = np.array([0.7, 0.9, 1.1, 1.3, 1.7, 1.9])
    q = np.array([0.0, -1.2, 1.4, -1.8, -1.6, 0.0]) + 0.2 * np.sin(rate * t + np.arange(6))
    friction = 20.0 * np.hstack([np.sin(t), np.cos(t)])
    force = np.hstack([friction, 80.0 + 20.0 * np.sin(0.5 * t)])
    noise = rng.multivariate_normal(np.zeros(6), 0.3 * SIGMA, N)
    R_WE, _ = ur10e.chain.pose(q)
    return Slide(ur10e.chain.jacobian(q), R_WE, force, noise)


def moment_of(slide: Slide, p_EP: Array) -> float:
    """N m, rms of an axis."""
    moment = np.cross(slide.R_WE @ p_EP, slide.force)
    return float(np.sqrt(np.mean(moment**2)))


@pytest.mark.parametrize("p_EP", [np.array([0.0, 0.0, 0.08]), np.array([0.05, -0.03, 0.06])])
def test_a_lever_is_found_with_its_moment(slide: Slide, p_EP: Array) -> None:
    tau = slide.torques(p_EP)
    lever = find_lever(slide.J, slide.R_WE, tau, SIGMA, DURATION)
    assert lever is not None
    # A tenth of the torque's noise on 80 N: millimetres.
    np.testing.assert_allclose(lever.p_EP, p_EP, atol=0.01)
    # The formula takes the force's deviations as equal in all directions; here z has more.
    assert lever.moment_sd == pytest.approx(moment_of(slide, p_EP), rel=0.5)
    assert "mm beside E" in lever.sentence() and "--tool" in lever.sentence()


def test_a_force_at_E_and_no_force_have_no_lever(slide: Slide) -> None:
    assert find_lever(slide.J, slide.R_WE, slide.torques(np.zeros(3)), SIGMA, DURATION) is None
    assert find_lever(slide.J, slide.R_WE, slide.noise, SIGMA, DURATION) is None


def test_a_point_far_from_E_is_no_tools(slide: Slide) -> None:
    tau = slide.torques(np.array([0.0, 0.4, 0.3]))
    assert find_lever(slide.J, slide.R_WE, tau, SIGMA, DURATION) is None


def test_a_few_samples_of_a_short_log_prove_nothing(slide: Slide) -> None:
    tau = slide.torques(np.array([0.0, 0.0, 0.02]))
    assert find_lever(slide.J[:20], slide.R_WE[:20], tau[:20], SIGMA, 0.2) is None
