"""Machining path: plan of a pass over a surface, with motion, time law and forces.

The tool's tip E is led over the points of a surface path with its z axis into the surface; the
posture at each sample is given (models.planning.motion.redundancy chooses it). A pass that cannot
succeed is refused before anything moves, with one line.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.machining.machining_phases import PhasesConfig, check_phases
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.planning.motion.inverse_kinematics import follow_path
from wrenchsight.models.planning.motion.paths import JointTrajectory, steady_speed
from wrenchsight.models.planning.motion.surface_path import SurfacePath
from wrenchsight.models.robot.robot import Robot

_TIME_STEP = 0.01  # s between the times that the trajectory holds
_SETTLING_TIME = 0.4  # s of even feed, after which joints slide and an observer has settled
_MAX_TORQUE_SHARE = 0.9  # of a drive's limit, needed at rest: the rest is for motion and control
# of the largest speed of the feed; above it is the even part alone, whatever rounding does
_FULL_SPEED_SHARE = 0.999


@dataclass
class NormalForceConfig:
    """value + amplitude sin(2 pi periods s), s from 0 to 1 along the path."""

    value: float = 40.0
    """N"""
    amplitude: float = 0.0
    """N"""
    periods: float = 2.0
    """from the start of the path to its end"""

    def at(self, s: Array) -> Array:
        """The set-point at s (...), N."""
        return np.asarray(self.value + self.amplitude * np.sin(2.0 * math.pi * self.periods * s))


@dataclass(frozen=True, eq=False)
class MachiningPath:
    """Plan of a pass, as functions of the time since the feed starts.

    Attributes:
        path: points and outward normals in W.
        trajectory: trajectory of the joints, from rest to rest, there and back `passes` times.
        s: (T,) place on the path, 0 to 1, at the times of the trajectory.
        setpoint: (T,) N, of the normal force there.
        steady: (T,) 1 where the feed has kept its full speed for a while (0.4 s), else 0: where
            friction is as it was on an air pass, and an estimate of the force can be used.
        q_start: (n,) above the path's first point, where the approach begins.
    """

    path: SurfacePath
    trajectory: JointTrajectory
    s: Array
    setpoint: Array
    steady: Array
    q_start: Array


@dataclass(frozen=True)
class PassSettings:
    """The feed, the forces and the tool of a pass.

    Attributes:
        one_way: s from one end of the path to the other, at constant speed but for the ramps.
        passes: 1 there, 2 there and back, ...
        ramp: s in which the feed comes up to its speed, and down again at the other end; half of
            one_way at most. Short ones keep the joints from creeping, where friction is unknown.
        force: set-point of the normal force.
        phases: distances, speeds and forces of approach and lift.
        tool_radius: m, of the tool's tip.
    """

    one_way: float
    passes: int
    ramp: float
    force: NormalForceConfig
    phases: PhasesConfig
    tool_radius: float


def plan_machining(
    robot: Robot, path: SurfacePath, q: Array, settings: PassSettings, source: str = "machining"
) -> MachiningPath:
    """Plans a pass: the joints' motion along a path, to and fro, with the force to push with.

    Postures are joined by a quintic spline over the place s in [0, 1], not over time: so velocity
    and acceleration of the joints have the corners of the feed's time law, and none of their own.

    Args:
        robot: its chain and its limits of speed and torque.
        path: N points with normals in W.
        q: (N, n) postures there.
        settings: settings of the pass.
        source: named in messages.

    Returns:
        The pass; `steady` where the feed has had its full speed for _SETTLING_TIME.

    Raises:
        InputError: a duration that is not positive, a set-point that is not positive or too large
            for phases.max_force, an edge sharper than the tool, a set-point beyond the drives'
            torque, a motion too fast for a joint, an approach out of reach.
    """
    force = settings.force
    _check_settings(settings, source)
    check_curvature(path, settings.tool_radius)
    s = path.distance / path.distance[-1]
    _check_torque(robot, path, q, force.at(s), source)
    feed = _time_law(settings)
    # A quintic needs six points; between fewer the joints go straight.
    spline = make_interp_spline(s, q, k=5 if len(s) > 5 else 1)
    ds, d2s = feed.ds[:, np.newaxis], feed.d2s[:, np.newaxis]
    # By the chain rule.
    slope, bend = spline.derivative(1)(feed.s), spline.derivative(2)(feed.s)
    trajectory = JointTrajectory(
        t=feed.t, q=spline(feed.s), v=slope * ds, vdot=bend * ds**2 + slope * d2s
    )
    speed = np.abs(trajectory.v).max(axis=0)
    if np.any(speed > robot.velocity_limit):
        joint = robot.joint_names[int(np.argmax(speed / robot.velocity_limit))]
        raise InputError(source, "one_way", f"{settings.one_way:g} s is too fast for {joint}")
    feed_speed = np.abs(feed.ds)
    steady = _held_for(feed_speed > _FULL_SPEED_SHARE * feed_speed.max(), feed.t, _SETTLING_TIME)
    q_start = _start_above(robot, path, q[0], settings.phases.standoff, source)
    return MachiningPath(
        path=path,
        trajectory=trajectory,
        s=feed.s,
        setpoint=force.at(feed.s),
        steady=steady,
        q_start=q_start,
    )


def _check_settings(settings: PassSettings, source: str) -> None:
    """Raises InputError, naming `source`, for a number out of range."""
    one_way, ramp = settings.one_way, settings.ramp
    force, phases = settings.force, settings.phases
    check_phases(phases, source)
    if not (math.isfinite(one_way) and one_way > 0.0):
        raise InputError(source, "one_way", f"{one_way:g} s, expected more than 0")
    if not (math.isfinite(ramp) and ramp > 0.0):
        raise InputError(source, "ramp", f"{ramp:g} s, expected more than 0")
    if settings.passes < 1:
        raise InputError(source, "passes", f"{settings.passes}, expected 1 or more")
    least_force = force.value - abs(force.amplitude)
    if not (math.isfinite(least_force) and least_force > 0.0):
        raise InputError(
            source,
            "force",
            f"falls to {least_force:g} N, expected a push above 0 all along the path",
        )
    largest_force = force.value + abs(force.amplitude)
    if largest_force >= phases.max_force:
        raise InputError(
            source,
            "force",
            f"rises to {largest_force:g} N, at or above phases.max_force = {phases.max_force:g} N",
            "lower the set-point, or raise max_force",
        )


class _Feed(NamedTuple):
    """The place on the path over time.

    Attributes:
        t: (T,) s, from the start of the feed.
        s: (T,) 0 to 1.
        ds, d2s: (T,) 1/s and 1/s^2, its derivatives.
    """

    t: Array
    s: Array
    ds: Array
    d2s: Array


def _time_law(settings: PassSettings) -> _Feed:
    """The feed along the path, there and back `passes` times."""
    one_way = settings.one_way
    count = max(2, round(one_way / _TIME_STEP))
    u = np.arange(count + 1) / count
    law = steady_speed(min(0.5, settings.ramp / one_way))(u)
    parts = []
    for k in range(settings.passes):
        back = k % 2 == 1
        place = 1.0 - law.s if back else law.s
        sign = -1.0 if back else 1.0
        start = 0 if k == 0 else 1
        parts.append(
            np.stack(
                [k * one_way + u * one_way, place, sign * law.ds_du, sign * law.d2s_du2], axis=1
            )[start:]
        )
    t, s, ds_du, d2s_du2 = np.concatenate(parts).T
    return _Feed(t, s, ds_du / one_way, d2s_du2 / one_way**2)


def _start_above(robot: Robot, path: SurfacePath, q: Array, standoff: float, source: str) -> Array:
    """The posture (n,) above the path's first point, where the posture is q.

    Args:
        standoff: m, along the normal.

    Raises:
        InputError: out of reach.
    """
    R_WE, _ = robot.chain.pose(q)
    above = path.p_WS[0] + np.outer([0.0, standoff], path.n_W[0])
    try:
        return np.asarray(follow_path(robot, R_WE, above, q)[-1])
    except InputError as error:
        raise InputError(
            source,
            "phases.standoff",
            f"{robot.name} cannot start {standoff:g} m above the path's first point",
            "move the workpiece, or start elsewhere",
        ) from error


def _held_for(holds: NDArray[np.bool_], t: Array, duration: float) -> Array:
    """1 where a condition has held for `duration`, else 0; (T,) over times t."""
    since = np.where(holds, np.nan, t)
    since[0] = t[0]
    last = np.maximum.accumulate(np.where(np.isnan(since), -np.inf, since))
    return np.asarray(holds & (t - last > duration), dtype=np.float64)


def check_curvature(path: SurfacePath, tool_radius: float) -> None:
    """Refuses a path over an edge that is sharper than the tool's tip.

    Raises:
        InputError: between two samples the normal turns by more than over a ball of that radius.
    """
    turn = np.linalg.norm(np.diff(path.n_W, axis=0), axis=1)
    step = np.linalg.norm(np.diff(path.p_WS, axis=0), axis=1)
    sharp = np.flatnonzero(turn * tool_radius > step)
    if sharp.size:
        i = int(sharp[0])
        raise InputError(
            path.source,
            f"sample {i + 1}",
            f"the surface bends with a radius of {1e3 * step[i] / turn[i]:.2g} mm, sharper than "
            f"the tool's {1e3 * tool_radius:g} mm",
            "lead the path round the edge, or take a smaller tool",
        )


def _check_torque(robot: Robot, path: SurfacePath, q: Array, force: Array, source: str) -> None:
    chain = robot.chain
    push = np.zeros((len(q), 6))
    push[:, 3:] = force[:, np.newaxis] * path.n_W
    tau = np.asarray(chain.gravity_torque(q)) - np.einsum("nki,nk->ni", chain.jacobian(q), push)
    share = np.abs(tau) / robot.effort_limit
    i, j = np.unravel_index(int(np.argmax(share)), share.shape)
    if share[i, j] > _MAX_TORQUE_SHARE:
        raise InputError(
            source,
            "force",
            f"{force[i]:g} N at sample {i} needs {abs(tau[i, j]):.3g} N m of "
            f"{robot.joint_names[j]}, whose limit is {robot.effort_limit[j]:g} N m",
            "lower the set-point, or place the workpiece elsewhere",
        )
