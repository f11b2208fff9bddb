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
    from wrenchsight.analyses.campaign.figures_fit import FiguresFit

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
    Option("fit", metavar="FIGURES.yaml"),
    Option("narrow", metavar="DIR"),
    Option("fresh"),
)


@with_settings(CampaignOptions, SETTINGS, from_file=False)
def command(options: CampaignOptions, out: Out = Path("out/campaign")) -> None:
    """Run experiments in many worlds, and show the spread of their figures.

    A world is a random draw of the simulated arm's true parameters. Finished worlds are kept: run
    the same command again after an interruption, or to add worlds or experiments.
    """
    from wrenchsight.analyses.campaign.campaign import COMMAND, run_campaign
    from wrenchsight.analyses.campaign.figures_config import bundled_worlds, load_figures
    from wrenchsight.analyses.campaign.figures_fit import fit_figures
    from wrenchsight.analyses.campaign.world_run import CampaignSettings
    from wrenchsight.analyses.output.progress import ProgressDisplay

    fit = options.fit
    if (fit is None) == (not options.experiments) or (options.narrow is not None and fit is None):
        problem = "name experiments, or give --fit FIGURES.yaml (with --narrow, if at all)"
        raise InputError("campaign", "", problem)
    if fit is not None:
        if options.world is not None or options.fastest_feed:
            raise InputError("--fit", "", "goes with neither --world nor --fastest-feed")
        figures = load_figures(fit, options.narrow)
        with ProgressDisplay(new_console(stderr=True), (COMMAND,)) as display:
            fitted = fit_figures(figures, options, out, display)
        _print_fit(fitted)
        return
    settings = CampaignSettings(**vars(options), source=bundled_worlds())
    with ProgressDisplay(new_console(stderr=True), (COMMAND,)) as display:
        result = run_campaign(settings, out, display)
    _print(result)
    if result.failures:
        raise typer.Exit(1)


def _print_fit(fit: "FiguresFit") -> None:
    table = new_table("", "printed", "nearest arm", "median", "5-95 %", "moved by")
    for row in fit.rows:
        moved = row.moved_by[0] if row.moved_by else None
        by = "" if moved is None else f"{moved.parameter} {moved.rank_correlation:+.2f}"
        numbers = (f"{x:.3g}" for x in (row.printed, row.best, row.median))
        table.add_row(plain_text(row.name), *numbers, f"{row.p05:.3g} to {row.p95:.3g}", by)
    ranges = "; ".join(
        f"{name} {low:.3g} to {high:.3g}" for name, (low, high) in fit.ranges.items()
    )
    show(
        table,
        f"parameters (5 to 95 %): {ranges}",
        f"arms: {fit.arms}; inside 5 to 95 %: {100 * fit.fitted_inside:.0f} % of the rows, of "
        f"those held out {100 * fit.held_out_inside:.0f} %",
        f"written to {fit.out / 'posterior'}",
    )


def _print(result: "CampaignResult") -> None:
    from wrenchsight.analyses.campaign.campaign_report import REPORT_NAME, table_row

    table = new_table("", "article", "median", "5-95 % of worlds", "ours ahead")
    experiment = ""
    for distribution in result.distributions:
        if distribution.experiment != experiment:
            experiment = distribution.experiment
            table.add_row(plain_text(experiment, style="bold"))
        row = table_row(distribution)
        label = (
            f"{distribution.label} [{distribution.unit}]"
            if distribution.unit
            else distribution.label
        )
        cells = [row[key] for key in ("article", "median", "range", "ahead")]
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
