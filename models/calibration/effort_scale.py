"""Torque per unit of what a log calls current or effort, joint by joint, from known weights.

The unit u of a joint's effort is not known: amperes, per mille of a rated current, N m behind a
factor. What holds the arm is known, either

- the URDF's masses: u = b (gravity + inertia) + rotor vdot + Coulomb sgn(v) + viscous v + offset,
  by least squares over a motion (`scale_from_gravity`); or
- one weight on the flange in two or more postures, each held with and without it: the difference
  of u is b times the weight's torque, whatever the arm weighs (`scale_from_weight`).

The torque per unit is 1 / b. u holds the noise, the torque none, so that b is not biased. Errors
last: their covariance is that of sums over BLOCK seconds (Liang and Zeger, Biometrika 73, 1986).
What the standard errors do not hold is an error of the masses, which b takes over as it is.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrenchsight.models.calibration.load_parameters import load_columns
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.resampling import resampled
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.signals.zero_phase import ZeroPhaseLowPass, derivative

BLOCK = 2.5  # s that an error of a model at rest lasts
SEEN = 0.1  # relative standard error from which on gravity does not show a joint
_GRAVITY_SHARE = 0.1  # of the variance of gravity and inertia together
_CUTOFF, _MOST_CUTOFF = 5.0, 0.2  # Hz; of the sampling rate
_TURN = 0.02  # of the speed limit, within which friction's sign fades
_EVERY = 0.05  # s between rows of the fit
_LEAST_BLOCKS = 6
_STILL, _HELD = 0.01, 0.5  # rad/s (m/s) below which an arm is held, and s
_SAME = 0.03  # rad or m by which a posture may differ when it is taken again


@dataclass(frozen=True, eq=False)
class EffortScale:
    """What was found of each joint.

    Attributes:
        torque_per_unit: (n,) N m (N) per unit of effort, with its sign; nan where not known.
        standard_error: (n,) of it.
        gravity: (n,) N m, sd of the known torque over the rows.
        count: rows, or pairs of postures.
    """

    torque_per_unit: Array
    standard_error: Array
    gravity: Array
    count: int

    @property
    def seen(self) -> Flags:
        """(n,) whether the joint's scale is known to SEEN."""
        with np.errstate(invalid="ignore"):
            known = self.standard_error < SEEN * np.abs(self.torque_per_unit)
        return np.asarray(known & np.isfinite(self.torque_per_unit))


def scale_from_gravity(recordings: Sequence[Recording], robot: Robot) -> EffortScale:
    """From the masses of the robot's file.

    Args:
        recordings: of free motion; `tau_J` is the effort where there is one, else `current`.

    Raises:
        InputError: the robot has no inertias, or motors that share joints; too short a log.
    """
    robot.require_inertias("identify --scale")
    _refuse_coupled(robot)
    rows = [_rows(one, robot) for one in recordings]
    n = robot.num_joints
    effort, known, gravity, vdot, v, block = (
        np.concatenate([part[k] for part in rows]) for k in range(6)
    )
    block += np.repeat(
        np.cumsum([0, *(part[5].max(initial=0.0) + 1.0 for part in rows[:-1])]),
        [len(part[5]) for part in rows],
    )
    if len(np.unique(block)) < _LEAST_BLOCKS:
        least = _LEAST_BLOCKS * BLOCK
        problem = f"lasts less than the {least:g} s that standard errors take"
        raise InputError(recordings[0].source, "", problem, "log a longer motion")
    turn = _TURN * np.where(np.isfinite(robot.velocity_limit), robot.velocity_limit, 1.0)
    found, error = np.full(n, np.nan), np.full(n, np.inf)
    for j in range(n):
        # Gravity must show: a torque of inertia alone looks like the rotor's, which is not known.
        if np.var(gravity[:, j]) < _GRAVITY_SHARE * np.var(known[:, j]) or not known[:, j].any():
            continue
        columns = [known[:, j], np.ones(len(known))]
        motion = (vdot[:, j], np.tanh(v[:, j] / turn[j]), v[:, j])
        columns += [column for column in motion if np.std(column) > 1e-6]
        b, sd = _slope(np.stack(columns, axis=1), effort[:, j], block)
        if b != 0.0:
            found[j], error[j] = 1.0 / b, sd / b**2
    return EffortScale(found, error, np.std(gravity, axis=0), len(known))


def scale_from_weight(
    empty: Sequence[Recording],
    laden: Sequence[Recording],
    robot: Robot,
    parameters: Array,
) -> EffortScale:
    """From one weight, in postures that are held with it and without it.

    Args:
        empty, laden: logs without and with the weight.
        parameters: (10,) of the weight, in the flange's frame, as `load_parameters`.

    Raises:
        InputError: less than two postures are held in both; motors that share joints.
    """
    _refuse_coupled(robot)
    before = [held for one in empty for held in _held(one)]
    after = [held for one in laden for held in _held(one)]
    q, change = [], []
    for posture, effort in after:
        near = [u for at, u in before if np.abs(at - posture).max() < _SAME]
        if near:
            q.append(posture)
            change.append(effort - np.mean(near, axis=0))
    if len(q) < 2:
        problem = f"{len(q)} postures are held {_HELD:g} s with the weight and without it, expected"
        problem += " two or more"
        remedy = f"hold the same postures, within {_SAME:g} rad, in both logs"
        raise InputError(laden[0].source, "", problem, remedy)
    still = np.zeros((len(q), robot.num_joints))
    torque = load_columns(robot, np.array(q), still, still) @ parameters
    u = np.array(change)
    squares = (torque**2).sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        b = (torque * u).sum(axis=0) / squares
        left = u - b * torque
        sd = np.sqrt((left**2).sum(axis=0) / (len(q) - 1) / squares)
        found, error = 1.0 / b, sd / b**2
    loaded = np.sqrt(squares / len(q)) > 1e-3 * np.sqrt(squares.max() / len(q))
    found = np.where(loaded & np.isfinite(found), found, np.nan)
    return EffortScale(found, error, np.sqrt(squares / len(q)), len(q))


def _refuse_coupled(robot: Robot) -> None:
    if robot.is_coupled:
        problem = "motors that share joints have no scale of their own"
        raise InputError("identify", "--scale", problem, "state torque_per_ampere in robot.yaml")


def _effort(recording: Recording) -> Array:
    return recording.current if recording.tau_J is None else recording.tau_J


def _rows(recording: Recording, robot: Robot) -> tuple[Array, ...]:
    """Effort, known torque, gravity, vdot and v (N, n) and block (N,) of a log, low-passed."""
    step = float(f"{recording.time_step:.3g}")
    uniform = resampled(recording, step)
    cutoff = min(_CUTOFF, _MOST_CUTOFF / step)
    low_pass = ZeroPhaseLowPass(cutoff, step, 5)
    if uniform.duration < 5.0 / cutoff:
        raise InputError(recording.source, "", "is too short to be filtered", "log a longer motion")
    q, v, effort = low_pass(uniform.q), low_pass(uniform.v), low_pass(_effort(uniform))
    vdot = derivative(v, step)
    whole = ~uniform.dropout & np.isfinite(q + v + effort).all(axis=1)
    trim = int(np.ceil(2.5 / cutoff / step))
    whole[:trim] = whole[len(whole) - trim :] = False
    rows = np.flatnonzero(whole)[:: max(1, round(_EVERY / step))]
    q, v, vdot = (np.ascontiguousarray(x[rows]) for x in (q, v, vdot))
    known = np.asarray(robot.chain.inverse_dynamics(q, v, vdot))
    gravity = np.asarray(robot.chain.gravity_torque(q))
    block = np.floor((uniform.t[rows] - uniform.t[0]) / BLOCK)
    return effort[rows], known, gravity, vdot, v, block


def _slope(A: Array, y: Array, block: Array) -> tuple[float, float]:
    """The first coefficient by least squares, and its standard error by sums over blocks."""
    scale = np.sqrt((A**2).mean(axis=0))
    A = A / scale
    x, *_ = np.linalg.lstsq(A, y, rcond=1e-9)
    scores = A * (y - A @ x)[:, None]
    names = np.unique(block)
    sums = np.stack([scores[block == name].sum(axis=0) for name in names])
    inverse = np.linalg.pinv(A.T @ A, rcond=1e-9)
    free = max(1, len(names) - A.shape[1])
    covariance = inverse @ (sums.T @ sums) @ inverse * len(names) / free
    return float(x[0] / scale[0]), float(np.sqrt(covariance[0, 0]) / scale[0])


def _held(recording: Recording) -> list[tuple[Array, Array]]:
    """Posture (n,) and effort (n,) of each stretch in which the arm is held."""
    still = (np.abs(recording.v) < _STILL).all(axis=1) & ~recording.dropout
    edges = np.flatnonzero(np.diff(np.r_[False, still, False].astype(np.int8)))
    effort = _effort(recording)
    return [
        (recording.q[begin:end].mean(axis=0), effort[begin:end].mean(axis=0))
        for begin, end in edges.reshape(-1, 2)
        if recording.t[end - 1] - recording.t[begin] >= _HELD
    ]
