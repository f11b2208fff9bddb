"""Figures of a payload's force: read, over a singular pass, and method by method."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from wrenchsight.analyses.experiments.setups.ur10e_recordings.known_payload import (
    MASS,
    METHODS,
    TIME_STEP,
    Reading,
    Reference,
)
from wrenchsight.analyses.output.axes import limit_y, log_scale
from wrenchsight.analyses.output.figures import (
    COLOUR,
    SERIES,
    Figure,
    fill_band,
    legend_on_top,
    new_figure,
)
from wrenchsight.models.arrays import Array, Flags
from wrenchsight.models.rigid_body.spatial_vectors import AXES
from wrenchsight.models.signals.bands import SIGMA_95

LABELS = {
    "bayesian": "Bayesian",
    "bayesian_live_prior": "Bayesian,\nlive prior",
    "force_only": "force only",
    "inverse": "inverse\n(eq. 22)",
    "damped": "damped\n(0.2)",
    "truncated": "truncated\n(0.05)",
    "truncated_1e_5": "truncated\n(1e-5)",
}


def force_figure(t: Array, reading: Reading, reference: Reference) -> Figure:
    """The three components of the force with their 95 % band, and the truth."""
    figure, axes = new_figure(3, 1, height=7.4, share_x=True)
    panels: list[Any] = list(axes[:, 0])
    everything = slice(None)
    for i, axis in enumerate(panels):
        _shade(axis, t, ~reading.valid, "flagged invalid")
        _draw_reading(axis, t, reading, i, everything)
        axis.plot(t, reference.force[:, i], color=COLOUR["truth"], lw=1.4, label="payload (truth)")
        axis.set_ylabel(f"force {AXES[i]} [N]")
    panels[-1].set_xlabel("time [s]")
    legend_on_top(figure, panels[0])
    return figure


def singular_figure(t: Array, reading: Reading, inverse: Reading, reference: Reference) -> Figure:
    """Three seconds around a singular pass; eq. 22 leaves the picture there."""
    rows = _singular_pass(inverse)
    figure, axes = new_figure(4, 1, height=8.6, share_x=True)
    panels: list[Any] = list(axes[:, 0])
    for i, axis in enumerate(panels[:3]):
        _shade(axis, t[rows], ~inverse.valid[rows], "eq. 22 flagged invalid")
        _draw_reading(axis, t, reading, i, rows)
        axis.plot(t[rows], inverse.force[rows, i], color=COLOUR["before"], lw=1.1, label="eq. 22")
        axis.plot(t[rows], reference.force[rows, i], color=COLOUR["truth"], label="payload (truth)")
        limit_y(axis, -120.0, 120.0, "N")
        axis.set_ylabel(f"force {AXES[i]} [N]")
    panels[3].plot(t[rows], inverse.condition_number[rows], color=COLOUR["reference"])
    log_scale(panels[3], "y")
    panels[3].set_ylabel("condition number")
    panels[3].set_xlabel("time [s]")
    legend_on_top(figure, panels[0])
    return figure


def _singular_pass(inverse: Reading) -> slice:
    """Rows around a sample where eq. 22 reads more than 300 N, chosen so that as many as possible
    of the others are valid: there both sides of the flag can be seen.
    """
    half = round(1.5 / TIME_STEP)
    size = np.linalg.norm(inverse.force, axis=1)
    inside = np.arange(half, len(size) - half)
    wild = inside[size[inside] > 300.0]
    centres = wild if len(wild) else inside[[np.argmax(size[inside])]]
    shares = [inverse.valid[c - half : c + half].mean() for c in centres]
    centre = int(centres[int(np.argmax(shares))])
    return slice(centre - half, centre + half + 1)


def _shade(axis: Any, t: Array, where: Flags, label: str) -> None:
    whole = axis.get_xaxis_transform()
    style = {"step": "mid", "color": COLOUR["invalid"], "lw": 0, "zorder": 0, "transform": whole}
    axis.fill_between(t, 0, 1, where=where, label=label, **style)


def _draw_reading(axis: Any, t: Array, reading: Reading, i: int, rows: slice) -> None:
    force, deviation = reading.force[rows, i], SIGMA_95 * reading.deviation[rows, i]
    fill_band(axis, t[rows], force, deviation, "Bayesian, 95 % band")
    axis.plot(t[rows], force, color=COLOUR["estimate"], lw=1.1, label="Bayesian")


def methods_figure(metrics: dict[str, Any]) -> Figure:
    """Errors per axis and the mass, over all samples and over valid ones, for every method."""
    figure, axes = new_figure(2, 1, height=6.6, share_x=True)
    panels: list[Any] = list(axes[:, 0])
    top, bottom = panels
    places = np.arange(len(METHODS))
    valid = {"color": COLOUR["truth"], "markerfacecolor": "white", "ls": "none", "marker": "o"}
    for i, axis in enumerate(AXES):
        key, at = f"rmse_f{axis}_n", places + 0.25 * (i - 1)
        top.bar(at, [metrics[m][key] for m in METHODS], 0.23, color=SERIES[i], label=f"f{axis}")
        selected = _or_nan(metrics[m]["valid"][key] for m in METHODS)
        top.plot(at, selected, **valid, label="valid samples only" if i == 0 else None)
    top.set_yscale("log")
    top.set_ylim(bottom=2.0)
    log_scale(top, "y")
    top.set_ylabel("force RMSE [N]")
    masses = [metrics[m]["mass_kg"] for m in METHODS]
    bottom.bar(places, np.clip(masses, 0.0, 4.0), 0.6, color=COLOUR["reference"])
    for place, mass in zip(places, masses, strict=True):
        bottom.annotate(f"{mass:.2f}", (place, 0.1), ha="center", color="white", weight="bold")
    bottom.plot(places, _or_nan(metrics[m]["valid"]["mass_kg"] for m in METHODS), **valid)
    bottom.axhline(MASS, color=COLOUR["truth"], lw=1.2, ls="--", label=f"true mass, {MASS} kg")
    bottom.set_ylim(0.0, 3.5)
    bottom.set_ylabel("mass read [kg]")
    bottom.set_xticks(places, [LABELS[m] for m in METHODS])
    legend_on_top(figure, top, bottom, ncols=5)
    return figure


def _or_nan(values: Iterable[float | None]) -> list[float]:
    return [float("nan") if value is None else value for value in values]
