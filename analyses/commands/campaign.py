"""The command `campaign`: experiments in many worlds."""

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from wrenchsight.analyses.campaign.campaign_options import CampaignOptions
from wrenchsight.analyses.commands.options import Option, Out, with_settings
from wrenchsight.analyses.output.console import new_console, new_table, plain_text, show
from wrenchsight.models.files.input_error import InputError

if TYPE_CHECKING:
    from wrenchsight.analyses.campaign.campaign import CampaignResult

ORDER = 15


SETTINGS = (
    Option("experiments", argument=True, metavar="EXPERIMENT"),
    Option("worlds", help="number of worlds in all", least=1),
    Option("data"),
    Option("seed", least=0),
    Option("quick"),
    Option("world", least=0),
    Option("fastest_feed"),
    Option("jobs", least=1),
    Option("cluster", metavar="ADDRESS"),
    Option("fresh"),
)


@with_settings(CampaignOptions, SETTINGS, from_file=False)
def command(options: CampaignOptions, out: Out = Path("out/campaign")) -> None:
    """Run experiments in many worlds, and show the spread of their figures.

    A world is a random draw of the simulated arm's true parameters. Finished worlds are kept: run
    the same command again after an interruption, or to add worlds or experiments.
    """
    from wrenchsight.analyses.campaign.campaign import COMMAND, run_campaign
    from wrenchsight.analyses.campaign.world_run import CampaignSettings
    from wrenchsight.analyses.output.progress import ProgressDisplay
    from wrenchsight.models.truth.worlds import bundled_worlds

    if not options.experiments:
        raise InputError("campaign", "", "names no experiment", "see `wrenchsight study --list`")
    settings = CampaignSettings(**vars(options), source=bundled_worlds())
    with ProgressDisplay(new_console(stderr=True), (COMMAND,)) as display:
        result = run_campaign(settings, out, display)
    _print(result)
    if result.failures:
        raise typer.Exit(1)


def _print(result: "CampaignResult") -> None:
    """Prints the table of distributions, the worlds that failed, and where the report is."""
    from wrenchsight.analyses.campaign.campaign_report import REPORT_NAME, table_row
    from wrenchsight.analyses.study.experiment import with_unit

    table = new_table("", "article", "median", "5-95 % of worlds", "ours ahead")
    experiment = ""
    for distribution in result.distributions:
        if distribution.experiment != experiment:
            experiment = distribution.experiment
            table.add_row(plain_text(experiment, style="bold"))
        texts = table_row(distribution)
        label = with_unit(distribution.label, distribution.unit)
        cells = [texts[key] for key in ("article", "median", "range", "ahead")]
        table.add_row(plain_text(label), *cells)
    reused = f", {result.reused} of them from earlier runs" if result.reused else ""
    if table.row_count:
        show(table)
    failures = [
        f"world {number} (seed {outcome.seed}) failed in {name}: {reason.splitlines()[0]}"
        for number, outcome in sorted(result.failures.items())
        for name, reason in outcome.failures.items()
    ]
    show(*failures, f"worlds: {result.worlds}{reused}")
    if result.seconds:
        times = "; ".join(f"{name} {seconds:.1f} s" for name, seconds in result.seconds.items())
        show(f"processor time a world: {times}")
    if result.worlds:
        show(f"report: {result.out / REPORT_NAME}")
