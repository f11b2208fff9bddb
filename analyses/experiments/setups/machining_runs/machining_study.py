"""The studies of machining: each feed with a force/torque sensor in the force loop, and without.

One way of the path takes 15, 30 or 60 s, forth and back (section 5 of the article). Each feed is
machined twice: with a force/torque sensor in the force loop, the readings compared on the same run,
and without any sensor, the loop closed by the estimate alone.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from wrenchsight.analyses.experiments.setups.machining_runs.machining import (
    COMPONENTS,
    FEED_TIMES,
    FEEDBACKS,
    K_0,
    LAW,
    OURS,
    READINGS,
    MachiningRun,
    MachiningTask,
    band_shares,
    errors,
    errors_within_ways,
    feed_key,
    read_all,
    regulation,
    run_machining,
)
from wrenchsight.analyses.experiments.setups.machining_runs.machining_figures import (
    machining_figures,
)
from wrenchsight.analyses.experiments.setups.simulated_arm.arm_models import ArmModels, identify_arm
from wrenchsight.analyses.methods.simulate.air_pass import learn_air_passes
from wrenchsight.analyses.methods.simulate.simulated_logs import ROBOT
from wrenchsight.analyses.study.experiment import (
    ComparisonRow,
    ExperimentContext,
    ExperimentResult,
    FigureFile,
)
from wrenchsight.diagrams.machining import make_machining_path
from wrenchsight.diagrams.scenario import Scenario, load_scenario
from wrenchsight.models.estimation.invalid_shares import invalid_pct
from wrenchsight.models.machining.machining_phases import FAULT_SENTENCES
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.signals.root_mean_square import rms

QUICK_SHARE = 1.0 / 15.0  # of each of FEED_TIMES, in a shortened run
_AIR_SEED = 1000  # apart from the runs' own
_PAGE = "recording.html"
_MODELS_SHARE, _RUNS_SHARE = 0.1, 0.85  # of the progress, for the models and for the runs


def study_machining(context: ExperimentContext, task: MachiningTask) -> ExperimentResult:
    """The experiments `polishing` and `grinding` of `study`.

    All methods read the run with a sensor in the force loop; both runs of a feed show how well the
    force is held.

    Raises:
        RuntimeError: a pass ended before its feed was steady.
    """
    robot = context.robot(ROBOT)
    report = context.part(0.0, _MODELS_SHARE)
    models = identify_arm(robot, context.seed, context.quick, report, context.draws)
    scenarios = {
        feedback: load_scenario(name)
        for feedback, name in zip(FEEDBACKS, (task.scenario, task.sensorless), strict=True)
    }
    feeds = FEED_TIMES[:1] if context.fastest_feed else FEED_TIMES
    metrics: dict[str, Any] = {}
    # By feed: the run with a sensor and its readings by method and component; the run without.
    shown: dict[float, tuple[MachiningRun, dict[str, dict[str, Array]]]] = {}
    without_sensor: dict[float, MachiningRun] = {}
    for k, feed in enumerate(feeds):
        # A run takes about as long as its feed.
        start, end = (
            _MODELS_SHARE + _RUNS_SHARE * sum(done) / sum(feeds)
            for done in (feeds[:k], feeds[: k + 1])
        )
        runs = _runs_at_feed(context, feed, scenarios, models, start, end)
        readings = read_all(runs["sensor"], models)
        metrics[feed_key(feed)] = feed_metrics(task, runs, readings)
        shown[feed] = (runs["sensor"], readings)
        without_sensor[feed] = runs["estimate"]
    metrics |= over_feeds(metrics)  # under keys of its own
    metrics["sources"] = sources(models, {feed: run for feed, (run, _) in shown.items()})
    context.progress(0.96, "figures")
    page = FigureFile(
        Path(_PAGE),
        f"The arm at work without a sensor, one way in {FEED_TIMES[0]:g} s: true force black, "
        "estimated force blue.",
    )
    return ExperimentResult(
        metrics=metrics,
        figures=()
        if context.fastest_feed
        else machining_figures(task, shown, without_sensor, metrics),
        recordings=[page] if context.draws else [],
        comparison=comparison_rows(task),
        notes=[*machining_notes(task), *broken_off(metrics)],
        configuration={"scenarios": scenarios, "feeds_s": feeds, "K_0": K_0},
    )


def _runs_at_feed(
    context: ExperimentContext,
    feed: float,
    scenarios: Mapping[str, Scenario],
    models: ArmModels,
    start: float,
    end: float,
) -> dict[str, MachiningRun]:
    """The work at one feed by feedback: with a sensor in the force loop, and with the estimate.

    Plan and air passes, which know of no force loop, are those of the scenario with the sensor in
    both runs. The page of the experiment shows the fastest feed without a sensor.

    Args:
        feed: s, one way, of FEED_TIMES; shorter in a shortened run.
        scenarios: by feedback.
        start, end: of the experiment's progress.

    Raises:
        RuntimeError: a pass ended before its feed was steady.
    """
    one_way = feed * (QUICK_SHARE if context.quick else 1.0)
    at_feed = {
        feedback: _at_feed(scenario, one_way, context.seed)
        for feedback, scenario in scenarios.items()
    }
    with_sensor = at_feed["sensor"]
    plan = make_machining_path(with_sensor, models.robot)
    air_passes = learn_air_passes(
        with_sensor, models.robot, models.models[OURS], plan, _AIR_SEED + context.seed
    )
    middle = 0.5 * (start + end)
    runs = {}
    for feedback, begin, stop in (("sensor", start, middle), ("estimate", middle, end)):
        is_shown = context.draws and feedback == "estimate" and feed == FEED_TIMES[0]
        run = run_machining(
            at_feed[feedback],
            models,
            plan,
            air_pass=air_passes.correction,
            reads=air_passes.model,
            page=context.out / _PAGE if is_shown else None,
            progress=context.part(begin, stop, f"{feed:g} s one way: "),
        )
        if not run.steady.any():
            reason = FAULT_SENTENCES.get(run.fault, "no steady feed")
            raise RuntimeError(f"{feedback} feedback, {feed:g} s: the pass ended early: {reason}")
        runs[feedback] = run
    return runs


def _at_feed(scenario: Scenario, one_way: float, seed: int) -> Scenario:
    """The scenario at a feed of `one_way` s, with the noise and the process that a seed draws."""
    assert scenario.machining is not None
    process = scenario.machining.process
    variations = replace(process.variations, seed=process.variations.seed + seed)
    machining = replace(
        scenario.machining, one_way=one_way, process=replace(process, variations=variations)
    )
    return replace(scenario, seed=scenario.seed + seed, machining=machining)


def feed_metrics(
    task: MachiningTask,
    runs: Mapping[str, MachiningRun],
    readings: Mapping[str, Mapping[str, Array]],
) -> dict[str, Any]:
    """All figures of one feed: first the article's method on the article's component.

    Args:
        runs: by feedback, "sensor" and "estimate"; with a correction, so that they have the tool's
            vibration.
        readings: (T,) N of the run with the sensor, by method (READINGS) and component.

    Returns:
        By method, while the tool works: the errors of the article's component, with `steady` and
        `within_ways`, and those of each component; the article's `correlation` and `rmse_n` stand
        on top as well. Then, by feedback: bands, shares of valid readings and reasons in percent by
        part of the work (`MachiningRun.parts`), regulation, vibration and fault. A part that a run
        did not have is left out.
    """
    out = _errors_by_method(task, runs["sensor"], readings)
    for key in ("correlation", "rmse_n"):
        out[key] = out["article"][key]
    out["steady_share"] = float(runs["sensor"].steady.sum() / runs["sensor"].working.sum())
    out["band"] = {feedback: band_shares(run) for feedback, run in runs.items()}
    out["band_of_valid"] = {
        feedback: band_shares(run, valid_only=True) for feedback, run in runs.items()
    }
    out["valid_share"] = {
        feedback: {
            part: float(run.signals["valid"][rows].mean())
            for part, rows in run.parts.items()
            if rows.any()
        }
        for feedback, run in runs.items()
    }
    out["invalid"] = {
        feedback: {
            part: invalid_pct(run.signals["invalid"][rows, 0].astype(np.int64))
            for part, rows in run.parts.items()
            if rows.any()
        }
        for feedback, run in runs.items()
    }
    out["regulation"] = {feedback: regulation(run) for feedback, run in runs.items()}
    out["tool_vibration_m_per_s"] = {
        feedback: float(np.median(run.signals["tool_vibration"][run.working]))
        for feedback, run in runs.items()
    }
    out["fault"] = {
        feedback: FAULT_SENTENCES.get(run.fault, "none") for feedback, run in runs.items()
    }
    return out


def _errors_by_method(
    task: MachiningTask, run: MachiningRun, readings: Mapping[str, Mapping[str, Array]]
) -> dict[str, Any]:
    """Errors of each method's reading of a run: of the article's component, then of each one."""
    truth = run.components(run.signals["wrench_true"][:, 3:])
    true_component = truth[task.component]
    working, steady = run.working, run.steady
    by_method: dict[str, Any] = {}
    for method in READINGS:
        reading = readings[method]
        by_component = {
            component: errors(reading[component][working], truth[component][working])
            for component in COMPONENTS
        }
        while_steady = errors(reading[task.component][steady], true_component[steady])
        within = errors_within_ways(reading[task.component], true_component, run.ways)
        by_method[method] = (
            by_component[task.component]
            | {"steady": while_steady, "within_ways": within}
            | by_component
        )
    return by_method


def sources(models: ArmModels, runs: Mapping[float, MachiningRun]) -> dict[str, Any]:
    """Causes of the errors by feed: friction that the law misses.

    Speeds are planned; friction errors are those of the law at the measured speed, joint by joint,
    over the steady feed and over the rest of the work (starts, stops, turns).
    """
    law = models.models[LAW].friction.velocity_law
    out: dict[str, Any] = {}
    for feed, run in runs.items():
        error = run.signals["tau_f_true"] - law.torque(run.signals["v"])
        planned = np.abs(run.plan.trajectory.v[run.plan.steady == 1.0])
        parts = {"steady": run.steady, "unsteady": run.working & ~run.steady}
        out[feed_key(feed)] = {
            "mean_joint_speed_rad_per_s": planned.mean(axis=0).tolist(),
            "mean_jcn": float(
                np.mean(models.robot.chain.condition_number(run.signals["q"][run.working][::50]))
            ),
            **{
                f"{name}_friction_error_nm": rms(error[rows]).tolist()
                for name, rows in parts.items()
            },
        }
    return out


def over_feeds(metrics: Mapping[str, Any]) -> dict[str, Any]:
    """The figures that are compared, as lists over the feeds; NaN of those that were not run.

    Args:
        metrics: of `feed_metrics`, by `feed_key`.
    """

    def collect(*path: str) -> list[float]:
        """The figure at this path of keys below each feed; NaN where it is None, too."""
        values = []
        for feed in FEED_TIMES:
            value: Any = metrics.get(feed_key(feed))
            if value is not None:
                for key in path:  # every run has them: "steady" is the one part that it must have
                    value = value[key]
            values.append(float("nan") if value is None else value)
        return values

    def worst_axes(band: str, feedback: str) -> dict[str, list[float]]:
        """The least share inside the band among x, y, z, by part of the work, over the feeds.

        NaN where a pass did not have that part; of the valid readings also where it had none.
        """
        bands = [
            metrics.get(feed_key(feed), {}).get(band, {}).get(feedback, {}) for feed in FEED_TIMES
        ]
        return {
            part: [
                min(of_feed[part].values()) if part in of_feed else float("nan")
                for of_feed in bands
            ]
            for part in ("steady", "ends", "turns", "all")
        }

    return {
        name: {"correlation": collect(name, "correlation"), "rmse_n": collect(name, "rmse_n")}
        | {"within_ways": {"correlation": collect(name, "within_ways", "correlation")}}
        for name in READINGS
    } | {
        "regulation": {
            feedback: {key: collect("regulation", feedback, key) for key in ("rms_n", "median_n")}
            for feedback in FEEDBACKS
        },
        "band": worst_axes("band", "sensor"),
        "band_without_sensor": worst_axes("band", "estimate"),
        "band_of_valid": worst_axes("band_of_valid", "sensor"),
        "band_of_valid_without_sensor": worst_axes("band_of_valid", "estimate"),
        "valid_share": {
            feedback: collect("valid_share", feedback, "steady") for feedback in FEEDBACKS
        },
    }


def comparison_rows(task: MachiningTask) -> list[ComparisonRow]:
    """Rows of the table "article / here".

    Their keys are paths into what `over_feeds` returns: a list each, one entry a feed time. There
    "article" is the article's method on the simulated arm, "ours" this project's. `article=` is the
    figure that the article prints; `ours=` is the key that a campaign compares the row with (the
    share of worlds in which ours is ahead), while the table has it in a row of its own (", ours").
    The article prints one correlation, which stands beside its method's. Bands and valid shares are
    those of the passes with a sensor in the control.
    """
    feeds = ", ".join(f"{feed:g}" for feed in FEED_TIMES)
    force = f"{task.component.capitalize()} force, one way in {feeds} s"
    held = f"True normal force held {{}} a sensor, {feeds} s: {{}} error"
    corrected = "with the air-pass correction"
    inside = f"Inside the stated 95 % band, {{}}, {feeds} s: least share of an axis"
    within = f"{force}: correlation within a way, its mean taken off"
    parts = {"steady": "steady feed", "ends": "starts and stops", "turns": "turns of the feed"}
    return [
        ComparisonRow(
            f"{force}: correlation",
            "article.correlation",
            article=task.correlation,
            ours="ours.correlation",
            more_is_better=True,
        ),
        ComparisonRow(
            f"{force}: RMSE",
            "article.rmse_n",
            article=task.rmse_n,
            remark=task.remark,
            ours="ours.rmse_n",
        ),
        ComparisonRow(f"{force}: correlation, ours", "ours.correlation", remark=corrected),
        ComparisonRow(f"{force}: RMSE, ours", "ours.rmse_n", article=task.rmse_n, remark=corrected),
        ComparisonRow(within, "article.within_ways.correlation"),
        ComparisonRow(f"{within}, ours", "ours.within_ways.correlation"),
        ComparisonRow(held.format("without", "RMS"), "regulation.estimate.rms_n"),
        ComparisonRow(held.format("without", "median"), "regulation.estimate.median_n"),
        *(ComparisonRow(inside.format(words), f"band.{part}") for part, words in parts.items()),
        ComparisonRow(inside.format("valid readings of the steady feed"), "band_of_valid.steady"),
        ComparisonRow(f"Valid in steady feed, {feeds} s: share", "valid_share.sensor"),
        ComparisonRow(held.format("with", "RMS"), "regulation.sensor.rms_n"),
    ]


def broken_off(metrics: Mapping[str, Any]) -> list[str]:
    """A note for each fault that ended a pass early."""
    faults = {
        fault
        for feed in FEED_TIMES
        for fault in metrics.get(feed_key(feed), {}).get("fault", {}).values()
    }
    return [f"A pass was broken off: {fault}." for fault in sorted(faults - {"none"})]


def machining_notes(task: MachiningTask) -> list[str]:
    """Notes for the report, to be filled by the metrics.

    `<a.b:spec>` stands for entry b of entry a of the metrics, written with a format; "100 .0f" is
    a hundred times it. The report leaves out a note whose metric is absent, as with one feed alone.
    The entries of each feed (`feed_key`) are metrics that this module writes; a test fills all.
    """

    def each(path: str, spec: str = ".2f") -> str:
        return " ".join(f"<{feed_key(feed)}.{path}:{spec}>" for feed in FEED_TIMES)

    feeds = ", ".join(f"{feed:g}" for feed in FEED_TIMES)
    inside = "; ".join(
        f"{words} "
        + ", ".join(
            " ".join(f"<{feed_key(feed)}.band.sensor.{part}.{axis}:100 .0f>" for axis in "xyz")
            for feed in FEED_TIMES
        )
        for part, words in (
            ("steady", "steady feed"),
            ("ends", "starts and stops"),
            ("turns", "turns"),
        )
    )
    return [
        f"{task.component.capitalize()} force, one way in {feeds} s, RMSE: {each('rmse_n')} N "
        f"(article), {each('coulomb_viscous.rmse_n')} N (Coulomb-viscous), {each('ours.rmse_n')} N "
        f"(ours), {each('known_friction.rmse_n')} N (true friction known); while the feed is "
        f"steady {each('article.steady.rmse_n')} N (article), {each('ours.steady.rmse_n')} N "
        "(ours).",
        "Correlation within a way, its mean subtracted: "
        f"{each('article.within_ways.correlation')} (article), "
        f"{each('ours.within_ways.correlation')} (ours).",
        f"True normal force off the set-point, RMS: {each('regulation.estimate.rms_n')} N without "
        f"a sensor, {each('regulation.sensor.rms_n')} N with it; median "
        f"{each('regulation.estimate.median_n')} N; largest overshoot "
        f"{each('regulation.estimate.overshoot_n', '.1f')} N.",
        f"Inside the 95 % band, x y z by feed: {inside} %.",
        "Amplitude of the tool's vibration, found from the torques, median: "
        f"{each('tool_vibration_m_per_s.sensor', '1000 .1f')} mm/s.",
        f"Share of the work at steady feed: {each('steady_share', '100 .0f')} %.",
    ]
