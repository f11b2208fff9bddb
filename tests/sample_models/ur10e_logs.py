"""Logs of a UR10e whose friction and load are known, as calibrations are tested on them."""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike
from sample_models import harmonic_motion

from wrenchsight.models.calibration.load_identification import LoadRows
from wrenchsight.models.calibration.load_parameters import load_columns
from wrenchsight.models.calibration.residual_noise import ResidualRows
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot

COULOMB = np.array([15.0, 14.0, 6.0, 2.8, 3.3, 2.7])  # N m
VISCOUS = np.array([20.0, 18.0, 10.0, 3.6, 2.4, 3.2])  # N m s/rad
RESIDUAL_SD = np.array([1.0, 1.0, 0.6, 0.2, 0.2, 0.15])  # N m, of a real arm's size
# Of the rows without a residual.
LAW = CoulombViscous(
    np.array([16.0, 16.0, 7.0, 2.8, 3.3, 2.7]),
    np.array([22.0, 18.0, 10.0, 3.6, 2.4, 3.2]),
    np.zeros(6),
)


def model_of(ur10e: Robot) -> IdentifiedModel:
    """The arm's own inertias, COULOMB and VISCOUS, RESIDUAL_SD."""
    law = SemiParametricFriction(CoulombViscous(COULOMB, VISCOUS, np.zeros(6)))
    nominal = IdentifiedModel.nominal(ur10e)
    return replace(nominal, friction=law, residual_covariance=np.diag(RESIDUAL_SD**2))


def log_of(
    ur10e: Robot,
    seed: int,
    duration: float,
    rates: ArrayLike,
    size: float = 0.5,
    *,
    coulomb: Array = COULOMB,
    viscous: Array = VISCOUS,
    load: Array | None = None,
    ratio: ArrayLike = 1.0,
    moving: ArrayLike = range(6),
) -> Recording:
    """A log of 100 Hz with noise of .03 A.

    Args:
        duration: s.
        rates, size, moving: of `harmonic_motion`.
        coulomb, viscous: N m and N m s/rad, of the arm.
        load: (10,) parameters of what the flange carries.
        ratio: torque per ampere of the drives over that which the robot's file states.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, duration, 0.01)
    q, v, vdot = harmonic_motion(rng, t, rates, size, moving=moving)
    q += ur10e.home
    tau = ur10e.chain.inverse_dynamics(q, v, vdot) + coulomb * np.sign(v) + viscous * v
    if load is not None:
        tau = tau + load_columns(ur10e, q, v, vdot) @ load
    current = tau / (ratio * ur10e.torque_per_ampere * ur10e.current_sign)
    current = current + 0.03 * rng.normal(size=q.shape)
    return Recording(t=t, q=q, v=v, current=current, source=f"log_{seed}.csv")


def quiet_rows(
    ur10e: Robot,
    rng: np.random.Generator,
    duration: float,
    size: float = 0.5,
    moving: ArrayLike = range(6),
) -> LoadRows:
    """Ten rows a second of an arm of friction LAW that the model explains: no residual."""
    t = np.arange(0.0, duration, 0.1)
    q, v, vdot = harmonic_motion(rng, t, 0.9 * np.arange(1, 5), size, least=0.5, moving=moving)
    q += ur10e.home
    sliding = np.stack([np.sign(v), v, np.ones_like(v)], axis=2)
    level = np.broadcast_to(LAW.coulomb, v.shape)
    dry, viscous = LAW.coulomb * np.sign(v), LAW.viscous * v
    rows = ResidualRows(t, v, np.zeros_like(v), dry, viscous, level, sliding, RESIDUAL_SD)
    return LoadRows(rows, load_columns(ur10e, q, v, vdot), np.zeros((*v.shape, 0)), np.zeros(0))
