"""Load identification: mass, centre of mass and inertia of a load, from joint torques.

A load adds a torque that is linear in its ten parameters to what the arm's model predicts. They are
found by generalised least squares of the model's residual, together with the drift that friction
may have made since (`models.calibration.friction_refresh`). The fit is made twice. The first
solution has a wide prior and shows where the centre of mass is. The second states the parameters
about that point, where a prior of the inertia follows from the mass.

The standard errors have three parts: the scatter of the torque, which is correlated over time,
errors of the arm's model, and errors of the torques per ampere. No motion with an unknown load
distinguishes the last two from another load. They are therefore not unknowns of the fit, which they
would bias. Their effect on the result is added to its covariance ("considered" parameters; Schmidt,
"Application of state-space methods to navigation problems", 1966).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.calibration.friction_refresh import FrictionDrift
from wrenchsight.models.calibration.load_parameters import (
    moved_parameters,
    realisable_inertia,
)
from wrenchsight.models.calibration.prior_least_squares import fit_with_prior
from wrenchsight.models.calibration.residual_noise import NUM_DRIFTS, ResidualRows, drift_columns
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.identification.torque_regression import NUM_INERTIAL
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot import rotational_inertia
from wrenchsight.models.robot.rotational_inertia import INERTIA, MASS, MOMENT

COM_PRIOR_SD = 0.3  # m, of a centre of mass from the flange: sd of the first solution's prior
# Radius of gyration of a load of 1 kg, m; others have the same density. A ball of this radius of
# gyration has a fourth of water's: tools and boxes are hollow.
GYRATION_FACTOR = 0.06
MIN_MASS_ERRORS = 3.0  # standard errors of its mass, above which a load is present
COM_DETERMINED_SD = 0.02  # m; beyond it the motion has not determined the centre of mass
MAX_COM_COORDINATE = 1.0  # m from the flange, of the point about which the second solution is made
_LEAST_MASS = 1e-9  # kg, for a division
_DIAGONAL_PLACES = rotational_inertia.INERTIA_PLACES[:3]  # of Ixx, Iyy, Izz


@dataclass(frozen=True)
class LoadPrior:
    """Prior of a load and of the torques per ampere.

    Attributes:
        mass: kg, sd of the load's mass about zero.
        gain: sd of each joint's torque per ampere, relative; 0 where a known weight has determined
            them.
    """

    mass: float
    gain: float = 0.03


@dataclass(frozen=True, eq=False)
class LoadRows:
    """A log's residual, and the torque per parameter of a load and of the model.

    Attributes:
        rows: the residual of the model without the load.
        load: (m, n, 10) N m per parameter in the flange's frame.
        model: (m, n, c) N m per uncertain parameter of the arm's model.
        model_sd: (c,) of these parameters.
    """

    rows: ResidualRows
    load: Array
    model: Array
    model_sd: Array

    @classmethod
    def joined(cls, parts: Sequence["LoadRows"]) -> "LoadRows":
        """Of several logs of one model."""
        rows = ResidualRows.joined([part.rows for part in parts])
        load = np.concatenate([part.load for part in parts])
        model = np.concatenate([part.model for part in parts])
        return cls(rows, load, model, parts[0].model_sd)

    def whitened(self, joint: int, load: Array, missed: Array | None = None) -> Array:
        """A joint's rows, whitened in time; not divided by the scale of a fit.

        Args:
            joint: its index.
            load: (m, L) N m per parameter of one load or more.
            missed: (m, M) N m per parameter of what the model misses; None: nothing (M = 0).

        Returns:
            (m, L + 3 n + M + c + 1) columns of load, drift (3 a joint), what is missed, model (c)
            and residual.
        """
        # A joint's rows depend on its own three changes of friction alone.
        drift = np.zeros((len(self.rows.t), NUM_DRIFTS * self.rows.num_joints))
        drift[:, drift_columns(joint)] = self.rows.drift[:, joint]
        columns = [load, drift, *([] if missed is None else [missed]), self.model[:, joint]]
        return self.rows.whitened(joint, np.hstack(columns))

    def __getitem__(self, part: slice | NDArray[np.bool_]) -> "LoadRows":
        """Returns the rows of `part`."""
        return LoadRows(self.rows[part], self.load[part], self.model[part], self.model_sd)


class LoadSds(NamedTuple):
    """Standard deviations of a load.

    Attributes:
        mass: kg.
        com: (3,) m.
        inertia: (6,) kg m^2, of Ixx, Iyy, Izz, Ixy, Ixz, Iyz.
    """

    mass: float
    com: Array
    inertia: Array

    @classmethod
    def of(cls, covariance: Array) -> "LoadSds":
        """Those of a covariance (10, 10) of mass, centre of mass and inertia."""
        sd = np.sqrt(np.diag(covariance))
        return cls(mass=float(sd[MASS]), com=sd[MOMENT], inertia=sd[INERTIA])


@dataclass(frozen=True, eq=False)
class LoadEstimate:
    """A load on the flange, in its axes.

    Attributes:
        mass: kg.
        com: (3,) m from the flange.
        inertia: (3, 3) kg m^2 about the centre of mass, as estimated; it may not be physical.
        covariance: (10, 10) of mass, com and Ixx, Iyy, Izz, Ixy, Ixz, Iyz.
        gain_covariance: (10, 10) the part of it that comes from the torques per ampere.
        inertia_prior_sd: (6,) kg m^2.
        parameters: (10,) in the flange's frame, as `models.calibration.load_parameters`.
        friction_change: (n, 3) of Coulomb, viscous and offset, found beside the load.
        scale: (n,) scatter of the residual relative to what the model states.
    """

    mass: float
    com: Array
    inertia: Array
    covariance: Array
    gain_covariance: Array
    inertia_prior_sd: Array
    parameters: Array
    friction_change: Array
    scale: Array

    @property
    def sd(self) -> LoadSds:
        """Of all causes."""
        return LoadSds.of(self.covariance)

    @property
    def sd_of_gains(self) -> LoadSds:
        """Of uncertain torques per ampere alone."""
        return LoadSds.of(self.gain_covariance)

    @property
    def is_present(self) -> bool:
        """Whether the load's mass is significantly above zero."""
        return self.mass > MIN_MASS_ERRORS * self.sd.mass

    @property
    def com_determined(self) -> NDArray[np.bool_]:
        """(3,) whether the motion determines the centre of mass along each axis of the flange."""
        return np.asarray(self.is_present & (self.sd.com < COM_DETERMINED_SD))

    def with_com_at_flange(self, unknown: NDArray[np.bool_]) -> "LoadEstimate":
        """Returns the load conditioned on a centre of mass at the flange's origin.

        The condition holds along the axes (3,) of `unknown`. The other values follow by their
        covariance with these.
        """
        if not unknown.any():
            return self
        fixed = 1 + np.flatnonzero(unknown)
        values = np.r_[self.mass, self.com, rotational_inertia.inertia_values(self.inertia)]
        gain = np.linalg.solve(self.covariance[np.ix_(fixed, fixed)], self.covariance[fixed])
        values = values - gain.T @ values[fixed]
        values[fixed] = 0.0
        inertia = rotational_inertia.inertia_matrix(values[INERTIA])
        return replace(self, mass=float(values[MASS]), com=values[MOMENT], inertia=inertia)

    @property
    def inertia_determined_share(self) -> Array:
        """(6,) share of the prior's variance that the motion has removed, 0 to 1."""
        remaining = (self.sd.inertia / self.inertia_prior_sd) ** 2
        return np.asarray(np.maximum(1.0 - remaining, 0.0))

    @property
    def realisable(self) -> Array:
        """(3, 3) kg m^2 about the centre of mass: the inertia nearby that is physical."""
        return realisable_inertia(self.inertia, max(self.mass, 1e-6))


def estimate_load(
    log: LoadRows,
    law: CoulombViscous,
    prior: LoadPrior,
    empty: LoadRows | None = None,
) -> LoadEstimate:
    """Estimates the load of a log.

    The load is fitted twice: with a vague prior, which gives its mass and about where its centre
    is; then about that point, with the inertia of a body of such a mass for its prior. A mass that
    is not significant leaves that point at the flange.

    Args:
        log: with the load.
        law: the friction coefficients behind the rows.
        prior: of the load's mass and of the torques per ampere.
        empty: a log without the load, of the same day. Its residual, as friction and as a weight
            at the flange, is then subtracted.
    """
    logs = [log] if empty is None else [log, empty]
    vague_sd = vague_spread(prior.mass)
    at_flange = _solve(
        logs, np.eye(NUM_INERTIAL), mean=np.zeros(NUM_INERTIAL), sd=vague_sd, law=law, prior=prior
    )
    parameters, mass_sd = at_flange.values[:NUM_INERTIAL], np.sqrt(at_flange.covariance[0, 0])
    mass = max(parameters[0], mass_sd)
    com = np.zeros(3)
    if parameters[0] > MIN_MASS_ERRORS * mass_sd:
        com = np.clip(parameters[MOMENT] / mass, -MAX_COM_COORDINATE, MAX_COM_COORDINATE)
    # Moment of inertia of a body of that mass, whose size goes with the cube root of the mass:
    # within twice itself; products within once. Mass and first moment stay vague.
    moment = mass * GYRATION_FACTOR**2 * mass ** (2.0 / 3.0)
    prior_mean, prior_sd = np.zeros(NUM_INERTIAL), vague_sd.copy()
    prior_mean[_DIAGONAL_PLACES] = moment
    prior_sd[INERTIA] = moment
    prior_sd[_DIAGONAL_PLACES] = 2.0 * moment
    frame = moved_parameters(np.eye(3), com)  # from a frame at the centre of mass to the flange's
    at_com = _solve(logs, frame, mean=prior_mean, sd=prior_sd, law=law, prior=prior)
    return _estimate(at_com, com, frame, prior_sd)


@dataclass(frozen=True, eq=False)
class _Solution:
    """Values of all unknowns: load (10), friction drift (3 n), weight in the empty log (10)."""

    values: Array
    covariance: Array
    gain_covariance: Array  # the part of it that comes from the torques per ampere
    scale: Array


def vague_spread(mass: float) -> Array:
    """(10,) sds of a load's parameters in the flange's frame, for an sd of its mass in kg."""
    return np.asarray(
        np.r_[mass, np.full(3, mass * COM_PRIOR_SD), np.full(6, mass * COM_PRIOR_SD**2)]
    )


def _solve(
    logs: list[LoadRows],
    frame: Array,
    *,
    mean: Array,
    sd: Array,
    law: CoulombViscous,
    prior: LoadPrior,
) -> _Solution:
    """The fit with the load's parameters in a frame from which `frame` leads to the flange's.

    Unknowns, in the order of the columns and values: the load (10), friction's drift (3 a joint),
    and, beside empty logs, what the model misses of the weight at the flange in all logs (10). The
    c parameters of the arm's model are not unknowns; their columns give the covariance that they
    add.

    Args:
        logs: the log with the load first; then logs of the arm without it.
        frame: (10, 10), the flange's parameters per parameter in the frame of the fit.
        mean, sd: (10,) prior of the load in the frame of the fit.
        law: the friction coefficients behind the rows.
        prior: of the load's mass and of the torques per ampere.
    """
    n = logs[0].rows.num_joints
    drift_sd = FrictionDrift().deviation(logs[0].rows, law).ravel()
    missed_sd = [vague_spread(prior.mass)] if len(logs) > 1 else []
    prior_sd = np.concatenate([sd, drift_sd, *missed_sd])
    k = len(prior_sd)  # unknowns
    blocks: list[Array] = []  # of each joint (m, k + 1): unknowns, residual
    considered: list[Array] = []  # of each joint (m, c): the model's parameters, in their sds
    for j in range(n):
        rows = _whitened_rows(logs, j, frame, k)
        blocks.append(np.hstack([rows.unknowns, rows.residual]))
        considered.append(rows.model * logs[0].model_sd)
    fit = fit_with_prior(blocks, prior_sd, np.concatenate([mean, np.zeros(k - NUM_INERTIAL)]))
    # Of each joint (k, m), how the solution responds to an error e of its whitened torque:
    # covariance A^T e / s^2, as the fit divides rows A and torque by the scale s.
    responses = [
        fit.covariance @ block[:, :-1].T / s**2 for block, s in zip(blocks, fit.scale, strict=True)
    ]
    # A gain that is wrong by prior.gain: the joint's torque of the load is wrong by that share.
    gain_effects = [
        prior.gain * response @ (block[:, :NUM_INERTIAL] @ fit.values[:NUM_INERTIAL])
        for response, block in zip(responses, blocks, strict=True)
    ]
    gain_covariance = sum(np.outer(effect, effect) for effect in gain_effects)
    # (k, c) change of the solution per sd of each parameter of the model.
    model_effects = sum(
        response @ columns for response, columns in zip(responses, considered, strict=True)
    )
    return _Solution(
        values=fit.values,
        covariance=fit.covariance + gain_covariance + model_effects @ model_effects.T,
        gain_covariance=np.asarray(gain_covariance),
        scale=fit.scale,
    )


class _WhitenedRows(NamedTuple):
    """One joint's m rows of all logs, whitened in time; not yet divided by the fit's scale.

    Attributes:
        unknowns: (m, k) columns of the unknowns.
        model: (m, c) columns of the parameters of the arm's model.
        residual: (m, 1).
    """

    unknowns: Array
    model: Array
    residual: Array


def _whitened_rows(logs: list[LoadRows], j: int, frame: Array, num_unknowns: int) -> _WhitenedRows:
    """Joint j's whitened rows of all logs.

    Args:
        logs, frame: as `_solve`.
        j: index of the joint.
        num_unknowns: k; their order is that of `_solve`.
    """
    parts = []
    for index, log in enumerate(logs):
        at_flange = log.load[:, j]
        load = at_flange @ frame if index == 0 else np.zeros_like(at_flange)
        # What the model misses of the weight at the flange is in all logs.
        parts.append(log.whitened(j, load, at_flange if len(logs) > 1 else None))
    whole = np.vstack(parts)  # columns as they went in, the residual behind them
    return _WhitenedRows(whole[:, :num_unknowns], whole[:, num_unknowns:-1], whole[:, -1:])


def _estimate(solution: _Solution, com: Array, frame: Array, prior_sd: Array) -> LoadEstimate:
    """Mass, centre of mass and inertia about it, from parameters about a point near it.

    Args:
        solution: its first ten values are mass, first moment (3) and inertia (6) about `com`, then
            3 a joint of friction's change.
        com: (3,) m in the flange's frame, near the centre of mass.
        frame: (10, 10) from parameters about `com` to those in the flange's frame.
        prior_sd: (10,) of the load's parameters about `com`.
    """
    values = solution.values[:NUM_INERTIAL]
    mass = float(values[MASS])
    divisor = mass if abs(mass) > _LEAST_MASS else _LEAST_MASS
    offset = values[MOMENT] / divisor  # of the centre of mass from `com`
    inertia = rotational_inertia.inertia_about_origin(values)
    inertia = inertia - rotational_inertia.point_inertia(mass, offset)
    # Derivatives of (m, c, Ixx, Iyy, Izz, Ixy, Ixz, Iyz), the order of the covariance, by the ten
    # parameters; the offset is small: what it adds to the inertia's is left out.
    slope = np.zeros((NUM_INERTIAL, NUM_INERTIAL))
    slope[MASS, MASS] = 1.0
    slope[MOMENT, MASS] = -offset / divisor
    slope[MOMENT, MOMENT] = np.eye(3) / divisor
    slope[range(10)[INERTIA], rotational_inertia.INERTIA_PLACES] = 1.0
    covariance = slope @ solution.covariance[:NUM_INERTIAL, :NUM_INERTIAL] @ slope.T
    gain_covariance = slope @ solution.gain_covariance[:NUM_INERTIAL, :NUM_INERTIAL] @ slope.T
    num_joints = len(solution.scale)
    changes = solution.values[NUM_INERTIAL : NUM_INERTIAL + NUM_DRIFTS * num_joints]
    return LoadEstimate(
        mass=mass,
        com=com + offset,
        inertia=inertia,
        covariance=covariance,
        gain_covariance=gain_covariance,
        inertia_prior_sd=prior_sd[rotational_inertia.INERTIA_PLACES],
        parameters=frame @ values,
        friction_change=changes.reshape(num_joints, NUM_DRIFTS),
        scale=solution.scale,
    )
