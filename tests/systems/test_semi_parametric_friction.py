"""SemiParametricFrictionSystem."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput, Sine

from wrenchsight.models.friction.friction_network import FrictionNetworks
from wrenchsight.models.friction.velocity_friction import CoulombViscous, SemiParametricFriction
from wrenchsight.systems.semi_parametric_friction import SemiParametricFrictionSystem

COULOMB, VISCOUS, OFFSET = np.array([4.0, 2.0]), np.array([10.0, 3.0]), np.array([0.5, -0.2])
V_CRIT = np.array([0.1, 0.2])


def networks():
    rng = np.random.default_rng(3)
    return FrictionNetworks(
        W1=rng.normal(size=(2, 10)),
        b1=rng.normal(size=(2, 10)),
        W2=rng.normal(size=(2, 10)),
        b2=rng.normal(size=2),
        v_scale=V_CRIT.copy(),
    )


def block(nets=None, handover="continuous"):
    law = CoulombViscous(COULOMB, VISCOUS, OFFSET)
    return SemiParametricFrictionSystem(SemiParametricFriction(law, nets, V_CRIT, handover))


def friction_torque(system, context, v):
    system.GetInputPort("v").FixValue(context, np.asarray(v, float))
    return system.GetOutputPort("tau_f").Eval(context)


def network_alone(nets, v):
    """Two layers, joint by joint, written out."""
    return np.array(
        [
            nets.W2[i] @ np.tanh(nets.W1[i] * v[i] / nets.v_scale[i] + nets.b1[i]) + nets.b2[i]
            for i in range(2)
        ]
    )


def test_ports():
    system = block()
    assert system.GetInputPort("v").size() == system.GetOutputPort("tau_f").size() == 2
    assert system.HasDirectFeedthrough(0, 0)
    assert system.CreateDefaultContext().num_total_states() == 0


@pytest.mark.parametrize("v", [[0.3, -0.5], [0.05, -0.01], [0.0, 0.0]])
def test_without_weights_it_is_coulomb_viscous_at_every_velocity(v):
    system = block()
    expected = COULOMB * np.sign(v) + VISCOUS * v + OFFSET
    tau_f = friction_torque(system, system.CreateDefaultContext(), v)
    np.testing.assert_allclose(tau_f, expected, rtol=0.0, atol=1e-14)


def test_the_literal_law_is_the_network_inside_and_coulomb_viscous_outside():
    nets = networks()
    system = block(nets, "literal")
    context = system.CreateDefaultContext()
    inside = np.array([0.09, -0.15])
    np.testing.assert_allclose(
        friction_torque(system, context, inside), network_alone(nets, inside), rtol=0, atol=1e-13
    )
    outside = np.array([0.11, -0.25])
    expected = COULOMB * np.sign(outside) + VISCOUS * outside + OFFSET
    np.testing.assert_allclose(
        friction_torque(system, context, outside), expected, rtol=0.0, atol=1e-13
    )


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_default_hand_over_has_no_jump(side):
    system = block(networks())
    context = system.CreateDefaultContext()
    inside = friction_torque(system, context, side * V_CRIT * (1.0 - 1e-12))
    outside = friction_torque(system, context, side * V_CRIT * (1.0 + 1e-12))
    np.testing.assert_allclose(inside, outside, rtol=0.0, atol=1e-9)
    literal = block(networks(), "literal")
    jump = friction_torque(literal, literal.CreateDefaultContext(), side * V_CRIT) - outside
    assert np.abs(jump).max() > 0.1  # the test has something to smooth


def test_along_a_motion():
    """The dissipated energy of a sinusoidal velocity, Coulomb and viscous, in closed form."""
    builder = DiagramBuilder()
    amplitude, omega = 0.8, 2.0 * np.pi
    velocity = builder.AddSystem(Sine(amplitude, omega, 0.0, 2))
    system = builder.AddSystem(block())
    builder.Connect(velocity.get_output_port(0), system.GetInputPort("v"))
    log = LogVectorOutput(system.GetOutputPort("tau_f"), builder, 1e-4)
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(1.0)
    tau_f = log.FindLog(simulator.get_context()).data().T[:-1]
    v = amplitude * np.sin(omega * np.arange(len(tau_f)) * 1e-4)[:, None]
    power = (tau_f * v).mean(axis=0)
    expected = COULOMB * 2.0 * amplitude / np.pi + VISCOUS * amplitude**2 / 2.0
    np.testing.assert_allclose(power, expected, rtol=1e-6)  # rectangle rule over a full period


def test_parameters_change_through_the_context_and_the_hand_over_follows():
    system = block(networks())
    context = system.CreateDefaultContext()
    friction_torque(system, context, [0.3, 0.3])
    for index in (0, 1, 2):
        context.get_mutable_numeric_parameter(index).SetFromVector([7.0, 8.0])
    np.testing.assert_allclose(
        friction_torque(system, context, [0.3, 0.3]), [7 + 2.1 + 7, 8 + 2.4 + 8], rtol=1e-15
    )
    at_the_seam = friction_torque(system, context, V_CRIT)
    np.testing.assert_allclose(at_the_seam, [14 + 7 * 0.1, 16 + 8 * 0.2], rtol=1e-12)


def test_a_narrower_interval_through_the_context():
    system = block(networks())
    context = system.CreateDefaultContext()
    context.get_mutable_numeric_parameter(3).SetFromVector([0.0, 0.0])
    np.testing.assert_allclose(
        friction_torque(system, context, [0.05, -0.05]),
        COULOMB * [1, -1] + VISCOUS * [0.05, -0.05] + OFFSET,
        rtol=1e-15,
    )


def test_sign():
    """Friction opposes motion and stands on the left of the equation: positive for v > 0."""
    system = block()
    context = system.CreateDefaultContext()
    assert np.all(friction_torque(system, context, [0.5, 0.5]) > 0.0)
    assert np.all(friction_torque(system, context, [-0.5, -0.5]) < 0.0)


def test_a_broken_velocity_is_seen_on_its_own_joint_only():
    system = block(networks())
    tau_f = friction_torque(system, system.CreateDefaultContext(), [np.nan, 0.3])
    assert np.isnan(tau_f[0])
    assert np.isfinite(tau_f[1])


def test_a_broken_parameter_is_refused_when_it_is_used():
    system = block()
    context = system.CreateDefaultContext()
    context.get_mutable_numeric_parameter(0).SetFromVector([np.nan, 1.0])
    with pytest.raises(ValueError, match="coulomb"):
        friction_torque(system, context, [0.1, 0.1])
