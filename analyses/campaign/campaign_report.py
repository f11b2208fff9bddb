"""A campaign as one page: a table and violins for each experiment, the ranges, what failed."""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from wrenchsight.analyses.campaign.campaign_store import CampaignRecord
from wrenchsight.analyses.campaign.distributions import Distribution
from wrenchsight.analyses.campaign.influences import said
from wrenchsight.analyses.campaign.world_run import WorldOutcome
from wrenchsight.analyses.output.figures import COLOUR, Figure, new_figure
from wrenchsight.analyses.output.outputs import OutputFolder
from wrenchsight.analyses.study.report import decimals_of_three_digits, number, page_templates

REPORT_NAME: Final = "campaign.html"
_FEWEST: Final = 8  # worlds; with fewer a density says nothing, and each is a dot
_WIDEST: Final = 12.0  # times the article's number; what lies beyond is drawn at the edge


def write_campaign_report(
    folder: OutputFolder,
    record: CampaignRecord,
    found: Sequence[Distribution],
    failures: Mapping[int, WorldOutcome],
    seconds: Mapping[str, float],
    version: str,
) -> None:
    """Writes campaign.html and its figures into `folder`.

    Args:
        found: the figures of the article over worlds.
        failures: what failed, by world.
        seconds: of a processor, by experiment, in a world.
        version: of the software.

    Raises:
        InputError: they cannot be written.
    """
    environment = page_templates()
    sections = []
    for name in dict.fromkeys(one.experiment for one in found):
        own = [one for one in found if one.experiment == name]
        picture, size = "", None
        if any(_comparable(one) for one in own):
            figure = violin_figure(own)
            width, height = figure.get_size_inches()
            size = (960, round(960 * height / width))
            picture = folder.write_figure(name, figure).relative_to(folder.path).as_posix()
        described = record.described[name]
        worlds = sum(name in world.values for world in record.worlds.values())
        sections.append(
            {
                "name": name,
                "title": described["title"],
                "section": described["section"],
                "num_worlds": worlds,
                "rows": [table_row(one) for one in own],
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
            (world.number, world.seed, name, why.splitlines()[0])
            for _, world in sorted(failures.items())
            for name, why in world.failures.items()
        ],
        timings=", ".join(f"{name} {own:.1f} s" for name, own in seconds.items()),
        version=version,
    )
    folder.write_text(REPORT_NAME, text)


def table_row(one: Distribution) -> dict[str, str]:
    """A distribution as text: what the page and the command show."""
    low, high = one.range
    digits = [value for value in (one.article, one.median, low, high) if value is not None]
    decimals = decimals_of_three_digits(digits)
    holds = one.holds_article
    return {
        "label": one.label,
        "unit": one.unit,
        "article": "" if one.article is None else number(one.article),
        "source": one.source,
        "median": number(one.median, decimals),
        "range": f"{number(low, decimals)} to {number(high, decimals)}",
        "holds": "–" if holds is None else "yes" if holds else "no",
        "ahead": "" if one.ahead is None else f"{100.0 * one.ahead:.0f} %",
        "moved_by": said(one.moved_by),
    }


def violin_figure(found: Sequence[Distribution]) -> Figure:
    """A violin for each figure that the article prints: the worlds' over the printed number."""
    shown = [one for one in found if _comparable(one)]
    figure, ((axes,),) = new_figure(1, 1, height=0.9 + 0.34 * len(shown))
    for place, one in enumerate(reversed(shown)):
        assert one.article is not None
        ratio = np.clip(one.values / one.article, -_WIDEST, _WIDEST)
        low, median, high = np.percentile(ratio, [5.0, 50.0, 95.0])
        colour = COLOUR["estimate"]
        if len(ratio) >= _FEWEST and np.ptp(ratio) > 1e-9 * abs(median):
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
    labels = [f"{one.label} [{one.unit}]" if one.unit else one.label for one in reversed(shown)]
    axes.set_yticks(range(len(shown)), labels=labels, fontsize=8)
    axes.set_ylim(-0.7, len(shown) - 0.3)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel("worlds' figure over the article's printed one")
    return figure


def _comparable(one: Distribution) -> bool:
    return one.article is not None and one.article != 0.0
