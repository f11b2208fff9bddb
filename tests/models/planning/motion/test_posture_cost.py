import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig, reconstruct_wrench
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.planning.motion.posture_cost import ConditionNumber, ForceSd, smoothed
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.robot.robot import Robot

METHODS = ("bayesian", "force_only", "inverse")


def random_chain(num_joints: int, prismatic: tuple[int, ...] = (), seed: int = 0) -> SerialChain:
    """An arm of links of any shape; some joints slide."""
    rng = np.random.default_rng(seed)
    axes = rng.normal(size=(num_joints, 3))
    return SerialChain(
        joint_names=tuple(f"j{i}" for i in range(num_joints)),
        prismatic=np.isin(np.arange(num_joints), prismatic),
        R_PJ=Rotation.random(num_joints, random_state=seed).as_matrix(),
        p_PJ=rng.uniform(-0.4, 0.4, (num_joints, 3)),
        axis=axes / np.linalg.norm(axes, axis=1)[:, np.newaxis],
        inertial_parameters=np.zeros((num_joints, 10)),
        reflected_inertia=np.zeros(num_joints),
        gravity=np.zeros(3),
        R_LE=np.eye(3),
        p_LE=np.array([0.05, -0.1, 0.2]),
    )


CHAINS = {
    "sts": lambda: Robot.load("sts_sre4_600").chain,
    "seven joints": lambda: random_chain(7),
    "a sliding joint": lambda: random_chain(6, prismatic=(2,)),
    "seven, two sliding": lambda: random_chain(7, prismatic=(0, 4)),
}


@pytest.fixture(scope="module", params=list(CHAINS))
def chain(request: pytest.FixtureRequest) -> SerialChain:
    return CHAINS[request.param]()


def torque_covariance(n: int) -> Array:
    L = np.random.default_rng(5).normal(size=(n, n))
    return 0.2 * L @ L.T + np.diag(np.linspace(4.0, 0.2, n))


def finite_differences(measure: ConditionNumber | ForceSd, q: Array) -> Array:
    h = 1e-5
    columns = [
        (measure.values(q + h * d) - measure.values(q - h * d)) / (2.0 * h)
        for d in np.eye(q.shape[1])
    ]
    return np.stack(columns, axis=1)


def assert_gradient(measure: ConditionNumber | ForceSd, q: Array) -> None:
    values, gradients = measure.values_and_gradients(q)
    expected = finite_differences(measure, q)
    # Steps of 1e-5 leave an error of some 1e-10 of the third derivative; near singular postures
    # that is large, so errors are measured by the value and the gradient there.
    scale = values + np.max(np.abs(gradients), axis=1)
    assert np.max(np.abs(gradients - expected) / scale[:, np.newaxis]) < 1e-6


def test_condition_number_is_numpys_and_its_gradient_is_that_of_finite_differences(
    chain: SerialChain,
) -> None:
    q = np.random.default_rng(0).uniform(-1.5, 1.5, (40, chain.num_joints))
    measure = ConditionNumber(chain)
    expected = np.linalg.cond(chain.jacobian(q))
    good = expected < 300.0  # where finite differences can follow
    assert np.sum(good) >= 20
    values, _ = measure.values_and_gradients(q)
    np.testing.assert_allclose(values, expected, rtol=1e-9)
    np.testing.assert_allclose(measure.values(q), expected, rtol=1e-9)
    assert_gradient(measure, q[good])


@pytest.mark.long
@pytest.mark.parametrize("method", METHODS)
def test_force_sd_is_that_of_the_reconstruction_and_so_is_its_gradient(
    chain: SerialChain, method: str
) -> None:
    n = chain.num_joints
    config = WrenchReconstructionConfig(method=method).with_prior(30.0, 2.0)
    Sigma = torque_covariance(n)
    measure = ForceSd(chain, Sigma, config)
    q = np.random.default_rng(1).uniform(-1.5, 1.5, (40, n))
    q = q[np.linalg.cond(chain.jacobian(q)) < 100.0]
    assert len(q) >= 12
    stated = reconstruct_wrench(chain.jacobian(q), np.zeros((len(q), n)), Sigma, config)
    expected = np.sqrt(np.trace(stated.covariance[:, 3:, 3:], axis1=1, axis2=2))
    np.testing.assert_allclose(measure.values(q), expected, rtol=1e-9)
    assert_gradient(measure, q)


def test_many_postures_are_the_same_as_each_alone(sts: Robot) -> None:
    chain = sts.chain
    q = np.random.default_rng(2).uniform(-2.0, 2.0, (300, 6))
    config = WrenchReconstructionConfig().with_prior(20.0, 1.0)
    for measure in (ConditionNumber(chain), ForceSd(chain, torque_covariance(6), config)):
        values, gradients = measure.values_and_gradients(q.reshape(10, 30, 6))
        assert values.shape == (10, 30)
        assert gradients.shape == (10, 30, 6)
        one, its_gradient = measure.values_and_gradients(q[137])
        assert one == values.ravel()[137]
        np.testing.assert_array_equal(its_gradient, gradients.reshape(-1, 6)[137])


def test_the_condition_number_does_not_see_the_first_and_last_joint(sts: Robot) -> None:
    chain = sts.chain
    q = np.random.default_rng(3).uniform(-1.0, 1.0, (20, 6))
    _, gradients = ConditionNumber(chain).values_and_gradients(q)
    size = np.max(np.abs(gradients), axis=1)
    assert np.all(np.abs(gradients[:, 0]) < 1e-9 * size)
    assert np.all(np.abs(gradients[:, 5]) < 1e-9 * size)


def test_a_singular_posture_has_a_large_finite_value(sts: Robot) -> None:
    chain = sts.chain
    singular = np.array([0.3, 0.2, -0.5, 0.1, 0.0, 0.4])  # two wrist axes in line
    value, gradient = ConditionNumber(chain).values_and_gradients(singular)
    assert value >= 1e12
    assert np.all(np.isfinite(gradient))


@pytest.mark.parametrize("method", ["damped", "truncated"])
def test_methods_that_state_less_the_less_they_read_are_refused(sts: Robot, method: str) -> None:
    chain = sts.chain
    with pytest.raises(InputError, match=f"method: {method} states a smaller sd"):
        ForceSd(chain, np.eye(6), WrenchReconstructionConfig(method=method))


def test_a_measure_that_does_not_fit_the_arm_is_refused(sts: Robot) -> None:
    chain = sts.chain
    config = WrenchReconstructionConfig(method="inverse")
    with pytest.raises(InputError, match="is of 7 joints, the arm has 6"):
        ForceSd(chain, np.eye(7), config)
    with pytest.raises(InputError, match="positive definite"):
        ForceSd(chain, np.zeros((6, 6)), config)
    with pytest.raises(InputError, match="5 joints cannot hold"):
        ConditionNumber(random_chain(5))
    with pytest.raises(ValueError, match="expected q of shape"):
        ConditionNumber(chain).values_and_gradients(np.zeros(5))


@pytest.fixture(scope="module")
def arm(sts):
    return sts.chain


@pytest.fixture(scope="module")
def postures(arm):
    q = np.random.default_rng(0).uniform(-1.5, 1.5, (60, 6))
    return q[np.linalg.cond(arm.jacobian(q)) < 300.0]  # where finite differences can follow


@pytest.fixture(scope="module")
def kink(arm):
    """A posture in whose neighbourhood the two smallest singular values meet."""
    q = np.array([0.0, -2.42, 3.70, 0.0, -2.85, 0.0])

    def gap(q3):
        s = np.linalg.svd(arm.jacobian(np.array([*q[:2], q3, *q[3:]])), compute_uv=False)
        return s[4] - s[5]

    # With the wrist in the arm's plane the values cross, they do not avoid each other.
    grid = np.linspace(3.5, 3.8, 20001)
    q[2] = grid[np.argmin([gap(q3) for q3 in grid])]
    assert gap(q[2]) < 1e-4
    return q


@pytest.mark.parametrize("sharpness", [1.0, 10.0, 1e3, 1e5])
def test_the_smooth_one_is_numpys_p_norms_and_a_bound(arm, postures, sharpness):
    s = np.linalg.svd(arm.jacobian(postures), compute_uv=False)
    p = 2.0 * sharpness
    # Relative to the extremes, or the powers overflow.
    above = np.sum((s / s[:, :1]) ** p, axis=1) ** (1.0 / p)
    below = np.sum((s[:, -1:] / s) ** p, axis=1) ** (1.0 / p)
    condition = s[:, 0] / s[:, -1]
    values = ConditionNumber(arm, sharpness).values(postures)
    np.testing.assert_allclose(values, condition * above * below, rtol=1e-9)
    assert np.all(values >= condition * (1.0 - 1e-12))
    assert np.all(values <= condition * 6.0 ** (1.0 / sharpness) * (1.0 + 1e-12))


@pytest.mark.parametrize("sharpness", [1.0, 30.0, 1e3])
def test_the_smooth_ones_gradient_is_that_of_differences(arm, postures, kink, sharpness):
    measure = ConditionNumber(arm, sharpness)
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


def test_the_smooth_one_sharp_and_away_from_kinks_it_is_the_condition_number(arm, postures):
    s = np.linalg.svd(arm.jacobian(postures), compute_uv=False)
    clear = (s[:, 0] > 1.01 * s[:, 1]) & (s[:, 4] > 1.01 * s[:, 5])
    assert clear.sum() > 20
    values, gradients = ConditionNumber(arm, 1e5).values_and_gradients(postures[clear])
    plain, by_q = ConditionNumber(arm).values_and_gradients(postures[clear])
    np.testing.assert_allclose(values, plain, rtol=1e-12)
    np.testing.assert_allclose(gradients, by_q, rtol=1e-9, atol=1e-9)


def test_singular_postures_and_wrong_sharpness(arm):
    values, gradients = ConditionNumber(arm, 10.0).values_and_gradients(
        np.array([0.3, 0.2, -0.4, 0.5, 0.0, 0.1])  # axes 4 and 6 in one line
    )
    assert values == 1e12
    np.testing.assert_array_equal(gradients, 0.0)
    with pytest.raises(ValueError, match="sharpness"):
        ConditionNumber(arm, 0.5)


def test_only_what_has_kinks_is_smoothed(arm):
    plain = ConditionNumber(arm)
    assert smoothed(arm, plain, 10.0).values(np.full(6, 0.5)) > plain.values(np.full(6, 0.5))
    force_sd = ForceSd(arm, np.eye(6), WrenchReconstructionConfig(method="force_only"))
    assert smoothed(arm, force_sd, 10.0) is force_sd
