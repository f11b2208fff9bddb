"""Experiment `realism`: is the simulated UR10e as unkind as the real one?

Every real log has a simulated twin: the same commanded motion (the log's own positions,
low-passed), the true joints of its robot.yaml, the same rows. A model is identified on the same
three runs of each arm, in the same way, and the same statistics of what it leaves are compared,
joint by joint.

The truth's parameters were settled on the three fitted runs, on 7harm, 5harm and the December logs,
and on the rests of ptp_10_points; compared are five other runs, the loaded one, and the passes of
single joints. Of the days that differ only four are real: their statistics are known to some 35 %.

No statistic of so few minutes is exact. How far chance alone takes them apart is seen from a second
simulated arm with the same parameters, on other days and with other noise: a truth that is exactly
right would be found no closer to the real arm than these two are to each other. A number is told
apart if it is further off than the aim and than chance (`told_apart`).
"""

from typing import Any

import numpy as np

from wrenchsight.analyses.experiments.realism.comparison import (
    CHECKED,
    DAY_DRAWS,
    FIT,
    LOADED,
    PASSES,
    SETTLED,
    SETTLED_LOAD,
    STILL,
    ArmLogs,
    ToldApart,
    compared,
    told_apart,
    twins,
)
from wrenchsight.analyses.experiments.setups.ur10e_recordings.ur10e_logs import (
    FOLDER,
    MORE,
    log_file,
)
from wrenchsight.analyses.output.figures import COLOUR, SERIES, Figure, new_figure
from wrenchsight.analyses.study.experiment import (
    ComparisonRow,
    Experiment,
    ExperimentContext,
    ExperimentResult,
)
from wrenchsight.models.arrays import Array
from wrenchsight.models.recordings.recording_reader import read_recording

AIM = 0.25  # by which a simulated statistic may differ from the real one


def run(context: ExperimentContext) -> ExperimentResult:
    """Simulates the twins, identifies both arms, compares."""
    robot = context.robot("ur10e")
    recordings = {
        name: read_recording(log_file(context.data, name), robot=robot)
        for name in (*FIT, *CHECKED, LOADED, STILL, *PASSES)
    }
    context.progress(0.05, "identifying the real arm")
    real = ArmLogs.of(recordings, robot).statistics()
    days = 2 if context.quick else DAY_DRAWS
    simulated, more = twins(
        recordings,
        robot,
        context.seed,
        days,
        context.part(0.4, 0.6),
    )
    context.progress(0.6, "identifying the simulated arm")
    first = ArmLogs.of(simulated, robot, more).statistics()
    result = compared(real, first)
    context.progress(0.75, "another arm of the same truth")
    simulated, more = twins(recordings, robot, context.seed + 1, days)
    again = compared(first, ArmLogs.of(simulated, robot, more).statistics())
    ratios = np.array([entry["ratio"] for entry in result.values()])
    apart = {
        name: told_apart(entry["ratio"], again[name]["ratio"], AIM)
        for name, entry in result.items()
    }
    metrics: dict[str, Any] = {
        name: {key: _numbers(value) for key, value in entry.items()}
        | {
            "two_simulated_ratio": _numbers(again[name]["ratio"]),
            "chance_factor": _numbers(np.array([apart[name].factor]))[0],
            "told_apart_joints": [int(j) + 1 for j in np.flatnonzero(apart[name].joints)],
        }
        for name, entry in result.items()
    }
    metrics["within_25_pct"] = {
        "share_pct": _share_close(ratios),
        "two_simulated_share_pct": _share_close(
            np.array([entry["ratio"] for entry in again.values()])
        ),
        "numbers": int(np.isfinite(ratios).sum()),
        "told_apart_numbers": sum(int(one.joints.sum()) for one in apart.values()),
        "statistics_by_median_pct": 100.0
        * float(np.mean([abs(np.nanmedian(row) - 1.0) <= AIM for row in ratios])),
    }
    context.progress(0.95, "figure")
    return ExperimentResult(
        metrics=metrics,
        figures=[
            (
                "realism",
                _figure(result, apart),
                "The simulated UR10e over the real one, joint by joint: what a model identified in "
                "the same way leaves unexplained along the same motions, and what is in the "
                "currents. Bars: how far chance takes two simulated arms with the same parameters "
                "apart, in all but 5 % of the numbers. Full circles lie beyond both bar and 25 %.",
            )
        ],
        comparison=_comparison(),
        notes=NOTES,
        configuration={"settled_on": (*FIT, *SETTLED, *SETTLED_LOAD, f"{STILL}, at rest")},
    )


def _share_close(ratios: Array) -> float:
    """% of the finite ratios that lie within AIM of 1."""
    ratios = ratios[np.isfinite(ratios)]
    return 100.0 * float(np.mean(np.abs(ratios - 1.0) <= AIM))


def _numbers(values: Array) -> list[float | None]:
    return [float(value) if np.isfinite(value) else None for value in values]


def _comparison() -> list[ComparisonRow]:
    return [
        ComparisonRow(
            "Simulated over real: torque error on other runs, joints 1 to 6",
            "residual_all_nm.ratio",
            unit="-",
        ),
        ComparisonRow(
            "Share of the statistics, joint by joint, within 25 % of the real arm's",
            "within_25_pct.share_pct",
        ),
        ComparisonRow(
            "The same of two simulated arms with the same parameters: what chance leaves",
            "within_25_pct.two_simulated_share_pct",
        ),
        ComparisonRow(
            "Statistics, joint by joint, more than 25 % off and by more than chance takes two "
            "simulated arms apart",
            "within_25_pct.told_apart_numbers",
            unit="-",
        ),
    ]


def _figure(found: dict[str, dict[str, Array]], apart: dict[str, ToldApart]) -> Figure:
    figure, ((panel,),) = new_figure(1, 1, height=0.27 * len(found) + 1.2)
    panel.axvspan(1.0 - AIM, 1.0 + AIM, color=COLOUR["truth"], alpha=0.12, lw=0, zorder=0)
    places = np.arange(len(found))
    table = np.array([entry["ratio"] for entry in found.values()])
    wrong = np.array([apart[name].joints for name in found])
    factor = np.array([apart[name].factor for name in found])
    panel.hlines(places, 1.0 / factor, factor, color=COLOUR["truth"], alpha=0.35, lw=7, zorder=1)
    for j in range(table.shape[1]):
        at = places + 0.1 * (j - 2.5)
        colour = SERIES[j % len(SERIES)]
        panel.plot(table[:, j], at, "o", ms=4, mfc="none", color=colour)
        panel.plot([], [], "o", ms=4, color=colour, label=f"joint {j + 1}")
        panel.plot(table[wrong[:, j], j], at[wrong[:, j]], "o", ms=4, color=colour)
    panel.set_yticks(places, list(found))
    panel.set_xscale("log")
    ticks = [0.25, 0.5, 0.75, 1.0, 1.25, 2.0, 4.0]
    panel.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    panel.minorticks_off()
    panel.invert_yaxis()
    panel.set_xlabel("simulated over real; shaded: within 25 %; bars: chance; full: beyond both")
    figure.legend(loc="outside upper center", ncols=6)
    return figure


NOTES = (
    "Of the numbers, joint by joint, <within_25_pct.share_pct:.0f> % lie within 25 % of the real "
    "arm's, of the statistics by the median joint "
    "<within_25_pct.statistics_by_median_pct:.0f> %; two simulated arms with the same parameters "
    "agree so in <within_25_pct.two_simulated_share_pct:.0f> %.",
    "<within_25_pct.told_apart_numbers:.0f> of <within_25_pct.numbers:.0f> numbers are off by more "
    "than 25 % and by more than chance (Student's t, 5 %).",
)


EXPERIMENT = Experiment(
    name="realism",
    title="Is the simulated UR10e as unkind as the real one?",
    section="recordings of a UR10e",
    run=run,
    needs=(FOLDER, MORE),
    order=158,
    seconds=180,
    readme=("residual_all_nm.ratio", "within_25_pct.share_pct"),
)
