"""Reading of one sample: one row of numbers, which passes from process to process."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Generic, TypeVar

import numpy as np

from wrenchsight.models.estimation.invalid import STREAM_LATE, first_reason
from wrenchsight.models.numerics.arrays import Array, Record, record_type
from wrenchsight.models.rigid_body.spatial_vectors import FORCE_FIRST


@cache
def reading_type(num_joints: int) -> np.dtype[np.void]:
    """The type of a reading's row; what the numbers are, the attributes of Reading say."""
    return record_type(
        t=(),
        received=(),
        published=(),
        invalid=(),
        contact=(),
        misfit=(),
        link=(),
        rest=(),
        out_of_range=(),
        fault=(),
        dropout=(),
        running=(),
        statistic=(),
        condition_number=(),
        wrench=(6,),
        covariance=(6, 6),
        tau_ext=(num_joints,),
        q=(num_joints,),
    )


FLAGS = (
    "valid",
    "invalid",
    "contact",
    "misfit",
    "link",
    "rest",
    "out_of_range",
    "fault",
    "dropout",
    "running",
)
"""Attributes of a reading that others are sent as whole numbers: 1 or 0, but for the number of the
`link` and the sums of bits in `invalid` and `fault`."""
_Kind = TypeVar("_Kind")


def row_size(num_joints: int) -> int:
    """Numbers of a reading of an arm with n joints."""
    return reading_type(num_joints).itemsize // np.dtype(np.float64).itemsize


def _joints_of(size: int) -> int:
    """The number of joints of a row of `row_size` numbers: the inverse of it."""
    return (size - row_size(0)) // (row_size(1) - row_size(0))


class _Field(Generic[_Kind]):
    """A number of the row, by its name."""

    def __init__(self, kind: Callable[[float], _Kind]) -> None:
        self._kind = kind

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __get__(self, reading: "Reading", owner: type) -> _Kind:
        return self._kind(reading.numbers[self._name].item())


@dataclass(frozen=True, eq=False)
class Reading:
    """The reading of one sample of the uniform grid.

    Attributes:
        row: (row_size,) all numbers, contiguous; `numbers` gives them under their names.
    """

    row: Array

    @classmethod
    def of(
        cls, wrench: Array, covariance: Array, tau_ext: Array, q: Array, **fields: float
    ) -> "Reading":
        """Makes a row; `fields` are numbers by name, 0 where one is left out."""
        reading = cls(np.zeros(row_size(len(q))))
        signals = {"wrench": wrench, "covariance": covariance, "tau_ext": tau_ext, "q": q}
        for name, value in (fields | signals).items():
            reading.numbers[name] = value
        return reading

    def unusable(self, received: float) -> "Reading":
        """The same reading, not valid: the stream or the robot has stopped."""
        reading = Reading(self.row.copy())
        numbers = reading.numbers
        numbers["invalid"] = self.invalid | STREAM_LATE
        numbers["contact"], numbers["misfit"] = 0.0, 0.0
        numbers["received"] = received
        return reading

    @property
    def numbers(self) -> Record:
        """(1,) of `reading_type`: the row's numbers under their names, as views of it."""
        return np.frombuffer(self.row, reading_type(_joints_of(len(self.row))))

    t = _Field(float)
    """s, the controller's clock."""
    received = _Field(float)
    """s, monotonic clock of this computer, of the sample that the reading rests on."""
    published = _Field(float)
    """s, of the same clock, when the reading was published; 0 before."""
    invalid = _Field(int)
    """Why it may not be used, a sum of codes of `models.estimation.invalid`; 0: it may."""
    contact = _Field(bool)
    """As `models.detection.contact_detector.Detection`; so are the next ones."""
    misfit = _Field(bool)
    """A contact that no force at E explains."""
    link = _Field(int)
    """The link whose contact explains a misfit; 0: not known."""
    rest = _Field(bool)
    """No joint moves."""
    out_of_range = _Field(bool)
    """A joint faster or more loaded than the model was fitted on."""
    statistic = _Field(float)
    """Of contact, in units of the level above which it begins."""
    fault = _Field(int)
    """What is wrong with the sample, see `models.observers.sample_check`; 0: nothing."""
    dropout = _Field(bool)
    """The sample was bridged, or lacks a number."""
    running = _Field(bool)
    """Whether the robot runs."""
    condition_number = _Field(float)
    """Of J, in m and rad."""

    @property
    def valid(self) -> bool:
        """Whether it may be used."""
        return self.invalid == 0

    @property
    def reason(self) -> str:
        """Why it may not be used, one word; empty where it may."""
        words = first_reason(self.invalid)
        return "" if words is None else words.key

    @property
    def latency(self) -> float:
        """s, from receipt of the sample to publication of the reading; 0 before."""
        return self.published - self.received if self.published else 0.0

    def publish(self, now: float) -> None:
        """Notes the time of publication, s."""
        self.numbers["published"] = now

    @property
    def wrench(self) -> Array:
        """(6,) F_E_W = [mx my mz fx fy fz] in N m and N: by the environment, at E, axes of W."""
        return np.asarray(self.numbers["wrench"][0])

    @property
    def covariance(self) -> Array:
        """(6, 6) of the wrench."""
        return np.asarray(self.numbers["covariance"][0])

    @property
    def sd(self) -> Array:
        """(6,) of the wrench, rotation first."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance)))

    @property
    def tau_ext(self) -> Array:
        """(n,) N m, positive along the motion it causes."""
        return np.asarray(self.numbers["tau_ext"][0])

    @property
    def q(self) -> Array:
        """(n,) rad or m."""
        return np.asarray(self.numbers["q"][0])

    @property
    def force_first(self) -> Array:
        """(12,) fx fy fz mx my mz, and their sds: the order of files and messages."""
        return np.concatenate([self.wrench[FORCE_FIRST], self.sd[FORCE_FIRST]])
