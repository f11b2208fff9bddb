"""A reading and a sensor side by side, as means over short blocks of time."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from wrenchsight.models.numerics.arrays import Array, Flags

BLOCK: Final = 0.02  # s
WINDOW: Final = 5  # blocks: forces are judged over 0.1 s


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
        """One block in so many."""
        own = (getattr(self, name)[::stride] for name in self.__dataclass_fields__)
        return SensorLog(*own)


class SensorLogCollector:
    """Gathers a `SensorLog` from a stream; some 20 MB an hour.

    Args:
        time_step: s, between samples.
    """

    def __init__(self, time_step: float) -> None:
        self.samples = max(1, round(BLOCK / time_step))
        self._kept: list[tuple[Array, ...]] = []
        self._rest: tuple[Array, ...] | None = None

    def add(self, *signals: Array) -> None:
        """Takes the next samples: t, reading, sd, valid, R_WE, v, sensor, as `SensorLog`.

        v is (N, n) rad/s, of the joints.
        """
        parts = tuple(np.asarray(signal, float) for signal in signals)
        if self._rest is not None:
            parts = tuple(np.concatenate(pair) for pair in zip(self._rest, parts, strict=True))
        count = len(parts[0]) // self.samples
        whole = count * self.samples
        self._rest = tuple(part[whole:] for part in parts)
        if not count:
            return
        blocks = [p[:whole].reshape(count, self.samples, *p.shape[1:]) for p in parts]
        t, reading, sd, valid, R_WE, v, sensor = blocks
        self._kept.append(
            (
                t.mean(axis=1),
                reading.mean(axis=1),
                sd.mean(axis=1),
                valid.min(axis=1),
                R_WE[:, self.samples // 2],
                np.abs(v.mean(axis=1)).max(axis=1),
                sensor.mean(axis=1),
            )
        )

    def log(self) -> SensorLog | None:
        """All blocks so far; None where there is none."""
        if not self._kept:
            return None
        t, reading, sd, valid, R_WE, speed, sensor = (
            np.concatenate(column) for column in zip(*self._kept, strict=True)
        )
        return SensorLog(t, reading, sd, valid == 1.0, R_WE, speed, sensor)


def joined_logs(logs: Sequence[SensorLog]) -> SensorLog:
    """Logs one after the other on one clock: for what a sensor has in common in all of them."""
    end, clocks = 0.0, []
    for log in logs:
        clocks.append(log.t - log.t[0] + end)
        end = clocks[-1][-1] + log.step
    if len(logs) == 1:
        return logs[0]
    names = [name for name in SensorLog.__dataclass_fields__ if name != "t"]
    parts = {name: np.concatenate([getattr(log, name) for log in logs]) for name in names}
    return SensorLog(t=np.concatenate(clocks), **parts)
