"""Task `wrench`: the force on a Panda's pad from the joint torque that the arm itself reports.

At ten configurations, against a force/torque sensor beneath. A method is given torque and Jacobian
alone, of all logs, as `wrenchsight estimate` of these logs is.

    plain_tools   damped inverse of J^T
    article       eq. 22
    ours          Bayesian, prior and torque noise of greatest evidence
"""

from pathlib import Path
from typing import Any, Final

import numpy as np

from wrenchsight.analyses.experiments.benchmark.entrants import Entrant, wrench_of_torque
from wrenchsight.analyses.experiments.benchmark.scores import spread
from wrenchsight.analyses.experiments.setups.panda_recordings.pose_logs import (
    R_PS,
    knowledge_of_logs,
    read_forces,
    read_pose_logs,
)
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.signals.bands import SIGMA_95
from wrenchsight.models.signals.root_mean_square import rms_length

READ_BY: Final = {"plain_tools": "damped", "article": "inverse", "ours": "bayesian"}
"""Method of `wrenchsight.models.estimation.wrench`."""
_STATES_ERROR: Final = ("article", "ours")
_TIME_STEP: Final = 1.0 / 80.0  # s


class WrenchTask:
    """Errors of the force, configuration by configuration."""

    def __init__(self, data: Path | None) -> None:
        self._logs = read_pose_logs(data)
        self._knowledge = knowledge_of_logs(self._logs)

    def built_in(self) -> dict[str, dict[str, Any]]:
        """Scores by method."""
        scores = {}
        for method, name in READ_BY.items():
            reading = read_forces(self._logs, name, self._knowledge)
            forces = [log.force for log in reading.logs]
            covariances = [log.covariance for log in reading.logs]
            scores[method] = self._scored(forces, covariances if method in _STATES_ERROR else None)
        return scores

    def of(self, entrant: Entrant) -> dict[str, Any] | None:
        """Scores of a method of others; None: it reads no joint torque.

        Raises:
            FaultError: it fails.
        """
        robot = Robot.load("panda")
        made = entrant.made("wrench", robot, IdentifiedModel.nominal(robot), (), _TIME_STEP)
        forces, covariances = [], []
        for log in self._logs:
            reading = wrench_of_torque(made, log.J, log.tau_ext)
            if reading is None:
                return None
            forces.append(reading.wrench[:, 3:] @ R_PS.T)
            if reading.covariance is not None:
                covariances.append(R_PS @ reading.covariance[:, 3:, 3:] @ R_PS.T)
        return self._scored(forces, covariances if len(covariances) == len(forces) else None)

    def _scored(self, forces: list[Array], covariances: list[Array] | None) -> dict[str, Any]:
        rmse, inside = [], []
        for k, (log, force) in enumerate(zip(self._logs, forces, strict=True)):
            error = (force - log.sensor_force)[log.loaded]
            rmse.append(rms_length(error))
            if covariances is not None:
                variance = np.diagonal(covariances[k][log.loaded], axis1=1, axis2=2)
                inside.append(float(np.mean(np.abs(error) <= SIGMA_95 * np.sqrt(variance))))
        scores = {**spread("rmse_n", rmse), "pose_rmse_n": rmse}
        return scores | (spread("inside_95_pct", [100.0 * x for x in inside]) if inside else {})
