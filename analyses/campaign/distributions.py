"""The figures of the article over worlds: median, 5-95 % range, how often our method is ahead."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Final

import numpy as np

from wrenchsight.analyses.campaign.campaign_store import CampaignRecord
from wrenchsight.analyses.campaign.influences import Influence, influences
from wrenchsight.analyses.study.readme_table import FEWEST_WORLDS
from wrenchsight.models.numerics.arrays import Array

LOW: Final = 5.0  # percentile
HIGH: Final = 95.0  # percentile
_GAIN: Final = "ours_against_article."  # metrics by how much ours is better than the article's
_REDUCTION: Final = "reduction_"  # in the keys of what the article claims most


@dataclass(frozen=True, eq=False)
class Distribution:
    """One number of a row of "article / here" over worlds."""

    experiment: str
    key: str  # of the metric; a list has one distribution per entry (`rmse_nm.0`)
    label: str  # of the row; the label of a list's entry ends with its place, from 1
    unit: str  # of the row
    article: float | None  # the printed number; None where there is none
    source: str  # who printed it
    values: Array  # (N,) of the worlds in which it is finite
    # share of worlds in which our method is ahead of the article's; None: no such row
    ahead: float | None
    # the drawn parameters that move it most; None: too few worlds, or nobody asks, as the article's
    # number lies in the range and is no reduction
    moved_by: tuple[Influence, ...] | None = None

    @property
    def median(self) -> float:
        return float(np.median(self.values))

    @property
    def range(self) -> tuple[float, float]:
        """The 5 % and the 95 % point."""
        low, high = np.percentile(self.values, [LOW, HIGH])
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
        asked = {} if self.moved_by is None else {"moved_by": list(map(asdict, self.moved_by))}
        return asked | {
            "article": self.article,
            "median": self.median,
            "p05": low,
            "p95": high,
            "share_of_worlds_ours_ahead": self.ahead,
            "worlds": len(self.values),
        }


def distributions(record: CampaignRecord, experiments: Sequence[str]) -> list[Distribution]:
    """Those of all rows of "article / here" of the experiments, in their order."""
    found = []
    for name in experiments:
        figures = record.figures(name)
        for row in record.described[name].get("comparison", []):
            stated = row["article"]
            ours = dict(_keys(figures, row["ours"]))
            for place, key in _keys(figures, row["key"]):
                values = _finite(figures[key])
                if len(values):
                    entry = stated[place] if isinstance(stated, list) else stated
                    label = row["label"][:1].upper() + row["label"][1:]
                    one = Distribution(
                        experiment=name,
                        key=key,
                        label=label if key == row["key"] else f"{label} ({place + 1})",
                        unit=row["unit"],
                        article=entry,
                        source=row["source"],
                        values=values,
                        ahead=_share_ahead(figures, key, ours.get(place), row),
                    )
                    found.append(replace(one, moved_by=_moved_by(one, figures[key], record)))
    return found


def _moved_by(
    one: Distribution, figures: Mapping[int, float | None], record: CampaignRecord
) -> tuple[Influence, ...] | None:
    asked = one.article is not None and (not one.holds_article or _REDUCTION in one.key)
    worlds = [number for number, value in figures.items() if value is not None]
    if not asked or len(worlds) < FEWEST_WORLDS:
        return None
    drawn = [record.worlds[number].parameters for number in worlds]
    parameters = {name: [own[name] for own in drawn] for name in drawn[0]}
    return influences(one.values, parameters, one.article)


def distribution_metrics(found: Sequence[Distribution]) -> dict[str, Any]:
    """By experiment and key, see `Distribution.metrics`."""
    metrics: dict[str, Any] = {}
    for one in found:
        metrics.setdefault(one.experiment, {})[one.key] = one.metrics()
    return metrics


def _keys(figures: Mapping[str, Any], key: str) -> list[tuple[int, str]]:
    """The number at a key, or the numbers of the list that is there."""
    if key in figures:
        return [(0, key)]
    entries = [re.fullmatch(rf"{re.escape(key)}\.(\d+)", name) for name in figures]
    return sorted((int(match.group(1)), match.group(0)) for match in entries if match)


def _share_ahead(
    figures: Mapping[str, Mapping[int, float | None]],
    key: str,
    ours: str | None,
    row: Mapping[str, Any],
) -> float | None:
    """The share of worlds in which ours is ahead, of those in which both figures are finite."""
    if key.startswith(_GAIN):
        return float(np.mean(_finite(figures[key]) > 0.0))
    if ours is None:
        return None
    sign = 1.0 if row["more_is_better"] else -1.0
    pairs = [(figures[ours].get(world), value) for world, value in figures[key].items()]
    gains = [sign * (own - other) for own, other in pairs if own is not None and other is not None]
    return float(np.mean(np.array(gains) > 0.0)) if gains else None


def _finite(values: Mapping[int, float | None]) -> Array:
    return np.array([value for value in values.values() if value is not None], dtype=np.float64)
