"""Supports README, "Grinding a blade without a force sensor".

Experiment `grinding`: a blade under a varying force, the normal force read (section 5.2).
"""

from wrenchsight.analyses.experiments.setups.machining_runs.machining import MachiningTask
from wrenchsight.analyses.experiments.setups.machining_runs.machining_study import study_machining
from wrenchsight.analyses.study.experiment import Experiment, ExperimentContext, ExperimentResult

TASK = MachiningTask(
    scenario="Grinding",
    sensorless="GrindingSensorless",
    component="normal",
    correlation=(0.7901, 0.5772, 0.4614),
    rmse_n=(12.9954, 19.2482, 22.9833),
    figure="Fig. 27",
    remark="the tool's vibration is fitted to the run of 15 s",
)


def run(context: ExperimentContext) -> ExperimentResult:
    """The experiment `grinding` of `study`."""
    return study_machining(context, TASK)


EXPERIMENT = Experiment(
    name="grinding",
    title="Grinding a blade without a force sensor",
    section="5.2, Figs. 26-27",
    run=run,
    order=120,
    seconds=330,
    readme=("ours.rmse_n",),
)
