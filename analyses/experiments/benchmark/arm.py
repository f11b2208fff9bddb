"""The UR10e of the benchmark: its models, and how each method reads a wrench from its currents.

    plain         K (i_target - i): what the drives need beyond their targets
    plain_tools   least squares with Coulomb-viscous friction and offset, momentum observer, damped
                  inverse of J^T
    article       Coulomb-viscous friction with a network near zero speed, momentum observer, eq. 22
    kalman        the model of `ours`, Kalman observer
    ours          presliding friction, momentum observer, force_only

All models are fitted on the same three runs, and all readings are causal. A method that states no
covariance has none here. `plain` reads a force alone, by least squares.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from wrenchsight.analyses.experiments.setups.ur10e_recordings.log_scenes import TIME_STEP
from wrenchsight.analyses.experiments.setups.ur10e_recordings.ur10e_logs import (
    FITTED_LOGS,
    identify_ur10e,
    log_file,
)
from wrenchsight.analyses.methods.identify.identification_config import IdentificationConfig
from wrenchsight.analyses.output.progress import ProgressCallback
from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.estimation.smoothing import smoothed_estimate
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.observers.kalman_observer import KalmanObserverConfig
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.recordings.position_resolution import position_resolution
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.recordings.resampling import resampled
from wrenchsight.models.robot.robot import Robot

LAWS: Final = {
    "plain_tools": "coulomb-viscous-offset",
    "article": "semi-parametric",
    "ours": "presliding",
}
"""Friction law by method, as `identify --friction`."""


@dataclass(frozen=True, eq=False)
class CurrentLog:
    """A log on its uniform grid; N samples.

    Attributes:
        t: (N,) s.
        q, v: (N, n) rad and rad/s.
        current: (N, n) A.
        target: (N, n) A, the controller's; None where it is not logged.
        resolution: (n,) rad, of the encoders.
        used: (N,) False where a sample was bridged.
        time_step: s.
        is_rebuilt: whether its velocities are, and jump: no sample is refused then.
    """

    name: str
    t: Array
    q: Array
    v: Array
    current: Array
    target: Array | None
    resolution: Array
    used: Flags
    time_step: float
    is_rebuilt: bool = False

    @classmethod
    def of(cls, name: str, recording: Recording) -> "CurrentLog":
        """A recording on the grid of TIME_STEP."""
        log = resampled(recording, TIME_STEP)
        target = log.extra.get("current_desired")
        return cls(
            name=name,
            t=log.t - log.t[0],
            q=log.q,
            v=log.v,
            current=log.current,
            target=target,
            resolution=position_resolution(recording.q),
            used=~log.dropout,
            time_step=TIME_STEP,
        )


class MethodReading(NamedTuple):
    """What a method reads of N samples.

    Attributes:
        wrench: (N, 6) F_E_W [mx my mz fx fy fz] in N m and N.
        covariance: (N, 6, 6) of it, or None where the method states none.
        tau_ext: (N, n) N m, or None where the method has no such torque.
    """

    wrench: Array
    covariance: Array | None = None
    tau_ext: Array | None = None


Reader = Callable[[CurrentLog], MethodReading]


class Ur10eArm:
    """The UR10e with every method's model, all fitted on the same three runs.

    Attributes:
        robot: with E at the flange.
        models: by method of LAWS.
        fitted: the three runs.
    """

    def __init__(self, data: Path | None, progress: ProgressCallback) -> None:
        self.data, self.robot = data, Robot.load("ur10e")
        self.fitted = tuple(self.read(name.removesuffix(".csv")) for name in FITTED_LOGS)
        self.models = {}
        for k, (method, law) in enumerate(LAWS.items()):
            progress(k / len(LAWS), f"UR10e, friction law {law}")
            config = IdentificationConfig(friction=law)
            self.models[method] = identify_ur10e(data, self.robot, config).model

    def read(self, name: str) -> Recording:
        """A log by its name, wherever it lies."""
        return read_recording(log_file(self.data, name), robot=self.robot)

    def readers(self, robot: Robot) -> dict[str, Reader]:
        """How each method reads a log at E of `robot`, which is this arm."""
        return {
            "plain": lambda log: self._plain(log, robot),
            "plain_tools": lambda log: by_estimator(log, robot, self.plain_model(), "damped"),
            "article": lambda log: by_estimator(log, robot, self.article_model(), "inverse"),
            "kalman": lambda log: by_estimator(
                log,
                robot,
                self.models["ours"],
                observer=KalmanObserverConfig(
                    time_step=log.time_step, torque_samples="trapezoidal"
                ),
            ),
            "ours": lambda log: by_estimator(log, robot, self.models["ours"]),
        }

    def smoothing_reader(self, robot: Robot) -> Reader:
        """How `ours` reads a log with `--smooth`: each sample also from those after it."""

        def read(log: CurrentLog) -> MethodReading:
            batch = smoothed_estimate(
                _estimator(log, robot, self.models["ours"], "force_only"),
                log.q,
                log.v,
                log.current,
            )
            return MethodReading(batch.wrench, batch.covariance, batch.tau_ext)

        return read

    def plain_model(self) -> IdentifiedModel:
        """The plain tools' model, with one covariance for all states."""
        return replace(self.models["plain_tools"], torque_error=None)

    def article_model(self) -> IdentifiedModel:
        """The article's model, with one covariance for all states."""
        return replace(self.models["article"], torque_error=None)

    def _plain(self, log: CurrentLog, robot: Robot) -> MethodReading:
        if log.target is None:
            raise ValueError(f"{log.name} holds no target currents")
        tau = robot.joint_torque(log.target - log.current)
        J = np.asarray(robot.chain.jacobian(log.q))[:, 3:]
        return MethodReading(
            _of_force(np.einsum("kaj,kj->ka", np.linalg.pinv(_turned(J)), tau)), None, tau
        )


def by_estimator(
    log: CurrentLog,
    robot: Robot,
    model: IdentifiedModel,
    method: str = "force_only",
    observer: Any = None,
) -> MethodReading:
    """A log read by the estimator: its observer, and a method of
    `wrenchsight.models.estimation.wrench`.

    Args:
        observer: its configuration, for the log's time step; None: the momentum observer's.
    """
    estimator = _estimator(log, robot, model, method, observer)
    batch = estimator.run(estimator.initial_state(), log.q, log.v, log.current)
    states_error = method == "force_only"
    return MethodReading(batch.wrench, batch.covariance if states_error else None, batch.tau_ext)


def _estimator(
    log: CurrentLog, robot: Robot, model: IdentifiedModel, method: str, observer: Any = None
) -> WrenchEstimator:
    """The estimator of a log; see `by_estimator`."""
    if observer is None:
        observer = MomentumObserverConfig(time_step=log.time_step, torque_samples="trapezoidal")
    config = WrenchEstimatorConfig(
        observer,
        WrenchReconstructionConfig(method),
        position_resolution=log.resolution.tolist(),
        check_samples=not log.is_rebuilt,
    )
    return WrenchEstimator(robot, model, config)


def _turned(J: Array) -> Array:
    return np.asarray(J.transpose(0, 2, 1))


def _of_force(force: Array) -> Array:
    return np.concatenate([np.zeros_like(force), force], axis=1)
