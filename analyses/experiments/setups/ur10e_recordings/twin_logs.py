"""The simulated twin of a real log: the same commanded motion, the true joints, the same clock.

The motion is the log's, low-passed, since the logs do not hold the controller's command. The
simulated arm follows it under the controller of its drives. It is logged at the times of the real
log's rows, rounded alike.
"""

from dataclasses import replace

import numpy as np

from wrenchsight.analyses.methods.simulate.simulated_logs import drive_servo
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.planning.motion.paths import JointTrajectory
from wrenchsight.models.recordings.position_resolution import position_resolution
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.resampling import resampled
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.robot_config import PoseConfig, ToolConfig
from wrenchsight.models.signals.zero_phase import ZeroPhaseLowPass
from wrenchsight.models.truth.free_arm import simulate_free_arm
from wrenchsight.models.truth.log_clock import clocked
from wrenchsight.models.truth.true_robot import true_robot

TIME_STEP = 0.01  # s, of the reference
_SIMULATION_STEP = 1e-3  # s
REFERENCE_CUTOFF = 8.0  # Hz, of the reference: more than twice what the motions hold


def commanded_motion(recording: Recording) -> JointTrajectory:
    """The motion of a log as it may have been commanded: low-passed, from rest to rest."""
    uniform = resampled(recording, TIME_STEP)
    q = ZeroPhaseLowPass(REFERENCE_CUTOFF, TIME_STEP, 4)(uniform.q)
    t = uniform.t - uniform.t[0]
    return JointTrajectory.from_positions(t, q)


def twin_log(
    recording: Recording,
    robot: Robot,
    day: int = 0,
    seed: int = 0,
    payload: ToolConfig | None = None,
) -> Recording:
    """What the simulated arm records along the motion of a real log.

    The arm is simulated in steps of _SIMULATION_STEP. The log's rows are the simulated ones nearest
    to its times, with angles rounded as the real encoders round them.

    Args:
        recording: the real log.
        robot: with its simulated truth.
        day: seed of what differs from day to day; of no effect on a truth without mechanisms.
        seed: seed of the drives' noise.
        payload: on the flange, unknown to the controller.
    """
    truth = robot.config.simulated_truth
    mechanisms = truth.mechanisms
    if mechanisms is not None:
        robot = robot.with_truth(replace(truth, mechanisms=replace(mechanisms, day=day)))
    # The payload is in the true arm's inertias alone: the controller has the robot without it.
    carrying = robot if payload is None else robot.with_tool(payload, PoseConfig())
    log = simulate_free_arm(
        robot,
        commanded_motion(recording),
        drive_servo(robot, IdentifiedModel.nominal(robot)),
        seed=seed,
        payload=true_robot(carrying).chain,
        time_step=_SIMULATION_STEP,
    )
    t = recording.t - recording.t[0]
    exact = Recording(
        t=recording.t[0] + log.t, q=log.q, v=log.v, current=log.current, source=recording.source
    )
    # The clock's errors move what is logged at a time, not which rows the log has.
    if mechanisms is not None:
        exact = clocked(exact, mechanisms.clock, seed)
    rows = np.clip(np.rint(t / _SIMULATION_STEP).astype(int), 0, len(log.t) - 1)
    encoder_step = position_resolution(recording.q)  # (n,) rad; 0: the log does not show one
    divisor = np.where(encoder_step > 0.0, encoder_step, 1.0)
    rounded = np.rint(exact.q[rows] / divisor) * divisor
    q = np.where(encoder_step > 0.0, rounded, exact.q[rows])
    return replace(
        recording, q=q, v=exact.v[rows], current=exact.current[rows], tau_J=None, extra={}
    )
