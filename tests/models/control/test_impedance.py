import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wrenchsight.models.control.impedance import (
    ForceControlInputs,
    ForceGains,
    SpringDamper,
    impedance_action,
    impedance_law,
    impedance_torque,
    impedance_wrench,
    pose_error,
)
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.rigid_body.desired_pose import DesiredPose
from wrenchsight.models.rigid_body.rigid_body_terms import RigidBodyTerms

RANDOM = np.random.default_rng(4)
COUPLED = RANDOM.normal(size=(6, 6))
STIFFNESS = COUPLED @ COUPLED.T + np.diag([5.0, 9, 20, 100, 300, 800])  # full, anisotropic
NO_DIRECTION = np.zeros(3)
NOTHING = np.zeros((6, 6))


def law(spring_damper, n=6, friction=None, **options):
    table = np.zeros((n, 7)) if friction is None else friction
    effort_limit = np.full(n, 1e6)
    return impedance_law(
        effort_limit=effort_limit, friction=table, spring_damper=spring_damper, **options
    )


def terms(n=6, **values):
    result = RigidBodyTerms.zeros(n)
    for name, value in values.items():
        getattr(result, name)[:] = value
    return result.record


def wrench(in_E, K, R_WE, p_WE, R_WD, p_WD, V_WE=0.0, V_WD=None, B=NOTHING, d=NO_DIRECTION):
    out = np.empty(6)
    impedance_wrench(
        law(SpringDamper(K, B, in_E)),
        terms(R_WE=R_WE, p_WE=p_WE, V_WE=V_WE),
        DesiredPose(
            np.ascontiguousarray(R_WD),
            np.asarray(p_WD, float),
            np.zeros(6) if V_WD is None else np.asarray(V_WD, float),
        ),
        d,
        out,
    )
    return out


@pytest.mark.parametrize("in_E", [False, True])
@pytest.mark.parametrize("angle", [0.0, 1e-5, 0.3, 2.0, 3.1])
def test_spring_is_the_gradient_of_its_energy(in_E, angle):
    axis = np.array([0.6, -0.48, 0.64])
    R_WD = Rotation.from_rotvec([0.4, 0.2, -0.9]).as_matrix()
    R_WE = Rotation.from_rotvec(axis * angle).as_matrix() @ R_WD
    p_WD, p_WE = np.array([0.3, 0.1, 0.5]), np.array([0.42, 0.05, 0.35])

    def energy(twist):
        R = Rotation.from_rotvec(twist[:3]).as_matrix() @ R_WE
        e = np.empty(6)
        pose_error(in_E, R, p_WE + twist[3:], R_WD, p_WD, e)
        return 0.5 * e @ STIFFNESS @ e

    h = 1e-5
    gradient = [(energy(h * k) - energy(-h * k)) / (2 * h) for k in np.eye(6)]
    force = wrench(in_E, STIFFNESS, R_WE, p_WE, R_WD, p_WD)
    # Central differences: h^2 times third derivatives of an energy of some hundreds of joules.
    np.testing.assert_allclose(force, -np.array(gradient), atol=2e-5)


def test_axes_of_E_and_of_W_differ_by_the_rotation():
    R_WE = Rotation.from_rotvec([0.0, 0, np.pi / 2]).as_matrix()
    K = np.diag([0.0, 0, 0, 100, 200, 300])
    p_WE, p_WD = np.array([0.01, 0.02, 0.03]), np.zeros(3)
    in_W = wrench(False, K, R_WE, p_WE, R_WE, p_WD)
    np.testing.assert_allclose(in_W, [0, 0, 0, -1, -4, -9], atol=1e-12)
    # x of W is -y of E, y of W is x of E
    in_E = wrench(True, K, R_WE, p_WE, R_WE, p_WD)
    np.testing.assert_allclose(in_E[3:], [-2, -2, -9], atol=1e-12)


@pytest.mark.parametrize("in_E", [False, True])
def test_damper_opposes_relative_velocity_only(in_E):
    R = Rotation.from_rotvec([0.3, -1.2, 0.4]).as_matrix()
    V = RANDOM.normal(size=6)
    B = np.diag([1.0, 2, 3, 40, 50, 60])
    none = wrench(in_E, np.zeros((6, 6)), R, [0, 0, 0], R, [0, 0, 0], V, V, B)
    np.testing.assert_allclose(none, 0, atol=1e-13)
    force = wrench(in_E, np.zeros((6, 6)), R, [0, 0, 0], R, [0, 0, 0], V, None, B)
    turn = np.kron(np.eye(2), R) if in_E else np.eye(6)
    np.testing.assert_allclose(force, -turn @ B @ turn.T @ V, atol=1e-12)
    assert force @ V < 0


def test_spring_is_blind_along_the_free_direction():
    d = np.array([0.0, 0.6, 0.8])
    R = np.eye(3)
    near = wrench(False, STIFFNESS, R, [0.1, 0, 0], R, [0, 0, 0], d=d)
    far = wrench(False, STIFFNESS, R, np.array([0.1, 0, 0]) + 0.3 * d, R, [0, 0, 0], d=d)
    np.testing.assert_allclose(near, far, atol=1e-10)
    assert abs(near[3:] @ d) < 1e-10


def test_null_space_damping_does_not_reach_the_tool():
    n = 7
    half = RANDOM.normal(size=(n, n))
    M, J = half @ half.T + np.eye(n), RANDOM.normal(size=(6, n))
    v = RANDOM.normal(size=n)
    tau = np.empty(n)
    damped = law(SpringDamper(null_space_damping=4.0), n)
    impedance_torque(damped, terms(n, M=M, J=J, v=v), np.zeros(3 * n), np.zeros(6), tau)
    # no acceleration of E, and it takes energy
    np.testing.assert_allclose(J @ np.linalg.solve(M, tau), 0, atol=1e-6)
    assert tau @ v < -1e-3
    Jbar = np.linalg.solve(M, J.T) @ np.linalg.inv(J @ np.linalg.solve(M, J.T))
    np.testing.assert_allclose(tau, (np.eye(n) - J.T @ Jbar.T) @ (-4.0 * v), atol=1e-6)


@pytest.mark.parametrize("valid", [False, True])
@pytest.mark.parametrize("is_active", [False, True])
@pytest.mark.parametrize("in_E", [False, True])
def test_an_action_is_torque_error_and_integral(is_active, in_E, valid):
    rng, n, T = np.random.default_rng(3), 6, 1e-3
    A, B, M = (x @ x.T for x in rng.normal(size=(3, 6, 6)))
    Cv, G, v, wrench = rng.normal(size=(4, n))
    J, reference = rng.normal(size=(6, n)), rng.normal(size=3 * n)
    R_WE, R_WD = Rotation.random(2, random_state=4).as_matrix()
    R_WE, R_WD = np.ascontiguousarray(R_WE), np.ascontiguousarray(R_WD)
    p_WE, p_WD, direction = rng.normal(size=(3, 3))
    V_WE, V_WD = rng.normal(size=(2, 6))
    direction /= np.linalg.norm(direction)
    integral, setpoint = 0.2, 40.0
    coulomb_viscous = CoulombViscous(np.ones(n), np.ones(n), np.zeros(n))
    controller = law(
        SpringDamper(stiffness=A, damping=B, in_E=in_E),
        friction=SemiParametricFriction(coulomb_viscous).table,
        force=ForceGains(0.6, 60.0, 1e3, direction, in_E=True),
        time_step=T,
    )
    arm = terms(M=M, Cv=Cv, G=G, J=J, R_WE=R_WE, p_WE=p_WE, V_WE=V_WE, v=v)
    pose = np.concatenate([R_WD.ravel(), p_WD, V_WD])
    torque, offset = np.empty(n), np.empty(6)
    force = ForceControlInputs(is_active, valid, setpoint, wrench, integral)
    is_usable, end = impedance_action(controller, arm, pose, reference, force, torque, offset)
    assert is_usable
    d_W = R_WE @ direction
    free, blind = np.empty(6), np.empty(6)
    for out, along in ((free, np.zeros(3)), (blind, d_W)):
        impedance_wrench(controller, arm, DesiredPose(R_WD, p_WD, V_WD), along, out)
    error = setpoint - d_W @ wrench[3:] if valid else 0.0
    if is_active:
        blind[3:] -= (setpoint + 0.6 * error + 60.0 * integral) * d_W
        total, after = blind, integral + T * error
    else:
        total, after = free, (-d_W @ (free - blind)[3:] - setpoint) / 60.0
    v_d, vdot_d = reference[n : 2 * n], reference[2 * n :]
    feed = (np.sign(v_d) + v_d) * np.abs(v_d) / np.hypot(v_d, 0.005)
    tau = J.T @ total + Cv + G + M @ vdot_d + feed
    e = np.empty(6)
    pose_error(in_E, R_WE, p_WE, R_WD, p_WD, e)
    action = np.concatenate([torque, offset, [end]])
    np.testing.assert_allclose(action, np.concatenate([tau, e, [after]]), atol=1e-11)
