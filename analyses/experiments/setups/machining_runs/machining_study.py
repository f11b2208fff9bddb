"""The studies of machining: each feed with a force/torque sensor in the force loop, and without.

One way of the path in 15, 30 and 60 s, there and back (section 5). Each feed is machined twice:
with a force/torque sensor in the force loop, the readings compared on the same run, and
without any sensor, the loop closed by the estimate alone.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from wrenchsight.analyses.experiments.setups.machining_runs.machining import (
    COMPONENTS,
    FEEDBACKS,
    FEEDS,
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
from wrenchsight.analyses.methods.runs.air_pass import learn_air_passes
from wrenchsight.analyses.methods.runs.simulated_logs import ROBOT
from wrenchsight.analyses.study.experiment import (
    ComparisonRow,
    ExperimentContext,
    ExperimentResult,
    FigureFile,
)
from wrenchsight.diagrams.machining import make_machining_path
from wrenchsight.diagrams.scenario import load_scenario
from wrenchsight.models.arrays import Array
from wrenchsight.models.machining.machining_phases import FAULT_SENTENCES

if TYPE_CHECKING:
    pass


QUICK_SHARE = 1.0 / 15.0  # of these
_AIR_SEED = 1000  # apart from the runs' own


def study_machining(context: ExperimentContext, task: MachiningTask) -> ExperimentResult:
    """The experiments `polishing` and `grinding` of `study`."""
    robot = context.robot(ROBOT)
    models = identify_arm(
        robot, context.seed, context.quick, lambda s, what: context.progress(0.1 * s, what)
    )
    scenarios = {
        feedback: load_scenario(name)
        for feedback, name in zip(FEEDBACKS, (task.scenario, task.sensorless), strict=True)
    }
    feeds = FEEDS[:1] if context.fastest_feed else FEEDS
    total = 2.0 * sum(feeds)
    done = 0.0
    metrics: dict[str, Any] = {}
    shown: dict[float, tuple[MachiningRun, dict[str, dict[str, Array]]]] = {}
    without: dict[float, MachiningRun] = {}
    picture = context.out / "recording.html"
    for feed in feeds:
        one_way = feed * (QUICK_SHARE if context.quick else 1.0)
        runs: dict[str, MachiningRun] = {}
        plan, lesson = None, None
        for feedback, scenario in scenarios.items():
            assert scenario.machining is not None
            process = scenario.machining.process
            varies = replace(process.variations, seed=process.variations.seed + context.seed)
            own = replace(
                scenario,
                seed=scenario.seed + context.seed,
                machining=replace(
                    scenario.machining,
                    one_way=one_way,
                    process=replace(process, variations=varies),
                ),
            )

            def told(share: float, what: str, start: float = done, feed: float = feed) -> None:
                place = (start + share * feed) / total
                context.progress(0.1 + 0.85 * place, f"{what}, {feed:g} s one way")

            if plan is None or lesson is None:  # the same for both
                plan = make_machining_path(own, robot)
                lesson = learn_air_passes(
                    own, robot, models.models[OURS], plan, _AIR_SEED + context.seed
                )
            with_picture = context.draws and feedback == "estimate" and feed == FEEDS[0]
            runs[feedback] = run_machining(
                own, models, plan, *lesson, picture if with_picture else None, told
            )
            done += feed
            if not runs[feedback].steady.any():
                why = FAULT_SENTENCES.get(runs[feedback].fault, "no steady feed")
                raise RuntimeError(f"{feedback} feedback, {feed:g} s: the pass ended early: {why}")
        readings = read_all(runs["sensor"], models)
        metrics[feed_key(feed)] = feed_metrics(task, runs, readings)
        shown[feed], without[feed] = (runs["sensor"], readings), runs["estimate"]
    metrics |= over_feeds(metrics)
    metrics["sources"] = sources(models, {feed: run for feed, (run, _) in shown.items()})
    context.progress(0.96, "figures")
    return ExperimentResult(
        metrics=metrics,
        figures=machining_figures(context, task, shown, without, metrics)
        if context.draws and not context.fastest_feed
        else [],
        recordings=[
            FigureFile(
                Path("recording.html"),
                f"The arm at work without a sensor, one way in {FEEDS[0]:g} s: true force black, "
                "estimated force blue.",
            )
        ]
        if context.draws
        else [],
        comparison=comparison_rows(task),
        notes=[] if context.fastest_feed else findings(task, metrics),
        configuration={"scenarios": scenarios, "feeds_s": feeds, "K_0": K_0},
    )


def feed_metrics(
    task: MachiningTask,
    runs: Mapping[str, MachiningRun],
    readings: Mapping[str, Mapping[str, Array]],
) -> dict[str, Any]:
    """All figures of one feed: first the article's method on the article's component."""
    run = runs["sensor"]
    truth = run.components(run.signals["wrench_true"][:, 3:])
    working, steady = run.working, run.steady
    out: dict[str, Any] = {}
    for name in READINGS:
        by_component = {
            component: errors(readings[name][component][working], truth[component][working])
            for component in COMPONENTS
        }
        while_steady = errors(readings[name][task.component][steady], truth[task.component][steady])
        within = errors_within_ways(readings[name][task.component], truth[task.component], run.ways)
        out[name] = (
            by_component[task.component]
            | {"steady": while_steady, "within_ways": within}
            | by_component
        )
    for key in ("correlation", "rmse_n"):
        out[key] = out["article"][key]
    out["steady_share"] = float(steady.sum() / working.sum())
    out["band"] = {feedback: band_shares(own) for feedback, own in runs.items()}
    out["regulation"] = {feedback: regulation(own) for feedback, own in runs.items()}
    out["fault"] = {
        feedback: FAULT_SENTENCES.get(own.fault, "none") for feedback, own in runs.items()
    }
    return out


def sources(models: ArmModels, runs: Mapping[float, MachiningRun]) -> dict[str, Any]:
    """What makes a feed harder than another: friction that the law misses, by feed.

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
                f"{name}_friction_error_nm": np.sqrt(np.mean(error[rows] ** 2, axis=0)).tolist()
                for name, rows in parts.items()
            },
        }
    return out


def over_feeds(metrics: Mapping[str, Any]) -> dict[str, Any]:
    """The figures that are compared, as lists over the feeds; NaN of those that were not run."""

    def collect(*path: str) -> list[float]:
        values = []
        for feed in FEEDS:
            value: Any = metrics.get(feed_key(feed))
            if value is not None:
                for part in path:
                    value = value[part]
            values.append(float("nan") if value is None else value)
        return values

    def worst_axis(feed: float, part: str) -> float:
        of_a_feed = metrics.get(feed_key(feed))
        return min(of_a_feed["band"]["sensor"][part].values()) if of_a_feed else float("nan")

    return {
        name: {"correlation": collect(name, "correlation"), "rmse_n": collect(name, "rmse_n")}
        | {"within_ways": {"correlation": collect(name, "within_ways", "correlation")}}
        for name in READINGS
    } | {
        "regulation": {
            feedback: {key: collect("regulation", feedback, key) for key in ("rms_n", "median_n")}
            for feedback in FEEDBACKS
        },
        "band": {
            part: [worst_axis(feed, part) for feed in FEEDS]
            for part in ("steady", "ends", "turns", "all")
        },
    }


def comparison_rows(task: MachiningTask) -> list[ComparisonRow]:
    """Rows of the table "article / here"."""
    feeds = ", ".join(f"{feed:g}" for feed in FEEDS)
    force = f"{task.component.capitalize()} force, one way in {feeds} s"
    ours = "reads with what a pass through the air has taught"
    harder = "friction here creeps, wanders and grows with the load (`--truth plain`: without)"
    return [
        ComparisonRow(
            f"{force}: correlation",
            "article.correlation",
            "",
            list(task.correlation),
            ours="ours.correlation",
            more_is_better=True,
        ),
        ComparisonRow(
            f"{force}: RMSE", "article.rmse_n", "N", list(task.rmse_n), harder, ours="ours.rmse_n"
        ),
        ComparisonRow(f"{force}: correlation, ours", "ours.correlation", "", None, ours),
        ComparisonRow(f"{force}: RMSE, ours", "ours.rmse_n", "N", None, ours),
        ComparisonRow(
            f"{force}: correlation within a way, its mean taken off",
            "article.within_ways.correlation",
            "",
            None,
        ),
        ComparisonRow(
            f"{force}: correlation within a way, its mean taken off, ours",
            "ours.within_ways.correlation",
            "",
            None,
        ),
        ComparisonRow(
            f"True normal force held without a sensor, {feeds} s: RMS error",
            "regulation.estimate.rms_n",
            "N",
            None,
        ),
        ComparisonRow(
            f"True normal force held without a sensor, {feeds} s: median error",
            "regulation.estimate.median_n",
            "N",
            None,
        ),
        *(
            ComparisonRow(
                f"Inside the stated 95 % band, {words}, {feeds} s: least share of an axis",
                f"band.{part}",
                "",
                None,
            )
            for part, words in (
                ("steady", "steady feed"),
                ("ends", "starts and stops"),
                ("turns", "turns of the feed"),
            )
        ),
        ComparisonRow(
            f"True normal force held with a sensor, {feeds} s: RMS error",
            "regulation.sensor.rms_n",
            "N",
            None,
        ),
    ]


def _row(metrics: Mapping[str, Any], path: str, digits: int = 2) -> str:
    values = []
    for feed in FEEDS:
        value: Any = metrics[feed_key(feed)]
        for part in path.split("."):
            value = value[part]
        values.append(f"{value:.{digits}f}")
    return ", ".join(values)


def _band(metrics: Mapping[str, Any], part: str) -> str:
    """Percent inside the band, x y z, feed by feed."""
    shares = [metrics[feed_key(feed)]["band"]["sensor"][part] for feed in FEEDS]
    return ", ".join(" ".join(f"{100.0 * s:.0f}" for s in share.values()) for share in shares)


def _share(metrics: Mapping[str, Any], feed: float) -> str:
    """Percent of the work in which the feed is not steady."""
    return f"{100.0 * (1.0 - metrics[feed_key(feed)]['steady_share']):.1f}"


def findings(task: MachiningTask, metrics: Mapping[str, Any]) -> list[str]:
    """What the figures say, in sentences."""
    rmse = [metrics[feed_key(feed)]["rmse_n"] for feed in FEEDS]
    slowest, fastest = (
        metrics["sources"][feed_key(FEEDS[-1])],
        metrics["sources"][feed_key(FEEDS[0])],
    )

    def worst(part: Mapping[str, Any]) -> str:
        return " ".join(f"{value:.2f}" for value in part["steady_friction_error_nm"])

    growth = np.subtract(slowest["steady_friction_error_nm"], fastest["steady_friction_error_nm"])
    grown = int(np.argmax(growth)) + 1
    faults = sorted(
        {fault for feed in FEEDS for fault in metrics[feed_key(feed)]["fault"].values()} - {"none"}
    )
    return [
        f"{task.component.capitalize()} force by the article's method (semi-parametric friction, "
        f"K_0 = {K_0:g}, eq. 22), one way in {', '.join(f'{feed:g}' for feed in FEEDS)} s: RMSE "
        f"{_row(metrics, 'rmse_n')} N; with Coulomb-viscous friction alone "
        f"{_row(metrics, 'coulomb_viscous.rmse_n')} N; ours {_row(metrics, 'ours.rmse_n')} N; with "
        f"the true friction known {_row(metrics, 'known_friction.rmse_n')} N. While the feed is "
        f"steady, the article's {_row(metrics, 'article.steady.rmse_n')} N, ours "
        f"{_row(metrics, 'ours.steady.rmse_n')} N.",
        "Friction along the feed changes its sign when the feed turns round, and a correlation "
        "over all ways counts that as agreement. Within a way, its mean taken off, the article's "
        f"method correlates by {_row(metrics, 'article.within_ways.correlation')}, ours by "
        f"{_row(metrics, 'ours.within_ways.correlation')}: how well each follows a varying force.",
        "The force varies along a way by itself: waviness, patches of material, run-out, entry and "
        "exit (`models.machining.process_variations`); `variations: {enabled: false}` is a steady "
        "process, in which hardly anything but the feed's direction changes.",
        "Ours reads bayesian, with friction that follows the joints through rest and reversal "
        "(presliding) and with what a pass through the air has taught, just above the surface "
        "along the same motion: what the observer reads there is the model's error and is taken "
        "off (eq. 4, on the observer's output). What contact itself changes is left, and what does "
        "not repeat. How much of a real UR10e's error does, `air-pass` measures.",
        "Its band follows the state of each joint, learnt from a second air pass at twice the "
        "height, never from the work. Inside 95 % are, x y z for each feed: "
        f"{_band(metrics, 'steady')} % while the feed is steady, {_band(metrics, 'ends')} % where "
        f"it starts and stops, {_band(metrics, 'turns')} % where it turns round.",
        "Force control without a sensor holds the true normal force within "
        f"{_row(metrics, 'regulation.estimate.rms_n')} N RMS "
        f"({_row(metrics, 'regulation.sensor.rms_n')} N with the sensor; half of the time within "
        f"{_row(metrics, 'regulation.estimate.median_n')} N without), "
        f"{_row(metrics, 'regulation.estimate.steady_rms_n')} N while the feed is steady. The most "
        f"above the set-point is {_row(metrics, 'regulation.estimate.overshoot_n', 1)} N "
        f"({_row(metrics, 'regulation.sensor.overshoot_n', 1)} N with the sensor): joints come to "
        "rest at the touch, where no current tells the force, so that the press is fed forward.",
        f"In the article slower feeds are harder to read. Here the article's method errs by "
        f"{rmse[-1] / rmse[0]:.2f} times as much in {FEEDS[-1]:g} s as in {FEEDS[0]:g} s. Two "
        "things decide it. Starts, stops and turns, where joints rest and hide force "
        f"within their stiction, take {_share(metrics, FEEDS[0])} % of the time in {FEEDS[0]:g} s "
        f"and {_share(metrics, FEEDS[-1])} % in {FEEDS[-1]:g} s. Over the steady feed the error "
        "goes from "
        f"{metrics[feed_key(FEEDS[0])]['article']['steady']['rmse_n']:.2f} to "
        f"{metrics[feed_key(FEEDS[-1])]['article']['steady']['rmse_n']:.2f} N: friction at joints "
        f"1 to 6 errs by {worst(fastest)} N m at the fastest feed and {worst(slowest)} N m at the "
        f"slowest. It {'grows most' if growth.max() > 0.0 else 'falls least'} at joint {grown}, of "
        f"{1e3 * slowest['mean_joint_speed_rad_per_s'][grown - 1]:.1f} mrad/s in the mean at the "
        "slowest.",
        "The workpiece stands where the article's reading has the least predicted sd, known from "
        "the identified model, the planned speeds and contact-free logs.",
        *(f"A pass was broken off: {fault}." for fault in faults),
    ]
