"""Gain calibration: torque per ampere of every joint, from logs with a load of known weight.

Without a known weight no log determines torque: an arm with twice the masses, twice the friction
and twice the torque per ampere has the same currents. A known weight on the flange fixes the scale
of the joints that carry it. Masses that several joints carry relate the scales of these joints.
With u = log of the true over the stated torque per ampere, the torque that the stated constants
give is

    tau = exp(-u) (Y pi + rotor vdot + friction + Y_load pi_load),

linear in all but u, and solved for all at once by Gauss-Newton steps of generalised least squares
(`models.calibration.residual_noise`). Each log's friction may have drifted a little from the
others' (`models.calibration.friction_refresh`). Friction that grows with the torque of a gear takes
that torque, load included, from the previous step.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.calibration.friction_refresh import FrictionDrift
from wrenchsight.models.calibration.load_identification import COM_PRIOR_SD
from wrenchsight.models.calibration.load_parameters import body_parameters, load_columns
from wrenchsight.models.calibration.prior_least_squares import PriorFit, fit_with_prior
from wrenchsight.models.calibration.residual_noise import ResidualRows
from wrenchsight.models.friction.friction_structure import FrictionStructure
from wrenchsight.models.friction.sliding_friction import dry_and_viscous, sliding_columns, stiction
from wrenchsight.models.identification.torque_regression import parameter_prior, split_terms
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.robot import Robot

GAIN_SD = 0.3  # of u before any log: torque per ampere right within a third
LOAD_DEPENDENCE_SD = 0.1  # N m of friction per N m
WEIGHT_ERROR_SHARE = 1e-3  # relative error of a known weight
COM_SD = 1e-3  # m, of a known centre of mass
MAX_STEPS = 8
_STEP_TOLERANCE = 1e-5  # change of u that ends the steps
_NUM_INERTIAL = 10
_LOG_DRIFT = FrictionDrift(viscous=0.1)  # of friction from log to log


@dataclass(frozen=True)
class KnownLoad:
    """A weighed body on the flange.

    Attributes:
        mass: kg, positive.
        com: (3,) m in the flange's frame; None where it is not known.
    """

    mass: float
    com: tuple[float, float, float] | None = None

    def prior(self) -> tuple[Array, Array]:
        """Mean and sd (10,) of its parameters in the flange's frame."""
        size = self.mass * COM_PRIOR_SD**2
        if self.com is None:
            mean = np.r_[self.mass, np.zeros(9)]
            sd = np.r_[
                WEIGHT_ERROR_SHARE * self.mass,
                np.full(3, self.mass * COM_PRIOR_SD),
                np.full(6, size),
            ]
            return mean, sd
        mean = body_parameters(self.mass, np.array(self.com), np.zeros((3, 3)))
        sd = np.r_[WEIGHT_ERROR_SHARE * self.mass, np.full(3, COM_SD * self.mass), np.full(6, size)]
        return mean, sd


@dataclass(frozen=True, eq=False)
class CalibrationLog:
    """One low-passed log.

    Attributes:
        t: (N,) s.
        q: (N, n) rad (m), as v and vdot.
        v: (N, n).
        vdot: (N, n).
        tau: (N, n) N m that the stated torques per ampere give.
        low_pass: along time; columns computed from q, v and vdot pass it.
        rows: (m,) samples that are used.
        load: index of the known load that the arm carries; None for no load.
    """

    t: Array
    q: Array
    v: Array
    vdot: Array
    tau: Array
    low_pass: Callable[[Array], Array]
    rows: NDArray[np.intp]
    load: int | None = None


@dataclass(frozen=True, eq=False)
class GainCalibration:
    """Estimates of drives, friction and loads.

    Attributes:
        ratio: (n,) true over stated torque per ampere.
        log_covariance: (n, n) of its logarithm.
        x: all parameters of arm and friction, in true torque, as
            `wrenchsight.models.identification.torque_regression`.
        standard_deviation: standard deviation of x.
        structure: structure of the friction.
        loads: (l, 10) parameters of the loads in the flange's frame.
        load_sd: (l, 10).
    """

    ratio: Array
    log_covariance: Array
    x: Array
    standard_deviation: Array
    structure: FrictionStructure
    loads: Array
    load_sd: Array

    @property
    def ratio_sd(self) -> Array:
        """(n,) of the ratio."""
        return np.asarray(self.ratio * np.sqrt(np.diag(self.log_covariance)))

    @property
    def least_known(self) -> tuple[Array, float]:
        """The least determined combination of log ratios, a unit vector (n,), and its sd."""
        values, vectors = np.linalg.eigh(self.log_covariance)
        worst = vectors[:, -1] * np.sign(vectors[:, -1].sum() or 1.0)
        return worst, float(np.sqrt(values[-1]))

    @property
    def load_dependence(self) -> tuple[Array, Array]:
        """(n,) N m of friction per N m transmitted, and its sd; NaN for a joint without it."""
        n = self.structure.num_joints
        value, sd = np.full(n, np.nan), np.full(n, np.nan)
        counts = [len(terms) for terms in self.structure.terms]
        _, _, coefficients = split_terms(self.x, counts)
        _, _, deviations = split_terms(self.standard_deviation, counts)
        for j, terms in enumerate(self.structure.terms):
            if "load" in terms:
                k = terms.index("load")
                value[j], sd[j] = coefficients[j][k], deviations[j][k]
        return value, sd


class GainProblem:
    """The least squares of this module for given logs."""

    def __init__(
        self,
        robot: Robot,
        logs: Sequence[CalibrationLog],
        loads: Sequence[KnownLoad],
        structure: FrictionStructure,
        start: Array,
        residual_sd: Array,
    ) -> None:
        """Prepares the fit.

        Args:
            robot: with the stated torques per ampere.
            logs: unloaded and loaded ones.
            loads: the loads that `CalibrationLog.load` is an index of.
            structure: friction terms and shape.
            start: all parameters, of an identification of the unloaded logs.
            residual_sd: (n,) N m, of that identification.
        """
        self._robot, self._logs, self._loads = robot, logs, loads
        self._structure = structure
        self._sd = residual_sd
        self._counts = [len(terms) for terms in structure.terms]
        self._start = start

    def solve(self) -> GainCalibration:
        """Runs the Gauss-Newton steps."""
        n, p = self._robot.num_joints, len(self._start)
        x, u = self._start, np.zeros(n)
        mean = [load.prior()[0] for load in self._loads]
        loads = np.stack(mean) if mean else np.zeros((0, _NUM_INERTIAL))
        for _ in range(MAX_STEPS):
            fit = self._step(x, u, loads)
            previous_u, u = u, fit.values[p + loads.size : p + loads.size + n]
            x, loads = fit.values[:p], fit.values[p : p + loads.size].reshape(loads.shape)
            if np.abs(u - previous_u).max() < _STEP_TOLERANCE:
                break
        deviation = fit.standard_deviation
        gains = slice(p + loads.size, p + loads.size + n)
        return GainCalibration(
            ratio=np.exp(u),
            log_covariance=fit.covariance[gains, gains],
            x=x,
            standard_deviation=deviation[:p],
            structure=self._structure,
            loads=loads,
            load_sd=deviation[p : p + loads.size].reshape(loads.shape),
        )

    @cached_property
    def _rigid(self) -> list[tuple[Array, Array]]:
        """For each log regressors, low-passed: (m, n, 10 n + 1) of links and rotor, (m, n, 10) of
        the load.
        """
        regressors = []
        for log in self._logs:
            Y = self._robot.chain.regressor(log.q, log.v, log.vdot)
            links_and_rotor = np.concatenate([Y, log.vdot[:, :, None]], axis=2)
            load = load_columns(self._robot, log.q, log.v, log.vdot)
            regressors.append(
                (log.low_pass(links_and_rotor)[log.rows], log.low_pass(load)[log.rows])
            )
        return regressors

    @cached_property
    def _prior(self) -> tuple[Array, Array]:
        """Mean and sd of x, the loads and u."""
        n = self._robot.num_joints
        mean, spread = parameter_prior(self._robot, self._counts)
        start = _NUM_INERTIAL * n
        for j, terms in enumerate(self._structure.terms):
            for k, term in enumerate(terms):
                sd = LOAD_DEPENDENCE_SD if term == "load" else float(self._robot.effort_limit[j])
                spread[start + 1 + k] = sd
            start += 1 + len(terms)
        priors = [load.prior() for load in self._loads]
        return (
            np.concatenate([mean, *(m for m, _ in priors), np.zeros(n)]),
            np.concatenate([spread, *(s for _, s in priors), np.full(n, GAIN_SD)]),
        )

    def _step(self, x: Array, u: Array, loads: Array) -> PriorFit:
        """One linearised fit about x, u and the loads.

        Unknowns, in the order of columns and of the fit's values: x (p,): inertial parameters (10 a
        link), then joint by joint rotor and friction terms; loads (10 each); u (n,): logarithms of
        the gains' factors; friction's drift, 3 a joint in each log.

        Args:
            x: (p,).
            u: (n,).
            loads: (L, 10) in the flange's frame.
        """
        n, p, num_logs = self._robot.num_joints, len(x), len(self._logs)
        counts = self._counts
        inertial, rotor, coefficients = split_terms(x, counts)
        law = self._structure.law(self._within(coefficients))
        chain = self._robot.chain.with_inertial_parameters(inertial, rotor)
        mean, spread = self._prior
        drift_start = p + loads.size + n
        width = drift_start + 3 * n * num_logs
        starts = _NUM_INERTIAL * n + np.concatenate([[0], np.cumsum([1 + c for c in counts])])
        whitened: list[list[Array]] = [[] for _ in range(n)]
        drift = np.zeros((num_logs, n, 3))
        for index, (log, (rigid, load)) in enumerate(zip(self._logs, self._rigid, strict=True)):
            carried = np.asarray(chain.inverse_dynamics(log.q, log.v, log.vdot))
            if log.load is not None:
                columns = load_columns(self._robot, log.q, log.v, log.vdot)
                carried = carried + columns @ loads[log.load]
            friction = self._structure.columns(log.q, log.v, carried)
            parts = (
                *dry_and_viscous(law, log.q, log.v, carried),
                stiction(law, carried),
                sliding_columns(law, log.q, log.v, carried),
            )
            dry, viscous, level, sliding = (log.low_pass(part)[log.rows] for part in parts)
            t, v = log.t[log.rows], log.v[log.rows]
            tau = log.tau[log.rows]
            rows = ResidualRows(t, v, tau, dry, viscous, np.abs(level), sliding, self._sd)
            drift[index] = _LOG_DRIFT.deviation(rows, law.coulomb_viscous)
            # tau = exp(-u_j) A x, the loads among x: linear in x, linearised in u about its value.
            for j in range(n):
                A = np.zeros((len(t), width))
                A[:, : _NUM_INERTIAL * n] = rigid[:, j, :-1]
                A[:, starts[j]] = rigid[:, j, -1]
                A[:, starts[j] + 1 : starts[j + 1]] = log.low_pass(friction[j])[log.rows]
                if log.load is not None:
                    place = p + _NUM_INERTIAL * log.load
                    A[:, place : place + _NUM_INERTIAL] = load[:, j]
                predicted = A[:, :drift_start] @ np.concatenate([x, loads.ravel(), np.zeros(n)])
                place = drift_start + 3 * (n * index + j)
                A[:, place : place + 3] = rows.drift[:, j]
                A *= np.exp(-u[j])
                A[:, p + loads.size + j] = -np.exp(-u[j]) * predicted
                whitened_rows = rows.whitened(j, A)
                whitened_rows[:, -1] += whitened_rows[:, p + loads.size + j] * u[j]
                whitened[j].append(whitened_rows)
        return fit_with_prior(
            [np.vstack(rows_of_joint) for rows_of_joint in whitened],
            np.concatenate([spread, drift.ravel()]),
            np.concatenate([mean, np.zeros(drift.size)]),
        )

    def _within(self, coefficients: list[Array]) -> list[Array]:
        """The coefficients with load terms clipped to a valid law's, for the noise model alone."""
        bounded_coefficients = []
        for values, terms in zip(coefficients, self._structure.terms, strict=True):
            bounded = values.copy()
            if "load" in terms:
                k = terms.index("load")
                bounded[k] = np.clip(bounded[k], 0.0, 0.5)
            bounded_coefficients.append(bounded)
        return bounded_coefficients
