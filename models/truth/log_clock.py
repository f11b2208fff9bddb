"""The clock of a log: when its rows were really taken."""

from dataclasses import replace

import numpy as np

from models.arrays import Array
from models.recordings.recording import Recording
from models.robot.truth_config import ClockConfig


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
    return replace(
        recording,
        q=_at(taken, recording.t, recording.q),
        v=_at(taken, recording.t, recording.v),
        current=_at(taken - clock.latency, recording.t, recording.current),
    )


def _at(times: Array, t: Array, signal: Array) -> Array:
    columns = [np.interp(times, t, signal[:, j]) for j in range(signal.shape[1])]
    return np.stack(columns, axis=1)
