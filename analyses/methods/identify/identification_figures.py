"""Figures of an identification: measured and predicted torque of a log, joint by joint."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from wrenchsight.analyses.methods.identify.torque_fit import TorqueFit
from wrenchsight.analyses.output.figures import (
    BAND_ALPHA,
    COLOUR,
    Figure,
    legend_below,
    panels_in_pairs,
    set_joint_title,
)
from wrenchsight.models.numerics.arrays import Array

GAP_STEPS: Final = 2.5  # between samples, from which on no line joins them


def torque_figure(fit: TorqueFit, joint_names: Sequence[str], kind: str) -> Figure:
    """Measured and predicted torque with the residual and its mean ± 1 sd, one panel a joint.

    Args:
        kind: of the log, for the title, such as "validation".
    """
    n = fit.measured.shape[1]
    figure, panels = panels_in_pairs(n, "time [s]", "torque [N m]", share_x=True)
    t, measured, predicted, residual = _with_gaps(
        fit.t - fit.t[0], fit.measured, fit.predicted, fit.residual
    )
    for j, axis in enumerate(panels):
        axis.plot(t, measured[:, j], color=COLOUR["truth"], label="measured")
        axis.plot(t, predicted[:, j], color=COLOUR["estimate"], lw=1.0, label="predicted")
        axis.plot(t, residual[:, j], color=COLOUR["before"], lw=0.8, label="residual")
        mean, sd = float(fit.bias[j]), float(fit.residual_sd[j])
        axis.axhspan(
            mean - sd,
            mean + sd,
            color=COLOUR["before"],
            alpha=BAND_ALPHA,
            lw=0.0,
            label="its mean ± 1 sd",
        )
        figures = f"{fit.rmse[j]:.2f} N m ({100 * fit.relative[j]:.0f} %)"
        set_joint_title(axis, joint_names[j], figures)
    legend_below(figure, panels[0], ncols=4)
    figure.suptitle(f"{fit.name} ({kind}): RMSE, and its share of the torque's RMS")
    return figure


def _with_gaps(t: Array, *signals: Array) -> list[Array]:
    """t (T,) and signals (T, n) with a row of NaN where samples are left out, as at a stop."""
    steps = np.diff(t)
    gaps = np.flatnonzero(steps > GAP_STEPS * np.min(steps, initial=np.inf)) + 1
    return [np.insert(values, gaps, np.nan, axis=0) for values in (t, *signals)]
