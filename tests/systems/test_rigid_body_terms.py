"""RigidBodyTermsSystem."""

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable

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


def test_terms_are_computed_once_per_state(sts):
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


def test_a_broken_state_gives_terms_that_are_not_finite(sts):
    system = RigidBodyTermsSystem(sts.chain)
    broken = Q.copy()
    broken[2] = np.nan
    terms = evaluate(system, system.CreateDefaultContext(), broken, V)
    assert not np.isfinite(terms.momentum).any()
    assert not np.isfinite(terms.J).all()


def test_terms_that_are_known_are_not_computed_again(sts):
    system = RigidBodyTermsSystem(sts.chain, reads_known=True)
    context, known = system.CreateDefaultContext(), sts.chain.terms(Q, V)
    system.GetInputPort("known").FixValue(context, AbstractValue.Make(known))
    given = system.GetInputPort("known").Eval(context)
    assert evaluate(system, context, Q, V) is given
    for q, v in ((Q + 1e-15, V), (Q, V + 1e-15)):
        terms = evaluate(system, context, q, v)
        assert terms is not given
        np.testing.assert_array_equal(terms.record, sts.chain.terms(q, v).record)
