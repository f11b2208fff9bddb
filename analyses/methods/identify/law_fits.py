"""Fits of friction laws with the inertias, all to the same logs, and their cross-validation."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from wrenchsight.analyses.methods.identify.friction_fit import (
    NUM_STRETCHES,
    FoldPart,
    FrictionFit,
    LawSolution,
)
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

NUM_JACKKNIFE = 9  # stretches of logs of one motion, each left out once
FAST_SHARE = 0.8  # share of the samples by speed, beyond which a joint's are fast


@dataclass(frozen=True, eq=False)
class LawFit:
    """A fit of one friction law with its errors.

    Attributes:
        law: its name.
        weights: weights of the squared residuals, by log (m, n); None: all one.
        solution: all parameters.
        chain: the arm with the fitted inertias.
        friction: the fitted law.
        fit: measured and predicted torque of each log.
        cross_validation: the same, each log predicted from the others; empty where none is.
        extrapolated: see `LawFits.candidate`.
    """

    law: str
    weights: Sequence[Array] | None
    solution: LawSolution
    chain: SerialChain
    friction: FrictionLaw
    fit: tuple[TorqueFit, ...]
    cross_validation: tuple[TorqueFit, ...]
    extrapolated: tuple[Array, ...]

    @property
    def cross_validated_rmse(self) -> Array:
        """(n,) N m, of held-out logs; of the fit itself where nothing was held out."""
        return pooled_rmse(self.cross_validation or self.fit)


@dataclass(frozen=True, eq=False)
class HeldOutModel:
    """A fit of all folds but one."""

    fold: Sequence[FoldPart]  # that it was not fitted on
    chain: SerialChain  # with the fitted inertias
    friction: FrictionLaw  # the fitted law


@dataclass(frozen=True, eq=False)
class _Realised:
    """A solution as an arm with friction."""

    chain: SerialChain
    friction: FrictionLaw


@dataclass(frozen=True, eq=False)
class _LinearFit:
    """A fit of one law of STRUCTURES to all logs, with its shape chosen."""

    structure: FrictionStructure  # as chosen; that of the solution may have fewer load terms
    weights: Sequence[Array] | None
    solution: LawSolution


class LawFits:
    """Fits of friction laws to the same logs: no fit depends on which were made before it."""

    def __init__(self, problem: FrictionFit, config: IdentificationConfig, logs: str) -> None:
        """Args: `logs` is a digest of the logs, their robot and the filters."""
        self._problem, self._logs, self._config = problem, problem.runs, config
        # All that a fit depends on beside its law: the key of what is shared within a study.
        self._source = (
            logs,
            config.num_passes,
            config.loss,
            config.consistent,
            config.selection,
        )
        self._linear: dict[str, _LinearFit] = {}

    def candidate(self, law: str) -> LawFit:
        """Fits one of LAWS, and cross-validates it where the configuration states so.

        A law with a network is the linear law below it, fitted, with networks trained on top: its
        `weights` and `solution` are the linear law's, its `friction` has the networks.

        Its `extrapolated` holds the RMSE (n,) in N m of each joint's fastest samples, then that of
        its slowest ones, beyond FAST_SHARE and 1 - FAST_SHARE of them. Fits without these samples
        predict them. It is empty where nothing is cross-validated, or a single law is requested.
        """
        linear_fit = self._linear_fit(_linear_law(law))
        realised = self._realised(law, linear_fit.solution, range(len(self._logs)))
        cross_validation: tuple[TorqueFit, ...] = ()
        extrapolated: tuple[Array, ...] = ()
        if self._problem.holds_out_logs and self._config.cross_validate:
            cross_validation = self._cross_validation(law)
        # Extrapolation leaves out samples, not logs: one log is enough.
        if self._config.cross_validate and self._config.friction == "best":
            # A network must not be trained where it is judged: the law below it is used there.
            extrapolated = self._extrapolated(_linear_law(law), linear_fit)
        return LawFit(
            law=law,
            weights=linear_fit.weights,
            solution=linear_fit.solution,
            chain=realised.chain,
            friction=realised.friction,
            fit=tuple(log.predict(realised.chain, realised.friction) for log in self._logs),
            cross_validation=cross_validation,
            extrapolated=extrapolated,
        )

    def held_out_models(self, law: str) -> list[HeldOutModel]:
        """For each fold the fit of the other folds."""
        linear_fit = self._linear_fit(_linear_law(law))
        solutions = self._without_each_fold(linear_fit, "friction_fit_held_out", NUM_STRETCHES)
        models = []
        for fold, solution in zip(self._problem.folds, solutions, strict=True):
            logs = list(range(len(self._logs)))
            if self._problem.holds_out_logs:
                held_out = {part.log for part in fold}
                logs = [k for k in logs if k not in held_out]
            realised = self._realised(law, solution, logs)
            models.append(HeldOutModel(fold, realised.chain, realised.friction))
        return models

    def gravity_without_a_fold(self, law: str) -> Array:
        """The parameters of gravity's torque, of each fit without one fold.

        Logs of one motion are taken in NUM_JACKKNIFE stretches. Without a third of a log the
        remaining postures determine less than all of them, and the fits differ by more than they
        err.

        Returns:
            (K, n, 5) mass, first moment and offset of each joint.
        """
        linear_fit = self._linear_fit(_linear_law(law))
        motor_rates = self._problem.robot.motor_rates
        parameters = []
        for solution in self._without_each_fold(
            linear_fit, "friction_fit_jackknife", NUM_JACKKNIFE
        ):
            inertial, _, coefficients = solution.parts()
            law_fit = solution.structure.law(coefficients).feedforward.coulomb_viscous
            offset = motor_rates.T @ law_fit.offset
            parameters.append(np.hstack([inertial[:, :4], offset[:, None]]))
        return np.stack(parameters)

    def _cross_validation(self, law: str) -> tuple[TorqueFit, ...]:
        """Each log, predicted from the logs of the other folds."""
        predicted = {}
        for model in self.held_out_models(law):
            for part in model.fold:
                log = self._logs[part.log]
                predicted[part.log] = log.predict(model.chain, model.friction)
        return tuple(predicted[k] for k in range(len(self._logs)))

    def _linear_fit(self, law: str) -> _LinearFit:
        if law not in self._linear:
            self._linear[law] = shared(
                "friction_fit", (*self._source, law), lambda: self._chosen_and_fitted(law)
            )
        return self._linear[law]

    def _chosen_and_fitted(self, law: str) -> _LinearFit:
        problem = self._problem
        structure = FrictionStructure.of(law, problem.robot.num_joints)
        if structure.has("stribeck"):  # other laws have no shape
            structure = problem.choose(structure)
        problem = problem.reweighed(structure)
        return _LinearFit(structure, problem.weights, problem.fit(structure))

    def _without_each_fold(self, fit: _LinearFit, name: str, stretches: int) -> list[LawSolution]:
        """For each fold the fit of the other folds."""
        problem = replace(self._problem, weights=fit.weights, stretches=stretches)
        folds = range(len(problem.folds))
        return shared(
            name,
            (*self._source, fit.structure, fit.weights),
            lambda: [problem.fit(fit.structure, [i for i in folds if i != fold]) for fold in folds],
        )

    def _extrapolated(self, law: str, fit: _LinearFit) -> tuple[Array, ...]:
        """Errors on the fastest and on the slowest samples, predicted by fits without them."""
        motor_rates = self._problem.robot.motor_rates
        speeds = [
            np.abs(log.v[regression.rows] @ motor_rates.T)
            for log, regression in zip(self._logs, self._problem.regressions, strict=True)
        ]
        all_speeds = np.vstack(speeds)
        slow_limit = np.quantile(all_speeds, 1.0 - FAST_SHARE, axis=0)
        fast_limit = np.quantile(all_speeds, FAST_SHARE, axis=0)
        without_fast = self._fit_of_rows(law, fit, [v <= fast_limit for v in speeds])
        without_fast = replace(without_fast, friction=bounded(without_fast.friction, fast_limit))
        without_slow = self._fit_of_rows(law, fit, [v >= slow_limit for v in speeds])
        return (
            self._rmse_where(without_fast, lambda speed: speed > fast_limit),
            self._rmse_where(without_slow, lambda speed: speed < slow_limit),
        )

    def _fit_of_rows(
        self, law: str, fit: _LinearFit, selected: Sequence[NDArray[np.bool_]]
    ) -> _Realised:
        """The fit without the rows that are not selected, joint by joint."""
        weights = fit.weights or [np.ones(rows.shape) for rows in selected]
        selected_weights = [w * rows for w, rows in zip(weights, selected, strict=True)]
        solution = shared(
            "friction_fit_extrapolated",
            (*self._source, fit.structure, selected_weights),
            lambda: replace(self._problem, weights=selected_weights).fit(fit.structure),
        )
        return self._realised(law, solution, range(len(self._logs)))

    def _rmse_where(
        self, model: _Realised, is_outside: Callable[[Array], NDArray[np.bool_]]
    ) -> Array:
        """(n,) N m, over the samples whose motor speed (T, n) is outside of what was fitted."""
        robot = self._problem.robot
        squares, count = np.zeros(robot.num_joints), np.zeros(robot.num_joints)
        for log in self._logs:
            residual = log.predict(model.chain, model.friction).residual
            outside = is_outside(np.abs(log.v[log.used] @ robot.motor_rates.T))
            squares += (residual**2 * outside).sum(axis=0)
            count += outside.sum(axis=0)
        return np.asarray(np.sqrt(squares / np.maximum(count, 1.0)))

    def _realised(self, law: str, solution: LawSolution, logs: Sequence[int]) -> _Realised:
        """The arm and the friction of a solution.

        Friction is held constant beyond the motors' highest speed in any of the logs, also in those
        that the solution was not fitted on: a held-out log is judged by the law's own course.

        Args:
            law: whose networks, if it has some, are trained.
            logs: numbers of the logs that they are trained on: those that the solution was fitted
                on.
        """
        inertial, rotor, coefficients = solution.parts()
        robot = self._problem.robot
        chain = robot.chain.with_inertial_parameters(inertial, rotor)
        friction = solution.structure.law(coefficients)
        if robot.is_coupled:
            if law in WITH_NETWORK:
                problem = "a network is trained on the friction of single joints, not of a coupling"
                raise InputError("identify", "friction", problem, f"take {WITH_NETWORK[law]}")
            friction = CoupledFriction(friction, robot.motor_rates)
        if law in WITH_NETWORK:
            training_logs = [self._logs[k] for k in logs]
            # `chain`, `coefficients` and `friction` follow from solution and robot, which are in
            # the key.
            friction = shared(
                "friction_networks",
                (*self._source, tuple(logs), solution.structure, solution.x, self._config.seed),
                lambda: _with_networks(
                    solution.structure, coefficients, friction, chain, training_logs, self._config
                ),
            )
        fastest = np.max(
            [np.abs(log.v[log.used] @ robot.motor_rates.T).max(axis=0) for log in self._logs],
            axis=0,
        )
        return _Realised(chain, bounded(friction, fastest))


def _linear_law(law: str) -> str:
    """The law of STRUCTURES that a law with a network stands on; any other law itself."""
    return WITH_NETWORK.get(law, law)


def bounded(friction: FrictionLaw, speed: Array) -> FrictionLaw:
    """The law, held constant beyond the motor speeds (n,) rad/s that it was fitted on.

    Laws that have no such limit come back as they are.
    """
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
    logs: Sequence[LowPassedLog],
    config: IdentificationConfig,
) -> FrictionLaw:
    """Trains near-zero networks on the friction that the model separates from the logs.

    Args:
        structure: the law's terms, with the shape of its slip elements.
        coefficients: of each joint's terms in the structure.
        friction: the law that they make, without networks.
        chain: with the fitted inertias.
        logs: to train on.
        config: only its seed counts.
    """
    # Of the used samples of each log; a group is a log.
    v: list[Array] = []
    torque: list[Array] = []
    groups: list[NDArray[np.intp]] = []
    for k, log in enumerate(logs):
        rigid = np.asarray(chain.inverse_dynamics(log.q, log.v, log.vdot))
        all_friction = friction.torque_along(log.q, log.v, rigid)
        # The network replaces a function of velocity; the slip part stays as it is.
        slip = all_friction - friction.velocity_law.torque(log.v)
        v.append(log.v[log.used])
        # `match`: the measured torque is low-passed.
        torque.append((log.tau - log.match(rigid + slip))[log.used])
        groups.append(np.full(int(log.used.sum()), k))
    trained = train_networks(
        np.vstack(v),
        np.vstack(torque),
        friction.velocity_law.coulomb_viscous,
        groups=np.concatenate(groups),
        config=TrainingConfig(config.seed),
    )
    return structure.law(coefficients, trained.networks, trained.v_crit)
