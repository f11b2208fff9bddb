"""Two equal cycles along each path; the second is read with the torque of the first (eq. 4)."""

from dataclasses import dataclass
from typing import Any

from wrenchsight.analyses.experiments.setups.path_runs.repetition_errors import repetition_errors
from wrenchsight.analyses.experiments.setups.path_runs.task_runs import (
    PATHS,
    RepetitionReader,
    TaskRun,
    line_of,
    planned_task,
    read_repetition,
    repetition_torque,
    run_task,
    scenario_on_path,
    task_path,
)
from wrenchsight.analyses.methods.reference_sensor.force_errors import (
    VariantReading,
    draw_band,
    draw_signal,
    reductions,
)
from wrenchsight.analyses.methods.simulate.simulated_logs import ROBOT
from wrenchsight.analyses.output.axes import legend_above, limit_y
from wrenchsight.analyses.output.figures import COLOUR, Figure, new_figure
from wrenchsight.analyses.study.experiment import ExperimentContext
from wrenchsight.diagrams.scenario import Scenario
from wrenchsight.models.estimation.wrench import WrenchReconstruction, WrenchReconstructionConfig
from wrenchsight.models.estimation.wrench_prior import live_prior
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.signals.root_mean_square import rms

ONE_WAY_QUICK = 5.0  # s
K_0 = 20.0  # 1/s
BEFORE, AFTER = "initial", "optimised"  # the article's two variants
FOUND = "found"  # the path that `linear-path` finds, read as the article does
OURS = "found_bayesian"
BEFORE_FILTERED, AFTER_FILTERED = "initial_filtered", "optimised_filtered"


@dataclass(frozen=True)
class Variant:
    """One row of the table; it differs in one thing from the row that it is compared with."""

    key: str
    label: str
    path: str
    K_0: float | None  # 1/s; None: raw, as eq. 4 stands
    method: str


VARIANTS = (
    Variant(BEFORE, "article: initial path", "initial", None, "inverse"),
    Variant(AFTER, "article: optimised path", "optimised", None, "inverse"),
    Variant(FOUND, "path found here", "found", None, "inverse"),
    Variant(BEFORE_FILTERED, "initial path, K$_0$ = 20", "initial", K_0, "inverse"),
    Variant(AFTER_FILTERED, "optimised path, K$_0$ = 20", "optimised", K_0, "inverse"),
    Variant(
        "optimised_bayesian", "optimised path, K$_0$ = 20, bayesian", "optimised", K_0, "bayesian"
    ),
    Variant(
        "optimised_force_only",
        "optimised path, K$_0$ = 20, force_only",
        "optimised",
        K_0,
        "force_only",
    ),
    Variant(OURS, "path found here, K$_0$ = 20, bayesian", "found", K_0, "bayesian"),
)


@dataclass(frozen=True, eq=False)
class RepeatedCycles:
    """Runs and readings.

    Attributes:
        runs: by path.
        readings: by variant.
        scenario: as run, on the initial path.
        metrics: by variant; the article's reductions on top; ours against the article's method;
            (n,) N m of eq. 4 by noise alone, as slow motion shows it, raw and behind K_0
            (`torque_sd_nm`, `filtered_torque_sd_nm`), and what eq. 4 behind K_0 reads in the second
            cycle, by path (`filtered_torque_rms_nm`).
    """

    runs: dict[str, TaskRun]
    readings: dict[str, VariantReading]
    scenario: Scenario
    metrics: dict[str, Any]


def repeat_cycles(context: ExperimentContext, scenario_name: str) -> RepeatedCycles:
    """Simulates two cycles on each path, and reads the second one with every variant.

    A cycle is one way forth and back. Eq. 4 subtracts the torque of the first cycle from that of
    the second, sample by sample.

    Returns:
        With metrics of each variant by its key, reductions of the error from one variant to another
        (at the top level those of the article: from BEFORE to AFTER), and the noise of the torque.
    """
    robot = context.robot(ROBOT)
    scenario = planned_task(context, scenario_name, ONE_WAY_QUICK)
    motion = line_of(scenario)
    period = round(2 * motion.one_way / scenario.time_step)  # samples of a cycle
    context.progress(0.0, "the error of eq. 4")
    learnt = repetition_errors(robot, (None, K_0), context.seed, context.quick)
    errors = {error.K_0: error for error in learnt}  # by K_0; None: raw
    prior = live_prior(robot.payload)  # for `bayesian` and `force_only`
    runs: dict[str, TaskRun] = {}
    readings: dict[str, VariantReading] = {}
    torque_rms: dict[str, Array] = {}  # (n,) N m by path, of eq. 4 behind K_0
    for k, path in enumerate(PATHS):
        context.progress(0.05 + 0.85 * k / len(PATHS), f"simulating, {path} path")
        moved = scenario_on_path(scenario, robot, *task_path(robot, path))
        run = run_task(moved, robot, path).between(motion.lead_in)  # two whole cycles
        runs[path] = run
        torque = repetition_torque(run.recording, robot, period, K_0)
        torque_rms[path] = rms(torque)
        readers = {}
        for variant in VARIANTS:
            if variant.path == path:
                config = WrenchReconstructionConfig(variant.method).with_prior(*prior)
                error = errors[variant.K_0]
                reconstruction = WrenchReconstruction(config, error.correlation)
                readers[variant.key] = RepetitionReader(variant.label, reconstruction, error)
        path_readings = read_repetition(run, robot, period, list(readers.values()))
        readings |= dict(zip(readers, path_readings, strict=True))
    # One entry a variant, by its key in VARIANTS; then comparisons of two variants each.
    metrics: dict[str, Any] = {variant.key: readings[variant.key].metrics() for variant in VARIANTS}
    initial, optimised = metrics[BEFORE], metrics[AFTER]
    metrics["found_against_initial"] = reductions(initial, metrics[FOUND])
    metrics["filtered"] = reductions(metrics[BEFORE_FILTERED], metrics[AFTER_FILTERED])
    metrics["ours_against_article"] = reductions(optimised, metrics[OURS])
    metrics["torque_sd_nm"] = errors[None].noise
    metrics["filtered_torque_sd_nm"] = errors[K_0].noise
    metrics["filtered_torque_rms_nm"] = torque_rms
    return RepeatedCycles(runs, readings, scenario, {**reductions(initial, optimised), **metrics})


def force_figure(cycles: RepeatedCycles, with_reference: bool) -> Figure:
    """Force along Y before and after the optimisation (the article's Figs. 16 and 17)."""
    limit = 1.1 * cycles.metrics[BEFORE]["max_error_y_n"]
    shown = (BEFORE, AFTER, OURS)
    figure, axes = new_figure(len(shown), 1, height=2.3 * len(shown) + 0.6, share_x=True)
    for panel, key, colour in zip(
        axes[:, 0], shown, (COLOUR["before"], COLOUR["after"], COLOUR["estimate"]), strict=True
    ):
        reading = cycles.readings[key]
        draw_signal(panel, reading.t, reading.force[:, 1], colour, "read")
        if with_reference:
            draw_signal(panel, reading.t, reading.reference[:, 1], COLOUR["truth"], "sensor")
        draw_band(panel, reading, 1, edges=not with_reference)
        panel.set_title(reading.name)
        panel.set_ylabel("force fy [N]")
        if with_reference or key != OURS:
            limit_y(panel, -limit, limit, "N")
        legend_above(panel, ncols=3)
    axes[-1, 0].set_xlabel("time in the second cycle [s]")
    return figure
