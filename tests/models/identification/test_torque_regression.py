"""The regression of joint torque, against pinocchio's torque with known parameters."""

import numpy as np
import pinocchio as pin
import pytest

from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.identification.base_parameters import find_base_parameters
from wrenchsight.models.identification.torque_regression import (
    JointMotion,
    factorise,
    parameter_columns,
    parameter_names,
    realisation,
    solve,
    split_terms,
)


def motion(n, num_samples=1500, step=0.01, seed=0):
    """Five harmonics of 0.1 Hz on each joint, with their exact derivatives."""
    rng = np.random.default_rng(seed)
    t = step * np.arange(num_samples)
    q, v, vdot = np.zeros((3, num_samples, n))
    for k in range(1, 6):
        w = 2 * np.pi * 0.1 * k
        amplitude, phase = rng.uniform(0.2, 0.6, n) / k, rng.uniform(0, 2 * np.pi, n)
        angle = w * t[:, None] + phase
        q += amplitude * np.sin(angle)
        v += amplitude * w * np.cos(angle)
        vdot -= amplitude * w**2 * np.sin(angle)
    return t, q, v, vdot


def true_parameters(robot, seed=3):
    """All 14 n parameters: inertias that differ from the file's, rotor inertia, friction."""
    rng = np.random.default_rng(seed)
    n = robot.num_joints
    inertial = robot.chain.inertial_parameters * rng.uniform(0.7, 1.3, (n, 10))
    drive = rng.uniform([0.5, 1.0, 2.0, -0.5], [2.0, 8.0, 9.0, 0.5], (n, 4))
    return np.concatenate([inertial.ravel(), drive.ravel()])


def torque(robot, x, q, v, vdot):
    """Pinocchio's inverse dynamics plus friction written out: no code of ours but the URDF text."""
    n = robot.num_joints
    model = pin.buildModelFromXML(robot.urdf_text)
    for i in range(n):
        # FromDynamicParameters would shift to the centre of mass and back: rounding only.
        model.inertias[i + 1] = pin.Inertia.FromDynamicParameters(x[10 * i : 10 * i + 10])
    drive = x[10 * n :].reshape(n, 4)
    model.armature = drive[:, 0].copy()
    model.gravity.linear = np.array(robot.gravity)
    data = model.createData()
    rigid = np.array([pin.rnea(model, data, *row) for row in zip(q, v, vdot, strict=True)])
    return rigid + drive[:, 1] * np.sign(v) + drive[:, 2] * v + drive[:, 3]


def unfiltered(x):
    return x


@pytest.fixture(scope="module")
def problem(sts):
    x = true_parameters(sts)
    _, q, v, vdot = motion(sts.num_joints)
    tau = torque(sts, x, q, v, vdot)
    rows = np.arange(0, len(q), 3)
    factors = factorise(sts.chain, JointMotion(q, v, vdot), tau, unfiltered, rows)
    base = find_base_parameters(factors.regressor, parameter_names(sts.joint_names))
    return x, tau, rows, factors, base


def test_factors_are_the_normal_equations_of_each_joint(sts, problem):
    x, tau, rows, factors, _ = problem
    assert factors.num_rows == len(rows)
    for j, R in enumerate(factors.R):
        # Torque is the last column and W x explains it exactly: R [x; -1] = 0.
        scale = np.linalg.norm(tau[rows, j])
        np.testing.assert_allclose(R @ np.append(x, -1.0), 0.0, atol=1e-9 * scale)
        assert np.linalg.norm(R[:, -1]) == pytest.approx(scale, rel=1e-12)


def test_known_base_parameters_come_back(problem):
    x, _, _, factors, base = problem
    estimate = solve([factors], base, 3)
    # 1e-8: rounding times the condition number (below 1000).
    assert base.condition_number < 1000.0
    np.testing.assert_allclose(estimate.values, base.combination @ x, atol=1e-8 * np.abs(x).max())
    assert estimate.residual_sd.max() < 1e-8


def test_two_halves_are_one_log(sts, problem):
    x, _, _, _, base = problem
    _, q, v, vdot = motion(sts.num_joints)
    noise = np.random.default_rng(5).normal(size=q.shape)
    tau = torque(sts, x, q, v, vdot) + noise
    rows = np.arange(len(q))
    parts = [
        factorise(sts.chain, JointMotion(q, v, vdot), tau, unfiltered, half)
        for half in np.split(rows, 2)
    ]
    whole = factorise(sts.chain, JointMotion(q, v, vdot), tau, unfiltered, rows)
    of_whole, of_parts = solve([whole], base, 3), solve(parts, base, 3)
    np.testing.assert_allclose(of_parts.values, of_whole.values, atol=1e-9)
    np.testing.assert_allclose(
        of_parts.standard_deviations, of_whole.standard_deviations, rtol=1e-7
    )


def test_standard_deviations_and_weights_are_those_of_the_noise(sts, problem):
    """White noise, of another size on each joint: its sd, and errors in units of their sd."""
    x, _, _, _, base = problem
    _, q, v, vdot = motion(sts.num_joints)
    clean = torque(sts, x, q, v, vdot)
    sd = np.array([3.0, 0.1, 1.0, 0.2, 0.05, 0.5])
    rng = np.random.default_rng(6)
    rows = np.arange(len(q))
    errors = []
    for _ in range(4):
        tau = clean + sd * rng.normal(size=clean.shape)
        estimate = solve(
            [factorise(sts.chain, JointMotion(q, v, vdot), tau, unfiltered, rows)], base, 4
        )
        # 1500 samples: the sd of a sd is 1.8 %; four of those.
        np.testing.assert_allclose(estimate.residual_sd, sd, rtol=0.08)
        errors.append((estimate.values - base.combination @ x) / estimate.standard_deviations)
    # About 230 unit Gaussians, nearly independent: their RMS is 1 within 0.05.
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(1.0, abs=0.15)
    # Twice as many rows as independent samples: twice the variance.
    slower = solve(
        [factorise(sts.chain, JointMotion(q, v, vdot), tau, unfiltered, rows)], base, 4, 2.0
    )
    np.testing.assert_allclose(
        slower.standard_deviations, np.sqrt(2.0) * estimate.standard_deviations, rtol=1e-9
    )


def test_the_realisation_predicts_a_motion_that_was_never_seen(sts, problem):
    x, _, _, factors, base = problem
    realised = realisation(sts, base, solve([factors], base, 3).values)
    inertial, rotor, terms = split_terms(realised, [3] * sts.num_joints)
    friction = CoulombViscous(*np.transpose(terms))
    _, q, v, vdot = motion(sts.num_joints, num_samples=200, seed=9)
    chain = sts.chain.with_inertial_parameters(inertial, rotor)
    expected = torque(sts, x, q, v, vdot)
    np.testing.assert_allclose(
        chain.inverse_dynamics(q, v, vdot) + friction.torque(v),
        expected,
        atol=1e-7 * np.abs(expected).max(),
    )


def test_the_realisation_of_the_files_own_values_is_the_file(sts, problem):
    *_, base = problem
    n = sts.num_joints
    drive = np.zeros((n, 4))
    drive[:, 0] = sts.chain.reflected_inertia
    x = np.concatenate([sts.chain.inertial_parameters.ravel(), drive.ravel()])
    np.testing.assert_allclose(realisation(sts, base, base.combination @ x), x, atol=1e-12)


def test_names_and_parts_go_together(sts):
    names = parameter_names(sts.joint_names)
    n = sts.num_joints
    assert len(names) == len(set(names)) == 14 * n
    x = np.arange(14.0 * n)
    inertial, rotor, terms = split_terms(x, [3] * n)
    friction = CoulombViscous(*np.transpose(terms))
    assert names[int(inertial[2, 9])] == "Izz[joint_3]"
    assert names[int(rotor[0])] == "rotor[joint_1]"
    assert names[int(friction.coulomb[1])] == "coulomb[joint_2]"
    assert names[int(friction.viscous[4])] == "viscous[joint_5]"
    assert names[int(friction.offset[5])] == "offset[joint_6]"


def test_each_parameter_has_its_column():
    # Joint 1 has two friction terms, joint 2 none, joint 3 one.
    columns = parameter_columns([2, 0, 1])
    assert columns.inertial.tolist() == np.arange(30).reshape(3, 10).tolist()
    assert columns.rotor.tolist() == [30, 33, 34]
    assert [terms.tolist() for terms in columns.friction] == [[31, 32], [], [35]]
    assert columns.torque == 36
    assert len(parameter_names(["a", "b", "c"], [["x", "y"], [], ["z"]])) == columns.torque
