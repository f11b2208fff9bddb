"""Figures of an identification: measured and predicted torque of a log, joint by joint."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from analyses.methods.learning.torque_fit import TorqueFit
from analyses.output.figures import COLOUR, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def torque_figure(fit: TorqueFit, joint_names: Sequence[str], kind: str) -> "Figure":
    """Measured and predicted torque with the residual, one panel a joint."""
    n = fit.measured.shape[1]
    rows = (n + 1) // 2
    figure, axes = new_figure(rows, 2, height=2.1 * rows + 0.6, share_x=True)
    panels: list[Any] = list(axes.flat)
    t = fit.t - fit.t[0]
    for j, axis in enumerate(panels[:n]):
        axis.plot(t, fit.measured[:, j], color=COLOUR["truth"], label="measured")
        axis.plot(t, fit.predicted[:, j], color=COLOUR["estimate"], lw=1.0, label="predicted")
        axis.plot(t, fit.residual[:, j], color=COLOUR["before"], lw=0.8, label="residual")
        axis.set_title(
            f"{joint_names[j]}: RMSE {fit.rmse[j]:.2f} N m, {100 * fit.relative[j]:.0f} %"
        )
        axis.set_ylabel("torque [N m]")
        if j >= n - 2:
            axis.set_xlabel("time [s]")
            axis.tick_params(labelbottom=True)
    for axis in panels[n:]:
        axis.set_visible(False)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    figure.suptitle(f"{fit.name} ({kind})")
    return figure
