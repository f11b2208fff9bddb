"""Figures of one style: readable at the width of the report, colour-blind safe, the same each time.

A colour means the same thing in every figure (`COLOUR`); what is not one of these meanings, such as
the joints of an arm or several methods side by side, takes its colours from `SERIES` in order.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.files.whole_file import whole_file, writing_to
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.numerics.stretches import stretches

if TYPE_CHECKING:
    import matplotlib.figure

Figure: TypeAlias = "matplotlib.figure.Figure"  # matplotlib is imported where something is drawn
Meaning = Literal[
    "truth", "estimate", "reference", "article", "before", "after", "invalid", "contact", "onset"
]

# Okabe and Ito's palette, which stays apart in all common colour deficiencies and in print.
COLOUR: Final[dict[Meaning, str]] = {
    "truth": "#1a1a1a",
    "estimate": "#0072b2",
    "reference": "#6b6b6b",
    "article": "#e69f00",
    "before": "#d55e00",
    "after": "#009e73",
    "invalid": "#f3d9d9",  # a background
    "contact": "#cfe8d5",  # likewise
    "onset": "#cc79a7",
}
SERIES: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#1a1a1a")
BAND_ALPHA: Final = 0.2  # of an uncertainty band in the colour of its estimate

FIGURE_WIDTH: Final = 8.0  # inches; the report shows it 960 CSS pixels wide
ROW_HEIGHT: Final = 2.6  # inches
DOTS_PER_INCH: Final = 170
TITLE_LETTERS: Final = 40  # that a panel of half the figure's width has room for, in bold

_STYLE: Final[dict[Any, Any]] = {  # Any: matplotlib types the keys as one Literal of 330
    "axes.axisbelow": True,
    "axes.edgecolor": "#4d4d4d",
    "axes.grid": True,
    "axes.labelcolor": "#1a1a1a",
    "axes.labelsize": 9.5,
    "axes.linewidth": 0.8,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlelocation": "left",
    "axes.titlesize": 10,
    "axes.titleweight": "bold",
    "axes.unicode_minus": True,
    "axes.xmargin": 0.01,
    "figure.facecolor": "white",
    "figure.titlesize": 10.5,
    "figure.titleweight": "bold",
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],  # comes with matplotlib: the same on every machine
    "font.size": 9.5,
    "grid.color": "#e3e3e3",
    "grid.linewidth": 0.7,
    "legend.borderpad": 0.3,
    "legend.fontsize": 8.5,
    "legend.frameon": True,
    "legend.framealpha": 0.85,
    "legend.edgecolor": "none",
    "lines.linewidth": 1.3,
    "lines.markersize": 4,
    "path.simplify": True,
    "path.simplify_threshold": 0.5,  # a log has more samples than the picture has columns
    "agg.path.chunksize": 20_000,
    "savefig.facecolor": "white",
    "xtick.color": "#4d4d4d",
    "xtick.labelsize": 8.5,
    "ytick.color": "#4d4d4d",
    "ytick.labelsize": 8.5,
}


def new_figure(
    rows: int = 1,
    cols: int = 1,
    *,
    height: float | None = None,
    width: float = FIGURE_WIDTH,
    share_x: bool = False,
    share_y: bool = False,
) -> "tuple[Figure, NDArray[np.object_]]":
    """Returns an empty figure in the house style and its axes.

    The figure belongs to no window system and to no global list: it is freed like any object.

    Args:
        rows: panels from top to bottom.
        cols: panels from left to right.
        height: height of the whole figure, inches; by default `ROW_HEIGHT` a row.
        width: width of the whole figure, inches.
        share_x: whether all panels have one range of x (labels at the bottom only).
        share_y: whether all panels have one range of y (labels at the left only).

    Returns:
        The figure, and its axes as an array of shape (rows, cols), also when it is a single one.
    """
    import matplotlib as mpl
    from cycler import cycler
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure as NewFigure

    # Lines, texts and legends read the style when they are made, after this function has returned.
    mpl.rcParams.update(_STYLE)
    mpl.rcParams["axes.prop_cycle"] = cycler(color=SERIES)
    figure = NewFigure(
        figsize=(width, height if height is not None else ROW_HEIGHT * rows), layout="constrained"
    )
    FigureCanvasAgg(figure)
    axes = figure.subplots(rows, cols, sharex=share_x, sharey=share_y, squeeze=False)
    return figure, np.asarray(axes, dtype=np.object_)


def panels_in_pairs(
    count: int, xlabel: str, ylabel: str, share_x: bool = False
) -> "tuple[Figure, list[Any]]":
    """A figure of `count` panels, two a row, of one kind: such as one a joint.

    Returns:
        The figure and its panels, (count,) axes.
    """
    rows = (count + 1) // 2
    figure, axes = new_figure(rows, 2, height=2.1 * rows + 0.6, share_x=share_x)
    panels: list[Any] = list(axes.flat)
    for k, axis in enumerate(panels[:count]):
        axis.set_ylabel(ylabel)
        if k >= count - 2:
            axis.set_xlabel(xlabel)
            axis.tick_params(labelbottom=True)
    for axis in panels[count:]:
        axis.set_visible(False)
    return figure, panels[:count]


def set_joint_title(panel: Any, joint: str, figures: str) -> None:
    """The title "joint: figures" of a panel of `panels_in_pairs`, on two lines where it is long."""
    separator = " " if len(joint) + len(figures) <= TITLE_LETTERS else "\n"
    panel.set_title(f"{joint}:{separator}{figures}")


def legend_below(figure: "Figure", *panels: Any, ncols: int | None = None, **style: Any) -> None:
    """One legend below all panels, with the entries of these: no wider than the figure, and of at
    most `ncols` columns.
    """
    _outside_legend(figure, "outside lower center", panels, ncols, style)


def legend_on_top(figure: "Figure", *panels: Any, ncols: int | None = None) -> None:
    """The same above all panels."""
    _outside_legend(figure, "outside upper center", panels, ncols, {})


def _outside_legend(
    figure: "Figure",
    place: Literal["outside lower center", "outside upper center"],
    panels: Sequence[Any],
    most_columns: int | None,
    style: Mapping[str, Any],
) -> None:
    """A legend of as many columns as the figure is wide for: names of joints may be long."""
    entries = [panel.get_legend_handles_labels() for panel in panels]
    handles, labels = ([one for entry in entries for one in entry[k]] for k in range(2))
    for columns in range(most_columns or len(labels), 0, -1):
        legend = figure.legend(handles, labels, loc=place, ncols=columns, **style)
        if columns == 1 or legend.get_window_extent().width <= figure.bbox.width:
            return
        legend.remove()


def draw_bars(panel: Any, series: Mapping[str, Any], names: Sequence[Any]) -> None:
    """Bars side by side, a group for each of `names`.

    Args:
        panel: to draw in.
        series: heights (N,) of one colour's bars, by label.
        names: names of the N groups.
    """
    places, each = np.arange(len(names)), 0.8 / len(series)
    for k, (label, values) in enumerate(series.items()):
        at = places + each * (k - 0.5 * (len(series) - 1))
        panel.bar(at, values, each, color=SERIES[k % len(SERIES)], label=label)
    panel.set_xticks(places, names)


def shade(panel: Any, t: Array, flag: Flags, meaning: Meaning, label: str) -> list[float]:
    """Marks the stretches of time in which a flag is set, from half a sample before to half after.

    Args:
        panel: to draw in.
        t: (T,) s.
        flag: (T,).
        meaning: of the background's colour.
        label: in the legend, once.

    Returns:
        Where each stretch begins, s.
    """
    half = 0.5 * float(np.median(np.diff(t))) if len(t) > 1 else 0.5
    begins: list[float] = []
    for stretch in stretches(flag):
        begin, end = float(t[stretch.start]) - half, float(t[stretch.stop - 1]) + half
        label_once = None if begins else label
        panel.axvspan(begin, end, color=COLOUR[meaning], lw=0, zorder=0, label=label_once)
        begins.append(begin)
    return begins


def fill_band(panel: Any, t: Any, x: Any, half_width: Any, label: str = "95 % band") -> None:
    """The band of an estimate x (N,), `half_width` (N,) to either side."""
    style = {"color": COLOUR["estimate"], "alpha": BAND_ALPHA, "lw": 0}
    panel.fill_between(t, x - half_width, x + half_width, label=label, **style)


def save_figure(figure: "Figure", path: Path) -> Path:
    """Writes the figure as a PNG, whole or not at all, with the same bytes for the same figure.

    Returns:
        The path written.

    Raises:
        InputError: the file cannot be written.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    with writing_to(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as partial, writing_to(path):
        # Without "Software" the file shows nothing of when or with what it was made. Not `savefig`,
        # which draws everything once more before, for the layout.
        figure.dpi = DOTS_PER_INCH
        canvas: Any = FigureCanvasAgg(figure)
        canvas.print_png(partial, metadata={"Software": None})
    figure.clear()
    return path
