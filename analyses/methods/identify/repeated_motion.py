"""Logs that repeat one motion: a fit of one cannot be tested on the other.

A law that is fitted on a motion and tried on its repetition shows how well the drives repeat, not
how well the law carries. (On one arm two of three logs were alike within 3 mrad. The law so chosen
predicted .07 N m on the last joint; its error on the third log was 9.9 N m.)
"""

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from wrenchsight.analyses.methods.identify.low_passed_logs import LowPassedLog
from wrenchsight.models.numerics.arrays import Array

POSITION_TOLERANCE = 0.01  # of a joint's travel over all logs
SPEED_TOLERANCE = 0.03  # of its largest speed
REPEATED_SHARE = 0.5  # of a log's moving samples: from this on it repeats the other
_MOVING_SHARE = 0.02  # of a joint's largest speed, reached by one of them
_MIN_TOLERANCE = 1e-12  # rad, rad/s (m, m/s), of a joint that stands still in all logs
_MAX_SAMPLES = 1000  # of a log that are looked for in the other


def motion_groups(runs: Sequence[LowPassedLog]) -> tuple[int, ...]:
    """The motion of each log, counted from 0 in the order in which they first appear.

    Logs that repeat each other, also by way of a third one, have one motion. A log repeats another
    where half of its moving samples have, in all joints, position and speed of some sample of the
    other.
    """
    if len(runs) == 1:
        return (0,)
    travel = np.ptp(np.vstack([run.q[run.used] for run in runs]), axis=0)
    speed = np.abs(np.vstack([run.v[run.used] for run in runs])).max(axis=0)
    scale = np.concatenate([POSITION_TOLERANCE * travel, SPEED_TOLERANCE * speed])
    scale = np.maximum(scale, _MIN_TOLERANCE)
    points = []  # of each log: position and speed (moving samples, 2 n), in units of the tolerance
    for run in runs:
        moving = run.used & (np.abs(run.v) > _MOVING_SHARE * speed).any(axis=1)
        points.append(np.hstack([run.q, run.v])[moving] / scale)
    groups = list(range(len(runs)))  # each log alone; those that repeat each other are joined
    for b in range(1, len(runs)):
        for a in range(b):
            if groups[a] != groups[b] and _repeats(points[a], points[b]):
                kept, dissolved = sorted((groups[a], groups[b]))
                groups = [kept if group == dissolved else group for group in groups]
    order = {group: k for k, group in enumerate(dict.fromkeys(groups))}
    return tuple(order[group] for group in groups)


def repeated_motion_notes(names: Sequence[str], groups: Sequence[int]) -> list[str]:
    """One sentence for each motion that several logs repeat."""
    notes = []
    for group in dict.fromkeys(groups):
        same = [name for name, other in zip(names, groups, strict=True) if other == group]
        if len(same) > 1:
            fold = "there is no other motion to test on: thirds of it are held out instead"
            if len(set(groups)) > 1:
                fold = "they are held out together"
            notes.append(f"{', '.join(same)} repeat one motion: {fold}")
    return notes


def _repeats(a: Array, b: Array) -> bool:
    if not len(a) or not len(b):
        return False
    return _share_within(a, b) >= REPEATED_SHARE or _share_within(b, a) >= REPEATED_SHARE


def _share_within(points: Array, reference: Array) -> float:
    """Share of the points with a reference point within the tolerances."""
    sample = points[:: max(1, len(points) // _MAX_SAMPLES)]
    distance, _ = cKDTree(reference).query(sample, p=np.inf, distance_upper_bound=1.0)
    return float(np.mean(np.isfinite(distance)))
