"""The article's figures over worlds: median, 5-95 % range, share of worlds in which ours leads."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Final

import pandas as pd

from wrenchsight.analyses.campaign.campaign_store import CampaignRecord
from wrenchsight.analyses.campaign.influences import Influence, influences
from wrenchsight.analyses.study.readme_table import FEWEST_WORLDS

LOW_QUANTILE: Final = 0.05  # quantile
HIGH_QUANTILE: Final = 0.95  # quantile
_GAIN: Final = "ours_against_article."  # metrics by how much ours is better than the article's
_REDUCTION: Final = "reduction_"  # in the keys of what the article claims most


@dataclass(frozen=True, eq=False)
class Distribution:
    """The distribution over worlds of one number in a row of "article / here"."""

    experiment: str
    key: str  # of the metric; a list has one distribution per entry (`rmse_nm.0`)
    label: str  # of the row, and for a list's entry of this one alone (`label_of_entry`)
    unit: str  # of the row
    article: float | None  # the printed number; None where there is none
    source: str  # who printed it
    values: "pd.Series[float]"  # (N,) by world, of those in which it is finite
    # share of worlds in which our method is ahead of the article's; None: no such row
    share_ahead: float | None
    # the drawn parameters that move it most; None: too few worlds, or no need to look, because the
    # article's number lies in the range and is no reduction
    moved_by: tuple[Influence, ...] | None = None

    @property
    def median(self) -> float:
        return float(self.values.median())

    @property
    def range(self) -> tuple[float, float]:
        """The 5 % and the 95 % point."""
        low, high = self.values.quantile([LOW_QUANTILE, HIGH_QUANTILE])
        return float(low), float(high)

    @property
    def holds_article(self) -> bool | None:
        """Whether the printed number lies in the range; None where there is none."""
        if self.article is None:
            return None
        low, high = self.range
        return low <= self.article <= high

    def metrics(self) -> dict[str, Any]:
        """As written to metrics.json."""
        low, high = self.range
        moved_by = {}
        if self.moved_by is not None:
            moved_by["moved_by"] = [asdict(influence) for influence in self.moved_by]
        return moved_by | {
            "article": self.article,
            "median": self.median,
            "p05": low,
            "p95": high,
            "share_of_worlds_ours_ahead": self.share_ahead,
            "worlds": len(self.values),
        }


def distributions(record: CampaignRecord, experiments: Sequence[str]) -> list[Distribution]:
    """Distributions of all rows of "article / here" of the experiments, in their order."""
    result = []
    for name in experiments:
        figures = record.figures(name)
        for row in record.described[name].get("comparison", []):
            result += _row_distributions(name, row, figures, record)
    return result


def _row_distributions(
    experiment: str,
    row: Mapping[str, Any],
    figures: pd.DataFrame,
    record: CampaignRecord,
) -> list[Distribution]:
    """The distributions of a row: one, or one for each entry of a list; none of what is not finite.

    Args:
        row: a `ComparisonRow` as a plain mapping. `key` names the article's method's figure, `ours`
            the one that is compared with it, if any (else it is empty); `article` is the printed
            number, None, or a list of one for each entry.
        figures: of `CampaignRecord.figures`: a row a world, a column a key; the entries of a list
            at `key` are `key.0`, `key.1` ...
        record: has the worlds' draws, among which those that move a number are searched.
    """
    article = row["article"]
    label = row["label"][:1].upper() + row["label"][1:]
    keys = _keys(figures, row["key"])  # place in the list, and the key there
    our_keys = dict(_keys(figures, row["ours"]))  # by place in the list
    result = []
    for place, key in keys:
        values = figures[key].dropna()
        if values.empty:
            continue
        distribution = Distribution(
            experiment=experiment,
            key=key,
            label=label if key == row["key"] else label_of_entry(label, place, len(keys)),
            unit=row["unit"],
            article=article[place] if isinstance(article, list) else article,
            source=row["source"],
            values=values,
            share_ahead=_share_ahead(figures, key, our_keys.get(place), row),
        )
        moved_by = _moved_by(distribution, record)
        result.append(replace(distribution, moved_by=moved_by))
    return result


def label_of_entry(label: str, place: int, count: int) -> str:
    """The label of one entry of a row that has a list.

    Labels of such rows enumerate their entries: "15, 30, 60 s", "joints 1 to 6" or "X Y Z". Of the
    enumeration the entry's own part is kept. A label without one ends with the place, from 1.

    Args:
        label: label of the row.
        place: place of the entry, from 0.
        count: count of the entries.
    """
    for pattern in (r"(?<![\w.])[\d.]+(?:, [\d.]+)+", r"\b(?:x y z|X Y Z)\b"):
        match = re.search(pattern, label)
        parts = re.split(", | ", match.group()) if match else []
        if match and len(parts) == count:
            return label[: match.start()] + parts[place] + label[match.end() :]
    joints = f"joints 1 to {count}"
    if joints in label:
        return label.replace(joints, f"joint {place + 1}")
    return f"{label} ({place + 1})"


def _moved_by(distribution: Distribution, record: CampaignRecord) -> tuple[Influence, ...] | None:
    values = distribution.values
    is_reduction = _REDUCTION in distribution.key
    needed = distribution.article is not None and (not distribution.holds_article or is_reduction)
    if not needed or len(values) < FEWEST_WORLDS:
        return None
    draws = record.draws().loc[values.index].drop(columns="seed")
    parameters = {str(name): draws[name].tolist() for name in draws}
    return influences(values.to_numpy(), parameters, distribution.article)


def distribution_metrics(spread: Sequence[Distribution]) -> dict[str, Any]:
    """Metrics by experiment and key, see `Distribution.metrics`."""
    metrics: dict[str, Any] = {}
    for distribution in spread:
        by_key = metrics.setdefault(distribution.experiment, {})
        by_key[distribution.key] = distribution.metrics()
    return metrics


def _keys(figures: pd.DataFrame, key: str) -> list[tuple[int, str]]:
    """Place and key of the number at a key, or of each number of a list at it.

    A single number has place 0; of a key that no column has, as an empty one, the list is empty.
    """
    if key in figures:
        return [(0, key)]
    entries = [re.fullmatch(rf"{re.escape(key)}\.(\d+)", name) for name in figures]
    return sorted((int(match.group(1)), match.group(0)) for match in entries if match)


def _share_ahead(
    figures: pd.DataFrame, key: str, ours: str | None, row: Mapping[str, Any]
) -> float | None:
    """The share of worlds in which ours is ahead, of those in which both figures are finite."""
    if key.startswith(_GAIN):
        gains = figures[key].dropna()
    elif ours is None:
        return None
    else:
        gains = (figures[ours] - figures[key]).dropna()
        gains = gains if row["more_is_better"] else -gains
    return None if gains.empty else float((gains > 0.0).mean())
