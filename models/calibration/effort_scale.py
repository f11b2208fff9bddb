"""Effort scale: torque per unit of a log's current or effort, joint by joint, from known weights.

The unit of a joint's effort u is not known: amperes, per mille of a rated current, N m behind a
factor. The torque that the arm needs is known, either from

- the URDF's masses: u = b (gravity + inertia) + rotor vdot + Coulomb sgn(v) + viscous v + offset,
  by least squares over a motion (`scale_from_gravity`); or
- one weight on the flange in two or more postures, each held with and without it: the difference
  of u is b times the weight's torque, whatever the arm weighs (`scale_from_weight`).

The torque per unit is 1 / b. Only u is noisy, so that b is not biased. Errors are correlated over
time: their covariance is that of sums over REST_ERROR_TIME seconds (Liang and Zeger, Biometrika 73,
1986). An error of the stated masses goes into b in full; the standard errors do not include it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from wrenchsight.models.calibration.load_parameters import load_columns
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.numerics.stretches import stretches
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.resampling import resampled
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.signals.root_mean_square import rms
from wrenchsight.models.signals.zero_phase import ZeroPhaseLowPass, derivative

REST_ERROR_TIME = 2.5  # s that an error of a model at rest lasts
MAX_SCALE_ERROR = 0.1  # relative standard error below which a joint's scale is determined
_MIN_GRAVITY_SHARE = 0.1  # of the variance of gravity and inertia together
_CUTOFF_FREQUENCY, _MAX_CUTOFF_SHARE = 5.0, 0.2  # Hz; of the sampling rate
_SIGN_FADING_SHARE = 0.02  # of the speed limit, within which friction's sign fades
_MIN_COLUMN_SD = 1e-6  # rad/s^2, 1 or rad/s: a column that varies less is the offset's
_ROW_PERIOD = 0.05  # s between rows of the fit
_FILTER_ORDER = 5  # of the low-pass: steep, as all columns and the effort go through it
_TRIM_PERIODS = 2.5  # of the cutoff frequency, at both ends, in which the low-pass settles
_MIN_SINGULAR_RATIO = 1e-9  # of the columns' singular values: less, and one depends on the others
_MIN_BLOCKS = 6  # blocks of REST_ERROR_TIME, one more than the columns of a joint
_HELD_SPEED, _HELD_TIME = 0.01, 0.5  # rad/s (m/s) below which an arm is held, and s
_POSTURE_TOLERANCE = 0.03  # rad or m by which a posture may differ when it is taken again
_MIN_WEIGHT_SHARE = 1e-3  # rms torque of the weight, of that at the most loaded joint


@dataclass(frozen=True, eq=False)
class EffortScale:
    """Torque per unit of effort of each joint.

    Attributes:
        torque_per_unit: (n,) N m (N) per unit of effort, with its sign; nan where not known.
        standard_error: (n,) of it; says nothing where the scale is not known.
        known_torque_sd: (n,) N m, of the known torque: sd of gravity over the rows, or root mean
            square of the weight's over the postures.
        count: rows, or pairs of postures.
    """

    torque_per_unit: Array
    standard_error: Array
    known_torque_sd: Array
    count: int

    @property
    def is_determined(self) -> Flags:
        """(n,) whether the joint's scale is known to within MAX_SCALE_ERROR."""
        with np.errstate(invalid="ignore"):
            is_precise = self.standard_error < MAX_SCALE_ERROR * np.abs(self.torque_per_unit)
        return np.asarray(is_precise & np.isfinite(self.torque_per_unit))


def scale_from_gravity(recordings: Sequence[Recording], robot: Robot) -> EffortScale:
    """Returns the scale from the masses of the robot's file.

    Of each joint effort = b torque + offset + rotor, dry and viscous terms is fitted; the scale is
    1 / b in N m (N) per unit of effort, NaN with an infinite error where gravity hardly loads it.

    Args:
        recordings: recordings of free motion; `tau_J` is the effort where there is one, else
            `current`.

    Raises:
        InputError: the robot has no inertias, or motors that share joints; too short a log.
    """
    robot.require_inertias("identify --scale")
    _refuse_coupled(robot)
    rows = _joined([_motion_rows(recording, robot) for recording in recordings])
    n = robot.num_joints
    if len(np.unique(rows.block)) < _MIN_BLOCKS:
        least_duration = _MIN_BLOCKS * REST_ERROR_TIME
        problem = f"lasts less than the {least_duration:g} s that standard errors need"
        raise InputError(recordings[0].source, "", problem, "log a longer motion")
    # A robot's file without a speed limit counts as one of 1 rad/s.
    fading_speed = _SIGN_FADING_SHARE * np.where(
        np.isfinite(robot.velocity_limit), robot.velocity_limit, 1.0
    )
    torque_per_unit, error = np.full(n, np.nan), np.full(n, np.inf)
    for j in range(n):
        torque, v = rows.torque[:, j], rows.v[:, j]
        # Gravity must show: torque of inertia alone cannot be separated from an unknown rotor's.
        if np.var(rows.gravity[:, j]) < _MIN_GRAVITY_SHARE * np.var(torque) or not torque.any():
            continue
        columns = [torque, np.ones(len(torque))]  # b is the first one's coefficient
        rotor, coulomb, viscous = rows.vdot[:, j], np.tanh(v / fading_speed[j]), v
        # One that hardly varies is the offset's column again.
        columns += [x for x in (rotor, coulomb, viscous) if np.std(x) > _MIN_COLUMN_SD]
        b, b_sd = _slope(np.stack(columns, axis=1), rows.effort[:, j], rows.block)
        if b != 0.0:
            torque_per_unit[j], error[j] = 1.0 / b, b_sd / b**2
    return EffortScale(
        torque_per_unit=torque_per_unit,
        standard_error=error,
        known_torque_sd=np.std(rows.gravity, axis=0),
        count=len(rows.block),
    )


def scale_from_weight(
    empty: Sequence[Recording],
    laden: Sequence[Recording],
    robot: Robot,
    parameters: Array,
) -> EffortScale:
    """Returns the scale from one weight, in postures that are held with it and without it.

    Of each joint the change of effort is b times the weight's torque, by least squares over the
    postures; the scale is 1 / b in N m (N) per unit of effort, NaN where the weight hardly loads
    it. A posture of `laden` is compared with the mean of those of `empty` within
    _POSTURE_TOLERANCE; one that `empty` lacks does not count.

    Args:
        empty, laden: logs without and with the weight.
        robot: its kinematics and gravity.
        parameters: (10,) of the weight, in the flange's frame, as `load_parameters`.

    Raises:
        InputError: less than two postures are held in both; motors that share joints.
    """
    _refuse_coupled(robot)
    held_empty = [held for recording in empty for held in _held_postures(recording)]
    held_laden = [held for recording in laden for held in _held_postures(recording)]
    q: list[Array] = []
    changes: list[Array] = []
    for held in held_laden:
        efforts = [
            other.effort
            for other in held_empty
            if np.abs(other.q - held.q).max() < _POSTURE_TOLERANCE
        ]
        if efforts:
            q.append(held.q)
            changes.append(held.effort - np.mean(efforts, axis=0))
    if len(q) < 2:
        problem = (
            f"{len(q)} postures are held {_HELD_TIME:g} s with the weight and without it, expected "
            "two or more"
        )
        remedy = f"hold the same postures, within {_POSTURE_TOLERANCE:g} rad, in both logs"
        raise InputError(laden[0].source, "", problem, remedy)
    still = np.zeros((len(q), robot.num_joints))
    torque = load_columns(robot, np.array(q), still, still) @ parameters
    effort_change = np.array(changes)
    squares = (torque**2).sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):  # a joint that the weight does not load
        b = (torque * effort_change).sum(axis=0) / squares
        residual = effort_change - b * torque
        b_sd = np.sqrt((residual**2).sum(axis=0) / (len(q) - 1) / squares)
        torque_per_unit, error = 1.0 / b, b_sd / b**2
    rms_torque = np.sqrt(squares / len(q))
    is_loaded = rms_torque > _MIN_WEIGHT_SHARE * np.sqrt(squares.max() / len(q))
    return EffortScale(
        torque_per_unit=np.where(is_loaded & np.isfinite(torque_per_unit), torque_per_unit, np.nan),
        standard_error=error,
        known_torque_sd=rms_torque,
        count=len(q),
    )


def _refuse_coupled(robot: Robot) -> None:
    if robot.is_coupled:
        problem = "motors that share joints: the scale of a single joint is not defined"
        raise InputError("identify", "--scale", problem, "state torque_per_ampere in robot.yaml")


def _effort(recording: Recording) -> Array:
    return recording.current if recording.tau_J is None else recording.tau_J


class _MotionRows(NamedTuple):
    """Low-passed rows of free motion.

    Attributes:
        effort: (N, n) in the log's unit.
        torque: (N, n) N m (N), gravity and inertia of the robot's file.
        gravity: (N, n) N m (N), its gravity part.
        vdot: (N, n) rad/s^2 (m/s^2).
        v: (N, n) rad/s (m/s).
        block: (N,) number of the row's block of REST_ERROR_TIME seconds.
    """

    effort: Array
    torque: Array
    gravity: Array
    vdot: Array
    v: Array
    block: Array


def _joined(parts: Sequence[_MotionRows]) -> _MotionRows:
    """Rows of several logs; each log has blocks of its own."""
    rows = _MotionRows(*map(np.concatenate, zip(*parts, strict=True)))
    num_blocks = [part.block.max(initial=0.0) + 1.0 for part in parts[:-1]]
    first_block = np.repeat(np.cumsum([0, *num_blocks]), [len(part.block) for part in parts])
    return rows._replace(block=rows.block + first_block)


def _motion_rows(recording: Recording, robot: Robot) -> _MotionRows:
    step = float(f"{recording.time_step:.3g}")
    uniform = resampled(recording, step)
    cutoff = min(_CUTOFF_FREQUENCY, _MAX_CUTOFF_SHARE / step)
    low_pass = ZeroPhaseLowPass(cutoff, step, _FILTER_ORDER)
    if uniform.duration < 2.0 * _TRIM_PERIODS / cutoff:
        raise InputError(recording.source, "", "is too short to be filtered", "log a longer motion")
    q, v, effort = low_pass(uniform.q), low_pass(uniform.v), low_pass(_effort(uniform))
    vdot = derivative(v, step)
    whole = ~uniform.dropout & np.isfinite(q + v + effort).all(axis=1)
    trim = int(np.ceil(_TRIM_PERIODS / cutoff / step))
    whole[:trim] = whole[len(whole) - trim :] = False
    rows = np.flatnonzero(whole)[:: max(1, round(_ROW_PERIOD / step))]
    q, v, vdot = (np.ascontiguousarray(x[rows]) for x in (q, v, vdot))
    torque = np.asarray(robot.chain.inverse_dynamics(q, v, vdot))
    gravity = np.asarray(robot.chain.gravity_torque(q))
    block = np.floor((uniform.t[rows] - uniform.t[0]) / REST_ERROR_TIME)
    return _MotionRows(effort[rows], torque, gravity, vdot, v, block)


def _slope(A: Array, y: Array, block: Array) -> tuple[float, float]:
    """The first coefficient by least squares, and its standard error by sums over blocks."""
    scale = rms(A)
    A = A / scale
    x, *_ = np.linalg.lstsq(A, y, rcond=_MIN_SINGULAR_RATIO)
    scores = A * (y - A @ x)[:, None]
    names = np.unique(block)
    sums = np.stack([scores[block == name].sum(axis=0) for name in names])
    inverse = np.linalg.pinv(A.T @ A, rcond=_MIN_SINGULAR_RATIO)
    free = max(1, len(names) - A.shape[1])
    covariance = inverse @ (sums.T @ sums) @ inverse * len(names) / free
    return float(x[0] / scale[0]), float(np.sqrt(covariance[0, 0]) / scale[0])


class _HeldPosture(NamedTuple):
    """Means over a stretch in which the arm is held: q (n,) rad (m), effort (n,)."""

    q: Array
    effort: Array


def _held_postures(recording: Recording) -> list[_HeldPosture]:
    """Returns each stretch of at least _HELD_TIME seconds in which the arm is held."""
    still = (np.abs(recording.v) < _HELD_SPEED).all(axis=1) & ~recording.dropout
    effort = _effort(recording)
    return [
        _HeldPosture(recording.q[rest].mean(axis=0), effort[rest].mean(axis=0))
        for rest in stretches(np.asarray(still))
        if recording.t[rest.stop - 1] - recording.t[rest.start] >= _HELD_TIME
    ]
