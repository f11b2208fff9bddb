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
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    ContactResults,
    CoulombFriction,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import BodyIndex, SpatialInertia
from pydrake.systems.framework import DiagramBuilder

from models.robot import Robot
from models.serial_chain import RigidBodyTerms
from systems.tool_contact import ToolContact

RADIUS, DEPTH = 0.012, 5e-4


def terms(p_WE, R_WE):
    nothing = np.zeros(0)
    return RigidBodyTerms(*[nothing] * 6, R_WE, p_WE, *[nothing] * 3)


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


@pytest.mark.parametrize("patches", [False, True])
@pytest.mark.parametrize("ball_first", [False, True])
def test_a_pressed_ball_is_pushed_out_of_the_plate(patches, ball_first):
    body, tip, p, results, _diagram = pressed_ball(patches, ball_first)
    count = results.num_hydroelastic_contacts() if patches else results.num_point_pair_contacts()
    assert count == 1
    # E on the ball's surface, a quarter turn away from the contact; its z axis points away too.
    R_WE = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    block = ToolContact(body, [tip], RADIUS)
    context = block.CreateDefaultContext()
    t = terms(p + RADIUS * R_WE[:, 2], R_WE)
    block.GetInputPort("terms").FixValue(context, AbstractValue.Make(t))
    block.GetInputPort("contact_results").FixValue(context, Value(results))
    contact = block.get_output_port().Eval(context)
    assert contact[5] > 1.0
    np.testing.assert_allclose(contact[3:5], 0.0, atol=1e-6 * contact[5])
    np.testing.assert_allclose(contact[7:], [0.0, 0.0, 1.0], atol=1e-3)
    assert contact[6] == pytest.approx(contact[5], rel=1e-4)
    # The force goes through the centre: about E it has the moment of the way between them.
    moment = np.cross(-RADIUS * R_WE[:, 2], contact[3:6])
    np.testing.assert_allclose(contact[:3], moment, atol=1e-3 * RADIUS * contact[5])


def test_contact_of_other_bodies_does_not_count():
    body, _, p, results, _diagram = pressed_ball(patches=False, ball_first=True)
    block = ToolContact(BodyIndex(int(body) + 5), [], RADIUS)
    context = block.CreateDefaultContext()
    block.GetInputPort("terms").FixValue(context, AbstractValue.Make(terms(p, np.eye(3))))
    block.GetInputPort("contact_results").FixValue(context, Value(results))
    np.testing.assert_array_equal(block.get_output_port().Eval(context), np.zeros(10))


def test_without_contact_all_is_zero():
    robot = Robot.load("sts_sre4_600")
    block = ToolContact(BodyIndex(8))
    context = block.CreateDefaultContext()
    t = robot.chain.terms(robot.home, np.zeros(6))
    block.GetInputPort("terms").FixValue(context, AbstractValue.Make(t))
    block.GetInputPort("contact_results").FixValue(context, Value(ContactResults()))
    np.testing.assert_array_equal(block.get_output_port().Eval(context), np.zeros(10))
