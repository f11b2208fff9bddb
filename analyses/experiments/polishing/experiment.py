"""Supports docs/worlds.md, "In polishing nothing vibrates".

Experiment `polishing`: a plate under a held force, the tangential force read (section 5.1).
"""

from wrenchsight.analyses.experiments.setups.machining_runs.machining import MachiningTask
from wrenchsight.analyses.experiments.setups.machining_runs.machining_study import study_machining
from wrenchsight.analyses.study.experiment import Experiment, ExperimentContext, ExperimentResult

TASK = MachiningTask(
    scenario="Polishing",
    sensorless="PolishingSensorless",
    component="tangential",
    correlation=(0.9534, 0.9538, 0.9415),
    rmse_n=(3.0845, 3.5468, 4.7082),
    figure="Fig. 25",
    remark="the simulated arm is fitted to the run of 15 s",
)


def run(context: ExperimentContext) -> ExperimentResult:
    """The experiment `polishing` of `study`."""
    return study_machining(context, TASK)


EXPERIMENT = Experiment(
    name="polishing",
    title="Polishing a plate without a force sensor",
    section="5.1, Figs. 24-25",
    run=run,
    order=110,
    seconds=240,
)
