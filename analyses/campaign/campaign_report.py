"""A campaign as one page: a table and violins for each experiment, ranges and failures."""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from wrenchsight.analyses.campaign.campaign_store import CampaignRecord
from wrenchsight.analyses.campaign.distributions import (
    HIGH_QUANTILE,
    LOW_QUANTILE,
    Distribution,
)
from wrenchsight.analyses.campaign.influences import influences_text
from wrenchsight.analyses.campaign.world_run import WorldOutcome
from wrenchsight.analyses.output.figures import COLOUR, Figure, new_figure
from wrenchsight.analyses.output.outputs import OutputFolder
from wrenchsight.analyses.study.experiment import with_unit
from wrenchsight.analyses.study.report import decimals_of_three_digits, number, page_templates

REPORT_NAME: Final = "campaign.html"
_MIN_DENSITY_WORLDS: Final = 8  # worlds; with fewer a density shows nothing, and each is a dot
_MAX_DRAWN_RATIO: Final = 12.0  # times the article's number; what lies beyond is drawn at the edge
_MIN_DENSITY_RANGE: Final = 1e-9  # of the median; a density of worlds that are equal fails
_PICTURE_WIDTH: Final = 960  # CSS pixels at which the page shows a figure, as the study's report


def write_campaign_report(
    folder: OutputFolder,
    record: CampaignRecord,
    spread: Sequence[Distribution],
    failures: Mapping[int, WorldOutcome],
    seconds: Mapping[str, float],
    version: str,
) -> None:
    """Writes campaign.html and its figures into `folder`.

    Args:
        record: its `described` states title, section and rows of each experiment.
        spread: the figures of the article over worlds, those of an experiment in their order.
        failures: outcomes of worlds in which experiments failed, by world; a failure is one line,
            which is shown, then where it happened.
        seconds: seconds of a processor, by experiment, in a world.
        version: version of the software.

    Raises:
        InputError: they cannot be written.
    """
    environment = page_templates()
    sections = []
    for name in dict.fromkeys(distribution.experiment for distribution in spread):
        of_experiment = [row for row in spread if row.experiment == name]
        picture, size = "", None  # path below the page, CSS pixels; none without a figure
        if any(_comparable(row) for row in of_experiment):
            figure = violin_figure(of_experiment)
            width, height = figure.get_size_inches()
            size = (_PICTURE_WIDTH, round(_PICTURE_WIDTH * height / width))
            picture = folder.write_figure(name, figure).relative_to(folder.path).as_posix()
        described = record.described[name]
        num_worlds = sum(experiment == name for _, experiment in record.measured)
        sections.append(
            {
                "name": name,
                "title": described["title"],
                "section": described["section"],
                "num_worlds": num_worlds,
                "rows": [table_row(row) for row in of_experiment],
                "picture": picture,
                "size": size,
            }
        )
    text = environment.get_template("campaign.html.j2").render(
        num_worlds=len(record.worlds),
        seed=record.settings["seed"],
        quick=record.settings["quick"],
        sections=sections,
        ranges=[(name, low, high) for name, (low, high) in record.settings["ranges"].items()],
        failures=[
            (world.number, world.seed, name, message.splitlines()[0])
            for _, world in sorted(failures.items())
            for name, message in world.failures.items()
        ],
        timings=", ".join(f"{name} {mean:.1f} s" for name, mean in seconds.items()),
        version=version,
    )
    folder.write_text(REPORT_NAME, text)


def table_row(distribution: Distribution) -> dict[str, str]:
    """A distribution as text, for the page and the command."""
    low, high = distribution.range
    digits = [
        value
        for value in (distribution.article, distribution.median, low, high)
        if value is not None
    ]
    decimals = decimals_of_three_digits(digits)
    holds = {None: "–", True: "yes", False: "no"}[distribution.holds_article]
    return {
        "label": distribution.label,
        "unit": distribution.unit,
        "article": "" if distribution.article is None else number(distribution.article),
        "source": distribution.source,
        "median": number(distribution.median, decimals),
        "range": f"{number(low, decimals)} to {number(high, decimals)}",
        "holds": holds,
        "ahead": ""
        if distribution.share_ahead is None
        else f"{100.0 * distribution.share_ahead:.0f} %",
        "moved_by": influences_text(distribution.moved_by),
    }


def violin_figure(spread: Sequence[Distribution]) -> Figure:
    """A violin for each figure that the article prints: the worlds' over the printed number.

    The first figure stands on top; one without a printed number, or with 0, is left out. The circle
    is the median. A violin has a bar from 5 to 95 % of the worlds; few worlds, or equal ones, are
    dots in its place. Ratios beyond _MAX_DRAWN_RATIO are set to it, also for bar and median.
    """
    shown = [row for row in spread if _comparable(row)]
    figure, ((axes,),) = new_figure(1, 1, height=0.9 + 0.34 * len(shown))  # inches
    colour = COLOUR["estimate"]
    for place, row in enumerate(reversed(shown)):  # place: the height on the panel
        assert row.article is not None
        ratio = np.clip(row.values.to_numpy() / row.article, -_MAX_DRAWN_RATIO, _MAX_DRAWN_RATIO)
        low, median, high = np.quantile(ratio, [LOW_QUANTILE, 0.5, HIGH_QUANTILE])
        if len(ratio) >= _MIN_DENSITY_WORLDS and np.ptp(ratio) > _MIN_DENSITY_RANGE * abs(median):
            (body,) = axes.violinplot(
                ratio, [place], orientation="horizontal", widths=0.85, showextrema=False
            )["bodies"]
            body.set_facecolor(colour)
            body.set_alpha(0.3)
            axes.plot([low, high], [place, place], color=colour, lw=4.0, solid_capstyle="butt")
        else:
            axes.plot(ratio, np.full(len(ratio), place), ".", color=colour, ms=5, alpha=0.6)
        axes.plot(median, place, "o", color=colour, mfc="white", ms=5)
    axes.axvline(1.0, color=COLOUR["article"], lw=1.5, zorder=0.5)
    labels = [with_unit(row.label, row.unit) for row in reversed(shown)]
    axes.set_yticks(range(len(shown)), labels=labels, fontsize=8)
    axes.set_ylim(-0.7, len(shown) - 0.3)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel("worlds' figure over the article's printed row")
    return figure


def _comparable(row: Distribution) -> bool:
    return row.article is not None and row.article != 0.0
