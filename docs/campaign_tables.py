"""Writes the tables of docs/worlds.md from the worlds of campaigns.

    python docs/campaign_tables.py [FOLDER...]

A FOLDER is that of `wrenchsight campaign`, with `polishing` and `grinding` or with the experiments
of ARM. Its worlds replace those that are committed, docs/machining-worlds.parquet or
docs/arm-worlds.parquet. Each table goes between its two markers of docs/worlds.md; all else on the
page stays as it is. Without a FOLDER both are written anew from the committed worlds.
"""

import shutil
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import pandas as pd

from wrenchsight.analyses.campaign.campaign_report import table_row
from wrenchsight.analyses.campaign.campaign_store import TABLE_FILE, CampaignRecord, read_table
from wrenchsight.analyses.campaign.distributions import Distribution, distributions
from wrenchsight.analyses.experiments.setups.machining_runs.machining import FEED_TIMES, feed_key
from wrenchsight.analyses.study.readme_table import (
    TABLE_BEGIN,
    TABLE_END,
    replaced,
    text_of,
    with_table,
)
from wrenchsight.models.files.input_error import InputError

DOCS: Final = Path(__file__).resolve().parent
PAGE: Final = DOCS / "worlds.md"
ARM: Final = ("identification", "friction", "combined", "repeat-cycle")
MACHINING: Final = ("polishing", "grinding")
FEW_INSIDE: Final = 0.85  # share of readings inside the band, below which a world is named
REDUCTIONS: Final = {
    ("combined", "reduction_rmse_x_pct"): "`combined`, X",
    ("combined", "reduction_rmse_y_pct"): "`combined`, Y",
    ("friction", "reduction_rmse_z_pct"): "`friction`, Z",
    ("repeat-cycle", "reduction_rmse_y_pct"): "`repeat-cycle`, Y",
}
"""What the article claims most, by experiment and key: shown whether it agrees or not."""
NOT_PRINTED: Final = ("similarity_pct", "found_against_initial")
"""In the keys of rows beside which the article prints no number of the same quantity."""
_BANDS: Final = {
    "sensor in the loop: steady feed": "band_of_valid.steady",
    "no sensor: steady feed": "band_of_valid_without_sensor.steady",
    "no sensor: turns": "band_of_valid_without_sensor.turns",
}


def arm_table(record: CampaignRecord) -> str:
    """How much the article's figures vary over worlds, and which lie outside, in Markdown.

    Args:
        record: the worlds of the experiments of ARM.
    """
    rows = [
        row
        for row in distributions(record, ARM)
        if row.article is not None and not any(part in row.key for part in NOT_PRINTED)
    ]
    reductions = [row for row in rows if (row.experiment, row.key) in REDUCTIONS]
    outside = [row for row in rows if not row.holds_article]
    compared = [row for row in rows if row.share_ahead is not None and "rmse" in row.key]
    num_worlds = len(record.worlds)
    ahead = min(
        round(row.share_ahead * len(row.values)) for row in compared if row.share_ahead is not None
    )
    command = f"`wrenchsight campaign {' '.join(ARM)} --worlds {num_worlds}`"
    return "\n".join(
        [
            f"{num_worlds} worlds were drawn from the arms that agree ({command}). They "
            "show how much these figures vary:",
            "",
            *_arm_rows("reduction", reductions, lambda row: REDUCTIONS[row.experiment, row.key]),
            "",
            f"Of the article's {len(rows)} printed figures, {len(rows) - len(outside)} lie within "
            "the range of 5 to 95 % of the worlds. These lie outside:",
            "",
            *_arm_rows("figure", outside, lambda row: f"`{row.experiment}`: {row.label}"),
            "",
            "The RMSE of this program's method is smaller than that of the article's in X, Y and Z "
            "of `combined`, in Z of `friction` and in Y of `repeat-cycle`, each in "
            f"{'all' if ahead == num_worlds else f'at least {ahead} of the {num_worlds}'} worlds.",
        ]
    )


def _arm_rows(
    head: str, rows: Sequence[Distribution], label: Callable[[Distribution], str]
) -> list[str]:
    """A table of figures of the article, line by line."""
    lines = [f"| {head} | article | worlds, median (5 to 95 %) |", "|---|---:|---:|"]
    for row in rows:
        text = table_row(row)
        unit = f" [{row.unit}]" if row.unit else ""
        spread = f"{text['median']} ({text['range']})"
        lines.append(f"| {label(row)}{unit} | {text['article']} | {spread} |")
    return lines


class MachiningRow(NamedTuple):
    """A row of the table of machining.

    Attributes:
        label: what it shows.
        key: of the metrics; `{k}` and `{feed}` stand for the feed's number and its `feed_key`.
        percent: whether the figure is a share, shown in per cent.
        names: whether the worlds are named whose share is below FEW_INSIDE.
    """

    label: str
    key: str
    percent: bool = True
    names: bool = False


def machining_rows() -> list[MachiningRow]:
    """The rows that show a figure's median and range over the worlds."""
    rows = [
        MachiningRow("RMSE, the article's method [N]", "article.rmse_n.{k}", percent=False),
        MachiningRow("RMSE, ours [N]", "ours.rmse_n.{k}", percent=False),
        MachiningRow(
            "True normal force held without a sensor, RMS error [N]",
            "regulation.estimate.rms_n.{k}",
            percent=False,
        ),
        MachiningRow(
            "The same, most above the set-point since the touch [N]",
            "{feed}.regulation.estimate.overshoot_n",
            percent=False,
        ),
        MachiningRow(
            "The same, least force from the first motion of the feed on [N]",
            "{feed}.regulation.estimate.least_n",
            percent=False,
        ),
        MachiningRow(
            "The same, largest error from then on [N]",
            "{feed}.regulation.estimate.max_error_n",
            percent=False,
        ),
    ]
    rows += [
        MachiningRow(f"Inside the band, valid readings, {words} [%]", f"{key}.{{k}}", names=True)
        for words, key in _BANDS.items()
    ]
    rows += [
        MachiningRow(f"Valid, no sensor: {words} [%]", f"{{feed}}.valid_share.estimate.{part}")
        for words, part in (("steady feed", "steady"), ("turns", "turns"))
    ]
    return rows


def machining_table(record: CampaignRecord) -> str:
    """Median and range of the figures of machining, by task and feed, in Markdown.

    Args:
        record: the worlds of `polishing` and `grinding` at all feeds.
    """
    heads = " | ".join(f"`{task}` {feed:g} s" for task in MACHINING for feed in FEED_TIMES)
    lines = [f"| | key | {heads} |", "|---|---|" + "---:|" * (len(MACHINING) * len(FEED_TIMES))]
    for row in machining_rows():
        shown = row.key.removesuffix(".{k}").format(feed=feed_key(FEED_TIMES[0]))
        cells = [
            range_of(figures(record, task, row.key.format(k=k, feed=feed_key(feed))), row)
            for task in MACHINING
            for k, feed in enumerate(FEED_TIMES)
        ]
        lines.append(f"| {row.label} | `{shown}` | {' | '.join(cells)} |")
    ahead = [ours_ahead(record, task, k) for task in MACHINING for k in range(len(FEED_TIMES))]
    lines.insert(4, f"| ours ahead in | `share_of_worlds_ours_ahead` | {' | '.join(ahead)} |")
    return "\n".join(lines)


def figures(record: CampaignRecord, task: str, key: str) -> "pd.Series[float]":
    """The figures of a key by world; those that are not finite are left out."""
    of_worlds = record.figures(task)
    return of_worlds[key].dropna() if key in of_worlds else pd.Series(dtype=float)


def range_of(of_worlds: "pd.Series[float]", row: MachiningRow) -> str:
    """Median and range of 5 to 95 % of a figure; and the worlds with few readings inside."""
    if of_worlds.empty:
        return "none"
    decimals, scale = (0, 100.0) if row.percent else (1, 1.0)
    quantiles = (scale * of_worlds).quantile([0.05, 0.5, 0.95])
    low, middle, high = (f"{x:.{decimals}f}" for x in quantiles)
    text = f"{middle} ({low} to {high})"
    few = of_worlds[of_worlds < FEW_INSIDE].sort_index()
    if row.names and not few.empty:
        each = ", ".join(f"{100.0 * value:.0f} in world {world}" for world, value in few.items())
        text += f"; {each}"
    return text


def ours_ahead(record: CampaignRecord, task: str, k: int) -> str:
    """In how many worlds our RMSE is smaller than the article's method's."""
    ours, article = (figures(record, task, f"{name}.rmse_n.{k}") for name in ("ours", "article"))
    return f"{(ours < article.reindex(ours.index)).sum()} of {len(ours)}"


TABLES: Final[dict[str, tuple[tuple[str, ...], Callable[[CampaignRecord], str]]]] = {
    "arm": (ARM, arm_table),
    "machining": (MACHINING, machining_table),
}
"""By name, the experiments that a table shows, and what writes it."""


def committed(name: str) -> Path:
    """The worlds of a table."""
    return DOCS / f"{name}-worlds.parquet"


def table_of(record: CampaignRecord, folder: Path) -> str:
    """The name of the table that shows the experiments of a campaign.

    Raises:
        InputError: no table shows them, or a world lacks one of them.
    """
    for name, (experiments, _) in TABLES.items():
        if not any(record.missing(number, experiments) for number in record.worlds):
            return name
    wanted = " or ".join(" ".join(experiments) for experiments, _ in TABLES.values())
    problem = f"expected a campaign in which every world has {wanted}"
    raise InputError(folder, "", problem, "run `wrenchsight campaign` with these experiments")


def read_worlds(path: Path) -> CampaignRecord:
    """The worlds of a campaign's file.

    Raises:
        InputError: it is not there, or is no campaign's.
    """
    record = read_table(path)
    if record is None:
        raise InputError(path, "", "does not exist", "name the folder of a campaign")
    return record


def run(folders: Sequence[Path]) -> None:
    """Takes the worlds of campaigns, and writes the page; if one is refused, nothing changes.

    Raises:
        InputError: a folder has no campaign that a table shows; the page lacks a marker.
    """
    sources = {name: committed(name) for name in TABLES}
    for folder in folders:
        sources[table_of(read_worlds(folder / TABLE_FILE), folder)] = folder / TABLE_FILE
    page = text_of(PAGE)
    for name, (_, table) in TABLES.items():
        markers = TABLE_BEGIN.format(name), TABLE_END.format(name)
        page = with_table(PAGE, page, table(read_worlds(sources[name])) + "\n", markers)
    for name, source in sources.items():
        if source != committed(name):
            shutil.copyfile(source, committed(name))
    replaced(PAGE, page)


def main(arguments: Sequence[str]) -> int:
    """The command."""
    try:
        run([Path(argument) for argument in arguments])
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
