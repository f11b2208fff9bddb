"""Friction laws, each fitted with the inertias to the same logs and cross-validated."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from wrenchsight.analyses.methods.identify.friction_fit import STRETCHES, FrictionFit, Solution
from wrenchsight.analyses.methods.identify.friction_training import TrainingConfig, train_networks
from wrenchsight.analyses.methods.identify.identification_config import (
    WITH_NETWORK,
    IdentificationConfig,
)
from wrenchsight.analyses.methods.identify.low_passed_logs import LowPassedLog
from wrenchsight.analyses.methods.identify.torque_fit import TorqueFit, pooled_rmse
from wrenchsight.analyses.study.shared_results import shared
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.coupled_friction import CoupledFriction
from wrenchsight.models.friction.friction_law import FrictionLaw
from wrenchsight.models.friction.friction_structure import FrictionStructure
from wrenchsight.models.friction.presliding_friction import PreslidingFriction
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.rigid_body.serial_chain import SerialChain

JACKKNIFE = 9  # stretches of logs of one motion, each left out once
EXTREME = 0.8  # share of the samples by speed, beyond which a joint's are fast


@dataclass(frozen=True, eq=False)
class LawFit:
    """One law, fitted."""

    law: str
    weights: Sequence[Array] | None  # of the squared residuals
    solution: Solution
    chain: SerialChain
    friction: FrictionLaw
    fit: tuple[TorqueFit, ...]
    cross_validation: tuple[TorqueFit, ...]
    extrapolated: tuple[Array, ...]  # see `LawFits.candidate`

    @property
    def cross_validated_rmse(self) -> Array:
        """(n,) N m, of held-out logs; of the fit itself where nothing was held out."""
        return pooled_rmse(self.cross_validation or self.fit)


@dataclass(frozen=True, eq=False)
class HeldOutModel:
    """A fit of all but one fold."""

    fold: Sequence[tuple[int, slice]]  # what it was not fitted on: (log, rows of its regression)
    chain: SerialChain  # with the inertias found
    friction: FrictionLaw  # the law found


@dataclass(frozen=True, eq=False)
class _LinearFit:
    """One law of STRUCTURES, its shape chosen, on all logs."""

    structure: FrictionStructure  # as chosen; that of the solution may have fewer load terms
    weights: Sequence[Array] | None
    solution: Solution


class LawFits:
    """Fits of laws to the same logs: none depends on which were fitted before."""

    def __init__(self, problem: FrictionFit, config: IdentificationConfig, logs: str) -> None:
        """Args: `logs` is a digest of the logs, their robot and the filters."""
        self._problem, self._runs, self._config = problem, problem.runs, config
        how = (config.num_passes, config.loss, config.consistent, config.selection)
        self._source = (logs, *how)
        self._linear: dict[str, _LinearFit] = {}

    def candidate(self, law: str) -> LawFit:
        """Fits one of LAWS, and cross-validates it where the configuration says so.

        Its `extrapolated` holds the RMSE (n,) in N m of the fastest and of the slowest samples of
        each joint (beyond EXTREME and 1 - EXTREME of them), predicted by fits without these
        samples; empty where nothing is cross-validated, or a single law is asked for.
        """
        runs = self._runs
        fit = self._linear_fit(WITH_NETWORK.get(law, law))
        chain, friction = self._realised(law, fit.solution, range(len(runs)))
        cross_validation: tuple[TorqueFit, ...] = ()
        extrapolated: tuple[Array, ...] = ()
        if self._problem.holds_out_logs and self._config.cross_validate:
            result = {
                k: runs[k].predict(entry.chain, entry.friction)
                for entry in self.held_out_models(law)
                for k, _ in entry.fold
            }
            cross_validation = tuple(result[k] for k in range(len(runs)))
        if self._config.cross_validate and self._config.friction == "best":
            # A network must not be trained where it is judged: the law below it is used there.
            extrapolated = self._extrapolated(WITH_NETWORK.get(law, law), fit)
        predicted = tuple(run.predict(chain, friction) for run in runs)
        return LawFit(
            law,
            fit.weights,
            fit.solution,
            chain,
            friction,
            predicted,
            cross_validation,
            extrapolated,
        )

    def held_out_models(self, law: str) -> list[HeldOutModel]:
        """Of each fold in turn, the fit of the others."""
        folds = self._problem.folds
        fit = self._linear_fit(WITH_NETWORK.get(law, law))
        models = []
        solutions = self._without_each_fold(fit, "friction_fit_held_out", STRETCHES)
        for fold, solution in zip(folds, solutions, strict=True):
            away = {k for k, _ in fold} if self._problem.holds_out_logs else set()
            others = [k for k in range(len(self._runs)) if k not in away]
            models.append(HeldOutModel(fold, *self._realised(law, solution, others)))
        return models

    def gravity_without_a_fold(self, law: str) -> Array:
        """Of fits without a fold each, what gravity depends on: (K, n, 5) mass, first moment and
        offset of each joint.

        Logs of one motion are taken in JACKKNIFE stretches: without a third of a log the postures
        that remain tell less than all of them, and the fits differ by more than they err.
        """
        fit = self._linear_fit(WITH_NETWORK.get(law, law))
        rates, found = self._problem.robot.motor_rates, []
        for solution in self._without_each_fold(fit, "friction_fit_jackknife", JACKKNIFE):
            inertial, _, coefficients = solution.parts()
            plain = solution.structure.law(coefficients).feedforward.coulomb_viscous
            found.append(np.hstack([inertial[:, :4], (rates.T @ plain.offset)[:, None]]))
        return np.stack(found)

    def _linear_fit(self, law: str) -> _LinearFit:
        if law not in self._linear:
            self._linear[law] = shared(
                "friction_fit", (*self._source, law), lambda: self._chosen_and_fitted(law)
            )
        return self._linear[law]

    def _chosen_and_fitted(self, law: str) -> _LinearFit:
        problem = self._problem
        structure = FrictionStructure.of(law, problem.robot.num_joints)
        if structure.has("stribeck"):  # the others have no shape
            structure = problem.choose(structure)
        problem = problem.reweighed(structure)
        return _LinearFit(structure, problem.weights, problem.fit(structure))

    def _without_each_fold(self, fit: _LinearFit, name: str, stretches: int) -> list[Solution]:
        """Of each fold in turn, the fit of the others."""
        problem = replace(self._problem, weights=fit.weights, stretches=stretches)
        folds = range(len(problem.folds))
        return shared(
            name,
            (*self._source, fit.structure, fit.weights),
            lambda: [problem.fit(fit.structure, [i for i in folds if i != k]) for k in folds],
        )

    def _extrapolated(self, law: str, fit: _LinearFit) -> tuple[Array, ...]:
        problem, runs = self._problem, self._runs
        rates = problem.robot.motor_rates
        speeds = [
            np.abs(run.v[entry.rows] @ rates.T)
            for run, entry in zip(runs, problem.regressions, strict=True)
        ]
        low, high = (np.quantile(np.vstack(speeds), x, axis=0) for x in (1.0 - EXTREME, EXTREME))
        weights = fit.weights or [np.ones_like(v) for v in speeds]

        def without(selected: Sequence[NDArray[np.bool_]]) -> tuple[SerialChain, FrictionLaw]:
            entry = [w * inside for w, inside in zip(weights, selected, strict=True)]
            solution = shared(
                "friction_fit_extrapolated",
                (*self._source, fit.structure, entry),
                lambda: replace(problem, weights=entry).fit(fit.structure),
            )
            return self._realised(law, solution, range(len(runs)))

        errors = []
        for selected, limit in (
            ([v <= high for v in speeds], high),
            ([v >= low for v in speeds], None),
        ):
            chain, friction = without(selected)
            if limit is not None:
                friction = bounded(friction, limit)
            squares, count = np.zeros(problem.robot.num_joints), np.zeros(problem.robot.num_joints)
            for run in runs:
                residual = run.predict(chain, friction).residual
                v = np.abs(run.v[run.used] @ rates.T)
                outside = v > high if limit is not None else v < low
                squares += (residual**2 * outside).sum(axis=0)
                count += outside.sum(axis=0)
            errors.append(np.sqrt(squares / np.maximum(count, 1.0)))
        return tuple(errors)

    def _realised(
        self, law: str, solution: Solution, logs: Sequence[int]
    ) -> tuple[SerialChain, FrictionLaw]:
        inertial, rotor, coefficients = solution.parts()
        chain = self._problem.robot.chain.with_inertial_parameters(inertial, rotor)
        friction = solution.structure.law(coefficients)
        robot = self._problem.robot
        if robot.is_coupled:
            if law in WITH_NETWORK:
                problem = "a network is trained on the friction of single joints, not of a coupling"
                raise InputError("identify", "friction", problem, f"take {WITH_NETWORK[law]}")
            friction = CoupledFriction(friction, robot.motor_rates)
        if law in WITH_NETWORK:
            runs = [self._runs[k] for k in logs]
            friction = shared(
                "friction_networks",
                (*self._source, tuple(logs), solution.structure, solution.x, self._config.seed),
                lambda: _with_networks(
                    solution.structure, coefficients, friction, chain, runs, self._config
                ),
            )
        fastest = np.max(
            [np.abs(run.v[run.used] @ robot.motor_rates.T).max(axis=0) for run in self._runs],
            axis=0,
        )
        return chain, bounded(friction, fastest)


def bounded(friction: FrictionLaw, speed: Array) -> FrictionLaw:
    """The law with a limit (n,) rad/s, of the motors, to what it was fitted on, if it has one."""
    if isinstance(friction, CoupledFriction):
        return replace(friction, law=bounded(friction.law, speed))
    if isinstance(friction, PreslidingFriction) and (speed > 0.0).all():
        return replace(friction, speed_limit=speed)
    return friction


def _with_networks(
    structure: FrictionStructure,
    coefficients: Sequence[Array],
    friction: FrictionLaw,
    chain: SerialChain,
    runs: Sequence[LowPassedLog],
    config: IdentificationConfig,
) -> FrictionLaw:
    """Trains near-zero networks on the friction that the model separates from the runs."""
    v, torque, group = [], [], []
    for k, run in enumerate(runs):
        rigid = np.asarray(chain.inverse_dynamics(run.q, run.v, run.vdot))
        whole = friction.torque_along(run.q, run.v, rigid)
        # The network replaces a function of velocity; the slip part stays as it is.
        slip = whole - friction.velocity_law.torque(run.v)
        v.append(run.v[run.used])
        torque.append((run.tau - run.match(rigid + slip))[run.used])
        group.append(np.full(int(run.used.sum()), k))
    trained = train_networks(
        np.vstack(v),
        np.vstack(torque),
        friction.velocity_law.coulomb_viscous,
        groups=np.concatenate(group),
        config=TrainingConfig(config.seed),
    )
    return structure.law(coefficients, trained.networks, trained.v_crit)
