"""Task `torque`: the motor torque of motion without contact that no method was fitted on.

All methods read the same zero-phase low-passed q and v, and are compared with torque that went
through the same low-pass. The score of a log is the geometric mean of its joints' RMS errors, so
that each joint counts alike.
"""

from typing import Any, Final

import numpy as np

from wrenchsight.analyses.experiments.benchmark.arm import LAWS, Ur10eArm
from wrenchsight.analyses.experiments.benchmark.entrants import Entrant, motor_torque
from wrenchsight.analyses.experiments.benchmark.scores import spread
from wrenchsight.analyses.experiments.benchmark.torque_log import torque_log
from wrenchsight.analyses.experiments.setups.ur10e_recordings.log_scenes import TIME_STEP
from wrenchsight.analyses.experiments.setups.ur10e_recordings.ur10e_logs import FREE_LOGS
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.resampling import resampled
from wrenchsight.models.signals.root_mean_square import rms

LOGS: Final = tuple(name for name in FREE_LOGS if "17-p" not in name or "ptp" in name)
"""Contact-free logs in which the arm moves."""


class TorqueTask:
    """Errors of the torque, log by log."""

    def __init__(self, arm: Ur10eArm) -> None:
        self._arm = arm
        self._recordings = {name: arm.read(name) for name in LOGS}
        model = arm.models["ours"]
        self._logs = {
            name: torque_log(recording, arm.robot, model)
            for name, recording in self._recordings.items()
        }

    def built_in(self) -> dict[str, dict[str, Any]]:
        """Scores by method."""
        errors: dict[str, dict[str, Array]] = {"plain": self._plain()}
        for method in LAWS:
            model = self._arm.models[method]
            logs = {
                name: torque_log(recording, self._arm.robot, model)
                for name, recording in self._recordings.items()
            }
            errors[method] = {
                name: (log.predicted - log.torque)[log.used] for name, log in logs.items()
            }
        return {method: _metrics(by_log) for method, by_log in errors.items()}

    def of(self, entrant: Entrant) -> dict[str, Any] | None:
        """Scores of a method of others; None: it predicts no torque.

        Raises:
            FaultError: it fails.
        """
        arm = self._arm
        made = entrant.made("torque", arm.robot, arm.models["ours"], arm.fitted, TIME_STEP)
        errors = {}
        for name, log in self._logs.items():
            predicted = motor_torque(made, log.q, log.v)
            if predicted is None:
                return None
            errors[name] = (predicted - log.torque)[log.used]
        return _metrics(errors)

    def _plain(self) -> dict[str, Array]:
        """The error (N m) of the torque K i_target, by log."""
        robot, errors = self._arm.robot, {}
        for name, recording in self._recordings.items():
            uniform = resampled(recording, TIME_STEP)
            target = robot.joint_torque(uniform.extra["current_desired"])
            log = torque_log(uniform, robot, self._arm.models["ours"], -target)
            errors[name] = -log.torque[log.used]
        return errors


def _metrics(errors: dict[str, Array]) -> dict[str, Any]:
    by_log = {name: rms(error) for name, error in errors.items()}
    scores = {
        name: float(np.exp(np.mean(np.log(joint_rmse)))) for name, joint_rmse in by_log.items()
    }
    return {
        **spread("rmse_nm", list(scores.values())),
        "logs": {
            name: {"rmse_nm": scores[name], "joints_rmse_nm": joint_rmse}
            for name, joint_rmse in by_log.items()
        },
    }
