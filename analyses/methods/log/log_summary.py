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


class _JointSums:
    """Extremes and sums over samples, joint by joint.

    Attributes:
        num_samples: so far.
        lowest, highest: (n,) rad (m), infinite before the first sample.
        fastest: (n,) rad/s (m/s).
        effort_squares: (n,) sums of squared efforts.
        num_resting: (n,) samples in which the joint rests.
    """

    def __init__(self, num_joints: int) -> None:
        self.num_samples = 0
        self.lowest = np.full(num_joints, np.inf)
        self.highest = np.full(num_joints, -np.inf)
        self.fastest = np.zeros(num_joints)
        self.effort_squares = np.zeros(num_joints)
        self.num_resting = np.zeros(num_joints)

    def add(self, part: Recording) -> None:
        """Takes samples; there may be none."""
        self.num_samples += part.num_samples
        self.lowest = np.minimum(self.lowest, part.q.min(axis=0, initial=np.inf))
        self.highest = np.maximum(self.highest, part.q.max(axis=0, initial=-np.inf))
        self.fastest = np.maximum(self.fastest, np.abs(part.v).max(axis=0, initial=0.0))
        self.effort_squares += (effort(part) ** 2).sum(axis=0)
        self.num_resting += (np.abs(part.v) < REST_SPEED).sum(axis=0)


def summarised(chunks: Iterable[Recording]) -> LogSummary:
    """The figures of a log's successive parts.

    Extremes, efforts and rests are of the samples without drop-outs. Of the samples every
    stride-th is kept for a figure; the stride doubles when they become too many. The times are all
    kept, for the median step.

    Raises:
        InputError: as the chunks.
        ValueError: there is no part.
    """
    kept: list[Recording] = []
    stride, num_samples = 1, 0
    times: list[Array] = []
    joints: _JointSums | None = None
    for chunk in chunks:
        if joints is None:
            joints = _JointSums(chunk.num_joints)
        times.append(chunk.t)
        joints.add(chunk[~chunk.dropout])
        first = -num_samples % stride  # index in this chunk of the first that is kept
        kept.append(chunk[first::stride])
        num_samples += chunk.num_samples
        if sum(part.num_samples for part in kept) > 2 * _MAX_DRAWN_SAMPLES:
            kept, stride = [concatenated(kept)[::2]], 2 * stride
    if joints is None:
        raise ValueError("a log without a part")
    t = np.concatenate(times)
    steps = np.diff(t)
    step = float(np.median(steps)) if len(steps) else 0.0
    gaps = steps[steps > DROPOUT_STEPS * step]
    least, most = np.quantile(steps, _STEP_SHARES) if len(steps) else (0.0, 0.0)
    num_judged = max(joints.num_samples, 1)  # without drop-outs; 1: all sums are 0 anyway
    return LogSummary(
        num_samples=num_samples,
        duration=float(t[-1] - t[0]),
        step=step,
        steps=(float(least), float(most)),
        num_gaps=len(gaps),
        longest_gap=float(gaps.max(initial=0.0)),
        q_min=joints.lowest,
        q_max=joints.highest,
        v_max=joints.fastest,
        effort_rms=np.sqrt(joints.effort_squares / num_judged),
        rest=joints.num_resting / num_judged,
        drawn=concatenated(kept),
    )
