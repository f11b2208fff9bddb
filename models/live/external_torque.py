"""Live readings from the controller's external torque, without a model of the arm.

The wrench is that of `estimate --torque external` with the same prior and sd of the torque. Contact
is found against a baseline that follows while nothing acts (`models.detection.torque_contact`). The
place of a contact, at E or on a link, is judged while it lasts, by the strongest samples so far.
"""

from collections import deque
from typing import NamedTuple

import numpy as np

from wrenchsight.models.detection.contact_detector import Detection
from wrenchsight.models.detection.link_odds import (
    AT_WORK,
    MAX_LINK_ODDS,
    PlaceOdds,
    place_evidence,
)
from wrenchsight.models.detection.torque_contact import (
    SENSOR_LOADED_SDS,
    START_TIME,
    ReportedTorqueSd,
    TorqueContactDetector,
    first_baseline,
)
from wrenchsight.models.estimation.estimator import EstimateBatch
from wrenchsight.models.estimation.invalid import OTHER_LINK, SAMPLE_MISSING, SETTLING
from wrenchsight.models.estimation.wrench import WrenchReconstruction, WrenchReconstructionConfig
from wrenchsight.models.estimation.wrench_prior import live_prior
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.robot import Robot

JUDGE_TIME = 0.05  # s of a contact before its place is judged first, then at each doubling
# samples of a contact: the latest, and of these the strongest that judge
LATEST_SAMPLES, JUDGED_SAMPLES = 20, 2


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
            remedy = "run `wrenchsight estimate` on a log of this arm's external torque: its "
            remedy += "config.yaml states the sd"
            raise InputError("watch", "--torque-sd", problem, remedy)
        self._robot, self._step = robot, time_step
        self._sd = np.array(np.broadcast_to(np.array(torque_sd), robot.num_joints))
        live_config = config.with_live(*live_prior(robot.payload))
        self._reading = WrenchReconstruction(live_config, np.diag(self._sd**2))
        self.restart()

    def restart(self) -> None:
        """As the protocol."""
        self._t = 0.0
        self._first_torques: list[Array] = []  # until there is a baseline
        self._detector: TorqueContactDetector | None = None
        self._contact_samples: deque[_ContactSample] = deque(maxlen=LATEST_SAMPLES)
        self._contact_begin = self._judge_at = np.inf  # s
        self._place: PlaceOdds | None = None  # of the present contact; None: not judged yet

    def run(self, q: Array, v: Array, current: Array) -> tuple[EstimateBatch, Detection]:
        """As the protocol."""
        rows = [self._read(q[k : k + 1], current[k : k + 1]) for k in range(len(q))]
        return (
            EstimateBatch.joined([batch for batch, _ in rows]),
            Detection.joined([detection for _, detection in rows]),
        )

    def _read(self, q: Array, tau: Array) -> tuple[EstimateBatch, Detection]:
        """The reading of one sample; one that is not finite is read as zeros, not valid.

        Args:
            q, tau: (1, n) rad, and N m of the external torque.
        """
        is_finite = bool(np.isfinite(q).all() and np.isfinite(tau).all())
        self._t += self._step
        J = self._robot.chain.jacobian(np.nan_to_num(q))
        estimate = self._reading.reconstruct(J, np.nan_to_num(tau))
        state = self._contact(J, tau) if is_finite else _NO_CONTACT
        # A contact whose place is not judged yet may be anywhere.
        on_link, link, may_be_elsewhere = False, 0, state.contact
        if state.contact and self._place is not None:
            on_link = self._place.on_link
            link = self._place.touched_link
            may_be_elsewhere = bool(self._place.links[:-1].sum() > MAX_LINK_ODDS)
        batch = EstimateBatch(
            tau_ext=tau,
            wrench=estimate.wrench,
            covariance=estimate.covariance,
            condition_number=estimate.condition_number,
            invalid=estimate.invalid,
            J=J,
            torque_sd=self._sd[None],
            fresh=np.array([is_finite]),
            fault=np.zeros(1, np.int64),
        )
        batch = batch.marked(SAMPLE_MISSING, not is_finite)
        batch = batch.marked(SETTLING, self._detector is None)
        batch = batch.marked(OTHER_LINK, may_be_elsewhere)
        detection = Detection(
            statistic=np.array([state.statistic]),
            contact=np.array([state.contact]),
            misfit=np.array([on_link]),  # then no force at E explains it
            link=np.array([link], np.int8),
            rest=np.array([not state.moving]),
            out_of_range=np.zeros(1, np.bool_),
        )
        return batch, detection

    def _contact(self, J: Array, tau: Array) -> "_ContactState":
        """Contact and motion of the next sample; judges the place of a contact where it is due."""
        if self._detector is None:
            self._first_torques.append(tau[0])
            if self._t < START_TIME:
                return _NO_CONTACT
            torques = np.array(self._first_torques)
            times = self._step * np.arange(len(torques), dtype=float)
            baseline = first_baseline(times, torques)
            self._detector = TorqueContactDetector(ReportedTorqueSd(self._sd, self._sd), baseline)
        sample = self._detector.run(np.array([self._t]), tau, J)
        contact = bool(sample.contact[0])
        if not contact:
            self._contact_samples.clear()
            self._place, self._contact_begin = None, np.inf
        else:
            if not np.isfinite(self._contact_begin):
                self._contact_begin, self._judge_at = self._t, self._t + JUDGE_TIME
            self._contact_samples.append(_ContactSample(J[0], tau[0] - sample.baseline[0]))
            if self._t >= self._judge_at:
                self._judge_at = self._t + (self._t - self._contact_begin)
                self._place = self._judge()
        return _ContactState(contact, bool(sample.moving[0]), float(sample.statistic[0]))

    def _judge(self) -> PlaceOdds:
        """The place of the present contact."""
        J = np.array([sample.J for sample in self._contact_samples])
        tau = np.array([sample.tau for sample in self._contact_samples])
        strongest = np.argsort(-np.linalg.norm(tau / self._sd, axis=1))[:JUDGED_SAMPLES]
        sd = np.broadcast_to(self._sd, (len(strongest), len(self._sd)))
        evidence = place_evidence(J[strongest], tau[strongest], sd, loaded=SENSOR_LOADED_SDS)
        return PlaceOdds.of(evidence, AT_WORK)


class _ContactSample(NamedTuple):
    """A sample of a contact: J (6, n), and tau (n,) N m less the baseline."""

    J: Array
    tau: Array


class _ContactState(NamedTuple):
    """Whether something touches the arm, whether it moves, and the contact statistic."""

    contact: bool
    moving: bool
    statistic: float


_NO_CONTACT = _ContactState(contact=False, moving=True, statistic=0.0)
