"""A log on its uniform grid, chunk by chunk, and which of its samples count.

Samples are checked against the joints' limits before the log is resampled: interpolation would
spread one impossible sample over its neighbours, where no check notices it.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from wrenchsight.analyses.output.progress import ProgressCallback
from wrenchsight.models.estimation.estimator import EstimateBatch, WrenchEstimatorConfig
from wrenchsight.models.numerics.arrays import Array, Flags, contiguous
from wrenchsight.models.observers.sample_check import FAULT_BEYOND, OTHER_FAULT_WEIGHT, SampleCheck
from wrenchsight.models.recordings.episodes_reader import LogReader
from wrenchsight.models.recordings.recording import Recording, place_of
from wrenchsight.models.recordings.resampling import plausible_step, resample_chunks
from wrenchsight.models.robot.robot import Robot

CHUNK_SAMPLES = 1 << 16  # samples of one chunk
FAULT_SIGNAL = "sample fault"
"""Signal of `Recording.extra`: 1 where a sample is missing because it is impossible; resampled,
above 0 wherever such a sample would have counted."""


class PassProgress:
    """Progress of one pass over the log within the whole work.

    Args:
        report: takes the share of the whole work, 0 to 1, and the title of the pass.
        begin, end: shares of the whole work at which the pass begins and ends.
        title: title of the pass.
    """

    def __init__(self, report: ProgressCallback, begin: float, end: float, title: str) -> None:
        self._report, self._begin, self._end, self._title = report, begin, end, title

    def __call__(self, fraction: float) -> None:
        self._report(self._begin + fraction * (self._end - self._begin), self._title)


class SampleScreen:
    """Passes a log on chunk by chunk, with NaN and a drop-out in place of impossible samples.

    Args:
        robot: whose limits count.
    """

    def __init__(self, robot: Robot) -> None:
        self._check = SampleCheck(robot, jitter=True)
        self._state = self._check.initial_state()
        self._last_t: float | None = None
        self._num_impossible = 0
        self._first_place = ""

    @property
    def notices(self) -> tuple[str, ...]:
        """How many samples were left out, in one sentence; none where all count."""
        if not self._num_impossible:
            return ()
        samples = "1 sample" if self._num_impossible == 1 else f"{self._num_impossible} samples"
        return (
            f"{samples} beyond the joints' limits, taken as missing (first: {self._first_place}); "
            "check the log there",
        )

    def screened(self, chunks: Iterable[Recording]) -> Iterator[Recording]:
        """Yields the same chunks without their impossible samples.

        These are NaN and a drop-out; FAULT_SIGNAL is 1 where a sample is beyond a limit,
        OTHER_FAULT_WEIGHT where it is impossible otherwise, else 0. Resampling, which follows,
        spreads it over the samples that would have been interpolated from it.
        """
        for chunk in chunks:
            previous_t = chunk.t[0] if self._last_t is None else self._last_t
            period = np.diff(chunk.t, prepend=previous_t)
            self._last_t = float(chunk.t[-1])
            # Time that stands still or runs backwards is refused later, with its line; until then
            # a ns keeps the quotients finite. The log's first sample, of period 0, follows none.
            q, v, current = contiguous(chunk.q, chunk.v, chunk.current)
            (q, v, current), codes = self._check.run(
                self._state, q, v, current, np.maximum(period, 1e-9)
            )
            is_impossible = (
                _is_removed(chunk.q, q)
                | _is_removed(chunk.v, v)
                | _is_removed(chunk.current, current)
            )
            if is_impossible.any() and not self._num_impossible:
                self._first_place = place_of(chunk, int(np.argmax(is_impossible)))
            self._num_impossible += int(is_impossible.sum())
            fault = np.where(
                is_impossible, np.where(codes & FAULT_BEYOND, 1.0, OTHER_FAULT_WEIGHT), 0.0
            )
            yield replace(
                chunk,
                q=q,
                v=v,
                current=current,
                dropout=chunk.dropout | is_impossible,
                extra={**chunk.extra, FAULT_SIGNAL: fault},
            )


def uniform_chunks(
    reader: LogReader,
    screen: SampleScreen | None,
    config: WrenchEstimatorConfig,
    max_gap: float,
    progress: PassProgress,
) -> Iterator[Recording]:
    """The log on its uniform grid, at most CHUNK_SAMPLES at a time.

    Args:
        screen: check for impossible samples; None: samples are not checked.
        max_gap: s, longest gap that is bridged; 0: the default.
    """
    step = config.observer.time_step or None
    chunks = reader.chunks() if screen is None else screen.screened(reader.chunks())
    for chunk in resample_chunks(chunks, step, max_gap or None):
        for begin in range(0, chunk.num_samples, CHUNK_SAMPLES):
            yield chunk[begin : begin + CHUNK_SAMPLES]
        progress(reader.progress)


def screen_of(robot: Robot, config: WrenchEstimatorConfig) -> SampleScreen | None:
    """The check of samples that the configuration requests, if any."""
    return SampleScreen(robot) if config.check_samples else None


def completed(
    config: WrenchEstimatorConfig,
    chunk: Recording,
    resolution: list[float],
    prior: tuple[float, float] | None,
) -> WrenchEstimatorConfig:
    """The configuration with the values that it leaves to the log.

    Args:
        chunk: chunk of the log, on its grid, which gives the time step.
        resolution: (n,) rad, of the encoders.
        prior: sds of force and moment, N and N m; None: the configuration states it.
    """
    if not config.observer.time_step:
        config = config.with_time_step(float(plausible_step(chunk)))
    reconstruction = config.reconstruction
    if prior is not None:
        reconstruction = reconstruction.with_prior(*prior)
    return replace(config, reconstruction=reconstruction, position_resolution=resolution)


def fault_of(chunk: Recording, batch: EstimateBatch) -> NDArray[np.int64]:
    """(N,) as `EstimateBatch.fault`, with the faults from before the log was resampled."""
    log_fault = chunk.extra.get(FAULT_SIGNAL)
    if log_fault is None:
        return batch.fault
    # An interpolated sample beside a missing one is missing, too.
    return np.asarray(batch.fault | np.where(log_fault == 0.0, 0, FAULT_BEYOND))


def marked_current(chunk: Recording) -> Array:
    """(N, n) A, inf in samples that were FAULT_BEYOND before the log was resampled."""
    log_fault = chunk.extra.get(FAULT_SIGNAL)
    if log_fault is None:
        return chunk.current
    return np.asarray(np.where(log_fault[:, None] > OTHER_FAULT_WEIGHT, np.inf, chunk.current))


def is_measured(chunk: Recording, batch: EstimateBatch) -> Flags:
    """(N,) samples that are neither missing nor faulty."""
    return np.asarray(~chunk.dropout & (fault_of(chunk, batch) == 0))


def is_usable(chunk: Recording, fault: NDArray[np.int64], tau_ext: Array, settled: int) -> Flags:
    """(N,) samples that were measured and, from index `settled` on, have a reading."""
    is_settled = np.arange(chunk.num_samples) >= settled
    is_finite = np.isfinite(chunk.q + chunk.v + tau_ext).all(axis=1)
    return np.asarray(~chunk.dropout & (fault == 0) & is_settled & is_finite)


def _is_removed(logged: Array, checked: Array) -> Flags:
    """(N,) samples that lack a number after the check."""
    return np.asarray((np.isnan(checked) & ~np.isnan(logged)).any(axis=1))
