"""A log on its uniform grid, chunk by chunk, and which of its samples count.

Samples are checked against what the joints can do before the log is resampled: interpolation would
spread one absurd sample over its neighbours, where it is no longer noticed.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.estimation.estimator import EstimateBatch, WrenchEstimatorConfig
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.observers.sample_check import BEYOND, LESS, SampleCheck
from wrenchsight.models.recordings.episodes_reader import LogReader
from wrenchsight.models.recordings.recording import Recording, place_of
from wrenchsight.models.recordings.resampling import plausible_step, resample_chunks
from wrenchsight.models.robot.robot import Robot

ProgressCallback = Callable[[float, str], None]

CHUNK_SAMPLES = 1 << 16  # samples that are worked on at a time
FAULT = "sample fault"
"""Signal of `Recording.extra`: 1 where a sample is missing because it is impossible; resampled,
above 0 wherever such a sample would have counted."""


class Part:
    """Progress of one pass within the whole."""

    def __init__(self, report: ProgressCallback, begin: float, end: float, what: str) -> None:
        self._report, self._begin, self._end, self._what = report, begin, end, what

    def __call__(self, fraction: float) -> None:
        self._report(self._begin + fraction * (self._end - self._begin), self._what)


class SampleScreen:
    """Passes a log on chunk by chunk, with NaN and a drop-out in place of impossible samples.

    Args:
        robot: whose limits count.
    """

    def __init__(self, robot: Robot) -> None:
        self._check = SampleCheck(robot, jitter=True)
        self._state = self._check.initial_state()
        self._last: float | None = None
        self._count = 0
        self._first = ""

    @property
    def notices(self) -> tuple[str, ...]:
        """What was left out, in one sentence; none where nothing was."""
        if not self._count:
            return ()
        samples = "1 sample is" if self._count == 1 else f"{self._count} samples are"
        return (
            f"{samples} beyond what the joints can do and left out as missing (the first in "
            f"{self._first})",
        )

    def screened(self, chunks: Iterable[Recording]) -> Iterator[Recording]:
        """Yields the same chunks without their impossible samples."""
        for chunk in chunks:
            before = chunk.t[0] if self._last is None else self._last
            period = np.diff(chunk.t, prepend=before)
            self._last = float(chunk.t[-1])
            # Time that stands still or runs backwards is refused later, with its line.
            (q, v, current), codes = self._check.run(
                self._state, chunk.q, chunk.v, chunk.current, np.maximum(period, 1e-9)
            )
            wrong = _lost(chunk.q, q) | _lost(chunk.v, v) | _lost(chunk.current, current)
            if wrong.any() and not self._count:
                self._first = place_of(chunk, int(np.argmax(wrong)))
            self._count += int(wrong.sum())
            fault = np.where(wrong, np.where(codes & BEYOND, 1.0, LESS), 0.0)
            yield replace(
                chunk,
                q=q,
                v=v,
                current=current,
                dropout=chunk.dropout | wrong,
                extra={**chunk.extra, FAULT: fault},
            )


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


def completed(
    config: WrenchEstimatorConfig,
    chunk: Recording,
    resolution: list[float],
    prior: tuple[float, float] | None,
) -> WrenchEstimatorConfig:
    """The configuration with what the log says where it says nothing itself.

    Args:
        chunk: of the log, on its grid: whence the time step.
        resolution: (n,) rad, of the encoders.
        prior: sds of force and moment, N and N m; None: left open.
    """
    observer, reconstruction = config.observer, config.reconstruction
    if not observer.time_step:
        observer = replace(observer, time_step=float(plausible_step(chunk)))
    if prior is not None:
        reconstruction = reconstruction.with_prior(*prior)
    return replace(
        config,
        observer=observer,
        reconstruction=reconstruction,
        position_resolution=resolution,
    )


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


def _lost(before: Array, after: Array) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """(N,) which samples lack a number that they had."""
    return np.asarray((np.isnan(after) & ~np.isnan(before)).any(axis=1))
