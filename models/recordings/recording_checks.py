"""Checks of a recording against the limits, velocities and gravity torques of its robot.

A log in degrees, in milliamperes or with a wrong sign holds valid numbers: only a comparison with
the robot shows the mistake. Limits and jumps are checked at every sample. Velocity is compared with
position, and current with gravity, by sums over the log so far, so that friction, noise and delay
do not matter.
"""

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.held_samples import HeldSignals
from wrenchsight.models.recordings.log_words import IN_DEGREES
from wrenchsight.models.recordings.plausibility.product_sums import (
    LEAST_GRAVITY,
    GravitySums,
    ProductSums,
)
from wrenchsight.models.recordings.recording import Recording, concatenated, place_of
from wrenchsight.models.recordings.recording_format import ColumnLayout
from wrenchsight.models.robot.robot import Robot

_RAD_PER_DEGREE = np.pi / 180
LIMIT_MARGIN = 0.2  # rad or m beyond a position limit: logs exceed soft limits a little
CERTAINLY_DEGREES = 4 * np.pi  # rad; no joint turns twice about itself
SPEED_MARGIN = 2.0  # times the velocity limit
_MAX_SPEED = 20.0  # rad/s or m/s, where the robot states no limit
_JUMP_MARGIN = 0.1  # rad or m beyond what twice the velocity limit allows
_WINDOW_S = 0.1  # over which the integral of v is compared with the change of q
_LEAST_MOTION = 2e-3  # rad or m in a window: noise of an encoder at rest stays below
_LEAST_WINDOWS = 10
_STANDING_SHARE = 1e-8  # of the other's square: position or velocity stands still
_LEAST_WINDOWS_FAR_OFF = 3  # where q or v of one joint stands still, or of all joints is far off
_FAR_OFF = 5.0  # times
_FEW_WINDOWS_MOTION = 1e-2  # rad or m a window, on average, from which fewer windows suffice
# of the squares: a delay of 30 ms at 2.4 Hz; measured on real logs: 0.007
_MAX_UNEXPLAINED_SHARE = 0.2
_WINDOWS_OF_SHORT = 5  # in a log of less than half a second, where _WINDOW_S gives fewer
_SHORTEST_WINDOW_S = 0.05
_LEAST_CORRELATION = 0.7  # measured on real logs: 0.99; a delay of 30 ms at 3 Hz gives 0.84
_ONE_SIGN_SHARE = 0.98  # of the squares of v, that have one sign; noise at rest has the other
_VELOCITY_RATIO = (0.8, 1.25)
_GRAVITY_SHARE = 0.03  # of the effort limit: below, friction hides gravity
_LEAST_GRAVITY_SAMPLES = 50
_COUNT_SPREAD = 16  # whole numbers apart, from which positions look like counts of an encoder
_SCALE_TOLERANCE = 0.2  # by which a ratio may differ from one of the scales
_SCALES = (  # of dq/dt over v, and what it comes from
    (1 / _RAD_PER_DEGREE, "the positions look like degrees: set position: {unit: deg}"),
    (_RAD_PER_DEGREE, "the velocities look like degrees per second: set velocity: {unit: deg/s}"),
    (1e3, "positions and velocities do not share a unit (mm and m?)"),
    (1e-3, "positions and velocities do not share a unit (m/s and mm/s?)"),
    (-1.0, "the velocity has the opposite sign: set gain: [-1] for one of them"),
    (2 * np.pi / 60, "the velocities look like revolutions per minute: set unit: rpm"),
)


class RecordingChecks:
    """Checks successive chunks of a recording against its robot.

    Args:
        robot: limits, drives, gravity torque.
        layout: layout of the log, for the names of columns in error lines; None for signals in
            memory.
        held: signals that hold each value for some rows, and are read so; None: none are.
    """

    def __init__(
        self, robot: Robot, layout: ColumnLayout | None = None, held: HeldSignals | None = None
    ) -> None:
        self._robot = robot
        self._layout = layout
        self._held = held
        self._last: Recording | None = None  # one sample
        self._is_first = True  # of the chunks
        self._motion = ProductSums(robot.num_joints)  # x: integral of v; y: change of q
        self._motion_sizes = ProductSums(robot.num_joints)  # of |x| and |y|
        self._signed_squares = np.zeros(robot.num_joints)  # sum of x |x|
        self._gravity = GravitySums(robot)  # x: gravity torque; y: motor torque

    def feed(self, chunk: Recording) -> None:
        """Checks the next chunk.

        Raises:
            InputError: a sample, or the log so far, is implausible.
        """
        self._is_first = self._last is None
        part = chunk
        if self._last is not None:
            part = concatenated([self._last, chunk])
        self._last = part[-1:]
        self._check_positions(chunk)
        self._check_speeds(chunk)
        self._check_jumps(part)
        self._add_motion(part)
        self._judge_motion(chunk)
        if self._has_drives() and self._robot.has_inertias:
            with np.errstate(over="ignore"):  # infinite torques are left out
                torque = self._robot.joint_torque(chunk.current)
            self._gravity.add_slow(chunk.q, chunk.v, torque)
            self._judge_gravity(chunk)

    def _has_drives(self) -> bool:
        """Whether the log holds motor currents or torques; one of external torque does not."""
        if self._layout is None:
            return True
        return any(self._layout.signal(name) is not None for name in ("current", "tau_J"))

    def _check_positions(self, chunk: Recording) -> None:
        """Refuses the first position beyond a joint's limits, with the unit that it may be in.

        Raises:
            InputError: there is one.
        """
        lower, upper = self._robot.position_lower, self._robot.position_upper
        excess = np.maximum(chunk.q - upper, lower - chunk.q)
        k, j = _first_place(excess > LIMIT_MARGIN)
        if k < 0:
            return
        value = chunk.q[k, j]
        revolute = not self._is_prismatic(j)
        remedy = "check the column, its unit and its offset, and that the log is of this robot"
        # One joint shows it: those whose rows are apart from its are interpolated.
        is_whole = (chunk.q == np.rint(chunk.q)).all(axis=0)
        is_counted = bool((is_whole & (np.ptp(chunk.q, axis=0) > _COUNT_SPREAD)).any())
        if revolute and is_counted:
            remedy = (
                "the positions are whole numbers, such as counts of an encoder or thousandths of a "
                "degree: set position: {gain: [6.28318 / counts per turn], offset: [...]}, or "
                "{unit: deg, gain: [0.001]}, in a description (--log-format), and the gains of "
                "velocities and currents alike"
            )
        elif revolute and self._is_scaled("q"):
            turns = np.max(np.abs(chunk.q)) / (2 * np.pi)
            remedy = (
                f"the log states the unit, in which the joints turn {turns:.3g} times: if these "
                "are positions of the motors, set position: {gain: [1 / gear ratio, ...]} and "
                "velocity: {gain: [...]} beside the unit in a description (--log-format)"
            )
        elif revolute and np.max(np.abs(chunk.q)) > CERTAINLY_DEGREES:
            remedy = (
                f"if positions and velocities are in degrees, add --log-format {IN_DEGREES}; if "
                "only positions are, set position: {unit: deg} in a description"
            )
        unit = "rad" if revolute else "m"
        problem = f"q is {value:.6g} {unit}, expected {lower[j]:.4g} to {upper[j]:.4g} {unit}"
        raise self._error(chunk, k, "q", j, problem, remedy)

    def _check_speeds(self, chunk: Recording) -> None:
        limit = self._robot.velocity_limit
        k, j = _first_place(np.abs(chunk.v) > SPEED_MARGIN * limit)
        if k < 0:
            return
        value = chunk.v[k, j]
        unit = "m/s" if self._is_prismatic(j) else "rad/s"
        remedy = "check the column and its unit"
        if not self._is_prismatic(j):
            remedy = (
                "if these are degrees per second, set velocity: {unit: deg/s} in a description "
                "(--log-format)"
            )
        problem = f"v is {value:.6g} {unit}, but the joint reaches {limit[j]:.4g} {unit}"
        raise self._error(chunk, k, "v", j, problem, remedy)

    def _check_jumps(self, part: Recording) -> None:
        jump = np.diff(part.q, axis=0)
        fastest = np.minimum(self._robot.velocity_limit, _MAX_SPEED)
        reach = SPEED_MARGIN * fastest * np.diff(part.t)[:, None]
        k, j = _first_place(np.abs(jump) > reach + _JUMP_MARGIN)
        if k < 0:
            return
        remedy = "correct or remove the row"
        if self._held is not None and "q" in self._held.names:
            remedy = (
                f"each value is repeated for {self._held.num_rows} rows: {self._held.remedy()} (in "
                f"a description keep_every: {self._held.num_rows})"
            )
        elif not part.q[k].any():
            remedy = (
                f"all positions are zero up to {place_of(part, k)}, as before the first packet of "
                "a driver: remove these rows"
            )
        elif abs(abs(jump[k, j]) - 2 * np.pi) < 0.5 and not self._is_prismatic(j):
            remedy = "the angle is wrapped: unwrap it in the log"
        elif abs(abs(jump[k, j]) - 360) < 30:
            remedy = "the angle is wrapped, in degrees: unwrap it in the log and set unit: deg"
        problem = f"q jumps by {jump[k, j]:.4g} in {part.t[k + 1] - part.t[k]:.4g} s"
        raise self._error(part, k + 1, "q", j, problem, remedy)

    def _add_motion(self, part: Recording) -> None:
        steps = np.diff(part.t)
        if len(steps) < 2:
            return
        step = max(float(np.median(steps)), 1e-9)
        window = max(1, round(_WINDOW_S / step))
        if self._is_first:
            shortest = max(1, round(_SHORTEST_WINDOW_S / step))
            window = min(window, max(shortest, len(steps) // _WINDOWS_OF_SHORT))
        ends = np.arange(0, part.num_samples, window)
        integral = np.zeros_like(part.q)
        np.cumsum(0.5 * (part.v[1:] + part.v[:-1]) * steps[:, None], axis=0, out=integral[1:])
        # In a window with a gap the integral of v is unknown.
        is_gapless = np.diff(part.t[ends]) < 2 * window * float(np.median(steps))
        v_change, q_change = np.diff(integral[ends], axis=0), np.diff(part.q[ends], axis=0)
        is_moving = np.maximum(np.abs(v_change), np.abs(q_change)) > _LEAST_MOTION
        is_used = is_moving & is_gapless[:, None]
        self._motion.add(v_change, q_change, is_used)
        self._motion_sizes.add(np.abs(v_change), np.abs(q_change), is_used)
        self._signed_squares += np.sum(np.where(is_used, v_change * np.abs(v_change), 0.0), axis=0)

    def _judge_motion(self, chunk: Recording) -> None:
        """Refuses velocities that are not the derivative of the positions, once enough is read.

        A joint of enough windows is judged by correlation and ratio of dq/dt and v. Before, only a
        long motion that v does not explain at all is wrong.

        Of each joint `_motion` sums x = integral of v and y = change of q over the windows in which
        it moves: xx, yy, xy and their count; its ratio is that of y to x.

        Raises:
            InputError: names the first such joint, and how v and dq/dt differ.
        """
        cosine, ratio = self._motion.cosine(), self._motion.ratio()
        low, high = _VELOCITY_RATIO
        follows = (cosine >= _LEAST_CORRELATION) & (low <= ratio) & (ratio <= high)
        is_enough = self._has_enough_windows()
        wrong = np.flatnonzero(np.where(is_enough, ~follows, self._is_unexplained()))
        if len(wrong):
            j = int(wrong[0])
            problem, remedy = self._motion_fault(j, bool(is_enough[j]))
            raise self._error(chunk, None, "v", j, problem, remedy)

    def _has_enough_windows(self) -> NDArray[np.bool_]:
        """(n,) whether correlation and ratio of dq/dt and v say something of a joint by now.

        _LEAST_WINDOWS do. Fewer do where both are far from each other: on all joints, as with a
        wrong unit, or where one of them stands still.
        """
        xx, yy, count = self._motion.xx, self._motion.yy, self._motion.count
        smaller, larger = np.minimum(xx, yy), np.maximum(xx, yy)
        has_few = count >= _LEAST_WINDOWS_FAR_OFF
        is_far_off = has_few & (smaller * _FAR_OFF**2 < larger)
        is_wrong_unit = bool(is_far_off.sum() > 1 and (is_far_off == has_few).all())
        stands_still = has_few & (smaller < _STANDING_SHARE * larger)
        return (count >= _LEAST_WINDOWS) | (is_far_off if is_wrong_unit else stands_still)

    def _is_unexplained(self) -> NDArray[np.bool_]:
        """(n,) whether a joint went far in few windows, and v does not explain it at all."""
        xx, yy, count = self._motion.xx, self._motion.yy, self._motion.count
        larger = np.maximum(xx, yy)
        moves_far = (count >= _LEAST_WINDOWS_FAR_OFF) & (larger > count * _FEW_WINDOWS_MOTION**2)
        left_over = xx - 2.0 * self._motion.xy + yy  # sum of (y - x)^2
        return np.asarray(moves_far & (left_over > _MAX_UNEXPLAINED_SHARE * larger))

    def _motion_fault(self, j: int, is_enough: bool) -> tuple[str, str]:
        """How v and dq/dt of joint j differ, and what to do; `is_enough` as above."""
        xx, yy = self._motion.xx[j], self._motion.yy[j]
        cosine, ratio = self._motion.cosine()[j], self._motion.ratio()[j]
        if xx < _STANDING_SHARE * yy:
            return "v stands still while q moves", "log the velocity, or give its column"
        if yy < _STANDING_SHARE * xx:
            return "q stands still while v moves", "log the position, or give its column"
        size_agrees = self._motion_sizes.cosine()[j] >= _LEAST_CORRELATION
        has_one_sign = abs(self._signed_squares[j]) > _ONE_SIGN_SHARE * xx
        if is_enough and abs(cosine) < _LEAST_CORRELATION and size_agrees and has_one_sign:
            problem = "v has the size of dq/dt, but its sign never changes while q goes both ways: "
            problem += "it is a speed"
            remedy = "leave it out, q is then differentiated: remove the line velocity from the "
            remedy += "description that `wrenchsight log` drafts, and add --log-format with it"
            return problem, remedy
        if is_enough and abs(cosine) < _LEAST_CORRELATION:
            problem = f"v does not follow dq/dt (correlation {cosine:.2f})"
            return problem, "check that q and v name the joints in one order"
        problem = f"dq/dt is {ratio:.4g} times v, expected 1"
        remedies = [text for scale, text in _SCALES if abs(ratio / scale - 1) < _SCALE_TOLERANCE]
        remedy = remedies[0] if remedies else "check the units of q, v and t"
        if not is_enough:  # sums over a short time may be in proportion by chance
            problem = f"v does not follow dq/dt: {problem}"
            remedy += ", and that q and v name the joints in one order"
        return problem, remedy

    def _judge_gravity(self, chunk: Recording) -> None:
        """Refuses motor torques that are zero where gravity loads the joint."""
        sums = self._gravity
        if sums.count[0] < _LEAST_GRAVITY_SAMPLES:
            return
        limit = self._robot.effort_limit
        least = np.where(np.isfinite(limit), _GRAVITY_SHARE * limit, 0.0)
        loaded = sums.gravity() > np.maximum(least, LEAST_GRAVITY)
        zero = np.flatnonzero(loaded & (sums.yy < 1e-12 * sums.xx))
        if len(zero):
            j = int(zero[0])
            quantity = "torque" if self._has_torque_only(chunk) else "current"
            gravity = sums.gravity()[j]
            problem = f"the {quantity} is zero, but the gravity torque is {gravity:.3g} N m"
            remedy = f"log the motor {quantity}, or give its column"
            raise self._error(chunk, None, "current", j, problem, remedy)

    def _has_torque_only(self, chunk: Recording) -> bool:
        """Whether the currents of a chunk were made of its torques."""
        return chunk.tau_J is not None and (
            self._layout is None or self._layout.signal("current") is None
        )

    def _is_scaled(self, signal: str) -> bool:
        """Whether the log or its description states another unit of a signal than SI."""
        found = None if self._layout is None else self._layout.signal(signal)
        return found is not None and bool(np.any(found.scale != 1.0))

    def _is_prismatic(self, joint: int) -> bool:
        return bool(self._robot.chain.prismatic[joint])

    def _error(
        self,
        recording: Recording,
        sample: int | None,
        signal: str,
        joint: int,
        problem: str,
        remedy: str,
    ) -> InputError:
        """The error of a joint's signal at a sample, or (None) over the samples so far."""
        if signal == "current" and self._has_torque_only(recording):
            signal = "tau_J"
        place = f"joint {joint + 1} ({self._robot.joint_names[joint]})"
        if self._layout is not None and self._layout.signal(signal):
            place = f"{self._layout.column_of(signal, joint)}, {place}"
        if sample is not None:
            place = f"{place_of(recording, sample)}, {place}"
        elif recording.row is not None and len(recording.row):
            place = f"up to {recording.row_word} {recording.row[-1]}, {place}"
        return InputError(recording.source, place, problem, remedy)


def _first_place(is_wrong: NDArray[np.bool_]) -> tuple[int, int]:
    """Sample and joint of the first flag that is set; (-1, -1) if none is."""
    if not is_wrong.any():
        return -1, -1
    k, j = np.unravel_index(int(np.argmax(is_wrong)), is_wrong.shape)
    return int(k), int(j)
