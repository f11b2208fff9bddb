"""Mounting of a force sensor: frame, sign, tare and delay, stated or found from its log.

The mounting that is found is the one whose sensor agrees best with the reading, root mean square
over the log:

    frame   the axes of W or of the tool, in quarter turns (24); or stated, with any turn
    sign    whether the sensor reports the force on the robot or the force on the environment
    delay   in steps of a block, up to MAX_DELAY either way
    tare    `fit`: the constant in the sensor's axes, whatever the others are

A force that never changes its direction leaves some of this open. Among mountings that agree within
EQUAL_ERROR_RATIO of the best the simplest is taken, the unturned first; a notice states it where it
matters. A fit of the tare hides a constant error of the reading.
"""

from dataclasses import dataclass, replace
from itertools import permutations, product
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from wrenchsight.analyses.methods.reference_sensor.reference_config import (
    FOUND,
    REFERENCE,
    ReferenceConfig,
    tare_numbers,
)
from wrenchsight.analyses.methods.reference_sensor.sensor_log import SensorLog
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.signals.root_mean_square import rms_length

MAX_DELAY: Final = 0.3  # s
TARE_TIME: Final = 0.5  # s, of the tare `start`
EQUAL_ERROR_RATIO: Final = 1.02  # times the least error: agrees equally well
# times the least error over all delays: the log does not determine the delay
_FLAT_ERROR_RATIO = 1.05
_SEARCH_ROWS = 5000  # of a search
_MAX_ERROR_SHARE = 0.6  # share of the sensor's RMS force: an error above it determines no mounting
_MIN_DIFFERENCE_SHARE = 0.5  # share of the error, beyond which the forces of two mountings differ


@dataclass(frozen=True, eq=False)
class Mounting:
    """Mounting of a sensor: turns its numbers into a wrench on the robot.

    Attributes:
        frame: "world" or "tool".
        R: (3, 3) axes of the sensor in that frame. A single column is a force along its z.
        sign: 1: the sensor reports the force on the robot; -1: the force on the environment.
        tare: (k,) its reading without load.
        delay: s, by which it is late.
    """

    frame: str
    R: Array
    sign: int
    tare: Array
    delay: float

    def on_robot(self, t: Array, sensor: Array, R_WE: Array) -> Array:
        """The wrench on the robot in axes of W (N, 3) or (N, 6), or (N, 1) along `direction`.

        NaN where the log ends before the sensor has followed.

        Args:
            t: (N,) s.
            sensor: (N, k) as logged.
            R_WE: (N, 3, 3).
        """
        shifted = np.stack([_shifted(t, column, self.delay) for column in sensor.T], axis=1)
        wrench = self.sign * (shifted - self.tare)
        if wrench.shape[1] == 1:
            return wrench
        return _turned(self.axes(R_WE), wrench)

    def axes(self, R_WE: Array) -> Array:
        """(N, 3, 3) axes of the sensor in W."""
        turned = np.broadcast_to(np.eye(3), R_WE.shape) if self.frame == "world" else R_WE
        return np.asarray(turned @ self.R)

    def direction(self, R_WE: Array) -> Array:
        """(N, 3) in W, of a single force."""
        return self.axes(R_WE)[:, :, 2]

    def compared(self, wrench: Array, R_WE: Array, columns: int) -> Array:
        """Components (N, columns) of a wrench (N, 6) in W that the sensor measures."""
        if columns == 1:
            return np.asarray(np.sum(wrench[:, :3] * self.direction(R_WE), axis=1)[:, None])
        return wrench[:, :columns]


def find_mounting(log: SensorLog, config: ReferenceConfig) -> tuple[Mounting, tuple[str, ...]]:
    """Finds what the configuration leaves open of the mounting; returns it with notices.

    Each mounting that is left open turns the sensor's numbers into forces; the one whose forces are
    nearest to the reading, over some thousand rows of the log (_SEARCH_ROWS), is taken, of several
    as near the simplest. A delay is found with the one that is best without, and all are compared
    again at this delay. The tare is fitted last.

    Args:
        log: N samples of the reading and of the sensor's k columns: 1 (force along z), 3 (force)
            or 6 (with moment).

    Raises:
        InputError: the log is too short.
    """
    k = log.sensor.shape[1]
    if len(log.t) < 2:
        raise InputError(
            "estimate",
            "--reference",
            "the log has fewer than two blocks to compare with",
            "record a longer log",
        )
    unturned = Mounting(
        frame="world",
        R=np.eye(3),
        sign=1,
        tare=tare_of(log.t, log.sensor, config),
        delay=0.0,
    )
    coarse = log.every(max(1, len(log.t) // _SEARCH_ROWS))
    candidates = _candidates(unturned, config, k)
    notices = []
    delay = _delay(coarse, candidates, config)
    if delay is None:
        notices.append(
            "the log does not determine the sensor's delay: taken as zero; state it with "
            "--reference-delay"
        )
    candidates = [replace(mounting, delay=delay or 0.0) for mounting in candidates]
    best, is_open = _best(coarse, candidates, config)
    if is_open:
        notices.append(
            "the log's forces leave the sensor's axes or sign open: the simplest that agree are "
            "taken; state them with --reference-frame and --reference-sign"
        )
    if config.tare == "fit":
        # (k,) reading less sign * (sensor - tare), in the sensor's axes; with the new tare it is 0.
        mean_error = _error(coarse, best, k).mean(axis=0)
        best = replace(best, tare=best.tare - best.sign * mean_error)
    if len(candidates) > 1:
        # The offset that a stated tare leaves counts as error, too; a fitted tare leaves none.
        error, size = error_of(coarse, best, with_offset=True), _size(coarse, best)
        if error > _MAX_ERROR_SHARE * size:
            notices.append(
                f"the reading differs from the sensor by {error:.3g} N RMS of {size:.3g} N: the "
                "mounting found is uncertain; state it with --reference-frame and "
                "--reference-sign"
            )
    return best, tuple(notices)


def sensor_torque(recording: Recording, robot: Robot, config: ReferenceConfig) -> Array:
    """External torque (N, n) by a log's force sensor, N m; zero where q is missing.

    The mounting is as stated; one column is a force along the axis z of `world` or `tool`. A delay
    that is to be found counts as zero.

    Raises:
        InputError: frame or sign are to be found, or the tare is to be fitted.
    """
    if FOUND in (config.frame, config.sign) or config.tare == "fit":
        problem = "needs the sensor's frame, sign and tare: a calibration finds none of them"
        remedy = "state --reference-frame, --reference-sign and numbers for --reference-tare"
        raise InputError("identify", "--reference", problem, remedy)
    sensor = recording.extra[REFERENCE]
    is_finite = np.asarray(np.isfinite(recording.q).all(axis=1))
    q = np.where(is_finite[:, None], recording.q, 0.0)
    mounting = Mounting(
        frame=config.frame,
        R=_stated_axes(config),
        sign=1 if config.sign == "robot" else -1,
        tare=tare_of(recording.t, sensor, config),
        delay=0.0 if config.delay == FOUND else float(config.delay),
    )
    R_WE, _ = robot.chain.pose(q)
    sensed = mounting.on_robot(recording.t, sensor, R_WE)  # (N, 1), (N, 3) or (N, 6), force first
    wrench = np.zeros((len(sensed), 6))  # at E in axes of W, moment first, as the Jacobian's rows
    wrench[:, 3:] = sensed * mounting.direction(R_WE) if sensed.shape[1] == 1 else sensed[:, :3]
    if sensed.shape[1] == 6:
        wrench[:, :3] = sensed[:, 3:]
    tau_ext = np.einsum("kaj,ka->kj", robot.chain.jacobian(q), wrench)
    is_finite &= np.asarray(np.isfinite(tau_ext).all(axis=1))
    return np.where(is_finite[:, None], tau_ext, 0.0)


def _size(log: SensorLog, mounting: Mounting) -> float:
    """RMS of the sensor's force, N."""
    return float(np.sqrt(np.nanmean(np.sum(_force_vector(log, mounting) ** 2, axis=1))))


def error_of(log: SensorLog, mounting: Mounting, with_offset: bool) -> float:
    """RMS difference of the forces, N.

    Args:
        mounting: mounting of the sensor.
        with_offset: whether a constant in the sensor's axes counts.
    """
    error = _error(log, mounting, min(log.sensor.shape[1], 3))
    if not with_offset:
        error = error - error.mean(axis=0)
    return rms_length(error)


def tare_of(t: Array, sensor: Array, config: ReferenceConfig) -> Array:
    """(k,) reading of a sensor (N, k) without load, as configured; zero where it is fitted."""
    stated_numbers = tare_numbers(config)
    if stated_numbers is not None:
        return np.array(stated_numbers)
    if config.tare == "start":
        return np.asarray(sensor[t <= t[0] + TARE_TIME].mean(axis=0))
    return np.zeros(sensor.shape[1])


def _stated_axes(config: ReferenceConfig) -> Array:
    return np.asarray(Rotation.from_euler("xyz", config.turn or [0.0] * 3).as_matrix())


def _candidates(unturned: Mounting, config: ReferenceConfig, columns: int) -> list[Mounting]:
    """All mountings that the configuration leaves open, the simplest first."""
    signs = {"found": (1, -1), "robot": (1,), "environment": (-1,)}[config.sign]
    if config.frame == FOUND:
        turns = _quarter_turns()
        if columns == 1:  # only the direction of z counts
            turns = _distinct_directions(turns)
            signs = signs if len(signs) == 1 else (1,)
        return [
            replace(unturned, frame=frame, R=R, sign=sign)
            for R, frame, sign in product(turns, ("world", "tool"), signs)
        ]
    R = _stated_axes(config)
    return [replace(unturned, frame=config.frame, R=R, sign=sign) for sign in signs]


def _distinct_directions(turns: list[Array]) -> list[Array]:
    """The first turn of each direction of z."""
    directions: set[tuple[int, ...]] = set()
    distinct = []
    for R in turns:
        direction = tuple(int(x) for x in np.round(R[:, 2]))
        if direction not in directions:
            directions.add(direction)
            distinct.append(R)
    return distinct


def _quarter_turns() -> list[Array]:
    """The 24 rotations that take axes to axes, the smallest first."""
    turns = []
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        R = np.zeros((3, 3))
        R[list(order), range(3)] = signs
        if np.linalg.det(R) > 0.0:
            turns.append(R)
    return sorted(turns, key=lambda R: -float(np.trace(R)))


def _best(
    log: SensorLog, candidates: list[Mounting], config: ReferenceConfig
) -> tuple[Mounting, bool]:
    """The simplest of the best, and whether another as good gives other forces."""
    errors = [error_of(log, mounting, config.tare != "fit") for mounting in candidates]
    least = min(errors)
    best, *others = [
        mounting
        for mounting, error in zip(candidates, errors, strict=True)
        if error <= EQUAL_ERROR_RATIO * least + 1e-9
    ]
    force = _force_vector(log, best)
    for mounting in others:
        difference = _force_vector(log, mounting) - force
        rms = float(np.sqrt(np.nanmean(np.sum(difference**2, axis=1))))
        if rms > _MIN_DIFFERENCE_SHARE * least + 1e-9:
            return best, True
    return best, False


def _force_vector(log: SensorLog, mounting: Mounting) -> Array:
    """(N, 3) N on the robot in axes of W, as the mounting has it."""
    sensor = mounting.on_robot(log.t, log.sensor, log.R_WE)
    return sensor[:, :3] if sensor.shape[1] > 1 else sensor * mounting.direction(log.R_WE)


def _error(log: SensorLog, mounting: Mounting, columns: int) -> Array:
    """Reading less sensor in the sensor's axes, where both are known."""
    sensor = mounting.on_robot(log.t, log.sensor, log.R_WE)[:, :columns]
    error = mounting.compared(log.reading, log.R_WE, columns) - sensor
    if columns > 1:
        error = _turned(mounting.axes(log.R_WE).transpose(0, 2, 1), error)
    return np.asarray(error[np.isfinite(error).all(axis=1)])


def _turned(R: Array, x: Array) -> Array:
    """R (N, 3, 3) times each three columns of x (N, k)."""
    parts = [np.einsum("kij,kj->ki", R, x[:, s : s + 3]) for s in range(0, x.shape[1], 3)]
    return np.concatenate(parts, axis=1)


def _delay(log: SensorLog, candidates: list[Mounting], config: ReferenceConfig) -> float | None:
    """s, stated or found with the best of the candidates; None where the log does not tell it."""
    if config.delay != FOUND:
        return float(config.delay)
    best, _ = _best(log, candidates, config)
    return _found_delay(log, best, config)


def _found_delay(log: SensorLog, mounting: Mounting, config: ReferenceConfig) -> float | None:
    """s; None where the log does not determine it: all fit alike, or the longest fits best."""
    step = log.step
    reach = max(1, round(MAX_DELAY / step))
    delays = [k * step for k in sorted(range(-reach, reach + 1), key=abs)]
    errors = [error_of(log, replace(mounting, delay=d), config.tare != "fit") for d in delays]
    best = delays[int(np.argmin(errors))]
    if max(errors) <= _FLAT_ERROR_RATIO * min(errors) or abs(best) >= reach * step:
        return None
    return best


def _shifted(t: Array, signal: Array, delay: float) -> Array:
    """The signal `delay` later; NaN beyond the log."""
    if delay == 0.0:
        return signal
    return np.interp(t + delay, t, signal, left=np.nan, right=np.nan)
