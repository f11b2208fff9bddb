"""Logs of a simulated arm in free motion: a motion in, its controller's log out.

The true robot, with friction that no model contains, follows the motion under its drives' own stiff
controller, which knows the nominal model only. The log holds what its drives and encoders report,
as a real arm's; the true friction is kept beside it.
"""

from dataclasses import dataclass

import numpy as np

from wrenchsight.analyses.study.shared_results import shared
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.planning.excitation.fourier_trajectory import FourierTrajectory
from wrenchsight.models.planning.motion.paths import JointTrajectory
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.truth.free_arm import Servo, simulate_free_arm
from wrenchsight.models.truth.log_clock import clocked
from wrenchsight.systems.joint_tracking_controller import JointTrackingConfig

ROBOT = "sts_sre4_600"
# Servo drives follow a reference far more stiffly than a force controller may: 200 rad/s here. With
# less, a wrist of little inertia sticks and slips through each reversal.
TRACKING_CONFIG = JointTrackingConfig(kp=[4e4], kd=[400.0], ki=[2e6], integral_limit=[400.0])
NUM_PERIODS = 2  # of each trajectory: 20 s


@dataclass(frozen=True, eq=False)
class SimulatedLog:
    """The log of a simulated arm's controller, with the true friction.

    Attributes:
        recording: t, q, v and measured current at 1 kHz.
        tau_f_true: (T, n) N m, the true friction.
    """

    recording: Recording
    tau_f_true: Array


def stored_excitation(robot: Robot, number: int) -> FourierTrajectory:
    """Excitation `number` (1, 2) that lies beside the robot's own file.

    Raises:
        InputError: the file is missing; `excite` makes it.
    """
    return FourierTrajectory.load(robot.source.parent / f"excitation_{number}.yaml", robot.name)


def simulate_excitation(
    robot: Robot,
    trajectory: FourierTrajectory,
    num_periods: int = NUM_PERIODS,
    seed: int = 0,
    name: str = "excitation",
) -> SimulatedLog:
    """Simulates the true robot on a trajectory, under a controller of its nominal model.

    Args:
        robot: with its simulated truth.
        trajectory: to follow.
        num_periods: number of periods to run.
        seed: seed of the currents' noise.
        name: name of the recording.
    """
    return simulate_motion(robot, trajectory.joint_trajectory(num_periods), seed, name)


def simulate_motion(
    robot: Robot,
    trajectory: JointTrajectory,
    seed: int = 0,
    name: str = "motion",
) -> SimulatedLog:
    """Simulates the true robot on any motion of the joints, as `simulate_excitation`.

    Within a study the same motion is simulated once for all experiments.

    Raises:
        InputError: the robot states no inertias that its links can have.
    """
    robot.require_inertias("simulate")
    return shared(
        "simulate_motion",
        (robot, trajectory, seed, name),
        lambda: _simulate_motion(robot, trajectory, seed, name),
    )


def _simulate_motion(
    robot: Robot,
    trajectory: JointTrajectory,
    seed: int,
    name: str,
) -> SimulatedLog:
    nominal = IdentifiedModel.nominal(robot)
    # The same as the cell's tick by tick, much faster (tests/models/truth/test_free_arm.py).
    log = simulate_free_arm(robot, trajectory, drive_servo(robot, nominal), seed=seed, whole=False)
    exact = Recording(t=log.t, q=log.q, v=log.v, current=log.current, source=name)
    mechanisms = robot.config.simulated_truth.mechanisms
    clock = None if mechanisms is None else mechanisms.clock
    return SimulatedLog(clocked(exact, clock, seed), log.tau_f_true)


def drive_servo(
    robot: Robot, model: IdentifiedModel, config: JointTrackingConfig = TRACKING_CONFIG
) -> Servo:
    """The drives' own controller, for `simulate_free_arm`."""
    gains = [config.kp, config.kd, config.ki, config.integral_limit]
    return Servo(
        model.chain(robot),
        np.stack([np.broadcast_to(np.asarray(row, float), robot.num_joints) for row in gains]),
        model.friction.feedforward,
        config.friction_velocity,
        config.law == "computed_torque",
    )
