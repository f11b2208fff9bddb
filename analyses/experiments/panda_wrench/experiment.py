"""Supports README, "Wrench from a real Panda's joint torques".

Experiment `panda-wrench`: wrench from a real arm's joint torques, against a real sensor.

A Franka Emika Panda holds a pad at ten configurations, the same load is laid on it, and a
force/torque sensor beneath measures it. The logs hold the controller's external torque and the
Jacobian, so that this tests the step from torque to wrench alone.

Prior and torque noise of the estimate come from the torques of all ten logs, by the rule of
`analyses.methods.external_torque.force_readings`, as in `wrenchsight estimate` of these logs.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from wrenchsight.analyses.experiments.setups.panda_recordings.pose_logs import (
    LOADED_FORCE,
    PoseLog,
    knowledge_from_unloaded_start,
    knowledge_of_logs,
    read_forces,
    read_pose_logs,
)
from wrenchsight.analyses.methods.external_torque.force_readings import (
    Knowledge,
    MethodReading,
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
from wrenchsight.models.estimation.wrench_methods import METHODS
from wrenchsight.models.signals.root_mean_square import rms


def run(context: ExperimentContext) -> ExperimentResult:
    """Reads the ten logs by every method and compares with the sensor.

    Three pairs of prior and torque noise are compared: those of greatest evidence in all logs,
    which every method uses, those with the noise of the logs' unloaded start, and fixed ones.
    """
    context.progress(0.0, "reading the logs")
    logs = read_pose_logs(context.data)
    context.progress(0.3, "prior and torque noise of greatest evidence")
    knowledge = knowledge_of_logs(logs)
    unloaded = knowledge_from_unloaded_start(logs)
    # Fixed ones, of nobody's logs: N, N m, and (0.1 N m)^2 for each joint.
    fixed = Knowledge(force_sd=20.0, moment_sd=0.2, torque_covariance=0.1**2 * np.eye(7))
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
    # The force as the authors of the data read it.
    rmse_of_robot_force = [
        float(rms(np.linalg.norm((log.robot_force - log.sensor_force)[log.loaded], axis=1)))
        for log in logs
    ]
    metrics["authors"] = {
        "rmse_n": rmse_of_robot_force,
        "mean_rmse_n": float(np.mean(rmse_of_robot_force)),
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
            inverse_force = inverse.logs[k].force[:, i]
            ax.plot(log.t, inverse_force, color=COLOUR["before"], lw=1.0, label="eq. 22")
            fill_band(ax, log.t, reading.force[:, i], 2.0 * sd, "± 2 stated sd")
            ax.plot(log.t, reading.force[:, i], color=COLOUR["estimate"], label="Bayesian")
            ax.plot(log.t, log.sensor_force[:, i], color=COLOUR["truth"], lw=1.0, label="sensor")
            ax.set_ylabel(f"f{'xyz'[i]} [N]" if column == 0 else "")
        condition = np.mean(inverse.logs[k].condition_number)
        axes[0, column].set_title(f"pose {k + 1}, condition number {condition:.0f}")
        axes[2, column].set_xlabel("time [s]")
    legend_below(figure, axes[0, 0], ncols=4)
    return figure


def _comparison() -> list[ComparisonRow]:
    """The rows of the report: force errors in N of plain tools beside ours.

    Their numbers stand here as they were measured; no code of this repository makes them.
    """
    plain = "plain tools"
    return [
        ComparisonRow(
            "mean RMSE over ten poses, eq. 22", "inverse.mean_rmse_n", article=0.87, source=plain
        ),
        ComparisonRow(
            "RMSE per pose, eq. 22",
            "inverse.rmse_n",
            article=[0.57, 2.14, 0.79, 0.35, 0.34, 1.80, 0.40, 0.44, 0.32, 1.56],
            source=plain,
        ),
        ComparisonRow(
            "mean RMSE, Bayesian",
            "bayesian.mean_rmse_n",
            article=0.66,
            remark="prior of maximum evidence; plain tools: 20 N and 0.2 N m",
            source=plain,
        ),
        ComparisonRow(
            "mean RMSE, Bayesian with 20 N, 0.2 N m and torque sd 0.1 N m",
            "bayesian_fixed_prior.mean_rmse_n",
            article=0.66,
            remark="the torque noise of that arm is not known",
            source=plain,
        ),
        ComparisonRow(
            "rank correlation of condition number and RMSE, eq. 22",
            "inverse.rank_correlation.poses.condition_number",
            article=0.25,
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
    needs=("panda_ati_gamma",),
    order=170,
    seconds=5,
    readme=("bayesian.mean_rmse_n",),
)
