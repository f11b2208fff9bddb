"""The consistent fit: what a body is, what the program returns, what the data still decide."""

import copy

import numpy as np
import pytest

from wrenchsight.models.friction.friction_structure import FrictionStructure
from wrenchsight.models.identification.base_parameters import find_base_parameters
from wrenchsight.models.identification.physical_consistency import (
    fit_consistent,
    least_eigenvalues,
    pseudo_inertia,
    unphysical_links,
)
from wrenchsight.models.identification.torque_regression import (
    JointMotion,
    RegressionRows,
    parameter_names,
    parameter_prior,
    split_terms,
)


def points(masses, positions):
    """Inertial parameters of point masses, summed one by one."""
    out = np.zeros(10)
    for m, p in zip(masses, positions, strict=True):
        inertia = m * (p @ p * np.eye(3) - np.outer(p, p))
        out += [m, *(m * p), *inertia[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]]
    return out


def test_pseudo_inertia_is_the_second_moment_of_the_mass():
    rng = np.random.default_rng(0)
    masses, positions = rng.uniform(size=8), rng.normal(size=(8, 3))
    homogeneous = np.column_stack([positions, np.ones(8)])
    expected = np.einsum("k,ki,kj->ij", masses, homogeneous, homogeneous)
    np.testing.assert_allclose(pseudo_inertia(points(masses, positions)), expected, atol=1e-12)


def test_a_link_without_a_physical_body_is_named():
    rng = np.random.default_rng(1)
    good = points(np.ones(6), rng.normal(size=(6, 3)))
    negative = good * np.r_[-1.0, np.ones(9)]
    # Principal moments 1, 1, 3: each is positive, and no distribution of mass has them.
    flat = np.array([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 3.0])
    assert unphysical_links(np.array([good, negative, flat]), ["a", "b", "c"]) == ["b", "c"]


@pytest.fixture(scope="module")
def problem(sts):
    """The bundled arm's regression with noise, and its true parameters."""
    n = sts.num_joints
    rng = np.random.default_rng(4)
    t = 0.02 * np.arange(600)[:, None]
    q, v, vdot = np.zeros((3, 600, n))
    for k in range(1, 6):
        w, amplitude, phase = (
            2 * np.pi * 0.1 * k,
            rng.uniform(0.2, 0.6, n) / k,
            rng.uniform(0, 6, n),
        )
        q += amplitude * np.sin(w * t + phase)
        v += amplitude * w * np.cos(w * t + phase)
        vdot -= amplitude * w**2 * np.sin(w * t + phase)
    structure = FrictionStructure.of("coulomb-viscous-offset", n)
    prior, spread = parameter_prior(sts)
    truth = prior.copy()
    # A body scaled in mass and size stays a body.
    mass, size = rng.uniform(0.7, 1.3, n), rng.uniform(0.9, 1.1, n)
    powers = np.array([0, 1, 1, 1, 2, 2, 2, 2, 2, 2])
    truth[: 10 * n] *= (mass[:, None] * size[:, None] ** powers).ravel()
    truth[10 * n :] = np.tile([1.0, 5.0, 4.0, 0.2], n)
    rows = RegressionRows.of(
        sts.chain, JointMotion(q, v, vdot), np.zeros_like(q), lambda x: x, np.arange(600)
    )
    friction = rows.friction_rows(structure.columns(q, v, np.zeros_like(q)))
    tau = -rows.residual(friction, truth)
    noisy = tau + rng.normal(scale=2.0, size=tau.shape)
    rows = RegressionRows(rows.rigid, noisy, rows.low_pass, rows.rows)
    R = np.vstack([factor / 2.0 for factor in rows.factors(friction).R])
    return sts, structure, prior, spread, truth, R, np.abs(v).max(axis=0)


def test_links_are_bodies_and_friction_takes_energy(problem):
    robot, structure, prior, spread, _, R, v_max = problem
    n = robot.num_joints
    fit = fit_consistent(R[:, :-1], R[:, -1], prior, spread, structure, v_max)
    inertial, rotor, friction = split_terms(fit.x, [3] * n)
    assert unphysical_links(inertial, robot.joint_names) == []
    assert (fit.least_eigenvalue > 0.0).all()
    np.testing.assert_allclose(
        fit.least_eigenvalue, least_eigenvalues(inertial, spread[: 10 * n].reshape(n, 10))
    )
    assert (rotor >= -1e-9).all()
    assert (np.array(friction)[:, :2] >= -1e-9).all()
    # Plain least squares of the same rows leaves links that belong to no body: the test has
    # something to repair.
    plain = np.linalg.lstsq(R[:, :-1], R[:, -1], rcond=1e-9)[0]
    assert unphysical_links(plain[: 10 * n].reshape(n, 10), robot.joint_names)


def test_what_the_data_determine_comes_from_them_and_the_rest_from_the_file(problem):
    robot, structure, prior, spread, truth, R, v_max = problem
    fit = fit_consistent(R[:, :-1], R[:, -1], prior, spread, structure, v_max)
    base = find_base_parameters(R[:, :-1], parameter_names(robot.joint_names, structure.terms))
    W = R[:, base.independent]
    sd = np.sqrt(np.diag(np.linalg.inv(W.T @ W)))
    deviation = base.combination @ (fit.x - truth) / sd
    # Within what the noise allows of the truth, which is a body, too: 58 Gaussian deviations, of
    # which the constraints take some away.
    assert np.sqrt(np.mean(deviation**2)) < 1.2
    # The first link turns about a vertical axis: nothing feels its mass. 1 %: a heavier or lighter
    # link with the moment of inertia that is felt may be the nearer body.
    assert fit.x[0] == pytest.approx(prior[0], rel=0.01)


def test_an_arm_that_states_no_masses_gets_them_from_the_data(problem):
    robot, structure, _, _, truth, R, v_max = problem
    bare = copy.copy(robot)
    bare.__dict__["chain"] = robot.chain.with_inertial_parameters(np.zeros((6, 10)))
    prior, spread = parameter_prior(bare)
    fit = fit_consistent(R[:, :-1], R[:, -1], prior, spread, structure, v_max)
    base = find_base_parameters(R[:, :-1], parameter_names(robot.joint_names, structure.terms))
    W = R[:, base.independent]
    sd = np.sqrt(np.diag(np.linalg.inv(W.T @ W)))
    deviation = base.combination @ (fit.x - truth) / sd
    assert np.sqrt(np.mean(deviation**2)) < 1.5  # as above, from a prior that knows less


def test_the_length_of_the_log_does_not_matter_once_it_is_reduced(problem):
    _, structure, prior, spread, _, R, v_max = problem
    once = fit_consistent(R[:, :-1], R[:, -1], prior, spread, structure, v_max)
    twice = np.vstack([R, np.zeros_like(R)])
    again = fit_consistent(twice[:, :-1], twice[:, -1], prior, spread, structure, v_max)
    # The interior point method's own tolerance, 1e-8 of the objective.
    np.testing.assert_allclose(again.x, once.x, atol=1e-3 * np.abs(once.x).max())


def test_negative_friction_is_held_at_zero(problem):
    robot, _, prior, spread, truth, R, v_max = problem
    n = robot.num_joints
    structure = FrictionStructure.of("coulomb-viscous-offset", n)
    pulled = truth.copy()
    pulled[10 * n + 1] = -5.0  # Coulomb friction of the first joint
    b = R[:, -1] + R[:, :-1] @ (pulled - truth)
    fit = fit_consistent(R[:, :-1], b, prior, spread, structure, v_max)
    assert fit.x[10 * n + 1] == pytest.approx(0.0, abs=1e-5)
