import numpy as np

from wrenchsight.models.motion.paths import JointTrajectory
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


def test_delay_through_the_context():
    block = PathReference(quintic())
    context = block.CreateDefaultContext()
    context.SetTime(1.0)
    context.get_mutable_numeric_parameter(0).SetAtIndex(0, 0.25)
    reference = block.GetOutputPort("reference").Eval(context)
    np.testing.assert_allclose(reference, evaluate(block, 0.75))
