"""Figures of a machining study: force read, force held, both over the feed (Figs. 25 and 27)."""

from collections.abc import Iterator, Mapping
from typing import Any

from wrenchsight.analyses.experiments.setups.machining_runs.machining import (
    COMPONENTS,
    FEED_TIMES,
    MachiningRun,
    MachiningTask,
    feed_key,
)
from wrenchsight.analyses.methods.reference_sensor.force_errors import draw_signal
from wrenchsight.analyses.output.axes import limit_y
from wrenchsight.analyses.output.figures import (
    COLOUR,
    Figure,
    legend_below,
    legend_on_top,
    new_figure,
)
from wrenchsight.analyses.study.experiment import Drawing
from wrenchsight.models.machining.machining_phases import Phase
from wrenchsight.models.numerics.arrays import Array


def force_figure(
    shown: Mapping[float, tuple[MachiningRun, Mapping[str, Mapping[str, Array]]]],
    component: str,
) -> Figure:
    """True, measured and estimated force at work, a panel a feed (the article's Figs. 25, 27)."""
    figure, axes = new_figure(len(shown), 1, height=2.5 * len(shown) + 0.6)
    for panel, (feed, (run, readings)) in zip(axes[:, 0], shown.items(), strict=True):
        rows = run.working
        t = run.t[rows] - run.t[rows][0]
        truth = run.components(run.signals["wrench_true"][:, 3:])[component][rows]
        panel.plot(t, readings["sensor"][component][rows], color="#bdbdbd", lw=4.0, label="sensor")
        draw_signal(
            panel, t, readings["article"][component][rows], COLOUR["article"], "article's method"
        )
        draw_signal(panel, t, readings["ours"][component][rows], COLOUR["estimate"], "ours")
        panel.plot(t, truth, color=COLOUR["truth"], lw=0.8, label="true")
        low, high = truth.min(), truth.max()
        room = 0.35 * (high - low) + 6.0
        limit_y(panel, low - room, high + room, "N")
        panel.set_ylabel(f"{component} force [N]")
        panel.set_title(f"one way in {feed:g} s")
    axes[-1, 0].set_xlabel("time since the feed started [s]")
    legend_below(figure, axes[0, 0], ncols=4)
    return figure


def regulation_figure(
    with_sensor: Mapping[float, MachiningRun], without: Mapping[float, MachiningRun]
) -> Figure:
    """The true normal force from touch to lift, force control with and without a sensor."""
    figure, axes = new_figure(len(without), 1, height=2.5 * len(without) + 0.6)
    for panel, feed in zip(axes[:, 0], without, strict=True):
        for run, colour, label in (
            (without[feed], COLOUR["estimate"], "held by the estimate"),
            (with_sensor[feed], COLOUR["after"], "held by a sensor"),
        ):
            phase = run.signals["phase"][:, 0]
            rows = (phase >= Phase.TOUCH) & (phase <= Phase.RELEASE)
            start = run.t[run.working][0]
            force = run.components(run.signals["wrench_true"][:, 3:])["normal"]
            draw_signal(panel, run.t[rows] - start, force[rows], colour, label)
        setpoint = run.signals["force_setpoint"][rows, 0]
        panel.plot(run.t[rows] - start, setpoint, color=COLOUR["truth"], lw=0.8, label="set-point")
        panel.set_ylabel("normal force [N]")
        panel.set_ylim(bottom=0.0)
        panel.set_title(f"one way in {feed:g} s")
    axes[-1, 0].set_xlabel("time since the feed started [s]")
    legend_below(figure, axes[0, 0], ncols=3)
    return figure


def feed_figure(task: MachiningTask, metrics: Mapping[str, Any]) -> Figure:
    """RMSE of the reading over the feed's duration, and error of the held force.

    Args:
        metrics: of `machining_study.feed_metrics`, by `feed_key`.
    """
    figure, axes = new_figure(1, 2, height=4.2)
    reading, held = axes[0]
    reading.plot(
        FEED_TIMES, task.rmse_n, "s--", color=COLOUR["reference"], label="printed in the article"
    )
    lines = (
        ("article", COLOUR["article"], "article's method, here"),
        ("ours", COLOUR["estimate"], "ours"),
        ("known_friction", COLOUR["truth"], "true friction known"),
    )
    for key, colour, label in lines:
        values = [metrics[feed_key(feed)][key]["rmse_n"] for feed in FEED_TIMES]
        reading.plot(FEED_TIMES, values, "o-", color=colour, label=label)
    steady = [metrics[feed_key(feed)]["article"]["steady"]["rmse_n"] for feed in FEED_TIMES]
    reading.plot(FEED_TIMES, steady, "o:", color=COLOUR["article"], label="article's, steady feed")
    reading.set_title(f"{task.component} force read")
    for feedback, colour, label in (
        ("estimate", COLOUR["estimate"], "held by the estimate"),
        ("sensor", COLOUR["after"], "held by a sensor"),
    ):
        values = [metrics[feed_key(feed)]["regulation"][feedback]["rms_n"] for feed in FEED_TIMES]
        held.plot(FEED_TIMES, values, "o-", color=colour, label=label)
    held.set_title("normal force held")
    for panel in (reading, held):
        panel.set_xlabel("one way in [s]")
        panel.set_ylabel("RMS error [N]")
        panel.set_ylim(bottom=0.0)
        panel.set_xticks(FEED_TIMES)
    legend_on_top(figure, reading, held, ncols=3)
    return figure


def machining_figures(
    task: MachiningTask,
    shown: Mapping[float, tuple[MachiningRun, Mapping[str, Mapping[str, Array]]]],
    without: Mapping[float, MachiningRun],
    metrics: Mapping[str, Any],
) -> Iterator[Drawing]:
    """All figures of a machining study.

    Args:
        shown: by feed, the run with a sensor in its loop, and its readings by method and component.
        without: by feed, the run without a sensor.
        metrics: of all feeds.
    """
    other = COMPONENTS[1 - COMPONENTS.index(task.component)]
    with_sensor = {feed: run for feed, (run, _) in shown.items()}
    yield (
        "forces",
        force_figure(shown, task.component),
        f"{task.component.capitalize()} force at work, true, measured and estimated "
        f"({task.figure}). At the ends joints rest or turn round, and friction hides the "
        "force; the highest peaks of the readings are cut off.",
    )
    yield other, force_figure(shown, other), f"{other.capitalize()} force, the same runs."
    yield (
        "regulation",
        regulation_figure(with_sensor, without),
        "True normal force, held with a sensor in the loop and without one.",
    )
    yield (
        "feeds",
        feed_figure(task, metrics),
        "Errors of reading and of holding the force, by feed.",
    )
