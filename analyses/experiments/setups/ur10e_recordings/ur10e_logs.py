"""The UR10e's recordings: the runs that a model is fitted on, and those that judge it."""

from dataclasses import replace
from pathlib import Path

from wrenchsight.analyses.data_sets.places import data_set_folder, find_data_set
from wrenchsight.analyses.methods.identify.identification import IdentificationResult, identify
from wrenchsight.analyses.methods.identify.identification_config import IdentificationConfig
from wrenchsight.analyses.output.progress import ProgressCallback
from wrenchsight.analyses.study.experiment import ExperimentContext
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.robot.robot import Robot

FOLDER = "ur10e"
FITTED_LOGS = (
    "ur-20_02_10-30sec_12harm.csv",
    "ur-20_02_12-40sec_12harm.csv",
    "ur-20_02_12-50sec_12harm.csv",
)
VALIDATION_LOGS = {
    "14harm50sec": "ur-20_02_19_14harm50sec.csv",
    "ptp_10_points": "ur-20_01_17-ptp_10_points.csv",
}
# The motion of 14harm50sec with a payload of 2.805 kg.
LOADED_LOG = "ur-20_02_19_14harm50secLoad.csv"
FILES = tuple(f"{FOLDER}/{name}" for name in (*FITTED_LOGS, *VALIDATION_LOGS.values(), LOADED_LOG))
FURTHER_FOLDER = "ur10e_more"
# All contact-free logs that no model is fitted on, and those with a payload (kg).
FREE_LOGS = (
    "ur-20_02_19_14harm50sec",
    "ur-20_01_17-ptp_10_points",
    "ur-20_02_19_15harm50sec",
    "ur-20_02_10-20sec_7harm",
    "ur-20_02_06-20sec_5harm",
    "ur-20_02_06-20sec_10harm",
    "ur-20_02_05-20sec_8harm",
    "ur-20_01_31-unload",
    "ur-19_12_23_free",
    *(f"ur-20_01_17-p{k}" for k in range(1, 6)),
)
LOADED_LOGS = {"ur-20_02_19_14harm50secLoad": 2.805, "ur-19_12_23_load": 1.069}
LOAD_MASSES = dict.fromkeys(FREE_LOGS, 0.0) | LOADED_LOGS  # kg


def log_file(data: Path | None, name: str) -> Path:
    """A log's file, in either of the two sets; it need not exist where the set FURTHER_FOLDER is
    missing.

    Args:
        data: the folder of recordings that is given.

    Raises:
        InputError: the set FOLDER is nowhere.
    """
    path = data_set_folder(FOLDER, data) / f"{name}.csv"
    second_set = find_data_set(FURTHER_FOLDER, data)
    return path if path.is_file() or second_set is None else second_set.folder / path.name


def validation_recordings(data: Path | None, robot: Robot) -> list[Recording]:
    """The runs of `VALIDATION_LOGS`, under their short names."""
    folder = data_set_folder(FOLDER, data)
    return [
        replace(read_recording(folder / name, robot=robot), source=key)
        for key, name in VALIDATION_LOGS.items()
    ]


def identify_ur10e(
    data: Path | None,
    robot: Robot,
    config: IdentificationConfig | None = None,
    progress: ProgressCallback = lambda fraction, action: None,
) -> IdentificationResult:
    """Fits the UR10e's model on the three unloaded runs.

    The results of the validation logs carry the short names of `VALIDATION_LOGS`.

    Raises:
        InputError: a log is missing or damaged.
    """
    folder = data_set_folder(FOLDER, data)
    fitted, validated = (
        [read_recording(folder / name, robot=robot) for name in names]
        for names in (FITTED_LOGS, VALIDATION_LOGS.values())
    )
    result = identify(fitted, robot, validated, config, progress)
    short = {Path(name).stem: key for key, name in VALIDATION_LOGS.items()}
    return replace(
        result, validation=tuple(replace(fit, name=short[fit.name]) for fit in result.validation)
    )


def presliding_arm(context: ExperimentContext, share: float) -> tuple[Robot, IdentifiedModel]:
    """The UR10e and its model with presliding friction, a `share` of the experiment's work.

    Raises:
        InputError: a log is missing or damaged.
    """
    robot, config = Robot.load("ur10e"), IdentificationConfig(friction="presliding")
    return robot, identify_ur10e(context.data, robot, config, context.part(0.0, share)).model
