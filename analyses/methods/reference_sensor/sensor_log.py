"""A reading and a sensor side by side, as means over short blocks of time."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from wrenchsight.models.numerics.arrays import Array, Flags

BLOCK_TIME: Final = 0.02  # s
WINDOW_BLOCKS: Final = 5  # blocks: forces are judged over 0.1 s


@dataclass(frozen=True, eq=False)
class SensorLog:
    """N successive blocks of a log.

    Attributes:
        t: (N,) s.
        reading: (N, 6) wrench on the robot at E in axes of W, force first; N, N m.
        sd: (N, 6) as stated.
        valid: (N,).
        R_WE: (N, 3, 3) axes of the tool.
        speed: (N,) rad/s, of the fastest joint.
        sensor: (N, k) as logged; k is 1, 3 or 6, force first.
    """

    t: Array
    reading: Array
    sd: Array
    valid: Flags
    R_WE: Array
    speed: Array
    sensor: Array

    @property
    def step(self) -> float:
        """s between blocks."""
        return float(np.median(np.diff(self.t)))

    def every(self, stride: int) -> "SensorLog":
        """Every `stride`-th block."""
        names = self.__dataclass_fields__
        return SensorLog(**{name: getattr(self, name)[::stride] for name in names})


class SensorSamples(NamedTuple):
    """N successive samples of a reading and a sensor; fields as `SensorLog`, but for v.

    Attributes:
        v: (N, n) rad/s, of the joints.
    """

    t: Array
    reading: Array
    sd: Array
    valid: Array
    R_WE: Array
    v: Array
    sensor: Array

    def rows(self, rows: slice) -> "SensorSamples":
        """Some of the samples."""
        return SensorSamples._make(signal[rows] for signal in self)

    def followed_by(self, later: "SensorSamples") -> "SensorSamples":
        """The samples of both."""
        pairs = zip(self, later, strict=True)
        return SensorSamples._make(np.concatenate(pair) for pair in pairs)


class SensorLogCollector:
    """Gathers a `SensorLog` from a stream; some 20 MB an hour.

    Args:
        time_step: s, between samples.

    Attributes:
        samples: samples of a block.
    """

    def __init__(self, time_step: float) -> None:
        self.samples = max(1, round(BLOCK_TIME / time_step))
        self._blocks: list[SensorLog] = []
        self._unfinished: SensorSamples | None = None  # samples that do not fill a block yet

    def add(self, samples: SensorSamples) -> None:
        """Takes the next samples."""
        samples = SensorSamples._make(np.asarray(signal, float) for signal in samples)
        if self._unfinished is not None:
            samples = self._unfinished.followed_by(samples)
        count = len(samples.t) // self.samples
        self._unfinished = samples.rows(slice(count * self.samples, None))
        if count:
            self._blocks.append(self._blocks_of(samples, count))

    def _blocks_of(self, samples: SensorSamples, count: int) -> SensorLog:
        """The first `count` blocks of the samples."""
        size = self.samples
        whole = samples.rows(slice(0, count * size))
        blocks = SensorSamples._make(
            signal.reshape(count, size, *signal.shape[1:]) for signal in whole
        )
        return SensorLog(
            t=blocks.t.mean(axis=1),
            reading=blocks.reading.mean(axis=1),
            sd=blocks.sd.mean(axis=1),
            valid=blocks.valid.min(axis=1) == 1.0,
            R_WE=blocks.R_WE[:, size // 2],
            speed=np.abs(blocks.v.mean(axis=1)).max(axis=1),
            sensor=blocks.sensor.mean(axis=1),
        )

    def log(self) -> SensorLog | None:
        """All blocks so far; None where there is none."""
        if not self._blocks:
            return None
        return _concatenated(self._blocks, np.concatenate([log.t for log in self._blocks]))


def joined_logs(logs: Sequence[SensorLog]) -> SensorLog:
    """Logs one after the other on one clock: for what a sensor has in common in all of them."""
    if len(logs) == 1:
        return logs[0]
    end = 0.0
    clocks = []
    for log in logs:
        clocks.append(log.t - log.t[0] + end)
        end = clocks[-1][-1] + log.step
    return _concatenated(logs, np.concatenate(clocks))


def _concatenated(logs: Sequence[SensorLog], t: Array) -> SensorLog:
    """The blocks of all logs, over the time t."""
    names = [name for name in SensorLog.__dataclass_fields__ if name != "t"]
    columns = {name: np.concatenate([getattr(log, name) for log in logs]) for name in names}
    return SensorLog(t=t, **columns)
