"""Friction laws, each fitted with the inertias to the same logs and cross-validated."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analyses.methods.learning.friction_fit import FrictionFit, Solution
from analyses.methods.learning.friction_training import train_networks
from analyses.methods.learning.identification_config import WITH_NETWORK, IdentificationConfig
from analyses.methods.learning.low_passed_logs import LowPassedLog
from analyses.methods.learning.torque_fit import TorqueFit, pooled_rmse
from analyses.study.shared_results import shared
from models.friction.friction_law import FrictionLaw
from models.friction.friction_structure import FrictionStructure
from models.rigid_body.serial_chain import SerialChain

Array = NDArray[np.float64]


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

    @property
    def cross_validated_rmse(self) -> Array:
        return pooled_rmse(self.cross_validation or self.fit)


@dataclass(frozen=True, eq=False)
class _LinearFit:
    """One law of STRUCTURES, its shape chosen, on all logs."""

    structure: FrictionStructure  # as chosen; that of the solution may have fewer load terms
    weights: Sequence[Array] | None
    solution: Solution


class LawFits:
    """Fits of laws to the same logs: none depends on which were fitted before."""

    def __init__(
        self,
        problem: FrictionFit,
        runs: Sequence[LowPassedLog],
        config: IdentificationConfig,
        logs: str,
    ) -> None:
        """Args: `logs` is a digest of the logs, their robot and the filters."""
        self._problem = problem
        self._runs = runs
        self._config = config
        self._source = (
            logs,
            config.num_passes,
            config.loss,
            config.consistent,
            config.selection,
        )
        self._linear: dict[str, _LinearFit] = {}

    def candidate(self, law: str) -> LawFit:
        """Fits one of LAWS, and cross-validates it where the configuration says so."""
        runs = self._runs
        fit = self._linear_fit(WITH_NETWORK.get(law, law))
        chain, friction = self._realised(law, fit.solution, range(len(runs)))
        cross_validation: tuple[TorqueFit, ...] = ()
        if len(runs) > 1 and self._config.cross_validate:
            cross_validation = tuple(
                run.predict(*self._realised(law, solution, others))
                for run, solution, others in zip(
                    runs, self._held_out(fit), _others(len(runs)), strict=True
                )
            )
        predicted = tuple(run.predict(chain, friction) for run in runs)
        return LawFit(law, fit.weights, fit.solution, chain, friction, predicted, cross_validation)

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

    def _held_out(self, fit: _LinearFit) -> list[Solution]:
        """Of each log in turn, the fit of the others."""
        problem = replace(self._problem, weights=fit.weights)
        return shared(
            "friction_fit_held_out",
            (*self._source, fit.structure, fit.weights),
            lambda: [problem.fit(fit.structure, others) for others in _others(len(self._runs))],
        )

    def _realised(
        self, law: str, solution: Solution, logs: Sequence[int]
    ) -> tuple[SerialChain, FrictionLaw]:
        inertial, rotor, coefficients = solution.parts()
        chain = self._problem.robot.chain.with_inertial_parameters(inertial, rotor)
        friction = solution.structure.law(coefficients)
        if law in WITH_NETWORK:
            runs = [self._runs[k] for k in logs]
            friction = shared(
                "friction_networks",
                (*self._source, tuple(logs), solution.structure, solution.x, self._config.seed),
                lambda: _with_networks(
                    solution.structure, coefficients, friction, chain, runs, self._config
                ),
            )
        return chain, friction


def _others(count: int) -> list[list[int]]:
    return [[i for i in range(count) if i != k] for k in range(count)]


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
        # What the network replaces is a function of velocity: the slip part is not its business.
        slip = whole - friction.velocity_law.torque(run.v)
        v.append(run.v[run.used])
        torque.append((run.tau - run.match(rigid + slip))[run.used])
        group.append(np.full(int(run.used.sum()), k))
    trained = train_networks(
        np.vstack(v),
        np.vstack(torque),
        friction.velocity_law.coulomb_viscous,
        seed=config.seed,
        groups=np.concatenate(group),
    )
    return structure.law(coefficients, trained.networks, trained.v_crit)
