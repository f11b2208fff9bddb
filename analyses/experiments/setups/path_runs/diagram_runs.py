"""A task run once in the diagram: the plant moves the arm, every stage of the estimator is a block.

`task_runs.run_task` simulates the same scenario in one compiled loop, which campaigns repeat, and
reads its log. Here the closed loop of `diagrams.closed_loop` runs: the friction law, with its
trained network, is a `SemiParametricFrictionSystem` in the loop's estimator.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from wrenchsight.analyses.experiments.setups.path_runs.task_runs import (
    line_of,
    planned_motion,
    uniform_motion,
)
from wrenchsight.analyses.experiments.setups.path_runs.task_variants import EstimatorVariant
from wrenchsight.analyses.experiments.setups.simulated_arm.arm_models import ArmModels
from wrenchsight.analyses.methods.reference_sensor.force_errors import VariantReading
from wrenchsight.analyses.methods.simulate.advance import run_loop
from wrenchsight.analyses.study.experiment import ExperimentContext
from wrenchsight.diagrams.closed_loop import LogRequest, LoopEstimator, make_closed_loop
from wrenchsight.diagrams.scenario import Scenario
from wrenchsight.models.estimation.estimator import WrenchEstimator
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.robot.robot import Robot

LOG_PERIOD = 0.01  # s; the estimator takes every tick
_PROGRESS_PERIOD = 1.0  # s between two reports of progress


def read_in_diagram(
    name: str,
    scenario: Scenario,
    robot: Robot,
    estimator: WrenchEstimator,
    progress: Callable[[float], None],
) -> VariantReading:
    """Simulates a scenario in the diagram and returns what its estimator reads.

    Args:
        name: name of the reading.
        scenario: scenario of a straight path, with a force/torque sensor or without.
        robot: with its simulated truth.
        estimator: whose model and configuration the loop's estimator gets. The controller has the
            robot's nominal model, as in `run_task`.
        progress: called with the share that is done, 0 to 1.

    Returns:
        The reading every LOG_PERIOD of the even motion along the path, without the observer's
        `settling_time` at its start; beside it the sensor's force, or the true one without a
        sensor.
    """
    reference = "wrench_true" if scenario.force_torque_sensor is None else "ft_wrench"
    loop = make_closed_loop(
        replace(scenario, estimator=estimator.config),
        robot,
        IdentifiedModel.nominal(robot),
        motion=planned_motion(scenario, robot, everywhere=False),
        estimator=LoopEstimator(model=estimator.model),
        log=LogRequest(only=["wrench", "covariance", reference], period=LOG_PERIOD),
    )
    t, logged = run_loop(loop, scenario.duration, _PROGRESS_PERIOD, progress)
    start, end = uniform_motion(line_of(scenario))
    rows = (t >= start + estimator.observer.settling_time) & (t <= end)
    covariance = logged["covariance"][rows].reshape(-1, 6, 6)
    return VariantReading(
        name=name,
        t=t[rows],
        force=logged["wrench"][rows, 3:],
        sd=np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)[:, 3:]),
        reference=logged[reference][rows, 3:],
    )


def diagram_metrics(
    context: ExperimentContext,
    models: ArmModels,
    scenario: Scenario,
    variant: EstimatorVariant,
    speed: float,
) -> dict[str, Any]:
    """Figures of a variant read in the diagram, as `VariantReading.metrics`.

    Args:
        scenario: scenario of the path that the variant is read on.
        speed: rad/s, the highest planned joint speed of the task.
    """
    estimator = models.estimator(
        variant.law, speed, variant.K_0, WrenchReconstructionConfig(variant.method)
    )

    def progress(share: float) -> None:
        context.progress(0.9 + 0.08 * share, f"in the diagram, {100.0 * share:.0f} %")

    return read_in_diagram(variant.label, scenario, models.robot, estimator, progress).metrics()
