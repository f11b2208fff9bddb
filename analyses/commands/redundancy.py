"""The command `redundancy`: the free angle along a path on a surface."""

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from wrenchsight.analyses.commands.options import Option, Out, on_command_line, with_settings
from wrenchsight.analyses.methods.redundancy.redundancy_task import RedundancySettings
from wrenchsight.analyses.output.console import new_table, notes, show, showing_progress

if TYPE_CHECKING:
    from wrenchsight.analyses.methods.redundancy.redundancy import RedundancyResult

ORDER = 80
OPTIONS = (Option("task", required=True), Option("robot"))


@with_settings(RedundancySettings, OPTIONS)
def command(
    settings: RedundancySettings, ctx: typer.Context, out: Out = Path("out/redundancy")
) -> None:
    """Choose the free angle about the normal, and the branch, along a path on a surface."""
    from wrenchsight.analyses.methods.redundancy.redundancy_results import redundancy

    if on_command_line(ctx, "task"):
        settings.task_content = None
    with showing_progress("redundancy") as progress:
        result = redundancy(settings, out, progress)
    _print(result, out)


def _print(result: "RedundancyResult", out: Path) -> None:
    metrics, key = result.metrics(), result.problem.measure.key
    table = new_table(result.problem.measure.label, "mean", "largest")
    solutions = {
        "initial": "initial",
        "local method": "local",
        "optimised": "optimised",
        "best without collision": "free",
    }
    for title, name in solutions.items():
        if name in metrics:
            mean, largest = metrics[name][f"mean_{key}"], metrics[name][f"max_{key}"]
            table.add_row(title, f"{mean:.3f}", f"{largest:.3f}")
    show(table, *notes(result.notices))
    show(f"joints: {out / 'trajectory.csv'}, page: {out / 'recording.html'}")
