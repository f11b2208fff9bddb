"""What an arm's logs say of it beyond its model: statistics that a simulated arm should share.

All are one number a joint, of logs without contact, about a model that was identified on some of
them; torque errors are low-passed as in that identification.

    residual        RMS of the torque error, by joint speed
    correlation     time in which the error's autocorrelation falls to 1/e
    drift           RMS over days of what the error grows with velocity, and with its sign
    load            the error with a payload, once the payload's ten parameters are taken off, and
                    the share of it that is that of the same motion without
    repeatability   passes to and fro of one joint: torque at the same place, speed and direction
    rest            the error while a joint has not moved for REST_TIME: what dry friction keeps
    noise           what is in the currents above the joints' motion, by band; with and without it
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.signal import correlate

from wrenchsight.analyses.methods.calibration.model_residual import ModelResidual
from wrenchsight.models.arrays import Array
from wrenchsight.models.calibration.load_parameters import load_columns
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.resampling import resampled
from wrenchsight.models.robot.robot import Robot

SPEEDS = (0.0, 0.01, 0.03, 0.1, 0.3, np.inf)  # rad/s, edges of the bins
FEWEST = 60  # samples in a bin
REST_SPEED, REST_TIME = 0.005, 0.3  # rad/s, s
TURN = 0.02  # rad/s, over which dry friction's sign is smoothed in a regression
BANDS = ((5.0, 12.0), (12.0, 25.0), (25.0, 45.0))  # Hz
TIME_STEP = 0.01  # s
PLACE = 0.02  # rad, in which torques of passes are averaged
SAME_SPEED = 0.03  # rad/s, in which two passes have one speed


@dataclass(frozen=True, eq=False)
class TorqueError:
    """The torque error of a log: (N,) s, (N, n) rad/s, rad/s, N m."""

    t: Array
    v: Array
    error: Array
    residual: ModelResidual
    used: NDArray[np.bool_]

    @classmethod
    def of(cls, recording: Recording, robot: Robot, model: IdentifiedModel) -> "TorqueError":
        """Of a recording; errors as `ModelResidual.of`."""
        residual = ModelResidual.of(recording, robot, model)
        log = residual.log
        rigid = np.asarray(residual.chain.inverse_dynamics(log.q, log.v, log.vdot))
        predicted = log.match(rigid + model.friction.torque_along(log.q, log.v, rigid))
        used = log.used
        return cls(log.t[used], log.v[used], (log.tau - predicted)[used], residual, used)

    def without_load(self) -> "TorqueError":
        """With the payload taken off that explains it best."""
        log = self.residual.log
        columns = log.match(load_columns(self.residual.robot, log.q, log.v, log.vdot))[self.used]
        n = self.error.shape[1]
        scale = 1.0 / np.sqrt(np.mean(self.error**2, axis=0))
        rows = (columns * scale[:, None]).reshape(-1, 10)
        load, *_ = np.linalg.lstsq(rows, (self.error * scale).ravel(), rcond=1e-8)
        left = self.error - (columns @ load).reshape(-1, n)
        return TorqueError(self.t, self.v, left, self.residual, self.used)


def residual_by_speed(errors: list[TorqueError]) -> dict[str, Array]:
    """RMS (n,) N m of each bin of SPEEDS; NaN where a joint is in it too seldom."""
    v, error = np.vstack([e.v for e in errors]), np.vstack([e.error for e in errors])
    result = {"all": np.sqrt(np.mean(error**2, axis=0))}
    for low, high in pairwise(SPEEDS):
        inside = (np.abs(v) >= low) & (np.abs(v) < high)
        count = inside.sum(axis=0)
        mean = (error**2 * inside).sum(axis=0) / np.maximum(count, 1)
        result[_bin(low, high)] = np.where(count >= FEWEST, np.sqrt(mean), np.nan)
    return result


def _bin(low: float, high: float) -> str:
    low, high = 1e3 * low, 1e3 * high
    if low == 0.0:
        return f"below_{high:g}_mrad_per_s"
    return f"above_{low:g}_mrad_per_s" if np.isinf(high) else f"{low:g}_to_{high:g}_mrad_per_s"


def correlation_time(errors: list[TorqueError]) -> Array:
    """(n,) s in which the error's autocorrelation falls to 1/e, averaged over the logs."""
    times = []
    for log in errors:
        step = float(np.median(np.diff(log.t)))
        x = log.error - log.error.mean(axis=0)
        own = np.stack([correlate(one, one)[len(x) - 1 :] for one in x.T], axis=1)
        times.append(step * np.argmax(own < own[0] / np.e, axis=0))
    return np.asarray(np.mean(times, axis=0))


def drift(errors: list[TorqueError]) -> dict[str, Array]:
    """RMS (n,) over the logs of the error's slope in velocity, N m s/rad, and in its sign, N m."""
    slopes = []
    for log in errors:
        slope = []
        for v, error in zip(log.v.T, log.error.T, strict=True):
            A = np.stack([v, np.tanh(v / TURN), np.ones_like(v)], axis=1)
            slope.append(np.linalg.lstsq(A, error, rcond=None)[0][:2])
        slopes.append(np.transpose(slope))
    viscous, dry = np.sqrt(np.mean(np.square(slopes), axis=0))
    return {"viscous_nms_per_rad": viscous, "dry_nm": dry}


def load_statistics(free: TorqueError, loaded: TorqueError) -> dict[str, Array]:
    """Of one motion without and with a payload: RMS N m with it, ratio to without, and repeated."""
    carried = loaded.without_load()
    rms = np.sqrt(np.mean(carried.error**2, axis=0))
    without = np.sqrt(np.mean(free.error**2, axis=0))
    # The two logs began at their own moments: they are laid on each other by their positions.
    shift = _shift(free, carried)
    t = free.t - free.t[0]
    later = carried.t - carried.t[0] - shift
    inside = (t >= later[0]) & (t <= later[-1])
    other = np.stack([np.interp(t[inside], later, one) for one in carried.error.T], axis=1)
    difference = other - free.error[inside]
    return {
        "residual_nm": rms,
        "over_unloaded": rms / without,
        "difference_nm": np.sqrt(np.mean(difference**2, axis=0)) / np.sqrt(2.0),
    }


def _shift(first: TorqueError, second: TorqueError) -> float:
    """How much later, s, the second's motion comes in its log than the first's."""
    t = first.t - first.t[0]
    times = second.t - second.t[0]
    shifts = np.arange(-8.0, 8.0, 0.02)
    middle = (t > 0.2 * t[-1]) & (t < 0.8 * t[-1])

    def gap(shift: float) -> float:
        moved = [np.interp(t[middle] + shift, times, v) for v in second.v.T]
        return float(np.sum((np.transpose(moved) - first.v[middle]) ** 2))

    return float(shifts[int(np.argmin([gap(shift) for shift in shifts]))])


def pass_repeatability(recording: Recording, robot: Robot, joint: int) -> float:
    """RMS, N m, by which single passes of a joint differ from the mean of those alike.

    Of torque averaged over PLACE, at one speed and in one direction; NaN without passes alike.
    """
    uniform = resampled(recording, TIME_STEP)
    q, v = uniform.q[:, joint], uniform.v[:, joint]
    tau = robot.joint_torque(uniform.current)[:, joint]
    moving = (np.abs(np.gradient(v, TIME_STEP)) < 0.1) & (np.abs(v) > 0.02)
    number = np.cumsum(np.diff(np.sign(v), prepend=np.sign(v[0])) != 0)
    keys = np.stack([np.rint(q / PLACE), np.rint(v / SAME_SPEED), number])[:, moving]
    # The mean of each pass in each cell of place and speed, then their spread within the cells
    of_pass, which = np.unique(keys, axis=1, return_inverse=True)
    means = np.bincount(which, tau[moving]) / np.bincount(which)
    _, cell, passes_in = np.unique(of_pass[:2], axis=1, return_inverse=True, return_counts=True)
    spread = np.sum((means - (np.bincount(cell, means) / passes_in)[cell]) ** 2)
    count = np.sum(passes_in - 1)
    return float(np.sqrt(spread / count)) if count >= FEWEST else float("nan")


def at_rest(error: TorqueError) -> Array:
    """RMS (n,) N m of the error of joints that have not moved for REST_TIME; NaN where none has."""
    step = float(np.median(np.diff(error.t)))
    moves = np.abs(error.v) > REST_SPEED
    window = np.ones(max(1, round(REST_TIME / step)))
    result = np.full(error.v.shape[1], np.nan)
    for j in range(len(result)):
        rest = np.convolve(moves[:, j], window)[: len(moves)] == 0.0
        if rest.sum() >= FEWEST:
            result[j] = np.sqrt(np.mean(error.error[rest, j] ** 2))
    return result


def current_noise(recordings: list[Recording], moving: bool) -> dict[str, Array]:
    """RMS (n,) A in each of BANDS, of joints that move (or rest), by windows of 1.28 s."""
    length = 128
    n = recordings[0].num_joints
    taper = np.hanning(length)
    frequency = np.fft.rfftfreq(length, TIME_STEP)
    sums = np.zeros((len(BANDS), n))
    count = np.zeros(n)
    for recording in recordings:
        uniform = resampled(recording, TIME_STEP)
        for k in range(0, uniform.num_samples - length, length // 2):
            v = np.abs(uniform.v[k : k + length])
            fits = v.mean(axis=0) > 0.05 if moving else v.max(axis=0) < REST_SPEED
            part = uniform.current[k : k + length]
            x = (part - part.mean(axis=0)) * taper[:, None]
            density = np.abs(np.fft.rfft(x, axis=0)) ** 2 * 2 / (length * np.sum(taper**2))
            for b, (low, high) in enumerate(BANDS):
                inside = (frequency >= low) & (frequency < high)
                sums[b] += np.where(fits, density[inside].sum(axis=0), 0.0)
            count += fits
    rms = np.sqrt(sums / np.maximum(count, 1))
    return {
        f"{low:g}_to_{high:g}_hz_a": np.where(count >= 5, rms[b], np.nan)
        for b, (low, high) in enumerate(BANDS)
    }
