"""The benchmark's tables, for the report and docs/benchmark.md."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

from wrenchsight.analyses.study.experiment import ComparisonRow, ResultTable

LABELS: Final = {
    "plain": "K (i − i_target)",
    "plain_tools": "plain tools",
    "article": "article",
    "kalman": "Kalman",
    "network": "network",
    "ours": "ours",
}
_RANGE: Final = "<{0}.{1}:{2}> (<{0}.{1}_low:{2}> to <{0}.{1}_high:{2}>)"
_ONE: Final = "<{0}.{1}:{2}>"
_LOG: Final = (
    "<{0}.logs.{1}.rmse_n:{2}> (<{0}.logs.{1}.rmse_n_low:{2}> to <{0}.logs.{1}.rmse_n_high:{2}>)"
)
# Rows of the tables: the task whose metrics it shows, words, a cell, its key, its format.
ROWS: Final[Mapping[str, Sequence[tuple[str, str, str, str, str]]]] = {
    "torque": (
        ("torque", "RMSE [N m], median of logs (least to largest)", _RANGE, "rmse_nm", ".2f"),
        (
            "torque",
            "14harm50sec, a week after the fit",
            "<{0}.logs.{1}.rmse_nm:{2}>",
            "ur-20_02_19_14harm50sec",
            ".2f",
        ),
        (
            "torque",
            "ptp_10_points, with long rests",
            "<{0}.logs.{1}.rmse_nm:{2}>",
            "ur-20_01_17-ptp_10_points",
            ".2f",
        ),
        (
            "torque",
            "12_23_free, seven weeks before",
            "<{0}.logs.{1}.rmse_nm:{2}>",
            "ur-19_12_23_free",
            ".2f",
        ),
    ),
    "load": (
        (
            "load",
            "RMSE of the force [N], median of pieces of 5 s (least to largest)",
            _RANGE,
            "rmse_n",
            ".1f",
        ),
        ("load", "2.805 kg, a week after the fit", _LOG, "ur-20_02_19_14harm50secLoad", ".1f"),
        ("load", "1.069 kg, seven weeks before", _LOG, "ur-19_12_23_load", ".1f"),
        ("load", "inside the stated 95 % band [%]", _ONE, "inside_95_pct", ".0f"),
    ),
    "contact": (
        (
            "contact",
            "slides: RMSE [N], median of runs (least to largest)",
            _RANGE,
            "slide_rmse_n",
            ".1f",
        ),
        ("contact", "slides: RMSE [N], mean of runs", _ONE, "slide_rmse_n_mean", ".2f"),
        ("contact", "slides: inside the stated 95 % band [%]", _ONE, "slide_inside_95_pct", ".0f"),
        (
            "contact",
            "at rest: RMSE [N], median of holds (least to largest)",
            _RANGE,
            "rest_rmse_n",
            ".1f",
        ),
        ("contact", "at rest: RMSE [N], mean of holds", _ONE, "rest_rmse_n_mean", ".2f"),
        ("contact", "at rest: inside the stated 95 % band [%]", _ONE, "rest_inside_95_pct", ".0f"),
    ),
    "detection": (
        (
            "detection",
            "pushes of 30 N for 0.5 s missed [%] ± standard error",
            "<{0}.{1}:{2}> ± <{0}.{1}_error:{2}>",
            "pushes_missed_pct",
            ".1f",
        ),
        ("detection", "of how many", _ONE, "pushes_contacts", ".0f"),
        (
            "detection",
            "their delay, median [ms] (95 % below)",
            "<{0}.{1}_median_s:1e3 {2}> (<{0}.{1}_p95_s:1e3 {2}>)",
            "pushes_delay",
            ".0f",
        ),
        (
            "detection",
            "hand collisions missed",
            "<{0}.{1}_missed:{2}> of <{0}.{1}_contacts:{2}>",
            "collisions",
            ".0f",
        ),
        (
            "detection",
            "false alarms per hour of free motion and rest (95 %: from, to)",
            "<{0}.{1}:{2}> (<{0}.{1}_lower:{2}>, <{0}.{1}_upper:{2}>)",
            "false_alarms_per_hour",
            ".0f",
        ),
        ("detection", "share of that time in alarm [%]", _ONE, "in_alarm_pct", ".2f"),
        (
            "touches",
            "touches found, by the arm's own torque",
            "<{0}.{1}:{2}> of <{0}.touches:{2}>",
            "found",
            ".0f",
        ),
        ("touches", "contacts reported without a touch", _ONE, "false", ".0f"),
        (
            "touches",
            "delay after the label [ms], median of recordings (least to largest)",
            "<{0}.{1}:1e3 {2}> (<{0}.{1}_low:1e3 {2}> to <{0}.{1}_high:1e3 {2}>)",
            "delay_s",
            ".0f",
        ),
    ),
    "link": (
        (
            "link",
            "labelled link among those named [%], median of recordings (least to largest)",
            _RANGE,
            "named_pct",
            ".0f",
        ),
        ("link", "the same, mean of recordings [%]", _ONE, "named_pct_mean", ".1f"),
        (
            "link",
            "links named, mean of recordings (least to largest)",
            "<{0}.{1}_mean:{2}> (<{0}.{1}_low:{2}> to <{0}.{1}_high:{2}>)",
            "links_named",
            ".1f",
        ),
        (
            "link",
            "a link named that statics rule out [%], mean of recordings",
            _ONE,
            "ruled_out_pct_mean",
            ".1f",
        ),
    ),
    "wrench": (
        (
            "wrench",
            "RMSE of the force [N], median of configurations (least to largest)",
            _RANGE,
            "rmse_n",
            ".2f",
        ),
        ("wrench", "the same, mean of configurations", _ONE, "rmse_n_mean", ".2f"),
        (
            "wrench",
            "inside the stated 95 % band [%], median (least to largest)",
            _RANGE,
            "inside_95_pct",
            ".0f",
        ),
    ),
}
TITLES: Final = {
    "torque": "Torque of motion that no method was fitted on",
    "load": "Force of a known load in motion",
    "contact": "Contact force along the tool, sliding and at rest",
    "detection": "Detection of contact",
    "link": "Link that is touched",
    "wrench": "Force from the joint torque that an arm reports itself",
}


def tables(
    metrics: Mapping[str, Any], own: Sequence[str], absent: Mapping[str, Sequence[str]]
) -> list[ResultTable]:
    """All tables.

    Args:
        metrics: by task and method.
        own: names of the methods of others, whose columns are the last.
        absent: folders of recordings that are not there, by task.
    """
    labels = LABELS | {name: f"`{name}`" for name in own}
    found = []
    for name, rows in ROWS.items():
        lines = [
            [words, *(_cell(metrics, task, method, (cell, key, form)) for method in labels)]
            for task, words, cell, key, form in rows
            if task in metrics
        ]
        lacking = sorted({one for task, *_ in rows for one in absent.get(task, ())})
        remarks = [f"Not measured for want of recordings: {', '.join(lacking)}."] if lacking else []
        remarks += _failures(metrics, {task for task, *_ in rows}, own)
        found.append(ResultTable(name, TITLES[name], ["", *labels.values()], lines, remarks))
    return found


def _cell(metrics: Mapping[str, Any], task: str, method: str, cell: tuple[str, str, str]) -> str:
    measured = metrics[task].get(method)
    if measured is None:
        return "–"
    if "failed" in measured:
        return "failed"
    form, *words = cell
    return form.format(f"{task}.{method}", *words)


def _failures(metrics: Mapping[str, Any], tasks: set[str], own: Sequence[str]) -> list[str]:
    reasons = {
        (name, metrics[task][name]["failed"]): None
        for task in sorted(tasks & set(metrics))
        for name in own
        if "failed" in metrics[task].get(name, {})
    }
    return [f"`{name}` failed: {reason}." for name, reason in reasons]


def comparison(metrics: Mapping[str, Any], own: Sequence[str]) -> list[ComparisonRow]:
    """Ours, and methods of others, beside plain tools, all measured here."""
    measures = {
        "torque": ("torque RMSE of held-out motion, median of logs", "rmse_nm", "plain_tools"),
        "load": ("force RMSE under a known load, median of pieces", "rmse_n", "plain_tools"),
        "contact": ("force RMSE in slides, mean of runs", "slide_rmse_n_mean", "plain_tools"),
        "detection": ("pushes of 30 N missed", "pushes_missed_pct", "plain_tools"),
        "link": ("labelled link among those named, mean", "named_pct_mean", "plain"),
        "wrench": ("force RMSE from joint torque, mean", "rmse_n_mean", "article"),
    }
    rows = []
    for task, (words, key, beside) in measures.items():
        for method in ("ours", *own):
            measured = metrics.get(task, {})
            if key not in measured.get(method, {}):
                continue
            stated = measured.get(beside, {}).get(key)
            who = "" if method == "ours" else f", {method}"
            source = f"{LABELS[beside]}, measured here"
            more = task == "link"
            rows.append(
                ComparisonRow(
                    *(f"{words}{who}", f"{task}.{method}.{key}", stated, "", source),
                    more_is_better=more,
                )
            )
    return rows
