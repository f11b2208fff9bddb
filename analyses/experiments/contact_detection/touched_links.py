"""Calibration of the odds of links on a Panda's labelled touches.

Each recording of the data set `link_contact` is read alone, as `estimate` reads it: contacts, and
the odds of each link. E counts for the last link, which carries it. Touches fall into bins by the
odds of their likeliest link. Each bin has the mean of the stated odds and the share of touches
whose likeliest link is the labelled one. All touches of a recording are of one spot: only the ten
recordings are independent, and an interval by the number of touches is too short.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binomtest

from wrenchsight.analyses.experiments.setups.panda_recordings.touch_logs import (
    TouchLog,
    read_touch_logs,
)
from wrenchsight.analyses.methods.estimate.estimate_config import EstimateConfig
from wrenchsight.analyses.methods.external_torque.torque_log import TorqueLog
from wrenchsight.analyses.methods.external_torque.torque_touches import TorqueTouches
from wrenchsight.analyses.output.figures import SERIES, Figure, legend_on_top, new_figure
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.robot import Robot

ODDS_BINS = {
    "below_50": (0.0, 0.5),
    "50_70": (0.5, 0.7),
    "70_85": (0.7, 0.85),
    "85_95": (0.85, 0.95),
    "above_95": (0.95, 1.0 + 1e-9),
}
SURE_ODDS = 0.85  # odds that are called 90 % and more
_LABEL_TOLERANCE = 0.3  # s that a contact may begin before or after its label


@dataclass(frozen=True, eq=False)
class Touch:
    """One labelled touch that was found.

    Attributes:
        recording: its name.
        link: labelled, 1 to n.
        odds: (n,) of each link as a body.
        named: the links that were named.
    """

    recording: str
    link: int
    odds: Array
    named: tuple[int, ...]

    @property
    def stated(self) -> float:
        """Odds of the likeliest link."""
        return float(self.odds.max())

    @property
    def right(self) -> bool:
        """Whether the likeliest link is the labelled one."""
        return int(np.argmax(self.odds)) + 1 == self.link


def touches_of(log: TouchLog) -> tuple[list[Touch], int, int]:
    """The found touches of a recording, the number of missed labels and of false contacts."""
    config, robot = EstimateConfig(torque="external"), Robot.load("panda")
    source = TorqueLog(log.path, None, robot, config.check, config.reference, config.torque_sign)
    reading = TorqueTouches(source)
    for chunk, J, tau_ext in source.chunks(source.reader()):
        detection, odds, _ = reading.take(chunk, J, tau_ext)
        count = chunk.num_samples
        reading.episodes.add(chunk.t, detection, np.zeros((count, 3)), np.zeros(count, bool), odds)
    reading.episodes.finish()
    begins = np.array([log.t[touch.start] for touch in log.touches])
    touches, matched, false = [], set[int](), 0
    for contact in reading.episodes.contacts:
        nearest = int(np.argmin(np.abs(begins - contact.begin)))
        if abs(begins[nearest] - contact.begin) > _LABEL_TOLERANCE or nearest in matched:
            false += 1
        elif contact.place is not None:
            matched.add(nearest)
            place = contact.place
            touches.append(Touch(log.path.stem, log.link, place.bodies, tuple(place.named())))
    return touches, len(begins) - len(matched), false


def link_metrics(data: Path | None) -> dict[str, Any]:
    """Metrics over all recordings of the set, under the keys of the experiment.

    Args:
        data: the folder of recordings that is given.
    """
    touches: list[Touch] = []  # those that were found
    num_missed = 0  # touches in which no contact was found
    num_false = 0  # contacts apart from all touches
    by_recording = {}
    for log in read_touch_logs(data):
        log_touches, missed_in_log, false_in_log = touches_of(log)
        touches += log_touches
        num_missed += missed_in_log
        num_false += false_in_log
        by_recording[log.path.stem.removeprefix("panda_")] = {
            "touches": len(log_touches),
            "named_pct": 100.0 * _share([touch.link in touch.named for touch in log_touches]),
            "likeliest_pct": 100.0 * _share([touch.right for touch in log_touches]),
            # The mean odds that the labelled link was given.
            "label_odds_pct": 100.0 * _share([touch.odds[touch.link - 1] for touch in log_touches]),
        }
    return {
        "touches": len(touches),
        "missed": num_missed,
        "false_alarms": num_false,
        "recordings": by_recording,
        **calibration(touches),
    }


def calibration(touches: Sequence[Touch]) -> dict[str, Any]:
    """Stated against counted odds: by bin, of the sure touches, and the mean error (%) over all."""
    bins = {
        name: _bin([touch for touch in touches if low <= touch.stated < high])
        for name, (low, high) in ODDS_BINS.items()
    }
    off = [
        entry["touches"] * abs(entry["stated_pct"] - entry["right_pct"])
        for entry in bins.values()
        if entry["touches"]
    ]
    return {
        "odds": bins,
        "sure": _bin([touch for touch in touches if touch.stated >= SURE_ODDS]),
        "calibration_error_pct": float(np.sum(off)) / max(len(touches), 1),
        "named_pct": 100.0 * _share([touch.link in touch.named for touch in touches]),
    }


def _bin(touches: Sequence[Touch]) -> dict[str, Any]:
    count, right = len(touches), sum(touch.right for touch in touches)
    result: dict[str, Any] = {
        "touches": count,
        "recordings": len({touch.recording for touch in touches}),
        "stated_pct": None,
        "right_pct": None,
    }
    if count:
        interval = binomtest(right, count).proportion_ci(0.95, method="wilson")
        result["stated_pct"] = 100.0 * _share([touch.stated for touch in touches])
        result["right_pct"] = 100.0 * right / count
        result["right_low_pct"] = 100.0 * float(interval.low)
        result["right_high_pct"] = 100.0 * float(interval.high)
    return result


def _share(values: Sequence[float]) -> float:
    return float(np.mean(values)) if values else float("nan")


def odds_figure(metrics: dict[str, Any]) -> Figure:
    """How often the likeliest link is the labelled one, against its odds.

    The number below a bar is that of its touches; a bin without touches is left out.

    Args:
        metrics: of `link_metrics`; `odds` holds the figures of touches by ODDS_BINS: `touches`, and
            in % the stated odds, `right_pct` and its 95 % interval.
    """
    figure, ((panel,),) = new_figure(1, 1, height=3.4)
    panel.plot([0.0, 100.0], [0.0, 100.0], color=SERIES[6], lw=0.8, label="as stated")
    entries = [entry for entry in metrics["odds"].values() if entry["touches"]]
    stated, right, low, high = (
        np.array([entry[key] for entry in entries])
        for key in ("stated_pct", "right_pct", "right_low_pct", "right_high_pct")
    )
    bars = np.maximum(np.stack([right - low, high - right]), 0.0)
    panel.errorbar(
        stated, right, bars, fmt="o", color=SERIES[0], label="labelled touches (their number), 95 %"
    )
    for entry in entries:
        panel.annotate(
            str(entry["touches"]),
            (entry["stated_pct"], entry["right_low_pct"]),
            (0, -12),
            textcoords="offset points",
            ha="center",
        )
    panel.set_xlabel("odds of the likeliest link [%]")
    panel.set_ylabel("is the touched one [%]")
    legend_on_top(figure, panel)
    return figure
