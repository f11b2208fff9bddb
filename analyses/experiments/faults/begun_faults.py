"""Faults of currents that begin in a log, last and end; and pushes, which are none.

A fault is a function from the currents (N, n) of a log that is right, the span of the samples in
which they are wrong, and the time step, s, to the currents (M, n) of that span. Delays lie on the
times that `models.observers.shifted_torque` tries, between them, and beyond the longest one.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from wrenchsight.models.numerics.arrays import Array

Fault = Callable[[Array, slice, float], Array]
Change = Callable[[Any, Any], Any]  # of one current, by the times since the fault began

NUM_JOINTS = 6
EXTRA_CURRENT = 2.5  # A
DRIFT_RATE = 1.0  # A/s
NOISE_SD = 3.0  # A
SHORT_DELAYS = (0.1, 0.17, 0.2, 0.22, 0.275, 0.3)  # s
LONG_DELAYS = (0.65, 0.8, 1.0)  # s
FORCE_LIMITS = (20.0, 80.0)  # N, least and greatest of a push
MAX_LEVER = 0.1  # m beside E


def shifted(delay: float) -> Fault:
    """All currents late by `delay` s; negative: early."""

    def fault(current: Array, span: slice, T: float) -> Array:
        samples = round(delay / T)
        return current[span.start - samples : span.stop - samples].copy()

    return fault


def exchanged(j: int, k: int) -> Fault:
    """The currents of two joints, counted from 0, exchanged."""

    def fault(current: Array, span: slice, T: float) -> Array:
        wrong = current[span].copy()
        wrong[:, [j, k]] = wrong[:, [k, j]]
        return wrong

    return fault


def changed(joint: int, change: Change) -> Fault:
    """The current of one joint, counted from 0, changed.

    Args:
        change: from the current (M,), A, and the times since the fault began, s, to the wrong one.
    """

    def fault(current: Array, span: slice, T: float) -> Array:
        wrong = current[span].copy()
        wrong[:, joint] = change(wrong[:, joint], T * np.arange(len(wrong)))
        return wrong

    return fault


def _of_each_joint(*changes: Change) -> list[Fault]:
    return [changed(joint, change) for change in changes for joint in range(NUM_JOINTS)]


def _noisy(current: Array, t: Array) -> Array:
    noise = np.random.default_rng(3).normal(scale=NOISE_SD, size=len(t))
    noisy: Array = current + noise
    return noisy


BEGUN_FAULTS: Mapping[str, Sequence[Fault]] = {
    "sign": _of_each_joint(lambda i, t: -i),
    "doubled": _of_each_joint(lambda i, t: 2.0 * i),
    "offset": _of_each_joint(lambda i, t: i + EXTRA_CURRENT, lambda i, t: i - EXTRA_CURRENT),
    "noise": _of_each_joint(_noisy),
    "drift": _of_each_joint(lambda i, t: i + DRIFT_RATE * t, lambda i, t: i - DRIFT_RATE * t),
    "exchanged": [exchanged(j, k) for j, k in ((0, 1), (1, 2), (2, 3), (3, 4), (4, 5), (0, 5))],
    "late_100_to_300_ms": [shifted(delay) for delay in SHORT_DELAYS],
    "late_500_ms": [shifted(0.5)],
    "late_650_to_1000_ms": [shifted(delay) for delay in LONG_DELAYS],
    "late_1300_ms": [shifted(1.3)],
    "early_100_to_300_ms": [shifted(-delay) for delay in SHORT_DELAYS],
    "early_500_ms": [shifted(-0.5)],
    "early_650_to_1000_ms": [shifted(-delay) for delay in LONG_DELAYS],
    "early_1300_ms": [shifted(-1.3)],
}
"""By kind: one of each joint, sign, pair or time."""


@dataclass(frozen=True)
class Push:
    """A force of constant course at a point beside E, drawn at random.

    Attributes:
        course: one of COURSES.
        force: (M, 3) N on the robot, in axes of W.
        lever: (3,) m from E to the point, in axes of W.
    """

    course: str
    force: Array
    lever: Array

    @property
    def wrench(self) -> Array:
        """(M, 6) at E, moment first."""
        return np.concatenate([np.cross(self.lever, self.force), self.force], axis=1)


COURSES = ("held", "sine_1_hz", "sine_2_hz", "by_hand", "growing", "turning")


def push(seed: int, num_samples: int, T: float) -> Push:
    """Returns a push of `num_samples` samples of T s, of the course `seed % len(COURSES)`."""
    rng = np.random.default_rng(seed)
    t = T * np.arange(num_samples)
    along = _unit_vector(rng)
    size = rng.uniform(*FORCE_LIMITS)
    lever = rng.uniform(0.0, MAX_LEVER) * _unit_vector(rng)
    begin = np.clip(t / rng.uniform(0.05, 0.4), 0.0, 1.0)
    ramp = (begin * np.clip((t[-1] - t) / 0.2, 0.0, 1.0))[:, None]
    course = COURSES[seed % len(COURSES)]
    columns = t[:, None]
    if course == "held":
        shape = along * np.ones_like(columns)
    elif course == "sine_1_hz":
        shape = along * (0.5 - 0.5 * np.cos(2.0 * np.pi * columns))
    elif course == "sine_2_hz":
        shape = along * np.sin(4.0 * np.pi * columns)
    elif course == "by_hand":
        shape = _wandering(rng, num_samples, T)
    elif course == "growing":
        shape = along * np.clip(columns / 3.0, 0.0, 1.0)
    else:
        across = _unit_vector(rng)
        across -= along * (along @ across)
        across /= np.linalg.norm(across)
        shape = np.cos(2.0 * columns) * along + np.sin(2.0 * columns) * across
    return Push(course, size * ramp * shape, lever)


def _unit_vector(rng: np.random.Generator) -> Array:
    vector: Array = rng.normal(size=3)
    vector /= np.linalg.norm(vector)
    return vector


def _wandering(rng: np.random.Generator, num_samples: int, T: float) -> Array:
    """(num_samples, 3) noise behind two low-passes of .25 s, of which one axis has an rms of .6."""
    course: Array = rng.normal(size=(num_samples, 3))
    pole = float(np.exp(-T / 0.25))
    for _ in range(2):
        for k in range(1, num_samples):
            course[k] = pole * course[k - 1] + (1.0 - pole) * course[k]
    course *= 0.6 / course.std()
    return course
