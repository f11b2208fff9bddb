"""An arm with viscous friction alone: its model, and logs in which nothing touches it."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio
from numpy.typing import ArrayLike
from sample_models import torque_error
from scipy.signal import lfilter

from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.identified_model import (
    IdentifiedModel,
    LogSource,
    Provenance,
)
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot

TIME_STEP = 0.01  # s
VISCOUS = 20.0  # N m s/rad, of the model
NOISE_SD = 0.2  # N m; it correlates over a tenth of a second


def untouched_log(
    robot: Robot,
    num_rows: int,
    amplitude: float,
    rate: ArrayLike,
    more_friction: Callable[[Array, Array], Array],
) -> Recording:
    """A log of harmonic motion about home, torque by pinocchio.

    Args:
        amplitude: rad.
        rate: (n,) rad/s.
        more_friction: from q and v (N, n) to what friction has beyond the model's, N m.
    """
    model = pinocchio.buildModelFromXML(robot.urdf_text)
    model.armature = np.asarray(robot.reflected_inertia)
    data = model.createData()
    t, rate = np.asarray(TIME_STEP * np.arange(num_rows), float), np.asarray(rate, float)
    phase = t[:, None] * rate + np.arange(6)
    q = robot.home + amplitude * np.sin(phase)
    v, vdot = amplitude * rate * np.cos(phase), -amplitude * rate**2 * np.sin(phase)
    tau = np.array([pinocchio.rnea(model, data, *row) for row in zip(q, v, vdot, strict=True)])
    white = np.random.default_rng(0).normal(size=(num_rows, 6))
    tau += NOISE_SD * np.sqrt(1.0 - 0.9**2) * lfilter([1.0], [1.0, -0.9], white, axis=0)
    tau += VISCOUS * v + more_friction(q, v)
    current = tau / (robot.torque_per_ampere * robot.current_sign)
    return Recording(t=t, q=q, v=v, current=current, source="synthetic")


def save_viscous_model(robot: Robot, path: Path) -> Path:
    """Writes the arm's model, and returns its path."""
    zero = np.zeros(6)
    replace(
        IdentifiedModel.nominal(robot),
        friction=SemiParametricFriction(CoulombViscous(zero, VISCOUS + zero, zero)),
        residual_covariance=NOISE_SD**2 * np.eye(6),
        torque_error=torque_error(constant=NOISE_SD),
        provenance=Provenance(logs=[LogSource(name="a.csv")]),
    ).save(path)
    return path
