"""Supports README, "Contact force of a real UR10e from its motor currents".

Experiment `ur10e-contact`: a real UR10e in contact, its motor currents against a force sensor.

The arm presses a roller on a workpiece that stands on a force/torque sensor, holds still, rolls
along it and holds still again, at several forces and speeds, with two force controllers. It is
another specimen than the one identified in `ur10e-identification`; its friction is found from its
motion in the air. `contact_reading` states what each method may use. `command` and `no_sensor` are
what a user gets: `identify --refresh MODEL --other-specimen` on the motion in the air, then
`estimate --tool --contact-axis tool_z`. `calibrated` adds `--reference` on the other runs of the
same controller; `carried_over` takes the friction of the other specimen as it is.
"""

from collections.abc import Sequence
from itertools import product
from typing import Any

from wrenchsight.analyses.experiments.setups.ur10e_recordings.contact_reading import (
    AXIS,
    block_mean,
    prepare,
)
from wrenchsight.analyses.experiments.setups.ur10e_recordings.contact_runs import (
    CONTACT,
    CONTROLLERS,
    JUDGED,
    find_runs,
    read_run,
    tooled,
)
from wrenchsight.analyses.experiments.setups.ur10e_recordings.ur10e_logs import presliding_arm
from wrenchsight.analyses.experiments.ur10e_contact.contact_study import (
    SETTLED_ON,
    ReadRun,
    contact_metrics,
    invalid_by_kind,
    read_runs,
)
from wrenchsight.analyses.output.axes import limit_y
from wrenchsight.analyses.output.figures import (
    COLOUR,
    Figure,
    fill_band,
    legend_on_top,
    new_figure,
)
from wrenchsight.analyses.study.experiment import (
    ComparisonRow,
    Experiment,
    ExperimentContext,
    ExperimentResult,
)
from wrenchsight.analyses.study.outcome import look_up
from wrenchsight.models.estimation.contact_filter import ContactConfig
from wrenchsight.models.signals.bands import SIGMA_95

_SHOWN = {
    "command": "never a sensor",
    "calibrated": "calibrated once",
}
_FULL_SCALE = 160.0  # N; impacts leave the picture
_JUDGED_BY = (
    "bias_n",
    "sd_n",
    "rmse_n",
    "inside_95_pct",
    "correlation",
    "share_valid_pct",
    "rmse_valid_n",
    "inside_95_valid_pct",
)
_CHECK = "the data set's own check"  # K (i - i_target) of joints 2 and 3, over all 67 runs


def run(context: ExperimentContext) -> ExperimentResult:
    """Reads every run by every method, and judges them against the sensor."""
    files = find_runs(context.data)
    # Shares of the work: the model to 0.3, the logs to 0.4, the forces to 0.9, figures to 1.
    robot, identified = presliding_arm(context, 0.3)
    robots = {controller: tooled(robot, controller) for controller in CONTROLLERS}
    prepared = []
    for k, path in enumerate(files):
        context.progress(0.3 + 0.1 * k / len(files), "reading the runs")
        contact_run = read_run(path)
        prepared.append(prepare(contact_run, robots[contact_run.name.controller], identified))
    reads, air_fits = read_runs(
        prepared, files, identified, lambda share: context.progress(0.4 + 0.5 * share, "forces")
    )
    metrics = contact_metrics(reads)
    metrics["friction"] = {controller: fit.metrics() for controller, fit in air_fits.items()}
    metrics["runs"] = _run_metrics(reads)
    metrics["invalid"] = invalid_by_kind(reads)
    context.progress(0.9, "figures")
    return ExperimentResult(
        metrics=metrics,
        figures=[
            (
                "forces",
                _force_figure(_one_run_a_group(reads)),
                "Force along the tool from motor currents, without a sensor, against the sensor: "
                "one run of each kind.",
            ),
        ],
        comparison=_comparison(metrics),
        notes=NOTES,
        configuration={
            "runs": [read.prepared.run.name.stem for read in reads],
            "settled_on": sorted(SETTLED_ON),
            "filter": ContactConfig(axis=AXIS),
        },
    )


def _run_metrics(reads: Sequence[ReadRun]) -> dict[str, Any]:
    """Without a sensor, run by run; keys without dots, which part a metric's path."""
    metrics: dict[str, Any] = {}
    for read in reads:
        by_interval = {}
        for interval in JUDGED:
            judged = read.judged("command", interval)
            if judged is not None:
                by_interval[interval] = {key: judged.metrics()[key] for key in _JUDGED_BY}
        metrics[read.prepared.run.name.stem.replace(".", "p")] = by_interval
    return metrics


def _one_run_a_group(reads: Sequence[ReadRun]) -> list[ReadRun]:
    """The run of the middle force of each scene and controller, in the order of their names."""
    groups: dict[str, list[ReadRun]] = {}
    for read in reads:
        groups.setdefault(read.prepared.run.name.group, []).append(read)
    chosen = []
    for _, group in sorted(groups.items(), reverse=True):
        ranked = sorted(group, key=lambda r: (r.prepared.run.name.force, r.prepared.run.name))
        chosen.append(ranked[len(ranked) // 2])
    return chosen


def _force_figure(reads: Sequence[ReadRun]) -> Figure:
    """The force along the tool over time, a panel a run: sensor, ours with its band, by hand."""
    figure, axes = new_figure(len(reads), 1, height=2.1 * len(reads) + 0.6)
    panels: list[Any] = list(axes[:, 0])
    for axis, read in zip(panels, reads, strict=True):
        run, ours = read.prepared.run, read.readings["command"]
        assert ours.sd is not None
        t = block_mean(run.t)
        for interval in JUDGED:
            if interval in run.intervals:
                axis.axvspan(*run.intervals[interval], color=COLOUR["reference"], alpha=0.08, lw=0)
        fill_band(axis, t, ours.force, SIGMA_95 * ours.sd)
        by_hand = read.readings["two_joints"].force
        axis.plot(
            t, by_hand, color=COLOUR["article"], lw=0.7, label="K (i - i_target), joints 2 and 3"
        )
        axis.plot(t, ours.force, color=COLOUR["estimate"], lw=1.2, label="ours, never a sensor")
        axis.plot(t, read.prepared.block_force, color=COLOUR["truth"], lw=1.0, label="sensor")
        limit_y(axis, -40.0, _FULL_SCALE, "N")
        axis.set_ylabel("force [N]")
        axis.set_title(run.name.stem)
    panels[-1].set_xlabel("time from the first contact [s]; shaded: where it is judged")
    legend_on_top(figure, panels[0], ncols=4)
    return figure


def _comparison(metrics: dict[str, Any]) -> list[ComparisonRow]:
    """Rows for the figures that there are, beside the data set's check, a subtraction or 95 %.

    Args:
        metrics: of `contact_metrics`, which says how its keys are built. `{}` below is the method.
    """
    # Key of the metric, and RMSE in N of the data set's own check over all 67 runs, from its
    # description; on the straight workpiece of both controllers together.
    rmse_of_check = {
        "straight slide at 0.10 m/s": ("summary.{}.straight_slide_v10.rmse_n", 2.9),
        "straight slide at 0.25 m/s": ("summary.{}.straight_slide_v25.rmse_n", 2.9),
        "straight slide at 0.90 m/s": ("summary.{}.straight_slide_v90.rmse_n", 3.2),
        "ramp slide with the flange at 0.10 m/s": ("ramp_acf.v10.slide.{}.rmse_n", 3.1),
        "ramp slide with the flange at 0.25 m/s": ("ramp_acf.v25.slide.{}.rmse_n", 6.6),
        "ramp slide in force mode at 0.10 m/s": ("ramp_ur.v10.slide.{}.rmse_n", 11.6),
        "ramp slide in force mode at 0.25 m/s": ("ramp_ur.v25.slide.{}.rmse_n", 11.8),
    }
    rows = []
    for (kind, (key_of_method, rmse)), (method, label) in product(
        rmse_of_check.items(), _SHOWN.items()
    ):
        key = key_of_method.format(method)
        share = look_up(metrics, key.replace("rmse_n", "share_valid_pct"))
        valid = "" if share is None else f"; {share:.0f} % of the readings are valid"
        remark = f"the check reads K (i - i_target){valid}"
        text = f"RMSE of the force, {kind}, {label}"
        rows.append(ComparisonRow(text, key, article=rmse, remark=remark, source=_CHECK))
    # Two decimals, as the figures of others have.
    rmse_of_subtraction = round(metrics["summary"]["gravity"]["rest"]["rmse_n"], 2)
    rows += [
        ComparisonRow(
            f"RMSE of the force at rest, {label}",
            f"summary.{method}.rest.rmse_n",
            article=rmse_of_subtraction,
            remark="K i - gravity",
            source="plain subtraction",
        )
        for method, label in _SHOWN.items()
    ]
    rows += _band_rows(metrics)
    rows += [
        ComparisonRow(
            f"ramp slide in force mode, share of its readings that are valid, at 0.{speed[1:]} m/s",
            f"ramp_ur.{speed}.slide.command.share_valid_pct",
            remark="elsewhere the force changes faster than the filters assume",
            more_is_better=True,
        )
        for speed in ("v10", "v25")
    ]
    return [row for row in rows if look_up(metrics, row.key) is not None]


def _band_rows(metrics: dict[str, Any]) -> list[ComparisonRow]:
    """Shares of the true force inside the 95 % band: at rest, sliding, and from touch to lift."""
    claim = "the band's own claim"
    states = (("rest", "at rest"), ("slide", "sliding"))
    rows = [
        ComparisonRow(
            f"share of the true force inside the 95 % band, {words}, {label}",
            f"summary.{method}.{state}.inside_95_pct",
            article=95.0,
            remark="wanted",
            source=claim,
        )
        for (method, label), (state, words) in product(_SHOWN.items(), states)
    ]
    for method, label in _SHOWN.items():
        share = metrics["summary"][method][CONTACT]["share_valid_pct"]
        valid = "" if share is None else f"; {share:.0f} % of the readings are valid"
        rows.append(
            ComparisonRow(
                f"share of the true force inside the band of valid readings, every 20 ms, {label}",
                f"summary.{method}.{CONTACT}.inside_95_valid_pct",
                article=95.0,
                remark=f"from the touch to the lift{valid}",
                source=claim,
            )
        )
    return rows


def _of_slides(method: str) -> str:
    kinds = [f"straight_slide_v{speed}" for speed in (10, 25, 90)]
    return " ".join(f"<summary.{method}.{kind}.rmse_n:.1f>" for kind in kinds)


NOTES = (
    "RMSE of the force along the tool over 0.1 s, straight slides at 0.10, 0.25 and 0.90 m/s: "
    f"{_of_slides('command')} N without any sensor, "
    f"{_of_slides('calibrated')} N calibrated once, {_of_slides('two_joints')} N by two joints' "
    f"currents, {_of_slides('article')} N by the article's method.",
    "At rest: <summary.command.rest.rmse_n:.1f> N without a sensor, "
    "<summary.calibrated.rest.rmse_n:.1f> N calibrated, <summary.article.rest.rmse_n:.1f> N by the "
    "article's method, <summary.gravity.rest.rmse_n:.1f> N by currents less gravity.",
    "Inside the 95 % band at rest and sliding: <summary.command.rest.inside_95_pct:.0f> and "
    "<summary.command.slide.inside_95_pct:.0f> % without a sensor, "
    "<summary.calibrated.rest.inside_95_pct:.0f> and "
    "<summary.calibrated.slide.inside_95_pct:.0f> % calibrated, "
    "<summary.article.rest.inside_95_pct:.0f> and <summary.article.slide.inside_95_pct:.0f> % with "
    "the article's covariance.",
    "Every 20 ms, from the touch to the lift, with starts, corners and bounces, the band of the "
    "valid readings holds <summary.command.contact.inside_95_valid_pct:.0f> % without a "
    "sensor, <summary.calibrated.contact.inside_95_valid_pct:.0f> % calibrated.",
    "Where the readings are valid: <summary.command.rest.rmse_valid_n:.1f> N at rest and "
    "<summary.command.slide.rmse_valid_n:.1f> N in slides without a sensor, "
    "<summary.calibrated.rest.rmse_valid_n:.1f> and <summary.calibrated.slide.rmse_valid_n:.1f> N "
    "calibrated.",
    "The ramp in force mode at 0.25 m/s: the roller bounces, 0 to 160 N within tenths of a second, "
    "and the arm moves towards the workpiece as the rebuilt angles do not say. Of the readings of "
    "its slides <ramp_ur.v25.slide.command.share_valid_pct:.0f> % are valid; all together err by "
    "<ramp_ur.v25.slide.command.rmse_n:.1f> N.",
    "Runs on which constants were settled, at rest and sliding: "
    "<settled.rest.command.rmse_n:.1f> and <settled.slide.command.rmse_n:.1f> N; the others: "
    "<checked.rest.command.rmse_n:.1f> and <checked.slide.command.rmse_n:.1f> N.",
    "A larger filter of this kind was chosen with all runs in sight; what was left out of it, and "
    "the numbers, were settled on the first half.",
    "With the friction of another UR10e: <summary.carried_over.slide.rmse_n:.1f> N in slides. "
    "Its level does not carry over; kinematics, masses, torque per ampere and its shape do.",
    "Without a sensor the mean error of slides falls as the force grows, in joints 2 and 3 as "
    "their lever arms, whichever way they turn: torque constants that are too small. Without a "
    "sensor that looks like wrong masses. Calibrated, the mean error does not fall so.",
    "Calibrated once: on the other runs of the same controller, most of them along the same path.",
    "Positions are rebuilt from the script, the ramp's corners rounded as the script's blends are. "
    "The reading is 60 ms late.",
)


EXPERIMENT = Experiment(
    name="ur10e-contact",
    title="Contact force of a real UR10e from its motor currents, against a force sensor",
    section="recordings of a UR10e in contact",
    run=run,
    needs=("ur10e_contact", "ur10e"),
    order=165,
    seconds=250.0,
    readme=(
        "summary.command.straight_slide_v10.rmse_n",
        "ramp_ur.v10.slide.command.rmse_n",
        "ramp_ur.v25.slide.command.rmse_n",
        "summary.calibrated.rest.rmse_n",
    ),
)
