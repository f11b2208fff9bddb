"""Logs that are named with stretches."""

from pathlib import Path

import numpy as np

from wrenchsight.analyses.methods.identify.known_model.stretches import logs_of
from wrenchsight.models.recordings.recording import Recording


def test_all_stretches_of_a_log_count_and_a_log_without_counts_whole():
    t = 5.0 + np.arange(11) / 10.0
    zeros = np.zeros((11, 2))

    def read(path: Path) -> Recording:
        return Recording(t, zeros, zeros, zeros, str(path))

    (first, chosen), (second, whole) = logs_of(["a=0,0.25,0.75,2", "b"], "payload", "LOG", read)
    assert (first.source, second.source, whole) == ("a", "b", None)
    assert chosen is not None
    assert np.flatnonzero(chosen).tolist() == [0, 1, 2, 8, 9, 10]
