"""The whole chain: against pinocchio and numpy, tick against log, holes, signs."""

import copy
from dataclasses import replace
from functools import cache

import numpy as np
import pinocchio as pin
import pytest
from sample_models import sample_torque_error

from wrenchsight.models.estimation.estimator import (
    Correction,
    WrenchEstimator,
    WrenchEstimatorConfig,
)
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.estimation.wrench_methods import METHODS
from wrenchsight.models.estimation.wrench_prior import live_prior
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.coupled_friction import CoupledFriction
from wrenchsight.models.friction.friction_network import FrictionNetworks
from wrenchsight.models.friction.presliding_friction import PreslidingFriction
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.observers.momentum_observer import MomentumObserver, MomentumObserverConfig
from wrenchsight.models.robot.robot import Robot

T = 0.002
CONFIG = WrenchEstimatorConfig(MomentumObserverConfig([20.0], T))


@cache
def arm() -> Robot:
    return Robot.load("sts_sre4_600")


@cache
def model() -> IdentifiedModel:
    """The arm's own inertias; every kind of friction; a full residual covariance."""
    rng = np.random.default_rng(1)
    friction = SemiParametricFriction(
        CoulombViscous(rng.uniform(1, 10, 6), rng.uniform(1, 10, 6), rng.normal(size=6)),
        FrictionNetworks(*rng.normal(size=(3, 6, 10)), rng.normal(size=6), np.full(6, 0.1)),
        np.full(6, 0.1),
    )
    A = np.diag([1.5, 1.5, 1.0, 0.3, 0.3, 0.2]) @ (np.eye(6) + 0.2 * rng.normal(size=(6, 6)))
    return replace(IdentifiedModel.nominal(arm()), friction=friction, residual_covariance=A @ A.T)


def estimator(method: str = "bayesian", K_0: float = 20.0) -> WrenchEstimator:
    config = WrenchEstimatorConfig(
        MomentumObserverConfig([K_0], T), WrenchReconstructionConfig(method)
    )
    return WrenchEstimator(arm(), model(), config)


def log(N: int = 600) -> tuple[Array, Array, Array]:
    """All joints in smooth motion through their near-zero velocities, currents of a real size."""
    t = T * np.arange(N)[:, None]
    w = np.array([1.1, 0.9, 1.7, 2.3, 3.1, 2.0])
    q = np.array([0.0, 0.2, -0.6, 0.3, 1.0, 0.0]) + 0.4 * np.sin(w * t + np.arange(6))
    v = 0.4 * w * np.cos(w * t + np.arange(6))
    rng = np.random.default_rng(2)
    tau = arm().chain.gravity_torque(q) + model().friction.torque(v) + rng.normal(size=(N, 6))
    return q, v, arm().motor_current(tau)


def test_the_chain_against_pinocchio_and_numpy() -> None:
    """The equations of the module docstrings, from another rigid-body library."""
    q, v, current = log(300)
    robot, Sigma = arm(), model().residual_covariance
    rigid = pin.buildModelFromXML(robot.urdf_text)
    rigid.armature = robot.reflected_inertia
    rigid.gravity.linear = robot.gravity
    data = rigid.createData()
    tool = rigid.getFrameId("E")
    tau_J = current * robot.torque_per_ampere * robot.current_sign
    tau_f = model().friction.torque(v)
    force_sd, moment_sd = live_prior(robot.payload)
    P = np.diag([moment_sd**2] * 3 + [force_sd**2] * 3)
    a = np.exp(-20.0 * T)
    expected, tau_ext = [], np.zeros(6)
    previous: tuple[Array, Array] | None = None
    for k in range(len(q)):
        C = pin.computeCoriolisMatrix(rigid, data, q[k], v[k])
        momentum = pin.crba(rigid, data, q[k]) @ v[k]
        G = pin.computeGeneralizedGravity(rigid, data, q[k])
        part = C.T @ v[k] - G - tau_f[k]
        if previous is not None:
            u = tau_J[k - 1] + 0.5 * (previous[1] + part)
            tau_ext = a * tau_ext + (1.0 - a) / T * (momentum - previous[0] - T * u)
        previous = momentum, part
        J = pin.computeFrameJacobian(rigid, data, q[k], tool, pin.LOCAL_WORLD_ALIGNED)[
            [3, 4, 5, 0, 1, 2]
        ]
        gain = P @ J @ np.linalg.inv(J.T @ P @ J + Sigma)
        expected.append((tau_ext, gain @ tau_ext, P - gain @ J.T @ P, np.linalg.cond(J)))
    estimate = estimator().run(estimator().initial_state(), q, v, current)
    # 1e-13 relative of the terms (100 N m), times K' = 20/s, over the period of 2 ms.
    np.testing.assert_allclose(estimate.tau_ext, [e[0] for e in expected], atol=1e-8)
    np.testing.assert_allclose(estimate.wrench, [e[1] for e in expected], atol=1e-7)
    np.testing.assert_allclose(estimate.covariance, [e[2] for e in expected], rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(estimate.condition_number, [e[3] for e in expected], rtol=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_a_tick_is_a_row_of_the_log_and_chunks_are_one_pass(method: str) -> None:
    q, v, current = log()
    current[200, 3] = np.nan
    q[400] = np.nan
    tool = estimator(method)
    whole = tool.run(tool.initial_state(), q, v, current)
    state = tool.initial_state()
    parts = [
        tool.run(state, q[a:b], v[a:b], current[a:b]) for a, b in ((0, 1), (1, 201), (201, 600))
    ]
    for name in whole._fields:
        chunks = np.concatenate([getattr(part, name) for part in parts])
        np.testing.assert_array_equal(chunks, getattr(whole, name))
    state, same = tool.initial_state(), tool.initial_state()
    rows = []
    for k in range(600):
        tick = tool.step(state, q[k], v[k], current[k])
        for name in tick._fields:
            np.testing.assert_array_equal(getattr(tick, name), getattr(whole, name)[k])
        rows.append(tool.run(same, q[k : k + 1], v[k : k + 1], current[k : k + 1]))
    for tick, column in zip(type(whole).joined(rows), whole, strict=True):
        np.testing.assert_array_equal(tick, column)


def test_an_estimate_stays_as_it_is_when_the_next_samples_are_taken() -> None:
    """The estimator keeps memory between ticks; what it hands out is none of it."""
    (q, v, current), tool = log(300), estimator()
    state = tool.initial_state()
    ticks = [tool.step(state, q[k], v[k], current[k]) for k in range(200)]
    first = copy.deepcopy(ticks[150])
    assert np.abs(first.wrench).max() > 0.0
    tool.step(state, q[-1], v[-1], current[-1])
    for before, after in zip(first, ticks[150], strict=True):
        np.testing.assert_array_equal(before, after)


def test_a_long_log_crosses_the_memory_bound_unchanged() -> None:
    q, v, current = (np.tile(x, (30, 1)) for x in log())  # 18,000 rows
    tool = estimator()
    whole = tool.run(tool.initial_state(), q, v, current)
    state = tool.initial_state()
    first_part = tool.run(state, q[:16000], v[:16000], current[:16000])
    second_part = tool.run(state, q[16000:], v[16000:], current[16000:])
    np.testing.assert_array_equal(
        np.concatenate([first_part.wrench, second_part.wrench]), whole.wrench
    )


@pytest.mark.parametrize("method", ["inverse", "bayesian"])
def test_a_push_reads_as_what_the_environment_does(method: str) -> None:
    """Held still under 30 N along +z of W: the motors carry less, the reading is +30 N."""
    robot = arm()
    F = np.array([0.5, -0.3, 0.2, 0.0, 10.0, 30.0])
    q = np.tile([0.0, 0.2, -0.6, 0.3, 1.0, 0.0], (1000, 1))
    v = np.zeros_like(q)
    tau = robot.chain.gravity_torque(q) + model().friction.torque(v)
    tau -= robot.chain.jacobian(q[0]).T @ F
    current = robot.motor_current(tau)
    tool = estimator(method)
    if method == "bayesian":
        tool = tool.with_prior(1e5, 1e5)
    estimate = tool.run(tool.initial_state(), q, v, current)
    # Settled to exp(-40); the loose prior shrinks by (sd / 1e5)^2.
    np.testing.assert_allclose(estimate.wrench[-1], F, atol=1e-6)
    # K_0 = 40 / s: until 3 / K_0 the observer is on its way from zero.
    np.testing.assert_array_equal(estimate.valid, np.arange(1000) >= 75)


def test_a_hole_is_flagged_finite_and_forgotten() -> None:
    q, v, current = log()
    tool = estimator()
    clean = tool.run(tool.initial_state(), q, v, current)
    v[300:303, 1] = np.nan
    holed = tool.run(tool.initial_state(), q, v, current)
    assert np.isfinite(holed.wrench).all()
    assert np.isfinite(holed.covariance).all()
    assert np.flatnonzero(holed.valid != clean.valid).tolist() == [300, 301, 302, 303]
    # 300 samples of 2 ms at K_0 = 20: exp(-12) of what was missed.
    np.testing.assert_allclose(holed.wrench[-1], clean.wrench[-1], atol=1e-3)


def test_prior_of_the_configuration_and_of_the_rule() -> None:
    force_sd, moment_sd = live_prior(arm().payload)
    result = estimator().config.reconstruction
    assert (result.prior_force_sd, result.prior_moment_sd) == (force_sd, moment_sd)
    q, v, current = log(50)
    tight = estimator().with_prior(1.0, 0.01)
    estimate = tight.run(tight.initial_state(), q, v, current)
    assert np.all(estimate.standard_deviation[:, 3:] <= 1.0)
    assert np.all(estimate.standard_deviation[:, :3] <= 0.01)


def test_gain_per_joint() -> None:
    q, v, current = log(50)
    K_0 = [5.0, 10.0, 20.0, 40.0, 80.0, 160.0]
    config = WrenchEstimatorConfig(MomentumObserverConfig(K_0, T))
    mixed = WrenchEstimator(arm(), model(), config)
    together = mixed.run(mixed.initial_state(), q, v, current).tau_ext
    for i, gain in enumerate(K_0):
        alone = estimator(K_0=gain)
        np.testing.assert_array_equal(
            alone.run(alone.initial_state(), q, v, current).tau_ext[:, i], together[:, i]
        )


def test_any_layout_of_the_samples_reads_the_same() -> None:
    q, v, current = log(50)
    tool = estimator()
    whole = tool.run(tool.initial_state(), q, v, current)
    columns = [np.asfortranarray(x) for x in (q, v, current)]
    for x in columns:
        x.flags.writeable = False
    repeated = tool.run(tool.initial_state(), *columns)
    np.testing.assert_array_equal(repeated.wrench, whole.wrench)
    state = tool.initial_state()
    for k in range(50):
        tick = tool.step(state, columns[0][k], columns[1][k].tolist(), columns[2][k])
        np.testing.assert_array_equal(tick.wrench, whole.wrench[k])


def test_model_of_another_robot_and_wrong_shapes_are_refused() -> None:
    with pytest.raises(InputError, match="somebody"):
        WrenchEstimator(arm(), replace(model(), robot="somebody"))
    q, v, current = log(10)
    with pytest.raises(ValueError, match=r"must be \(N, 6\)"):
        estimator().run(estimator().initial_state(), q, v[:5], current)
    with pytest.raises(ValueError, match=r"must be \(N, 6\)"):
        estimator().step(estimator().initial_state(), q[0, :5], v[0], current[0])
    with pytest.raises(ValueError, match="state must be of this estimator's initial_state"):
        estimator().step(remembering().initial_state(), q[0], v[0], current[0])
    with pytest.raises(ValueError, match="K_0"):
        WrenchEstimator(
            arm(), model(), WrenchEstimatorConfig(MomentumObserverConfig([1.0, 2.0], T))
        )


@cache
def remembering() -> WrenchEstimator:
    """The same arm with a law that has memory and load dependence, and a network on top."""
    rng = np.random.default_rng(3)
    nets = FrictionNetworks(*rng.normal(size=(3, 6, 10)), rng.normal(size=6), np.full(6, 0.1))
    near_zero = SemiParametricFriction(
        CoulombViscous(np.zeros(6), rng.uniform(1, 10, 6), rng.normal(size=6)),
        nets,
        np.full(6, 0.1),
    )
    friction = PreslidingFriction(
        near_zero,
        coulomb=rng.uniform(2, 9, 6),
        stribeck=rng.uniform(-1, 1, 6),
        stribeck_velocity=np.full(6, 0.05),
        load=rng.uniform(0.0, 0.1, 6),
        cubic=rng.normal(size=6),
        weight=np.tile([0.8, 0.2], (6, 1)),
        displacement=np.tile([2e-4, 2e-3], (6, 1)),
    )
    config = WrenchEstimatorConfig(MomentumObserverConfig([20.0], T))
    return WrenchEstimator(arm(), replace(model(), friction=friction), config)


def test_friction_with_memory_tick_by_tick_is_the_log_in_any_split() -> None:
    tool, (q, v, current) = remembering(), log(300)
    whole = tool.run(tool.initial_state(), q, v, current)
    state = tool.initial_state()
    assert state.friction.shape == (4, 6)
    parts = [
        tool.run(state, q[rows], v[rows], current[rows]) for rows in (slice(0, 7), slice(7, 90))
    ]
    for k in range(90, 300):
        tick = tool.step(state, q[k], v[k], current[k])
        np.testing.assert_array_equal(tick.tau_ext, whole.tau_ext[k])
    np.testing.assert_array_equal(np.vstack([p.tau_ext for p in parts]), whole.tau_ext[:90])


@pytest.mark.parametrize("kind", ["learnt error", "friction with memory"])
def test_motion_and_then_current_is_the_whole_sample(kind: str) -> None:
    """To the last bit, the state after each sample as well; with impossible samples."""
    known = replace(model(), torque_error=sample_torque_error())
    tool = (
        remembering() if kind == "friction with memory" else WrenchEstimator(arm(), known, CONFIG)
    )
    q, v, current = log(120)
    current[40, 1], current[60:70, 4], v[80, 2] = 1e4, np.nan, 1e3
    state, whole_state = tool.initial_state(), tool.initial_state()
    for k in range(len(q)):
        sample = (q[k : k + 1], v[k : k + 1], current[k : k + 1])
        whole = tool.take(whole_state, *sample)
        tool.read(whole_state.reading, whole)
        state_of_motion = copy.deepcopy(state)
        taken = tool.take_motion(state_of_motion, *sample[:2])
        tool.read(state_of_motion.reading, taken)
        tau_J = tool.take_current(state, state_of_motion, taken, *sample)
        np.testing.assert_array_equal(taken.tau_ext, whole.tau_ext)
        np.testing.assert_array_equal(taken.fault, whole.fault)
        np.testing.assert_array_equal(taken.error.flat, whole.error.flat)
        np.testing.assert_array_equal(tau_J, whole.samples.tau_J)
        for now, expected in zip(
            (state.check, state.error, state.friction, state.observer, *state.reading),
            (
                whole_state.check,
                whole_state.error,
                whole_state.friction,
                whole_state.observer,
                *whole_state.reading,
            ),
            strict=True,
        ):
            np.testing.assert_array_equal(now, expected)


def test_the_load_is_the_torque_transmitted_at_the_sample_before() -> None:
    """The observer fed with the law written out, L_k = tau_J,k-1 - tau_f,k-1."""
    tool, (q, v, current) = remembering(), log(200)
    law = tool.model.friction
    tau_J = current * arm().torque_per_ampere * arm().current_sign
    load = np.zeros_like(q)
    law = law.sampled(tool.observer.time_step)
    for k in range(1, len(q)):
        load[k] = tau_J[k - 1] - law.torque_along(q[:k], v[:k], load[:k])[-1]
    tau_f = law.torque_along(q, v, load)
    momentum, CTv, G = tool.chain.momentum_terms(q, v)
    observer = tool.observer
    expected, _ = observer.run(observer.initial_state(), momentum, CTv, G, tau_J, tau_f)
    result = tool.run(tool.initial_state(), q, v, current)
    # The same numbers in another order of additions, 1e-13 of 100 N m, times K' = 20/s over 2 ms.
    np.testing.assert_allclose(result.tau_ext, expected, atol=1e-8)


def test_friction_known_from_elsewhere_is_a_model_without_friction() -> None:
    """The given friction is subtracted from the motor torque, sample by sample, not the law's."""
    q, v, current = log(400)
    tau_f = 3.0 * np.sign(v) + 2.0 * v
    law = SemiParametricFriction(CoulombViscous(np.full(6, 9.0), np.full(6, 1.0), np.zeros(6)))
    knowing = WrenchEstimator(arm(), replace(model(), friction=law), CONFIG)
    result = knowing.run(knowing.initial_state(), q, v, current, tau_f=tau_f)
    without = SemiParametricFriction(CoulombViscous.zero(6))
    plain = WrenchEstimator(arm(), replace(model(), friction=without), CONFIG)
    less = current - tau_f / (arm().torque_per_ampere * arm().current_sign)
    expected = plain.run(plain.initial_state(), q, v, less)
    # As a torque and as a current: rounding of the motor torque, 1e-14 of some 100 N m, times K'.
    np.testing.assert_allclose(result.wrench, expected.wrench, rtol=1e-9, atol=1e-10)


def test_a_learnt_correction_is_added_and_friction_is_taken_at_planned_speeds() -> None:
    q, v, current = log(400)
    rng = np.random.default_rng(3)
    planned, correction = v + 0.1 * rng.normal(size=v.shape), rng.normal(size=v.shape)
    counts = (np.arange(400) % 3 > 0).astype(float)
    law = SemiParametricFriction(CoulombViscous(np.full(6, 9.0), np.full(6, 1.0), np.zeros(6)))
    tool = WrenchEstimator(arm(), replace(model(), friction=law), CONFIG)
    taught = Correction(correction, planned, counts)
    result = tool.run(tool.initial_state(), q, v, current, correction=taught)
    # The oracle: the observer alone, fed with the friction of the planned speeds.
    momentum, CTv, G = tool.chain.momentum_terms(q, v)
    tau_J = current * arm().torque_per_ampere * arm().current_sign
    observer = MomentumObserver(CONFIG.observer, 6)
    tau_ext, fresh = observer.run(
        observer.initial_state(), momentum, CTv, G, tau_J, law.torque(planned)
    )
    np.testing.assert_allclose(result.tau_ext, tau_ext + correction, rtol=0.0, atol=1e-10)
    assert not result.valid[(counts == 0.0) | ~fresh].any()
    assert result.valid.any()
    state = tool.initial_state()
    for k in range(50):
        tick = tool.step(
            state,
            q[k],
            v[k],
            current[k],
            correction=Correction(correction[k], planned[k], counts[k]),
        )
        np.testing.assert_array_equal(tick.wrench, result.wrench[k])
        assert tick.valid == result.valid[k]


def test_the_sd_of_a_correction_adds_to_the_torque_error_s() -> None:
    """Eq. 22, torque errors that are independent: Sigma_F = J^-T (Sigma_tau + D^2) J^-1."""
    q, v, current = log(40)
    tool = WrenchEstimator(
        arm(),
        replace(model(), residual_covariance=np.diag(np.arange(1.0, 7.0))),
        replace(CONFIG, reconstruction=WrenchReconstructionConfig("inverse")),
    )
    zero, sd = np.zeros_like(v), np.linspace(0.1, 2.0, v.size).reshape(v.shape)
    plain, with_sd = (
        tool.run(
            tool.initial_state(),
            q,
            v,
            current,
            correction=Correction(zero, v, np.ones(40), correction_sd),
        )
        for correction_sd in (0.0, sd)
    )
    np.testing.assert_array_equal(with_sd.tau_ext, plain.tau_ext)
    for k in range(0, 40, 7):
        gain = np.linalg.inv(tool.chain.jacobian(q[k]).T)
        expected = plain.covariance[k] + gain @ np.diag(sd[k] ** 2) @ gain.T
        np.testing.assert_allclose(with_sd.covariance[k], expected, rtol=1e-6)
    state = tool.initial_state()
    tick = tool.step(
        state, q[0], v[0], current[0], correction=Correction(zero[0], v[0], 1.0, sd[0])
    )
    np.testing.assert_array_equal(tick.covariance, with_sd.covariance[0])


def test_friction_with_memory_follows_the_measured_motion_despite_a_correction() -> None:
    """The planned speeds play no part: the reading is the plain one plus the correction."""
    q, v, current = log(200)
    rng = np.random.default_rng(3)
    planned, correction = rng.normal(size=(2, *v.shape))
    counts = (np.arange(200) % 3 > 0).astype(float)
    tool = remembering()
    result = tool.run(
        tool.initial_state(), q, v, current, correction=Correction(correction, planned, counts)
    )
    plain = tool.run(tool.initial_state(), q, v, current)
    np.testing.assert_allclose(result.tau_ext, plain.tau_ext + correction, rtol=0.0, atol=1e-12)
    np.testing.assert_array_equal(result.transmitted, plain.transmitted)
    np.testing.assert_array_equal(result.valid, plain.valid & (counts == 1.0))
    state = tool.initial_state()
    for k in range(200):
        taught = Correction(correction[k], planned[k], counts[k])
        tick = tool.step(state, q[k], v[k], current[k], correction=taught)
        np.testing.assert_array_equal(tick.wrench, result.wrench[k])


def test_a_learnt_correction_must_fit_the_log() -> None:
    q, v, current = log(20)
    tool = estimator()
    state = tool.initial_state()
    with pytest.raises(ValueError, match="of an air pass must be"):
        tool.run(state, q, v, current, correction=Correction(v, v[:5], np.ones(20)))
    with pytest.raises(ValueError, match="tau_f must be"):
        tool.run(state, q, v, current, tau_f=v[:5])
    with pytest.raises(ValueError, match="pass correction or tau_f"):
        tool.run(state, q, v, current, tau_f=v, correction=Correction(v, v, np.ones(20)))


@pytest.mark.long
@pytest.mark.parametrize("remembers", [False, True])
def test_coupled_joints_tick_by_tick_and_as_a_log(coupled_wrist: Robot, remembers: bool) -> None:
    """Motors that hold a push up, through their friction: read back in any split."""
    law = replace(
        remembering().friction,
        velocity_law=replace(
            remembering().friction.velocity_law, networks=None, v_crit=np.zeros(6)
        ),
    )
    below = law if remembers else SemiParametricFriction(law.coulomb_viscous)
    friction = CoupledFriction(below, coupled_wrist.motor_rates)
    nominal = replace(IdentifiedModel.nominal(coupled_wrist), friction=friction)
    tool = WrenchEstimator(coupled_wrist, nominal, CONFIG)
    q, v, _ = log(300)
    chain = coupled_wrist.chain
    w = np.array([1.1, 0.9, 1.7, 2.3, 3.1, 2.0])
    vdot = -(w**2) * (q - np.array([0.0, 0.2, -0.6, 0.3, 1.0, 0.0]))
    J = chain.jacobian(q)
    F = np.array([1.0, -2.0, 3.0, 20.0, 30.0, -40.0])
    rigid = chain.inverse_dynamics(q, v, vdot)
    tau_ext = np.einsum("kij,i->kj", J, F)
    tau_f = friction.torque_along(q, v, rigid - tau_ext)
    current = coupled_wrist.motor_current(rigid + tau_f - tau_ext)
    whole = tool.run(tool.initial_state(), q, v, current)
    state = tool.initial_state()
    for k in range(300):
        tick = tool.step(state, q[k], v[k], current[k])
        np.testing.assert_array_equal(tick.tau_ext, whole.tau_ext[k])
    if not remembers:  # else the slip at the first sample is not the log's
        # The observer's pole is 20 /s: after .5 s what it read at first is below 1e-4 of it; the
        # trapezoidal rule and the lag behind a J that moves leave some 3 % of the push.
        rows = slice(250, None)
        np.testing.assert_allclose(
            whole.tau_ext[rows], tau_ext[rows], atol=0.05 * np.abs(tau_ext).max()
        )
