"""A log on a coarse grid: low-passed signals from which hypotheses are judged.

All signals go through the same zero-phase low-pass of CUTOFF_FREQUENCY, so that none is late
against another unless the log itself has it so. Rows at ROW_RATE hold all that is left.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.hypotheses.sample_traits import SampleTraits, TraitFinder
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.recording import Recording, concatenated
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.signals.zero_phase import ZeroPhaseLowPass, derivative

CUTOFF_FREQUENCY = 4.0  # Hz
LARGEST_CUTOFF = 0.2  # of the log's rate
FADING_SHARE = 0.01  # of the speed limit, within which the sign of friction fades
FINE_RATE = 100.0  # 1/s, to which a faster log is averaged before it is kept
ROW_RATE = 20.0  # 1/s
LONGEST_LOG = 600.0  # s of a log that are looked at
SHORTEST_LOG = 1.4  # s; a shorter log tells nothing
MIN_SAMPLES = 40  # of a log
TRIM_TIME = 0.4  # s, transients of the low-pass at both ends
GAP_WINDOW = 0.25  # s, about a row, in which missing samples count: a period of the low-pass
MAX_MISSING_SHARE = 0.2  # of the samples in GAP_WINDOW, of a row that is used


@dataclass(frozen=True, eq=False)
class LogRows:
    """T rows of a log, low-passed.

    Attributes:
        t: (T,) s.
        q, v, vdot: (T, n) rad, rad/s, rad/s^2 (m, m/s, m/s^2).
        sliding: (T, n) low-passed sign of the velocity, -1 to 1; its size is the share of time in
            which the joint moves.
        effort: (T, n) what the drives report: A, or N m on the joints.
        is_torque: whether effort is in N m.
        is_used: (T,) clear of missing samples and of the low-pass's transients.
        traits: what the samples show before the low-pass; None: not looked for.
    """

    t: Array
    q: Array
    v: Array
    vdot: Array
    sliding: Array
    effort: Array
    is_torque: bool
    is_used: NDArray[np.bool_]
    traits: SampleTraits | None = None

    @property
    def step(self) -> float:
        """s between rows."""
        return float((self.t[-1] - self.t[0]) / max(1, len(self.t) - 1))


def slowest_sliding(robot: Robot) -> Array:
    """(n,) rad/s (m/s) below which the sign of friction fades."""
    limit = robot.velocity_limit
    return np.asarray(FADING_SHARE * np.where(np.isfinite(limit), limit, 1.0))


def log_rows(chunks: Iterable[Recording], robot: Robot) -> LogRows | None:
    """The rows of a log: low-passed, ROW_RATE a second, of at most its first LONGEST_LOG s.

    Missing samples are bridged. Rows where more than MAX_MISSING_SHARE of the samples around are
    missing, and those near the ends of the low-pass, are not used.

    Args:
        chunks: successive parts of the log, on a uniform grid.
        robot: of its joints `slowest_sliding` tells in which direction friction acts.

    Returns:
        The rows, with `effort` the motor torque where the log has one (`is_torque`), else current.
        None where the log is too short, has too low a rate or holds no drives.
    """
    parts: list[Recording] = []
    finder = TraitFinder()
    duration = 0.0
    for chunk in chunks:
        if not chunk.num_samples or duration >= LONGEST_LOG:
            continue  # the caller's generator runs to its end, with its checks
        finder.feed(chunk)
        parts.append(_averaged(chunk))
        duration += chunk.num_samples * (chunk.time_step if chunk.num_samples > 1 else 0.0)
    if not parts or duration < SHORTEST_LOG:
        return None
    log = concatenated(parts)
    step = log.time_step
    cutoff = min(CUTOFF_FREQUENCY, LARGEST_CUTOFF / step)
    effort = log.current if log.tau_J is None else log.tau_J
    is_missing = log.dropout | ~np.isfinite(np.hstack([log.q, log.v, effort])).all(axis=1)
    if (~is_missing).sum() * step < SHORTEST_LOG or log.num_samples < MIN_SAMPLES:
        return None
    q, v, effort = (_bridged(x, is_missing) for x in (log.q, log.v, effort))
    low_pass = ZeroPhaseLowPass(cutoff, step, 4)
    sliding = low_pass(np.tanh(v / slowest_sliding(robot)))
    q, v, effort = low_pass(q), low_pass(v), low_pass(effort)
    vdot = derivative(v, step)
    window = max(1, round(GAP_WINDOW / step))
    num_missing = np.convolve(is_missing, np.ones(window), "same")
    is_used = num_missing <= MAX_MISSING_SHARE * window
    trim = round(TRIM_TIME / step)
    is_used[:trim] = is_used[len(is_used) - trim :] = False
    rows = slice(None, None, max(1, round(1.0 / (ROW_RATE * step))))
    return LogRows(
        t=log.t[0] + step * np.arange(log.num_samples)[rows],
        q=np.ascontiguousarray(q[rows]),
        v=np.ascontiguousarray(v[rows]),
        vdot=np.ascontiguousarray(vdot[rows]),
        sliding=sliding[rows],
        effort=effort[rows],
        is_torque=log.tau_J is not None,
        is_used=is_used[rows],
        traits=finder.traits(),
    )


def _averaged(chunk: Recording) -> Recording:
    """The chunk, samples averaged in groups to FINE_RATE; all its signals alike."""
    size = round(1.0 / (FINE_RATE * chunk.time_step)) if chunk.num_samples > 1 else 1
    count = chunk.num_samples // size if size > 1 else 0
    if count < 1:
        return Recording(
            chunk.t, chunk.q, chunk.v, chunk.current, chunk.source, chunk.tau_J, chunk.dropout
        )

    def mean(x: Array) -> Array:
        return np.asarray(x[: count * size].reshape(count, size, *x.shape[1:]).mean(axis=1))

    return Recording(
        t=mean(chunk.t),
        q=mean(chunk.q),
        v=mean(chunk.v),
        current=mean(chunk.current),
        source=chunk.source,
        tau_J=None if chunk.tau_J is None else mean(chunk.tau_J),
        dropout=mean(chunk.dropout.astype(float)) > 0.0,
    )


def _bridged(x: Array, is_missing: NDArray[np.bool_]) -> Array:
    """A signal (T, n), linear across missing rows."""
    if not is_missing.any():
        return x
    rows, known = np.arange(len(x)), np.flatnonzero(~is_missing)
    return np.stack([np.interp(rows, known, x[known, j]) for j in range(x.shape[1])], axis=1)
