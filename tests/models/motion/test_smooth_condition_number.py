"""The condition number by p-norms: its bounds, its gradient, also where the other has a kink."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.motion.posture_measures import ConditionNumber, ForceSd
from wrenchsight.models.motion.smooth_condition_number import SmoothConditionNumber, smoothed
from wrenchsight.models.robot.robot import Robot


@pytest.fixture(scope="module")
def chain():
    return Robot.load("sts_sre4_600").chain


@pytest.fixture(scope="module")
def postures(chain):
    q = np.random.default_rng(0).uniform(-1.5, 1.5, (60, 6))
    return q[np.linalg.cond(chain.jacobian(q)) < 300.0]  # where finite differences can follow


@pytest.fixture(scope="module")
def kink(chain):
    """A posture in whose neighbourhood the two smallest singular values meet."""
    q = np.array([0.0, -2.42, 3.70, 0.0, -2.85, 0.0])

    def gap(q3):
        s = np.linalg.svd(chain.jacobian(np.array([*q[:2], q3, *q[3:]])), compute_uv=False)
        return s[4] - s[5]

    # With the wrist in the arm's plane the values cross, they do not avoid each other.
    grid = np.linspace(3.5, 3.8, 20001)
    q[2] = grid[np.argmin([gap(q3) for q3 in grid])]
    assert gap(q[2]) < 1e-4
    return q


@pytest.mark.parametrize("sharpness", [1.0, 10.0, 1e3, 1e5])
def test_it_is_numpys_p_norms_and_bounds_the_condition_number(chain, postures, sharpness):
    s = np.linalg.svd(chain.jacobian(postures), compute_uv=False)
    p = 2.0 * sharpness
    # Relative to the extremes, or the powers overflow.
    above = np.sum((s / s[:, :1]) ** p, axis=1) ** (1.0 / p)
    below = np.sum((s[:, -1:] / s) ** p, axis=1) ** (1.0 / p)
    condition = s[:, 0] / s[:, -1]
    values = SmoothConditionNumber(chain, sharpness).values(postures)
    np.testing.assert_allclose(values, condition * above * below, rtol=1e-9)
    assert np.all(values >= condition * (1.0 - 1e-12))
    assert np.all(values <= condition * 6.0 ** (1.0 / sharpness) * (1.0 + 1e-12))


@pytest.mark.parametrize("sharpness", [1.0, 30.0, 1e3])
def test_its_gradient_is_that_of_finite_differences(chain, postures, kink, sharpness):
    measure = SmoothConditionNumber(chain, sharpness)
    q = np.vstack([postures, kink])
    values, gradients = measure.values_and_gradients(q)
    h = 1e-6
    expected = np.stack(
        [(measure.values(q + h * d) - measure.values(q - h * d)) / (2.0 * h) for d in np.eye(6)],
        axis=1,
    )
    # At the kink the curvature grows with the sharpness: an error of h^2 sharpness^2 or so.
    scale = values + np.max(np.abs(gradients), axis=1)
    assert np.max(np.abs(gradients - expected) / scale[:, np.newaxis]) < 1e-5
    np.testing.assert_array_equal(measure.values(q), values)
    np.testing.assert_array_equal(measure.values(q.reshape(-1, 1, 6)), values[:, np.newaxis])


def test_sharp_and_away_from_kinks_it_is_the_condition_number(chain, postures):
    s = np.linalg.svd(chain.jacobian(postures), compute_uv=False)
    clear = (s[:, 0] > 1.01 * s[:, 1]) & (s[:, 4] > 1.01 * s[:, 5])
    assert clear.sum() > 20
    values, gradients = SmoothConditionNumber(chain, 1e5).values_and_gradients(postures[clear])
    plain, by_q = ConditionNumber(chain).values_and_gradients(postures[clear])
    np.testing.assert_allclose(values, plain, rtol=1e-12)
    np.testing.assert_allclose(gradients, by_q, rtol=1e-9, atol=1e-9)


def test_singular_postures_and_wrong_sharpness(chain):
    values, gradients = SmoothConditionNumber(chain, 10.0).values_and_gradients(
        np.array([0.3, 0.2, -0.4, 0.5, 0.0, 0.1])  # axes 4 and 6 in one line
    )
    assert values == 1e12
    np.testing.assert_array_equal(gradients, 0.0)
    with pytest.raises(ValueError, match="sharpness"):
        SmoothConditionNumber(chain, 0.5)
    with pytest.raises(InputError, match="joints"):
        SmoothConditionNumber(few_joints(chain), 10.0)


def few_joints(chain):
    per_joint = ("joint_names", "prismatic", "R_PJ", "p_PJ", "axis")
    per_joint += ("inertial_parameters", "reflected_inertia")
    return replace(chain, **{name: getattr(chain, name)[:5] for name in per_joint})


def test_only_what_has_kinks_is_smoothed(chain):
    assert isinstance(smoothed(chain, ConditionNumber(chain), 10.0), SmoothConditionNumber)
    force_sd = ForceSd(chain, np.eye(6), WrenchReconstructionConfig(method="force_only"))
    assert smoothed(chain, force_sd, 10.0) is force_sd
