"""Specimen friction: fits another robot of a known make, with the known robot's law as prior.

Two robots of one make share kinematics, masses and the shape of their friction. The level of
friction differs from robot to robot, and changes with temperature and wear. A short motion rarely
determines all parameters of a law, such as the part of the level that is due to load. Each
parameter therefore keeps the known robot's value unless the motion contradicts it. Per joint, while
it slides,

    tau_f - (Stribeck and cubic part, as known) = coulomb z + load |L| z + viscous v + offset
                                                  + gain tau_ext

is linear in its parameters. The gain is the share by which the torque constants are too small.
Masses and friction, which explain gravity and free motion, are too small by the same share: only a
known force determines it. It is one number for the arm: the mean of the joints that the force
loads, weighted by their deviations.

The posterior is Gaussian. Outlying rows (shocks, vibration) have less weight, as under Cauchy
noise, by iterated reweighting. The errors of rows of one motion are correlated, by ripple over
position and by the posture's gravity: each row counts 1 / dependence^2.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.presliding_friction import PreslidingFriction
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.signals.bands import SD_PER_MEDIAN

_NUM_ROUNDS = 20  # of reweighting; the weights settle within five
_MAX_GAIN_SD_SHARE = 0.2  # of the prior's sd, below which a joint determines the gain
_LEAST_PRIOR_SD = 1e-6  # of a parameter that the known law does not have, or that is given
_LEAST_SCATTER = 1e-9  # N m, of rows without error
_MAX_LOAD = 0.99  # N m per N m: a law with one or more would hold any load
_HALF_WEIGHT_SDS = 2.0  # sds, at which a row weighs half


@dataclass
class SpecimenPrior:
    """Standard deviations of the difference between two specimens."""

    coulomb: float = 0.5  # share of the known value
    viscous: float = 0.5  # share of the known value
    load: float = 0.015  # N m per N m
    offset: float = 0.5  # N m
    gain: float = 0.1  # share of the external torque
    dependence: float = 5.0  # rows that stand for one


@dataclass(frozen=True, eq=False)
class SlidingRows:
    """Friction of a sliding joint; N rows.

    Attributes:
        side: (N,) -1 or 1.
        v: (N,) rad/s.
        load: (N,) transmitted torque, N m.
        torque: (N,) motor torque without rigid body and external torque, N m.
        external: (N,) torque from outside, N m, positive along the motion it causes.
    """

    side: Array
    v: Array
    load: Array
    torque: Array
    external: Array

    @classmethod
    def joined(cls, parts: "Sequence[SlidingRows]") -> "SlidingRows":
        """The rows of several logs together."""
        if not parts:
            return cls(**{name: np.zeros(0) for name in cls.__dataclass_fields__})
        columns = {
            name: np.concatenate([getattr(part, name) for part in parts])
            for name in cls.__dataclass_fields__
        }
        return cls(**columns)


class SpecimenSds(NamedTuple):
    """Posterior standard deviations of a law, (n,) each.

    Attributes:
        coulomb: N m.
        load: N m per N m.
        viscous: N m s/rad.
        offset: N m.
    """

    coulomb: Array
    load: Array
    viscous: Array
    offset: Array


@dataclass(frozen=True, eq=False)
class SpecimenFit:
    """The law of the other specimen.

    Attributes:
        law: law of all joints.
        gain: share by which the torque constants are too small; 0 where no force determines it.
        gain_sd: standard deviation of it.
        sd: of its parameters.
        scatter: (n,) N m, sd of the rows; NaN for a joint without rows.
        rows: (n,) how many.
    """

    law: PreslidingFriction
    gain: float
    gain_sd: float
    sd: SpecimenSds
    scatter: Array
    rows: NDArray[np.int64]


def fit_specimen(
    law_of_known: PreslidingFriction,
    rows: Sequence[SlidingRows],
    prior: SpecimenPrior | None = None,
) -> SpecimenFit:
    """Fits the parameters of each joint; a joint without rows keeps the known robot's.

    Stribeck and cubic part and the slip stay those of the known robot; a network near zero velocity
    is left out.

    Args:
        law_of_known: law of the known robot.
        rows: rows of each joint.
        prior: how much the two may differ.

    Raises:
        ValueError: not one entry of rows per joint.
    """
    prior = prior if prior is not None else SpecimenPrior()
    if len(rows) != law_of_known.num_joints:
        raise ValueError(f"{len(rows)} joints with rows, expected {law_of_known.num_joints}")
    gain, gain_sd = _gain(law_of_known, rows, prior)
    fitted = _fitted(law_of_known, rows, prior, gain)
    # In the order of `_Fitted`; the last is the gain, which has been given.
    coulomb, load, viscous, offset = fitted.values[:, :-1].T
    law = replace(
        law_of_known,
        coulomb=coulomb,
        load=np.clip(load, 0.0, _MAX_LOAD),
        # Coulomb friction is the slip elements'; the velocity law has none.
        velocity_law=SemiParametricFriction(
            CoulombViscous(np.zeros(law_of_known.num_joints), viscous, offset)
        ),
    )
    return SpecimenFit(
        law=law,
        gain=gain,
        gain_sd=gain_sd,
        sd=SpecimenSds(*fitted.deviation[:, :-1].T),
        scatter=fitted.scatter,
        rows=np.array([len(joint_rows.torque) for joint_rows in rows]),
    )


class _Fitted(NamedTuple):
    """Parameters (n, 5) of all joints, their sds (n, 5) and the rows' scatter (n,) in N m.

    In the order of A's columns: coulomb (N m), load (N m per N m), viscous (N m s/rad), offset
    (N m), gain (share of the external torque).
    """

    values: Array
    deviation: Array
    scatter: Array


def _gain(
    law_of_known: PreslidingFriction, rows: Sequence[SlidingRows], prior: SpecimenPrior
) -> tuple[float, float]:
    """The arm's gain and its sd; 0 and the prior's where no joint determines it."""
    if not any(part.external.any() for part in rows):
        return 0.0, prior.gain
    free = _fitted(law_of_known, rows, prior, None)
    gains, deviations = free.values[:, -1], free.deviation[:, -1]
    counts = deviations < _MAX_GAIN_SD_SHARE * prior.gain
    if not counts.any():
        return 0.0, prior.gain
    precision = 1.0 / deviations[counts] ** 2
    mean = np.sum(precision * gains[counts]) / np.sum(precision)
    return float(mean), float(np.sum(precision) ** -0.5)


def _fitted(
    law_of_known: PreslidingFriction,
    rows: Sequence[SlidingRows],
    prior: SpecimenPrior,
    gain: float | None,
) -> _Fitted:
    """Fits each joint by itself, its gain free or given; a joint without rows keeps the prior.

    The joint's torque less Stribeck and cubic part of the known robot is A times its unknowns, in
    the order of `_Fitted`. A given gain has a prior so narrow (_LEAST_PRIOR_SD) that it stays.

    Args:
        law_of_known: law of the known robot; its numbers are the prior's mean.
        rows: rows of each joint.
        prior: how much the two may differ.
        gain: of all joints; None: free, of prior mean 0.
    """
    plain, n = law_of_known.coulomb_viscous, law_of_known.num_joints
    mean_gain = np.full(n, 0.0 if gain is None else gain)
    mean = np.stack(
        [law_of_known.coulomb, law_of_known.load, plain.viscous, plain.offset, mean_gain], axis=1
    )
    sd = np.stack(
        [
            prior.coulomb * law_of_known.coulomb,
            np.full(n, prior.load),
            prior.viscous * plain.viscous,
            np.full(n, prior.offset),
            np.full(n, prior.gain if gain is None else 0.0),
        ],
        axis=1,
    )
    prior_sd: Array = np.maximum(sd, _LEAST_PRIOR_SD)
    values, deviation, scatter = mean.copy(), prior_sd.copy(), np.full(n, np.nan)
    for j, joint_rows in enumerate(rows):
        if not len(joint_rows.torque):
            continue
        curved = law_of_known.stribeck[j] * np.exp(
            -((joint_rows.v / law_of_known.stribeck_velocity[j]) ** 2)
        )
        y = joint_rows.torque - curved * joint_rows.side - law_of_known.cubic[j] * joint_rows.v**3
        ones = np.ones_like(y)
        A = np.stack(
            [
                joint_rows.side,
                np.abs(joint_rows.load) * joint_rows.side,
                joint_rows.v,
                ones,
                joint_rows.external,
            ],
            axis=1,
        )
        values[j], deviation[j], scatter[j] = _posterior(
            A, y, mean[j], prior_sd[j], prior.dependence
        )
    return _Fitted(values, deviation, scatter)


def _posterior(
    A: Array, y: Array, mean: Array, prior_sd: Array, dependence: float
) -> tuple[Array, Array, float]:
    """Mean and sd of the parameters, and the sd of the rows, under Cauchy-like noise."""
    x, weight = mean, np.ones_like(y)
    scatter = max(float(np.std(y - A @ mean)), _LEAST_SCATTER)
    precision = np.diag(1.0 / prior_sd**2)
    for _ in range(_NUM_ROUNDS):
        scale = (scatter * dependence) ** 2
        information = (A * weight[:, None]).T @ A / scale + precision
        right = A.T @ (weight * y) / scale + precision @ mean
        x = np.asarray(np.linalg.solve(information, right), dtype=np.float64)
        error = y - A @ x
        scatter = max(SD_PER_MEDIAN * float(np.median(np.abs(error))), _LEAST_SCATTER)
        weight = 1.0 / (1.0 + (error / (_HALF_WEIGHT_SDS * scatter)) ** 2)
    return x, np.sqrt(np.diag(np.linalg.inv(information))), scatter
