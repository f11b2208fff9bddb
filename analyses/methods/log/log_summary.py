"""What a log holds: rate, gaps, and how far, how fast and with which torque each joint moves."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.recordings.recording import Recording, concatenated
from wrenchsight.models.recordings.resampling import DROPOUT_STEPS

REST_SPEED = 0.01  # rad/s or m/s, below which a joint rests
_MAX_DRAWN_SAMPLES = 20_000  # samples that are kept for a figure, at most twice as many
_STEP_SHARES = (0.01, 0.99)  # of the steps, whose range is stated


@dataclass(frozen=True, eq=False)
class LogSummary:
    """Figures of a log of n joints; angles in rad (m of a joint that slides).

    Attributes:
        num_samples: that were read.
        duration: from the first to the last, s.
        step: the median step, s.
        steps: range of the steps but for the shortest and the longest hundredth, s.
        num_gaps: steps that miss a sample.
        longest_gap: s; 0 where there is none.
        q_min, q_max: (n,) range of the positions.
        v_max: (n,) largest speed.
        effort_rms: (n,) root mean square of the currents in A, or of the torques in N m.
        rest: (n,) share of the samples in which a joint rests.
        drawn: some of the samples, evenly spread.
    """

    num_samples: int
    duration: float
    step: float
    steps: tuple[float, float]
    num_gaps: int
    longest_gap: float
    q_min: Array
    q_max: Array
    v_max: Array
    effort_rms: Array
    rest: Array
    drawn: Recording

    @property
    def rate_hz(self) -> float:
        """Samples a second."""
        return 1.0 / self.step if self.step > 0.0 else 0.0

    @property
    def rests_throughout(self) -> Flags:
        """(n,) the joints that do not move."""
        return np.asarray(self.rest == 1.0)

    def metrics(self) -> dict[str, Any]:
        """All figures but the samples, as written to metrics.json."""
        return {
            "samples": self.num_samples,
            "duration_s": self.duration,
            "step_s": self.step,
            "steps_s": list(self.steps),
            "gaps": self.num_gaps,
            "longest_gap_s": self.longest_gap,
            "q_min_rad": self.q_min,
            "q_max_rad": self.q_max,
            "v_max_rad_per_s": self.v_max,
            "effort_rms": self.effort_rms,
            "rest_share": self.rest,
        }


def effort(part: Recording) -> Array:
    """(N, n) currents in A, or the torques in N m where the log holds these."""
    return part.current if part.tau_J is None else part.tau_J


def summarised(chunks: Iterable[Recording]) -> LogSummary:
    """The figures of a log's successive parts.

    Extremes, efforts and rests are of the samples without drop-outs. Of the samples every
    stride-th is kept for a figure; the stride doubles when they become too many.

    Raises:
        InputError: as the chunks.
        ValueError: there is no part.
    """
    kept: list[Recording] = []
    stride, num_samples, num_complete = 1, 0, 0
    times: list[Array] = []
    lowest = highest = fastest = squares = resting = np.zeros(0)
    for chunk in chunks:
        n = chunk.num_joints
        if not num_samples:
            lowest, highest = np.full(n, np.inf), np.full(n, -np.inf)
            fastest, squares, resting = np.zeros((3, n))
        times.append(chunk.t)
        complete = chunk[~chunk.dropout]
        lowest = np.minimum(lowest, complete.q.min(axis=0, initial=np.inf))
        highest = np.maximum(highest, complete.q.max(axis=0, initial=-np.inf))
        fastest = np.maximum(fastest, np.abs(complete.v).max(axis=0, initial=0.0))
        squares = squares + (effort(complete) ** 2).sum(axis=0)
        resting = resting + (np.abs(complete.v) < REST_SPEED).sum(axis=0)
        num_complete += complete.num_samples
        first = -num_samples % stride  # of this chunk that is kept
        kept.append(chunk[first::stride])
        num_samples += chunk.num_samples
        if sum(part.num_samples for part in kept) > 2 * _MAX_DRAWN_SAMPLES:
            kept, stride = [concatenated(kept)[::2]], 2 * stride
    t = np.concatenate(times)
    steps = np.diff(t)
    step = float(np.median(steps)) if len(steps) else 0.0
    gaps = steps[steps > DROPOUT_STEPS * step]
    least, most = np.quantile(steps, _STEP_SHARES) if len(steps) else (0.0, 0.0)
    return LogSummary(
        num_samples=num_samples,
        duration=float(t[-1] - t[0]),
        step=step,
        steps=(float(least), float(most)),
        num_gaps=len(gaps),
        longest_gap=float(gaps.max(initial=0.0)),
        q_min=lowest,
        q_max=highest,
        v_max=fastest,
        effort_rms=np.sqrt(squares / max(num_complete, 1)),
        rest=resting / max(num_complete, 1),
        drawn=concatenated(kept),
    )
