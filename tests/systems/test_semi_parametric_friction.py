"""SemiParametricFrictionSystem."""

import numpy as np
import pytest

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


def test_ports():
    system = block()
    assert system.GetInputPort("v").size() == system.GetOutputPort("tau_f").size() == 2
    assert system.HasDirectFeedthrough(0, 0)
    assert system.CreateDefaultContext().num_total_states() == 0


@pytest.mark.parametrize("handover", ["continuous", "literal"])
def test_formula(handover):
    """That of the law, inside and outside of ±v_crit."""
    system = block(networks(), handover)
    law = SemiParametricFriction(
        CoulombViscous(COULOMB, VISCOUS, OFFSET), networks(), V_CRIT, handover
    )
    context = system.CreateDefaultContext()
    for v in ([0.09, -0.15], [0.11, -0.25]):
        np.testing.assert_array_equal(friction_torque(system, context, v), law.torque(np.array(v)))


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
