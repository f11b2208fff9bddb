"""The labels of the collisions, against the currents of the same path untouched."""

from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import uniform_filter1d
from scipy.spatial import cKDTree

from wrenchsight.analyses.experiments.contact_detection.experiment import (
    COLLISION_TIMES,
    PUSH_FORCES,
    PUSHED_LINKS,
    push_key,
)
from wrenchsight.models.recordings.recording_reader import read_recording

GAIN = np.array([11.976, 11.976, 9.839])  # N m/A, joints 1 to 3


def test_the_collisions_are_where_the_current_leaves_the_untouched_paths(data_holding, ur10e):
    folder: Path = data_holding("ur10e_more/collision_wrist.csv", "ur10e_more/collision_free.csv")
    logs = [
        read_recording(folder / f"ur10e_more/collision_{name}.csv", robot=ur10e)
        for name in ("free", "wrist")
    ]
    free, wrist = (np.hstack([log.q, 0.3 * log.v]) for log in logs)
    current = [uniform_filter1d(log.current[:, :3], 5, axis=0) for log in logs]
    _, near = cKDTree(free).query(wrist, k=8)
    torque = np.abs(GAIN * (current[1] - current[0][near].mean(axis=1))).max(axis=1)
    t = logs[1].t - logs[1].t[0]
    labelled = np.zeros(len(t), bool)
    peaks = []
    for begin, end in COLLISION_TIMES:
        inside = (t >= begin) & (t <= end + 0.5)  # the arm swings a little after each
        peaks.append(torque[inside].max())
        labelled |= inside
    # The two logs run at speeds of their own, which alone differ by up to 13 N m.
    assert torque[~labelled].max() < 0.8 * min(peaks)


def test_keys_are_those_of_the_contract():
    assert [push_key(30.0, 0.5, place) for place in PUSHED_LINKS] == [
        "push_30n_500ms_at_e",
        "push_30n_500ms_off_e",
    ]
    assert min(PUSH_FORCES) == 5.0
    assert max(PUSH_FORCES) == pytest.approx(60.0)
