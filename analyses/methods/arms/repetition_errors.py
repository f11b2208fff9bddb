"""How far is eq. 4 off on the simulated arm? Contact-free logs in, its error out.

Two periods of an excitation show what does not repeat: torque of the one minus the other's. What a
push does to friction, they cannot show: the Coulomb friction of the model that is identified from
the same log says how much may turn round (`models.identification.repetition_error`).
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from analyses.methods.arms.simulated_identification import CONFIG, identify_simulated_arm
from analyses.methods.arms.simulated_logs import PERIODS, simulate_excitation, stored_excitation
from analyses.methods.reading.repetition import repetition_torque
from models.identification.repetition_error import RepetitionError, fit_repetition_errors
from models.recordings.position_resolution import position_resolution
from models.robot.robot import Robot

ProgressCallback = Callable[[float, str], None]


def repetition_errors(
    robot: Robot,
    K_0: float,
    speed: float,
    seed: int = 0,
    quick: bool = False,
    progress: ProgressCallback = lambda fraction, what: None,
) -> tuple[RepetitionError, RepetitionError]:
    """The error of eq. 4 as it stands, and behind a low-pass; nothing of it is from a task's run.

    From two periods of excitation 1, whose start (a quarter of a period) is left out.

    Args:
        robot: with its simulated truth.
        K_0: 1/s.
        speed: rad/s, the highest planned joint speed of the task.
        seed: of the noise.
        quick: a shorter log for the identification.
        progress: told the share done.
    """
    excitation = stored_excitation(robot, 1)
    log = simulate_excitation(
        robot,
        excitation,
        2,
        2 * seed,
        "excitation_1",
        lambda share, what: progress(0.5 * share, what),
    ).recording
    result, _ = identify_simulated_arm(
        robot,
        seed,
        1 if quick else PERIODS,
        replace(CONFIG, seed=seed),
        lambda share, what: progress(0.5 + 0.5 * share, what),
    )
    period = round(excitation.period / log.time_step)
    raw, filtered = (
        repetition_torque(log, robot, period, gain)[period // 4 :] for gain in (None, K_0)
    )
    level = np.abs(result.model.friction.coulomb_viscous.coulomb)
    v = log.v[period:][period // 4 :]
    return fit_repetition_errors(raw, filtered, v, speed, level, position_resolution(log.q), K_0)
