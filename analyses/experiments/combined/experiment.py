"""Supports README, "Semi-parametric friction and optimised path together, pushed by hand".

Experiment `combined`: optimised path and better friction together (section 4.7, Figs. 20, 21).

The arm goes from one end of its path to the other in 100 s while a hand pushes, alike in every run.
The article's first experiment (initial path, Coulomb-viscous friction) is compared with its second
(optimised path, semi-parametric friction). This program's additions follow, one change a row.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from wrenchsight.analyses.experiments.setups.path_runs.article_paths import found_path
from wrenchsight.analyses.experiments.setups.path_runs.diagram_runs import diagram_metrics
from wrenchsight.analyses.experiments.setups.path_runs.path_study import (
    PathPage,
    path_result,
    pushed_arm,
    pushed_runs,
)
from wrenchsight.analyses.experiments.setups.path_runs.task_runs import (
    PATHS,
    highest_speed,
    scenario_on_path,
    task_path,
)
from wrenchsight.analyses.experiments.setups.path_runs.task_variants import (
    FAST_GAIN,
    EstimatorVariant,
    axes_figure,
    known_friction,
    lag_alone,
    read_variants,
)
from wrenchsight.analyses.methods.reference_sensor.force_errors import VariantReading, reductions
from wrenchsight.analyses.output.figures import COLOUR
from wrenchsight.analyses.study.experiment import (
    ComparisonRow,
    Drawing,
    Experiment,
    ExperimentContext,
    ExperimentResult,
)
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.rigid_body.spatial_vectors import AXES

SCENARIO = "Combined"
CV, SP = "coulomb-viscous", "semi-parametric"
# Keys of variants: the article's first and second experiment, and all of this program's additions.
BEFORE, AFTER, OURS = "initial", "optimised", "ours"
VARIANTS = (
    EstimatorVariant(BEFORE, "article: initial path, Coulomb-viscous", "initial", CV),
    EstimatorVariant("initial_semi_parametric", "+ semi-parametric", "initial", SP),
    EstimatorVariant("optimised_coulomb_viscous", "or optimised path", "optimised", CV),
    EstimatorVariant(AFTER, "article: both", "optimised", SP),
    EstimatorVariant("faster", f"+ K$_0$ = {FAST_GAIN:g}", "optimised", SP, "inverse", FAST_GAIN),
    EstimatorVariant("bayesian", "+ bayesian (B)", "optimised", SP, "bayesian", FAST_GAIN),
    EstimatorVariant(
        "force_only", "B with force_only instead", "optimised", SP, "force_only", FAST_GAIN
    ),
    EstimatorVariant(
        "presliding", "B, presliding", "optimised", "presliding", "bayesian", FAST_GAIN
    ),
    EstimatorVariant("least_jcn", "B, path of least JCN", "found", SP, "bayesian", FAST_GAIN),
    EstimatorVariant(OURS, "B, path of least force sd: ours", "placed", SP, "bayesian", FAST_GAIN),
)


DIAGRAM_NOTE = (
    "In the diagram (the plant moves the arm, every stage is a block, the trained network is in "
    "the block of the friction law) both measures together read with <in_diagram.rmse_x_n:.2f> "
    "<in_diagram.rmse_y_n:.2f> <in_diagram.rmse_z_n:.2f> N (X Y Z)."
)


def _comparison() -> list[ComparisonRow]:
    """The rows of the report: the article's numbers for each axis, and ours beside them."""
    slow = "Coulomb-viscous friction misses the true arm's Stribeck rise at this speed"
    # The article's numbers for X Y Z, N and %; "without" and "with" its method.
    rmse_without, rmse_with = (12.6891, 14.3286, 4.6852), (6.5627, 7.6607, 4.3901)
    reduction_pct = (48.28, 46.53, 6.30)
    largest_without, largest_with = (75.2268, 52.4015, 38.7453), (51.0333, 32.3707, 18.6869)

    def pair(label: str, key: str, without: float, with_it: float) -> list[ComparisonRow]:
        """A figure without the article's method, and with it."""
        ours = f"{OURS}.{key}"
        return [
            ComparisonRow(f"{label}, without", f"{BEFORE}.{key}", article=without, remark=slow),
            ComparisonRow(f"{label}, with", f"{AFTER}.{key}", article=with_it, ours=ours),
        ]

    rows = []
    for k, axis in enumerate(AXES):
        name = axis.upper()
        rows += [
            *pair(f"RMSE in {name}", f"rmse_{axis}_n", rmse_without[k], rmse_with[k]),
            ComparisonRow(
                f"Reduction of the RMSE in {name}",
                f"reduction_rmse_{axis}_pct",
                article=reduction_pct[k],
            ),
            *pair(
                f"Largest error in {name}",
                f"max_error_{axis}_n",
                largest_without[k],
                largest_with[k],
            ),
        ]
    rows += [
        ComparisonRow(
            f"RMSE in {axis.upper()}, ours against the article's method",
            f"ours_against_article.reduction_rmse_{axis}_pct",
        )
        for axis in AXES
    ]
    return [*rows, ComparisonRow("Share in the 95 % band, ours", "ours.share_in_95_band")]


def _errors(key: str) -> str:
    return f"<{key}.rmse_x_n:.2f> <{key}.rmse_y_n:.2f> <{key}.rmse_z_n:.2f> N"


NOTES = (
    f"RMSE in X, Y, Z: {_errors(BEFORE)} (article, initial path, Coulomb-viscous), "
    f"{_errors(AFTER)} (article, both measures; reduced by <reduction_rmse_x_pct:.1f> "
    "<reduction_rmse_y_pct:.1f> <reduction_rmse_z_pct:.1f> %).",
    f"Ours (K_0 = {FAST_GAIN:g}, bayesian, path of least force sd): {_errors(OURS)}, "
    "<ours_against_article.reduction_rmse_x_pct:.1f> "
    "<ours_against_article.reduction_rmse_y_pct:.1f> "
    "<ours_against_article.reduction_rmse_z_pct:.1f> % below the article's. On the article's "
    f"path: {_errors('bayesian')}; with `presliding` {_errors('presliding')}; with `force_only` "
    f"{_errors('force_only')}; on the path of least mean condition number {_errors('least_jcn')}.",
    f"With the true friction: {_errors('known_friction')} at K_0 = 20, of which the lag makes "
    f"{_errors('lag_alone')}; {_errors('known_friction_fast')} and {_errors('lag_alone_fast')} at "
    f"K_0 = {FAST_GAIN:g}.",
    "Inside the stated 95 % band: "
    + ", ".join(
        f"<{variant.key}.share_in_95_band:100 .0f> % ({variant.key})" for variant in VARIANTS
    )
    + ".",
)


def run(context: ExperimentContext) -> ExperimentResult:
    """The experiment `combined` of `study`.

    Scenarios and simulated runs are kept by path (PATHS, and "placed": the path of least force sd
    for our model); readings and metrics by variant (VARIANTS), beside comparisons of two of them.
    """
    models, scenario = pushed_arm(context, SCENARIO, share=0.35)
    robot = models.robot
    scenarios = {path: scenario_on_path(scenario, robot, *task_path(robot, path)) for path in PATHS}
    # rad/s, for which the error of friction is stated
    speed = highest_speed(list(scenarios.values()), robot)
    context.progress(0.35, "placing the path")
    bayesian = models.estimator(SP, speed, FAST_GAIN, WrenchReconstructionConfig("bayesian"))
    # Seed 0 whatever the study's: all its runs have the same path.
    path, posture = found_path(robot, seed=0, model=bayesian.model)
    scenarios["placed"] = scenario_on_path(scenario, robot, path, posture)
    runs = pushed_runs(context, models, scenarios, start=0.45)
    readings = read_variants(models, runs, VARIANTS, speed)
    metrics: dict[str, Any] = {key: entry.metrics() for key, entry in readings.items()}
    initial, optimised = metrics[BEFORE], metrics[AFTER]
    # Bounds for the article's method on its own path, at both gains: errors without any error of
    # friction, and those of the observer's lag alone.
    metrics["known_friction"] = known_friction(models, runs["optimised"])
    metrics["known_friction_fast"] = known_friction(models, runs["optimised"], FAST_GAIN)
    metrics["lag_alone"] = lag_alone(runs["optimised"])
    metrics["lag_alone_fast"] = lag_alone(runs["optimised"], FAST_GAIN)
    metrics["ours_against_article"] = reductions(optimised, metrics[OURS])
    metrics["bayesian_against_article"] = reductions(optimised, metrics["bayesian"])
    metrics["correlation_gain"] = {
        axis: optimised[f"correlation_{axis}"] - initial[f"correlation_{axis}"] for axis in AXES
    }
    metrics["mean_jcn"] = {path: float(run.condition_number.mean()) for path, run in runs.items()}
    notes: tuple[str, ...] = NOTES
    if context.draws:  # a campaign repeats the compiled loop alone
        [variant] = [variant for variant in VARIANTS if variant.key == AFTER]
        metrics["in_diagram"] = diagram_metrics(
            context, models, scenarios[variant.path], variant, speed
        )
        notes += (DIAGRAM_NOTE,)
    return path_result(
        context,
        runs,
        metrics={**reductions(initial, optimised), **metrics},
        figures=_figures(readings),
        configuration={"scenarios": scenarios, "speed_rad_per_s": speed},
        page=PathPage(
            title="Pushed by hand along the path",
            passes=1,
            variants=VARIANTS,
            comparison=_comparison(),
            notes=notes,
            caption="Errors of every variant. A row with + changes the row above it, one with B "
            "the row marked (B).",
        ),
    )


def _figures(readings: dict[str, VariantReading]) -> Iterator[Drawing]:
    """Three figures of the force over time, to the scale of the reading without the method.

    Args:
        readings: by key of VARIANTS.
    """
    largest = [float(np.abs(readings[BEFORE].force[:, k]).max()) for k in range(3)]  # N
    limits = np.array([1.15 * force for force in largest])  # with some room above
    for name, key, colour, title, caption in (
        (
            "without",
            BEFORE,
            COLOUR["before"],
            "Without the article's method: initial path, Coulomb-viscous",
            "Force read on the initial path with Coulomb-viscous friction (Fig. 20).",
        ),
        (
            "with",
            AFTER,
            COLOUR["after"],
            "With it: optimised path, semi-parametric",
            "Force read on the optimised path with semi-parametric friction (Fig. 21), to the "
            "same scale.",
        ),
        (
            "ours",
            OURS,
            COLOUR["estimate"],
            f"Ours: path of least force sd, bayesian, K$_0$ = {FAST_GAIN:g}",
            "Force read by this program, to the same scale.",
        ),
    ):
        yield name, axes_figure(readings[key], title, colour, limits), caption


EXPERIMENT = Experiment(
    name="combined",
    title="Semi-parametric friction and optimised path together, pushed by hand",
    section="4.7, Figs. 20-21",
    run=run,
    order=100,
    readme=("reduction_rmse_x_pct",),
)
