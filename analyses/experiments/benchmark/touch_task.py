"""Tasks `touches` and `link`: touches of a Panda at rest, their times and their links.

Both read the external torque that the arm reports. A touch is found if a contact begins between
LABEL_TOLERANCE before its label and MAX_DELAY after its end. A contact apart from every label is
false. Of a found touch the labelled link should be among those named. No link before the last
loaded joint should be named: statics rule it out.

    plain   contact where any joint's torque leaves a slow baseline by TORQUE_LEVEL, and the last
            joint that is loaded names the link: the data set's own reference
    ours    `estimate --torque external`

The unit of evidence is the recording: the same spot is touched all through it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from wrenchsight.analyses.experiments.benchmark.entrants import Entrant, touched_link
from wrenchsight.analyses.experiments.benchmark.scores import spread
from wrenchsight.analyses.experiments.setups.panda_recordings.touch_logs import (
    TouchLog,
    read_touch_logs,
)
from wrenchsight.analyses.methods.external_torque.torque_log import TorqueLog
from wrenchsight.analyses.methods.external_torque.torque_touches import TorqueTouches
from wrenchsight.analyses.methods.reference_sensor.reference_config import ReferenceConfig
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.numerics.stretches import stretches
from wrenchsight.models.robot.robot import Robot

MAX_DELAY: Final = 0.2  # s
TORQUE_LEVEL: Final = 0.5  # N m
START_TIME: Final = 0.15  # s that the baseline begins with
BASELINE_TIME: Final = 1.0  # s of its low-pass
LABEL_TOLERANCE: Final = 0.05  # s before its label that a contact may begin: the label is no surer
LOADED_TORQUE: Final = np.array([0.15, 0.15, 0.15, 0.15, 0.08, 0.08, 0.05])  # N m
LOADED_SHARE: Final = 0.02  # of the peak


@dataclass(frozen=True)
class ReportedContact:
    """A contact that a method reports, s, and the links that it names."""

    begin: float
    end: float
    links: tuple[int, ...]


class TouchTasks:
    """Detected touches and named links, compared with the labels."""

    def __init__(self, data: Path | None) -> None:
        self._robot = Robot.load("panda")
        self._logs = read_touch_logs(data)
        self._last = [[_last_loaded(log, touch) for touch in log.touches] for log in self._logs]

    def built_in(self) -> dict[str, dict[str, dict[str, Any]]]:
        """By task and method."""
        return self._by_task({"plain": self._plain(), "ours": self._ours()})

    def of(self, entrant: Entrant) -> dict[str, dict[str, Any]] | None:
        """By task, of a method of others; None: it names no link.

        Raises:
            FaultError: it fails.
        """
        robot, episodes = self._robot, []
        step = float(np.median(np.diff(self._logs[0].t)))
        made = entrant.made("link", robot, IdentifiedModel.nominal(robot), (), step)
        for log in self._logs:
            link = touched_link(made, log.t, log.tau_ext, robot.chain.jacobian(log.q))
            if link is None:
                return None
            episodes.append(_episodes(log.t, link > 0.0, link))
        scored = self._by_task({entrant.name: episodes})
        return {task: by_method[entrant.name] for task, by_method in scored.items()}

    def _by_task(
        self, methods: Mapping[str, Sequence[Sequence[ReportedContact]]]
    ) -> dict[str, dict[str, dict[str, Any]]]:
        scores = {method: self._scored(episodes) for method, episodes in methods.items()}
        return {
            task: {method: by_task[task] for method, by_task in scores.items()}
            for task in ("touches", "link")
        }

    def _plain(self) -> list[list[ReportedContact]]:
        episodes = []
        for log in self._logs:
            alone = log.tau_ext - _baseline(log)
            contact = np.asarray((np.abs(alone) > TORQUE_LEVEL).any(axis=1))
            link = np.zeros(len(log.t))
            for part in stretches(contact):
                link[part] = _last_of(alone[part])
            episodes.append(_episodes(log.t, contact, link))
        return episodes

    def _ours(self) -> list[list[ReportedContact]]:
        episodes = []
        for log in self._logs:
            source = TorqueLog(log.path, None, self._robot, True, ReferenceConfig())
            touches = TorqueTouches(source)
            for chunk, J, tau_ext in source.chunks(source.reader()):
                detection, odds, trusted = touches.take(chunk, J, tau_ext)
                nothing = np.zeros((chunk.num_samples, 3))
                touches.episodes.add(chunk.t, detection, nothing, trusted, odds)
            touches.episodes.finish()
            episodes.append(
                [
                    ReportedContact(
                        contact.begin,
                        contact.end,
                        tuple(contact.place.named() if contact.place else ()),
                    )
                    for contact in touches.episodes.contacts
                ]
            )
        return episodes

    def _scored(self, episodes: Sequence[Sequence[ReportedContact]]) -> dict[str, dict[str, Any]]:
        """Scores of the touches found, and of the link that is named for those.

        A list with `_of_logs` has an entry a log; all but the share found leave out logs in which
        no touch is found.

        Args:
            episodes: of each log, the contacts that a method reports.

        Returns:
            By task: "touches" and "link".
        """
        num_touches = 0  # that are labelled
        num_found = 0  # of these
        num_false = 0  # contacts apart from every label
        delays = list[float]()  # s, of those found
        found_pct_of_logs = list[float]()
        # Of logs in which a touch is found:
        delay_of_logs = list[float]()  # s, median
        named_pct_of_logs = list[float]()  # touches whose labelled link is among those named
        num_links_of_logs = list[float]()  # how many links are named for a touch, mean
        ruled_out_pct_of_logs = list[float]()  # touches with a named link that cannot be
        for log, reported, last_loaded in zip(self._logs, episodes, self._last, strict=True):
            spans = [(log.t[rows.start], log.t[rows.stop - 1]) for rows in log.touches]  # s
            hits = [_hit(reported, *span) for span in spans]
            log_delays = [hit.begin - span[0] for hit, span in zip(hits, spans, strict=True) if hit]
            num_touches += len(spans)
            num_found += len(log_delays)
            delays += log_delays
            # Apart from every label: no sample in common with it, nor with MAX_DELAY after it.
            num_false += sum(
                all(episode.end < begin or episode.begin > end + MAX_DELAY for begin, end in spans)
                for episode in reported
            )
            found_pct_of_logs.append(100.0 * len(log_delays) / len(spans))
            # The links named for each touch that is found, and its last loaded joint, 1 to 7: a
            # force on a link before that joint cannot load it.
            named = [
                (hit.links, joint)
                for hit, joint in zip(hits, last_loaded, strict=True)
                if hit is not None
            ]
            if not named:
                continue
            delay_of_logs.append(float(np.median(log_delays)))
            named_pct_of_logs.append(
                100.0 * float(np.mean([log.link in links for links, _ in named]))
            )
            num_links_of_logs.append(float(np.mean([len(links) for links, _ in named])))
            ruled_out_pct_of_logs.append(
                100.0 * float(np.mean([any(k < joint for k in links) for links, joint in named]))
            )
        totals = {"touches": num_touches, "found": num_found, "false": num_false}
        detected = {**totals, **spread("found_pct", found_pct_of_logs)}
        link: dict[str, Any] = {"touches": num_touches}
        if delays:
            detected |= spread("delay_s", delay_of_logs)
            detected["delay_p90_s"] = float(np.quantile(delays, 0.9))
            link |= spread("named_pct", named_pct_of_logs)
            link |= spread("links_named", num_links_of_logs)
            link |= spread("ruled_out_pct", ruled_out_pct_of_logs)
        return {"touches": detected, "link": link}


def _hit(episodes: Sequence[ReportedContact], begin: float, end: float) -> ReportedContact | None:
    """The first episode that begins during a touch."""
    return next(
        (
            episode
            for episode in episodes
            if begin - LABEL_TOLERANCE <= episode.begin <= end + MAX_DELAY
        ),
        None,
    )


def _episodes(t: Array, contact: Flags, link: Array) -> list[ReportedContact]:
    """Stretches of contact by the link most often named; pauses below MAX_DELAY / 2 are filled."""
    joined = contact.copy()
    for pause in stretches(~contact):
        inner = pause.start > 0 and pause.stop < len(t)
        if inner and t[pause.stop] - t[pause.start - 1] < 0.5 * MAX_DELAY:
            joined[pause] = True
    episodes = []
    for part in stretches(joined):
        named = link[part][link[part] > 0].astype(int)
        links = (int(np.bincount(named).argmax()),) if len(named) else ()
        episodes.append(ReportedContact(float(t[part.start]), float(t[part.stop - 1]), links))
    return episodes


def _baseline(log: TouchLog) -> Array:
    """(N, 7) N m: the mean of the first START_TIME s, low-passed slowly while no contact is
    found.
    """
    base = log.tau_ext[log.t <= log.t[0] + START_TIME].mean(axis=0)
    baseline = np.empty_like(log.tau_ext)
    steps = np.diff(log.t, prepend=log.t[0])
    for k, (tau, step) in enumerate(zip(log.tau_ext, steps, strict=True)):
        baseline[k] = base
        if (np.abs(tau - base) <= TORQUE_LEVEL).all():
            base = base + (1.0 - np.exp(-step / BASELINE_TIME)) * (tau - base)
    return baseline


def _last_of(alone: Array) -> int:
    """The last joint, 1 to 7, that is loaded at the peak of a contact (K, 7) N m; at least 1."""
    peak = np.abs(alone[int(np.linalg.norm(alone, axis=1).argmax())])
    loaded = np.flatnonzero(peak > np.maximum(LOADED_TORQUE, LOADED_SHARE * peak.max()))
    return int(loaded[-1]) + 1 if len(loaded) else 1


def _last_loaded(log: TouchLog, touch: slice) -> int:
    """The last loaded joint of a labelled touch; the torque just before it is subtracted."""
    rows_before = log.tau_ext[max(touch.start - 5, 0) : touch.start]
    base = rows_before.mean(axis=0) if len(rows_before) else 0.0
    return _last_of(log.tau_ext[touch] - base)
