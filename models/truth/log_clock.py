"""The clock of a log: jitter and latency of its rows."""

from dataclasses import replace

import numpy as np

from wrenchsight.models.numerics.arrays import Array, contiguous
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.truth_config import ClockConfig


def clocked(recording: Recording, clock: ClockConfig | None, seed: int) -> Recording:
    """The recording as a log with this clock shows it: the same times, samples of other moments.

        q, v at t_k + jitter_k,   current at t_k + jitter_k - latency,   jitter ~ N(0, jitter_sd)

    interpolated linearly. Before the log's first moment its first sample is used.

    Args:
        recording: at even steps, or any.
        clock: None leaves the recording as it is.
        seed: seed of the jitter.
    """
    if clock is None or (clock.latency == 0.0 and clock.jitter_sd == 0.0):
        return recording
    jitter = np.random.default_rng([seed, 23]).standard_normal(recording.num_samples)
    taken = recording.t + clock.jitter_sd * jitter
    t = contiguous(recording.t)[0]
    return replace(
        recording,
        q=_interpolated(taken, t, recording.q),
        v=_interpolated(taken, t, recording.v),
        current=_interpolated(taken - clock.latency, t, recording.current),
    )


def _interpolated(times: Array, t: Array, signal: Array) -> Array:
    """`signal` (T, n) of moments t (T,) at other times (N,): `np.interp`, column by column."""
    out = np.empty((len(times), signal.shape[1]))
    _interpolate(times, t, contiguous(signal)[0], out)
    return out


@kernel
def _interpolate(times: Array, t: Array, signal: Array, out: Array) -> None:
    """Writes `out` (N, n). The search for each time starts at the row of the time before."""
    last_row, k = t.shape[0] - 1, 0
    for i in range(times.shape[0]):
        time = times[i]
        while k < last_row and t[k + 1] <= time:
            k += 1
        while k > 0 and t[k] > time:
            k -= 1
        if time <= t[0] or k == last_row:
            for j in range(signal.shape[1]):
                out[i, j] = signal[k, j]
            continue
        step, elapsed = t[k + 1] - t[k], time - t[k]
        for j in range(signal.shape[1]):
            out[i, j] = (signal[k + 1, j] - signal[k, j]) / step * elapsed + signal[k, j]
