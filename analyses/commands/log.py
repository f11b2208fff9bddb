"""The command `log`: what a log is, drawn on a page, and a draft of its description."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from wrenchsight.analyses.commands.options import Option, Out, with_settings
from wrenchsight.analyses.methods.log.log_settings import LogSettings
from wrenchsight.analyses.output.console import new_table, notes, show, showing_progress

if TYPE_CHECKING:
    from wrenchsight.analyses.methods.log.log_inspection import InspectedLog
    from wrenchsight.analyses.methods.log.log_summary import LogSummary

ORDER = 15
_PRINTED_COLUMNS = 40
OPTIONS = (
    Option("logs", required=True, argument=True, metavar="FILE"),
    Option("robot"),
    Option("log_format"),
)


@with_settings(LogSettings, OPTIONS)
def command(settings: LogSettings, out: Out = Path("out/log")) -> None:
    """Say what a log is: columns, joints, rate, gaps, motion; draw it and draft its description."""
    from wrenchsight.analyses.methods.log.log_inspection import inspect_logs

    with showing_progress("log") as progress:
        logs = inspect_logs(settings, out, progress)
    for log in logs:
        _print(log, out)


def _print(log: "InspectedLog", out: Path) -> None:
    from wrenchsight.models.recordings.layouts.shortened_list import shortened

    show(f"{log.path}: {log.container}, columns: {len(log.columns)}")
    draft = f"draft of its description: {out / log.draft_name}"
    if log.summary is None:
        show(
            f"columns: {shortened(log.columns, _PRINTED_COLUMNS)}",
            f"not read: {log.problem}",
            *notes(log.notices),
            f"{draft}; fill in what has a question mark, and add --log-format with it",
        )
        return
    if log.unread:
        show(f"columns that are not read: {shortened(log.unread, _PRINTED_COLUMNS)}")
    show(_rate_text(log.summary))
    if log.joint_names:
        _print_joints(log)
    show(*notes(log.notices))
    if log.problem:
        show(f"contradicts the robot: {log.problem}")
    figure = out / "figures" / f"log_{log.name}.png"
    show(f"{draft}" + (f", figure: {figure}" if log.joint_names else ""))


def _rate_text(summary: "LogSummary") -> str:
    least, most = summary.steps
    text = f"{summary.num_samples} samples in {summary.duration:.4g} s, {summary.rate_hz:.4g} Hz"
    if most - least > 0.01 * summary.step:
        text += f" (steps of {1e3 * least:.3g} to {1e3 * most:.3g} ms)"
    if summary.num_gaps:
        return f"{text}; gaps: {summary.num_gaps}, the longest {summary.longest_gap:.3g} s"
    return f"{text}; no gaps"


def _print_joints(log: "InspectedLog") -> None:
    summary = log.summary
    assert summary is not None
    quantity = "current\nRMS [A]" if summary.drawn.tau_J is None else "torque\nRMS [N m]"
    table = new_table("\njoint", "position\n[rad]", "moves by\n[rad]", "fastest\n[rad/s]", quantity,
                      "at rest\n[%]")  # fmt: skip
    travel = summary.q_max - summary.q_min
    for j, name in enumerate(log.joint_names):
        table.add_row(
            name,
            f"{summary.q_min[j]:.3g} to {summary.q_max[j]:.3g}",
            f"{travel[j]:.3g}",
            f"{summary.v_max[j]:.3g}",
            f"{summary.effort_rms[j]:.3g}",
            f"{100 * summary.rest[j]:.0f}",
        )
    show(table)
    resting = np.flatnonzero(summary.rests_throughout)
    if len(resting):
        show(f"rest throughout: {', '.join(log.joint_names[j] for j in resting)}")
