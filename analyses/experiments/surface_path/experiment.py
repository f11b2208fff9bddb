"""Experiment `surface-path`: what is the free angle about the normal worth (section 4.4)?

The bundled path on a blade, as `redundancy` uses it: at a constant angle, by the local method that
the article uses, and the optimum (Figs. 11-13).
"""

from typing import Any

from wrenchsight.analyses.methods.planning.redundancy import ROUNDING, find_redundancy
from wrenchsight.analyses.methods.planning.redundancy_results import draw
from wrenchsight.analyses.methods.planning.redundancy_task import RedundancyTask
from wrenchsight.analyses.study.experiment import (
    ComparisonRow,
    Experiment,
    ExperimentContext,
    ExperimentResult,
)
from wrenchsight.models.files.configuration import load_configuration
from wrenchsight.models.files.task_files import task_file
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
                "Samples with a lower JCN", "samples_lower", "", None, "the article: every one"
            ),
            ComparisonRow("Mean JCN on the surface, initial", "initial.mean_jcn", "", None),
            ComparisonRow("Mean JCN on the surface, optimised", "optimised.mean_jcn", "", None),
            ComparisonRow("Mean JCN on the surface, local method", "local.mean_jcn", "", None),
        ],
        notes=[*findings(metrics, config.num_angles), *result.notices],
        configuration={"robot": robot.name, "task": config},
    )


def findings(metrics: dict[str, Any], num_angles: int) -> list[str]:
    """What the figures say, in sentences."""
    constant, found = metrics["constant_angle"], metrics["optimised"]
    before, after = metrics["initial"]["mean_jcn"], found["mean_jcn"]
    local = (
        f"the local method that the article uses ends at {metrics['local']['mean_jcn']:.2f}"
        if "local" in metrics
        else "the local method that the article uses cannot follow the path"
    )
    return [
        f"The free angle about the normal takes the mean JCN from {before:.2f} to {after:.2f} "
        f"and lowers it at {metrics['samples_lower']} of {metrics['samples']} samples; {local}.",
        "The initial trajectory keeps the angle 0, at which the tool leans along the path. No "
        "figure of the article says how good its own was. Of the angles on the grid "
        f"{constant['angles_kept']} can be kept from end to end: at the best of them, on its "
        f"best branch, the mean is {constant['best_mean_jcn']:.2f}, at the middle one "
        f"{constant['median_mean_jcn']:.2f}, at the worst {constant['worst_mean_jcn']:.2f}.",
        "Joint 3 is kept between -120 and 90 deg, so that the elbow stays above the blade: "
        "collisions are not checked otherwise.",
        "The tool is held at 45 deg to the surface's normal, as an inclined spindle is. Held "
        "along the normal, its axis would be that of joint 6, on which no JCN depends: then "
        "only the branch can be chosen.",
        f"Position and normal hold to {max(ROUNDING, found['position_error_m']):.0e} m and "
        f"{max(ROUNDING, found['normal_error_rad']):.0e} rad. On the grid of {num_angles} angles "
        f"the optimum's mean is {metrics['grid']['mean_jcn']:.3f}; refined, {after:.3f}.",
    ]


EXPERIMENT = Experiment(
    name="surface-path",
    title="A path on a curved surface, with the angle about the normal free",
    section="4.4, Figs. 11-13",
    run=run,
    order=50,
    seconds=60,
)
