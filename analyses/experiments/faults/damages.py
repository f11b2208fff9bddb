"""Ways in which a log can be wrong, each done to a recording of a UR10e that is right.

A damage is a function from a `Recording` and its robot to another one. None knows what the
hypotheses try: delays, orders and joints are others than those of their tests.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot

Damage = Callable[[Recording, Robot], Recording]


def late(delay: float) -> Damage:
    """Currents that are late by `delay` s; negative: they lead."""

    def damage(log: Recording, robot: Robot) -> Recording:
        columns = [np.interp(log.t - delay, log.t, x) for x in log.current.T]
        return replace(log, current=np.stack(columns, axis=1))

    return damage


def averaged(window: float) -> Damage:
    """Currents averaged over the last `window` s."""

    def damage(log: Recording, robot: Robot) -> Recording:
        size = max(1, round(window / log.time_step))
        padded = np.vstack([np.repeat(log.current[:1], size, axis=0), log.current])
        total = np.cumsum(padded, axis=0)
        return replace(log, current=(total[size:] - total[:-size]) / size)

    return damage


def centred(window: float) -> Damage:
    """Currents averaged over `window` s about each sample."""

    def damage(log: Recording, robot: Robot) -> Recording:
        size = round(window / log.time_step) // 2 * 2 + 1  # odd: as many samples before as behind
        return replace(log, current=uniform_filter1d(log.current, size, axis=0, mode="nearest"))

    return damage


def reordered(order: Sequence[int], of_drives: bool) -> Damage:
    """Currents, or positions and velocities, in another order; joints counted from 1."""
    places = [k - 1 for k in order]

    def damage(log: Recording, robot: Robot) -> Recording:
        if of_drives:
            return replace(log, current=log.current[:, places])
        return replace(log, q=log.q[:, places], v=log.v[:, places])

    return damage


def turned(joints: Sequence[int], of_drives: bool) -> Damage:
    """Currents, or positions and velocities, of the opposite sign; joints counted from 1."""

    def damage(log: Recording, robot: Robot) -> Recording:
        sign = np.ones(log.num_joints)
        sign[[k - 1 for k in joints]] = -1.0
        if of_drives:
            return replace(log, current=log.current * sign)
        return replace(log, q=log.q * sign, v=log.v * sign)

    return damage


def moved_zero(joint: int, offset: float) -> Damage:
    """Positions of a joint, counted from 1, off by `offset` rad."""

    def damage(log: Recording, robot: Robot) -> Recording:
        q = log.q.copy()
        q[:, joint - 1] += offset
        return replace(log, q=q)

    return damage


def scaled(gain: Sequence[float]) -> Damage:
    """Currents times a gain of each joint."""
    return lambda log, robot: replace(log, current=log.current * np.asarray(gain))


def under_gravity(gravity: Sequence[float]) -> Damage:
    """The currents of an arm that stands so that gravity is this in W, m/s^2."""

    def damage(log: Recording, robot: Robot) -> Recording:
        chain = replace(robot.chain, gravity=np.asarray(gravity, float))
        change: Array = chain.gravity_torque(log.q) - robot.chain.gravity_torque(log.q)
        return replace(log, current=log.current + robot.motor_current(change))

    return damage


def without_gravity(log: Recording, robot: Robot) -> Recording:
    """Currents from which the controller has taken gravity."""
    gravity = robot.chain.gravity_torque(log.q)
    return replace(log, current=log.current - robot.motor_current(gravity))


def without_sign(log: Recording, robot: Robot) -> Recording:
    """The size of the currents."""
    return replace(log, current=np.abs(log.current))


DAMAGES: dict[str, Damage] = {
    "none": lambda log, robot: log,
    **{f"late_{1000 * d:.0f}_ms": late(d) for d in (0.05, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0)},
    **{f"early_{1000 * d:.0f}_ms": late(-d) for d in (0.05, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0)},
    **{f"averaged_{1000 * w:.0f}_ms": averaged(w) for w in (0.1, 0.25, 0.5)},
    **{f"centred_{1000 * w:.0f}_ms": centred(w) for w in (0.3, 0.5)},
    "drives_by_name": reordered((3, 2, 1, 4, 5, 6), True),
    "drives_backwards": reordered((6, 5, 4, 3, 2, 1), True),
    "drives_4_5": reordered((1, 2, 3, 5, 4, 6), True),
    "drives_5_6": reordered((1, 2, 3, 4, 6, 5), True),
    "joints_2_3": reordered((1, 3, 2, 4, 5, 6), False),
    "joints_4_5": reordered((1, 2, 3, 5, 4, 6), False),
    "drive_1_turned": turned([1], True),
    "drive_3_turned": turned([3], True),
    "drive_5_turned": turned([5], True),
    "drives_turned": turned(range(1, 7), True),
    "joint_2_turned": turned([2], False),
    "joint_4_turned": turned([4], False),
    "zero_2_20_mrad": moved_zero(2, 0.02),
    "zero_2_50_mrad": moved_zero(2, -0.05),
    "zero_3_100_mrad": moved_zero(3, 0.1),
    "zero_4_quarter": moved_zero(4, 0.5 * np.pi),
    "wall": under_gravity((0.0, 9.81, 0.0)),
    "ceiling": under_gravity((0.0, 0.0, 9.81)),
    "tilted_5_deg": under_gravity((0.855, 0.0, -9.773)),
    "gravity_missing": without_gravity,
    "milliamperes": scaled([1000.0] * 6),
    "all_times_115": scaled([1.15] * 6),
    "all_times_87": scaled([0.87] * 6),
    "drive_3_doubled": scaled((1.0, 1.0, 2.0, 1.0, 1.0, 1.0)),
    "drive_2_half": scaled((1.0, 0.5, 1.0, 1.0, 1.0, 1.0)),
    "unsigned": without_sign,
}
"""By name; "none" leaves the log as it is."""
