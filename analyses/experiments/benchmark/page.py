"""The benchmark's tables, for the report and docs/benchmark.md."""

from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

from wrenchsight.analyses.study.experiment import ComparisonRow, ResultTable

LABELS: Final = {
    "plain": "K (i − i_target)",
    "plain_tools": "plain tools",
    "article": "article",
    "kalman": "Kalman",
    "ours": "ours",
}


class Row(NamedTuple):
    """A row of a table.

    Attributes:
        task: whose metrics it shows.
        words: the row's label.
        key: key of the metric, below task and method.
        digits: format of its figures.
        cell: the figures' places: {0} is task and method, {1} the key, {2} the format.
    """

    task: str
    words: str
    key: str
    digits: str
    cell: str = "<{0}.{1}:{2}> (<{0}.{1}_low:{2}> to <{0}.{1}_high:{2}>)"


_ONE: Final = "<{0}.{1}:{2}>"
_WITHIN: Final = "<{0}.{1}:{2}> (<{0}.{1}_lower:{2}>, <{0}.{1}_upper:{2}>)"
_MISSED: Final = "<{0}.{1}_missed:{2}> of <{0}.{1}_contacts:{2}>"
_FOUND: Final = "<{0}.{1}:{2}> of <{0}.touches:{2}>"
_DELAY: Final = "<{0}.{1}_median_s:1e3 {2}> (<{0}.{1}_p95_s:1e3 {2}>)"
_MILLISECONDS: Final = "<{0}.{1}:1e3 {2}> (<{0}.{1}_low:1e3 {2}> to <{0}.{1}_high:1e3 {2}>)"
_MEAN: Final = "<{0}.{1}_mean:{2}> (<{0}.{1}_low:{2}> to <{0}.{1}_high:{2}>)"
_BAND: Final = "inside the 95 % band [%]"
_LATER, _RESTS = "ur-20_02_19_14harm50sec", "ur-20_01_17-ptp_10_points"
_EARLIER: Final = "ur-19_12_23_free"
_LOADS: Final = ("ur-20_02_19_14harm50secLoad", "ur-19_12_23_load")

ROWS: Final[Mapping[str, Sequence[Row]]] = {
    "torque": (
        Row("torque", "RMSE [N m] of nine logs", "rmse_nm", ".2f"),
        Row("torque", "14harm50sec, a week after the fit", f"logs.{_LATER}.rmse_nm", ".2f", _ONE),
        Row("torque", "ptp_10_points, with long rests", f"logs.{_RESTS}.rmse_nm", ".2f", _ONE),
        Row("torque", "12_23_free, seven weeks before", f"logs.{_EARLIER}.rmse_nm", ".2f", _ONE),
    ),
    "load": (
        Row("load", "RMSE [N] of pieces of 5 s", "rmse_n", ".1f"),
        Row("load", "2.805 kg, a week after the fit", f"logs.{_LOADS[0]}.rmse_n", ".1f"),
        Row("load", "1.069 kg, seven weeks before", f"logs.{_LOADS[1]}.rmse_n", ".1f"),
        Row("load", _BAND, "inside_95_pct", ".0f", _ONE),
        Row("load", "smoothed: RMSE [N] of pieces of 5 s", "smoothed_rmse_n", ".1f"),
        Row("load", f"smoothed: {_BAND}", "smoothed_inside_95_pct", ".0f", _ONE),
    ),
    "contact": (
        Row("contact", "slides: RMSE [N] of runs", "slide_rmse_n", ".1f"),
        Row("contact", "slides: its mean", "slide_rmse_n_mean", ".2f", _ONE),
        Row("contact", f"slides: {_BAND}", "slide_inside_95_pct", ".0f", _ONE),
        Row("contact", "at rest: RMSE [N] of holds", "rest_rmse_n", ".1f"),
        Row("contact", "at rest: its mean", "rest_rmse_n_mean", ".2f", _ONE),
        Row("contact", f"at rest: {_BAND}", "rest_inside_95_pct", ".0f", _ONE),
    ),
    "detection": (
        Row("detection", "pushes of 30 N missed [%]", "pushes_missed_pct", ".0f"),
        Row("detection", "of how many", "pushes_contacts", ".0f", _ONE),
        Row("detection", "their delay [ms], median (95 % below)", "pushes_delay", ".0f", _DELAY),
        Row("detection", "hand collisions missed", "collisions", ".0f", _MISSED),
        Row(
            "detection",
            "false alarms an hour",
            "false_alarms_per_hour",
            ".0f",
            _WITHIN,
        ),
        Row("detection", "time without contact in alarm [%]", "in_alarm_pct", ".2f", _ONE),
        Row(
            "detection",
            "pushes missed [%] where levels are so high that nothing without contact alarms",
            "quiet_missed_pct",
            ".0f",
        ),
        Row("touches", "touches found by the arm's torque", "found", ".0f", _FOUND),
        Row("touches", "contacts reported without a touch", "false", ".0f", _ONE),
        Row(
            "touches",
            "delay after the label [ms]",
            "delay_s",
            ".0f",
            _MILLISECONDS,
        ),
    ),
    "link": (
        Row("link", "labelled link named [%]", "named_pct", ".0f"),
        Row("link", "its mean", "named_pct_mean", ".1f", _ONE),
        Row("link", "how many are named, mean", "links_named", ".1f", _MEAN),
        Row(
            "link",
            "one named that statics rule out [%], mean",
            "ruled_out_pct_mean",
            ".1f",
            _ONE,
        ),
    ),
    "wrench": (
        Row("wrench", "RMSE [N] of configurations", "rmse_n", ".2f"),
        Row("wrench", "its mean", "rmse_n_mean", ".2f", _ONE),
        Row("wrench", _BAND, "inside_95_pct", ".0f"),
    ),
}
REMARKS: Final = {
    "detection": (
        "Ours with levels like the others': <detection.ours_by_level.pushes_missed_pct:.1f> % of "
        "the pushes missed at <detection.ours_by_level.false_alarms_per_hour:.0f> false alarms an "
        "hour, <detection.ours_by_level.in_alarm_pct:.0f> % of the time in alarm; "
        "<detection.ours_by_level.quiet_missed_pct:.1f> % missed where the levels are raised until "
        "no contact-free log alarms.",
    )
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
    metrics: Mapping[str, Any], entrants: Sequence[str], absent: Mapping[str, Sequence[str]]
) -> list[ResultTable]:
    """All tables: a row a measure, a column a method; a table without a figure has no row.

    What methods of others failed in, and which recordings are absent, stands below a table.

    Args:
        metrics: by task and method.
        entrants: names of the methods of others, whose columns are the last.
        absent: folders of recordings that are not there, by task.
    """
    labels = LABELS | {name: f"`{name}`" for name in entrants}
    result_tables = []
    for name, rows in ROWS.items():
        lines = [
            [row.words, *(_cell(metrics, row, method) for method in labels)]
            for row in rows
            if row.task in metrics  # else its recordings are absent
        ]
        tasks = {row.task for row in rows}
        lacking = sorted({folder for task in tasks for folder in absent.get(task, ())})
        remarks = [f"Not measured for want of recordings: {', '.join(lacking)}."] if lacking else []
        remarks += [text for text in REMARKS.get(name, ()) if lines]
        remarks += _failures(metrics, tasks, entrants)
        result_tables.append(
            ResultTable(name, TITLES[name], ["", *labels.values()], lines, remarks)
        )
    return result_tables


def _cell(metrics: Mapping[str, Any], row: Row, method: str) -> str:
    measured = metrics[row.task].get(method)
    if measured is None:
        return "–"
    if "failed" in measured:
        return "failed"
    return row.cell.format(f"{row.task}.{method}", row.key, row.digits)


def _failures(metrics: Mapping[str, Any], tasks: set[str], entrants: Sequence[str]) -> list[str]:
    reasons = {
        (name, metrics[task][name]["failed"]): None
        for task in sorted(tasks & set(metrics))
        for name in entrants
        if "failed" in metrics[task].get(name, {})
    }
    return [f"`{name}` failed: {reason}." for name, reason in reasons]


class Measure(NamedTuple):
    """A figure that the report shows beside a plain method's; both are measured here.

    Attributes:
        task: task of the benchmark.
        words: the row's label.
        key: key of the metric, below task and method.
        unit: unit of it.
        beside: the plain method.
        source: the name of the plain method in the report.
    """

    task: str
    words: str
    key: str
    unit: str
    beside: str
    source: str


MEASURES: Final = (
    Measure(
        "torque",
        "torque RMSE of held-out motion, median of logs",
        "rmse_nm",
        "N m",
        "plain_tools",
        "plain tools",
    ),
    Measure(
        "load",
        "force RMSE under a known load, median of pieces",
        "rmse_n",
        "N",
        "plain_tools",
        "plain tools",
    ),
    Measure(
        "contact",
        "force RMSE in slides, mean of runs",
        "slide_rmse_n_mean",
        "N",
        "plain",
        "K (i − i_target)",
    ),
    Measure(
        "detection", "pushes of 30 N missed", "pushes_missed_pct", "%", "plain_tools", "plain tools"
    ),
    Measure(
        "link", "labelled link named, mean", "named_pct_mean", "%", "plain", "last loaded joint"
    ),
    Measure(
        "wrench", "force RMSE from joint torque, mean", "rmse_n_mean", "N", "article", "eq. 22"
    ),
)


def comparison(metrics: Mapping[str, Any], entrants: Sequence[str]) -> list[ComparisonRow]:
    """Ours, and methods of others, beside a plain one."""
    return [
        _compared(measure, method, metrics[measure.task])
        for measure in MEASURES
        for method in ("ours", *entrants)
        if measure.key in metrics.get(measure.task, {}).get(method, {})
    ]


def _compared(measure: Measure, method: str, measured: Mapping[str, Any]) -> ComparisonRow:
    stated = measured.get(measure.beside, {}).get(measure.key)
    return ComparisonRow(
        measure.words if method == "ours" else f"{measure.words}, {method}",
        f"{measure.task}.{method}.{measure.key}",
        article=None if stated is None else float(f"{stated:.3g}"),
        source=f"{measure.source}, measured here",
        more_is_better=measure.task == "link",
        unit=measure.unit,
    )
