"""The arm and its force on a page."""

import numpy as np
import pytest

from wrenchsight.analyses.methods.watch.arm_scene import METRES_PER_NEWTON
from wrenchsight.analyses.methods.watch.meshcat_view import MeshcatView
from wrenchsight.analyses.methods.watch.ring import Ring, RingReader
from wrenchsight.analyses.methods.watch.watching import SinkThread
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.live.reading import Reading, row_size
from wrenchsight.systems.wrench_arrows import HEAD_LENGTH


def msgpack_matrix(packed):
    """The (4, 4) matrix at the end of the message: 16 floats of 5 or 9 bytes, column by column."""
    for code, size, kind in ((0xCA, 5, ">f4"), (0xCB, 9, ">f8")):
        words = [packed[-size * k : len(packed) - size * (k - 1)] for k in range(16, 0, -1)]
        if all(word[0] == code for word in words):
            return np.array([np.frombuffer(word[1:], kind)[0] for word in words]).reshape(4, 4).T
    raise AssertionError(packed)


def test_the_arm_and_the_force_are_drawn_where_they_are(ur10e):
    """In the thread of a sink, as `watch` draws."""
    placed, messages = {}, []

    class View(MeshcatView):
        def close(self):
            for path in ("/force", "/force/shaft", "/force/head"):
                placed[path] = msgpack_matrix(self._meshcat._GetPackedTransform(path))
            assert self._meshcat.HasPath("/arm/forearm_link")
            assert "127.0.0.1" in self.url or "localhost" in self.url
            return super().close()

    q = np.add(ur10e.home, [0.3, 0.1, -0.2, 0.0, 0.4, 0.0])
    wrench = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 100.0])
    reading = Reading.of(wrench, np.eye(6), np.zeros(6), q, t=1.0)
    ring = Ring(row_size(6), 64)
    thread = SinkThread(lambda: View(ur10e), RingReader(ring), messages.append)
    ring.write(reading.row)
    thread.finish()
    ring.close()
    assert messages == []
    # The arrow begins at E and points along the force, with its head at the end.
    _, p_WE = ur10e.chain.pose(q[None])
    np.testing.assert_allclose(placed["/force"][:3, 3], p_WE[0], atol=1e-6)
    np.testing.assert_allclose(placed["/force"][:3, 2], [0.0, 0.0, 1.0], atol=1e-6)
    shaft, head = placed["/force/shaft"], placed["/force/head"]
    length = 100.0 * METRES_PER_NEWTON
    assert head[2, 3] == pytest.approx(length, abs=1e-6)
    assert shaft[2, 2] == pytest.approx(length - HEAD_LENGTH, abs=1e-6)
    assert shaft[2, 3] == pytest.approx(0.5 * shaft[2, 2], abs=1e-6)


def test_a_broken_view_is_reported(ur10e):
    class Broken:
        period = 0.001

        def take(self, rows):
            raise RuntimeError("no paint")

    messages, ring = [], Ring(row_size(6), 64)
    thread = SinkThread(Broken, RingReader(ring), messages.append)
    thread.join()
    assert "Broken" in messages[0]
    assert "no paint" in messages[0]
    with pytest.raises(InputError, match="no such"):
        SinkThread(refused, RingReader(ring), messages.append)
    ring.close()


def refused():
    raise InputError("view", "", "no such")
