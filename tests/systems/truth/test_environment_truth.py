from dataclasses import replace

import numpy as np
import pytest
from pydrake.common.value import AbstractValue, Value
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddContactMaterial,
    AddRigidHydroelasticProperties,
    Box,
    ProximityProperties,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlant, CoulombFriction, MultibodyPlantConfig
from pydrake.multibody.tree import BodyIndex, SpatialInertia
from pydrake.systems.framework import DiagramBuilder

from wrenchsight.systems.truth.environment_truth import EnvironmentTruth

RADIUS, DEPTH = 0.012, 5e-4


def block_with(terms, wrench, **more):
    block = EnvironmentTruth(6, BodyIndex(8))
    context = block.CreateDefaultContext()
    block.GetInputPort("terms").FixValue(context, AbstractValue.Make(terms))
    block.GetInputPort("wrench_applied").FixValue(context, wrench)
    for name, value in more.items():
        block.GetInputPort(name).FixValue(context, value)
    return block, context


@pytest.fixture(scope="module")
def terms(sts):
    return sts.chain.terms(sts.home, np.zeros(6))


def test_ports():
    block = EnvironmentTruth(6, BodyIndex(8))
    assert block.GetOutputPort("wrench_true").size() == 6
    assert block.GetOutputPort("tau_ext_true").size() == 6
    assert block.GetOutputPort("contact").size() == 4
    assert block.GetOutputPort("truth").size() == sum(block.sizes(6)) == 16


def test_without_contact_it_is_what_is_applied(terms):
    t, F = terms, np.array([0.1, -0.2, 0.3, 4.0, 5.0, 6.0])
    block, context = block_with(t, F)
    np.testing.assert_array_equal(block.GetOutputPort("wrench_true").Eval(context), F)
    tau = block.GetOutputPort("tau_ext_true").Eval(context)
    np.testing.assert_allclose(tau, t.J.T @ F, atol=1e-14)


def test_contact_torque_is_added(terms):
    t, F, tau_contact = terms, np.ones(6), np.arange(6.0)
    block, context = block_with(t, F, tau_contact=tau_contact)
    tau = block.GetOutputPort("tau_ext_true").Eval(context)
    np.testing.assert_allclose(tau, t.J.T @ F + tau_contact, atol=1e-14)


def test_a_push_along_a_joints_motion_is_positive(terms):
    t = terms
    # Along the velocity that the second joint gives to E.
    F = np.concatenate([np.zeros(3), t.J[3:, 1]])
    block, context = block_with(t, F)
    assert block.GetOutputPort("tau_ext_true").Eval(context)[1] > 0


def pressed_ball(patches, ball_first):
    """A ball half a millimetre deep in the world's plate at z = 0: contact of either kind."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlant(
        MultibodyPlantConfig(
            time_step=1e-3,
            contact_model="hydroelastic" if patches else "point",
            use_sampled_output_ports=False,
        ),
        builder,
    )
    solid = SpatialInertia.SolidSphereWithMass(1.0, RADIUS)
    bodies = [plant.AddRigidBody(name, solid) for name in "ab"]
    ball, plate = bodies if ball_first else bodies[::-1]
    soft, hard = ProximityProperties(), ProximityProperties()
    for properties in (soft, hard):
        AddContactMaterial(
            dissipation=0.0,
            point_stiffness=2e5,
            friction=CoulombFriction(0.2, 0.2),
            properties=properties,
        )
    AddCompliantHydroelasticProperties(0.5 * RADIUS, 1e8, soft)
    AddRigidHydroelasticProperties(0.1, hard)
    tip = plant.RegisterCollisionGeometry(ball, RigidTransform(), Sphere(RADIUS), "tip", soft)
    X = RigidTransform([0, 0, -0.05])
    plant.RegisterCollisionGeometry(plate, X, Box(0.2, 0.2, 0.1), "plate", hard)
    plant.WeldFrames(plant.world_frame(), plate.body_frame())
    plant.Finalize()
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    mine = plant.GetMyMutableContextFromRoot(context)
    p = np.array([0.01, -0.02, RADIUS - DEPTH])
    plant.SetFreeBodyPose(mine, ball, RigidTransform(p))
    results = plant.get_contact_results_output_port().Eval(mine)
    return ball.index(), tip, p, results, diagram


def parts(block, context):
    truth = block.GetOutputPort("truth").Eval(context)
    names = ("wrench_true", "tau_ext_true", "contact")
    for name, part in zip(names, np.split(truth, [6, 12]), strict=True):
        np.testing.assert_array_equal(block.GetOutputPort(name).Eval(context), part)
        yield part


def block_at(terms, p_WE, R_WE, F, body, tip, results):
    block = EnvironmentTruth(6, body, [tip], RADIUS)
    t = replace(terms, p_WE=p_WE, R_WE=R_WE)
    context = block.CreateDefaultContext()
    block.GetInputPort("terms").FixValue(context, AbstractValue.Make(t))
    block.GetInputPort("wrench_applied").FixValue(context, F)
    block.GetInputPort("contact_results").FixValue(context, Value(results))
    return block, context, t


@pytest.mark.parametrize("patches", [False, True])
@pytest.mark.parametrize("ball_first", [False, True])
def test_a_pressed_ball_is_pushed_out_of_the_plate(terms, patches, ball_first):
    body, tip, p, results, _diagram = pressed_ball(patches, ball_first)
    count = results.num_hydroelastic_contacts() if patches else results.num_point_pair_contacts()
    assert count == 1
    # E on the ball's surface, a quarter turn away from the contact; its z axis points away too.
    R_WE = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    applied = np.arange(1.0, 7.0)
    block, context, t = block_at(terms, p + RADIUS * R_WE[:, 2], R_WE, applied, body, tip, results)
    wrench, tau, (normal_force, *n) = parts(block, context)
    np.testing.assert_allclose(tau, t.J.T @ applied, atol=1e-12)
    touch = wrench - applied
    assert touch[5] > 1.0
    np.testing.assert_allclose(touch[3:5], 0.0, atol=1e-6 * touch[5])
    np.testing.assert_allclose(n, [0.0, 0.0, 1.0], atol=1e-3)
    assert normal_force == pytest.approx(touch[5], rel=1e-4)
    # The force goes through the centre: about E it has the moment of the way between them.
    moment = np.cross(-RADIUS * R_WE[:, 2], touch[3:])
    np.testing.assert_allclose(touch[:3], moment, atol=1e-3 * RADIUS * touch[5])


def test_contact_of_other_bodies_does_not_count(terms):
    body, tip, p, results, _diagram = pressed_ball(patches=False, ball_first=True)
    other = BodyIndex(int(body) + 5)
    block, context, _ = block_at(terms, p, np.eye(3), np.ones(6), other, tip, results)
    wrench, _, contact = parts(block, context)
    np.testing.assert_array_equal(wrench, 1.0)
    np.testing.assert_array_equal(contact, 0.0)
