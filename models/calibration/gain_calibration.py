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

Columns and values of the fit stand in this order: the arm's parameters x (as `parameter_columns`
has them), the loads' (10 each), u (n), friction's drift in each log (3 a joint).
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
from wrenchsight.models.calibration.residual_noise import (
    NUM_DRIFTS,
    ResidualRows,
    drift_columns,
)
from wrenchsight.models.friction.friction_law import FrictionLaw
from wrenchsight.models.friction.friction_structure import FrictionStructure
from wrenchsight.models.friction.sliding_friction import dry_and_viscous, sliding_columns, stiction
from wrenchsight.models.identification.torque_regression import (
    NUM_INERTIAL,
    parameter_columns,
    parameter_prior,
    split_terms,
)
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.robot import Robot

GAIN_SD = 0.3  # of u before any log: torque per ampere right within a third
LOAD_DEPENDENCE_SD = 0.1  # N m of friction per N m
WEIGHT_ERROR_SHARE = 1e-3  # relative error of a known weight
COM_SD = 1e-3  # m, of a known centre of mass
MAX_STEPS = 8  # of Gauss-Newton, if _STEP_TOLERANCE does not end them
_STEP_TOLERANCE = 1e-5  # change of u that ends the steps; u is known to 1e-3 at best
_MAX_LOAD_DEPENDENCE = 0.5  # N m per N m, of the law behind the noise model
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
        coefficients = split_terms(self.x, counts).friction
        deviations = split_terms(self.standard_deviation, counts).friction
        for j, terms in enumerate(self.structure.terms):
            if "load" in terms:
                k = terms.index("load")
                value[j], sd[j] = coefficients[j][k], deviations[j][k]
        return value, sd


class GainProblem:
    """The least squares of this module for given logs: `solve` runs it."""

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
            start: (p,) all parameters, of an identification of the unloaded logs.
            residual_sd: (n,) N m, of that identification.
        """
        self._robot, self._logs, self._loads = robot, logs, loads
        self._structure = structure
        self._sd = residual_sd
        self._counts = [len(terms) for terms in structure.terms]
        self._start = start
        # Places in the columns and values: the arm's (those of x by `_columns`), the loads', u. The
        # friction's drift stands behind them, log by log and three a joint.
        self._columns = parameter_columns(self._counts)
        self._arm = slice(0, len(start))
        self._all_loads = slice(len(start), len(start) + NUM_INERTIAL * len(loads))
        self._gains = slice(self._all_loads.stop, self._all_loads.stop + robot.num_joints)

    def solve(self) -> GainCalibration:
        """Runs the Gauss-Newton steps."""
        x, u = self._start, np.zeros(self._robot.num_joints)
        mean = [load.prior()[0] for load in self._loads]
        loads = np.stack(mean) if mean else np.zeros((0, NUM_INERTIAL))
        for _ in range(MAX_STEPS):
            fit = self._step(x, u, loads)
            previous_u, u = u, fit.values[self._gains]
            x, loads = fit.values[self._arm], fit.values[self._all_loads].reshape(loads.shape)
            if np.abs(u - previous_u).max() < _STEP_TOLERANCE:
                break
        deviation = fit.standard_deviation
        return GainCalibration(
            ratio=np.exp(u),
            log_covariance=fit.covariance[self._gains, self._gains],
            x=x,
            standard_deviation=deviation[self._arm],
            structure=self._structure,
            loads=loads,
            load_sd=deviation[self._all_loads].reshape(loads.shape),
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
        for j, terms in enumerate(self._structure.terms):
            for column, term in zip(self._columns.friction[j], terms, strict=True):
                sd = LOAD_DEPENDENCE_SD if term == "load" else float(self._robot.effort_limit[j])
                spread[column] = sd
        priors = [load.prior() for load in self._loads]
        return (
            np.concatenate([mean, *(m for m, _ in priors), np.zeros(n)]),
            np.concatenate([spread, *(s for _, s in priors), np.full(n, GAIN_SD)]),
        )

    def _step(self, x: Array, u: Array, loads: Array) -> PriorFit:
        """One linearised fit about x, u and the loads; values in the order of this module.

        Of joint j tau = exp(-u_j) A x, the loads among x, is linear in x. In u_j it is linearised:
        with the column g = -exp(-u_j) A x of the present x and u_j, the rows are

            tau + g u_j = exp(-u_j) A x_new + g u_new

        Args:
            x: (p,) parameters of the arm.
            u: (n,).
            loads: (L, 10) in the flange's frame.
        """
        n, num_logs = self._robot.num_joints, len(self._logs)
        inertial, rotor, coefficients = split_terms(x, self._counts)
        law = self._structure.law(self._within(coefficients))
        chain = self._robot.chain.with_inertial_parameters(inertial, rotor)
        mean, prior_sd = self._prior
        first_drift = self._gains.stop
        present = np.concatenate([x, loads.ravel(), np.zeros(n)])  # u's columns are still zero
        whitened: list[list[Array]] = [[] for _ in range(n)]
        drift_sd = np.zeros((num_logs, n, 3))
        for index, (log, (rigid, load)) in enumerate(zip(self._logs, self._rigid, strict=True)):
            carried = np.asarray(chain.inverse_dynamics(log.q, log.v, log.vdot))
            if log.load is not None:
                columns = load_columns(self._robot, log.q, log.v, log.vdot)
                carried = carried + columns @ loads[log.load]
            friction = self._structure.columns(log.q, log.v, carried)
            rows = self._torque_rows(log, law, carried)
            drift_sd[index] = _LOG_DRIFT.deviation(rows, law.coulomb_viscous)
            for j in range(n):
                # Columns of other joints, loads and logs stay zero.
                A = np.zeros((len(rows.t), first_drift + NUM_DRIFTS * n * num_logs))
                A[:, self._columns.inertial.ravel()] = rigid[:, j, :-1]
                A[:, self._columns.rotor[j]] = rigid[:, j, -1]  # behind the links'
                A[:, self._columns.friction[j]] = log.low_pass(friction[j])[log.rows]
                if log.load is not None:
                    first = self._all_loads.start + NUM_INERTIAL * log.load
                    A[:, first : first + NUM_INERTIAL] = load[:, j]
                predicted = A[:, :first_drift] @ present  # u's slope leaves the small drift out
                # Behind `first_drift` stand the changes of friction, log by log.
                A[:, first_drift:][:, drift_columns(n * index + j)] = rows.drift[:, j]
                A *= np.exp(-u[j])
                gain = self._gains.start + j
                A[:, gain] = -np.exp(-u[j]) * predicted
                whitened_rows = rows.whitened(j, A)
                # The last column is the torque: g u_j of it, as above.
                whitened_rows[:, -1] += whitened_rows[:, gain] * u[j]
                whitened[j].append(whitened_rows)
        return fit_with_prior(
            [np.vstack(rows_of_joint) for rows_of_joint in whitened],
            np.concatenate([prior_sd, drift_sd.ravel()]),
            np.concatenate([mean, np.zeros(drift_sd.size)]),
        )

    def _torque_rows(self, log: CalibrationLog, law: FrictionLaw, carried: Array) -> ResidualRows:
        """Rows whose right side is the whole torque of the log, not a residual.

        Args:
            log: N samples, of which `log.rows` are used.
            law: friction, for the covariance of the rows.
            carried: (N, n) N m that the gears transmit.
        """

        def low_passed(torque: Array) -> Array:
            return log.low_pass(torque)[log.rows]

        dry, viscous = dry_and_viscous(law, log.q, log.v, carried)
        return ResidualRows(
            t=log.t[log.rows],
            v=log.v[log.rows],
            residual=log.tau[log.rows],
            dry=low_passed(dry),
            viscous=low_passed(viscous),
            stiction=np.abs(low_passed(stiction(law, carried))),  # a low-pass may overshoot
            sliding=low_passed(sliding_columns(law, log.q, log.v, carried)),
            sd=self._sd,
        )

    def _within(self, coefficients: list[Array]) -> list[Array]:
        """The coefficients with load terms clipped to a valid law's, for the noise model alone."""
        bounded_coefficients = []
        for values, terms in zip(coefficients, self._structure.terms, strict=True):
            bounded = values.copy()
            if "load" in terms:
                k = terms.index("load")
                bounded[k] = np.clip(bounded[k], 0.0, _MAX_LOAD_DEPENDENCE)
            bounded_coefficients.append(bounded)
        return bounded_coefficients
