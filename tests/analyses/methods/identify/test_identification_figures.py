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
