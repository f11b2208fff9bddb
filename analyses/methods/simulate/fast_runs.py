"""Simulation in one compiled loop, for tasks in which nothing but a hand touches the arm.

Signal by signal the same as `diagrams.closed_loop` gives for such a scenario, some tens of times
faster: `models.truth.free_arm` for arm, drives and controller, the force/torque sensor behind it.
"""

import numpy as np

from wrenchsight.analyses.methods.simulate.simulated_logs import drive_servo
from wrenchsight.diagrams.scenario import Scenario, make_trajectory
from wrenchsight.models.control.wrench_script import WrenchScript
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.planning.motion.paths import JointTrajectory
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.signals.gaussian_noise import gaussian_noise
from wrenchsight.models.signals.low_pass import LowPass
from wrenchsight.models.truth.free_arm import simulate_free_arm
from wrenchsight.systems.force_torque_sensor import ForceTorqueSensorConfig
from wrenchsight.systems.joint_tracking_controller import JointTrackingConfig


def is_free(scenario: Scenario) -> bool:
    """Whether `run_free` can simulate all parts of the scenario."""
    sensor = scenario.force_torque_sensor
    return (
        isinstance(scenario.controller, JointTrackingConfig)
        and scenario.workpiece is None
        and scenario.machining is None
        and not scenario.floor
        and scenario.friction == "full"
        and scenario.current_noise
        and (sensor is None or sensor.compensation == 1.0)
    )


def run_free(
    scenario: Scenario,
    robot: Robot,
    model: IdentifiedModel,
    trajectory: JointTrajectory | None = None,
) -> tuple[Array, dict[str, Array]]:
    """Simulates a free scenario.

    Args:
        scenario: for which `is_free` holds.
        robot: with its simulated truth.
        model: model of the controller.
        trajectory: trajectory of the joints; None: the scenario's motion.

    Returns:
        Times (T,) in s and signals (T, size) by name: q, v, current, wrench_true and tau_f_true;
        with a force/torque sensor also ft_wrench.
    """
    assert isinstance(scenario.controller, JointTrackingConfig)
    log = simulate_free_arm(
        robot,
        make_trajectory(scenario, robot) if trajectory is None else trajectory,
        drive_servo(robot, model, scenario.controller),
        time_step=scenario.time_step,
        seed=scenario.seed,
        wrench=WrenchScript(scenario.wrench, scenario.seed, "scenario"),
        duration=scenario.duration,
        whole=False,  # without signals that only studies of the truth read
    )
    signals = {  # as the log has them: (T, n) but for the wrench, (T, 6) with its moment first
        "q": log.q,
        "v": log.v,
        "current": log.current,
        "wrench_true": log.wrench_true,
        "tau_f_true": log.tau_f_true,
    }
    if scenario.force_torque_sensor is not None:
        signals["ft_wrench"] = sensed(
            log.wrench_true, scenario.force_torque_sensor, scenario.time_step, scenario.seed
        )
    return log.t, signals


def sensed(wrench: Array, config: ForceTorqueSensorConfig, time_step: float, seed: int) -> Array:
    """Reading of `ForceTorqueSensor` for a wrench (T, 6), with the tool's weight compensated."""
    noisy = wrench.copy()
    if config.force_noise_sd > 0 or config.moment_noise_sd > 0:
        noise = np.empty_like(noisy)
        _fill(seed + 2**32, noise)
        noisy += noise * np.repeat([config.moment_noise_sd, config.force_noise_sd], 3)
    return LowPass.butterworth(config.cutoff, config.order, time_step).filter(noisy)


@kernel
def _fill(seed: int, noise: Array) -> None:
    for tick in range(noise.shape[0]):
        gaussian_noise(seed, tick, noise[tick])
