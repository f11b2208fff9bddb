"""Error of eq. 4 on the simulated arm, from contact-free logs.

A motion as slow as a task's joints, done twice, shows what does not repeat: the torque of one run
less that of the other. (Two periods of an excitation would be too fast: drives are louder above .05
rad/s. And 20 s are too short for friction that wanders over half a second.) Such runs do not show
how a push changes friction. The Coulomb friction of the model identified from excitation 1
bounds what may turn round (`wrenchsight.models.identification.repetition_error`).
"""

from collections.abc import Sequence

import numpy as np

from wrenchsight.analyses.experiments.setups.path_runs.task_runs import repetition_torque
from wrenchsight.analyses.experiments.setups.simulated_arm.friction_reversal import (
    HOME_DEPARTURES,
    reversal_recordings,
)
from wrenchsight.analyses.experiments.setups.simulated_arm.simulated_identification import (
    identify_simulated_arm,
)
from wrenchsight.models.identification.repetition_error import RepetitionError, repetition_error
from wrenchsight.models.recordings.position_resolution import position_resolution
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot

PASS_SPEEDS = (0.003, 0.01, 0.03)  # rad/s, of the passes
PASS_PERIOD = 8.0  # s
SETTLING_TIME = 1.0  # s that are left out: a low-pass settles


def repetition_errors(
    robot: Robot,
    gains: Sequence[float | None],
    seed: int = 0,
    quick: bool = False,
) -> list[RepetitionError]:
    """The error of eq. 4 behind each K_0 (1/s; None: raw), found without any task's run.

    Args:
        robot: with its simulated truth.
        gains: K_0.
        quick: a shorter log for the identification, and one posture.

    Returns:
        One entry for each of `gains`, in their order.
    """
    # The first departure is home itself, the fourth is for tests alone.
    departures = HOME_DEPARTURES[1:2] if quick else HOME_DEPARTURES[1:3]
    postures = np.asarray(robot.home) + np.asarray(departures)
    # Two simulations of the same slow motions at each posture, with noise of their own: log k of a
    # simulation has its seed plus k. The first seed is also that of the slow logs of
    # `setups.simulated_arm.arm_models`; nothing hangs on that.
    first_cycles, second_cycles = (
        reversal_recordings(
            robot, postures, PASS_SPEEDS, seed=seed + 100 * (1 + k), period=PASS_PERIOD
        )
        for k in range(2)
    )
    result, _ = identify_simulated_arm(robot, seed, quick)
    level = np.abs(result.model.friction.coulomb_viscous.coulomb)  # (n,) N m, of slow friction
    resolution = position_resolution(np.vstack([log.q for log in first_cycles]))
    errors = []
    for K_0 in gains:
        settled_errors = []  # (N, n) N m of each posture: nothing touches the arm
        for first_cycle, second_cycle in zip(first_cycles, second_cycles, strict=True):
            period = len(first_cycle.t)
            tau_ext = repetition_torque(_after(first_cycle, second_cycle), robot, period, K_0)
            settled_errors.append(tau_ext[_settled(first_cycle)])
        errors.append(repetition_error(np.vstack(settled_errors), level, resolution, K_0))
    return errors


def _after(first_cycle: Recording, second_cycle: Recording) -> Recording:
    """One recording of two runs of a motion, the one after the other."""
    cycles = (first_cycle, second_cycle)
    return Recording(
        t=first_cycle.time_step
        * np.arange(len(first_cycle.t) + len(second_cycle.t), dtype=np.float64),
        q=np.vstack([log.q for log in cycles]),
        v=np.vstack([log.v for log in cycles]),
        current=np.vstack([log.current for log in cycles]),
        source=first_cycle.source,
    )


def _settled(log: Recording) -> slice:
    return slice(round(SETTLING_TIME / log.time_step), None)
