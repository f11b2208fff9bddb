"""The figures of an identification, as they are laid out."""

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text

from wrenchsight.analyses.methods.learning.identification_figures import torque_figure
from wrenchsight.analyses.methods.learning.torque_fit import TorqueFit


def _fit(n):
    t = np.linspace(0.0, 1.0, 20)
    measured = np.tile(100.0 * np.sin(6.0 * t)[:, None], n)
    return TorqueFit("ptp_10_points", t, measured, 0.9 * measured)


@pytest.mark.parametrize("name", ["j", "shoulder_lift_joint", "arm_left_shoulder_lift_joint_of_it"])
def test_no_title_is_cut_off_or_runs_into_its_neighbour(name):
    figure = torque_figure(_fit(6), [name] * 6, "validation, UR10e")
    FigureCanvasAgg(figure).draw()
    boxes = [
        next(t for t in panel.findobj(Text) if t.get_text().startswith(name)).get_window_extent()
        for panel in figure.axes
    ]
    for k, box in enumerate(boxes):
        assert box.x1 <= figure.bbox.x1, name
        if k % 2 == 0:
            assert box.x1 < boxes[k + 1].x0, name
