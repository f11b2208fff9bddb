"""Live readings of an arm that reports its external torque itself: no model has a part in them.

The wrench is that of `estimate --torque external` with the same prior and sd of the torque. Contact
is told by a baseline that follows while nothing acts (`models.detection.torque_contact`). Where a
contact is, at E or on a link, is judged while it lasts, by the strongest samples so far.
"""

from collections import deque

import numpy as np

from wrenchsight.models.detection.contact_detector import Detection
from wrenchsight.models.detection.link_odds import (
    AT_WORK,
    DOUBT,
    PlaceOdds,
    place_evidence,
)
from wrenchsight.models.detection.torque_contact import (
    FIRST,
    TorqueContactDetector,
    TorqueError,
    first_baseline,
)
from wrenchsight.models.estimation.estimator import EstimateBatch
from wrenchsight.models.estimation.wrench import (
    WrenchReconstruction,
    WrenchReconstructionConfig,
    live_prior,
)
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.robot import Robot

JUDGE_TIME = 0.05  # s of a contact before its place is judged first, then at each doubling
KEPT, CHOSEN = 20, 2  # samples of a contact that are kept, and by which it is judged
LOADED = 1.5  # as `place_evidence`, of what a sensor reads


class ExternalTorqueEstimator:
    """A `Reader` of external torque, N m positive along the motion that it causes, as current.

    Args:
        robot: whose Jacobian it is.
        config: with a prior.
        torque_sd: N m, of the torque's error: one for all joints, or one each.
        time_step: s.

    Raises:
        InputError: the sd is not stated, or not of each joint.
    """

    def __init__(
        self,
        robot: Robot,
        config: WrenchReconstructionConfig,
        torque_sd: list[float],
        time_step: float,
    ) -> None:
        if len(torque_sd) not in (1, robot.num_joints):
            problem = f"has {len(torque_sd)} numbers, expected 1 or {robot.num_joints}"
            remedy = "estimate on a log of this arm's external torque finds it (config.yaml)"
            raise InputError("watch", "--torque-sd", problem, remedy)
        self._robot, self._step = robot, time_step
        self._sd = np.array(np.broadcast_to(np.array(torque_sd), robot.num_joints))
        known = config.with_live(*live_prior(robot.payload))
        self._reading = WrenchReconstruction(known, np.diag(self._sd**2))
        self.restart()

    def restart(self) -> None:
        """As the protocol."""
        self._t = 0.0
        self._first: list[Array] = []  # torques before there is a baseline
        self._detector: TorqueContactDetector | None = None
        self._strong: deque[tuple[Array, Array]] = deque(maxlen=KEPT)
        self._since = self._judge_at = np.inf  # s, of a contact
        self._place: PlaceOdds | None = None

    def run(self, q: Array, v: Array, current: Array) -> tuple[EstimateBatch, Detection]:
        """As the protocol."""
        rows = [self._read(q[k : k + 1], current[k : k + 1]) for k in range(len(q))]
        batches, found = zip(*rows, strict=True)
        return EstimateBatch.joined(batches), Detection.joined(found)

    def _read(self, q: Array, tau: Array) -> tuple[EstimateBatch, Detection]:
        known = bool(np.isfinite(q).all() and np.isfinite(tau).all())
        self._t += self._step
        J = self._robot.chain.jacobian(np.nan_to_num(q))
        estimate = self._reading.reconstruct(J, np.nan_to_num(tau))
        contact, moving, statistic = self._contact(J, tau) if known else (False, True, 0.0)
        place = self._place if contact else None
        on_link = place is not None and place.on_link
        at_E = place is None or bool(place.links[:-1].sum() <= DOUBT)
        valid = known and self._detector is not None and at_E and bool(estimate.valid[0])
        valid &= place is not None or not contact
        batch = EstimateBatch(
            tau,
            estimate.wrench,
            estimate.covariance,
            estimate.condition_number,
            np.array([valid]),
            J,
            self._sd[None],
            fresh=np.array([known]),
            fault=np.zeros(1, np.int64),
        )
        found = Detection(
            statistic=np.array([statistic]),
            contact=np.array([contact]),
            misfit=np.array([on_link]),
            link=np.array([place.named()[0] if place is not None and on_link else 0], np.int8),
            rest=np.array([not moving]),
            out_of_range=np.zeros(1, np.bool_),
        )
        return batch, found

    def _contact(self, J: Array, tau: Array) -> tuple[bool, bool, float]:
        """Whether something touches the arm, whether it moves, and how sure the former is."""
        if self._detector is None:
            self._first.append(tau[0])
            if self._t < FIRST:
                return False, True, 0.0
            taken = np.array(self._first)
            start = first_baseline(self._step * np.arange(len(taken), dtype=float), taken)
            self._detector = TorqueContactDetector(TorqueError(self._sd, self._sd), start)
        found = self._detector.run(np.array([self._t]), tau, J)
        contact = bool(found.contact[0])
        if not contact:
            self._strong.clear()
            self._place, self._since = None, np.inf
        else:
            if not np.isfinite(self._since):
                self._since, self._judge_at = self._t, self._t + JUDGE_TIME
            self._strong.append((J[0], tau[0] - found.baseline[0]))
            if self._t >= self._judge_at:
                self._judge_at = self._t + (self._t - self._since)
                self._place = self._judge()
        return contact, bool(found.moving[0]), float(found.statistic[0])

    def _judge(self) -> PlaceOdds:
        J, tau = (np.array(part) for part in zip(*self._strong, strict=True))
        chosen = np.argsort(-np.linalg.norm(tau / self._sd, axis=1))[:CHOSEN]
        sd = np.broadcast_to(self._sd, (len(chosen), len(self._sd)))
        evidence = place_evidence(J[chosen], tau[chosen], sd, loaded=LOADED)
        return PlaceOdds.of(evidence, AT_WORK)
