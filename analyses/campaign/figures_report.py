"""Figures of a fit to printed figures: parameters that agree, and each row over the arms."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from wrenchsight.analyses.output.figures import COLOUR, Figure, new_figure
from wrenchsight.models.numerics.arrays import Array, Flags

if TYPE_CHECKING:
    from wrenchsight.analyses.campaign.figures_fit import FittedRow

_COLUMNS = 4
_BINS = 14


def parameters_figure(
    ranges: Mapping[str, tuple[float, float]], parameters: Array, best: Array, arms: Array
) -> Figure:
    """Each parameter: what was drawn, what agrees, and the nearest arm.

    Args:
        ranges: from where to where each of the P parameters was drawn.
        parameters: (N, P) of all arms.
        best: (P,) of the nearest.
        arms: (A, P) that agree, equally likely.
    """
    rows = -(-len(ranges) // _COLUMNS)
    figure, axes = new_figure(rows, _COLUMNS, height=0.6 + 1.55 * rows)
    panels: list[Any] = list(axes.flat)
    for panel in panels[len(ranges) :]:
        panel.set_visible(False)
    for k, (panel, (name, (low, high))) in enumerate(zip(panels, ranges.items(), strict=False)):
        bins = np.linspace(low, high, _BINS + 1)
        style = {"bins": bins.tolist(), "density": True}
        panel.hist(parameters[:, k], color=COLOUR["reference"], alpha=0.35, label="drawn", **style)
        panel.hist(arms[:, k], color=COLOUR["estimate"], alpha=0.6, label="agrees", **style)
        panel.axvline(best[k], color=COLOUR["after"], label="nearest arm")
        panel.set_title(name.replace("_", " "), fontsize=8.5)
        panel.set_yticks([])
        panel.set_xlim(low, high)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    figure.suptitle("Arms that give the printed figures, over all that were drawn")
    return figure


def rows_figure(rows: "Sequence[FittedRow]", settles: Flags) -> Figure:
    """Each row over its printed figure: 5 to 95 % of the arms that agree, and the nearest."""
    figure, ((axes,),) = new_figure(1, 1, height=1.0 + 0.21 * len(rows))
    for k, row in enumerate(reversed(rows)):
        scale = 1.0 / row.printed if row.printed else 1.0
        colour = COLOUR["estimate"] if settles[len(rows) - 1 - k] else COLOUR["before"]
        axes.plot([row.p05 * scale, row.p95 * scale], [k, k], color=colour, lw=4.0, alpha=0.45)
        axes.plot(row.median * scale, k, "o", color=colour, mfc="white", ms=4)
        axes.plot(row.best * scale, k, "x", color=COLOUR["after"], ms=5)
    axes.axvline(1.0, color=COLOUR["article"], lw=1.5, zorder=0.5)
    names = [row.name.replace("_", " ") for row in reversed(rows)]
    axes.set_yticks(range(len(rows)), labels=names, fontsize=7)
    axes.set_ylim(-0.7, len(rows) - 0.3)
    axes.set_xlim(-0.5, 3.0)
    axes.set_xlabel(
        "over the printed figure: bar 5 to 95 %, ring median (orange: held out), cross nearest arm"
    )
    return figure
