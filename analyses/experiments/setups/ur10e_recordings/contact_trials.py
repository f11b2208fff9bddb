"""Pushes added to logs, and what a detector finds of them.

A push is added to the motors' torque: a force F at a point with Jacobian J takes J^T F off the
torque that the same motion needs. Observer, friction and detector read the log as any other.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from wrenchsight.analyses.experiments.setups.ur10e_recordings.ur10e_logs import (
    FOLDER,
    FURTHER_FOLDER,
)
from wrenchsight.models.detection.contact_detector import (
    ContactDetectionConfig,
    ContactDetector,
    Detection,
)
from wrenchsight.models.detection.contact_statistic import ArmSamples
from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.recordings.position_resolution import position_resolution
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.resampling import resampled
from wrenchsight.models.robot.robot import Robot

TIME_STEP = 0.01  # s
K_0 = 20.0  # 1/s
MAX_DELAY = 0.1  # s after a push in which it may still be found: the observer's own lag and more
WANTED_DELAY = 0.05 + 1e-9  # s, the delay that is wanted; delays are multiples of the period
FREE_MOTION_LOGS = {
    "14harm50sec": f"{FOLDER}/ur-20_02_19_14harm50sec.csv",
    "15harm50sec": f"{FURTHER_FOLDER}/ur-20_02_19_15harm50sec.csv",
    "7harm": f"{FURTHER_FOLDER}/ur-20_02_10-20sec_7harm.csv",
    "5harm": f"{FURTHER_FOLDER}/ur-20_02_06-20sec_5harm.csv",
    "10harm": f"{FURTHER_FOLDER}/ur-20_02_06-20sec_10harm.csv",
    "8harm": f"{FURTHER_FOLDER}/ur-20_02_05-20sec_8harm.csv",
    "01_31-unload": f"{FURTHER_FOLDER}/ur-20_01_31-unload.csv",
    "ptp_10_points": f"{FOLDER}/ur-20_01_17-ptp_10_points.csv",
    "collision_free": f"{FURTHER_FOLDER}/collision_free.csv",
}
"""Logs of free motion, into which pushes are put."""
SINGLE_JOINT_LOGS = {f"joint_{k}": f"{FOLDER}/ur-20_01_22-joint_{k}.csv" for k in range(1, 7)}
REST_LOGS = {f"p{k}": f"{FURTHER_FOLDER}/ur-20_01_17-p{k}.csv" for k in range(1, 6)}
OLDER_LOGS = {"12_23_free": f"{FURTHER_FOLDER}/ur-19_12_23_free.csv"}
COLLISION_LOG = f"{FURTHER_FOLDER}/collision_wrist.csv"
COLLISION_TIMES = (  # s, in it
    (4.6, 5.1),
    (7.3, 8.0),
    (11.2, 11.8),
    (15.2, 15.6),
    (19.2, 19.6),
    (22.7, 23.7),
    (26.4, 27.1),
)
FIRST_PUSH_TIME = 4.0  # s into a log
PUSH_PERIOD = 3.5  # s
MIN_MOVING_SPEED = 0.05  # rad/s: what counts as moving
NUM_ROUNDS = 2  # of pushes through every log
FALSE_ALARM_RATE = 1.0  # false alarms an hour
RATE_CONFIDENCE = 0.95  # of the largest rate that a count agrees with, and of the least


class TrialLog:
    """A log on its uniform grid, ready to be read again and again with other currents.

    Args:
        recording: recording of free motion, or with contacts of its own.
        time_step: s.
    """

    def __init__(
        self,
        recording: Recording,
        robot: Robot,
        model: IdentifiedModel,
        time_step: float = TIME_STEP,
    ) -> None:
        log = resampled(recording, time_step)
        self.robot, self.time_step = robot, time_step
        self.t, self.q, self.v, self.current = log.t - log.t[0], log.q, log.v, log.current
        self.estimator = WrenchEstimator(
            robot,
            model,
            WrenchEstimatorConfig(
                MomentumObserverConfig([K_0], time_step),
                WrenchReconstructionConfig("force_only"),
                position_resolution=position_resolution(recording.q).tolist(),
            ),
        )
        self.momentum = self.estimator.chain.momentum_terms(self.q, self.v)[0]
        self.J = self.estimator.chain.jacobian(self.q)

    @property
    def hours(self) -> float:
        """h, of the whole log."""
        return len(self.t) * self.time_step / 3600.0

    def detector(self, rate: float) -> ContactDetector:
        """The detector at a stated rate of false alarms an hour."""
        return ContactDetector.of(self.estimator, ContactDetectionConfig(rate))

    def detect(self, detector: ContactDetector, tau_ext: Array | None = None) -> Detection:
        """Detection along the log, with an external torque (N, n) N m added to it."""
        current = self.current
        if tau_ext is not None:
            current = np.asarray(current - self.robot.motor_current(tau_ext))
        observation = self.estimator.observe(self.q, self.v, current)
        samples = ArmSamples(
            observation.torque_error,
            self.v,
            observation.transmitted,
            self.momentum,
            observation.tau_ext,
            observation.fresh,
        )
        return Detection.of(detector.judge(detector.initial_state(), samples))

    def alarms(self, rate: float) -> NDArray[np.intp]:
        """Samples at which contacts begin, at a stated rate of false alarms an hour."""
        return onsets(self.detect(self.detector(rate)).contact)


def jacobian_on_link(J: Array, link: int) -> Array:
    """(N, 3, n) of the point of link 1 to n - 1 that lies on the next joint's axis, nearest to E.

    Args:
        J: (N, 6, n) rows [angular; linear] at E, of revolute joints.
        link: 1 to n - 1.
    """
    # Joint axis z through a point whose linear column is l: E lies at l x z from the axis.
    p_EP = -np.cross(J[:, 3:, link], J[:, :3, link])
    moved = J[:, 3:] + np.cross(J[:, :3], p_EP[:, :, None], axis=1)
    moved[:, :, link:] = 0.0
    return np.asarray(moved)


@dataclass
class Tally:
    """Counts of the pushes of a set: found, missed, their delays and their links."""

    contacts: int = 0
    delays: list[float] = field(default_factory=list)  # s, of those that were found
    misfits: int = 0  # of those found, not at E for at least half of the time
    links: dict[str, int] = field(default_factory=dict)  # "right", "wrong", "untold", of misfits

    @property
    def missed(self) -> int:
        """Pushes that were not found."""
        return self.contacts - len(self.delays)

    def add(
        self, detection: Detection, begin: int, end: int, time_step: float, link: int | None
    ) -> None:
        """Takes one push; none that begins while the contact before it is not over.

        It is found where a contact is detected from its begin to MAX_DELAY after its end. Where the
        detector says for at least half of the rest of the push that no force at E explains it (a
        misfit), the link counts that is named most often in those samples: right, wrong, or untold
        where links are named in half of them or less.

        Args:
            detection: along its log.
            begin, end: first sample with it, and the one after its last.
            time_step: s.
            link: that it acts on, 1 to n; None: it acts at E, and any link that is named is wrong.
        """
        late = round(MAX_DELAY / time_step)  # samples
        if detection.contact[max(begin - 1, 0)]:  # another contact lasts
            return
        self.contacts += 1
        in_contact = np.flatnonzero(detection.contact[begin : end + late])
        if not len(in_contact):
            return
        # The push may have begun up to a sample before the first that shows it.
        self.delays.append((int(in_contact[0]) + 1) * time_step)
        found_part = slice(begin + int(in_contact[0]), end)  # empty: found after its end
        misfit = detection.misfit[found_part]
        if len(misfit) and misfit.mean() >= 0.5:
            self.misfits += 1
            reported = detection.link[found_part][misfit]
            links = reported[reported > 0]  # 0: no link is named
            named = int(np.bincount(links).argmax()) if 2 * len(links) > len(reported) else None
            if named is None:
                verdict = "untold"
            elif named == link:
                verdict = "right"
            else:
                verdict = "wrong"
            self.links[verdict] = self.links.get(verdict, 0) + 1

    def metrics(self) -> dict[str, Any]:
        """Under the keys of the experiment; delays are null where nothing was found."""
        delays = np.array(self.delays)
        result = len(delays)
        return {
            "contacts": self.contacts,
            "missed": self.missed,
            "missed_pct": 100.0 * self.missed / max(self.contacts, 1),
            "delay_median_s": float(np.median(delays)) if result else None,
            "delay_p95_s": float(np.quantile(delays, 0.95)) if result else None,
            "delay_max_s": float(delays.max()) if result else None,
            "within_50ms_pct": 100.0
            * float(np.sum(delays <= WANTED_DELAY))
            / max(self.contacts, 1),
            "misfit_pct": 100.0 * self.misfits / max(result, 1),
            **{f"link_{name}": self.links.get(name, 0) for name in ("right", "wrong", "untold")},
        }


def onsets(contact: Flags) -> NDArray[np.intp]:
    """Samples at which a flag (N,) begins to be set."""
    return np.flatnonzero(np.diff(np.concatenate([[False], contact]).astype(int)) == 1)


def false_alarm_metrics(alarms: int, hours: float) -> dict[str, Any]:
    """False alarms an hour, and the least and the largest rate that agree with the count."""
    lower = 0.5 * float(chi2.ppf(1.0 - RATE_CONFIDENCE, 2 * alarms)) if alarms else 0.0
    upper = 0.5 * float(chi2.ppf(RATE_CONFIDENCE, 2 * (alarms + 1)))
    return {
        "false_alarms": alarms,
        "hours": hours,
        "false_alarms_per_hour": alarms / hours,
        "false_alarms_per_hour_lower": lower / hours,
        "false_alarms_per_hour_upper": upper / hours,
    }


def schedule(
    v: Array, duration: float, pause: float, lead: float, time_step: float, slowest: float
) -> list[tuple[int, int]]:
    """(begin, end) of pushes one after another while the arm moves.

    Args:
        v: (N, n) rad/s.
        duration: s, of a push.
        pause: s, after a push.
        lead: s, before the first push.
        time_step: s.
        slowest: rad/s of the fastest joint, all through the push.
    """
    size, gap = round(duration / time_step), round(pause / time_step)
    fast = np.abs(v).max(axis=1) >= slowest
    result, begin = [], round(lead / time_step)
    while begin + size + gap < len(v):
        if fast[begin : begin + size].all():
            result.append((begin, begin + size))
            begin += size + gap
        else:
            begin += max(1, gap // 10)
    return result


def spans_of(v: Array, duration: float, turn: int) -> list[tuple[int, int]]:
    """(begin, end) of the pushes of one of NUM_ROUNDS through a log of v (N, n) rad/s."""
    lead = FIRST_PUSH_TIME + turn * 0.5 * PUSH_PERIOD
    return schedule(v, duration, PUSH_PERIOD, lead, TIME_STEP, MIN_MOVING_SPEED)


def samples_of(spans: Sequence[tuple[float, float]], t: Array) -> list[tuple[int, int]]:
    """First sample of spans of time, s, and the one after the last, in a log of t (N,) s."""
    return [(int(np.searchsorted(t, begin)), int(np.searchsorted(t, end))) for begin, end in spans]


def put_in(
    pushes: Sequence[tuple[int, int]], J: Array, size: float, rng: np.random.Generator
) -> Array:
    """Torque (N, n) of forces of `size` N in random directions, constant in W; J (N, 3, n)."""
    tau = np.zeros((len(J), J.shape[2]))
    for begin, end in pushes:
        direction = rng.normal(size=3)
        direction *= size / np.linalg.norm(direction)
        tau[begin:end] = np.einsum("kij,i->kj", J[begin:end], direction)
    return tau
