"""Checks of the model that reads a log: warnings about it, and the drift that is requested."""

from dataclasses import replace
from pathlib import Path

from wrenchsight.analyses.methods.estimate.estimate_config import EstimateConfig, EstimateSettings
from wrenchsight.analyses.output.result_marker import file_checksum
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.observers.observer_kinds import kind_name, kind_of
from wrenchsight.models.recordings.lerobot.data_set import episode_paths, file_of
from wrenchsight.models.robot.robot import Robot


def model_warnings(robot: Robot, model: IdentifiedModel, settings: EstimateSettings) -> list[str]:
    """What of the model makes every reading doubtful, one sentence each."""
    warnings: list[str] = []
    identify = f"`wrenchsight identify LOGS --robot {settings.robot}`"
    is_identified = bool(model.provenance.logs)
    if is_identified:
        warnings += model.fitted_robot.warnings(robot)
    else:
        consequence = "" if settings.model else f", so no reading is valid; identify it: {identify}"
        warnings.append(
            "the model is not identified from logs: its friction and its noise are assumed"
            + consequence
        )
    warnings += [
        f"robot.yaml has changed since the model was identified (--other-robot): {key}: {change}"
        for key, change in model.fitted_robot.differences(robot)
    ]
    if is_identified and model.torque_error is None:
        warnings.append(
            "the model states no torque error for rest and for motion: one covariance stands for "
            f"both; identify it again: {identify}"
        )
    elif is_identified and model.contact_noise is None:
        warnings.append(
            "the model states no readings without contact: the rate of false alarms is unknown; "
            f"identify it again: {identify}"
        )
    kind = kind_of(settings.estimate.estimator.observer)
    if kind is not None and kind.reads_wrench and model.torque_error is not None:
        warnings.append(
            f"contact and misfit are judged by the {kind_name(kind)} observer's readings with "
            "thresholds of the momentum observer's: the rate of false alarms may differ; for the "
            "stated rate use --observer momentum"
        )
    return warnings


def with_requested_drift(model: IdentifiedModel, config: EstimateConfig) -> IdentifiedModel:
    """The model with the drift of friction that the configuration requests.

    Raises:
        InputError: drift is requested, or to be followed, and the model states no torque error.
    """
    option = "track" if config.track else "drift"
    if (config.track or config.drift is not None) and model.torque_error is None:
        problem = "model.yaml states no torque error"
        raise InputError("estimate", option, problem, f"identify it again, or leave --{option} out")
    if config.drift is None or model.torque_error is None:
        return model
    return replace(model, torque_error=model.torque_error.with_drift(config.drift))


def is_fitted_on(model: IdentifiedModel, log: str) -> bool:
    """Whether the model was fitted on this very file."""
    paths = [path for path in episode_paths(Path(log)) if file_of(path).is_file()]
    fitted_names = {source.name for source in model.provenance.logs}
    paths = [path for path in paths if path.name in fitted_names]
    fitted_checksums = {source.sha256 for source in model.provenance.logs}
    return any(file_checksum(file_of(path)) in fitted_checksums for path in paths)
