import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import PrismaticJoint, SpatialInertia, UnitInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from wrenchsight.models.control.wrench_script import WrenchScript, WrenchSine, WrenchStep
from wrenchsight.systems.external_wrench_source import ExternalWrenchSource


def cart(p_BE=(0.0, 0.0, 0.0)):
    plant = MultibodyPlant(1e-3)
    body = plant.AddRigidBody("cart", SpatialInertia(2.0, [0, 0, 0], UnitInertia(1, 1, 1)))
    plant.AddJoint(PrismaticJoint("rail", plant.world_frame(), body.body_frame(), [1, 0, 0]))
    plant.Finalize()
    return plant, body


def test_ports():
    _plant, body = cart()
    block = ExternalWrenchSource(WrenchScript([]), body.index(), [0, 0, 0])
    assert block.num_input_ports() == 0
    assert block.GetOutputPort("wrench_true").size() == 6
    assert block.GetOutputPort("spatial_forces").get_name() == "spatial_forces"


def test_both_outputs_are_the_script():
    _plant, body = cart()
    script = WrenchScript([WrenchStep(0.5, force=[1, 2, 3], moment=[4, 5, 6])])
    block = ExternalWrenchSource(script, body.index(), [0.1, 0.2, 0.3])
    context = block.CreateDefaultContext()
    for t, gain in ((0.0, 0), (0.7, 1)):
        context.SetTime(t)
        expected = gain * np.array([4.0, 5, 6, 1, 2, 3])
        np.testing.assert_array_equal(block.GetOutputPort("wrench_true").Eval(context), expected)
        (force,) = block.GetOutputPort("spatial_forces").Eval(context)
        np.testing.assert_array_equal(force.F_Bq_W.get_coeffs(), expected)
        np.testing.assert_array_equal(force.p_BoBq_B, [0.1, 0.2, 0.3])
        assert force.body_index == body.index()


def test_pushes_a_cart_as_the_closed_form_says():
    builder = DiagramBuilder()
    plant, body = cart()
    builder.AddSystem(plant)
    script = WrenchScript([WrenchSine(frequency=1.0, force=[4.0, 0, 0])])
    block = builder.AddSystem(ExternalWrenchSource(script, body.index(), [0, 0, 0]))
    builder.Connect(
        block.GetOutputPort("spatial_forces"), plant.get_applied_spatial_force_input_port()
    )
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(0.5)
    v = plant.GetVelocities(plant.GetMyContextFromRoot(simulator.get_context()))[0]
    # v = F / (m w) (1 - cos wt); a sum of samples instead of the integral errs by T F / m / 2.
    assert abs(v - 4.0 / (2.0 * 2 * np.pi) * 2.0) < 1e-3 * 4.0 / 2.0
    assert v > 0  # a positive push moves it the positive way
