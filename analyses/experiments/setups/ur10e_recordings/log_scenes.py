"""Logs with their truth: the force of a UR10e's known load, at the point where it acts."""

from dataclasses import dataclass

from wrenchsight.analyses.experiments.setups.ur10e_recordings.known_payload import force_of_load
from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.recordings.position_resolution import position_resolution
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.resampling import resampled
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.robot_config import PoseConfig

TIME_STEP = 0.01  # s, of the UR10e's logs


@dataclass(frozen=True, eq=False)
class LogScene:
    """A log with its truth.

    Attributes:
        recording: on a uniform grid.
        truth: (N, 3) N, in axes of W at E of `robot`.
        robot, model: that read it.
        resolution: (n,) rad, of the encoders.
    """

    recording: Recording
    truth: Array
    robot: Robot
    model: IdentifiedModel
    resolution: Array


def loaded_scene(
    recording: Recording, mass: float, robot: Robot, model: IdentifiedModel
) -> LogScene:
    """The log with E at the point where its load acts; this point is found from its first 10 s."""
    uniform, step = resampled(recording, TIME_STEP), position_resolution(recording.q)
    config = WrenchEstimatorConfig(
        MomentumObserverConfig(time_step=TIME_STEP, torque_samples="trapezoidal"),
        position_resolution=step.tolist(),
    )
    observation = WrenchEstimator(robot, model, config).observe(
        uniform.q, uniform.v, uniform.current
    )
    Sigma_tau = model.residual_covariance
    point, truth = force_of_load(
        robot, uniform, observation.J, observation.tau_ext, Sigma_tau, mass
    )
    if any(robot.config.tool_frame.xyz) or any(robot.config.tool_frame.rpy):
        raise ValueError("the load's point is given in the flange")
    robot_at_load = robot.with_tool(robot.config.tool, PoseConfig([float(x) for x in point]))
    return LogScene(uniform, truth, robot_at_load, model, step)
