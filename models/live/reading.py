"""What is read of one sample, as one row of numbers, which goes from process to process."""

from dataclasses import dataclass

import numpy as np

from wrenchsight.models.arrays import Array
from wrenchsight.models.rigid_body.spatial_vectors import FORCE_FIRST

_FIELDS = (
    "t",
    "received",
    "published",
    "valid",
    "contact",
    "misfit",
    "link",
    "rest",
    "out_of_range",
    "fault",
    "dropout",
    "running",
    "statistic",
    "condition_number",
)
_PLACE = {name: k for k, name in enumerate(_FIELDS)}
_WRENCH = len(_FIELDS)
_COVARIANCE = _WRENCH + 6
_JOINTS = _COVARIANCE + 36
_PUBLISHED = _PLACE["published"]
_VALID, _CONTACT, _MISFIT = (_PLACE[name] for name in ("valid", "contact", "misfit"))


def row_size(num_joints: int) -> int:
    """Numbers of a reading of an arm with n joints."""
    return _JOINTS + 2 * num_joints


@dataclass(frozen=True, eq=False)
class Reading:
    """The reading of one sample of the uniform grid.

    Attributes:
        row: (row_size,) all numbers.
    """

    row: Array

    @classmethod
    def of(
        cls, wrench: Array, covariance: Array, tau_ext: Array, q: Array, **rest: float
    ) -> "Reading":
        """Puts a row together; `rest` are the fields by their names, 0 where one is left out."""
        row = np.zeros(row_size(len(q)))
        for name, value in rest.items():
            row[_PLACE[name]] = value
        row[_WRENCH:_COVARIANCE] = wrench
        row[_COVARIANCE:_JOINTS] = covariance.ravel()
        row[_JOINTS:] = np.concatenate([tau_ext, q])
        return cls(row)

    def unusable(self, received: float) -> "Reading":
        """The same, not to be used: the stream stands still, or the robot does."""
        row = self.row.copy()
        row[[_VALID, _CONTACT, _MISFIT]] = 0.0
        row[_PLACE["received"]] = received
        return Reading(row)

    def _number(self, name: str) -> float:
        return self.row.item(_PLACE[name])

    @property
    def t(self) -> float:
        """s, the controller's clock."""
        return self.row.item(0)

    @property
    def received(self) -> float:
        """s, monotonic clock of this computer, of the sample that the reading rests on."""
        return self.row.item(1)

    @property
    def latency(self) -> float:
        """s, from the sample's coming to the reading's going; 0 before it goes."""
        return self.row.item(_PUBLISHED) - self.row.item(1) if self.row.item(_PUBLISHED) else 0.0

    def publish(self, now: float) -> None:
        """Notes when the reading goes to those who want it, s."""
        self.row[_PUBLISHED] = now

    @property
    def valid(self) -> bool:
        """Whether it may be used; see `models.estimation.wrench.WrenchEstimate`."""
        return self.row.item(_VALID) == 1.0

    @property
    def contact(self) -> bool:
        """As `models.detection.contact_detector.Detection`; so are the next ones."""
        return self.row.item(_CONTACT) == 1.0

    @property
    def misfit(self) -> bool:
        """A contact that no force at E explains."""
        return self.row.item(_MISFIT) == 1.0

    @property
    def link(self) -> int:
        """The link whose contact explains a misfit; 0: not known."""
        return int(self._number("link"))

    @property
    def rest(self) -> bool:
        """No joint moves."""
        return self._number("rest") == 1.0

    @property
    def out_of_range(self) -> bool:
        """A joint faster or more loaded than the model was fitted on."""
        return self._number("out_of_range") == 1.0

    @property
    def statistic(self) -> float:
        """Of contact, in units of the level above which it begins."""
        return self._number("statistic")

    @property
    def fault(self) -> int:
        """What is wrong with the sample, see `models.observers.sample_check`; 0: nothing."""
        return int(self._number("fault"))

    @property
    def dropout(self) -> bool:
        """The sample was bridged, or lacks a number."""
        return self._number("dropout") == 1.0

    @property
    def running(self) -> bool:
        """Whether the robot runs."""
        return self._number("running") == 1.0

    @property
    def condition_number(self) -> float:
        """Of J, in m and rad."""
        return self._number("condition_number")

    @property
    def wrench(self) -> Array:
        """(6,) F_E_W = [mx my mz fx fy fz] in N m and N: by the environment, at E, axes of W."""
        return self.row[_WRENCH:_COVARIANCE]

    @property
    def covariance(self) -> Array:
        """(6, 6) of the wrench."""
        return self.row[_COVARIANCE:_JOINTS].reshape(6, 6)

    @property
    def sd(self) -> Array:
        """(6,) of the wrench, rotation first."""
        return np.asarray(np.sqrt(self.row[_COVARIANCE:_JOINTS:7]))

    @property
    def tau_ext(self) -> Array:
        """(n,) N m, positive along the motion it causes."""
        return self.row[_JOINTS : (_JOINTS + len(self.row)) // 2]

    @property
    def q(self) -> Array:
        """(n,) rad or m."""
        return self.row[(_JOINTS + len(self.row)) // 2 :]

    @property
    def force_first(self) -> Array:
        """(12,) fx fy fz mx my mz, and their sds: the order of files and messages."""
        return np.concatenate([self.wrench[FORCE_FIRST], self.sd[FORCE_FIRST]])
