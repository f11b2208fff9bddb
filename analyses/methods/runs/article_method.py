"""What the article's method reads on the simulated arm, and nothing else: a fast look at one arm.

The same logs, models and readings as in the experiments of these names, number by number, without
what this program adds to them: `identification`, `friction` and `combined` (`method_by_model`),
`repeat-cycle` and `repeat-cycle-push` (`method_by_repetition`).
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from wrenchsight.analyses.methods.arms.arm_models import article_models
from wrenchsight.analyses.methods.arms.simulated_logs import ROBOT
from wrenchsight.analyses.methods.reading.force_errors import force_metrics, reductions
from wrenchsight.analyses.methods.reading.repetition import repetition_torque
from wrenchsight.analyses.methods.runs.task_runs import (
    TaskRun,
    on_path,
    read_run,
    run_task,
    task_path,
    task_scenario,
    uniform_motion,
)
from wrenchsight.analyses.study.experiment import ExperimentContext
from wrenchsight.diagrams.scenario import LineMotion
from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.robot.robot import Robot

K_0 = 20.0  # 1/s, the article's
ONE_WAY_QUICK, CYCLE_QUICK = 8.0, 5.0  # s
_BLOCK = 50_000  # samples read at a time
_PATHS = ("initial", "optimised")


def method_by_model(context: ExperimentContext) -> dict[str, Any]:
    """Figures of identification, friction and combined, by experiment and the experiment's key."""
    robot = context.robot(ROBOT)
    context.progress(0.0, "identification")
    result, semi_parametric = article_models(robot, context.seed, context.quick)
    one_way = ONE_WAY_QUICK if context.quick else None
    laws = {"coulomb_viscous": result.model, "semi_parametric": semi_parametric}
    read = {law: _estimator(robot, model) for law, model in laws.items()}

    def figures(run: TaskRun, law: str) -> dict[str, Any]:
        return _errors(read_run(law, run, read[law]).metrics())

    context.progress(0.5, "friction")
    turned = _task(context, robot, "FrictionAtReversal", "initial", one_way)
    friction = {law: figures(turned, law) for law in laws}
    context.progress(0.7, "combined")
    before = figures(_task(context, robot, "Combined", "initial", one_way), "coulomb_viscous")
    after = figures(_task(context, robot, "Combined", "optimised", one_way), "semi_parametric")
    return {
        "identification": {"cross_validation": {"rmse_nm": result.validation[0].rmse}},
        "friction": {
            **friction,
            **reductions(friction["coulomb_viscous"], friction["semi_parametric"]),
        },
        "combined": {"initial": before, "optimised": after, **reductions(before, after)},
    }


def method_by_repetition(context: ExperimentContext, scenario: str) -> dict[str, Any]:
    """Figures of `RepeatCycle` or `RepeatCyclePush`, by the experiments' keys.

    Args:
        context: of an experiment.
        scenario: its name.
    """
    robot = context.robot(ROBOT)
    found: dict[str, Any] = {}
    for k, path in enumerate(_PATHS):
        context.progress(0.5 * k, f"{path} path")
        planned = task_scenario(scenario, context.seed, CYCLE_QUICK if context.quick else None)
        motion = planned.motion
        assert isinstance(motion, LineMotion)
        period = round(2 * motion.one_way / planned.time_step)
        moved = on_path(planned, robot, *task_path(robot, path))
        run = run_task(moved, robot, path).between(motion.lead_in)
        tau = repetition_torque(run.recording, robot, period)
        q, force = run.recording.q[period:], np.empty((len(tau), 3))
        for start in range(0, len(q), _BLOCK):
            rows = slice(start, start + _BLOCK)
            J = robot.chain.jacobian(q[rows])
            force[rows] = np.linalg.solve(np.swapaxes(J, 1, 2), tau[rows, :, None])[:, 3:, 0]
        found[path] = _errors(force_metrics(force, 0.0 * force, run.reference[period:]))
    return {**reductions(found["initial"], found["optimised"]), **found}


def _task(
    context: ExperimentContext, robot: Robot, name: str, path: str, one_way: float | None
) -> TaskRun:
    scenario = task_scenario(name, context.seed, one_way)
    scenario = on_path(scenario, robot, *task_path(robot, path))
    motion = scenario.motion
    assert isinstance(motion, LineMotion)
    return run_task(scenario, robot, path).between(*uniform_motion(motion))


def _estimator(robot: Robot, model: Any) -> WrenchEstimator:
    """Eq. 22, that no stated covariance changes."""
    config = WrenchEstimatorConfig(
        MomentumObserverConfig([K_0]), WrenchReconstructionConfig("inverse")
    )
    return WrenchEstimator(robot, replace(model, torque_error=None), config)


def _errors(metrics: Mapping[str, Any]) -> dict[str, Any]:
    """RMSE and largest error by axis."""
    return {key: value for key, value in metrics.items() if key.startswith(("rmse", "max_error"))}
