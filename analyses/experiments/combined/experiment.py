"""Experiment `combined`: everything together (section 4.7, Figs. 20 and 21).

The arm goes from one end of its path to the other in 100 s while a hand pushes, alike in every run.
The article's first experiment (initial path, Coulomb-viscous friction) against its second
(optimised path, semi-parametric friction), then what this program adds, one change per row.
"""

from typing import TYPE_CHECKING, Any

import numpy as np

from wrenchsight.analyses.experiments.setups.path_runs.article_paths import found_path
from wrenchsight.analyses.experiments.setups.path_runs.task_runs import (
    PATHS,
    TaskRun,
    highest_speed,
    on_path,
    run_task,
    task_path,
    task_scenario,
    uniform_motion,
    write_runs_page,
)
from wrenchsight.analyses.experiments.setups.path_runs.task_variants import (
    FAST,
    EstimatorVariant,
    axes_figure,
    known_friction,
    lag_alone,
    read_variants,
)
from wrenchsight.analyses.experiments.setups.simulated_arm.arm_models import identify_arm
from wrenchsight.analyses.methods.reading.force_errors import (
    ForceReading,
    draw_signal,
    reductions,
    variants_figure,
)
from wrenchsight.analyses.methods.runs.simulated_logs import ROBOT
from wrenchsight.analyses.output.figures import COLOUR, legend_below, new_figure
from wrenchsight.analyses.study.experiment import (
    ComparisonRow,
    Experiment,
    ExperimentContext,
    ExperimentResult,
    FigureFile,
)
from wrenchsight.analyses.study.figure_files import saved_figures
from wrenchsight.analyses.study.wording import change, compared, listed
from wrenchsight.diagrams.scenario import LineMotion
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.rigid_body.spatial_vectors import AXES

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SCENARIO = "Combined"
ONE_WAY_QUICK = 8.0  # s
CV, SP = "coulomb-viscous", "semi-parametric"
BEFORE, AFTER, OURS = "initial", "optimised", "ours"
VARIANTS = (
    EstimatorVariant(BEFORE, "article: initial path, Coulomb-viscous", "initial", CV),
    EstimatorVariant("initial_semi_parametric", "+ semi-parametric", "initial", SP),
    EstimatorVariant("optimised_coulomb_viscous", "or optimised path", "optimised", CV),
    EstimatorVariant(AFTER, "article: both", "optimised", SP),
    EstimatorVariant("faster", f"+ K$_0$ = {FAST:g}", "optimised", SP, "inverse", FAST),
    EstimatorVariant("bayesian", "+ bayesian (B)", "optimised", SP, "bayesian", FAST),
    EstimatorVariant(
        "force_only", "B with force_only instead", "optimised", SP, "force_only", FAST
    ),
    EstimatorVariant("presliding", "B, presliding", "optimised", "presliding", "bayesian", FAST),
    EstimatorVariant("least_jcn", "B, path of least JCN", "found", SP, "bayesian", FAST),
    EstimatorVariant(OURS, "B, path of least force sd: ours", "placed", SP, "bayesian", FAST),
)


def run(context: ExperimentContext) -> ExperimentResult:
    """The experiment `combined` of `study`."""
    robot = context.robot(ROBOT)
    models = identify_arm(
        robot,
        context.seed,
        context.quick,
        lambda s, what: context.progress(0.35 * s, what),
        contact_noise=context.draws,
    )
    scenario = task_scenario(SCENARIO, context.seed, ONE_WAY_QUICK if context.quick else None)
    scenarios = {path: on_path(scenario, robot, *task_path(robot, path)) for path in PATHS}
    speed = highest_speed(list(scenarios.values()), robot)
    context.progress(0.35, "placing the path")
    bayesian = models.estimator(SP, speed, FAST, WrenchReconstructionConfig("bayesian"))
    scenarios["placed"] = on_path(scenario, robot, *found_path(robot, 0, bayesian.model))
    motion = scenario.motion
    assert isinstance(motion, LineMotion)
    runs: dict[str, TaskRun] = {}
    for k, (path, own) in enumerate(scenarios.items()):

        def told(share: float, what: str, k: int = k) -> None:
            context.progress(0.45 + 0.4 * (k + share) / len(scenarios), what)

        runs[path] = run_task(own, robot, path, told).between(*uniform_motion(motion))
    context.progress(0.86, "readings")
    readings = read_variants(models, runs, VARIANTS, speed)
    metrics: dict[str, Any] = {key: own.metrics() for key, own in readings.items()}
    metrics["known_friction"] = known_friction(models, runs["optimised"])
    metrics["known_friction_fast"] = known_friction(models, runs["optimised"], FAST)
    metrics["lag_alone"] = lag_alone(runs["optimised"])
    metrics["lag_alone_fast"] = lag_alone(runs["optimised"], FAST)
    metrics["ours_against_article"] = reductions(metrics[AFTER], metrics[OURS])
    metrics["bayesian_against_article"] = reductions(metrics[AFTER], metrics["bayesian"])
    metrics["correlation_gain"] = {
        axis: metrics[AFTER][f"correlation_{axis}"] - metrics[BEFORE][f"correlation_{axis}"]
        for axis in AXES
    }
    metrics["mean_jcn"] = {path: float(own.condition_number.mean()) for path, own in runs.items()}
    metrics = {**reductions(metrics[BEFORE], metrics[AFTER]), **metrics}
    context.progress(0.93, "figures")
    return ExperimentResult(
        metrics=metrics,
        figures=_figures(context, readings, metrics) if context.draws else [],
        recordings=[write_runs_page(robot, runs, 1, context.out, "Pushed by hand along the path")]
        if context.draws
        else [],
        comparison=_comparison(),
        notes=findings(metrics),
        configuration={
            "scenarios": scenarios,
            "variants": VARIANTS,
            "speed_rad_per_s": speed,
        },
    )


def _three(metrics: dict[str, Any], key: str = "rmse_{}_n") -> str:
    return " ".join(f"{metrics[key.format(axis)]:.2f}" for axis in AXES)


def _changes(metrics: dict[str, Any]) -> str:
    """By how much the RMSE falls, axis by axis."""
    return ", ".join(change(metrics[f"reduction_rmse_{axis}_pct"]) for axis in AXES)


def _axes(metrics: dict[str, Any], variant: str) -> str:
    """Along which axes a variant errs less, and more, than the row (B) that it changes."""
    before, after = metrics["bayesian"], metrics[variant]
    words = {
        axis: compared(
            after[f"rmse_{axis}_n"], before[f"rmse_{axis}_n"], "less", "more", "as much", 0.02
        )
        for axis in AXES
    }
    said = listed(f"{axis.upper()} errs {word}" for axis, word in words.items())
    return f"{said}, beside (B)"


def findings(metrics: dict[str, Any]) -> list[str]:
    """What the figures say, in sentences."""
    before, after, ours = (metrics[key] for key in (BEFORE, AFTER, OURS))
    shares = ", ".join(
        f"{100 * metrics[v.key]['share_in_95_band']:.0f} % ({v.key})" for v in VARIANTS
    )
    return [
        f"The article's two measures together take the RMSE in X, Y, Z from {_three(before)} to "
        f"{_three(after)} N ({_changes(metrics)}), the correlation "
        f"from {_three(before, 'correlation_{}')} to {_three(after, 'correlation_{}')}.",
        f"Ours on top (K_0 = {FAST:g}, bayesian, path of least force sd) reads {_three(ours)} N: "
        f"{_changes(metrics['ours_against_article'])} than the article's method. On the article's "
        f"own path: {_three(metrics['bayesian'])} N.",
        f"Without the two measures the errors are to one side by {_three(before, 'bias_{}_n')} N "
        "in the mean. On the optimised path Coulomb-viscous friction alone reads "
        f"{_three(metrics['optimised_coulomb_viscous'])} N; with the true friction known the "
        f"article's reading there would err by {_three(metrics['known_friction'])} "
        f"N, of which {_three(metrics['lag_alone'])} N are the lag of K_0 = 20 behind a hand of up "
        f"to 3 Hz; with K_0 = {FAST:g} by {_three(metrics['known_friction_fast'])} N and "
        f"{_three(metrics['lag_alone_fast'])} N.",
        "No law here contains ripple over position and load dependence: they remain. With "
        f"`presliding` {_axes(metrics, 'presliding')} "
        f"({_three(metrics['presliding'])} N): it knows elastic creep before sliding, which dry "
        "friction (`--truth plain`) does not have.",
        f"With `force_only` {_axes(metrics, 'force_only')} ({_three(metrics['force_only'])} N): it "
        "trusts the light wrist joints most, and these hardly move on the article's paths (joint 4 "
        "rests on the optimised one), where a joint keeps back part of a push within its stiction.",
        f"On the path of least mean condition number {_axes(metrics, 'least_jcn')} "
        f"({_three(metrics['least_jcn'])} N): the condition number asks about the worst direction "
        "of force and moment together, the force sd about force.",
        f"Inside the stated 95 % band lie {shares}. The band follows each joint's state, learnt "
        "from contact-free logs (`arm_models`), never from these runs.",
        "The hand pushes for 6 s and pauses for 4 s, 15 N standard deviation per axis with nothing "
        "above 3 Hz; readings count where the arm moves evenly, between ramps of 1 % of the time.",
    ]


def _comparison() -> list[ComparisonRow]:
    rows = []
    before, after = (12.6891, 14.3286, 4.6852), (6.5627, 7.6607, 4.3901)
    most_before, most_after = (75.2268, 52.4015, 38.7453), (51.0333, 32.3707, 18.6869)
    fall = (48.28, 46.53, 6.30)
    slow = "Coulomb-viscous friction misses the true arm's Stribeck rise at this speed"
    for k, axis in enumerate(AXES):
        name = axis.upper()
        rows += [
            ComparisonRow(
                f"RMSE in {name}, without", f"initial.rmse_{axis}_n", "N", before[k], slow
            ),
            ComparisonRow(
                f"RMSE in {name}, with",
                f"optimised.rmse_{axis}_n",
                "N",
                after[k],
                ours=f"ours.rmse_{axis}_n",
            ),
            ComparisonRow(
                f"Reduction of the RMSE in {name}", f"reduction_rmse_{axis}_pct", "%", fall[k]
            ),
            ComparisonRow(
                f"Largest error in {name}, without",
                f"initial.max_error_{axis}_n",
                "N",
                most_before[k],
                slow,
            ),
            ComparisonRow(
                f"Largest error in {name}, with",
                f"optimised.max_error_{axis}_n",
                "N",
                most_after[k],
                ours=f"ours.max_error_{axis}_n",
            ),
        ]
    for axis in AXES:
        rows.append(
            ComparisonRow(
                f"RMSE in {axis.upper()}, ours against the article's method",
                f"ours_against_article.reduction_rmse_{axis}_pct",
                "%",
                None,
            )
        )
    rows.append(ComparisonRow("Share in the 95 % band, ours", "ours.share_in_95_band", "", None))
    return rows


def error_figure(readings: dict[str, ForceReading]) -> "Figure":
    """Errors over time of the article's two experiments and of ours, axis by axis."""
    figure, axes = new_figure(3, 1, height=6.6, share_x=True)
    shown = (
        (BEFORE, COLOUR["before"], "article, without"),
        (AFTER, COLOUR["after"], "article, with"),
        (OURS, COLOUR["estimate"], "ours"),
    )
    for k, panel in enumerate(axes[:, 0]):
        for key, colour, label in shown:
            draw_signal(panel, readings[key].t, readings[key].error[:, k], colour, label)
        panel.set_ylabel(f"error of f{AXES[k]} [N]")
    axes[-1, 0].set_xlabel("time [s]")
    legend_below(figure, axes[0, 0], 3)
    return figure


def _figures(
    context: ExperimentContext, readings: dict[str, ForceReading], metrics: dict[str, Any]
) -> list[FigureFile]:
    limits = np.array([1.15 * float(np.abs(readings[BEFORE].force[:, k]).max()) for k in range(3)])
    figures = (
        (
            "without",
            axes_figure(
                readings[BEFORE],
                "Without the article's method: initial path, Coulomb-viscous",
                COLOUR["before"],
                limits,
            ),
            "Force read on the initial path with Coulomb-viscous friction (Fig. 20).",
        ),
        (
            "with",
            axes_figure(
                readings[AFTER],
                "With it: optimised path, semi-parametric",
                COLOUR["after"],
                limits,
            ),
            "Force read on the optimised path with semi-parametric friction (Fig. 21), drawn to "
            "the same scale.",
        ),
        (
            "ours",
            axes_figure(
                readings[OURS],
                f"Ours: path of least force sd, bayesian, K$_0$ = {FAST:g}",
                COLOUR["estimate"],
                limits,
            ),
            "Force read by this program, to the same scale.",
        ),
        ("errors", error_figure(readings), "Errors of the three over time."),
        (
            "variants",
            variants_figure(
                metrics,
                {variant.key: variant.label for variant in VARIANTS},
                "Pushed by hand along the path: one change per row",
            ),
            "Errors of every variant. A row with + changes the row above it, one with B the row "
            "marked (B). Grey: where the share inside a correct 95 % band lies.",
        ),
    )
    return saved_figures(figures, context.out)


EXPERIMENT = Experiment(
    name="combined",
    title="Friction law and path together, pushed by hand",
    section="4.7, Figs. 20-21",
    run=run,
    order=100,
    readme=("reduction_rmse_x_pct", "ours_against_article.reduction_rmse_x_pct"),
)
