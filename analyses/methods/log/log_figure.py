"""A page that draws a log: position, speed and current or torque of each joint over time."""

import numpy as np

from wrenchsight.analyses.methods.log.log_summary import LogSummary, effort
from wrenchsight.analyses.output.figures import COLOUR, Figure, new_figure


def log_figure(summary: LogSummary, joint_names: list[str], title: str) -> Figure:
    """One row of three panels a joint."""
    part = summary.drawn
    n = part.num_joints
    figure, axes = new_figure(n, 3, height=0.62 * n + 1.2, share_x=True)
    panels = np.asarray(axes).reshape(n, 3)
    t = part.t - part.t[0]
    quantity = "current [A]" if part.tau_J is None else "torque [N m]"
    columns = (("position [rad]", part.q), ("speed [rad/s]", part.v), (quantity, effort(part)))
    for column, (label, signal) in enumerate(columns):
        for j in range(n):
            axis = panels[j, column]
            axis.plot(t, signal[:, j], color=COLOUR["estimate"], lw=0.7)
            if j == 0:
                axis.set_title(label)
            if column == 0:
                axis.set_ylabel(joint_names[j], rotation=0, ha="right", va="center")
            if j == n - 1:
                axis.set_xlabel("time [s]")
    figure.suptitle(title)
    return figure
