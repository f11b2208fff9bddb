"""A log on its uniform grid, chunk by chunk, and which of its samples count."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from wrenchsight.analyses.methods.reading.sample_screen import FAULT, SampleScreen
from wrenchsight.models.arrays import Array, Flags
from wrenchsight.models.estimation.estimator import EstimateBatch, WrenchEstimatorConfig
from wrenchsight.models.observers.sample_check import BEYOND, LESS
from wrenchsight.models.recordings.episodes_reader import LogReader
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.resampling import plausible_step, resample_chunks
from wrenchsight.models.robot.robot import Robot

ProgressCallback = Callable[[float, str], None]

CHUNK_SAMPLES = 1 << 16  # samples that are worked on at a time


class Part:
    """Progress of one pass within the whole."""

    def __init__(self, report: ProgressCallback, begin: float, end: float, what: str) -> None:
        self._report, self._begin, self._end, self._what = report, begin, end, what

    def __call__(self, fraction: float) -> None:
        self._report(self._begin + fraction * (self._end - self._begin), self._what)


def uniform_chunks(
    reader: LogReader,
    screen: SampleScreen | None,
    config: WrenchEstimatorConfig,
    max_gap: float,
    part: "Part",
) -> Iterator[Recording]:
    """The log on its uniform grid, some ten thousand samples at a time."""
    step = config.observer.time_step or None
    chunks = reader.chunks() if screen is None else screen.screened(reader.chunks())
    for chunk in resample_chunks(chunks, step, max_gap or None):
        for begin in range(0, chunk.num_samples, CHUNK_SAMPLES):
            yield chunk[begin : begin + CHUNK_SAMPLES]
        part(reader.progress)


def screen_of(robot: Robot, config: WrenchEstimatorConfig) -> SampleScreen | None:
    return SampleScreen(robot) if config.check_samples else None


def timed(config: WrenchEstimatorConfig, chunk: Recording) -> WrenchEstimatorConfig:
    """The configuration with the time step that the log suggests, unless it states one."""
    step = config.observer.time_step or float(plausible_step(chunk))
    return replace(config, observer=replace(config.observer, time_step=step))


def fault_of(chunk: Recording, batch: EstimateBatch) -> NDArray[np.int64]:
    """(N,) as `EstimateBatch.fault`, with what was found before the log was resampled."""
    found = chunk.extra.get(FAULT)
    if found is None:
        return batch.fault
    # An interpolated sample beside a missing one is missing, too.
    return np.asarray(batch.fault | np.where(found == 0.0, 0, BEYOND))


def marked_current(chunk: Recording) -> Array:
    """(N, n) A, inf in samples that were found BEYOND before the log was resampled."""
    found = chunk.extra.get(FAULT)
    if found is None:
        return chunk.current
    return np.asarray(np.where(found[:, None] > LESS, np.inf, chunk.current))


def measured(chunk: Recording, batch: EstimateBatch) -> Flags:
    return np.asarray(~chunk.dropout & (fault_of(chunk, batch) == 0))


def there(chunk: Recording, fault: NDArray[np.int64], tau_ext: Array, settled: int) -> Flags:
    """(N,) samples that were measured and, from index `settled` on, are read."""
    there = ~chunk.dropout & (fault == 0) & (np.arange(chunk.num_samples) >= settled)
    return np.asarray(there & np.isfinite(chunk.q + chunk.v + tau_ext).all(axis=1))
