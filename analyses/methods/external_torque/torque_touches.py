"""The contacts of a log of external torque: since when, how sure, and on which link.

The torque's error and its baseline come from the log itself (`models.detection.torque_contact`).
Where the log holds positions, what a contact moves tells the torque's sign besides: an arm at rest
yields along the torque that acts on it.
"""

from dataclasses import dataclass

import numpy as np

from wrenchsight.analyses.methods.estimate.contact_episodes import ContactEpisodes
from wrenchsight.analyses.methods.estimate.contact_places import (
    ContactTorque,
    PlacedContacts,
    judge_places,
    stretches,
)
from wrenchsight.analyses.methods.external_torque.torque_log import TorqueLog
from wrenchsight.models.detection.contact_detector import Detection
from wrenchsight.models.detection.torque_contact import (
    ANEW,
    MOST_SAMPLES,
    TorqueContact,
    TorqueContactDetector,
    first_baseline,
    learn_torque_error,
)
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.recording import Recording

_BEFORE = (0.2, 0.08)  # s before a contact, between which the arm is where it rests
_FEWEST = 3  # contacts that the sign is told by
_AGREES = 0.5  # least correlation, in size, that tells it
_LOADED = 1.5  # sds of what a sensor reads, beyond which a joint is loaded
_LEAST_YIELD = 2e-6  # rad (m); less is rounding


@dataclass(frozen=True)
class TorqueSign:
    """How torque and the motion that it causes go together.

    Attributes:
        contacts: of an arm at rest that shifted it.
        correlation: of torque and shift over the joints, median of these; NaN where there are few.
    """

    contacts: int
    correlation: float

    @property
    def contradicts(self) -> bool:
        """Whether the arm moves against the torque that is said to push it."""
        return self.correlation < -_AGREES

    def sentence(self, name: str, exerted_on: str) -> str:
        """What to tell a user of a log whose torques were read as exerted on `exerted_on`."""
        other = "environment" if exerted_on == "robot" else "robot"
        return (
            f"{name}: the sign of the external torque is contradicted: touched at rest the arm "
            f"moves against it (correlation {self.correlation:.2f} over {self.contacts} contacts), "
            f"so that forces read reversed; say --torque-sign {other}"
        )


class TorqueTouches:
    """Finds the contacts of a log, chunk by chunk, and where each of them is.

    Reads the beginning of the log to learn its error.
    """

    def __init__(self, log: TorqueLog) -> None:
        t, tau, J = _beginning(log)
        self.error = learn_torque_error(t, tau, J)
        self._detector = TorqueContactDetector(self.error, first_baseline(t, tau))
        self.episodes = ContactEpisodes(log.num_joints, ANEW)
        self._shifts: list[float] = []

    def take(self, chunk: Recording, J: Array, tau_ext: Array) -> PlacedContacts:
        """Takes N samples: (N, 6, n), (N, n) N m.

        Returns:
            As `judge_places`.
        """
        found = self._detector.run(chunk.t, tau_ext, J)
        alone = tau_ext - found.baseline
        nothing = np.zeros(chunk.num_samples, bool)
        detection = Detection(
            statistic=found.statistic,
            contact=found.contact,
            misfit=nothing,
            link=nothing.astype(np.int8),
            rest=~found.moving,
            out_of_range=nothing,
        )
        if chunk.num_joints:
            self._shifts += _shifts(chunk, found, alone)
        torque = ContactTorque(chunk.t, J, alone, found.sd)
        return judge_places(detection, torque, loaded=_LOADED)

    @property
    def sign(self) -> TorqueSign:
        """Of all that was taken."""
        count = len(self._shifts)
        return TorqueSign(count, float(np.median(self._shifts)) if count >= _FEWEST else np.nan)


def _beginning(log: TorqueLog) -> tuple[Array, Array, Array]:
    """s, N m and Jacobians of at most MOST_SAMPLES rows."""
    parts, count = [], 0
    for chunk, J, tau_ext in log.chunks(log.reader()):
        parts.append((chunk.t, tau_ext, J))
        count += chunk.num_samples
        if count >= MOST_SAMPLES:
            break
    t, tau, J = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    return t, tau, J


def _shifts(chunk: Recording, found: TorqueContact, alone: Array) -> list[float]:
    """Per contact at rest that moves the arm, the correlation of its torque with the shift."""
    correlations = []
    for piece in stretches(found.contact):
        begin = chunk.t[piece.start]
        first, last = np.searchsorted(chunk.t, (begin - _BEFORE[0], begin - _BEFORE[1]))
        if first == last or found.moving[first : piece.stop].any():
            continue
        shift = chunk.q[piece] - chunk.q[first:last].mean(axis=0)
        known = np.isfinite(shift + alone[piece]).all(axis=1)
        shift, torque = shift[known], alone[piece][known]
        if not len(shift) or np.abs(shift).max() < _LEAST_YIELD:
            continue
        size = float(np.sqrt((shift**2).sum() * (torque**2).sum()))
        correlations.append(float((shift * torque).sum()) / size)
    return correlations
