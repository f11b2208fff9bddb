"""The command `place`: where a straight path belongs."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from wrenchsight.analyses.commands.options import Option, Out, on_command_line, with_settings
from wrenchsight.analyses.methods.place.place_settings import PlaceSettings
from wrenchsight.analyses.output.console import new_table, notes, show, showing_progress

if TYPE_CHECKING:
    from wrenchsight.analyses.methods.place.placement_result import PlacementResult

ORDER = 70
OPTIONS = (
    Option("task", required=True),
    Option("robot"),
    Option("objective"),
    Option("solver"),
    Option("model"),
    Option("method"),
    Option("seed", least=0),
    Option("quick"),
)


@with_settings(PlaceSettings, OPTIONS)
def command(settings: PlaceSettings, ctx: typer.Context, out: Out = Path("out/place")) -> None:
    """Find where a straight path belongs, and how the arm should stand along it."""
    from wrenchsight.analyses.methods.place.placement import place_task

    if on_command_line(ctx, "task"):
        settings = replace(settings, task_content=None)
    with showing_progress("place") as progress:
        result = place_task(settings, out, progress)
    _print(result, out)
    if result.search.interrupted:  # the best so far is printed and written
        raise KeyboardInterrupt


def _print(result: "PlacementResult", out: Path) -> None:
    """Prints the placements side by side, the optimised one in numbers, and the local optima.

    The metrics have `initial` where the task states a guess that can be followed, `unconstrained`
    where the best placement overlaps.
    """
    metrics, key = result.metrics(), result.measure.key
    names = {"mean_jcn": "mean JCN", "max_jcn": "largest JCN"}
    if key != "jcn":
        names |= {f"mean_{key}": "mean sd [N]", f"max_{key}": "largest sd [N]"}
    table = new_table("", *names.values())
    for solution in ("initial", "optimised", "unconstrained"):
        if solution in metrics:
            cells = [f"{metrics[solution][name]:.4f}" for name in names]
            table.add_row(solution, *cells)
    optimised = metrics["optimised"]
    # The best one comes first. Of the others, those at which no start ended are left out: they came
    # out of the refinement of an optimum.
    optima = ", ".join(
        f"{o[f'mean_{key}']:.4f} ({o['starts']} starts)"
        for k, o in enumerate(metrics["optima"])
        if k == 0 or o["starts"] > 0
    )
    show(
        table,
        f"direction: {_vector(optimised['direction'])}",
        f"midpoint [m]: {_vector(optimised['midpoint_m'])}",
        f"tool: {optimised['angle_deg']:.2f} degrees about {_vector(optimised['axis'])}",
        f"local optima: {optima}; {result.seconds:.1f} s",
        *notes(result.notices),
        f"postures: {out / 'postures.csv'}, page: {out / 'recording.html'}",
    )


def _vector(values: Iterable[float]) -> str:
    """Numbers of four decimals; one that is rounded to zero has no sign."""
    return " ".join(f"{round(value, 4) + 0.0:.4f}" for value in values)
