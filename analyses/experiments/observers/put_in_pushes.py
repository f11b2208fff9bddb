"""Pushes of a known force, put into the currents of a log in which nothing touched the arm.

The currents become those that the drives would have needed had the environment pushed: the motion
is as logged, the current is less by J^T F over the torque per ampere. Friction that depends on the
load stays what it was: a few percent of the push.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot

RISE = 0.03  # s, of a hand's push


def push_forces(
    num_samples: int,
    time_step: float,
    size: float,
    duration: float,
    pause: float,
    rng: np.random.Generator,
) -> Array:
    """(N, 3) N in axes of W: pushes in random directions, each after a pause.

    Args:
        num_samples: N, on a grid of `time_step` s.
        size: N.
        duration: s, of a push, with RISE at both ends.
        pause: s.
        rng: of the directions.
    """
    forces = np.zeros((num_samples, 3))
    length, every = round(duration / time_step), round((duration + pause) / time_step)
    k = np.arange(length)
    ramp = max(round(RISE / time_step), 1)
    profile = np.minimum(1.0, np.minimum(k + 1, length - k) / ramp)
    for begin in range(round(pause / time_step), num_samples - length, every):
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        forces[begin : begin + length] = size * profile[:, None] * direction
    return forces


def pushed(recording: Recording, robot: Robot, forces: ArrayLike) -> Recording:
    """The recording (N samples) as it would have been with forces (N, 3) N at E, in axes of W."""
    J = robot.chain.jacobian(recording.q)
    tau = np.einsum("kaj,ka->kj", J[:, 3:], np.asarray(forces, float))
    return replace(recording, current=recording.current - robot.motor_current(tau))
