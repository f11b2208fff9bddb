"""Supports docs/worlds.md, "7.6 N up to 1.8 Hz in `repeat-cycle-push`".

Experiment `repeat-cycle-push`: a hand pushes while the arm repeats its cycle (Fig. 17).

As `repeat-cycle`, but in the second cycle a hand pushes at the tool, alike on every path; readings
are compared with a force/torque sensor that has noise of its own, low-passed at 18 Hz as in the
article.
"""

from collections.abc import Iterator
from typing import Any

from wrenchsight.analyses.experiments.setups.path_runs.path_study import PathPage, path_result
from wrenchsight.analyses.experiments.setups.path_runs.repeated_cycles import (
    BEFORE,
    VARIANTS,
    RepeatedCycles,
    force_figure,
    repeat_cycles,
)
from wrenchsight.analyses.experiments.setups.path_runs.task_runs import PATHS
from wrenchsight.analyses.methods.reference_sensor.force_errors import force_metrics
from wrenchsight.analyses.study.experiment import (
    ComparisonRow,
    Drawing,
    Experiment,
    ExperimentContext,
    ExperimentResult,
)

SCENARIO = "RepeatCyclePush"


def _sensor(cycles: RepeatedCycles) -> dict[str, Any]:
    """The reference's own error, on the initial path: noise, and the lag of 18 Hz."""
    run = cycles.runs[BEFORE]
    half = len(run.wrench_true) // 2
    force, true = run.reference[half:], run.wrench_true[half:, 3:]
    figures = force_metrics(force, force * 0.0, true)
    return {key: value for key, value in figures.items() if key.startswith(("rmse", "correl"))}


NOTES = (
    "RMSE in Y of eq. 4 on raw torques: <initial.rmse_y_n:.2f> N on the initial path, "
    "<optimised.rmse_y_n:.2f> N on the optimised one (reduced by <reduction_rmse_y_pct:.1f> %, the "
    "largest error by <reduction_max_y_pct:.1f> %), <found.rmse_y_n:.2f> N on the path found here. "
    "The article leaves abnormal points out; here all count.",
    "On the optimised path, behind K_0 = 20: `inverse` <optimised_filtered.rmse_y_n:.2f>, "
    "`bayesian` <optimised_bayesian.rmse_y_n:.2f>, `force_only` "
    "<optimised_force_only.rmse_y_n:.2f> N.",
    "Inside the 95 % band: <initial.share_in_95_band:100 .0f> % (initial), "
    "<optimised.share_in_95_band:100 .0f> % (optimised), "
    "<found_bayesian.share_in_95_band:100 .0f> % (path found here, K_0 = 20, bayesian).",
    "The sensor is <sensor.rmse_y_n:.2f> N RMS off the true force in Y: noise, and the lag of its "
    "18 Hz low-pass.",
)


COMPARISON = (
    ComparisonRow("RMSE in Y, initial path", "initial.rmse_y_n", article=4.0661),
    ComparisonRow(
        "RMSE in Y, optimised path",
        "optimised.rmse_y_n",
        article=3.2274,
        ours="found_bayesian.rmse_y_n",
    ),
    ComparisonRow(
        "Reduction of the RMSE in Y",
        "reduction_rmse_y_pct",
        article=20.93,
        remark="over all points; the article removed abnormal ones",
    ),
    ComparisonRow(
        "Largest error in Y, initial path",
        "initial.max_error_y_n",
        article=46.8357,
        remark="the article removed abnormal points",
    ),
    ComparisonRow(
        "Largest error in Y, optimised path",
        "optimised.max_error_y_n",
        article=14.4221,
        remark="the article removed abnormal points",
        ours="found_bayesian.max_error_y_n",
    ),
    ComparisonRow(
        "Reduction of the largest error in Y",
        "reduction_max_y_pct",
        article=66.39,
        remark="the article removed abnormal points",
    ),
    ComparisonRow(
        "Reduction of the RMSE in Y, path found here",
        "found_against_initial.reduction_rmse_y_pct",
        article=20.93,
        remark="our placement, the article's reading",
    ),
    ComparisonRow("Share in the 95 % band, optimised path", "optimised.share_in_95_band"),
)


def run(context: ExperimentContext) -> ExperimentResult:
    """The experiment `repeat-cycle-push` of `study`."""
    cycles = repeat_cycles(context, SCENARIO)
    sensor_metrics = {"sensor": _sensor(cycles)}
    return path_result(
        context,
        cycles.runs,
        cycles.metrics | sensor_metrics,
        _figures(cycles),
        {"scenario": cycles.scenario, "paths": list(PATHS)},
        PathPage(
            title="Repeated cycles, pushed by hand",
            passes=4,
            variants=VARIANTS,
            comparison=COMPARISON,
            notes=NOTES,
        ),
    )


def _figures(cycles: RepeatedCycles) -> Iterator[Drawing]:
    yield (
        "force-y",
        force_figure(cycles, True),
        "Force in Y read in the second cycle and the sensor's (Fig. 17). The noise is "
        "largest near the initial path's ends, where the arm turns round.",
    )


EXPERIMENT = Experiment(
    name="repeat-cycle-push",
    title="Repeated cycles, pushed by hand",
    section="4.5, Fig. 17",
    run=run,
    order=80,
)
