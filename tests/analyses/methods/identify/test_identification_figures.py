"""The figures of an identification, as they are laid out."""

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text

from wrenchsight.analyses.methods.identify.identification_figures import torque_figure
from wrenchsight.analyses.methods.identify.torque_fit import TorqueFit


def _fit(n):
    t = np.linspace(0.0, 1.0, 20)
    measured = np.tile(100.0 * np.sin(6.0 * t)[:, None], n)
    return TorqueFit("ptp_10_points", t, measured, 0.9 * measured)


@pytest.mark.parametrize(
    ("n", "name"),
    [
        (1, "j"), (6, "j"), (7, "j"),
        (6, "shoulder_lift_joint"), (6, "arm_left_shoulder_lift_joint_of_it"),
    ],
)  # fmt: skip
def test_no_title_is_cut_off_or_runs_into_its_neighbour(n, name):
    figure = torque_figure(_fit(n), [name] * n, "validation, UR10e")
    FigureCanvasAgg(figure).draw()
    boxes = [
        next(t for t in panel.findobj(Text) if t.get_text().startswith(name)).get_window_extent()
        for panel in figure.axes
        if panel.get_visible()
    ]
    assert len(boxes) == n
    for k, box in enumerate(boxes):
        assert box.x1 <= figure.bbox.x1, name
        if k % 2 == 0 and k + 1 < n:
            assert box.x1 < boxes[k + 1].x0, name


def test_no_line_is_drawn_across_a_stop():
    fit = _fit(1)
    moving = (fit.t < 0.4) | (fit.t > 0.7)
    stopped = TorqueFit("log", fit.t[moving], fit.measured[moving], fit.predicted[moving])
    axis = torque_figure(stopped, ["j"], "validation").axes[0]
    for line in axis.lines[:3]:
        x, y = line.get_xdata(), line.get_ydata()
        assert np.isnan(x).sum() == np.isnan(y).sum() == 1
        assert np.nanmax(np.diff(x)) < 0.1
