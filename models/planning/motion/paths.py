"""Straight paths of the tool, time laws, and the motion of the joints along them.

A path states the positions of E (`StraightPath`), a time law the progress along it. From both
`joint_trajectory` computes joint positions, velocities and accelerations.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.interpolate import make_interp_spline

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.planning.motion.inverse_kinematics import follow_path
from wrenchsight.models.robot.robot import Robot

NUM_SPLINE_POINTS = 201  # of a path, through which the joints' spline goes; it needs six


@dataclass(frozen=True)
class StraightPath:
    """A straight path of E with a fixed orientation (Lu et al., eqs. 23-26).

    Attributes:
        n_W: (3,) its direction; made a unit vector.
        p_WM: (3,) its midpoint M, m.
        R_WE: (3, 3) the orientation of E.
        path_length: a in the article, m.
        num_segments: k in the article; the path has k + 1 points.

    Raises:
        InputError: wrong shapes, no direction, a matrix that is no rotation, no length or segments.
    """

    n_W: Array
    p_WM: Array
    R_WE: Array
    path_length: float = 1.0
    num_segments: int = 20

    def __post_init__(self) -> None:
        n_W = np.array(self.n_W, dtype=np.float64)
        p_WM = np.array(self.p_WM, dtype=np.float64)
        R_WE = np.array(self.R_WE, dtype=np.float64)
        if n_W.shape != (3,) or p_WM.shape != (3,) or R_WE.shape != (3, 3):
            raise InputError("path", "", "n_W and p_WM take 3 numbers, R_WE takes 3 x 3")
        length = float(np.linalg.norm(n_W))
        if not (np.isfinite(length) and length > 1e-9):
            raise InputError("path", "n_W", f"{n_W.tolist()} has no direction")
        # 1e-3: the article prints its directions and rotations with four digits.
        if np.max(np.abs(R_WE @ R_WE.T - np.eye(3))) > 1e-3 or np.linalg.det(R_WE) < 0:
            raise InputError("path", "R_WE", "is no rotation matrix")
        if not self.path_length > 0 or self.num_segments < 1:
            raise InputError("path", "", "path_length and num_segments must be above 0")
        object.__setattr__(self, "n_W", n_W / length)
        object.__setattr__(self, "p_WM", p_WM)
        object.__setattr__(self, "R_WE", R_WE)

    def points(self) -> Array:
        """(k + 1, 3) points at even distances, p_0 first (eq. 24)."""
        return self.positions(np.linspace(0.0, 1.0, self.num_segments + 1))

    def positions(self, s: Array | float) -> Array:
        """(..., 3) position of E where the fraction s in [0, 1] of the path is done."""
        along = (np.asarray(s, dtype=np.float64) - 0.5) * self.path_length
        return self.p_WM + along[..., np.newaxis] * self.n_W

    def poses(self, s: Array) -> tuple[Array, Array]:
        """R_WE (N, 3, 3) and p_WE (N, 3) at fractions s (N,) of the path."""
        p_WE = self.positions(s)
        return np.broadcast_to(self.R_WE, (*p_WE.shape[:-1], 3, 3)), p_WE


class PathProgress(NamedTuple):
    """PathProgress along a path, and its derivatives by u, the fraction of the time that has
    passed.
    """

    s: Array  # 0 at the start of the path, 1 at its end
    ds_du: Array
    d2s_du2: Array


TimeLaw = Callable[[Array], PathProgress]
"""From u in [0, 1] to the progress along the path. Outside of [0, 1] it rests at the ends."""


def uniform_acceleration(u: Array) -> PathProgress:
    """Accelerates evenly over the first half of the time, decelerates evenly over the second."""
    return _trapezoidal(u, 0.5)


def thirds(u: Array) -> PathProgress:
    """Accelerates evenly for a third of the time, keeps the speed, decelerates for a third."""
    return _trapezoidal(u, 1.0 / 3.0)


def constant_speed(u: Array) -> PathProgress:
    """Keeps its speed but for the first and the last tenth of the time.

    There the speed follows half a cosine, so that the acceleration begins and ends at zero.
    """
    return _steady(u, 0.1)


def steady_speed(ramp: float) -> TimeLaw:
    """Returns the law of `constant_speed` with ramps of another share of the time, in (0, 0.5].

    Raises:
        ValueError: a ramp outside (0, 0.5].
    """
    if not 0.0 < ramp <= 0.5:
        raise ValueError(f"ramp must be above 0 and at most 0.5, not {ramp}")
    return lambda u: _steady(u, ramp)


def _steady(u: Array, ramp: float) -> PathProgress:
    speed = 1.0 / (1.0 - ramp)
    u = np.clip(np.asarray(u, dtype=np.float64), 0.0, 1.0)
    is_second_half = u > 0.5
    x = np.minimum(np.where(is_second_half, 1.0 - u, u), ramp)  # time within the ramp
    phase = np.pi * x / ramp
    cruise = np.where(is_second_half, 1.0 - u, u) - x
    done = speed * (0.5 * (x - ramp / np.pi * np.sin(phase)) + cruise)
    ds = 0.5 * speed * (1.0 - np.cos(phase))
    d2s = 0.5 * speed * np.pi / ramp * np.sin(phase)
    d2s = np.where(x < ramp, d2s, 0.0)
    return PathProgress(
        np.where(is_second_half, 1.0 - done, done), ds, np.where(is_second_half, -d2s, d2s)
    )


def there_and_back(law: TimeLaw) -> TimeLaw:
    """The law forward in the first half of the time, and backward in the second."""

    def forth_and_back(u: Array) -> PathProgress:
        u = np.asarray(u, dtype=np.float64)
        is_back = u > 0.5
        progress = law(np.where(is_back, 2.0 - 2.0 * u, 2.0 * u))
        ds = np.where(is_back, -2.0, 2.0) * progress.ds_du
        return PathProgress(progress.s, ds, 4.0 * progress.d2s_du2)

    return forth_and_back


def _trapezoidal(u: Array, ramp: float) -> PathProgress:
    """Even acceleration over `ramp` of the time, constant speed, even deceleration."""
    u = np.asarray(u, dtype=np.float64)
    outside = (u < 0.0) | (u > 1.0)
    u = np.clip(u, 0.0, 1.0)
    speed = 1.0 / (1.0 - ramp)
    is_second_half = u > 0.5
    x = np.where(is_second_half, 1.0 - u, u)
    is_ramp = x < ramp
    done = np.where(is_ramp, 0.5 * speed / ramp * x**2, speed * (x - 0.5 * ramp))
    ds = np.where(is_ramp, speed / ramp * x, speed)
    d2s = np.where(is_ramp & ~outside, speed / ramp, 0.0)
    return PathProgress(
        np.where(is_second_half, 1.0 - done, done), ds, np.where(is_second_half, -d2s, d2s)
    )


@dataclass(frozen=True)
class JointTrajectory:
    """A motion of the joints, known at times t and smooth between them.

    Between two times the positions are the quintic that meets position, velocity and acceleration
    at both; before the first and after the last the joints rest.

    Attributes:
        t: (T,) s, rising.
        q, v, vdot: (T, n) rad, rad/s, rad/s^2 (m for prismatic joints).

    Raises:
        ValueError: times that do not rise, or shapes that disagree.
    """

    t: Array
    q: Array
    v: Array
    vdot: Array

    def __post_init__(self) -> None:
        for name in ("t", "q", "v", "vdot"):
            array = np.ascontiguousarray(getattr(self, name), dtype=np.float64)
            object.__setattr__(self, name, array)
        if self.t.ndim != 1 or len(self.t) < 2 or np.any(np.diff(self.t) <= 0):
            raise ValueError("t must hold two or more rising times")
        if not (self.q.shape == self.v.shape == self.vdot.shape == (len(self.t), self.num_joints)):
            raise ValueError("q, v and vdot must be (T, n) like t")

    @property
    def num_joints(self) -> int:
        """Number of joints, n."""
        return int(self.q.shape[1])

    @property
    def duration(self) -> float:
        """Time from the first to the last, s."""
        return float(self.t[-1] - self.t[0])

    @classmethod
    def from_positions(cls, t: Array, q: Array) -> "JointTrajectory":
        """The quintic spline through q (T, n) at t (T,), at rest at both ends."""
        at_rest = [(1, np.zeros(q.shape[1])), (2, np.zeros(q.shape[1]))]
        spline = make_interp_spline(t, q, k=5, bc_type=(at_rest, at_rest))
        return cls(t, q, spline.derivative(1)(t), spline.derivative(2)(t))

    def reference(self, t: float) -> Array:
        """q, v and vdot at one time, one after the other: (3 n,)."""
        out = np.empty((3, self.q.shape[1]))
        quintic_at(self.t, self.q, self.v, self.vdot, t, out)
        return out.reshape(-1)

    def sample(self, t: Array | float) -> "tuple[Array, Array, Array]":
        """q, v and vdot at times t (...,), each (..., n)."""
        times = np.asarray(t, dtype=np.float64)
        out = np.empty((times.size, 3, self.num_joints))
        _quintic(self.t, self.q, self.v, self.vdot, times.ravel(), out)
        shape = (*times.shape, self.num_joints)
        return (
            out[:, 0].reshape(shape),
            out[:, 1].reshape(shape),
            out[:, 2].reshape(shape),
        )


@kernel
def quintic_at(t: Array, q: Array, v: Array, vdot: Array, time: float, out: Array) -> None:
    """Quintic Hermite interpolation at one time; beyond an end the arm rests at the posture there.

    Args:
        t: (T,) s, rising.
        q, v, vdot: (T, n) at t.
        time: s.
        out: (3, n), written: q, v, vdot at that time.
    """
    last_row = t.shape[0] - 1
    if time <= t[0] or time >= t[last_row]:
        end = 0 if time <= t[0] else last_row
        at_the_end = time == t[end]
        for j in range(q.shape[1]):
            out[0, j] = q[end, j]
            out[1, j] = v[end, j] if at_the_end else 0.0
            out[2, j] = vdot[end, j] if at_the_end else 0.0
        return
    k = np.searchsorted(t, time, side="right") - 1
    h = t[k + 1] - t[k]
    x = (time - t[k]) / h
    for j in range(q.shape[1]):
        # q = c0 + c1 x + ... + c5 x^5 on [0, 1]; c0 to c2 meet q, v, vdot at the near end, c3 to c5
        # at the far end what is left there: a of q, b of v h, c of vdot h^2.
        c0, c1, c2 = q[k, j], h * v[k, j], 0.5 * h * h * vdot[k, j]
        a = q[k + 1, j] - c0 - c1 - c2
        b = h * v[k + 1, j] - c1 - 2.0 * c2
        c = h * h * vdot[k + 1, j] - 2.0 * c2
        c3 = 10.0 * a - 4.0 * b + 0.5 * c
        c4 = -15.0 * a + 7.0 * b - c
        c5 = 6.0 * a - 3.0 * b + 0.5 * c
        out[0, j] = c0 + x * (c1 + x * (c2 + x * (c3 + x * (c4 + x * c5))))
        out[1, j] = (c1 + x * (2.0 * c2 + x * (3.0 * c3 + x * (4.0 * c4 + x * 5.0 * c5)))) / h
        out[2, j] = (2.0 * c2 + x * (6.0 * c3 + x * (12.0 * c4 + x * 20.0 * c5))) / (h * h)


@kernel
def _quintic(t: Array, q: Array, v: Array, vdot: Array, times: Array, out: Array) -> None:
    """`quintic_at` at many times; out (N, 3, n)."""
    for i in range(times.shape[0]):
        quintic_at(t, q, v, vdot, times[i], out[i])


def joint_trajectory(
    robot: Robot,
    path: StraightPath,
    law: TimeLaw,
    duration: float,
    q_seed: Array,
    time_step: float = 0.01,
) -> JointTrajectory:
    """The motion of the joints that takes E along a path by a time law.

    Joint positions are solved at NUM_SPLINE_POINTS of the path and joined by a quintic spline over
    the path, not over time: so velocity and acceleration have the corners of the time law, and none
    of their own.

    Args:
        robot: chain and joint limits.
        path: of E.
        law: progress along it over the share of `duration` that is over.
        duration: duration of the whole motion, s.
        q_seed: (n,) the branch is the one nearest to it at the start of the path.
        time_step: between the times that the trajectory holds, s.

    Raises:
        InputError: part of the path is out of reach (see `follow_path`).
    """
    s = np.linspace(0.0, 1.0, NUM_SPLINE_POINTS)
    R_WE, p_WE = path.poses(s)
    spline = make_interp_spline(s, follow_path(robot, R_WE, p_WE, q_seed), k=5)
    t = np.linspace(0.0, duration, max(2, round(duration / time_step) + 1))
    progress = law(t / duration)
    slope, bend = spline.derivative(1)(progress.s), spline.derivative(2)(progress.s)
    ds = progress.ds_du[:, np.newaxis] / duration
    d2s = progress.d2s_du2[:, np.newaxis] / duration**2
    return JointTrajectory(t=t, q=spline(progress.s), v=slope * ds, vdot=bend * ds**2 + slope * d2s)
