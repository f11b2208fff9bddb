"""Experiment `article-cycles`: readings by eq. 4 on the simulated arm, as in the article.

The runs and readings are those of `repeat-cycle` and `repeat-cycle-push`, number by number, without
this program's additions. It is no part of a study; a search over arms repeats it.
"""

from typing import Any

import numpy as np

from wrenchsight.analyses.experiments.setups.path_runs.article_method import errors_alone
from wrenchsight.analyses.experiments.setups.path_runs.task_runs import (
    line_of,
    on_path,
    planned_task,
    repetition_torque,
    run_task,
    task_path,
)
from wrenchsight.analyses.methods.reference_sensor.force_errors import force_metrics, reductions
from wrenchsight.analyses.methods.simulate.simulated_logs import ROBOT
from wrenchsight.analyses.study.experiment import Experiment, ExperimentContext, ExperimentResult

ONE_WAY_QUICK = 5.0  # s
_BLOCK = 50_000  # samples read at a time
_PATHS = ("initial", "optimised")


def method_by_repetition(context: ExperimentContext, scenario: str) -> dict[str, Any]:
    """Figures of `RepeatCycle` or `RepeatCyclePush`, by the experiments' keys.

    Args:
        scenario: its name.
    """
    robot = context.robot(ROBOT)
    metrics: dict[str, Any] = {}
    for k, path in enumerate(_PATHS):
        context.progress(0.5 * k, f"{path} path")
        planned = planned_task(context, scenario, ONE_WAY_QUICK)
        motion = line_of(planned)
        period = round(2 * motion.one_way / planned.time_step)
        moved = on_path(planned, robot, *task_path(robot, path))
        run = run_task(moved, robot, path).between(motion.lead_in)
        tau = repetition_torque(run.recording, robot, period)
        q, force = run.recording.q[period:], np.empty((len(tau), 3))
        for start in range(0, len(q), _BLOCK):
            rows = slice(start, start + _BLOCK)
            J = robot.chain.jacobian(q[rows])
            force[rows] = np.linalg.solve(np.swapaxes(J, 1, 2), tau[rows, :, None])[:, 3:, 0]
        metrics[path] = errors_alone(force_metrics(force, 0.0 * force, run.reference[period:]))
    return {**reductions(metrics["initial"], metrics["optimised"]), **metrics}


def run(context: ExperimentContext) -> ExperimentResult:
    """Repeated cycles with and without a hand that pushes."""
    metrics = {
        "repeat-cycle": method_by_repetition(context, "RepeatCycle"),
        "repeat-cycle-push": method_by_repetition(context, "RepeatCyclePush"),
    }
    return ExperimentResult(metrics=metrics)


EXPERIMENT = Experiment(
    name="article-cycles",
    title="The article's method without a model",
    section="4.5",
    run=run,
)
