"""Supports docs/foreign-physics.md, "is checked in physics that nobody here wrote".

Experiment `foreign-physics`: drawn arms in MuJoCo, identified and read as a user does it, 20 draws.

Each draw of an arm is identified from two motions of `excite`; then its logs are read by `estimate`
with its defaults and held against MuJoCo's truth. CORE_CASES cases run for all draws of all arms,
the others for the first FURTHER_DRAWS of the UR10e. Figures are the median and the worst of the
draws.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from wrenchsight.analyses.output.figures import SERIES, legend_on_top, new_figure
from wrenchsight.analyses.output.side_by_side import Died, run_side_by_side
from wrenchsight.analyses.study.experiment import (
    ComparisonRow,
    Drawing,
    Experiment,
    ExperimentContext,
    ExperimentResult,
    ResultTable,
)
from wrenchsight.models.files.input_error import InputError

if TYPE_CHECKING:
    from wrenchsight.analyses.experiments.foreign_physics.motions import Motion

CORE_CASES: Final = (
    "free",
    "pick_and_place",
    "constant",
    "steps",
    "sine_2",
    "sine_5",
    "slide_40",
    "slide_110",
    "press",
    "drift_steps",
)
FIRST_ARM: Final = "ur10e"
NUM_DRAWS: Final = {"ur10e": 20, "panda": 20, "z1": 20}
QUICK_DRAWS: Final = {"ur10e": 2}
FURTHER_DRAWS: Final = 4
QUICK_CASES: Final = ("free", "pick_and_place", "steps")
QUICK_PERIODS: Final = 2
README_CASES: Final = ("free", "constant", "steps", "sine_2", "slide_40", "slide_110")
"""Cases of which the README states the worst draw."""
_MOTIONS_SHARE: Final = 0.05  # of the whole time
_WORST: Final = {  # keys of the figures, and whether the least is the worst
    "inside_95_pct": True,
    "beyond_3sd_pct": False,
    "share_valid_pct": True,
    "sd_n": False,
    "false_contacts_per_hour": False,
    "missed": False,
}


class _Plan(NamedTuple):
    """Draws of an arm: the cases that are read of each."""

    arm: str
    cases: Sequence[tuple[str, ...]]


@dataclass(frozen=True, eq=False)
class _Draw:
    """A draw of an arm, and the cases that are read of it.

    Attributes:
        arm: one of `arms.ARMS`.
        seed: of the draw.
        motions: of its identification.
        cases: names of `cases.CASES`.
    """

    arm: str
    seed: int
    motions: "tuple[Motion, ...]"
    cases: tuple[str, ...]


def run(context: ExperimentContext) -> ExperimentResult:
    """Reads all logs, draws side by side, and sums them up; a draw that fails is left out."""
    from numba import config

    plans, lacking = _plans(context.quick)
    draws = list(_with_motions(plans, context))
    # By the draw's place in `draws`, then by case.
    figures_of_draw: dict[int, dict[str, dict[str, Any]]] = {}
    failures = []  # sentences
    ends = run_side_by_side(
        _read_draw,
        draws,
        config.NUMBA_NUM_THREADS,  # as many processors as this experiment may use
        environment={"NUMBA_NUM_THREADS": "1"},
        started=lambda draw: context.progress(
            _MOTIONS_SHARE + (1.0 - _MOTIONS_SHARE) * len(figures_of_draw) / len(draws),
            f"{draw.arm}, draw {draw.seed}; {len(figures_of_draw)} of {len(draws)} draws are read",
        ),
    )
    with closing(ends):
        for draw, figures_or_reason in ends:
            # Why it has none, in a sentence, or that its process died.
            if isinstance(figures_or_reason, Died | str):
                failures.append(f"{draw.arm}, draw {draw.seed}: {figures_or_reason}")
            else:
                figures_of_draw[draws.index(draw)] = figures_or_reason
    read: dict[str, dict[str, list[dict[str, Any]]]] = {}  # by arm and case, of each draw
    for k in sorted(figures_of_draw):  # the order in which they end is chance
        by_case = read.setdefault(draws[k].arm, {})
        for case, figures in figures_of_draw[k].items():
            by_case.setdefault(case, []).append(figures)
    return replace(result_of(read, lacking, context.draws), failures=failures)


def _with_motions(plans: "Sequence[_Plan]", context: ExperimentContext) -> Iterator[_Draw]:
    """The draws of all plans, with the motions of the arm, which are planned once."""
    from wrenchsight.analyses.experiments.foreign_physics.arms import robot_file
    from wrenchsight.analyses.experiments.foreign_physics.identified_arms import (
        NUM_PERIODS,
        excitation_motions,
    )
    from wrenchsight.models.robot.robot import Robot

    periods = QUICK_PERIODS if context.quick else NUM_PERIODS
    for k, plan in enumerate(plans):
        context.progress(_MOTIONS_SHARE * k / len(plans), f"{plan.arm}: motions of excite")
        with TemporaryDirectory() as scratch:
            file = robot_file(plan.arm, Path(scratch))
            motions = excitation_motions(Robot.load(file), file, periods)
        for draw, cases in enumerate(plan.cases):
            yield _Draw(plan.arm, 100 * context.seed + draw, motions, cases)


def _read_draw(draw: _Draw) -> dict[str, dict[str, Any]] | str:
    """The figures of a draw by case (`readings.figures`), or why it has none."""
    from wrenchsight.analyses.experiments.foreign_physics.drawn_arm import DrawnArm

    figures_of_case = {}
    try:
        with TemporaryDirectory() as scratch:
            drawn = DrawnArm.identify(draw.arm, draw.seed, Path(scratch), draw.motions)
            for case in draw.cases:
                log = drawn.simulate(case)
                reading = drawn.read(case, log, draws=False)
                figures_of_case[case] = drawn.figures(case, log, reading)
    except (InputError, RuntimeError) as error:  # its logs identify nothing, or MuJoCo gave up
        return str(error)
    return figures_of_case


def result_of(
    read: dict[str, dict[str, list[dict[str, Any]]]], lacking: Sequence[str], draws: bool
) -> ExperimentResult:
    """Metrics, tables and figure of the figures of all logs.

    Args:
        read: by arm and case, of each draw (`readings.figures`).
        lacking: sentences on what is left out.
        draws: whether a figure is wanted.

    Returns:
        Metrics by arm and case (`summed_up`); and of an arm `worst_inside_pct`: of each README case
        that has a valid sample the share of the worst draw's worst axis of the force.
    """
    metrics: dict[str, Any] = {
        arm: {case: summed_up(figures) for case, figures in by_case.items()}
        for arm, by_case in read.items()
    }
    for cases in metrics.values():
        shown = _shown(cases)
        if shown:
            worst_draws = [cases[case]["inside_95_pct"]["worst"] for case in shown]  # (6,) each
            cases["worst_inside_pct"] = [float(np.min(of_axes[:3])) for of_axes in worst_draws]
    return ExperimentResult(
        metrics=metrics,
        figures=[_figure(read)] if draws else [],
        comparison=_comparison(metrics),
        notes=(*NOTES, *lacking),
        tables=[_table(arm, cases) for arm, cases in metrics.items()],
    )


def _shown(cases: dict[str, Any]) -> list[str]:
    """The README's cases of an arm, but for those of which no draw has a valid sample."""
    return [case for case in README_CASES if "inside_95_pct" in cases.get(case, {})]


def _plans(quick: bool) -> tuple[list[_Plan], list[str]]:
    """What is read, and a sentence on what is left out."""
    from wrenchsight.analyses.experiments.foreign_physics.arms import DRAFTED_ARM, has_stranger
    from wrenchsight.analyses.experiments.foreign_physics.cases import CASES

    if quick:
        return [_Plan(arm, [QUICK_CASES] * count) for arm, count in QUICK_DRAWS.items()], []
    further = tuple(case for case in CASES if case not in CORE_CASES)
    plans = [
        _Plan(
            arm,
            [CORE_CASES + further * (arm == FIRST_ARM and k < FURTHER_DRAWS) for k in range(count)],
        )
        for arm, count in NUM_DRAWS.items()
        if arm != DRAFTED_ARM or has_stranger()
    ]
    without = (
        f"{DRAFTED_ARM} is left out: python -m pip install 'wrenchsight[study]' brings its URDF."
    )
    return plans, [] if any(plan.arm == DRAFTED_ARM for plan in plans) else [without]


def summed_up(draws: list[dict[str, Any]]) -> dict[str, Any]:
    """Median and worst of the figures of one case, a draw each (`readings.figures`).

    Draws whose log was refused, or has no valid sample, have a NaN share inside: they do not count
    there, and count as not valid. A key that no draw has is left out.

    Args:
        draws: at least one, all read with plain tools, too.

    Returns:
        Counts and sums over the draws (`all_...`), `invalid` (mean percent by reason), and of each
        key of _WORST, and below `ours` and `plain` of `rmse_n`, `median` and `worst`.
    """
    hours = sum(figures["seconds"] for figures in draws) / 3600.0
    result: dict[str, Any] = {
        "draws": len(draws),
        "refused": sum(figures["refused"] for figures in draws),
        "true_contacts": sum(figures["true_contacts"] for figures in draws),
        "all_missed": sum(figures["missed"] for figures in draws),
        "all_false_contacts_per_hour": sum(figures["false_contacts"] for figures in draws) / hours,
    }
    reasons = sorted({key for figures in draws for key in figures["invalid"]})
    result["invalid"] = {
        key: float(np.mean([figures["invalid"].get(key, 0.0) for figures in draws]))
        for key in reasons
    }
    for key, is_least in _WORST.items():
        if key == "false_contacts_per_hour":
            values = [3600.0 * figures["false_contacts"] / figures["seconds"] for figures in draws]
        else:
            values = [figures[key] for figures in draws]
        result |= _median_and_worst(key, values, is_least)
    for method in ("ours", "plain"):
        values = [figures[method]["rmse_n"] for figures in draws]
        result[method] = _median_and_worst("rmse_n", values, is_least=False)
    return result


def _median_and_worst(key: str, values: list[Any], is_least: bool) -> dict[str, Any]:
    """Median and worst of the draws that have the figure, by its key; nothing where none has."""
    table = np.array(values, dtype=float)
    known = table[~np.isnan(table.reshape(len(table), -1)).any(axis=1)]
    if not len(known):
        return {}
    worst = known.min(axis=0) if is_least else known.max(axis=0)
    return {key: {"median": np.median(known, axis=0), "worst": worst}}


def _figure(read: dict[str, dict[str, list[dict[str, Any]]]]) -> Drawing:
    """Shares of each draw, case by case; an arm's dots stand beside the other arms'.

    Args:
        read: by arm and case, of each draw (`readings.figures`).
    """
    case_names = list(dict.fromkeys(case for by_case in read.values() for case in by_case))
    figure, axes = new_figure(3, 1, height=7.0, share_x=True)
    # The first three of the six axes are the force's.
    panels: tuple[tuple[str, Callable[[dict[str, Any]], float]], ...] = (
        ("valid samples inside\nthe 95 % band [%]", lambda f: f["inside_95_pct"][:3].min()),
        ("beyond 3 sd [%]", lambda f: f["beyond_3sd_pct"][:3].max()),
        ("valid samples [%]", lambda f: f["share_valid_pct"]),
    )
    for axis, (label, share_of) in zip(list[Any](axes.flat), panels, strict=True):
        for k, (arm, by_case) in enumerate(read.items()):
            offset = (k - 0.5 * (len(read) - 1)) * 0.25
            for case, draws in by_case.items():
                values = [share_of(figures) for figures in draws]
                x = np.full(len(values), case_names.index(case) + offset)
                label_once = arm if case == next(iter(by_case)) else None
                colour = SERIES[k % len(SERIES)]
                axis.plot(x, values, ".", color=colour, ms=5, alpha=0.6, label=label_once)
        axis.set_ylabel(label)
    axes[0, 0].axhspan(90.0, 99.0, color="0.9", zorder=0)
    axes[1, 0].axhline(2.0, color="0.6", lw=0.8)
    axes[-1, 0].set_xticks(range(len(case_names)), case_names, rotation=60, ha="right")
    legend_on_top(figure, axes[0, 0], ncols=3)
    caption = (
        "Each dot is a draw: the worst axis of the force (shares inside and beyond 3 sd), and the "
        "share of samples that are valid. Grey: 90 to 99 % inside, 2 % beyond 3 sd."
    )
    return "shares", figure, caption


def _table(arm: str, cases: dict[str, Any]) -> ResultTable:
    """The table of an arm: a row a case, each cell a pattern that the metrics fill.

    `<key:.0f>` is replaced by the metric at the path `key` in this format; of a list of axes all
    stand side by side.

    Args:
        cases: metrics by case, and `worst_inside_pct`, which is no case.
    """

    def row(case: str) -> list[str]:
        key = f"{arm}.{case}"
        return [
            case,
            f"<{key}.inside_95_pct.median:.0f>",
            f"<{key}.inside_95_pct.worst:.0f>",
            f"<{key}.beyond_3sd_pct.worst:.1f>",
            f"<{key}.share_valid_pct.median:.0f> (<{key}.share_valid_pct.worst:.0f>)",
            f"<{key}.all_false_contacts_per_hour:.0f>",
            f"<{key}.all_missed:.0f> of <{key}.true_contacts:.0f>",
            f"<{key}.refused:.0f> of <{key}.draws:.0f>",
            f"<{key}.ours.rmse_n.median:.1f>",
            f"<{key}.plain.rmse_n.median:.1f>",
        ]

    heads = (
        "case",
        "inside [%]",
        "worst draw [%]",
        "beyond 3 sd, worst draw [%]",
        "valid (worst) [%]",
        "false contacts an hour",
        "missed",
        "refused",
        "RMSE, ours [N]",
        "RMSE, plain tools [N]",
    )
    return ResultTable(arm, arm, heads, [row(case) for case in cases if case != "worst_inside_pct"])


def _comparison(metrics: dict[str, Any]) -> list[ComparisonRow]:
    rows = []
    for arm, figures in metrics.items():
        shown = _shown(figures)
        if not shown:
            continue
        label = (
            "Inside the stated 95 % band, worst axis of the force and worst draw of "
            f"{figures[shown[0]]['draws']}, "
            f"{arm}: {', '.join(shown)}"
        )
        lacking = [case for case in README_CASES if case in figures and case not in shown]
        remark = "of the draws with valid samples"
        if lacking:
            remark += f"; no draw has one in {', '.join(lacking)}"
        rows.append(ComparisonRow(label, f"{arm}.worst_inside_pct", remark=remark))
    return rows


NOTES = (
    "UR10e in MuJoCo, valid samples inside the 95 % band in the median draw, fx fy fz mx my mz: "
    "free motion <ur10e.free.inside_95_pct.median:.0f> %, steps of force "
    "<ur10e.steps.inside_95_pct.median:.0f> %.",
    "False contacts an hour: <ur10e.free.all_false_contacts_per_hour:.0f> in free motion, "
    "<ur10e.pick_and_place.all_false_contacts_per_hour:.0f> with a rest at every place.",
    "RMSE of the force in steps, x y z: <ur10e.steps.ours.rmse_n.median:.2f> N; plain tools "
    "(least squares, first-order observer, pinv(J^T)): <ur10e.steps.plain.rmse_n.median:.2f> N.",
)


EXPERIMENT = Experiment(
    name="foreign-physics",
    title="What is valid, in physics that nobody here wrote",
    section="arms in MuJoCo",
    run=run,
    modules=("mujoco",),
    order=190,
    seconds=3000,
    readme=("ur10e.worst_inside_pct", "panda.worst_inside_pct", "z1.worst_inside_pct"),
)
