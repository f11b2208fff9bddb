"""The command `study`: every experiment, or those that are named."""

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from wrenchsight.analyses.commands.options import Option, Out, with_settings
from wrenchsight.analyses.output.console import new_console, new_table, plain_text, show

if TYPE_CHECKING:
    from wrenchsight.analyses.study.outcome import StudyResult

ORDER = 10


@dataclass
class StudyOptions:
    """Options of a study on the command line."""

    experiments: list[str] = field(default_factory=list)
    """names; all if none is given"""
    data: Path | None = None
    """folder of the real recordings, where you have one: see `data`"""
    seed: int = 0
    """seed of every random number"""
    quick: bool = False
    """shorter and coarser: to try things out"""
    truth: str = "own"
    """what simulated arms truly are: as their robot.yaml has it, or with plain friction alone, all
    else exact, or as the harder truth beside it has it"""
    jobs: int | None = None
    """experiments side by side; as many as cores"""
    method: list[str] = field(default_factory=list)
    """your own estimator, MODULE:FUNCTION, which the experiment benchmark measures beside the
    others; may be given several times"""
    fresh: bool = False
    """run also experiments whose results are up to date"""
    list_names: bool = False
    """list the experiments' names and stop"""


SETTINGS = (
    Option("experiments", argument=True, metavar="EXPERIMENT"),
    Option("data"),
    Option("seed", least=0),
    Option("quick"),
    Option("truth", metavar="own|plain|hard"),
    Option("jobs", least=1),
    Option("method", metavar="MODULE:FUNCTION"),
    Option("fresh"),
    Option("list_names", flags="--list"),
)


@with_settings(StudyOptions, SETTINGS, from_file=False)
def command(options: StudyOptions, out: Out = Path("out/study")) -> None:
    """Run the article's experiments, and those on real robots' logs, and report on them.

    What is finished is kept: after an interruption, run the same again to go on. An experiment runs
    anew when something that its result depends on has changed: options, software, recordings.
    """
    from wrenchsight.analyses.output.progress import ProgressDisplay
    from wrenchsight.analyses.study.registry import REGISTRY
    from wrenchsight.analyses.study.study import available_cores, check_names, run_study

    if options.list_names:
        sys.stdout.write("\n".join(REGISTRY.entries()) + "\n")
        return
    names = check_names(options.experiments)
    with ProgressDisplay(new_console(stderr=True), tuple(names)) as display:
        result = run_study(
            names,
            out,
            options.data,
            seed=options.seed,
            quick=options.quick,
            truth=options.truth,
            jobs=options.jobs or available_cores(),
            fresh=options.fresh,
            methods=options.method,
            watch=display,
        )
    _print(result)
    if result.failed:
        raise typer.Exit(1)


def _print(result: "StudyResult") -> None:
    """Prints a line a row of comparison, what did not run, and where the report is.

    An outcome's `stored` is its result.json: empty without a result, `failures` only of some.
    """
    from rich.padding import Padding

    from wrenchsight.analyses.data_sets.advice import missing_recordings
    from wrenchsight.analyses.study.experiment import with_unit
    from wrenchsight.analyses.study.report import comparisons

    table = new_table("", "article", "here")
    for outcome in result.outcomes:
        if outcome.has_result:
            earlier = " (kept)" if outcome.state == "earlier" else ""
            table.add_row(plain_text(f"{outcome.name}{earlier}", style="bold"))
        for row in comparisons(outcome.metrics, outcome.stored.get("comparison", [])):
            label = with_unit(row.label, row.unit)
            # Padded, not begun with spaces: a label's second line stands under its first.
            indented = Padding(plain_text(label), (0, 0, 0, 2))
            table.add_row(indented, " ".join(row.stated), " ".join(row.measured))
    missing = {outcome.name: outcome.lacks for outcome in result.outcomes if outcome.lacks}
    failures = [
        f"{outcome.name}: {text}"
        for outcome in result.outcomes
        for text in outcome.stored.get("failures", [])
    ]
    without_result = [
        f"{outcome.name} {outcome.state}: {outcome.reason}"
        for outcome in result.outcomes
        if not outcome.has_result and not outcome.lacks
    ]
    if table.row_count:
        show(table)
    show(*without_result)
    if missing:
        show(missing_recordings(missing))
    show(*failures, f"report: {result.report}")
