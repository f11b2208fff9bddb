"""Variants of the estimator that read the same runs, one change a row.

A variant is a path, a friction law, a gain and a reconstruction of the wrench. Two rows beside them
are no estimators, but made with the truth: the reading with the true friction known, and the true
force behind the observer's low-pass. They show how much of the errors is due to friction and lag.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.signal import lfilter

from wrenchsight.analyses.experiments.setups.path_runs.task_runs import TaskRun, read_run
from wrenchsight.analyses.experiments.setups.simulated_arm.arm_models import ArmModels
from wrenchsight.analyses.methods.reference_sensor.force_errors import (
    VariantReading,
    draw_band,
    draw_signal,
    force_metrics,
)
from wrenchsight.analyses.output.axes import limit_y
from wrenchsight.analyses.output.figures import COLOUR, Figure, legend_below, new_figure
from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.rigid_body.spatial_vectors import AXES
from wrenchsight.models.robot.robot import Robot

K_0 = 20.0  # 1/s, the article's
# 1/s, ours: follows a hand of 3 Hz; the currents' noise then costs tenths of a newton
FAST_GAIN = 60.0


@dataclass(frozen=True)
class EstimatorVariant:
    """One row of the table."""

    key: str
    label: str
    path: str
    law: str
    method: str = "inverse"
    K_0: float = K_0


def read_variants(
    models: ArmModels,
    runs: Mapping[str, TaskRun],
    variants: Sequence[EstimatorVariant],
    speed: float,
) -> dict[str, VariantReading]:
    """Readings by variant; the prior is `live_prior` of the robot's payload.

    Args:
        speed: rad/s, the highest planned joint speed of the task.
    """
    readings = {}
    for variant in variants:
        estimator = models.estimator(
            variant.law, speed, variant.K_0, WrenchReconstructionConfig(variant.method)
        )
        readings[variant.key] = read_run(variant.label, runs[variant.path], estimator)
    return readings


def inverse_estimator(robot: Robot, model: IdentifiedModel, gain: float = K_0) -> WrenchEstimator:
    """The estimator of eq. 22; the stated covariance keeps it finite next to a singularity."""
    config = WrenchEstimatorConfig(
        MomentumObserverConfig([gain]), WrenchReconstructionConfig("inverse")
    )
    return WrenchEstimator(robot, model, config)


def known_friction(models: ArmModels, run: TaskRun, gain: float = K_0) -> dict[str, Any]:
    """Errors of the `inverse` reading when the true friction is taken off the torques."""
    estimator = inverse_estimator(models.robot, models.models["coulomb-viscous"], gain)
    reading = read_run("true friction known", run, estimator, run.tau_f_true)
    return _without_band(reading.metrics())


def lag_alone(run: TaskRun, gain: float = K_0) -> dict[str, Any]:
    """Errors of the true force behind K_0 / (s + K_0): the least that this observer can have."""
    force = _lagged(run, gain)
    return _without_band(force_metrics(force, np.zeros_like(force), run.reference))


def against_lagged(reading: VariantReading, run: TaskRun, gain: float = K_0) -> dict[str, Any]:
    """Errors of a reading with this gain against the true force behind K_0 / (s + K_0)."""
    rows = np.searchsorted(run.recording.t, reading.t)
    return _without_band(force_metrics(reading.force, reading.sd, _lagged(run, gain)[rows]))


def _lagged(run: TaskRun, gain: float) -> Array:
    pole = float(np.exp(-gain * run.recording.time_step))
    return np.asarray(lfilter([1.0 - pole], [1.0, -pole], run.wrench_true[:, 3:], axis=0))


def _without_band(metrics: dict[str, Any]) -> dict[str, Any]:
    return {
        key: value for key, value in metrics.items() if not key.startswith(("share", "mean_sd"))
    }


def axes_figure(reading: VariantReading, title: str, colour: str, limits: Array) -> Figure:
    """Force along X, Y and Z with the sensor's and the stated band (the article's Figs. 20, 21).

    Args:
        limits: (3,) N, of each axis.
    """
    figure, axes = new_figure(3, 1, height=6.6, share_x=True)
    for k, panel in enumerate(axes[:, 0]):
        draw_band(panel, reading, k)
        draw_signal(panel, reading.t, reading.force[:, k], colour, "read")
        draw_signal(panel, reading.t, reading.reference[:, k], COLOUR["truth"], "sensor")
        limit_y(panel, -limits[k], limits[k], "N")
        panel.set_ylabel(f"force f{AXES[k]} [N]")
    axes[-1, 0].set_xlabel("time [s]")
    legend_below(figure, axes[0, 0])
    figure.suptitle(title)
    return figure
