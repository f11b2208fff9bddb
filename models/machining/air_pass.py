"""The feedforward correction that an air pass teaches: the model's torque error along a path.

Most of the error of a torque-based force estimate is friction. Much of it repeats with the
direction of motion, the speed and the place: Stribeck rise, ripple over position, a gravity
parameter a little off. So the arm leads the tool once along the planned motion, a few millimetres
above the surface. No force acts there: what the observer reads is the model's error. In contact,
that reading is subtracted at the same place of the same motion. This is eq. 4 of Lu, Shen and
Zhuang, where the first of two alike cycles gives tau_d, applied to the observer's output. The model
describes what differs between the two passes, the correction what repeats. An air pass does not
show what contact itself changes: friction that grows with the load, and the torque of joints at
rest, anywhere within their stiction.

Friction without memory is evaluated at planned speeds on both passes, and the correction is valid
while the feed is steady. A law with memory follows the measured motion instead: under contact
forces a joint may stick where it slid through the air, and its friction then differs from that of
the air pass. A second air pass shows the remaining error
(`wrenchsight.analyses.methods.simulate.air_pass`).

The correction belongs to the motion that the joints made in the air. Under contact forces a joint
reverses at another moment and speed, and may run off its plan for tenths of a second. What the pass
has shown at the planned speed then says little. The friction law alone reads, and errs by as much
as the pass showed anywhere. So the sd of the correction is how far it differs from itself along the
whole path, times the departure of the joint's speed from the planned one:

    sd = LP(spread departure),   spread^2 = mean over t' of (tau(t') - tau(t))^2
    departure = |v - v_planned| / max(|v|, |v_planned|, STILL_SPEED),   at most 1

LP is the observer's low-pass. This was settled on the turns of grinding at 30 s one way in worlds 0
to 5 of `campaign` with seed 5 and world 5 of seed 0. With the correction's change within 0.3 s as
its spread, 42 to 100 % of the valid readings of a turn lay inside the band, now 98 to 100 %.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.planning.motion.inverse_kinematics import follow_path
from wrenchsight.models.planning.motion.paths import JointTrajectory
from wrenchsight.models.robot.robot import Robot

LEAD_TIME = 0.5  # s at rest before the motion: the observer settles
_NUM_RISE_POINTS = 5
"""Points of the way up from the path, both ends included: inverse kinematics that goes all the way
at once may end in another branch of postures."""
STILL_SPEED = 2e-3  # rad/s: below it a speed that differs from the planned one hardly moves a joint


@dataclass(frozen=True, eq=False)
class AirPassCorrection:
    """The correction learnt on an air pass: the observer's output along a motion without contact.

    Attributes:
        t: (T,) s, even, from 0, where the feed starts.
        tau_ext: (T, n) N m, the observer's output: the model's error, positive along the motion.
        steady: (T,) 1 where the feed is steady, or friction known through its turns, so that the
            correction is valid, else 0; None: 1 everywhere.

    Raises:
        ValueError: t, tau_ext and steady do not fit each other, t is not even, or a number is not
            finite.
    """

    t: Array
    tau_ext: Array
    steady: Array | None = None

    def __post_init__(self) -> None:
        t = np.ascontiguousarray(self.t, dtype=np.float64)
        tau_ext = np.ascontiguousarray(self.tau_ext, dtype=np.float64)
        if t.ndim != 1 or len(t) < 2 or tau_ext.ndim != 2 or len(tau_ext) != len(t):
            raise ValueError(
                "air-pass correction: expected t (T,) and tau_ext (T, n) with T above 1"
            )
        if not (np.all(np.isfinite(t)) and np.all(np.isfinite(tau_ext))):
            raise ValueError("air-pass correction: a number is not finite")
        steps = np.diff(t)
        if t[0] != 0.0 or steps.min() <= 0.0 or np.ptp(steps) > 1e-6 * steps.mean():
            raise ValueError("air-pass correction: t must rise evenly from 0")
        object.__setattr__(self, "t", t)
        object.__setattr__(self, "tau_ext", tau_ext)
        steady = np.ones_like(t) if self.steady is None else np.array(self.steady, np.float64)
        if steady.shape != t.shape:
            raise ValueError("air-pass correction: steady must be (T,) like t")
        object.__setattr__(self, "steady", steady)

    @property
    def num_joints(self) -> int:
        """n."""
        return int(self.tau_ext.shape[1])

    @cached_property
    def spread(self) -> Array:
        """(T, n) N m: RMS difference of the correction at a time from itself at all times."""
        mean, variance = self.tau_ext.mean(axis=0), self.tau_ext.var(axis=0)
        return np.asarray(np.sqrt((self.tau_ext - mean) ** 2 + variance))

    def at(self, feed_time: ArrayLike) -> Array:
        """The torque (..., n) in N m at these times since the feed started (...), s.

        Zero before the feed has started (below 0), after the motion's end and for NaN: friction at
        rest is different, and unknown.
        """
        x = np.nan_to_num(np.asarray(feed_time, dtype=np.float64) / self.t[1], nan=-1.0)
        inside = (x >= 0.0) & (x <= len(self.t) - 1.0)
        x = np.clip(x, 0.0, len(self.t) - 1.0)
        k = np.minimum(x.astype(int), len(self.t) - 2)
        share = (x - k)[..., np.newaxis]
        tau = self.tau_ext[k] + share * (self.tau_ext[k + 1] - self.tau_ext[k])
        return np.asarray(np.where(inside[..., np.newaxis], tau, 0.0))

    def steady_at(self, feed_time: ArrayLike) -> Array:
        """`steady` (...) at the nearest of its times to each of these (...), s."""
        assert self.steady is not None
        k = np.rint(np.asarray(feed_time, float) / self.t[1]).astype(int)
        return np.asarray(self.steady[np.clip(k, 0, len(self.t) - 1)])

    def counts_at(self, feed_time: float) -> bool:
        """Whether a reading that is corrected at this time (s) may be used."""
        assert self.steady is not None
        x = feed_time / self.t[1]
        return bool(0.0 <= x <= len(self.t) - 1.0 and self.steady[round(x)] == 1.0)


class CorrectionTable(NamedTuple):
    """An AirPassCorrection as kernels read it.

    Attributes:
        tau_ext, spread: (T, n) N m.
        steady: (T,).
        period: s, between two of its times.
    """

    tau_ext: Array
    spread: Array
    steady: Array
    period: float

    @classmethod
    def of(cls, correction: AirPassCorrection) -> "CorrectionTable":
        """Returns the table of a correction."""
        assert correction.steady is not None
        return cls(
            tau_ext=correction.tau_ext,
            spread=correction.spread,
            steady=correction.steady,
            period=float(correction.t[1]),
        )


class CorrectionSample(NamedTuple):
    """An air-pass correction at one time.

    Attributes:
        correction: (n,) N m, to be added to the observer's output.
        spread: (n,) N m, of the AirPassCorrection.
        counts: (1,) 1 where the corrected reading may be used, else 0.
    """

    correction: Array
    spread: Array
    counts: Array

    @classmethod
    def zeros(cls, num_joints: int) -> "CorrectionSample":
        """Returns no correction, not valid."""
        return cls(np.zeros(num_joints), np.zeros(num_joints), np.zeros(1))


@kernel
def sample_correction(table: CorrectionTable, feed_time: float, out: CorrectionSample) -> None:
    """Single-sample kernel: -at(feed_time), spread and counts_at(feed_time) of AirPassCorrection.

    All are 0 before the feed starts, after the motion's end and for NaN.

    Args:
        feed_time: s since the feed started.
        out: written.
    """
    tau_ext, spread, steady, period = table
    last, n = len(steady) - 1, tau_ext.shape[1]
    out.correction[:] = 0.0
    out.spread[:] = 0.0
    out.counts[0] = 0.0
    x = feed_time / period
    if not 0.0 <= x <= last:  # true for NaN as well
        return
    k = min(int(x), last - 1)
    share, nearest = x - k, int(np.rint(x))
    for j in range(n):
        out.correction[j] = -(tau_ext[k, j] + share * (tau_ext[k + 1, j] - tau_ext[k, j]))
        out.spread[j] = spread[nearest, j]
    out.counts[0] = 1.0 if steady[nearest] == 1.0 else 0.0


@kernel
def departure(v: float, v_planned: float) -> float:
    """How far a joint's speed is from the planned one, 0 to 1; both rad/s."""
    return min(abs(v - v_planned) / max(abs(v), abs(v_planned), STILL_SPEED), 1.0)


def raised_motion(robot: Robot, motion: JointTrajectory, height: float) -> JointTrajectory:
    """The same motion of the tool `height` (m) back along its own axis, after LEAD_TIME at rest.

    Args:
        robot: with six joints: its Jacobian is inverted.
        motion: motion of the joints, E's z axis into the surface, from rest to rest.
        height: m, above the surface.

    Returns:
        The motion from t = 0 on: one row at rest, LEAD_TIME before the rows of `motion`, which keep
        their distances in time.

    Raises:
        InputError: a height that is not above 0, or out of the arm's reach.
    """
    if not (np.isfinite(height) and height > 0.0):
        raise InputError("air pass", "height", f"{height:g} m, expected more than 0")
    R_WE, p_WE = robot.chain.pose(motion.q)
    raised = p_WE - height * R_WE[:, :, 2]
    try:
        share_of_way = np.linspace(0.0, 1.0, _NUM_RISE_POINTS)[:, np.newaxis]
        # Up point by point, for the posture above the path's first; then along the raised path.
        up = p_WE[0] + share_of_way * (raised[0] - p_WE[0])
        first = follow_path(robot, R_WE[0], up, motion.q[0])[-1]
        q = follow_path(robot, R_WE, raised, first)
    except InputError as error:
        raise InputError(
            "air pass",
            "height",
            f"{robot.name} cannot do this motion {height:g} m above the surface",
            "choose a lower height, or place the workpiece elsewhere",
        ) from error
    # Speeds by the Jacobian, from the tool's in `motion`: free of the search's rounding, which two
    # differences of postures would enlarge. So accelerations are differences of speeds.
    v = _joint_speeds(robot, motion, q, height)
    vdot = np.gradient(v, motion.t, axis=0)
    vdot[[0, -1]] = 0.0  # the motion begins and ends at rest, where a difference would be one-sided
    standstill = np.zeros((1, robot.num_joints))
    return JointTrajectory(
        t=np.concatenate([[0.0], motion.t - motion.t[0] + LEAD_TIME]),
        q=np.vstack([q[:1], q]),
        v=np.vstack([standstill, v]),
        vdot=np.vstack([standstill, vdot]),
    )


def _joint_speeds(robot: Robot, motion: JointTrajectory, q: Array, height: float) -> Array:
    """(T, n) rad/s at q, with which E moves as the raised point of the tool does on the motion.

    That point lies `height` m behind E along E's z axis.
    """
    J = robot.chain.jacobian(motion.q)
    V = np.einsum("tij,tj->ti", J, motion.v)
    R_WE, _ = robot.chain.pose(motion.q)
    V[:, 3:] -= height * np.cross(V[:, :3], R_WE[:, :, 2])
    return np.linalg.solve(robot.chain.jacobian(q), V[:, :, np.newaxis])[:, :, 0]
