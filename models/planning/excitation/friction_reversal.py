"""Friction from motor torque without a torque sensor, by reversal (Lu et al., eqs. 13-19).

Where an arm passes the same posture twice with opposite velocity, Coriolis torque and gravity are
equal (eq. 14) and friction is opposite as far as it is odd (eq. 15), so that

    tau_f = (tau_J1 - tau_J2) / 2 - M (vdot_1 - vdot_2) / 2

which is eq. 19 where the accelerations are opposite too (eq. 16): M vdot. Half the sum,

    (tau_J1 + tau_J2) / 2 - [Cv + G + M (vdot_1 + vdot_2) / 2],

is the part of friction that eq. 15 neglects (plus the error of the model's gravity).

`reversal_motion` plans such passes: q(t) = phi + (speed / w) sin(w t), w = 2 pi / T, passes phi
with any chosen speed, however small, and half a period later with the opposite one, both times
without acceleration.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.planning.motion.paths import JointTrajectory
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.robot.robot import Robot

TIME_STEP = 1e-3  # s, of the trajectory
MIN_PASS_SAMPLES = 4  # samples of a pass
MAX_POSTURE_DIFFERENCE = 0.05  # rad, of any joint between the two passes
PAIR_SPACING = 0.002  # rad, between the positions at which two passes are compared
SPEED_TOLERANCE = 0.2  # of the speed, by which the two passes may differ in it


@dataclass(frozen=True, eq=False)
class ReversalSamples:
    """Friction of one joint where it passes a position both ways.

    Attributes:
        joint: index.
        position: (K,) rad.
        speed: (K,) rad/s, positive: the mean of the two.
        acceleration: (K,) rad/s^2, half the difference of the two.
        symmetric: (K,) N m, the odd part of friction, positive against the motion.
        asymmetric: (K,) N m, half the sum less the rigid-body torque.
    """

    joint: int
    position: Array
    speed: Array
    acceleration: Array
    symmetric: Array
    asymmetric: Array

    def friction(self) -> tuple[Array, Array]:
        """Velocities and friction torques (2 K,) of both directions."""
        v = np.concatenate([self.speed, -self.speed])
        return v, np.concatenate(
            [self.asymmetric + self.symmetric, self.asymmetric - self.symmetric]
        )


def reversal_motion(
    robot: Robot, direction: ArrayLike, posture: ArrayLike, speeds: ArrayLike, period: float = 2.0
) -> JointTrajectory:
    """Plans passes through a posture, both ways, at every speed; at rest at both ends.

    Joints that move together pass it with opposite velocities, so that the friction of each
    separates from one motion. Speed k (from 0 on) takes two periods: one in which the motion
    changes smoothly from what it was, and one that holds the passes at its start,
    (2 k + 1) period, its middle and its end.

    Args:
        robot: sets the limits.
        direction: (n,) share of the motion that each joint makes.
        posture: (n,) rad, where the passes meet.
        speeds: rad/s, positive; a joint passes with the speed times its entry of `direction`.
        period: s, from one pass to the next in the same direction.

    Raises:
        InputError: a posture or motion beyond the joint's limits, or a speed that is not positive.
    """
    posture, joint_shares = np.asarray(posture, np.float64), np.asarray(direction, np.float64)
    levels = np.atleast_1d(np.asarray(speeds, np.float64))
    if (
        posture.shape != (robot.num_joints,)
        or joint_shares.shape != posture.shape
        or not len(levels)
    ):
        problem = f"expected a posture and a direction of {robot.num_joints} joints, and a speed"
        raise InputError("reversal", "", problem)
    if not np.all(np.isfinite(levels) & (levels > 0.0)):
        name = ", ".join(robot.joint_names[j] for j in np.flatnonzero(joint_shares))
        raise InputError("reversal", name, "speeds must be positive")
    omega = 2.0 * np.pi / period
    # Amplitude in rad where each period begins and where the last ends: 0, a_0, a_0, a_1, a_1, ...
    # 0, so that every second period keeps its amplitude and the motion starts and ends at rest.
    amplitudes = np.append(0.0, levels / omega)
    at_period_ends = np.append(np.repeat(amplitudes, 2)[1:], 0.0)
    num_periods = len(at_period_ends) - 1
    # p = a sin(omega t) and its derivatives. The amplitude a goes from one period's end to the next
    # along a quintic that starts and ends without velocity or acceleration; u is the share of the
    # period that is over.
    t = np.arange(round(num_periods * period / TIME_STEP) + 1) * TIME_STEP
    index = np.minimum((t / period).astype(int), num_periods - 1)
    u = t / period - index
    change = at_period_ends[index + 1] - at_period_ends[index]
    a = at_period_ends[index] + change * (u**3 * (10.0 - 15.0 * u + 6.0 * u**2))
    da = change * (30.0 * u**2 * (1.0 - u) ** 2 / period)
    d2a = change * (60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / period**2)
    sine, dsine = np.sin(omega * t), omega * np.cos(omega * t)
    p, dp = a * sine, da * sine + a * dsine
    d2p = d2a * sine + 2.0 * da * dsine + a * (-(omega**2) * sine)
    q = np.outer(p, joint_shares) + posture
    v, vdot = np.outer(dp, joint_shares), np.outer(d2p, joint_shares)
    _check_within_limits(robot, q, v)
    return JointTrajectory(t=np.asarray(t, dtype=np.float64), q=q, v=v, vdot=vdot)


def _check_within_limits(robot: Robot, q: Array, v: Array) -> None:
    """Checks a motion (T, n) against the limits of position and velocity.

    Raises:
        InputError: naming the first joint that is beyond one.
    """
    for values, low, high, quantity in (
        (q, robot.position_lower, robot.position_upper, "position"),
        (v, -robot.velocity_limit, robot.velocity_limit, "velocity"),
    ):
        is_beyond = (values.min(axis=0) < low) | (values.max(axis=0) > high)
        if is_beyond.any():
            j = int(np.argmax(is_beyond))
            raise InputError(
                "reversal",
                robot.joint_names[j],
                f"{quantity} {values[:, j].min():.3g} to {values[:, j].max():.3g}, the limits are "
                f"{low[j]:.3g} and {high[j]:.3g}",
                "choose a posture farther inside, lower speeds or a shorter period",
            )


class FilteredMotion(NamedTuple):
    """A log of motion and torque, low-passed.

    Attributes:
        t: (T,) s.
        q, v, vdot: (T, n) rad, rad/s, rad/s^2.
        tau: (T, n) N m, motor torque on the joint side.
    """

    t: Array
    q: Array
    v: Array
    vdot: Array
    tau: Array


def separate(
    chain: SerialChain,
    motion: FilteredMotion,
    joint: int,
    rest_speed: float = 1e-3,
    settle: float = 0.0,
) -> ReversalSamples:
    """Pairs passes of a joint in opposite directions at equal positions and separates friction.

    Args:
        chain: chain of the identified model; its gravity enters the asymmetric part only.
        motion: with passes of the joint in both directions.
        joint: index.
        rest_speed: rad/s, below which the joint rests and belongs to no pass; above the noise of a
            filtered velocity, and below the slowest pass.
        settle: s, left out at both ends of a pass: there a low-pass mixes the friction of both
            directions. About one over its cutoff; 0 for a log that is not filtered.

    Returns:
        The samples of all pairs; none where no two passes meet.
    """
    passes = _passes(motion.t, motion.v[:, joint], rest_speed, settle)
    pairs = [_pair(motion, joint, *neighbours) for neighbours in pairwise(passes)]
    up = _joined(motion, [pair.up for pair in pairs])
    down = _joined(motion, [pair.down for pair in pairs])
    # Of both; they differ by MAX_POSTURE_DIFFERENCE at the most.
    posture = 0.5 * (up.q + down.q)
    # What the rigid body leaves of the joint's torque, up and down.
    tau_up = up.tau[:, joint] - chain.inverse_dynamics(posture, up.v, up.vdot)[:, joint]
    tau_down = down.tau[:, joint] - chain.inverse_dynamics(posture, down.v, down.vdot)[:, joint]
    return ReversalSamples(
        joint=joint,
        position=posture[:, joint],
        speed=0.5 * (up.v[:, joint] - down.v[:, joint]),
        acceleration=0.5 * (up.vdot[:, joint] - down.vdot[:, joint]),
        symmetric=0.5 * (tau_up - tau_down),
        asymmetric=0.5 * (tau_up + tau_down),
    )


def _passes(t: Array, v: Array, rest_speed: float, settle: float) -> list[slice]:
    """Stretches in which a joint moves one way, less `settle` at both ends."""
    direction = np.where(np.abs(v) > rest_speed, np.sign(v), 0.0)
    edges = np.flatnonzero(np.diff(direction)) + 1
    bounds = [0, *edges.tolist(), len(v)]
    passes = []
    for a, b in pairwise(bounds):
        first = int(np.searchsorted(t, t[a] + settle, "left"))
        end = int(np.searchsorted(t, t[b - 1] - settle, "right"))
        if direction[a] != 0.0 and end - first >= MIN_PASS_SAMPLES:
            passes.append(slice(first, end))
    return passes


class _Pair(NamedTuple):
    """Two passes of a joint at the same K positions: one upwards (v > 0), one downwards."""

    up: FilteredMotion
    down: FilteredMotion


def _pair(motion: FilteredMotion, joint: int, first: slice, second: slice) -> _Pair:
    """Two successive passes of a joint where they agree in the other joints and in speed.

    Args:
        motion: the log.
        joint: index.
        first, second: rows of the passes, of `_passes`: some samples each, in which the joint moves
            one way, so that its position tells the sample.

    Returns:
        Both, interpolated to positions that they share; no samples where they share none, or go the
        same way.
    """
    no_pair = _Pair(_at_rows(motion, slice(0, 0)), _at_rows(motion, slice(0, 0)))
    q, v = motion.q[:, joint], motion.v[:, joint]
    if v[first][0] * v[second][0] > 0.0:
        return no_pair
    up, down = (first, second) if v[first][0] > 0.0 else (second, first)
    low = max(q[up].min(), q[down].min())
    high = min(q[up].max(), q[down].max())
    if high <= low:
        return no_pair
    positions = np.linspace(low, high, max(2, int((high - low) / PAIR_SPACING) + 1))
    pair = _Pair(*(_at_positions(_at_rows(motion, rows), joint, positions) for rows in (up, down)))
    speeds = np.stack([pair.up.v[:, joint], pair.down.v[:, joint]], axis=1)
    is_speed_equal = np.abs(speeds.sum(axis=1)) <= SPEED_TOLERANCE * np.abs(speeds).min(axis=1)
    posture_difference = np.abs(pair.up.q - pair.down.q).max(axis=1)
    is_alike = is_speed_equal & (posture_difference <= MAX_POSTURE_DIFFERENCE)
    return _Pair(_at_rows(pair.up, is_alike), _at_rows(pair.down, is_alike))


def _at_positions(one_pass: FilteredMotion, joint: int, positions: Array) -> FilteredMotion:
    """A pass, interpolated over the joint's position to positions (K,) within it."""
    order = np.argsort(one_pass.q[:, joint], kind="stable")
    rising = _at_rows(one_pass, order)

    def interpolated(signal: Array) -> Array:
        columns = [np.interp(positions, rising.q[:, joint], c) for c in signal.T]
        return np.stack(columns, axis=1)

    t = np.interp(positions, rising.q[:, joint], rising.t)
    return FilteredMotion(t, *(interpolated(signal) for signal in rising[1:]))


def _at_rows(motion: FilteredMotion, rows: slice | Flags | NDArray[np.intp]) -> FilteredMotion:
    """Some samples of a motion."""
    return FilteredMotion(*(signal[rows] for signal in motion))


def _joined(log: FilteredMotion, motions: list[FilteredMotion]) -> FilteredMotion:
    """Parts of a log one after another; without any, a motion of no samples."""
    parts = [_at_rows(log, slice(0, 0)), *motions]
    return FilteredMotion(*(np.concatenate(signals) for signals in zip(*parts, strict=True)))
