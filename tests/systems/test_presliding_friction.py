"""PreslidingFrictionSystem."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, LogVectorOutput, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from wrenchsight.models.friction.presliding_friction import (
    PreslidingFriction,
    add_slip_torque,
    update_slip,
)
from wrenchsight.models.friction.velocity_friction import CoulombViscous, SemiParametricFriction
from wrenchsight.systems.presliding_friction import PreslidingFrictionSystem

N, STEP = 2, 0.01
VISCOUS, OFFSET = np.array([3.0, 1.0]), np.array([0.2, -0.1])


def law():
    return PreslidingFriction(
        SemiParametricFriction(CoulombViscous(np.zeros(N), VISCOUS, OFFSET)),
        coulomb=np.array([5.0, 2.0]),
        stribeck=np.array([1.0, 0.5]),
        stribeck_velocity=np.array([0.1, 0.05]),
        load=np.array([0.06, 0.1]),
        cubic=np.array([-0.4, 0.1]),
        weight=np.ones((N, 1)),
        displacement=np.array([[1e-3], [2e-3]]),
    )


def fixed(q, v, tau_J=(0.0, 0.0)):
    system = PreslidingFrictionSystem(law(), STEP)
    context = system.CreateDefaultContext()
    for name, value in (("q", q), ("v", v), ("tau_J", tau_J)):
        system.GetInputPort(name).FixValue(context, np.asarray(value, float))
    return system, context


def torque(system, context):
    return system.GetOutputPort("tau_f").Eval(context)


def step(system, context):
    context.SetDiscreteState(system.EvalUniquePeriodicDiscreteUpdate(context))


def test_ports():
    system = PreslidingFrictionSystem(law(), STEP)
    assert [system.get_input_port(i).get_name() for i in range(3)] == ["q", "v", "tau_J"]
    assert system.HasDirectFeedthrough(0, 0)
    assert system.HasDirectFeedthrough(1, 0)
    assert not system.HasDirectFeedthrough(2, 0)
    assert system.CreateDefaultContext().num_total_states() == 3 * N


def test_relaxed_before_the_first_tick():
    v = np.array([0.2, -0.3])
    system, context = fixed([0.4, -1.0], v)
    expected = VISCOUS * v + OFFSET + np.array([-0.4, 0.1]) * v**3
    np.testing.assert_allclose(torque(system, context), expected, rtol=1e-14)


def test_a_displacement_stretches_the_element_and_the_load_of_the_tick_before_counts():
    system, context = fixed([0.0, 0.0], [0.0, 0.0], [21.0, 0.0])
    before = torque(system, context)
    step(system, context)  # load = tau_J - tau_f = 21 - 0.2
    system.GetInputPort("q").FixValue(context, [5e-4, 0.0])
    expected = OFFSET[0] + (5.0 + 1.0 + 0.06 * (21.0 - before[0])) * 0.5
    assert torque(system, context)[0] == pytest.approx(expected, rel=1e-13)


def test_along_a_motion_it_is_the_kernel_tick_by_tick():
    t = np.arange(0.0, 1.0, STEP)
    q = np.stack([2e-3 * np.sin(6.0 * t), 3e-3 * np.cos(5.0 * t)])
    v = np.gradient(q, STEP, axis=1)
    builder = DiagramBuilder()
    system = builder.AddSystem(PreslidingFrictionSystem(law(), STEP))
    for name, samples in (("q", q), ("v", v)):
        path = PiecewisePolynomial.ZeroOrderHold(t, samples)
        source = builder.AddSystem(TrajectorySource(path))
        builder.Connect(source.get_output_port(), system.GetInputPort(name))
    tau_J = np.array([8.0, -3.0])
    motor = builder.AddSystem(ConstantVectorSource(tau_J))
    builder.Connect(motor.get_output_port(), system.GetInputPort("tau_J"))
    log = LogVectorOutput(system.GetOutputPort("tau_f"), builder, STEP)
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(0.9)
    found = log.FindLog(simulator.get_context()).data().T
    own, state = law(), law().initial_state()
    for k in range(80):
        # Samples of the log and of the zero-order hold fall together; use what was read.
        qk, vk = (np.asarray(path[:, k]) for path in (q, v))
        tau_f = own.velocity_law.torque(vk)
        add_slip_torque(own.slip_table, state, qk, vk, tau_f)
        update_slip(own.slip_table, state, qk, vk, tau_J - tau_f)
        np.testing.assert_allclose(found[k], tau_f, rtol=0, atol=1e-12)


def test_a_parameter_changed_through_the_context():
    system, context = fixed([0.0, 0.0], [0.0, 0.0])
    step(system, context)
    table = law().slip_table.copy()
    table[:, 0] = 50.0
    context.get_mutable_numeric_parameter(0).SetFromVector(table.ravel())
    system.GetInputPort("q").FixValue(context, [1.0, 1.0])
    found = torque(system, context)
    load = 0.06 * abs(0.0 - OFFSET[0])
    assert found[0] == pytest.approx(OFFSET[0] + 51.0 + load, rel=1e-12)


def test_sign():
    """Friction opposes motion and stands on the left of the equation: positive for v > 0."""
    for side in (1.0, -1.0):
        system, context = fixed([0.0, 0.0], [0.0, 0.0])
        step(system, context)
        system.GetInputPort("q").FixValue(context, [side * 0.1] * N)
        system.GetInputPort("v").FixValue(context, [side * 0.5] * N)
        assert (side * (torque(system, context) - OFFSET) > 0.0).all()


def test_a_broken_position_is_seen_on_its_own_joint_and_forgotten():
    system, context = fixed([np.nan, 0.0], [0.0, 0.0])
    assert np.isnan(torque(system, context)).tolist() == [True, False]
    step(system, context)
    system.GetInputPort("q").FixValue(context, [0.0, 0.0])
    assert np.isfinite(torque(system, context)).all()


def test_bad_arguments_are_refused():
    with pytest.raises(ValueError, match="without memory"):
        PreslidingFrictionSystem(SemiParametricFriction(CoulombViscous.zero(2)), STEP)
    with pytest.raises(ValueError, match="time_step"):
        PreslidingFrictionSystem(law(), 0.0)
