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
    ways = {"initial": "initial", "local method": "local", "optimised": "optimised"}
    ways |= {"best that is free": "free"}
    for name, way in ways.items():
        if way in metrics:
            figures = (f"{metrics[way][f'{what}_{key}']:.3f}" for what in ("mean", "max"))
            table.add_row(name, *figures)
    show(table, *notes(result.notices))
    if result.free is not None:
        show(f"joints of the free way: {out / 'trajectory_free.csv'}")
    show(f"joints: {out / 'trajectory.csv'}, page: {out / 'recording.html'}")
