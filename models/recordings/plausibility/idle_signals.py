"""Signals that a driver does not fill, or fills in another unit: velocities, time."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.recording import Recording

TIME_UNITS = {"ms": 1e-3, "us": 1e-6, "100 ns": 1e-7, "ns": 1e-9, "days": 86400.0}
# Numbers that dates from 2001 to 2099 have: since 1970; in steps of 100 ns since 1601 (Windows), or
# since the year 1 (.NET).
_DATES = (
    ("ms", 9.8e11, 4.1e12),
    ("us", 9.8e14, 4.1e15),
    ("ns", 9.8e17, 4.1e18),
    ("100 ns", 1.26e17, 1.58e17),
    ("100 ns", 6.31e17, 6.63e17),
)
_LEAST_STEP, _LARGEST_STEP = 1e-4, 0.25  # s, of a log of motor currents
_LARGEST_DAY_STEP = _LARGEST_STEP / 86400.0  # of a clock that counts days: no other is so fast
_DAYS_OF_DATES = (
    (3.6e4, 7.5e4),
    (7.25e5, 7.7e5),
)  # of such dates: of spreadsheets, and since the year 0
_SMALLEST_COUNT = 1.0  # in which a clock of ms, us or ns steps
_MAX_PATH_RATIO = 3.0  # factor by which the path may differ from the integral of the speed
MIN_TRAVEL = 5e-3  # rad or m, beyond what an encoder rounds
_SMALLEST_SPEED = 1e-9  # rad/s or m/s
_MEASURED_SIZES = (1e-200, 1e15)  # of a number that is not zero, in any unit
_UNWRITTEN_SHARE = 0.5  # of a column's numbers that are none of these
_HELD_SHARE = 0.9  # of the changes that come after one number of rows
_MIN_SAMPLES = 100  # in which a torque of a moving arm does not stay the same


def idle_velocities(part: Recording) -> NDArray[np.intp] | None:
    """The joints whose velocity is one constant while they move another way.

    Where another joint has a velocity and stands still, the columns are exchanged rather than
    idle: no joint is then returned.

    Args:
        part: the first samples of a log.

    Returns:
        The joints, counted from 0; None where no joint moves.
    """
    is_complete = np.asarray(np.isfinite(np.hstack([part.q, part.v])).all(axis=1))
    complete = part[is_complete]
    if complete.num_samples < 2:
        return None
    q, v, t = complete.q, complete.v, complete.t - complete.t[0]
    distance = travel(complete)
    if not (distance > MIN_TRAVEL).any():
        return None
    path = np.abs(np.trapezoid(v, t, axis=0))  # how far the velocity says that a joint moved
    is_exchanged = (distance == 0.0) & (path > MIN_TRAVEL)
    # A velocity that is constant and right, as of a joint that turns evenly, leaves nothing over.
    unexplained = np.ptp(q - v[0] * t[:, None], axis=0)
    is_idle = (np.ptp(v, axis=0) < _SMALLEST_SPEED) & (
        np.minimum(distance, unexplained) > MIN_TRAVEL
    )
    if is_exchanged.any():
        return np.empty(0, np.intp)
    return np.flatnonzero(is_idle)


def travel(part: Recording) -> Array:
    """(n,) rad or m: how far each joint goes."""
    complete = part.q[np.isfinite(part.q).all(axis=1)]
    return np.asarray(np.ptp(complete, axis=0)) if len(complete) else np.zeros(part.num_joints)


def unfilled(values: Array) -> str:
    """Says why numbers (N, k) of a log, NaN where one is missing, are no measurement; '' if so."""
    if not np.isfinite(values).any():
        return "hold no number, or NaN only"
    size = np.abs(values)
    least, largest = _MEASURED_SIZES
    is_unwritten = (size > largest) | ((size > 0.0) & (size < least))
    if is_unwritten.mean(axis=0).max(initial=0.0) < _UNWRITTEN_SHARE:
        return ""
    number = values[is_unwritten][0]
    return f"hold numbers such as {number:.3g}: memory that the driver never wrote"


def constant(values: Array) -> str:
    """Says that drives' numbers (N, k) of a moving arm are no measurement: they never change."""
    complete = values[np.isfinite(values).all(axis=1)]
    if len(complete) < _MIN_SAMPLES or not complete[0].any() or np.ptp(complete, axis=0).any():
        return ""
    listed = ", ".join(f"{number:.3g}" for number in complete[0])
    return f"stay the same while the joints move ({listed})"


def num_held_rows(part: Recording) -> int:
    """How many rows a logger repeats each sample for, as where it reads faster than its source.

    Returns:
        1 where rows change each by themselves, or too few do so to tell.
    """
    numbers = np.hstack([part.q, part.v, part.current])
    is_new = (numbers[1:] != numbers[:-1]).any(axis=1)
    rows = np.flatnonzero(is_new)
    if len(rows) < _MIN_SAMPLES // 2 or travel(part).max(initial=0.0) < MIN_TRAVEL:
        return 1
    counts = np.diff(rows)
    count = int(np.median(counts))
    return count if np.mean(counts == count) > _HELD_SHARE else 1


def time_unit(part: Recording, has_velocities: bool) -> str:
    """The unit in which a log counts its time, a key of TIME_UNITS; '' for s, or in doubt.

    Args:
        part: the first samples of the log, read as if in s.
        has_velocities: whether the log holds them: they must agree with the positions.
    """
    if part.num_samples < 2:
        return ""
    steps = np.diff(part.t)
    step = float(np.median(steps))
    if 0.0 < step <= _LARGEST_DAY_STEP:
        is_date = any(first <= part.t[0] <= last for first, last in _DAYS_OF_DATES)
        has_motion = has_velocities and part.num_joints > 0
        if has_motion and not _agrees(part, steps * TIME_UNITS["days"]):
            return ""
        is_day = step * TIME_UNITS["days"] >= _LEAST_STEP and (is_date or has_motion)
        return "days" if is_day else ""
    if step < _SMALLEST_COUNT:
        return ""
    units = [
        unit
        for unit, factor in TIME_UNITS.items()
        if unit != "days" and _LEAST_STEP <= step * factor <= _LARGEST_STEP
    ]
    of_date = [unit for unit, first, last in _DATES if first <= part.t[0] <= last]
    units = [unit for unit in units if unit in of_date] or [u for u in units if u != "100 ns"]
    if has_velocities and part.num_joints:
        units = [unit for unit in units if _agrees(part, steps * TIME_UNITS[unit])]
    return units[0] if len(units) == 1 else ""


def _agrees(part: Recording, steps: NDArray[Any]) -> bool:
    """Whether the velocities, over such steps, lead along the positions."""
    speed = 0.5 * np.abs(part.v[1:] + part.v[:-1])
    length = float(np.nansum(speed * steps[:, None]))
    path = float(np.nansum(np.abs(np.diff(part.q, axis=0))))
    return (
        max(path, length) < MIN_TRAVEL or path / _MAX_PATH_RATIO < length < _MAX_PATH_RATIO * path
    )
