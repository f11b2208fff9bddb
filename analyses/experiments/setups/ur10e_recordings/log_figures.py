"""The figure of experiments that judge many logs, laws or joints alike."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.analyses.output.figures import (
    COLOUR,
    Figure,
    draw_bars,
    legend_on_top,
    new_figure,
)
from wrenchsight.models.numerics.arrays import Array


def bar_rows(rows: Mapping[str, Mapping[str, ArrayLike]], names: Sequence[str]) -> Figure:
    """Bars side by side for each name; a panel "inside" (shares of a 95 % band) shades 90 to 98 %.

    Args:
        rows: by the label of a panel's y, heights (L,) of each series.
        names: names of the L groups.
    """
    figure, axes = new_figure(len(rows), 1, height=1.7 * len(rows) + 1.8, share_x=True)
    for panel, (label, series) in zip(axes[:, 0], rows.items(), strict=True):
        draw_bars(
            panel, {key: np.asarray(heights, float) for key, heights in series.items()}, names
        )
        panel.set_ylabel(label)
        if label.startswith("inside"):
            panel.axhspan(90.0, 98.0, color=COLOUR["truth"], alpha=0.12, lw=0, zorder=0)
    axes[-1, 0].tick_params(axis="x", labelrotation=90)
    legend_on_top(figure, axes[0, 0])
    return figure


def axes_of(values: ArrayLike) -> dict[str, Array]:
    """Series fx, fy and fz of values (L, 3)."""
    return dict(zip(("fx", "fy", "fz"), np.transpose(values), strict=True))
