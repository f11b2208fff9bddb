"""Errors of a force reading against a reference, and the calibration of its stated band.

Force along X, Y and Z of W, axis by axis: root mean square, largest, mean error (bias),
correlation, and calibration: the share of samples whose error lies inside the stated 68 % and 95 %
bands. A variant's figures are compared with those of another one as reductions in percent, positive
where the error falls.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from wrenchsight.analyses.output.figures import BAND_ALPHA, COLOUR, SERIES, legend_below, new_figure
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.rigid_body.spatial_vectors import AXES
from wrenchsight.models.signals.bands import SIGMA_68, SIGMA_95

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_MIN_REFERENCE_RANGE = 1e-9  # N, from which on a reference varies: below is rounding
_BAR_STEP, _BAR_HEIGHT = 0.27, 0.25  # of a row of bars: three with gaps, and room to the next row
_GOOD_SHARES = (0.90, 0.98)  # of samples in the 95 % band, shaded: near 95 %
FIGURE_COLUMNS = 1500  # of a figure: a longer signal is drawn as its extremes, column by column


@dataclass(frozen=True, eq=False)
class VariantReading:
    """Reading of one variant along one run.

    Attributes:
        name: name of the variant.
        t: (T,) s.
        force: (T, 3) N along X, Y, Z of W, on the robot.
        sd: (T, 3) N, stated.
        reference: (T, 3) N.
    """

    name: str
    t: Array
    force: Array
    sd: Array
    reference: Array

    @property
    def error(self) -> Array:
        """(T, 3) N, reading minus reference."""
        return np.asarray(self.force - self.reference)

    def part(self, rows: slice | NDArray[np.bool_]) -> "VariantReading":
        """Some of its rows."""
        return VariantReading(
            self.name,
            self.t[rows],
            self.force[rows],
            self.sd[rows],
            self.reference[rows],
        )

    def metrics(self) -> dict[str, Any]:
        """One number per axis and figure; correlation only where the reference varies."""
        return force_metrics(self.force, self.sd, self.reference)


def force_metrics(force: Array, sd: Array, reference: Array) -> dict[str, Any]:
    """Figures of a reading by axis: `rmse_y_n`, `share_in_95_band_y` and so on.

    Args:
        force: (T, 3) N, read.
        sd: (T, 3) N, stated for it.
        reference: (T, 3) N.

    Returns:
        Correlations only of axes along which reading and reference vary. Shares are 0 to 1;
        without an axis in their name, over all three together.
    """
    error = force - reference
    inside = {
        68: np.abs(error) <= SIGMA_68 * sd,
        95: np.abs(error) <= SIGMA_95 * sd,
    }
    out: dict[str, Any] = {}
    for k, axis in enumerate(AXES):
        out[f"rmse_{axis}_n"] = float(np.sqrt(np.mean(error[:, k] ** 2)))
        out[f"max_error_{axis}_n"] = float(np.abs(error[:, k]).max())
        out[f"bias_{axis}_n"] = float(error[:, k].mean())
        out[f"mean_sd_{axis}_n"] = float(sd[:, k].mean())
        if np.ptp(reference[:, k]) > _MIN_REFERENCE_RANGE and np.ptp(force[:, k]) > 0.0:
            out[f"correlation_{axis}"] = float(np.corrcoef(force[:, k], reference[:, k])[0, 1])
        for percent, mask in inside.items():
            out[f"share_in_{percent}_band_{axis}"] = float(mask[:, k].mean())
    for percent, mask in inside.items():
        out[f"share_in_{percent}_band"] = float(mask.mean())
    return out


def reductions(base: Mapping[str, Any], improved: Mapping[str, Any]) -> dict[str, float]:
    """Reduction of RMSE and of the largest error by axis, %, positive where the error falls.

    Args:
        base, improved: of `force_metrics`, without the improvement and with it.
    """
    out = {}
    for axis in AXES:
        for key, name in (("rmse", "rmse"), ("max_error", "max")):
            ratio = improved[f"{key}_{axis}_n"] / base[f"{key}_{axis}_n"]
            out[f"reduction_{name}_{axis}_pct"] = 100.0 * (1.0 - ratio)
    return out


def envelope(t: Array, x: Array) -> tuple[Array, Array, Array]:
    """Times, smallest and largest value of x (T,) in FIGURE_COLUMNS stretches of equal length."""
    if len(t) <= FIGURE_COLUMNS:
        return t, x, x
    edges = np.linspace(0, len(t), FIGURE_COLUMNS + 1).astype(int)[:-1]
    return t[edges], np.minimum.reduceat(x, edges), np.maximum.reduceat(x, edges)


def draw_signal(axis: Any, t: Array, x: Array, colour: str, label: str, **style: Any) -> None:
    """Draws a long signal as the area between its extremes, so that every peak shows."""
    times, low, high = envelope(t, x)
    axis.fill_between(times, low, high, color=colour, lw=0.6, label=label, **style)


def draw_band(axis: Any, reading: VariantReading, k: int, edges: bool = False) -> None:
    """Draws the stated 95 % band around the reference: where readings should lie.

    Args:
        edges: on top, too, for a noisy reading of a quiet reference, which fills the band.
    """
    times, _, sd = envelope(reading.t, reading.sd[:, k])
    _, low, high = envelope(reading.t, reading.reference[:, k])
    low, high = low - SIGMA_95 * sd, high + SIGMA_95 * sd
    label = "stated 95 % band"
    if edges:
        style = {"color": SERIES[3], "lw": 1.0, "zorder": 5}
        axis.plot(times, low, label=label, **style)
        axis.plot(times, high, **style)
    else:
        style = {"alpha": 2 * BAND_ALPHA, "lw": 0, "zorder": 0.9}
        axis.fill_between(times, low, high, color=SERIES[3], label=label, **style)


def variants_figure(metrics: Mapping[str, Any], labels: Mapping[str, str], title: str) -> "Figure":
    """One change per row: RMSE, largest error and share in the 95 % band of every variant.

    Args:
        metrics: holds `force_metrics` by variant; may hold more.
        labels: labels of the rows, by variant, from top to bottom.
    """
    count = len(labels)
    figure, axes = new_figure(1, 3, height=1.3 + 0.42 * count, share_y=True)
    rows = np.arange(count)
    metrics_of_variants = [metrics[variant] for variant in labels]
    columns = (
        ("rmse_{}_n", "RMSE [N]"),
        ("max_error_{}_n", "largest error [N]"),
        ("share_in_95_band_{}", "share inside the 95 % band"),
    )
    for panel, (key, label) in zip(axes[0], columns, strict=True):
        for k, axis in enumerate(AXES):
            values = [variant[key.format(axis)] for variant in metrics_of_variants]
            places = rows + _BAR_STEP * (k - 1)  # X, Y, Z around the row
            panel.barh(places, values, _BAR_HEIGHT, color=SERIES[k], label=f"f{axis}")
        panel.set_xlabel(label)
    axes[0, 2].axvspan(*_GOOD_SHARES, color=COLOUR["reference"], alpha=0.25, lw=0)
    axes[0, 2].set_xlim(0.0, 1.0)
    axes[0, 0].set_yticks(rows, list(labels.values()))
    axes[0, 0].invert_yaxis()
    legend_below(figure, axes[0, 0], ncols=3)
    figure.suptitle(title)
    return figure
