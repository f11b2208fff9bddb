"""Figures of the contact runs: forces over time with their band, and errors by interval."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from wrenchsight.analyses.experiments.setups.ur10e_recordings.contact_runs import (
    CONTROLLERS,
    JUDGED,
    SCENES,
)
from wrenchsight.analyses.experiments.ur10e_contact.contact_reading import block_mean
from wrenchsight.analyses.experiments.ur10e_contact.contact_study import ContactStudy, ReadRun
from wrenchsight.analyses.output.axes import limit_y
from wrenchsight.analyses.output.figures import (
    COLOUR,
    Figure,
    draw_bars,
    fill_band,
    legend_on_top,
    new_figure,
)
from wrenchsight.models.signals.bands import SIGMA_95

LABELS: Final = {
    "command": "ours, never a sensor",
    "calibrated": "ours, calibrated once",
    "article": "the article's",
    "by_hand": "K (i - i_target) by J^-T",
    "two_joints": "K (i - i_target), joints 2 and 3",
    "carried_over": "ours, friction of another robot",
}
_DRAWN = ("command", "calibrated", "article", "by_hand", "two_joints")
_FULL_SCALE = 160.0  # N; impacts leave the picture


def one_run_a_group(study: ContactStudy) -> list[ReadRun]:
    """The run of the middle force of each scene and controller, in the order of their names."""
    groups: dict[str, list[ReadRun]] = {}
    for read in study.runs:
        groups.setdefault(read.prepared.run.name.group, []).append(read)
    chosen = []
    for _, reads in sorted(groups.items(), reverse=True):
        ranked = sorted(reads, key=lambda r: (r.prepared.run.name.force, r.prepared.run.name))
        chosen.append(ranked[len(ranked) // 2])
    return chosen


def force_figure(reads: Sequence[ReadRun]) -> Figure:
    """The force along the tool over time, a panel a run: sensor, ours with its band, by hand."""
    figure, axes = new_figure(len(reads), 1, height=2.1 * len(reads) + 0.6)
    panels: list[Any] = list(axes[:, 0])
    for axis, read in zip(panels, reads, strict=True):
        run, ours = read.prepared.run, read.readings["command"]
        assert ours.sd is not None
        t = block_mean(run.t)
        for interval in JUDGED:
            if interval in run.intervals:
                axis.axvspan(*run.intervals[interval], color=COLOUR["reference"], alpha=0.08, lw=0)
        fill_band(axis, t, ours.force, SIGMA_95 * ours.sd)
        by_hand = read.readings["two_joints"].force
        axis.plot(t, by_hand, color=COLOUR["article"], lw=0.7, label=LABELS["two_joints"])
        axis.plot(t, ours.force, color=COLOUR["estimate"], lw=1.2, label=LABELS["command"])
        axis.plot(t, read.prepared.truth, color=COLOUR["truth"], lw=1.0, label="sensor")
        limit_y(axis, -40.0, _FULL_SCALE, "N")
        axis.set_ylabel("force [N]")
        axis.set_title(run.name.stem)
    panels[-1].set_xlabel("time from the first contact [s]; shaded: where it is judged")
    legend_on_top(figure, panels[0], ncols=4)
    return figure


def error_figure(metrics: dict[str, Any]) -> Figure:
    """RMSE of each method by scene, controller and interval, a panel an interval."""
    figure, axes = new_figure(len(JUDGED), 1, height=6.6, share_x=True)
    panels: list[Any] = list(axes[:, 0])
    kinds = [
        (group, speed)
        for group in (f"{scene}_{controller}" for scene in SCENES for controller in CONTROLLERS)
        for speed in metrics[group]
        if any(metrics[group][speed][i]["command"]["runs"] for i in JUDGED)
    ]
    names = [f"{group.replace('_', chr(10))}\n{int(speed[1:]) / 100:.2f}" for group, speed in kinds]
    for axis, interval in zip(panels, JUDGED, strict=True):
        series = {
            LABELS[method]: np.array(
                [metrics[group][speed][interval][method]["rmse_n"] for group, speed in kinds], float
            )
            for method in _DRAWN
        }
        draw_bars(axis, series, names)
        axis.set_ylim(0.0, 20.0)
        axis.set_ylabel("RMSE [N]")
        axis.set_title(
            {"hold1": "first hold", "slide": "steady slide", "hold2": "second hold"}[interval]
        )
    panels[-1].set_xlabel("scene, controller, speed [m/s]; bars beyond 20 N are cut")
    legend_on_top(figure, panels[0], ncols=3)
    return figure
