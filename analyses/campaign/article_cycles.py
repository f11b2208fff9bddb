"""Experiment `article-cycles`: what eq. 4 reads on the simulated arm, as the article has it.

No part of a study, which has the experiments themselves: it is what a search over arms repeats.
"""

from wrenchsight.analyses.methods.runs.article_method import method_by_repetition
from wrenchsight.analyses.study.experiment import Experiment, ExperimentContext, ExperimentResult


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
