"""Axes that a person can read: plain ticks, limits that say what they cut, legends off the data."""

import math
from typing import Any, Literal

import numpy as np

# Multiples of a power of ten at which ticks may stand, from few to many.
_TICK_MULTIPLES = ((1.0,), (1.0, 3.0), (1.0, 2.0, 5.0), (1.0, 1.5, 2.0, 3.0, 5.0, 7.0))
_ENOUGH_TICKS, _MANY_TICKS = 4, 9


def log_ticks(low: float, high: float) -> list[float]:
    """Round numbers from `low` to `high`, both positive, for a logarithmic axis: four or more.

    Powers of ten where the range holds enough of them, else also multiples of them that are easily
    read, and in a narrow range the ticks of an even axis.
    """
    from matplotlib.ticker import MaxNLocator

    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    for steps in _TICK_MULTIPLES:
        every = [float(f"{step * 10.0**decade:.6g}") for decade in decades for step in steps]
        ticks = [tick for tick in every if low <= tick <= high]
        if len(ticks) >= _ENOUGH_TICKS:
            return ticks[:: math.ceil(len(ticks) / _MANY_TICKS)]
    even = MaxNLocator(nbins=6, steps=[1, 2, 5, 10]).tick_values(low, high)
    return [float(f"{tick:.6g}") for tick in even if low <= tick <= high]


def log_label(value: float) -> str:
    """A tick's number as people write it; a power of ten where it has many zeros."""
    if 1e-3 <= value < 1e4:
        return f"{value:g}"
    exponent = math.floor(math.log10(value) + 1e-9)
    factor = value / 10.0**exponent
    power = f"10$^{{{exponent}}}$"
    return power if abs(factor - 1.0) < 1e-9 else f"{factor:g}·{power}"


def log_scale(axes: Any, which: Literal["x", "y"]) -> None:
    """Makes one axis logarithmic, with ticks in plain numbers; called when all is drawn."""
    getattr(axes, f"set_{which}scale")("log")
    low, high = getattr(axes, f"get_{which}lim")()
    ticks = log_ticks(low, high)
    axis = getattr(axes, f"{which}axis")
    axis.set_ticks(ticks, labels=[log_label(tick) for tick in ticks])
    axis.set_minor_locator(_no_ticks())
    getattr(axes, f"set_{which}lim")(low, high)


def limit_y(axes: Any, low: float, high: float, unit: str = "") -> None:
    """Sets the range of y and writes on the panel what is drawn beyond it, and how far it goes.

    Called when all is drawn. Only what has a label of its own is named, and how far it goes is
    given to a tenth of the range or finer.

    Args:
        low, high: the range, in the unit of the axis.
    """
    axes.set_ylim(low, high)
    decimals = max(0, 1 - math.floor(math.log10(high - low)))
    beyond = []
    for artist in (*axes.lines, *axes.collections):
        label = str(artist.get_label())
        # A label that matplotlib made begins with an underscore.
        if label.startswith("_") or not _is_in_data_of_y(axes, artist):
            continue
        y = _heights(artist)
        if y.size == 0:
            continue
        outside = [float(y.min())] if y.min() < low else []
        outside += [float(y.max())] if y.max() > high else []
        if outside:
            values = " and ".join(f"{value:.{decimals}f}" for value in outside)
            beyond.append(f"{label} to {values} {unit}".rstrip())
    if beyond:
        text = "beyond the panel: " + "; ".join(beyond)
        axes.text(
            0.01, 0.98, text, transform=axes.transAxes, va="top", fontsize=7, zorder=10,
            bbox={"facecolor": "white", "alpha": 0.7, "lw": 0, "pad": 1.0},
        )  # fmt: skip


def legend_above(axes: Any, ncols: int = 1) -> None:
    """A panel's own legend at the right above it, beside its title: never over the data."""
    axes.legend(
        loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=ncols, borderpad=0.0, handlelength=1.2
    )


def _no_ticks() -> Any:
    from matplotlib.ticker import NullLocator

    return NullLocator()


def _is_in_data_of_y(axes: Any, artist: Any) -> bool:
    return bool(artist.get_transform().contains_branch_seperately(axes.transData)[1])


def _heights(artist: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    """The finite y that an artist is drawn at."""
    if hasattr(artist, "get_ydata"):
        y = np.asarray(artist.get_ydata(), dtype=np.float64)
    else:
        parts = [np.asarray(path.vertices)[:, 1] for path in artist.get_paths()]
        y = np.concatenate(parts) if parts else np.zeros(0)
    return y[np.isfinite(y)]
