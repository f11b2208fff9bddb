"""Wrench reconstruction: closed forms, limits, singularities, calibration, the log's own prior."""

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest

from wrenchsight.models.estimation.evidence_prior import (
    FORCE_SD_RANGE,
    MOMENT_SD_RANGE,
    evidence_prior,
    evidence_prior_and_noise,
)
from wrenchsight.models.estimation.wrench import (
    WrenchReconstruction,
    WrenchReconstructionConfig,
    reconstruct_wrench,
)
from wrenchsight.models.estimation.wrench_methods import METHODS
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.rigid_body.conditioning import condition_number


def jacobians(count: int, n: int = 6, seed: int = 1) -> Array:
    return np.random.default_rng(seed).normal(size=(count, 6, n))


def noise_covariance(n: int = 6, seed: int = 2) -> Array:
    """Full, not diagonal; sds between 0.3 and 3 N m."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n, n)) * np.linspace(0.3, 1.5, n)[:, None]
    return np.asarray(A @ A.T + 0.05 * np.eye(n))


def config(
    method: str, force_sd: float = 30.0, moment_sd: float = 2.0
) -> WrenchReconstructionConfig:
    return WrenchReconstructionConfig(method, force_sd, moment_sd)


def singular_jacobian(n: int = 6) -> Array:
    """A direction of force, (0, 0.6, 0.8), that no joint feels."""
    J = jacobians(1, n, seed=8)[0]
    blind = np.array([0.0, 0.0, 0.0, 0.0, 0.6, 0.8])
    return np.asarray(J - np.outer(blind, blind @ J))


# ---- the formulas, by numpy --------------------------------------------------------------------


@pytest.mark.parametrize("n", [4, 6, 7, 9])
def test_bayesian_is_the_gaussian_posterior(n: int) -> None:
    J, Sigma = jacobians(20, n), noise_covariance(n)
    tau = np.random.default_rng(3).normal(size=(20, n)) * 10.0
    estimate = reconstruct_wrench(J, tau, Sigma, config("bayesian"))
    P = np.diag([4.0] * 3 + [900.0] * 3)
    for k in range(20):
        gain = P @ J[k] @ np.linalg.inv(J[k].T @ P @ J[k] + Sigma)  # the other form of it
        np.testing.assert_allclose(estimate.wrench[k], gain @ tau[k], rtol=1e-8, atol=1e-9)
        np.testing.assert_allclose(
            estimate.covariance[k], P - gain @ J[k].T @ P, rtol=1e-7, atol=1e-9
        )
    np.testing.assert_allclose(estimate.condition_number, condition_number(J), rtol=1e-9)


@pytest.mark.parametrize("n", [4, 6, 7, 9])
def test_inverse_is_equation_22_with_the_noise_passed_through(n: int) -> None:
    J, Sigma = jacobians(20, n), noise_covariance(n)
    tau = np.random.default_rng(3).normal(size=(20, n)) * 10.0
    estimate = reconstruct_wrench(J, tau, Sigma, config("inverse"))
    pinv = np.linalg.pinv(J.transpose(0, 2, 1))
    np.testing.assert_allclose(estimate.wrench, (pinv @ tau[..., None])[..., 0], rtol=1e-9)
    np.testing.assert_allclose(estimate.condition_number, condition_number(J), rtol=1e-9)
    if n >= 6:
        expected = pinv @ Sigma @ pinv.transpose(0, 2, 1)
        np.testing.assert_allclose(estimate.covariance, expected, rtol=1e-8, atol=1e-9)
    else:  # fewer joints than components: part of every wrench is unseen
        assert not estimate.valid.any()
        assert np.isfinite(estimate.covariance).all()
        assert np.all(estimate.standard_deviation > 1e3)


@pytest.mark.parametrize("n", [6, 7])
def test_force_only_is_weighted_least_squares_on_the_force(n: int) -> None:
    J, Sigma = jacobians(20, n), noise_covariance(n)
    tau = np.random.default_rng(3).normal(size=(20, n)) * 10.0
    estimate = reconstruct_wrench(J, tau, Sigma, config("force_only"))
    W = np.linalg.inv(Sigma)
    for k in range(20):
        covariance = np.linalg.inv(J[k, 3:] @ W @ J[k, 3:].T)
        force = covariance @ J[k, 3:] @ W @ tau[k]
        np.testing.assert_allclose(estimate.wrench[k, 3:], force, rtol=1e-8)
        np.testing.assert_allclose(estimate.covariance[k, 3:, 3:], covariance, rtol=1e-6, atol=1e-9)
    assert np.all(estimate.wrench[:, :3] == 0.0)
    assert np.all(estimate.covariance[:, :3] == 0.0)
    assert np.all(estimate.covariance[:, :, :3] == 0.0)


def test_damped_and_truncated_are_the_textbook_pseudo_inverses() -> None:
    J, Sigma = jacobians(20), noise_covariance()
    tau = np.random.default_rng(3).normal(size=(20, 6)) * 10.0
    U, s, Vt = np.linalg.svd(J.transpose(0, 2, 1))
    is_large = s > 0.2 * s[:, :1]
    gains = {"damped": s / (s**2 + 0.3**2), "truncated": np.where(is_large, 1.0 / s, 0.0)}
    assert 0 < np.sum(is_large) < s.size
    for method, gain in gains.items():
        H = Vt.transpose(0, 2, 1) * gain[:, None, :] @ U.transpose(0, 2, 1)
        settings = WrenchReconstructionConfig(method, 30.0, 2.0, damping=0.3, truncation=0.2)
        estimate = reconstruct_wrench(J, tau, Sigma, settings)
        np.testing.assert_allclose(estimate.wrench, (H @ tau[..., None])[..., 0], rtol=1e-8)
        expected = H @ Sigma @ H.transpose(0, 2, 1)
        np.testing.assert_allclose(estimate.covariance, expected, rtol=1e-7, atol=1e-9)


# ---- one estimator, several readings -----------------------------------------------------------


@pytest.mark.parametrize("force_sd", [1e5, np.inf])
def test_a_huge_prior_gives_the_inverse(force_sd: float) -> None:
    """With 6 joints weights cannot matter; with 7 they do, and equal ones give eq. 22."""
    for n, Sigma in ((6, noise_covariance()), (7, 0.04 * np.eye(7))):
        J = jacobians(10, n)
        tau = np.random.default_rng(4).normal(size=(10, n))
        loose = reconstruct_wrench(J, tau, Sigma, config("bayesian", force_sd, 1e5))
        inverse = reconstruct_wrench(J, tau, Sigma, config("inverse"))
        np.testing.assert_allclose(loose.wrench, inverse.wrench, rtol=1e-5, atol=1e-6)
        np.testing.assert_allclose(loose.covariance, inverse.covariance, rtol=1e-5, atol=1e-5)


def test_unequal_weights_with_seven_joints_are_weighted_least_squares() -> None:
    J, Sigma = jacobians(10, 7), noise_covariance(7)
    tau = np.random.default_rng(4).normal(size=(10, 7))
    loose = reconstruct_wrench(J, tau, Sigma, config("bayesian", 1e5, 1e5))
    root = np.linalg.inv(np.linalg.cholesky(Sigma))
    for k in range(10):
        expected = np.linalg.lstsq(root @ J[k].T, root @ tau[k], rcond=None)[0]
        np.testing.assert_allclose(loose.wrench[k], expected, rtol=1e-5, atol=1e-6)


def test_a_vanishing_moment_prior_gives_force_only() -> None:
    J, Sigma = jacobians(10), noise_covariance()
    tau = np.random.default_rng(4).normal(size=(10, 6))
    force_only = reconstruct_wrench(J, tau, Sigma, config("force_only"))
    for moment_sd in (1e-7, 0.0):
        tight = reconstruct_wrench(J, tau, Sigma, config("bayesian", 1e6, moment_sd))
        np.testing.assert_allclose(tight.wrench, force_only.wrench, rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(tight.covariance, force_only.covariance, rtol=1e-6, atol=1e-6)


def test_exact_torques_are_read_exactly() -> None:
    J = jacobians(10, 7)
    F = np.random.default_rng(5).normal(size=(10, 6)) * 20.0
    tau = np.einsum("kij,ki->kj", J, F)
    np.testing.assert_allclose(
        reconstruct_wrench(J, tau, np.eye(7), config("inverse")).wrench, F, rtol=1e-9, atol=1e-9
    )


@pytest.mark.parametrize(
    ("robot", "method"),
    # Three joints tell the force alone, where there is no moment.
    [*product(("sts", "ur10e"), METHODS), ("tilted_arm", "force_only")],
)
def test_a_push_is_read_along_the_motion_that_it_gives(
    robot: str, method: str, request: pytest.FixtureRequest
) -> None:
    """A sign error anywhere shows here, from the Jacobian to the wrench; so do swapped rows.

    What a push does to a joint is the work that it does as the joint turns: the motion of E, taken
    from two poses, times the push. Each component is pushed alone, both ways.
    """
    chain = request.getfixturevalue(robot).chain
    n, step = chain.num_joints, 1e-6
    q = np.array([0.4, -1.0, 0.9, 0.3, 0.8, -0.2])[:n]
    (R_back, p_back), (R_on, p_on) = (chain.pose(q + d * np.eye(n)) for d in (-step, step))
    turned = R_on @ R_back.transpose(0, 2, 1)  # about the axes of W
    turn = np.stack([turned[:, 2, 1], turned[:, 0, 2], turned[:, 1, 0]])
    motion = np.vstack([turn, (p_on - p_back).T]) / (2 * step)
    # A wide prior, little damping and nothing cut off: the readings of exact torques are the push.
    settings = WrenchReconstructionConfig(method, 1e4, 1e4, damping=1e-4, truncation=1e-6)
    for component in range(3, 6) if method == "force_only" else range(6):
        for push in (5.0, -5.0):
            F = push * np.eye(6)[component]
            tau = motion.T @ F
            estimate = reconstruct_wrench(chain.jacobian(q), tau, np.eye(n), settings)
            # 1e-4: the differences' rounding over a smallest singular value of 0.1.
            np.testing.assert_allclose(estimate.wrench, F, atol=1e-4)


def test_the_estimate_turns_with_the_frame() -> None:
    """One prior for every direction: reading in turned axes is the turned reading."""
    from scipy.spatial.transform import Rotation

    R = np.kron(np.eye(2), Rotation.from_rotvec([0.3, -1.0, 0.5]).as_matrix())
    J, Sigma = jacobians(5), noise_covariance()
    tau = np.random.default_rng(4).normal(size=(5, 6)) * 5.0
    for method in METHODS:
        here = reconstruct_wrench(J, tau, Sigma, config(method))
        turned = reconstruct_wrench(R @ J, tau, Sigma, config(method))
        np.testing.assert_allclose(turned.wrench, here.wrench @ R.T, rtol=1e-8, atol=1e-9)
        np.testing.assert_allclose(turned.covariance, R @ here.covariance @ R.T, atol=1e-8)
        np.testing.assert_array_equal(turned.valid, here.valid)


# ---- singular configurations -------------------------------------------------------------------


@pytest.mark.parametrize("n", [6, 7])
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("distance", [0.0, 1e-300, 1e-17, 1e-13, 1e-8, 1e-3])
def test_at_and_near_a_singular_jacobian_everything_is_finite_and_flagged(
    method: str, n: int, distance: float
) -> None:
    blind = np.array([0.0, 0.0, 0.0, 0.0, 0.6, 0.8])
    J = singular_jacobian(n) + distance * np.outer(blind, np.ones(n))
    tau = 5.0 * np.random.default_rng(6).normal(size=n)
    estimate = reconstruct_wrench(J, tau, noise_covariance(n), config(method))
    assert np.isfinite(estimate.wrench).all()
    assert np.isfinite(estimate.covariance).all()
    assert not estimate.valid
    assert estimate.condition_number > 1e3
    if method == "bayesian":  # what is not seen is known as well as before, and no worse
        in_blind = np.sqrt(blind @ estimate.covariance @ blind)
        assert in_blind == pytest.approx(30.0, rel=2e-3)
        assert np.all(estimate.standard_deviation[3:] <= 30.0 * (1.0 + 1e-12))
        assert np.all(estimate.standard_deviation[:3] <= 2.0 * (1.0 + 1e-12))
        assert np.abs(estimate.wrench).max() < 100.0


@pytest.mark.parametrize("method", ["inverse", "force_only", "bayesian"])
def test_the_stated_sd_grows_towards_the_singular_configuration(method: str) -> None:
    blind = np.array([0.0, 0.0, 0.0, 0.0, 0.6, 0.8])
    seen = singular_jacobian()
    direction = np.outer(blind, [1.0, -0.5, 0.3, 0.8, 0.1, -0.7])
    distances = np.geomspace(1.0, 1e-9, 40)
    J = seen + distances[:, None, None] * direction
    estimate = reconstruct_wrench(J, np.zeros((40, 6)), noise_covariance(), config(method))
    sd = np.sqrt(np.einsum("i,kij,j->k", blind, estimate.covariance, blind))
    # Rounding: with a force sd of 1e6 N for infinity, 1e-16 of 1e12 times some 1/(N m)^2.
    assert np.all(np.diff(sd) > -1e-3 * sd[:-1])
    # And the flag changes exactly once.
    assert estimate.valid[0]
    assert np.sum(np.diff(estimate.valid.astype(int)) != 0) == 1


def test_a_jacobian_of_zeros() -> None:
    for method in METHODS:
        estimate = reconstruct_wrench(np.zeros((6, 6)), np.ones(6), np.eye(6), config(method))
        assert np.isfinite(estimate.wrench).all()
        assert np.isfinite(estimate.covariance).all()
        assert not estimate.valid
        assert estimate.condition_number == np.inf


def test_the_bound_of_a_valid_reading() -> None:
    """Along one axis everything is a scalar: noise sd s against prior sd p."""
    for s, inverse_valid in ((29.0, True), (31.0, False)):
        J, Sigma = np.eye(6), np.diag([0.01] * 3 + [1.0, 1.0, s**2])
        for method in ("inverse", "force_only", "bayesian", "damped", "truncated"):
            estimate = reconstruct_wrench(J, np.zeros(6), Sigma, config(method, 30.0))
            assert bool(estimate.valid) is inverse_valid
        tighter = WrenchReconstructionConfig("bayesian", 30.0, 2.0, max_force_sd=20.0)
        assert not reconstruct_wrench(J, np.zeros(6), Sigma, tighter).valid
        wider = WrenchReconstructionConfig("inverse", 30.0, 2.0, max_force_sd=40.0)
        assert reconstruct_wrench(J, np.zeros(6), Sigma, wider).valid


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_input_that_is_not_finite_gives_zero_the_prior_and_a_flag(method: str, bad: float) -> None:
    J, Sigma = jacobians(3), noise_covariance()
    tau = np.ones((3, 6))
    clean = reconstruct_wrench(J, tau, Sigma, config(method))
    tau[0, 2] = bad
    J[1, 4, 3] = bad
    estimate = reconstruct_wrench(J, tau, Sigma, config(method))
    assert np.all(estimate.wrench[:2] == 0.0)
    assert not estimate.valid[:2].any()
    moment, force = (0.0, 1e6) if method == "force_only" else (2.0, 30.0)
    expected = np.array([moment] * 3 + [force] * 3)
    np.testing.assert_allclose(estimate.standard_deviation[:2], [expected, expected])
    np.testing.assert_array_equal(estimate.wrench[2], clean.wrench[2])
    assert np.isfinite(estimate.covariance).all()


# ---- calibration -------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [6, 7])
@pytest.mark.parametrize("method", METHODS)
def test_stated_covariance_is_the_sample_covariance(method: str, n: int) -> None:
    """Wrenches drawn from the prior (bayesian), or one fixed wrench (the others)."""
    rng = np.random.default_rng(7)
    draws = 100_000
    J, Sigma = jacobians(1, n)[0], noise_covariance(n)
    prior = np.array([2.0] * 3 + [30.0] * 3)
    F = rng.normal(size=(draws, 6)) * prior
    if method == "force_only":
        F[:, :3] = 0.0
    elif method != "bayesian":
        F[:] = F[0]
    tau = F @ J + rng.normal(size=(draws, n)) @ np.linalg.cholesky(Sigma).T
    estimate = reconstruct_wrench(np.broadcast_to(J, (draws, 6, n)), tau, Sigma, config(method))
    error = estimate.wrench - F
    sample = np.cov(error.T)
    stated = estimate.covariance[0]
    sd = np.maximum(np.sqrt(np.diag(stated)), 1e-12)
    # An entry's relative sampling error is sqrt(2 / draws) = 0.45 %; five of them.
    np.testing.assert_allclose(sample / np.outer(sd, sd), stated / np.outer(sd, sd), atol=0.0225)
    bias = np.abs(error.mean(axis=0)) / sd
    if method in ("inverse", "force_only", "bayesian"):
        assert bias.max() < 5.0 / np.sqrt(draws)
    elif method == "damped":  # its loss of the true wrench is no noise, and not in its covariance
        assert bias.max() > 0.1


# ---- one path of code --------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
def test_single_sample_and_log_are_the_same(method: str) -> None:
    J, Sigma = jacobians(600, 7), noise_covariance(7)
    tau = np.random.default_rng(4).normal(size=(600, 7))
    reconstruction = WrenchReconstruction(config(method), Sigma)
    many = reconstruction.reconstruct(J, tau)
    for k in (0, 299, 599):
        one = reconstruction.reconstruct(J[k], tau[k])
        np.testing.assert_array_equal(one.wrench, many.wrench[k])
        np.testing.assert_array_equal(one.covariance, many.covariance[k])
        assert one.condition_number == many.condition_number[k]
        assert one.invalid == many.invalid[k]
    assert reconstruction.reconstruct(J[:0], tau[:0]).wrench.shape == (0, 6)
    two = reconstruction.reconstruct(J.reshape(2, 300, 6, 7), tau.reshape(2, 300, 7))
    np.testing.assert_array_equal(two.wrench.reshape(600, 6), many.wrench)


# ---- priors ------------------------------------------------------------------------------------


def test_with_prior_fills_what_the_user_left_open() -> None:
    assert WrenchReconstructionConfig(prior_force_sd=7.0).with_prior(1.0, 2.0) == (
        WrenchReconstructionConfig(prior_force_sd=7.0, prior_moment_sd=2.0)
    )


def synthetic_log(
    force_sd: float, moment_sd: float, n: int = 6, count: int = 6000, seed: int = 11
) -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(seed)
    J, Sigma = jacobians(count, n, seed), noise_covariance(n)
    F = rng.normal(size=(count, 6)) * np.array([moment_sd] * 3 + [force_sd] * 3)
    noise = rng.normal(size=(count, n)) @ np.linalg.cholesky(Sigma).T
    return J, np.einsum("kij,ki->kj", J, F) + noise, Sigma


@pytest.mark.parametrize(("force_sd", "moment_sd"), [(20.0, 1.0), (5.0, 5.0), (100.0, 0.5)])
def test_evidence_recovers_the_sds_of_a_log(force_sd: float, moment_sd: float) -> None:
    prior = evidence_prior(*synthetic_log(force_sd, moment_sd))
    # 2000 samples: the force sd has 6000 components, 1 % each way; a moment sd near the torque
    # noise is known five times worse.
    assert prior[0] == pytest.approx(force_sd, rel=0.04)
    assert prior[1] == pytest.approx(moment_sd, rel=0.15)


def test_evidence_near_its_lower_bound() -> None:
    """A top just inside the bounds, where a search can get stuck on them."""
    J, Sigma = jacobians(6000, 6), noise_covariance()
    rng = np.random.default_rng(3)
    F = rng.normal(size=(len(J), 6)) * np.array([0.08] * 3 + [1.3] * 3)
    quiet = 1e-3 * Sigma
    error = rng.normal(size=(6000, 6)) @ np.linalg.cholesky(quiet).T
    prior = evidence_prior(J, np.einsum("kij,ki->kj", J, F) + error, quiet)
    assert prior == pytest.approx((1.3, 0.08), rel=0.1)
    found_too = evidence_prior_and_noise(J, np.einsum("kij,ki->kj", J, F) + error, Sigma)
    assert found_too[0] == pytest.approx(1.3, rel=0.1)


def test_evidence_is_deterministic_and_ignores_holes() -> None:
    J, tau, Sigma = synthetic_log(20.0, 1.0, count=1500)
    first = evidence_prior(J, tau, Sigma)
    assert evidence_prior(J, tau, Sigma) == first
    holes = np.full((300, 6), np.nan)
    assert evidence_prior(
        np.concatenate([J[:300], J]), np.concatenate([holes, tau]), Sigma
    ) == pytest.approx(first)


def test_a_log_without_contact_gives_the_lower_bounds() -> None:
    J, tau, Sigma = synthetic_log(0.0, 0.0)
    force_sd, moment_sd = evidence_prior(J, tau, Sigma)
    assert force_sd == pytest.approx(FORCE_SD_RANGE[0], rel=1e-3)
    assert MOMENT_SD_RANGE[0] <= moment_sd < 0.2
    assert evidence_prior(J, 0.0 * tau, Sigma) == pytest.approx(
        (FORCE_SD_RANGE[0], MOMENT_SD_RANGE[0]), rel=1e-3
    )


def test_evidence_finds_the_scale_of_the_noise_too() -> None:
    J, tau, Sigma = synthetic_log(20.0, 1.0, n=7)
    force_sd, moment_sd, scale = evidence_prior_and_noise(J, tau, Sigma / 9.0)
    assert force_sd == pytest.approx(20.0, rel=0.04)
    assert moment_sd == pytest.approx(1.0, rel=0.15)
    assert scale == pytest.approx(3.0, rel=0.04)


def test_evidence_of_nothing_is_refused() -> None:
    J, tau, Sigma = synthetic_log(20.0, 1.0, count=10)
    with pytest.raises(ValueError, match="no sample is finite"):
        evidence_prior(J, tau * np.nan, Sigma)
    with pytest.raises(ValueError, match="must be"):
        evidence_prior(J, tau[:5], Sigma)


# ---- bad configuration -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"method": "bayes"}, "one of inverse, force_only, bayesian"),
        ({"method": "bayesian", "prior_moment_sd": 1.0}, "needs prior_force_sd"),
        ({"method": "inverse", "prior_force_sd": -1.0}, "prior_force_sd must be"),
        ({"method": "inverse", "prior_moment_sd": np.nan}, "prior_moment_sd must be"),
        ({"method": "damped", "damping": -0.1}, "damping must be"),
        ({"method": "truncated", "truncation": np.inf}, "truncation must be"),
    ],
)
def test_bad_configuration_is_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        WrenchReconstruction(WrenchReconstructionConfig(**arguments), np.eye(6))


@pytest.mark.parametrize(
    ("Sigma", "message"),
    [
        (np.diag([1.0, 1.0, 0.0, 1.0, 1.0, 1.0]), "positive definite"),
        (-np.eye(6), "positive definite"),
        (np.eye(6) + np.eye(6, k=1), "symmetric"),
        (np.full((6, 6), np.nan), "finite"),
        (np.ones(6), r"must be \(n, n\)"),
    ],
)
def test_bad_covariance_is_refused(Sigma: Array, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        WrenchReconstruction(config("bayesian"), Sigma)


def test_shapes_that_disagree_are_refused() -> None:
    with pytest.raises(ValueError, match="J must be"):
        reconstruct_wrench(np.ones((3, 6, 6)), np.ones((4, 6)), np.eye(6), config("bayesian"))


def test_sds_of_each_sample_are_a_covariance_of_their_own() -> None:
    rng = np.random.default_rng(12)
    A = rng.normal(size=(7, 7))
    R = A @ A.T + 3.0 * np.eye(7)
    size = np.sqrt(np.diag(R))
    R /= np.outer(size, size)
    J, tau, sd = (
        rng.normal(size=(20, 6, 7)),
        rng.normal(size=(20, 7)),
        rng.uniform(0.1, 3.0, (20, 7)),
    )
    for method in METHODS:
        config = WrenchReconstructionConfig(method, prior_force_sd=30.0, prior_moment_sd=2.0)
        readings = WrenchReconstruction(config, R).reconstruct(J, tau, sd)
        for k in range(20):
            one = reconstruct_wrench(J[k], tau[k], np.outer(sd[k], sd[k]) * R, config)
            np.testing.assert_allclose(readings.wrench[k], one.wrench, rtol=1e-7, atol=1e-9)
            np.testing.assert_allclose(
                readings.covariance[k], one.covariance, rtol=1e-7, atol=1e-9 * one.covariance.max()
            )
            assert readings.valid[k] == one.valid


def seen_directions(sds: list[float]) -> tuple[np.ndarray, np.ndarray]:
    """J = 1 and sds of six joints: each sees one component of the wrench, moments first."""
    return np.eye(6)[None], np.array([[0.01, 0.01, 0.01, *sds]])


LIVE = {"live_force_sd": 60.0, "live_moment_sd": 3.0}


def test_valid_is_the_same_whatever_the_prior_of_the_reading() -> None:
    """The least certain force has an sd of 19.9 N beside a live prior of 60 N, or of 20.1."""
    for worst, expected in ((19.9, True), (20.1, False)):
        torque_sd = 1.0 / np.sqrt(1.0 / worst**2 - 1.0 / 60.0**2)
        J, sd = seen_directions([1.0, torque_sd, 2.0])
        for prior in (0.5, 5.0, 60.0, 1e4):
            config = WrenchReconstructionConfig("bayesian", prior, 0.1, **LIVE)
            reading = WrenchReconstruction(config, np.eye(6)).reconstruct(J, np.ones((1, 6)), sd)
            assert bool(reading.valid[0]) is expected
            assert reading.standard_deviation[0, 4] < prior


@pytest.mark.parametrize("method", ["force_only", "bayesian", "inverse", "damped"])
def test_what_stiction_may_feign_is_bounded(method: str) -> None:
    """Even over a band of sd s N m, at 1 m: sqrt(3) s N at most, and 9.6 N may be."""
    for s, expected in ((5.5, True), (5.6, False)):
        J, sd = seen_directions([1.0, 7.0, 1.0])
        held = np.zeros((1, 6))
        held[0, 4] = s
        config = WrenchReconstructionConfig(method, 1e4, 1e4, live_force_sd=1e4, live_moment_sd=1e4)
        config = replace(config, max_force_sd=20.0, max_stiction_force=9.6)
        reading = WrenchReconstruction(config, np.eye(6)).reconstruct(J, np.ones((1, 6)), sd, held)
        assert bool(reading.valid[0]) is expected
        assert WrenchReconstruction(config, np.eye(6)).reconstruct(J, np.ones((1, 6)), sd).valid[0]


def test_what_stiction_feigns_goes_through_the_correlated_gain() -> None:
    rng = np.random.default_rng(13)
    A = rng.normal(size=(7, 7))
    R = A @ A.T + 3.0 * np.eye(7)
    size = np.sqrt(np.diag(R))
    R /= np.outer(size, size)
    J, sd = rng.normal(size=(6, 7)), rng.uniform(0.5, 2.0, 7)
    held = sd * rng.uniform(0.2, 0.9, 7)
    Sigma = np.outer(sd, sd) * R
    information = J @ np.linalg.inv(Sigma) @ J.T + np.diag([1 / 9.0] * 3 + [1 / 3600.0] * 3)
    gain = (np.linalg.inv(information) @ J @ np.linalg.inv(Sigma))[3:]
    feigned = np.sqrt(3.0 * np.linalg.eigvalsh(gain @ np.diag(held**2) @ gain.T)[-1])
    for limit, expected in ((1.0001 * feigned, True), (0.9999 * feigned, False)):
        config = WrenchReconstructionConfig(
            "bayesian", 5.0, 0.2, max_force_sd=1e3, max_stiction_force=limit, **LIVE
        )
        reading = WrenchReconstruction(config, R).reconstruct(J, np.ones(7), sd, held)
        assert bool(reading.valid) is expected


@pytest.mark.parametrize("method", METHODS)
def test_without_condition_numbers_all_else_is_the_same(method: str) -> None:
    J, tau = jacobians(300), np.random.default_rng(2).normal(size=(300, 6))
    reading = WrenchReconstruction(config(method), noise_covariance())
    whole, part = reading.reconstruct(J, tau), reading.reconstruct(J, tau, J_now=J[:0])
    assert np.isnan(part.condition_number).all()
    for name in ("wrench", "covariance", "invalid"):
        np.testing.assert_array_equal(getattr(part, name), getattr(whole, name))


def test_the_condition_number_is_that_of_the_present() -> None:
    rng = np.random.default_rng(14)
    J, now = rng.normal(size=(2, 6, 6))
    config = WrenchReconstructionConfig("bayesian", 30.0, 2.0)
    reading = WrenchReconstruction(config, np.eye(6)).reconstruct(J, np.ones(6), J_now=now)
    assert reading.condition_number == pytest.approx(np.linalg.cond(now), rel=1e-9)
    np.testing.assert_array_equal(
        reading.wrench, WrenchReconstruction(config, np.eye(6)).reconstruct(J, np.ones(6)).wrench
    )
