"""Contacts of a log of external torque: their begin, statistic and place.

The torque's error and its baseline come from the log itself (`models.detection.torque_contact`).
Where the log holds positions, the contacts show the torque's sign besides: an arm at rest yields
along the torque that acts on it.
"""

from dataclasses import dataclass

import numpy as np

from wrenchsight.analyses.methods.estimate.contact_episodes import ContactEpisodes
from wrenchsight.analyses.methods.estimate.contact_places import (
    ContactTorque,
    PlacedContacts,
    judge_places,
)
from wrenchsight.analyses.methods.external_torque.torque_log import TorqueLog
from wrenchsight.models.detection.contact_detector import Detection
from wrenchsight.models.detection.torque_contact import (
    MAX_SAMPLES,
    PAUSE_TIME,
    SENSOR_LOADED_SDS,
    TorqueContact,
    TorqueContactDetector,
    first_baseline,
    learn_reported_torque_sd,
)
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.stretches import stretches
from wrenchsight.models.recordings.recording import Recording

_REST_TIMES = (0.2, 0.08)  # s before a contact, between which the arm's place of rest is read
_MIN_CONTACTS = 3  # contacts that determine the sign
_MIN_CORRELATION = 0.5  # least size of the correlation that determines it
_LEAST_YIELD = 2e-6  # rad (m); less is rounding


@dataclass(frozen=True)
class TorqueSign:
    """Agreement of the torque with the motion that it causes.

    Attributes:
        contacts: that shifted an arm at rest.
        correlation: correlation of torque and shift over the joints, median of these; NaN where
            there are few.
    """

    contacts: int
    correlation: float

    @property
    def contradicts(self) -> bool:
        """Whether the arm moves against the logged torque."""
        return self.correlation < -_MIN_CORRELATION

    def sentence(self, name: str, exerted_on: str) -> str:
        """The contradiction, and what to do, for the user.

        Args:
            name: name of the log.
            exerted_on: body that its torques were read to be exerted on.
        """
        other = "environment" if exerted_on == "robot" else "robot"
        return (
            f"{name}: the sign of the external torque is contradicted: touched at rest, the arm "
            f"moves against it (correlation {self.correlation:.2f} over {self.contacts} contacts), "
            f"so forces read reversed; pass --torque-sign {other}"
        )


class TorqueTouches:
    """Finds the contacts of a log and their places, chunk by chunk.

    Reads the beginning of the log to estimate the torque's error.

    Attributes:
        error: error of the torque.
        episodes: the contacts.
    """

    def __init__(self, log: TorqueLog) -> None:
        t, tau, J = _beginning(log)
        self.error = learn_reported_torque_sd(t, tau, J)
        self._detector = TorqueContactDetector(self.error, first_baseline(t, tau))
        self.episodes = ContactEpisodes(log.num_joints, PAUSE_TIME)
        self._shifts: list[float] = []

    def take(self, chunk: Recording, J: Array, tau_ext: Array) -> PlacedContacts:
        """Takes N samples: J (N, 6, n), tau_ext (N, n) N m; places their contacts."""
        contact = self._detector.run(chunk.t, tau_ext, J)
        contact_torque = tau_ext - contact.baseline
        none = np.zeros(chunk.num_samples, bool)
        detection = Detection(
            statistic=contact.statistic,
            contact=contact.contact,
            misfit=none,
            link=none.astype(np.int8),
            rest=~contact.moving,
            out_of_range=none,
        )
        if chunk.num_joints:
            self._shifts += _shifts(chunk, contact, contact_torque)
        torque = ContactTorque(chunk.t, J, contact_torque, contact.sd)
        return judge_places(detection, torque, loaded=SENSOR_LOADED_SDS)

    @property
    def sign(self) -> TorqueSign:
        """The sign that all contacts so far show."""
        count = len(self._shifts)
        return TorqueSign(
            count, float(np.median(self._shifts)) if count >= _MIN_CONTACTS else np.nan
        )


def _beginning(log: TorqueLog) -> tuple[Array, Array, Array]:
    """s, N m and Jacobians of at most MAX_SAMPLES rows."""
    parts, count = [], 0
    for chunk, J, tau_ext in log.chunks(log.reader()):
        parts.append((chunk.t, tau_ext, J))
        count += chunk.num_samples
        if count >= MAX_SAMPLES:
            break
    t, tau, J = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    return t, tau, J


def _shifts(chunk: Recording, contact: TorqueContact, contact_torque: Array) -> list[float]:
    """Per contact at rest that moves the arm, the correlation of its torque with the shift."""
    correlations = []
    for stretch in stretches(contact.contact):
        begin = chunk.t[stretch.start]
        start, stop = np.searchsorted(chunk.t, (begin - _REST_TIMES[0], begin - _REST_TIMES[1]))
        if start == stop or contact.moving[start : stretch.stop].any():
            continue
        shift = chunk.q[stretch] - chunk.q[start:stop].mean(axis=0)
        is_finite = np.isfinite(shift + contact_torque[stretch]).all(axis=1)
        shift, torque = shift[is_finite], contact_torque[stretch][is_finite]
        if not len(shift) or np.abs(shift).max() < _LEAST_YIELD:
            continue
        size = float(np.sqrt((shift**2).sum() * (torque**2).sum()))
        correlations.append(float((shift * torque).sum()) / size)
    return correlations
