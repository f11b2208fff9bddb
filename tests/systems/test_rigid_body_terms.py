"""RigidBodyTermsSystem."""

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, Demultiplexer

from wrenchsight.systems.rigid_body_terms import RigidBodyTermsSystem

Q = np.array([0.3, -0.4, 0.5, 0.2, -0.7, 1.1])
V = np.array([0.5, -0.3, 0.8, -1.0, 0.4, 0.9])


def evaluate(system, context, q, v):
    system.GetInputPort("q").FixValue(context, q)
    system.GetInputPort("v").FixValue(context, v)
    return system.GetOutputPort("terms").Eval(context)


def test_ports(sts):
    system = RigidBodyTermsSystem(sts.chain)
    assert system.GetInputPort("q").size() == system.GetInputPort("v").size() == 6
    assert system.num_output_ports() == 1
    assert system.chain is sts.chain
    assert system.CreateDefaultContext().num_total_states() == 0


def test_terms_are_those_of_the_plant(sts):
    plant = MultibodyPlant(0.0)
    parts = sts.add_to_plant(plant)
    plant.Finalize()
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, Q)
    plant.SetVelocities(context, V)
    system = RigidBodyTermsSystem(sts.chain)
    terms = evaluate(system, system.CreateDefaultContext(), Q, V)

    M = plant.CalcMassMatrix(context)
    tolerance = {"rtol": 0.0, "atol": 1e-10}
    np.testing.assert_allclose(terms.M, M, **tolerance)
    np.testing.assert_allclose(terms.momentum, M @ V, **tolerance)
    np.testing.assert_allclose(terms.G, -plant.CalcGravityGeneralizedForces(context), **tolerance)
    np.testing.assert_allclose(terms.Cv, plant.CalcBiasTerm(context), **tolerance)
    W = plant.world_frame()
    J = plant.CalcJacobianSpatialVelocity(
        context, JacobianWrtVariable.kV, parts.frame_E, [0, 0, 0], W, W
    )
    np.testing.assert_allclose(terms.J, J, **tolerance)
    np.testing.assert_allclose(terms.V_WE, J @ V, **tolerance)
    X_WE = parts.frame_E.CalcPoseInWorld(context)
    np.testing.assert_allclose(terms.R_WE, X_WE.rotation().matrix(), **tolerance)
    np.testing.assert_allclose(terms.p_WE, X_WE.translation(), **tolerance)
    np.testing.assert_array_equal(terms.q, Q)
    np.testing.assert_array_equal(terms.v, V)


def test_CTv_is_the_gradient_of_the_kinetic_energy(sts):
    system = RigidBodyTermsSystem(sts.chain)
    CTv = evaluate(system, system.CreateDefaultContext(), Q, V).CTv
    h = 1e-6
    energy = [
        [0.5 * V @ sts.chain.momentum_terms(Q + side * h * e, V)[0] for e in np.eye(6)]
        for side in (1.0, -1.0)
    ]
    # Central differences: truncation and rounding are both near 1e-9.
    np.testing.assert_allclose(CTv, np.subtract(*energy) / (2.0 * h), rtol=0.0, atol=1e-7)


def test_one_computation_serves_all_and_a_new_state_makes_a_new_one(sts):
    system = RigidBodyTermsSystem(sts.chain)
    context = system.CreateDefaultContext()
    first = evaluate(system, context, Q, V)
    assert system.GetOutputPort("terms").Eval(context) is first
    context.SetTime(1.0)
    assert system.GetOutputPort("terms").Eval(context) is first
    second = evaluate(system, context, Q, 2.0 * V)
    assert second is not first
    # What a reader still holds is not overwritten.
    np.testing.assert_allclose(second.momentum, 2.0 * first.momentum, rtol=1e-14)


def test_it_follows_a_simulated_plant(sts):
    """Free fall: the momentum in the terms changes by the impulse of gravity and of CTv."""
    builder = DiagramBuilder()
    plant = builder.AddSystem(MultibodyPlant(0.0))
    parts = sts.add_to_plant(plant)
    plant.Finalize()
    system = builder.AddSystem(RigidBodyTermsSystem(sts.chain))
    instance = parts.model_instance
    demux = builder.AddSystem(Demultiplexer(12, 6))
    builder.Connect(plant.get_state_output_port(instance), demux.get_input_port(0))
    builder.Connect(demux.get_output_port(0), system.GetInputPort("q"))
    builder.Connect(demux.get_output_port(1), system.GetInputPort("v"))
    rest = builder.AddSystem(ConstantVectorSource(np.zeros(6)))
    builder.Connect(rest.get_output_port(), plant.get_actuation_input_port())
    diagram = builder.Build()
    simulator = Simulator(diagram)
    simulator.get_mutable_integrator().set_target_accuracy(1e-10)
    context = simulator.get_mutable_context()
    plant.SetPositions(plant.GetMyMutableContextFromRoot(context), Q)

    def terms():
        return system.GetOutputPort("terms").Eval(system.GetMyContextFromRoot(context))

    h, impulse = 1e-3, np.zeros(6)
    before = terms()
    start = before.momentum
    for k in range(100):
        simulator.AdvanceTo((k + 1) * h)
        after = terms()
        impulse += 0.5 * h * (before.CTv - before.G + after.CTv - after.G)
        before = after
    # The trapezoidal rule's error over 0.1 s is far below this.
    np.testing.assert_allclose(after.momentum - start, impulse, rtol=0.0, atol=2e-5)
    assert np.abs(impulse).max() > 1.0


def test_sign(sts):
    """G is the torque that holds the arm: along a motion it does the work that lifts it."""
    plant = MultibodyPlant(0.0)
    sts.add_to_plant(plant)
    plant.Finalize()
    context = plant.CreateDefaultContext()

    def potential_energy(q):
        plant.SetPositions(context, q)
        return plant.CalcPotentialEnergy(context)

    h = 1e-6
    slope = [
        (potential_energy(Q + h * e) - potential_energy(Q - h * e)) / (2 * h) for e in np.eye(6)
    ]
    system = RigidBodyTermsSystem(sts.chain)
    G = evaluate(system, system.CreateDefaultContext(), Q, V).G
    # Central differences of an energy near 100 J: rounding is near 1e-8.
    np.testing.assert_allclose(G, slope, rtol=0.0, atol=1e-6)


def test_a_broken_state_gives_terms_that_are_not_finite(sts):
    system = RigidBodyTermsSystem(sts.chain)
    broken = Q.copy()
    broken[2] = np.nan
    terms = evaluate(system, system.CreateDefaultContext(), broken, V)
    assert not np.isfinite(terms.momentum).any()
    assert not np.isfinite(terms.J).all()


def test_wrong_size(sts):
    system = RigidBodyTermsSystem(sts.chain)
    with pytest.raises(Exception, match=r"size|Size"):
        system.GetInputPort("q").FixValue(system.CreateDefaultContext(), np.zeros(5))
