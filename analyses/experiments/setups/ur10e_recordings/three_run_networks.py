"""The UR10e's torque predictors of its three fitted runs, trained once in a study."""

from pathlib import Path
from typing import Final

from wrenchsight.analyses.data_sets.places import data_set_folder
from wrenchsight.analyses.experiments.setups.torque_networks.torque_predictors import (
    Predictors,
    torque_log,
)
from wrenchsight.analyses.experiments.setups.ur10e_recordings.ur10e_logs import (
    FITTED,
    FOLDER,
    identify_ur10e,
)
from wrenchsight.analyses.methods.identify.identification_config import IdentificationConfig
from wrenchsight.analyses.study.shared_results import shared
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.robot.robot import Robot

LAW: Final = IdentificationConfig(
    friction="presliding", cross_validate=False
)  # what `--friction best` chooses here


def three_run_predictors(data: Path | None, robot: Robot, seed: int, share: float) -> Predictors:
    """Trains the networks on the three runs, beside a model that was fitted on them.

    Args:
        data: folder of the recordings.
        robot: the bundled ur10e.
        seed: of the training.
        share: of its epochs.

    Raises:
        InputError: a log is missing or damaged.
    """

    def trained() -> Predictors:
        model = identify_ur10e(data, robot, LAW).model
        folder = data_set_folder(FOLDER, data)
        runs = [read_recording(folder / name, robot=robot) for name in FITTED]
        return Predictors([torque_log(run, robot, model) for run in runs], seed, share)

    return shared("three-run-networks", (str(data), LAW, seed, share), trained, everywhere=True)
