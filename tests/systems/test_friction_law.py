"""SemiParametricFrictionSystem and PreslidingFrictionSystem."""

import numpy as np
import pytest
from block_ticks import memory_after_tick
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, LogVectorOutput, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.friction_network import FrictionNetworks
from wrenchsight.models.friction.presliding_friction import PreslidingFriction
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.friction.slip_elements import add_slip_torque, update_slip
from wrenchsight.systems.presliding_friction import PreslidingFrictionSystem
from wrenchsight.systems.semi_parametric_friction import SemiParametricFrictionSystem

N, STEP = 2, 0.01
COULOMB, VISCOUS, OFFSET = np.array([5.0, 2.0]), np.array([3.0, 1.0]), np.array([0.2, -0.1])
V_CRIT = np.array([0.1, 0.2])


def plain_law():
    rng = np.random.default_rng(3)
    networks = FrictionNetworks(*rng.normal(size=(3, N, 10)), rng.normal(size=N), V_CRIT)
    return SemiParametricFriction(CoulombViscous(COULOMB, VISCOUS, OFFSET), networks, V_CRIT)


def remembering_law():
    return PreslidingFriction(
        SemiParametricFriction(CoulombViscous(np.zeros(N), VISCOUS, OFFSET)),
        coulomb=COULOMB,
        stribeck=np.array([1.0, 0.5]),
        stribeck_velocity=np.array([0.1, 0.05]),
        load=np.array([0.06, 0.1]),
        cubic=np.array([-0.4, 0.1]),
        weight=np.ones((N, 1)),
        displacement=np.array([[1e-3], [2e-3]]),
    )


def fixed(law, **inputs):
    """The block and its context with these inputs, the others zero."""
    if law.state_rows == 0:
        system = SemiParametricFrictionSystem(law)
    else:
        system = PreslidingFrictionSystem(law, STEP)
    context = system.CreateDefaultContext()
    for k in range(system.num_input_ports()):
        port = system.get_input_port(k)
        port.FixValue(context, np.asarray(inputs.get(port.get_name(), np.zeros(N)), float))
    return system, context


def torque(system, context):
    return system.GetOutputPort("tau_f").Eval(context)


def step(system, context):
    context.SetDiscreteState(0, memory_after_tick(system, context))


def test_ports():
    system = SemiParametricFrictionSystem(plain_law())
    assert system.num_input_ports() == 1
    assert system.GetInputPort("v").size() == system.GetOutputPort("tau_f").size() == N
    assert system.HasDirectFeedthrough(0, 0)
    assert system.CreateDefaultContext().num_total_states() == 0
    system = PreslidingFrictionSystem(remembering_law(), STEP)
    assert [system.get_input_port(i).get_name() for i in range(3)] == ["q", "v", "tau_J"]
    assert [system.HasDirectFeedthrough(i, 0) for i in range(3)] == [True, True, False]
    state = system.CreateDefaultContext().get_discrete_state()
    assert [state.get_vector(k).size() for k in range(3)] == [3 * N, 2, N]  # memory, ticks, tau_f


@pytest.mark.parametrize("v", [[0.3, -0.5], [0.05, -0.01], [0.0, 0.0]])
def test_without_memory_it_is_the_law(v):
    np.testing.assert_array_equal(torque(*fixed(plain_law(), v=v)), plain_law().torque(v))


def test_along_a_motion_it_is_the_kernel_tick_by_tick():
    t = np.arange(0.0, 1.0, STEP)
    q = np.stack([2e-3 * np.sin(6.0 * t), 3e-3 * np.cos(5.0 * t)])
    v = np.gradient(q, STEP, axis=1)
    builder, friction = DiagramBuilder(), remembering_law()
    system = builder.AddSystem(PreslidingFrictionSystem(friction, STEP))
    for name, samples in (("q", q), ("v", v)):
        source = builder.AddSystem(TrajectorySource(PiecewisePolynomial.ZeroOrderHold(t, samples)))
        builder.Connect(source.get_output_port(), system.GetInputPort(name))
    tau_J = np.array([8.0, -3.0])
    motor = builder.AddSystem(ConstantVectorSource(tau_J))
    builder.Connect(motor.get_output_port(), system.GetInputPort("tau_J"))
    log = LogVectorOutput(system.GetOutputPort("tau_f"), builder, STEP)
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(0.9)
    logged, state = log.FindLog(simulator.get_context()).data().T, friction.initial_state()
    for k in range(80):
        qk, vk = q[:, k].copy(), v[:, k].copy()
        tau_f = friction.velocity_law.torque(vk)
        add_slip_torque(friction.slip_table, state, qk, vk, tau_f)
        update_slip(friction.slip_table, state, qk, vk, tau_J - tau_f)
        np.testing.assert_allclose(logged[k], tau_f, rtol=0, atol=1e-12)


def test_parameters_change_through_the_context_and_the_hand_over_follows():
    system, context = fixed(plain_law(), v=[0.3, 0.3])
    torque(system, context)
    for index in (0, 1, 2):
        context.get_mutable_numeric_parameter(index).SetFromVector([7.0, 8.0])
    np.testing.assert_allclose(torque(system, context), [7 + 2.1 + 7, 8 + 2.4 + 8], rtol=1e-15)
    system.GetInputPort("v").FixValue(context, V_CRIT)
    np.testing.assert_allclose(torque(system, context), [14 + 7 * 0.1, 16 + 8 * 0.2], rtol=1e-12)
    context.get_mutable_numeric_parameter(0).SetFromVector([np.nan, 1.0])
    with pytest.raises(ValueError, match="coulomb"):
        torque(system, context)


def test_the_slip_table_changes_through_the_context():
    system, context = fixed(remembering_law())
    step(system, context)
    table = remembering_law().slip_table.copy()
    table[:, 0] = 50.0
    context.get_mutable_numeric_parameter(0).SetFromVector(table.ravel())
    system.GetInputPort("q").FixValue(context, [1.0, 1.0])
    expected = OFFSET[0] + 51.0 + 0.06 * abs(0.0 - OFFSET[0])
    assert torque(system, context)[0] == pytest.approx(expected, rel=1e-12)


def test_sign():
    """Friction opposes motion and stands on the left of the equation: positive for v > 0."""
    for side in (1.0, -1.0):
        assert (side * torque(*fixed(plain_law(), v=[side, side])) > 0.0).all()
        system, context = fixed(remembering_law())
        step(system, context)
        system.GetInputPort("q").FixValue(context, [side * 0.1] * N)
        system.GetInputPort("v").FixValue(context, [side * 0.5] * N)
        assert (side * (torque(system, context) - OFFSET) > 0.0).all()


def test_a_broken_sample_is_seen_on_its_own_joint_and_forgotten():
    assert np.isnan(torque(*fixed(plain_law(), v=[np.nan, 0.3]))).tolist() == [True, False]
    system, context = fixed(remembering_law(), q=[np.nan, 0.0])
    assert np.isnan(torque(system, context)).tolist() == [True, False]
    step(system, context)
    system.GetInputPort("q").FixValue(context, [0.0, 0.0])
    assert np.isfinite(torque(system, context)).all()


def test_a_law_with_memory_needs_a_period():
    with pytest.raises(ValueError, match="time_step"):
        PreslidingFrictionSystem(remembering_law(), 0.0)
