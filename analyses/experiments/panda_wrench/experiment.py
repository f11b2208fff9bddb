"""Experiment `panda-wrench`: wrench from a real arm's joint torques, against a real sensor.

A Franka Emika Panda holds a pad at ten configurations, the same load is laid on it, and a
force/torque sensor beneath measures it. Logged are the robot's own external joint torque and the
Jacobian, so that this tests the step from torque to wrench alone.

What the estimate needs beside them comes from the torques of all ten logs, by the rule of
`analyses.methods.external_torque.force_readings`, as in `wrenchsight estimate` of these logs.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchsight.analyses.data_sets.places import data_set_folder, recording_file
from wrenchsight.analyses.methods.external_torque.force_readings import (
    Knowledge,
    LogReading,
    MethodReading,
    knowledge_by_evidence,
    rms,
)
from wrenchsight.analyses.output.figures import (
    COLOUR,
    Figure,
    fill_band,
    legend_below,
    new_figure,
)
from wrenchsight.analyses.study.experiment import (
    ComparisonRow,
    Experiment,
    ExperimentContext,
    ExperimentResult,
)
from wrenchsight.models.arrays import Array
from wrenchsight.models.estimation.evidence_prior import evidence_prior
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig, reconstruct_wrench
from wrenchsight.models.estimation.wrench_kernels import METHODS
from wrenchsight.models.files.input_error import InputError
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
    """One configuration: what the robot logs, and what the sensor says."""

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
    """The rule: prior and torque noise (alike in all joints) of greatest evidence."""
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


def run(context: ExperimentContext) -> ExperimentResult:
    """Reads the ten logs by every method and compares with the sensor."""
    context.progress(0.0, "reading the logs")
    logs = read_pose_logs(context.data)
    context.progress(0.3, "prior and torque noise of greatest evidence")
    knowledge = knowledge_of_logs(logs)
    unloaded = knowledge_from_unloaded_start(logs)
    fixed = Knowledge(20.0, 0.2, 0.1**2 * np.eye(7))
    context.progress(0.5, "reading the forces")
    readings = {method: read_forces(logs, method, knowledge) for method in METHODS}
    metrics: dict[str, Any] = {name: reading.metrics() for name, reading in readings.items()}
    metrics["bayesian_fixed_prior"] = read_forces(logs, "bayesian", fixed).metrics()
    metrics["bayesian_unloaded_noise"] = read_forces(logs, "bayesian", unloaded).metrics()
    metrics["condition_number"] = [
        float(np.mean(log.condition_number[log.loaded])) for log in readings["inverse"].logs
    ]
    metrics["prior"] = _knowledge_metrics(knowledge)
    metrics["prior_unloaded_noise"] = _knowledge_metrics(unloaded)
    by_authors = [
        rms(np.linalg.norm((log.robot_force - log.sensor_force)[log.loaded], axis=1))
        for log in logs
    ]
    metrics["authors"] = {
        "rmse_n": by_authors,
        "mean_rmse_n": float(np.mean(by_authors)),
    }
    context.progress(0.7, "figures")
    return ExperimentResult(
        metrics=metrics,
        figures=[
            (
                "force",
                _force_figure(logs, readings),
                "Force on the pad (its axes) at the poses where eq. 22 reads best (left) and worst "
                "(right)",
            ),
        ],
        comparison=_comparison(),
        notes=NOTES,
        configuration={
            "knowledge": "greatest evidence over all logs, one torque sd for all joints",
            **_knowledge_metrics(knowledge),
        },
    )


def _knowledge_metrics(knowledge: Knowledge) -> dict[str, Any]:
    return {
        "force_sd_n": knowledge.force_sd,
        "moment_sd_nm": knowledge.moment_sd,
        "torque_sd_nm": np.sqrt(np.diag(knowledge.torque_covariance)),
    }


def _force_figure(logs: Sequence[PoseLog], readings: dict[str, MethodReading]) -> Figure:
    inverse, bayesian = readings["inverse"], readings["bayesian"]
    rmse = [log.rmse for log in inverse.logs]
    figure, axes = new_figure(3, 2, share_x=False, share_y=True, height=6.6)
    for column, k in enumerate((int(np.argmin(rmse)), int(np.argmax(rmse)))):
        log, reading = logs[k], bayesian.logs[k]
        for i in range(3):
            ax = axes[i, column]
            sd = np.sqrt(reading.covariance[:, i, i])
            own = inverse.logs[k].force[:, i]
            ax.plot(log.t, own, color=COLOUR["before"], lw=1.0, label="eq. 22")
            fill_band(ax, log.t, reading.force[:, i], 2.0 * sd, "± 2 stated sd")
            ax.plot(log.t, reading.force[:, i], color=COLOUR["estimate"], label="Bayesian")
            ax.plot(log.t, log.sensor_force[:, i], color=COLOUR["truth"], lw=1.0, label="sensor")
            ax.set_ylabel(f"f{'xyz'[i]} [N]" if column == 0 else "")
        condition = np.mean(inverse.logs[k].condition_number)
        axes[0, column].set_title(f"pose {k + 1}, condition number {condition:.0f}")
        axes[2, column].set_xlabel("time [s]")
    legend_below(figure, axes[0, 0], 4)
    return figure


def _comparison() -> list[ComparisonRow]:
    plain = "plain tools"
    return [
        ComparisonRow(
            "mean RMSE over ten poses, eq. 22", "inverse.mean_rmse_n", 0.87, source=plain
        ),
        ComparisonRow(
            "RMSE per pose, eq. 22",
            "inverse.rmse_n",
            [0.57, 2.14, 0.79, 0.35, 0.34, 1.80, 0.40, 0.44, 0.32, 1.56],
            source=plain,
        ),
        ComparisonRow(
            "mean RMSE, Bayesian",
            "bayesian.mean_rmse_n",
            0.66,
            "prior by evidence; there it was 20 N and 0.2 N m",
            plain,
        ),
        ComparisonRow(
            "mean RMSE, Bayesian with 20 N, 0.2 N m and torque sd 0.1 N m",
            "bayesian_fixed_prior.mean_rmse_n",
            0.66,
            "its torque noise is not known",
            plain,
        ),
        ComparisonRow(
            "rank correlation of condition number and RMSE, eq. 22",
            "inverse.rank_correlation.poses.condition_number",
            0.25,
            source=plain,
        ),
    ]


NOTES = (
    "RMSE against the sensor, mean over ten postures: <bayesian.mean_rmse_n:.2f> N (bayesian), "
    "<inverse.mean_rmse_n:.2f> N (eq. 22), <bayesian_unloaded_noise.mean_rmse_n:.2f> N (noise from "
    f"before the contact). Rows with a sensed force above {LOADED_FORCE:g} N count.",
    "Error over stated sd, by posture: <bayesian.error_over_stated_sd:.1f>; with a fixed prior and "
    "noise <bayesian_fixed_prior.error_over_stated_sd:.1f>.",
    "Share of the squared error along the direction stated as worst, by posture: "
    "<inverse.error_in_worst_stated_direction_pct:.0f> % (eq. 22), "
    "<bayesian.error_in_worst_stated_direction_pct:.0f> % (bayesian); chance: 33 %.",
    "Rank correlation with the error of eq. 22 over postures: "
    "<inverse.rank_correlation.poses.stated_sd:.2f> (stated sd), "
    "<inverse.rank_correlation.poses.condition_number:.2f> (condition number), uncertain by a "
    "third.",
    "Prior and torque noise maximise the evidence of the joint torques of all logs; the sensor has "
    "no part in it.",
)


EXPERIMENT = Experiment(
    name="panda-wrench",
    title="Wrench from a real Panda's joint torques, against a force/torque sensor",
    section="recordings of a Franka Emika Panda",
    run=run,
    needs=(FOLDER,),
    order=170,
    readme=("bayesian.mean_rmse_n",),
)
