"""Identification of the simulated arm from its logs; all simulated experiments take it from here.

A Coulomb-viscous model is identified from a log along excitation 1 and predicts the torque along
excitation 2. Both were found by `excite` and lie beside the robot as coefficients.
"""

from dataclasses import replace

import numpy as np

from wrenchsight.analyses.methods.identify.identification import IdentificationResult, identify
from wrenchsight.analyses.methods.identify.identification_config import IdentificationConfig
from wrenchsight.analyses.methods.simulate.simulated_logs import (
    NUM_PERIODS,
    SimulatedLog,
    simulate_excitation,
    stored_excitation,
)
from wrenchsight.analyses.study.shared_results import shared
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.signals.root_mean_square import rms

CONFIG = IdentificationConfig(cutoff=7.5, friction="coulomb-viscous")  # as in the article


def identify_simulated_arm(
    robot: Robot,
    seed: int = 0,
    quick: bool = False,
    config: IdentificationConfig = CONFIG,
    contact_noise: bool = True,
) -> tuple[IdentificationResult, tuple[SimulatedLog, SimulatedLog]]:
    """Identifies the simulated arm from its own log along excitation 1, checked on excitation 2.

    Every simulated experiment takes its model from here; a study identifies it once.

    Args:
        robot: with its simulated truth.
        seed: seed of both logs' noise, and of the identification in the place of the config's.
        quick: one period of each excitation in the place of NUM_PERIODS.
        contact_noise: contact noise of `identify`; a world of a campaign, whose model is not kept,
            has none.
    """
    periods = 1 if quick else NUM_PERIODS
    seeded = replace(config, seed=seed)

    def identified() -> tuple[IdentificationResult, tuple[SimulatedLog, SimulatedLog]]:
        fitted_log, validation_log = (
            simulate_excitation(
                robot,
                stored_excitation(robot, k + 1),
                periods,
                seed=2 * seed + k,  # no two logs of a study's seeds share their noise
                name=f"excitation_{k + 1}",
            )
            for k in range(2)
        )
        result = identify(
            [fitted_log.recording],
            robot,
            [validation_log.recording],
            seeded,
            contact_noise=contact_noise,
        )
        return result, (fitted_log, validation_log)

    arguments = (robot, seed, periods, seeded, contact_noise)
    return shared("identify_simulated_arm", arguments, identified)


def inertial_error(robot: Robot, model: IdentifiedModel) -> tuple[Array, Array]:
    """RMS error (n,) of the identified rigid-body torque along an excitation, and RMS of the true.

    Both in N m; measured on the planned motion, free of noise and filters.
    """
    trajectory = stored_excitation(robot, 2)
    motion = trajectory.sample(np.arange(1000) * trajectory.period / 1000)
    true = robot.chain.inverse_dynamics(*motion)
    result = model.chain(robot).inverse_dynamics(*motion)
    return rms(result - true), rms(true)


def with_known_friction(
    robot: Robot, logs: tuple[SimulatedLog, SimulatedLog]
) -> IdentificationResult:
    """Identifies again from torques that the true friction has been taken off."""

    def without(log: SimulatedLog) -> Recording:
        recording = log.recording
        tau = robot.joint_torque(recording.current)
        return replace(recording, tau_J=tau - log.tau_f_true)

    config = replace(CONFIG, cross_validate=False)  # the observer's error is not needed
    return identify([without(logs[0])], robot, [without(logs[1])], config)
