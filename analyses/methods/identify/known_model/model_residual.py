"""Residual of a known model on a log: the rows that a refresh and a payload start from.

Signals are low-passed with the filter that the model was identified with. Torques computed from
them go through the same filter. About two rows a period of the cutoff carry all that the signals
hold.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wrenchsight.analyses.methods.identify.identification_config import IdentificationConfig
from wrenchsight.analyses.methods.identify.known_model.stretches import Logs, as_logs
from wrenchsight.analyses.methods.identify.low_passed_logs import (
    LowPassedLog,
    check_recording,
    decimation,
    log_names,
    low_pass_log,
    median_step,
)
from wrenchsight.models.calibration.load_identification import LoadRows
from wrenchsight.models.calibration.load_parameters import load_columns
from wrenchsight.models.calibration.model_uncertainty import uncertain_parameters
from wrenchsight.models.calibration.residual_noise import LogSignals, ResidualRows
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.friction_law import FrictionLaw
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.robot.robot import Robot

MIN_PERIODS = 7.5  # periods of the cutoff: 1.5 s at 5 Hz, of which the filter's transients take 1 s
MIN_ROWS = 13  # rows of all logs together: 1.3 s at 5 Hz beside the transients
EDGE_PERIODS = 1.0  # periods within a stretch, into which the filter carries what is outside


class _UncertainParameters(NamedTuple):
    """The c base parameters of the links that may be wrong.

    Attributes:
        regressor: (N, n, c) N m per parameter.
        sd: (c,) standard deviation of each parameter.
    """

    regressor: Array
    sd: Array


@dataclass(frozen=True, eq=False)
class ModelResidual:
    """The residual of a robot's model on one low-passed log."""

    log: LowPassedLog
    robot: Robot
    model: IdentifiedModel

    @classmethod
    def of(
        cls,
        recording: Recording,
        robot: Robot,
        model: IdentifiedModel,
        where: Flags | None = None,
    ) -> "ModelResidual":
        """Low-passes a recording as the model's own logs were; of a model without logs, as usual.

        Near a sample that does not count (EDGE_PERIODS of the cutoff), none counts: the filter
        carries it there. A log may be as short as MIN_PERIODS: it does not determine a model alone.

        Args:
            where: (N,) samples of the recording that count; None: all.

        Raises:
            InputError: a log of another robot, too short, or of a rate too low; a model of another
                robot.
        """
        check_recording(recording, robot)
        model.check_robot(robot, "model")
        config = IdentificationConfig(time_step=median_step([recording]))
        if model.provenance.cutoff > 0.0:  # else it has no logs, and the filter is the usual one
            config = replace(
                config,
                cutoff=model.provenance.cutoff,
                filter_order=model.provenance.filter_order,
                filter_regressor=model.provenance.filter_regressor,
            )
        (name,) = log_names([recording])
        log = low_pass_log(name, recording, robot, config, MIN_PERIODS)
        if where is not None and not where.all():
            # On the log's grid: both neighbours count.
            counts = np.interp(log.t, recording.t, where.astype(float)) == 1.0
            reach = round(EDGE_PERIODS / config.cutoff / log.low_pass.time_step)  # samples
            # How many samples within the reach do not count: none, or one and more.
            num_near = np.convolve(~counts, np.ones(2 * reach + 1), "same")
            log = replace(log, used=log.used & ~(num_near > 0.5))
        return cls(log, robot, model)

    @property
    def residual_sd(self) -> Array:
        """(n,) N m, that the model states."""
        return np.asarray(np.sqrt(np.diag(self.model.residual_covariance)))

    @cached_property
    def chain(self) -> SerialChain:
        """The robot with the model's inertias."""
        return self.model.chain(self.robot)

    @cached_property
    def _chosen(self) -> NDArray[np.intp]:
        return np.flatnonzero(self.log.used)[:: decimation(self.log.low_pass)]

    @cached_property
    def _rigid(self) -> Array:
        log = self.log
        return np.asarray(self.chain.inverse_dynamics(log.q, log.v, log.vdot))

    @cached_property
    def _load(self) -> Array:
        """(N, n, 10) N m per parameter of a load on the flange."""
        return load_columns(self.robot, self.log.q, self.log.v, self.log.vdot)

    def rows(self, load: Array | None = None) -> ResidualRows:
        """The model's residual.

        Args:
            load: (10,) parameters of a load on the flange that the gears transmit besides; its
                rigid-body torque stays in the residual.
        """
        log, law = self.log, self.model.friction
        carried = self._rigid if load is None else self._rigid + self._load @ load
        predicted = self._rigid + law.torque_along(log.q, log.v, carried)
        rows = self._chosen
        residual = log.tau[rows] - log.match(predicted)[rows]
        signals = LogSignals(log.t, log.q, log.v, carried)
        return ResidualRows.of_law(law, signals, residual, self.residual_sd, rows, log.match)

    def load_rows(self, load: Array | None = None) -> LoadRows:
        """As `rows`, with the columns of a load's and of the model's uncertain parameters."""
        rows = self._chosen
        uncertain = self._uncertain
        return LoadRows(
            rows=self.rows(load),
            load=self.log.match(self._load)[rows],
            model=self.log.match(uncertain.regressor)[rows],
            model_sd=uncertain.sd,
        )

    def torque_of(self, load: Array) -> Array:
        """(m, n) N m of a load's ten parameters, at the rows."""
        return np.asarray(self.log.match(self._load @ load)[self._chosen])

    @cached_property
    def _uncertain(self) -> "_UncertainParameters":
        places, sd = uncertain_parameters(self.model)
        log = self.log
        Y = np.asarray(self.robot.chain.regressor(log.q, log.v, log.vdot))
        return _UncertainParameters(Y[:, :, places], sd)


def residuals_of(logs: Logs, robot: Robot, model: IdentifiedModel) -> list["ModelResidual"]:
    """The residual of a model on each log.

    Raises:
        InputError: as `ModelResidual.of`; all together leave too few rows.
    """
    residuals = [ModelResidual.of(log, robot, model, where) for log, where in as_logs(logs)]
    count = sum(len(residual.rows().t) for residual in residuals)
    require_rows(count, ", ".join(residual.log.log.name for residual in residuals))
    return residuals


def require_rows(count: int, names: str) -> None:
    """Raises InputError where all logs together leave too little."""
    if count < MIN_ROWS:
        raise InputError(
            names,
            "",
            f"{count} rows of the logs can be used, {MIN_ROWS} are needed: 2.5 s of one log at a "
            "cutoff of 5 Hz, or several stretches",
            "give longer or more logs, or LOG=BEGIN,END",
        )


def model_with_friction(model: IdentifiedModel, friction: FrictionLaw) -> IdentifiedModel:
    """The model with another friction law; the table of base parameters follows where it can."""
    law = friction.coulomb_viscous
    table = model.base_parameters
    values = list(table.values)
    for j, joint in enumerate(model.joint_names):
        for term in ("coulomb", "viscous", "offset"):
            name = f"{term}[{joint}]"
            if name in table.names:
                values[table.names.index(name)] = float(getattr(law, term)[j])
    return replace(model, friction=friction, base_parameters=replace(table, values=values))
