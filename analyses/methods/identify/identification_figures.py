"""Figures of an identification: measured and predicted torque of a log, joint by joint."""

from collections.abc import Sequence
from typing import Final

from wrenchsight.analyses.methods.identify.torque_fit import TorqueFit
from wrenchsight.analyses.output.figures import (
    BAND_ALPHA,
    COLOUR,
    Figure,
    legend_below,
    panels_in_pairs,
)

TITLE_LETTERS: Final = 40  # that a panel of half the figure's width has room for


def torque_figure(fit: TorqueFit, joint_names: Sequence[str], kind: str) -> Figure:
    """Measured and predicted torque with the residual and its mean ± 1 sd, one panel a joint."""
    n = fit.measured.shape[1]
    figure, panels = panels_in_pairs(n, "time [s]", "torque [N m]", share_x=True)
    t = fit.t - fit.t[0]
    for j, axis in enumerate(panels):
        axis.plot(t, fit.measured[:, j], color=COLOUR["truth"], label="measured")
        axis.plot(t, fit.predicted[:, j], color=COLOUR["estimate"], lw=1.0, label="predicted")
        axis.plot(t, fit.residual[:, j], color=COLOUR["before"], lw=0.8, label="residual")
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
        one_line = len(joint_names[j]) + len(figures) <= TITLE_LETTERS
        axis.set_title(f"{joint_names[j]}:{' ' if one_line else chr(10)}{figures}")
    legend_below(figure, panels[0], 4)
    figure.suptitle(f"{fit.name} ({kind}): RMSE, and its share of the torque's RMS")
    return figure
