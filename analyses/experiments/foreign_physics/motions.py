"""Motions of the experiment, on the controller's grid (`models.robot.mjcf.TIME_STEP`)."""

from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.mjcf import TIME_STEP
from wrenchsight.models.robot.robot import Robot

MAX_DEPARTURE = 0.35  # rad, of joints about home
_LIMIT_MARGIN = 0.1  # rad, from the joints' limits
_RISE_TIME, _FALL_TIME = 1.5, 1.0  # s, in which `wave` begins and ends
_VIA_STEP = 0.02  # s, between the postures that a path is made of


class Motion(NamedTuple):
    """q, v, vdot (N, n) on the controller's grid, rad and s (m)."""

    q: Array
    v: Array
    vdot: Array


def grid(duration: float) -> Array:
    """The controller's instants, s."""
    return np.asarray(TIME_STEP * np.arange(round(duration / TIME_STEP)))


def smooth_step(x: Array) -> tuple[Array, Array, Array]:
    """A quintic from 0 to 1 for x from 0 to 1, with its first and second derivative by x."""
    x = np.clip(x, 0.0, 1.0)
    s = x**3 * (10.0 + x * (6.0 * x - 15.0))
    return s, 30.0 * x**2 * (1.0 - x) ** 2, 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x)


def wave(robot: Robot, duration: float, seed: int, reach: float = MAX_DEPARTURE) -> Motion:
    """All joints on sines of two incommensurate periods about home, from rest and to it.

    q = home + w x: x the sum of both sines, w a window that rises from 0 within _RISE_TIME and
    falls to 0 within _FALL_TIME. The derivatives follow by the product rule; below, `_dot` and
    `_ddot` are the first and the second by time.

    Args:
        duration: s.
        reach: rad (m), the largest departure of a joint from home.
    """
    rng = np.random.default_rng([seed, 2])  # 2: the stream of this motion
    n = robot.num_joints
    t = grid(duration)
    low, high = _room(robot, reach)
    amplitude = np.minimum(robot.home - low, high - robot.home)
    # Periods of 7 to 11 s and of 3.3 to 5 s.
    slow = rng.uniform(0.09, 0.14, n)  # Hz
    fast = rng.uniform(0.2, 0.3, n)  # Hz
    phase = rng.uniform(0.0, 2.0 * np.pi, (2, n))

    def sine(share: float, frequency: Array, phase: Array) -> Motion:
        """Of a share of each joint's amplitude, about zero."""
        omega = 2.0 * np.pi * frequency
        angle = omega * t[:, None] + phase
        size = share * amplitude
        return Motion(
            size * np.sin(angle), size * omega * np.cos(angle), -size * omega**2 * np.sin(angle)
        )

    # The shares add up to 1: the sum stays within each joint's amplitude.
    slow_sine, fast_sine = sine(0.65, slow, phase[0]), sine(0.35, fast, phase[1])
    x, x_dot, x_ddot = (a + b for a, b in zip(slow_sine, fast_sine, strict=True))
    # Derivatives of `smooth_step` are by its argument; time enters by the chain rule.
    rise, rise_slope, rise_curvature = smooth_step(t / _RISE_TIME)
    rise_dot, rise_ddot = rise_slope / _RISE_TIME, rise_curvature / _RISE_TIME**2
    fall, fall_slope, fall_curvature = smooth_step((t[-1] - t) / _FALL_TIME)
    fall_dot, fall_ddot = -fall_slope / _FALL_TIME, fall_curvature / _FALL_TIME**2
    w = (rise * fall)[:, None]
    w_dot = (rise_dot * fall + rise * fall_dot)[:, None]
    w_ddot = (rise_ddot * fall + 2.0 * rise_dot * fall_dot + rise * fall_ddot)[:, None]
    return Motion(
        q=robot.home + w * x,
        v=w_dot * x + w * x_dot,
        vdot=w_ddot * x + 2.0 * w_dot * x_dot + w * x_ddot,
    )


def slow_reversals(robot: Robot, duration: float, seed: int) -> Motion:
    """Each joint to and fro at some .1 rad/s, each with its own period."""
    rng = np.random.default_rng([seed, 3])
    t = grid(duration)[:, None]
    low, high = _room(robot, 0.12)
    amplitude = np.minimum(robot.home - low, high - robot.home)
    omega = 2.0 * np.pi / rng.uniform(6.0, 10.0, robot.num_joints)
    return Motion(
        robot.home + 0.5 * amplitude * (1.0 - np.cos(omega * t)),
        0.5 * amplitude * omega * np.sin(omega * t),
        0.5 * amplitude * omega**2 * np.cos(omega * t),
    )


def pick_and_place(robot: Robot, duration: float, seed: int, dwell: float = 1.2) -> Motion:
    """From posture to posture about home, with a rest at each."""
    rng = np.random.default_rng([seed, 4])
    n, t = robot.num_joints, grid(duration)
    low, high = _room(robot, 0.6)
    q = np.tile(robot.home, (len(t), 1))
    v, vdot = np.zeros((2, len(t), n))
    start, begin = np.array(robot.home), dwell
    while begin + dwell < duration:
        goal = rng.uniform(low, high)
        takes = float(max(1.0, 1.9 * np.max(np.abs(goal - start)) / 0.9))  # s, up to .9 rad/s
        if begin + takes + dwell > duration:
            break
        s, s1, s2 = smooth_step((t - begin) / takes)
        moves = t >= begin
        step = goal - start
        q[moves] = start + s[moves, None] * step
        v[moves] = s1[moves, None] * step / takes
        vdot[moves] = s2[moves, None] * step / takes**2
        start, begin = goal, begin + takes + dwell
    return Motion(q, v, vdot)


def along_points(robot: Robot, p_home: Array, duration: float) -> Motion:
    """E along points beside its place at home, with its orientation kept.

    Args:
        p_home: function values (K, 3) in m at instants _VIA_STEP apart, relative to E at home, in
            axes of W; the first is where the motion starts.
        duration: s.
    """
    R_home, p_start = robot.chain.pose(robot.home)
    q = np.array(robot.home)
    vias = np.empty((len(p_home), robot.num_joints))
    for k, p in enumerate(p_home):
        for _ in range(50 if k == 0 else 3):
            R_WE, p_WE = robot.chain.pose(q)
            turn = 0.5 * np.cross(R_WE.T, R_home.T).sum(axis=0)
            error = np.concatenate([turn, p_start + p - p_WE])
            J = robot.chain.jacobian(q)
            step = J.T @ np.linalg.solve(J @ J.T + 1e-8 * np.eye(6), error)
            q = q + step
        vias[k] = q
    spline = CubicSpline(_VIA_STEP * np.arange(len(vias)), vias, bc_type="clamped")
    t = grid(duration)
    return Motion(spline(t), spline(t, 1), spline(t, 2))


def via_instants(duration: float) -> Array:
    """Instants of the points of `along_points`, s."""
    return np.asarray(_VIA_STEP * np.arange(int(np.ceil(duration / _VIA_STEP)) + 1))


def _room(robot: Robot, reach: float) -> tuple[Array, Array]:
    """Least and largest position, `reach` about home and within the limits."""
    low = np.maximum(
        robot.home - reach, np.minimum(robot.position_lower + _LIMIT_MARGIN, robot.home)
    )
    high = np.minimum(
        robot.home + reach, np.maximum(robot.position_upper - _LIMIT_MARGIN, robot.home)
    )
    return low, high
