import numpy as np
import pytest

from wrenchsight.systems.pose_reference import PoseReference


@pytest.fixture(scope="module")
def chain(sts):
    return sts.chain


def test_ports(chain):
    block = PoseReference(chain)
    assert block.GetInputPort("reference").size() == 18
    assert block.GetOutputPort("pose_reference").size() == 18


def test_pose_and_velocity_are_those_of_the_chain(chain):
    block = PoseReference(chain)
    context = block.CreateDefaultContext()
    q, v = np.linspace(-0.5, 0.6, 6), np.linspace(1.0, -0.7, 6)
    block.get_input_port().FixValue(context, np.concatenate([q, v, np.zeros(6)]))
    pose = block.get_output_port().Eval(context)
    R_WE, p_WE = chain.pose(q)
    np.testing.assert_allclose(pose[:9].reshape(3, 3), R_WE, atol=1e-14)
    np.testing.assert_allclose(pose[9:12], p_WE, atol=1e-14)
    # The velocity against differences of the pose, second order in h.
    h = 1e-6
    R_next, p_next = chain.pose(q + h * v)
    R_last, p_last = chain.pose(q - h * v)
    spin = (R_next - R_last) / (2 * h) @ R_WE.T
    np.testing.assert_allclose(pose[12:15], [spin[2, 1], spin[0, 2], spin[1, 0]], atol=1e-8)
    np.testing.assert_allclose(pose[15:], (p_next - p_last) / (2 * h), atol=1e-8)
