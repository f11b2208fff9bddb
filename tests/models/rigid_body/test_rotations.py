"""The rotation vector and the quaternion of a rotation matrix, against scipy."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from wrenchsight.models.rigid_body.rotations import quaternion_of, rotation_vector


@settings(deadline=None, max_examples=300)
@given(
    st.tuples(*[st.floats(-1, 1)] * 3),
    st.sampled_from([0.0, 1e-12, 1e-8, 1e-4, 0.1, 2.0, np.pi - 1e-4, np.pi - 1e-9, np.pi]),
)
def test_rotation_vector_agrees_with_scipy(direction, angle):
    axis = np.array(direction)
    if np.linalg.norm(axis) < 1e-3:
        axis = np.array([0.0, 0, 1])
    R = Rotation.from_rotvec(axis / np.linalg.norm(axis) * angle).as_matrix()
    out = np.empty(3)
    rotation_vector(R, out)
    # At pi both signs are right, so compare the rotations; the length says: the short way.
    np.testing.assert_allclose(Rotation.from_rotvec(out).as_matrix(), R, atol=1e-14)
    assert np.linalg.norm(out) <= np.pi + 1e-12
    if angle < 3.0:
        np.testing.assert_allclose(out, Rotation.from_matrix(R).as_rotvec(), atol=1e-12)


def test_quaternions_are_those_of_the_rotation() -> None:
    rng = np.random.default_rng(4)
    turns = rng.normal(size=(60, 3))
    turns *= (rng.uniform(0.0, np.pi, 60) / np.linalg.norm(turns, axis=1))[:, np.newaxis]
    turns[:3] = np.pi * np.eye(3)  # half turns, where w is zero
    for R in Rotation.from_rotvec(turns).as_matrix():
        quaternion = np.empty(4)
        quaternion_of(np.ascontiguousarray(R), quaternion)
        assert np.linalg.norm(quaternion) == pytest.approx(1.0, abs=1e-12)
        again = Rotation.from_quat(quaternion[[1, 2, 3, 0]]).as_matrix()
        np.testing.assert_allclose(again, R, atol=1e-12)
