"""Experiment `article-method`: readings by the article's method alone on the simulated arm.

The logs, models and readings are those of `identification`, `friction` and `combined`, without this
program's additions. The numbers agree to a thousandth. They differ in the stated torque error,
which keeps eq. 22 finite next to a singularity. It is no part of a study, which holds the
experiments themselves; a search over arms repeats it.
"""

from collections.abc import Mapping
from typing import Any

from wrenchsight.analyses.experiments.setups.path_runs.task_runs import (
    TaskRun,
    line_of,
    on_path,
    planned_task,
    read_run,
    run_task,
    task_path,
    uniform_motion,
)
from wrenchsight.analyses.experiments.setups.path_runs.task_variants import inverse_estimator
from wrenchsight.analyses.experiments.setups.simulated_arm.arm_models import article_models
from wrenchsight.analyses.methods.reference_sensor.force_errors import reductions
from wrenchsight.analyses.methods.simulate.simulated_logs import ROBOT
from wrenchsight.analyses.study.experiment import Experiment, ExperimentContext, ExperimentResult
from wrenchsight.models.robot.robot import Robot

ONE_WAY_QUICK = 8.0  # s


def method_by_model(context: ExperimentContext) -> dict[str, Any]:
    """Figures of identification, friction and combined, by experiment and the experiment's key."""
    robot = context.robot(ROBOT)
    context.progress(0.0, "identification")
    result, semi_parametric = article_models(robot, context.seed, context.quick)
    laws = {"coulomb_viscous": result.model, "semi_parametric": semi_parametric}
    read = {law: inverse_estimator(robot, model) for law, model in laws.items()}

    def figures(run: TaskRun, law: str) -> dict[str, Any]:
        return errors_alone(read_run(law, run, read[law]).metrics())

    context.progress(0.5, "friction")
    turned = _task(context, robot, "FrictionAtReversal", "initial")
    friction = {law: figures(turned, law) for law in laws}
    context.progress(0.7, "combined")
    initial = figures(_task(context, robot, "Combined", "initial"), "coulomb_viscous")
    optimised = figures(_task(context, robot, "Combined", "optimised"), "semi_parametric")
    return {
        "identification": {"cross_validation": {"rmse_nm": result.validation[0].rmse}},
        "friction": {
            **friction,
            **reductions(friction["coulomb_viscous"], friction["semi_parametric"]),
        },
        "combined": {"initial": initial, "optimised": optimised, **reductions(initial, optimised)},
    }


def _task(context: ExperimentContext, robot: Robot, name: str, path: str) -> TaskRun:
    scenario = planned_task(context, name, ONE_WAY_QUICK)
    scenario = on_path(scenario, robot, *task_path(robot, path))
    return run_task(scenario, robot, path).between(*uniform_motion(line_of(scenario)))


def errors_alone(metrics: Mapping[str, Any]) -> dict[str, Any]:
    """RMSE and largest error by axis."""
    return {key: value for key, value in metrics.items() if key.startswith(("rmse", "max_error"))}


def run(context: ExperimentContext) -> ExperimentResult:
    """Identification, friction and combined, as far as the article's own method goes."""
    return ExperimentResult(metrics=method_by_model(context))


EXPERIMENT = Experiment(
    name="article-method",
    title="The article's method with a model",
    section="4.1, 4.6, 4.7",
    run=run,
)
