"""Least-squares fit of inertias and one friction law, and the choice of the law's shape.

The coefficients are linear and come from one least squares with the inertias. The law's shape is
not linear: slip displacement and Stribeck velocity of each joint, and which joints have a load
term. It is chosen on held-out logs, or on held-out thirds of a single one.

The rule is the one-standard-error rule (Breiman, Friedman, Olshen and Stone, Classification and
Regression Trees, 1984, section 3.4.3) on paired differences. Its candidates are the shapes whose
squared error exceeds the lowest by no more than one standard error of that difference over the
folds. Of these the smoothest is taken: the longest displacement, the highest Stribeck velocity, no
load term. The rule has no constant to tune.

The standard error needs MIN_FOLDS folds. Logs of two motions are therefore held out in
SHAPE_STRETCHES stretches: of two folds one that happens to be indifferent would allow any shape.

Friction below Coulomb's near zero velocity is creep, and a joint that slides has Coulomb's. A fall
that is fitted too wide takes some of it from a joint that slides slowly, more than its band allows
for. So a law without slip elements may fall within CREEP_VELOCITIES, too, but not below zero:
friction drives no joint.

The shape is chosen by plain squares, because Huber's weights, which come after, depend on it.
`ur10e-identification.lowest_error` measures what taking the lowest error itself would give.

The load term needs the torque that the gear transmits. In the fit it is the rigid-body torque of
the fit itself, iterated. The measured torque would let a joint that carries little but its
own friction explain that friction by itself: it halves the error of the UR10e's last joint in the
fit, but not on other logs.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wrenchsight.analyses.methods.identify.identification_config import SELECTIONS
from wrenchsight.analyses.methods.identify.low_passed_logs import LowPassedLog
from wrenchsight.models.friction.friction_structure import LARGEST_LOAD, FrictionStructure
from wrenchsight.models.friction.presliding_friction import slip_path
from wrenchsight.models.identification.base_parameters import (
    BaseParameters,
    find_base_parameters,
    independent_columns,
)
from wrenchsight.models.identification.physical_consistency import fit_consistent
from wrenchsight.models.identification.torque_regression import (
    ArmParameters,
    RegressionRows,
    TorqueEstimate,
    TorqueFactors,
    joined_factors,
    parameter_names,
    parameter_prior,
    realisation,
    solve,
    solve_values,
    split_terms,
)
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.numerics.ties import TIE_TOLERANCE, first_of_least
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.signals.bands import SD_PER_MEDIAN

DISPLACEMENT_CHOICES = (3e-5, 5e-5, 7e-5, 1e-4, 1.4e-4, 2e-4, 3e-4, 5e-4, 1e-3)  # rad or m
STRIBECK_VELOCITIES = (0.01, 0.02, 0.05, 0.1, 0.2, 0.4)  # rad/s or m/s
# A law without slip elements has no other term for the creep before a joint slides: rad/s or m/s.
CREEP_VELOCITIES = (0.002, 0.005)
LOAD_PASSES = 3
HUBER_PASSES = 4
NUM_STRETCHES = 3  # of a single log, to hold out one by one
MIN_FOLDS = 3  # folds whose spread is a standard error: of two folds it is their difference alone
SHAPE_STRETCHES = 9  # of logs of fewer motions, to choose a shape
REST_WEIGHT = 0.01  # of the squared residuals of a joint that rests in a whole log
HUBER_SCALES = 3.0  # scales of the residual from which it counts linearly, no longer squared
_MIN_SCALE = 1e-9  # N m, of residuals: a log without noise has none
_LEAST_RESIDUAL = 1e-300  # N m; any size below _MIN_SCALE gives the same weight
MIN_RESIDUAL_SD = 1e-12  # N m, that rows are divided by


@dataclass(frozen=True, eq=False)
class LawSolution:
    """The parameters of a fitted model.

    Attributes:
        structure: structure of its friction.
        base: combinations of parameters that the rows determine.
        estimate: estimate of these combinations.
        x: all parameters, in the order of `models.identification.torque_regression`.
        names: names of all parameters.
    """

    structure: FrictionStructure
    base: BaseParameters
    estimate: TorqueEstimate
    x: Array
    names: tuple[str, ...]

    def parts(self) -> ArmParameters:
        """The parameters apart."""
        return split_terms(self.x, [len(terms) for terms in self.structure.terms])


class _LogColumns:
    """The friction columns of one log, low-passed, at the rows of its regression.

    Sweeps, passes and laws need the same columns again and again. All are cached, those of the load
    term as long as the load stays the same array.
    """

    def __init__(self, q: Array, v: Array, regression: RegressionRows) -> None:
        """Args: `q`, `v` are those of the motors."""
        self._q, self._v, self._regression = q, v, regression
        self._rows: dict[tuple[str, int, tuple[float, ...]], Array] = {}
        self._load: Array | None = None

    def of(self, structure: FrictionStructure, load: Array | None) -> list[Array]:
        """Columns (m, terms) per joint; the load (N, n) N m, None for zero."""
        if load is None or load is not self._load:
            self._rows = {key: rows for key, rows in self._rows.items() if key[0] != "load"}
            self._load = load
        keys = [
            [(term, j, structure.column_shape(term, j)) for term in terms]
            for j, terms in enumerate(structure.terms)
        ]
        missing = list(
            dict.fromkeys(key for of_joint in keys for key in of_joint if key not in self._rows)
        )
        if missing:
            q, v = self._q, self._v
            load = np.zeros_like(v) if load is None else load
            z = slip_path(structure.displacement, q, v)
            columns = [structure.column(term, j, z, q, v, load) for term, j, _ in missing]
            (rows,) = self._regression.friction_rows([np.stack(columns, axis=1)])
            self._rows.update(zip(missing, rows.T, strict=True))
        return [np.stack([self._rows[key] for key in of_joint], axis=1) for of_joint in keys]


class FoldPart(NamedTuple):
    """Rows of one log that a fold holds out."""

    log: int  # index of the log
    rows: slice  # of its regression


@dataclass(frozen=True, eq=False)
class FrictionFit:
    """The least-squares problem of the logs that one model is to explain.

    Attributes:
        robot: that they were recorded on.
        runs: the logs, low-passed.
        regressions: regressions of these logs.
        num_passes: number of passes of weighted least squares.
        oversampling: rows per independent sample of the residual.
        loss: "huber" or "squares", see `reweighed`.
        consistent: whether `fit` returns a physical robot, see
            `models.identification.physical_consistency`.
        selection: one of `SELECTIONS`; the second takes the lowest held-out error, whatever
            the others' are.
        weights: weights of the squared residuals, by log (m, n); None: all one.
        resting: the joints (n,) that rest in a whole log, by log; None: none does.
        groups: the motion that each log shows; logs of one motion are held out together. None:
            each log shows its own.
        stretches: number of stretches in which logs of one motion are held out.
    """

    robot: Robot
    runs: Sequence[LowPassedLog]
    regressions: Sequence[RegressionRows]
    num_passes: int
    oversampling: float = 1.0
    loss: str = "squares"
    consistent: bool = False
    selection: str = SELECTIONS[0]
    weights: Sequence[Array] | None = None
    groups: Sequence[int] | None = None
    stretches: int = NUM_STRETCHES
    resting: Sequence[Flags] | None = None
    _columns_of_log: dict[int, _LogColumns] = field(default_factory=dict, repr=False)

    @cached_property
    def folds(self) -> list[list[FoldPart]]:
        """The folds of the cross-validation: what is held out together."""
        count = len(self.regressions)
        groups = range(count) if self.groups is None else self.groups
        if len(set(groups)) > 1:
            return [
                [FoldPart(k, slice(None)) for k in range(count) if groups[k] == group]
                for group in dict.fromkeys(groups)
            ]
        edges = [
            np.linspace(0, len(regression.rows), self.stretches + 1).astype(int)
            for regression in self.regressions
        ]
        return [
            [
                FoldPart(k, slice(int(log_edges[i]), int(log_edges[i + 1])))
                for k, log_edges in enumerate(edges)
            ]
            for i in range(self.stretches)
        ]

    @property
    def holds_out_logs(self) -> bool:
        """Whether a fold is one log or several, not stretches of them."""
        return all(part.rows == slice(None) for fold in self.folds for part in fold)

    def of_motors(self, x: Array) -> Array:
        """Positions or rates (N, n) of the motors, which friction depends on, from the joints'."""
        rates = self.robot.chain.motor_rates
        return x @ rates.T if rates.size else x

    def fit(self, structure: FrictionStructure, chosen: Sequence[int] | None = None) -> LawSolution:
        """Returns the model fitted on the folds `chosen` (all for None).

        A load coefficient outside [0, LARGEST_LOAD] is no property of a gear: the joint's term
        is left out.
        """
        solution = self._solve(structure.without("load"), None, chosen)
        while structure.has("load"):
            for _ in range(LOAD_PASSES):
                solution = self._solve(structure, self.loads(solution), chosen)
            coefficients = solution.parts().friction
            unfit = [
                j
                for j, terms in enumerate(structure.terms)
                if "load" in terms
                and not 0.0 <= coefficients[j][terms.index("load")] <= LARGEST_LOAD
            ]
            if not unfit:
                break
            structure = structure.without("load", unfit)
            solution = self._solve(structure.without("load"), None, chosen)
        return self._made_consistent(solution, chosen) if self.consistent else solution

    def _made_consistent(self, solution: LawSolution, chosen: Sequence[int] | None) -> LawSolution:
        structure = solution.structure
        factors = self.factors(solution)
        selected = factors if chosen is None else [factors[k] for k in chosen]
        sd = np.maximum(solution.estimate.residual_sd, MIN_RESIDUAL_SD) * np.sqrt(self.oversampling)
        rows = np.vstack([R / sd[j] for factor in selected for j, R in enumerate(factor.R)])
        prior, spread = parameter_prior(self.robot, [len(terms) for terms in structure.terms])
        v_max = np.max([np.abs(self.of_motors(log.v)).max(axis=0) for log in self.runs], axis=0)
        result = fit_consistent(rows[:, :-1], rows[:, -1], prior, spread, structure, v_max)
        values = solution.base.combination @ result.x
        return replace(solution, x=result.x, estimate=replace(solution.estimate, values=values))

    def factors(self, solution: LawSolution) -> list[TorqueFactors]:
        """The reduced rows of each fold, with the solution's friction columns."""
        columns = self.columns(solution.structure, self.loads(solution))
        return self._fold_factors(columns, self.weights)

    def loads(self, solution: LawSolution) -> list[Array]:
        """The rigid-body torque of each log, (N, n) N m, as the motors feel it."""
        inertial, rotor, _ = solution.parts()
        chain: SerialChain = self.robot.chain.with_inertial_parameters(inertial, rotor)
        loads = [np.asarray(chain.inverse_dynamics(log.q, log.v, log.vdot)) for log in self.runs]
        if self.robot.is_coupled:
            return [tau @ self.robot.coupling for tau in loads]
        return loads

    def columns(
        self, structure: FrictionStructure, loads: Sequence[Array] | None
    ) -> list[list[Array]]:
        """Friction columns per log and joint, low-passed, at the rows."""
        for k in range(len(self._columns_of_log), len(self.regressions)):
            q, v = self.of_motors(self.runs[k].q), self.of_motors(self.runs[k].v)
            self._columns_of_log[k] = _LogColumns(q, v, self.regressions[k])
        return [
            self._without_stiction(
                k,
                structure,
                self._columns_of_log[k].of(structure, None if loads is None else loads[k]),
            )
            for k in range(len(self.regressions))
        ]

    def _without_stiction(
        self, log: int, structure: FrictionStructure, columns: list[Array]
    ) -> list[Array]:
        """The columns of a log, those of a resting joint 0 but for its offset.

        Stiction holds it with any torque up to its Coulomb friction, and its velocity is noise,
        whose sign would be fitted to chance.
        """
        if self.resting is None or not self.resting[log].any():
            return columns
        return [
            rows * [term == "offset" for term in terms] if rests else rows
            for rows, terms, rests in zip(columns, structure.terms, self.resting[log], strict=True)
        ]

    def _with_rests(self, weights: Sequence[Array] | None) -> Sequence[Array] | None:
        """The weights by log, small for joints that rest: their stiction is not known."""
        if self.resting is None or not np.any(self.resting):
            return weights
        n = self.robot.num_joints
        by_log = weights or [np.ones((len(r.rows), n)) for r in self.regressions]
        return [
            rows * np.where(rests, REST_WEIGHT, 1.0)
            for rows, rests in zip(by_log, self.resting, strict=True)
        ]

    def held_out(self, structure: FrictionStructure, loads: Sequence[Array]) -> Array:
        """Mean squared error (folds, n) in (N m)^2, each fold predicted by a fit of the others."""
        columns = self.columns(structure, loads)
        factors = self._fold_factors(columns, None)
        independent = independent_columns(np.vstack([f.regressor for f in factors]))
        squares = np.empty((len(factors), self.robot.num_joints))
        for k, factor in enumerate(factors):
            values = solve_values(factors[:k] + factors[k + 1 :], independent, self.num_passes)
            for j, R in enumerate(factor.R):
                residual = R[:, -1] - R[:, independent] @ values
                squares[k, j] = residual @ residual / factor.num_rows
        return squares

    def choose(self, structure: FrictionStructure) -> FrictionStructure:
        """Returns the structure with its shape chosen, by plain least squares.

        Chosen joint by joint, by the error on held-out folds: the slip elements' displacement and
        Stribeck's velocity, in turn, and then whether friction depends on the load at all.

        Args:
            structure: which terms the law has, and the shape that the choice begins with; terms may
                be left out of it, none is added.
        """
        if len(self.folds) < MIN_FOLDS:  # SHAPE_STRETCHES of the logs are held out instead
            one_group = [0] * len(self.regressions)
            stretched = replace(self, groups=one_group, stretches=SHAPE_STRETCHES)
            return stretched.choose(structure)
        # Rigid-body torque, which the load term takes: one for all shapes, so that errors differ by
        # the shape alone.
        loads = self.loads(self.fit(structure))
        is_elastic = bool(structure.displacement.any())
        has_stribeck = structure.has("stribeck")
        velocities = (
            STRIBECK_VELOCITIES if is_elastic else (*CREEP_VELOCITIES, *STRIBECK_VELOCITIES)
        )
        # Two shapes are chosen in turn, twice: each with the other as it was chosen last.
        for _ in range(2 if is_elastic and has_stribeck else 1):
            if is_elastic:
                structure = self._sweep(structure, "displacement", DISPLACEMENT_CHOICES, loads)
            if has_stribeck:
                structure = self._sweep(structure, "stribeck_velocity", velocities, loads)
        # With the shape chosen, `fit` leaves out load terms that are no property of a gear; it does
        # so in `_opposing`, too.
        if is_elastic:
            structure = self.fit(structure).structure
        else:
            structure = self._opposing(structure, velocities)
        if structure.has("load"):
            candidates = (structure, structure.without("load"))
            errors = np.stack([self.held_out(candidate, loads) for candidate in candidates])
            # Joints of which the second candidate is taken.
            without_load = np.flatnonzero(self._smoothest(errors) == 1)
            structure = structure.without("load", without_load)
        return structure

    def _opposing(
        self, structure: FrictionStructure, velocities: Sequence[float]
    ) -> FrictionStructure:
        """The structure whose fitted friction opposes each joint also at a crawl.

        Where Coulomb's and Stribeck's coefficient add up to less than zero, the next higher
        Stribeck velocity is taken; after the highest the term is left out. Each round fits anew and
        raises a velocity or drops a term, so it ends. Load terms that `fit` leaves out stay out.

        Args:
            velocities: rad/s (m/s) to choose from, ascending.
        """
        while True:
            solution = self.fit(structure)
            structure = solution.structure
            coefficients = solution.parts().friction
            driven = []  # joints that friction drives at a crawl
            for j, (terms, values) in enumerate(zip(structure.terms, coefficients, strict=True)):
                crawl_friction = sum(
                    value
                    for term, value in zip(terms, values, strict=True)
                    if term in ("coulomb", "stribeck")
                )
                if "stribeck" in terms and crawl_friction < 0.0:
                    driven.append(j)
            if not driven:
                return structure
            stribeck_velocity = structure.stribeck_velocity.copy()
            without_term = []  # joints whose velocity is the highest already
            for j in driven:
                higher = [v for v in velocities if v > stribeck_velocity[j]]
                if higher:
                    stribeck_velocity[j] = min(higher)
                else:
                    without_term.append(j)
            structure = replace(structure, stribeck_velocity=stribeck_velocity)
            structure = structure.without("stribeck", without_term)

    def _sweep(
        self,
        structure: FrictionStructure,
        key: str,
        candidates: Sequence[float],
        loads: Sequence[Array],
    ) -> FrictionStructure:
        def with_shape(value: Array) -> FrictionStructure:
            shape: Any = {key: value}
            return replace(structure, **shape)

        n = structure.num_joints
        shapes = [with_shape(np.full(n, value)) for value in candidates]
        errors = np.stack([self.held_out(shape, loads) for shape in shapes])
        return with_shape(np.asarray(candidates)[self._smoothest(errors)])

    def _smoothest(self, errors: Array) -> NDArray[np.intp]:
        """The last candidate that the rule allows, by joint; errors are (candidates, folds, n)."""
        lowest = first_of_least(errors.mean(axis=1), axis=0)
        if self.selection == "lowest-error":
            return np.asarray(lowest)
        excess = errors - np.take_along_axis(errors, lowest[None, None, :], axis=0)
        standard_error = excess.std(axis=1, ddof=1) / np.sqrt(errors.shape[1])
        # The same but for rounding is no worse: of equals the smoothest.
        rounding = TIE_TOLERANCE * errors.mean(axis=1)
        good = excess.mean(axis=1) <= standard_error + rounding
        return np.asarray(len(errors) - 1 - np.argmax(good[::-1], axis=0))

    def _solve(
        self,
        structure: FrictionStructure,
        loads: Sequence[Array] | None,
        chosen: Sequence[int] | None,
    ) -> LawSolution:
        factors = self._fold_factors(self.columns(structure, loads), self.weights)
        names = parameter_names(self.robot.joint_names, structure.terms)
        base = find_base_parameters(np.vstack([f.regressor for f in factors]), names)
        selected = factors if chosen is None else [factors[k] for k in chosen]
        estimate = solve(selected, base, self.num_passes, self.oversampling)
        counts = [len(terms) for terms in structure.terms]
        x = realisation(self.robot, base, estimate.values, counts)
        return LawSolution(structure, base, estimate, x, tuple(names))

    def _fold_factors(
        self, columns: list[list[Array]], weights: Sequence[Array] | None
    ) -> list[TorqueFactors]:
        """The reduced rows of each fold."""
        return [
            joined_factors([self._part_factors(part, columns, weights) for part in fold])
            for fold in self.folds
        ]

    def _part_factors(
        self, part: FoldPart, columns: list[list[Array]], weights: Sequence[Array] | None
    ) -> TorqueFactors:
        weights = self._with_rests(None) if weights is None else weights
        log_weights = None if weights is None else weights[part.log]
        regression = self.regressions[part.log]
        return regression.factors(columns[part.log], part.rows, log_weights)

    def reweighed(self, structure: FrictionStructure) -> "FrictionFit":
        """Returns the same fit with the weights that iteration with this structure finds.

        They are Huber's, min(1, HUBER_SCALES s / |r|), and begin at the weights that this fit has.
        The loss "squares" leaves them as they are.

        s is 1.4826 times the joint's median absolute residual. Huber's and not Tukey's loss: the
        torque at reversals that no friction law explains lies far outside the bulk, too. Tukey's
        loss ignores what lies far outside, and then fits a law without those reversals. On the
        UR10e it costs a plain law 2 % of its held-out error, Huber's nothing.
        """
        if self.loss == "squares":
            return self
        result = self
        for _ in range(HUBER_PASSES):
            solution = result.fit(structure)  # may have left out load terms of the structure
            # Only the weights change from pass to pass: the regressions are this fit's own.
            columns = result.columns(solution.structure, result.loads(solution))
            residuals = [  # (rows, n) N m of each log
                regression.residual(log_columns, solution.x)
                for regression, log_columns in zip(self.regressions, columns, strict=True)
            ]
            scale = SD_PER_MEDIAN * np.median(np.abs(np.vstack(residuals)), axis=0)
            limit = HUBER_SCALES * np.maximum(scale, _MIN_SCALE)
            # Against a residual of zero, whose weight is 1.
            sizes = [np.maximum(np.abs(residual), _LEAST_RESIDUAL) for residual in residuals]
            weights = [np.minimum(1.0, limit / size) for size in sizes]
            result = replace(result, weights=self._with_rests(weights))
        return result
