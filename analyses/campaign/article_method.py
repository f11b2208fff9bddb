"""Experiment `article-method`: what the article's method reads on the simulated arm, and no more.

No part of a study, which has the experiments themselves: it is what a search over arms repeats.
"""

from wrenchsight.analyses.methods.runs.article_method import method_by_model
from wrenchsight.analyses.study.experiment import Experiment, ExperimentContext, ExperimentResult


def run(context: ExperimentContext) -> ExperimentResult:
    """Identification, friction and combined, as far as the article's own method goes."""
    return ExperimentResult(metrics=method_by_model(context))


EXPERIMENT = Experiment(
    name="article-method",
    title="The article's method with a model",
    section="4.1, 4.6, 4.7",
    run=run,
)
