"""The recordings of a Panda with a pad on a force/torque sensor, at ten configurations."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wrenchsight.analyses.data_sets.places import data_set_folder, recording_file
from wrenchsight.analyses.methods.external_torque.force_readings import (
    Knowledge,
    LogReading,
    MethodReading,
    knowledge_by_evidence,
)
from wrenchsight.models.estimation.evidence_prior import evidence_prior
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig, reconstruct_wrench
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.rigid_body.spatial_vectors import FORCE_FIRST

FOLDER = "panda_ati_gamma"
NUM_POSES = 10
LOADED_FORCE = 1.0  # N of the sensor's reading, above which a row is judged
UNLOADED_ROWS = 100  # at the start of each log: the rows on which sensor and torques were tared

# Sensor axes S to pad axes P: x' = x, y' = z, z' = -y.
R_PS = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


@dataclass(frozen=True)
class PoseLog:
    """One configuration: the robot's log and the sensor's force."""

    t: Array  # (N,) s from the start
    tau_ext: Array  # (N, 7) N m
    J: Array  # (N, 6, 7) of the sensor's frame in its own axes, rows [angular; linear]
    sensor_force: Array  # (N, 3) N, axes of the pad
    robot_force: Array  # (N, 3) N, as the data's authors read it; axes of the pad

    @property
    def loaded(self) -> NDArray[np.bool_]:
        """(N,) the rows that are judged."""
        return np.asarray(np.linalg.norm(self.sensor_force, axis=1) > LOADED_FORCE)


def read_pose_logs(data: Path | None) -> tuple[PoseLog, ...]:
    """Reads the ten logs.

    Args:
        data: the folder of recordings that is given.

    Raises:
        InputError: a log is missing or damaged, or lacks a signal.
    """
    folder = data_set_folder(FOLDER, data)
    return tuple(
        _pose_log(read_recording(recording_file(folder, f"data_pos_{i}")))
        for i in range(1, NUM_POSES + 1)
    )


def _pose_log(recording: Recording) -> PoseLog:
    wanted = ("tau_ext", "jacobian", "sensor_force", "robot_force")
    absent = [name for name in wanted if name not in recording.extra]
    if absent:
        raise InputError(recording.source, "", f"has no signal {', '.join(absent)}")
    return PoseLog(
        t=recording.t - recording.t[0],
        tau_ext=recording.extra["tau_ext"],
        J=recording.extra["jacobian"][:, FORCE_FIRST],  # the file has linear rows first
        sensor_force=recording.extra["sensor_force"],
        robot_force=recording.extra["robot_force"],
    )


def knowledge_of_logs(logs: Sequence[PoseLog]) -> Knowledge:
    """Prior and torque noise (alike in all joints) of greatest evidence: the rule in use."""
    return knowledge_by_evidence(*_joined(logs))


def knowledge_from_unloaded_start(logs: Sequence[PoseLog]) -> Knowledge:
    """For comparison: torque noise as it is before the contact, the prior by evidence."""
    start = np.concatenate([log.tau_ext[:UNLOADED_ROWS] for log in logs])
    covariance = np.diag(np.mean(start**2, axis=0))
    return Knowledge(*evidence_prior(*_joined(logs), covariance), covariance)


def _joined(logs: Sequence[PoseLog]) -> tuple[Array, Array]:
    return np.concatenate([log.J for log in logs]), np.concatenate([log.tau_ext for log in logs])


def read_forces(logs: Sequence[PoseLog], method: str, knowledge: Knowledge) -> MethodReading:
    """Reads every row of every log by one method of `wrenchsight.models.estimation.wrench`."""
    config = WrenchReconstructionConfig(method, knowledge.force_sd, knowledge.moment_sd)
    poses = []
    for log in logs:
        estimate = reconstruct_wrench(log.J, log.tau_ext, knowledge.torque_covariance, config)
        force = estimate.wrench[:, 3:] @ R_PS.T
        poses.append(
            LogReading(
                force=force,
                covariance=R_PS @ estimate.covariance[:, 3:, 3:] @ R_PS.T,
                condition_number=estimate.condition_number,
                error=force - log.sensor_force,
                loaded=log.loaded,
            )
        )
    return MethodReading(tuple(poses))
