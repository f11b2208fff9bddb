import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Integrator

from wrenchsight.models.planning.motion.paths import JointTrajectory
from wrenchsight.systems.path_reference import PathReference


def quintic():
    """q = t^5 and 1 - 2 t^3 on [0, 1.5]: a quintic spline holds it without error."""
    t = np.linspace(0.0, 1.5, 7)
    q = np.stack([t**5, 1 - 2 * t**3], axis=1)
    v = np.stack([5 * t**4, -6 * t**2], axis=1)
    vdot = np.stack([20 * t**3, -12 * t], axis=1)
    return JointTrajectory(t, q, v, vdot)


def evaluate(block, t):
    context = block.CreateDefaultContext()
    context.SetTime(t)
    return block.GetOutputPort("reference").Eval(context)


def test_ports():
    block = PathReference(quintic())
    assert block.num_input_ports() == 0
    assert block.GetOutputPort("reference").size() == 6


def test_position_velocity_acceleration_in_this_order():
    t = 0.83
    expected = [t**5, 1 - 2 * t**3, 5 * t**4, -6 * t**2, 20 * t**3, -12 * t]
    np.testing.assert_allclose(evaluate(PathReference(quintic()), t), expected, atol=1e-12)


def test_rests_after_the_end():
    expected = [1.5**5, 1 - 2 * 1.5**3, 0, 0, 0, 0]
    np.testing.assert_allclose(evaluate(PathReference(quintic()), 2.0), expected)


def test_velocity_integrates_to_position():
    builder = DiagramBuilder()
    block = builder.AddSystem(PathReference(quintic()))
    integrator = builder.AddSystem(Integrator(6))
    builder.Connect(block.get_output_port(), integrator.get_input_port())
    simulator = Simulator(builder.Build())
    simulator.get_mutable_integrator().set_target_accuracy(1e-9)
    simulator.AdvanceTo(1.2)
    context = simulator.get_context()
    moved = integrator.get_output_port().Eval(integrator.GetMyContextFromRoot(context))[2:4]
    np.testing.assert_allclose(moved, [1.2**5, -2 * 1.2**3], atol=1e-6)
