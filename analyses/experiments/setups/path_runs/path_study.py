"""Common parts of the experiments along the article's paths: their arm, runs and result."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

from wrenchsight.analyses.experiments.setups.path_runs.task_runs import (
    TaskRun,
    line_of,
    planned_task,
    run_task,
    uniform_motion,
    write_runs_page,
)
from wrenchsight.analyses.experiments.setups.simulated_arm.arm_models import ArmModels, identify_arm
from wrenchsight.analyses.methods.reference_sensor.force_errors import variants_figure
from wrenchsight.analyses.methods.simulate.simulated_logs import ROBOT
from wrenchsight.analyses.study.experiment import (
    ComparisonRow,
    Drawing,
    ExperimentContext,
    ExperimentResult,
)
from wrenchsight.diagrams.scenario import Scenario

ONE_WAY_QUICK = 8.0  # s, of a pushed pass


@dataclass(frozen=True)
class PathPage:
    """Texts and rows of an experiment along the article's paths, for the report.

    Attributes:
        title: title of the page on which the arm moves.
        passes: along the path, in each run.
        variants: rows of the table, each with a `key` of the metrics and a `label`.
        comparison: rows of the table "article / here".
        notes: for the report, see `filled`.
        caption: caption of the figure of all variants.
    """

    title: str
    passes: int
    variants: Sequence[Any]
    comparison: Sequence[ComparisonRow]
    notes: Sequence[str]
    caption: str = "Errors of every variant."


def path_result(
    context: ExperimentContext,
    runs: Mapping[str, TaskRun],
    metrics: dict[str, Any],
    figures: Iterable[Drawing],
    configuration: Mapping[str, Any],
    page: PathPage,
) -> ExperimentResult:
    """The result of an experiment along the article's paths.

    Args:
        runs: by path.
        metrics: with those of each variant.
        figures: besides that of all variants; not made where nobody looks at them.
        configuration: besides the variants.
        page: its description in the report.
    """
    context.progress(0.93, "figures")
    pages = []
    if context.draws:
        pages = [write_runs_page(context.robot(ROBOT), runs, page.passes, context.out, page.title)]

    def of_variants() -> Iterator[Drawing]:
        labels = {variant.key: variant.label for variant in page.variants}
        figure = variants_figure(metrics, labels, f"{page.title}: one change per row")
        yield (
            "variants",
            figure,
            f"{page.caption} Grey: where the share inside a correct 95 % band lies.",
        )

    return ExperimentResult(
        metrics=metrics,
        figures=chain(figures, of_variants()),
        recordings=pages,
        comparison=page.comparison,
        notes=page.notes,
        configuration={**configuration, "variants": page.variants},
    )


def pushed_arm(
    context: ExperimentContext, scenario: str, share: float
) -> tuple[ArmModels, Scenario]:
    """The arm's models and the scenario of a pushed pass.

    Args:
        share: share of the progress that is reached.
    """
    robot, report = context.robot(ROBOT), context.part(0.0, share)
    models = identify_arm(robot, context.seed, context.quick, report, context.draws)
    return models, planned_task(context, scenario, ONE_WAY_QUICK)


def pushed_runs(
    context: ExperimentContext, models: ArmModels, scenarios: Mapping[str, Scenario], start: float
) -> dict[str, TaskRun]:
    """The runs of scenarios by path, where the arm moves evenly; progress from `start` to 0.85."""
    runs: dict[str, TaskRun] = {}
    for k, (path, scenario) in enumerate(scenarios.items()):
        done = start + (0.85 - start) * k / len(scenarios)
        context.progress(done, f"simulating, {path} path")
        run = run_task(scenario, models.robot, path)
        runs[path] = run.between(*uniform_motion(line_of(scenario)))
    context.progress(0.86, "readings")
    return runs
