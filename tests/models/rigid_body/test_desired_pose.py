import numpy as np

from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.rigid_body.desired_pose import POSE_REFERENCE_SIZE, desired_pose


@kernel
def velocity_in_a_kernel(pose_reference, out):
    out[:] = desired_pose(pose_reference).V_WD


def test_the_parts_fill_the_vector_one_after_another_and_are_views_of_it():
    entries = np.arange(float(POSE_REFERENCE_SIZE))
    parts = desired_pose(entries)
    assert [part.shape for part in parts] == [(3, 3), (3,), (6,)]
    np.testing.assert_array_equal(np.concatenate([part.ravel() for part in parts]), entries)
    parts.V_WD[0] = -1.0
    assert entries[12] == -1.0


def test_kernels_read_the_same_parts():
    entries, velocity = np.arange(float(POSE_REFERENCE_SIZE)), np.empty(6)
    velocity_in_a_kernel(entries, velocity)
    np.testing.assert_array_equal(velocity, desired_pose(entries).V_WD)
