"""Models of drawn arms, as a user makes them: two motions of `excite`, then `identify`.

The motions are the arm's, whatever the draw; the logs and the model are the draw's.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from wrenchsight.analyses.experiments.foreign_physics.arms import MujocoArm
from wrenchsight.analyses.experiments.foreign_physics.motions import Motion
from wrenchsight.analyses.experiments.foreign_physics.mujoco_world import WorldLog, simulate
from wrenchsight.analyses.experiments.foreign_physics.scenes import MujocoScene
from wrenchsight.analyses.methods.excite.excitation import excite_robot
from wrenchsight.analyses.methods.excite.excitation_config import ExcitationConfig
from wrenchsight.analyses.methods.identify.identification import identify
from wrenchsight.analyses.methods.identify.identification_config import IdentificationConfig
from wrenchsight.analyses.study.shared_results import shared
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot

EXCITATION_SEEDS = (0, 1)
NUM_STARTS, NUM_ITERATIONS = 2, 10  # of `excite`, as in the tutorial
NUM_PERIODS = 4  # of a motion, 10 s each
_IDENTIFICATION_SEED = 1000  # of the noise, beside the seeds of other logs


def excitation_motions(robot: Robot, file: str, periods: int = NUM_PERIODS) -> tuple[Motion, ...]:
    """The motions that `excite` plans for an arm, on the controller's grid.

    Args:
        robot: as its file states it.
        file: that names it for the command.
        periods: periods of each motion.
    """
    return shared(
        "foreign_excitation",
        (robot, periods),
        lambda: tuple(_excitation(file, seed, periods) for seed in EXCITATION_SEEDS),
    )


def _excitation(file: str, seed: int, periods: int) -> Motion:
    with TemporaryDirectory() as folder:
        out = Path(folder) / "excite"
        config = ExcitationConfig(
            seed=seed, num_periods=periods, num_starts=NUM_STARTS, iterations=NUM_ITERATIONS
        )
        excite_robot(file, out, config, validation=False, page=False)
        table = np.loadtxt(out / "trajectory.csv", delimiter=",", skiprows=1)
    q, v, vdot = np.split(table[:, 1:], 3, axis=1)
    return Motion(q, v, vdot)


def identification_logs(arm: MujocoArm, motions: tuple[Motion, ...]) -> tuple[WorldLog, ...]:
    """Logs of the true arm along these motions."""
    return tuple(
        simulate(arm, MujocoScene(*motion), _IDENTIFICATION_SEED + k, f"identification_{k}")
        for k, motion in enumerate(motions)
    )


def identified(robot: Robot, logs: Sequence[Recording]) -> IdentifiedModel:
    """The model of `identify --friction best`."""
    config = replace(IdentificationConfig(), friction="best")
    return identify(logs, robot, [], config).model
