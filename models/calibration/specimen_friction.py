"""Friction of another specimen of a robot that is known: a fit with the known law as its prior.

Two robots of one make share kinematics, masses and the shape of their friction; its level is each
one's own, and changes with temperature and wear. What little motion there is rarely tells the
parameters of a law apart (how much of the level is load?), so each keeps to the known robot's
unless the motion says otherwise. Per joint, while it slides,

    tau_f - (Stribeck and cubic part, as known) = coulomb z + load |L| z + viscous v + offset
                                                  - gain tau_J

is linear in its parameters. The gain is the share by which the torque constant is too small.
Without a known force on the arm it cannot be told from the masses, nor from friction where that is
all that a drive works against: it stays zero unless the prior allows it and the joint carries
several times its friction.

The posterior is Gaussian; rows far off the others (shocks, vibration) weigh less, as under Cauchy
noise, by iterated reweighting. Rows of one motion err together, by ripple over position and by the
posture's gravity: each counts 1 / dependence^2.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.arrays import Array
from wrenchsight.models.friction.presliding_friction import PreslidingFriction
from wrenchsight.models.friction.velocity_friction import CoulombViscous, SemiParametricFriction

_ROUNDS = 20  # of reweighting; the weights settle within five
_NORMAL_MAD = 1.4826  # sd of a normal distribution over its median absolute deviation
_CARRIES = 3.0  # times its friction, above which a joint's load tells its torque constant
_LEAST_SPREAD = 1e-6  # of a parameter that the known law does not have
_FAR = 2.0  # sds, at which a row weighs half


@dataclass
class SpecimenPrior:
    """How much two specimens differ, as standard deviations."""

    coulomb: float = 0.5  # share of the known value
    viscous: float = 0.5  # share of the known value
    load: float = 0.015  # N m per N m
    offset: float = 0.5  # N m
    gain: float = 0.0  # share of the motor torque
    dependence: float = 5.0  # rows that stand for one


@dataclass(frozen=True, eq=False)
class SlidingRows:
    """What a sliding joint says of its friction; N rows.

    Attributes:
        side: (N,) -1 or 1.
        v: (N,) rad/s.
        load: (N,) transmitted torque, N m.
        torque: (N,) motor torque without rigid body and external torque, N m.
        drive: (N,) motor torque, N m.
    """

    side: Array
    v: Array
    load: Array
    torque: Array
    drive: Array

    @classmethod
    def joined(cls, parts: "Sequence[SlidingRows]") -> "SlidingRows":
        """The rows of several logs together."""
        columns = [[getattr(part, name) for part in parts] for name in cls.__dataclass_fields__]
        return cls(*(np.concatenate(c) if c else np.zeros(0) for c in columns))


@dataclass(frozen=True, eq=False)
class SpecimenFit:
    """The law of the other specimen.

    Attributes:
        law: of all joints.
        gain: (n,) share by which the torque constant is too small.
        deviation: (n, 5) posterior sd of coulomb, load, viscous, offset and gain.
        scatter: (n,) N m, sd of the rows; NaN for a joint without rows.
        rows: (n,) how many.
    """

    law: PreslidingFriction
    gain: Array
    deviation: Array
    scatter: Array
    rows: NDArray[np.int64]


def fit_specimen(
    known: PreslidingFriction, rows: Sequence[SlidingRows], prior: SpecimenPrior | None = None
) -> SpecimenFit:
    """Finds the parameters of each joint anew; a joint without rows keeps the known ones.

    Args:
        known: law of the known robot.
        rows: of each joint.
        prior: how much the two may differ.

    Raises:
        ValueError: not one entry of rows per joint.
    """
    prior = prior if prior is not None else SpecimenPrior()
    if len(rows) != known.num_joints:
        raise ValueError(f"{len(rows)} joints with rows, expected {known.num_joints}")
    plain = known.coulomb_viscous
    zero = np.zeros(known.num_joints)
    mean = np.stack([known.coulomb, known.load, plain.viscous, plain.offset, zero], axis=1)
    wide = np.stack(
        [
            prior.coulomb * known.coulomb,
            np.full(known.num_joints, prior.load),
            prior.viscous * plain.viscous,
            np.full(known.num_joints, prior.offset),
            np.full(known.num_joints, prior.gain),
        ],
        axis=1,
    )
    spread: Array = np.maximum(wide, _LEAST_SPREAD)
    values, deviation = mean.copy(), spread.copy()
    scatter = np.full(known.num_joints, np.nan)
    for j, own in enumerate(rows):
        if len(own.torque):
            curved = known.stribeck[j] * np.exp(-((own.v / known.stribeck_velocity[j]) ** 2))
            y = own.torque - curved * own.side - known.cubic[j] * own.v**3
            ones = np.ones_like(y)
            A = np.stack([own.side, np.abs(own.load) * own.side, own.v, ones, -own.drive], axis=1)
            if np.linalg.norm(own.load) < _CARRIES * np.linalg.norm(own.torque):
                spread[j, -1] = _LEAST_SPREAD
            values[j], deviation[j], scatter[j] = _posterior(
                A, y, mean[j], spread[j], prior.dependence
            )
    coulomb, load, viscous, offset, gain = values.T
    law = replace(
        known,
        coulomb=coulomb,
        load=np.clip(load, 0.0, 0.99),
        velocity_law=SemiParametricFriction(
            CoulombViscous(np.zeros(known.num_joints), viscous, offset)
        ),
    )
    return SpecimenFit(law, gain, deviation, scatter, np.array([len(own.torque) for own in rows]))


def _posterior(
    A: Array, y: Array, mean: Array, spread: Array, dependence: float
) -> tuple[Array, Array, float]:
    """Mean and sd of the parameters, and the sd of the rows, under Cauchy-like noise."""
    x, weight = mean, np.ones_like(y)
    scatter = max(float(np.std(y - A @ mean)), 1e-9)
    precision = np.diag(1.0 / spread**2)
    for _ in range(_ROUNDS):
        scale = (scatter * dependence) ** 2
        information = (A * weight[:, None]).T @ A / scale + precision
        seen = A.T @ (weight * y) / scale + precision @ mean
        x = np.asarray(np.linalg.solve(information, seen), dtype=np.float64)
        error = y - A @ x
        scatter = max(_NORMAL_MAD * float(np.median(np.abs(error))), 1e-9)
        weight = 1.0 / (1.0 + (error / (_FAR * scatter)) ** 2)
    return x, np.sqrt(np.diag(np.linalg.inv(information))), scatter
