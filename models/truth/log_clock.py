"""The clock of a log: when its rows were really taken."""

from dataclasses import replace

import numpy as np

from wrenchsight.models.arrays import Array, contiguous
from wrenchsight.models.kernel import kernel
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.truth_config import ClockConfig


def clocked(recording: Recording, clock: ClockConfig | None, seed: int) -> Recording:
    """The recording as a log with this clock has it: the same times, samples of other moments.

        q, v at t_k + jitter_k,   current at t_k + jitter_k - latency,   jitter ~ N(0, jitter_sd)

    interpolated linearly. Before the log's first moment its first sample is used.

    Args:
        recording: at even steps, or any.
        clock: None leaves the recording as it is.
        seed: of the jitter.
    """
    if clock is None or (clock.latency == 0.0 and clock.jitter_sd == 0.0):
        return recording
    jitter = np.random.default_rng([seed, 23]).standard_normal(recording.num_samples)
    taken = recording.t + clock.jitter_sd * jitter
    t = contiguous(recording.t)[0]
    return replace(
        recording,
        q=_at(taken, t, recording.q),
        v=_at(taken, t, recording.v),
        current=_at(taken - clock.latency, t, recording.current),
    )


def _at(times: Array, t: Array, signal: Array) -> Array:
    """`signal` (T, n) of moments t (T,) at other times (N,): `np.interp`, column by column."""
    out = np.empty((len(times), signal.shape[1]))
    _interpolate(times, t, contiguous(signal)[0], out)
    return out


@kernel
def _interpolate(times: Array, t: Array, signal: Array, out: Array) -> None:
    """Writes `out` (N, n). Each time is looked for from where the one before it was found."""
    last, k = t.shape[0] - 1, 0
    for i in range(times.shape[0]):
        time = times[i]
        while k < last and t[k + 1] <= time:
            k += 1
        while k > 0 and t[k] > time:
            k -= 1
        if time <= t[0] or k == last:
            for j in range(signal.shape[1]):
                out[i, j] = signal[k, j]
            continue
        step, past = t[k + 1] - t[k], time - t[k]
        for j in range(signal.shape[1]):
            out[i, j] = (signal[k + 1, j] - signal[k, j]) / step * past + signal[k, j]
