"""Supports README, "`redundancy` and `jcn-map` choose postures".

Experiment `surface-path`: conditioning gained by the free angle about the normal (section 4.4).

The bundled path on a blade, as `redundancy` uses it: at a constant angle, by the local method that
the article uses, and the optimum (Figs. 11-13).
"""

from wrenchsight.analyses.methods.redundancy.redundancy import find_redundancy
from wrenchsight.analyses.methods.redundancy.redundancy_results import draw
from wrenchsight.analyses.methods.redundancy.redundancy_task import RedundancyTask
from wrenchsight.analyses.study.experiment import (
    ComparisonRow,
    Experiment,
    ExperimentContext,
    ExperimentResult,
)
from wrenchsight.models.files.bundled_files import task_file
from wrenchsight.models.files.configuration import load_configuration
from wrenchsight.models.robot.robot import Robot


def run(context: ExperimentContext) -> ExperimentResult:
    """The experiment `surface-path` of `study`."""
    robot = Robot.load("sts_sre4_600")
    config = load_configuration(task_file("blade_path", "redundancy"), RedundancyTask)
    result = find_redundancy(robot, config, progress=context.progress)
    metrics = result.metrics()
    figures, pages = draw(result, context.out)
    return ExperimentResult(
        metrics=metrics,
        figures=figures,
        recordings=pages,
        comparison=[
            ComparisonRow(
                "Samples with a lower JCN",
                "samples_lower",
                remark="the article: every one",
            ),
            ComparisonRow("Mean JCN on the surface, initial", "initial.mean_jcn"),
            ComparisonRow("Mean JCN on the surface, optimised", "optimised.mean_jcn"),
            ComparisonRow("Mean JCN on the surface, local method", "local.mean_jcn"),
        ],
        notes=[*NOTES, *result.notices],
        configuration={"robot": robot.name, "task": config},
    )


NOTES = (
    "Mean JCN: <initial.mean_jcn:.2f> at a constant angle, <optimised.mean_jcn:.2f> optimised, "
    "lower at <samples_lower:.0f> of <samples:.0f> samples.",
    "The article's local method: <local.mean_jcn:.2f>.",
    "<constant_angle.angles_kept:.0f> constant angles can be kept: best, middle and worst mean JCN "
    "<constant_angle.best_mean_jcn:.2f> <constant_angle.median_mean_jcn:.2f> "
    "<constant_angle.worst_mean_jcn:.2f>. On the grid of angles the optimum's mean is "
    "<grid.mean_jcn:.3f>.",
    "Position and normal hold to <optimised.position_error_m:.0e> m and "
    "<optimised.normal_error_rad:.0e> rad.",
)


EXPERIMENT = Experiment(
    name="surface-path",
    title="Path on a curved surface with a free redundant angle",
    section="4.4, Figs. 11-13",
    run=run,
    order=50,
    seconds=60,
)
