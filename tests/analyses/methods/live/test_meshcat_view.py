"""The arm and its force on a page."""

import numpy as np

from wrenchsight.analyses.methods.live.meshcat_view import MeshcatView
from wrenchsight.models.live.reading import Reading


def msgpack_matrix(packed):
    """The (4, 4) matrix at the end of the message: 16 floats of 5 or 9 bytes, column by column."""
    for code, size, kind in ((0xCA, 5, ">f4"), (0xCB, 9, ">f8")):
        words = [packed[-size * k : len(packed) - size * (k - 1)] for k in range(16, 0, -1)]
        if all(word[0] == code for word in words):
            return np.array([np.frombuffer(word[1:], kind)[0] for word in words]).reshape(4, 4).T
    raise AssertionError(packed)


def test_the_arm_and_the_force_are_drawn_where_they_are(ur10e):
    view = MeshcatView(ur10e)
    q = np.add(ur10e.home, [0.3, 0.1, -0.2, 0.0, 0.4, 0.0])
    wrench = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 100.0])
    reading = Reading.of(wrench, np.eye(6), np.zeros(6), q, t=1.0, valid=1.0)
    assert view.take([reading.row]) == ""
    meshcat = view._meshcat
    assert "127.0.0.1" in view.url or "localhost" in view.url
    # The arrow begins at E and points along the force.
    _, p_WE = ur10e.chain.pose(q[None])
    assert meshcat.HasPath("/force/shaft")
    placed = msgpack_matrix(meshcat._GetPackedTransform("/force"))
    np.testing.assert_allclose(placed[:3, 3], p_WE[0], atol=1e-6)
    np.testing.assert_allclose(placed[:3, 2], [0.0, 0.0, 1.0], atol=1e-6)
    assert view.close() == ""
