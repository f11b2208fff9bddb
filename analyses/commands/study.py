"""The command `study`: every experiment, or those that are named."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wrenchsight.analyses.commands.options import Data, Out, Quick, Seed, Truth
from wrenchsight.analyses.output.console import new_console, new_table, plain_text, show

if TYPE_CHECKING:
    from wrenchsight.analyses.study.outcome import StudyResult

ORDER = 10


def command(
    experiments: Annotated[
        list[str] | None,
        typer.Argument(metavar="EXPERIMENT", help="Names; all if none is given."),
    ] = None,
    out: Out = Path("out/study"),
    data: Data = Path("../shared/data"),
    seed: Seed = 0,
    quick: Quick = False,
    truth: Truth = "own",
    jobs: Annotated[
        int | None, typer.Option(min=1, help="Experiments side by side; as many as cores.")
    ] = None,
    fresh: Annotated[
        bool,
        typer.Option("--fresh", help="Run also experiments whose results are up to date."),
    ] = False,
    list_names: Annotated[
        bool, typer.Option("--list", help="List the experiments' names and stop.")
    ] = False,
) -> None:
    """Run the article's experiments, and those on real robots' logs, and report on them.

    What is finished is kept: after an interruption, run the same again to go on. An experiment runs
    anew when something that its result depends on has changed: options, software, recordings.
    """
    from wrenchsight.analyses.output.progress import ProgressDisplay
    from wrenchsight.analyses.study.registry import REGISTRY
    from wrenchsight.analyses.study.study import available_cores, check_names, run_study

    if list_names:
        sys.stdout.write("\n".join(REGISTRY.entries()) + "\n")
        return
    names = check_names(experiments or [])
    with ProgressDisplay(new_console(stderr=True), tuple(names)) as watch:
        result = run_study(
            names,
            out,
            data,
            seed=seed,
            quick=quick,
            truth=truth,
            jobs=jobs or available_cores(),
            fresh=fresh,
            watch=watch,
        )
    _print(result)
    if result.failed:
        raise typer.Exit(1)


def _print(result: "StudyResult") -> None:
    from rich.padding import Padding

    from wrenchsight.analyses.study.report import comparisons

    table = new_table("", "article", "here")
    for outcome in result.outcomes:
        if outcome.has_result:
            earlier = " (kept)" if outcome.state == "earlier" else ""
            table.add_row(plain_text(f"{outcome.name}{earlier}", style="bold"))
        for row in comparisons(outcome.metrics, outcome.stored.get("comparison", [])):
            label = f"{row.label} [{row.unit}]" if row.unit else row.label
            # Padded, not begun with spaces: a label's second line stands under its first.
            indented = Padding(plain_text(label), (0, 0, 0, 2))
            table.add_row(indented, " ".join(row.stated), " ".join(row.here))
    show(
        *([table] if table.row_count else []),
        *(f"{o.name} {o.state}: {o.reason}" for o in result.outcomes if not o.has_result),
        f"report: {result.report}",
    )
