"""Joint velocities differentiated from positions, without delay, chunk by chunk.

The velocity is the derivative of a cubic, fitted by least squares to the samples around each one
(Savitzky and Golay, Analytical Chemistry 36, 1964). The same filter is applied to q and t:

    v_k = sum_i c_i q_{k+i} / sum_i c_i t_{k+i},   i = -m .. m

c is odd, so that the filter has zero phase. Dividing by the same sum over t makes it exact for a
joint that moves evenly, however the sampling jitters.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import cache

import numpy as np

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.recording import Recording, concatenated

HALF_WINDOW_S = 0.03
"""Half of the window around a sample. The velocity then differs from the drives' velocity by 3 to 4
mrad/s on a UR10e at 100 Hz, about the noise of the latter, and by 0.05 of 11.5 rad/s on a Staubli
TX40 at full speed."""
_LEAST_HALF_WINDOW = 4  # samples: a cubic through fewer repeats the encoder's steps
LEAST_WINDOW = 2 * _LEAST_HALF_WINDOW + 1
_SPLINE_DEGREE = 3
_MIN_TIME_STEP = 1e-9  # s; a log whose times stand still is refused elsewhere


def with_velocities(chunks: Iterable[Recording]) -> Iterator[Recording]:
    """The same samples, in other chunks, with v differentiated from q.

    The window shrinks towards both ends of the log; the first and the last sample have the
    velocity of their neighbours.

    Args:
        chunks: successive parts of one recording with finite positions.
    """
    half_window: int | None = None  # samples on either side of the middle; None: not known yet
    buffer: Recording | None = None  # samples that lack later ones, and the window before them
    num_yielded = 0  # samples at the buffer's begin that were yielded: kept for later windows
    # `_velocities` takes shorter windows near the buffer's ends. Of these only the log's own ends
    # are yielded: at the begin of a later buffer they were before, at its end they wait.
    for chunk in chunks:
        buffer = chunk if buffer is None else concatenated([buffer, chunk])
        if half_window is None:
            if buffer.num_samples < LEAST_WINDOW:
                continue
            time_step = max(buffer.time_step, _MIN_TIME_STEP)
            half_window = max(_LEAST_HALF_WINDOW, round(HALF_WINDOW_S / time_step))
        end = buffer.num_samples - half_window  # of the samples whose window is complete
        if end <= max(num_yielded, half_window):  # none that is new, or none at all
            continue
        v = _velocities(buffer, half_window)
        yield replace(buffer[num_yielded:end], v=v[num_yielded:end])
        start = max(0, end - half_window)
        buffer = buffer[start:]
        num_yielded = end - start
    if buffer is None:
        return
    v = _velocities(buffer, half_window or _LEAST_HALF_WINDOW)
    yield replace(buffer[num_yielded:], v=v[num_yielded:])


def _velocities(part: Recording, half: int) -> Array:
    """(T, n); near the ends of the part over shorter windows that are still symmetric."""
    q, t = part.q, part.t - part.t[0]
    size = len(t)
    v = np.zeros_like(q)
    for m in range(1, min(half, (size - 1) // 2) + 1):
        weights = _weights(m)
        centres = np.arange(half, size - half) if m == half else np.array([m, size - 1 - m])
        if not len(centres):
            continue
        if m == half:
            slope = np.correlate(t, weights, "valid")
            change = np.stack([np.correlate(x, weights, "valid") for x in q.T], axis=1)
        else:
            window = centres[:, None] + np.arange(-m, m + 1)
            slope = t[window] @ weights
            change = np.einsum("kij,i->kj", q[window], weights)
        v[centres] = change / slope[:, None]
    if size > 2:
        v[0], v[-1] = v[1], v[-2]
    return v


@cache
def _weights(m: int) -> Array:
    """(2 m + 1,) c, the slope's weights in the least-squares cubic (of lower degree for m = 1)."""
    i = np.arange(-m, m + 1.0)
    powers = np.vander(i / m, min(_SPLINE_DEGREE, 2 * m) + 1, increasing=True)
    return np.asarray(np.linalg.pinv(powers)[1])
