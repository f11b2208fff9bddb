"""Whether a recording can come from the robot that it is said to come from.

A log in degrees, in milliamperes or with a turned sign is a list of good numbers: only the robot
knows better. Limits and jumps are checked at every sample. Velocity against position, and current
against gravity, are checked by sums over the log so far, so that friction, noise and
delay do not matter.
"""

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.log_words import IN_DEGREES
from wrenchsight.models.recordings.plausibility.drive_evidence import DriveEvidence, SignEvidence
from wrenchsight.models.recordings.plausibility.product_sums import (
    FACTOR,
    FOLLOWS,
    LEAST_GRAVITY,
    GravitySums,
    ProductSums,
    telling_joints,
)
from wrenchsight.models.recordings.recording import Recording, concatenated, place_of
from wrenchsight.models.recordings.recording_format import ColumnLayout
from wrenchsight.models.robot.robot import Robot

_DEGREE = np.pi / 180
_LIMIT_MARGIN = 0.2  # rad or m beyond a position limit: logs exceed soft limits a little
_CERTAINLY_DEGREES = 4 * np.pi  # rad; no joint turns twice about itself
_SPEED_MARGIN = 2.0  # times the velocity limit
_FASTEST = 20.0  # rad/s or m/s, where the robot states no limit
_JUMP_MARGIN = 0.1  # rad or m beyond what twice the velocity limit allows
_TORQUE_MARGIN = 3.0  # times the effort limit, for the median
_WINDOW_S = 0.1  # over which v is integrated and compared with the change of q
_LEAST_MOTION = 2e-3  # rad or m in a window: noise of an encoder at rest stays below
_LEAST_WINDOWS = 10
_LEAST_WINDOWS_FAR_OFF = 3  # where q or v of one joint stands still, or of all is far off
_FAR_OFF = 5.0  # times
_FEW_WINDOWS_MOTION = 1e-2  # rad or m a window, on average, from which fewer tell as well
_UNEXPLAINED = 0.2  # of the squares: a delay of 30 ms at 2.4 Hz; measured on real logs: 0.007
_WINDOWS_OF_SHORT = 5  # in a log of less than half a second, where _WINDOW_S gives fewer
_SHORTEST_WINDOW_S = 0.05
_LEAST_CORRELATION = 0.7  # measured on real logs: 0.99; a delay of 30 ms at 3 Hz gives 0.84
_VELOCITY_RATIO = (0.8, 1.25)
_GRAVITY_SHARE = 0.03  # of the effort limit: below, friction hides gravity
_ALIKE = 1.6  # times more or less than gravity: a load, a poor model
_ONE_MULTIPLE = 50.0  # of gravity torque, more or less, that no motor gives
_COMMON_MULTIPLE = 7.0  # where all loaded joints have it: none carries seven times its own arm
_LEAST_GRAVITY_SAMPLES = 50
_SCALES = (
    (1 / _DEGREE, "the positions look like degrees: set position: {unit: deg}"),
    (_DEGREE, "the velocities look like degrees per second: set velocity: {unit: deg/s}"),
    (1e3, "positions and velocities do not share a unit (mm and m?)"),
    (1e-3, "positions and velocities do not share a unit (m/s and mm/s?)"),
    (-1.0, "the velocity has the opposite sign: set gain: [-1] for one of them"),
    (2 * np.pi / 60, "the velocities look like revolutions per minute: set unit: rpm"),
)


class RecordingChecks:
    """Checks successive chunks of a recording against its robot.

    Args:
        robot: limits, drives, gravity torque.
        layout: of the log, for the names of columns in error lines; None for signals in memory.
        accept_signs: whether drives whose torque has the wrong sign are taken as they are.
    """

    def __init__(
        self, robot: Robot, layout: ColumnLayout | None = None, accept_signs: bool = False
    ) -> None:
        self._robot = robot
        self._accept_signs = accept_signs
        self._drives = DriveEvidence(robot)
        self._layout = layout
        self._last: Recording | None = None  # one sample
        self._is_first = True  # of the chunks
        self._motion = ProductSums(robot.num_joints)  # x: integral of v; y: change of q
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
        if self._has_drives():
            self._check_currents(chunk)
            if self._robot.has_inertias:
                torque = self._robot.joint_torque(chunk.current)
                self._gravity.add_slow(chunk.q, chunk.v, torque)
            self._drives.add(chunk)
            self._judge_signs(chunk)
            self._judge_gravity(chunk)

    def _has_drives(self) -> bool:
        """Whether the log says what the motors do; one of external torque does not."""
        signals = ("current", "tau_J")
        return self._layout is None or any(map(self._layout.signal, signals))

    def _check_positions(self, chunk: Recording) -> None:
        lower, upper = self._robot.position_lower, self._robot.position_upper
        excess = np.maximum(chunk.q - upper, lower - chunk.q)
        k, j = _first(excess > _LIMIT_MARGIN)
        if k < 0:
            return
        value = chunk.q[k, j]
        revolute = not self._is_prismatic(j)
        remedy = "check the column, its unit and its offset, and that the log is of this robot"
        if revolute and np.max(np.abs(chunk.q)) > _CERTAINLY_DEGREES:
            remedy = (
                f"if these are degrees, and the velocities degrees per second, add --log-format "
                f"{IN_DEGREES}; if not, set position: {{unit: deg}} in a description"
            )
        unit = "rad" if revolute else "m"
        problem = f"q is {value:.6g} {unit}, expected {lower[j]:.4g} to {upper[j]:.4g} {unit}"
        raise self._error(chunk, k, "q", j, problem, remedy)

    def _check_speeds(self, chunk: Recording) -> None:
        limit = self._robot.velocity_limit
        k, j = _first(np.abs(chunk.v) > _SPEED_MARGIN * limit)
        if k < 0:
            return
        value = chunk.v[k, j]
        unit = "m/s" if self._is_prismatic(j) else "rad/s"
        remedy = "check the column and its unit"
        if not self._is_prismatic(j):
            remedy = "if these are degrees per second, set velocity: {unit: deg/s} "
            remedy += "in a description (--log-format)"
        problem = f"v is {value:.6g} {unit}, but the joint reaches {limit[j]:.4g} {unit}"
        raise self._error(chunk, k, "v", j, problem, remedy)

    def _check_jumps(self, part: Recording) -> None:
        jump = np.diff(part.q, axis=0)
        fastest = np.minimum(self._robot.velocity_limit, _FASTEST)
        reach = _SPEED_MARGIN * fastest * np.diff(part.t)[:, None]
        k, j = _first(np.abs(jump) > reach + _JUMP_MARGIN)
        if k < 0:
            return
        remedy = "correct or remove the row"
        if abs(abs(jump[k, j]) - 2 * np.pi) < 0.5 and not self._is_prismatic(j):
            remedy = "the angle is wrapped: unwrap it before"
        elif abs(abs(jump[k, j]) - 360) < 30:
            remedy = "the angle is wrapped, in degrees: unwrap it and set unit: deg"
        problem = f"q jumps by {jump[k, j]:.4g} in {part.t[k + 1] - part.t[k]:.4g} s"
        raise self._error(part, k + 1, "q", j, problem, remedy)

    def _check_currents(self, chunk: Recording) -> None:
        if not chunk.num_samples:
            return
        torque = np.median(np.abs(chunk.current), axis=0) * self._robot.torque_per_ampere
        limit = self._robot.effort_limit
        wrong = np.flatnonzero(torque > _TORQUE_MARGIN * limit)
        if not len(wrong):
            return
        j = int(wrong[0])
        remedy = "check the column, its unit and the robot's torque_per_ampere"
        if torque[j] / 1000 < limit[j]:
            remedy = (
                "if these are milliamperes, set current: {unit: mA} in a description (--log-format)"
            )
        if self._has_torque_only(chunk):
            remedy = "check the column and its unit: motor_torque: {unit: mN m} in a description "
            remedy += "(--log-format)"
        elif (np.median(np.abs(chunk.current), axis=0) < limit).all():
            remedy += "; if torques in N m, name the columns tau1.."
        problem = (
            f"the median torque would be {torque[j]:.4g} N m, but the joint has {limit[j]:.4g} N m"
        )
        raise self._error(chunk, None, "current", j, problem, remedy)

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
        way = np.zeros_like(part.q)
        np.cumsum(0.5 * (part.v[1:] + part.v[:-1]) * steps[:, None], axis=0, out=way[1:])
        # A window that holds a gap says nothing about v.
        whole = np.diff(part.t[ends]) < 2 * window * float(np.median(steps))
        way, change = np.diff(way[ends], axis=0), np.diff(part.q[ends], axis=0)
        moving = np.maximum(np.abs(way), np.abs(change)) > _LEAST_MOTION
        self._motion.add(way, change, moving & whole[:, None])

    def _judge_motion(self, chunk: Recording) -> None:
        cosine, ratio = self._motion.cosine(), self._motion.ratio()
        low, high = _VELOCITY_RATIO
        seen = self._motion.count >= _LEAST_WINDOWS_FAR_OFF
        xx, yy = self._motion.xx, self._motion.yy
        low_high = np.minimum(xx, yy), np.maximum(xx, yy)
        stands = low_high[0] < 1e-8 * low_high[1]
        far_off = seen & (low_high[0] * _FAR_OFF**2 < low_high[1])
        if not (far_off.sum() > 1 and (far_off == seen).all()):
            far_off = seen & stands
        least = np.where(far_off, _LEAST_WINDOWS_FAR_OFF, _LEAST_WINDOWS)
        follows = (cosine >= _LEAST_CORRELATION) & (low <= ratio) & (ratio <= high)
        few = seen & (low_high[1] > self._motion.count * _FEW_WINDOWS_MOTION**2)
        unexplained = xx - 2.0 * self._motion.xy + yy > _UNEXPLAINED * low_high[1]
        enough = self._motion.count >= least
        for j in np.flatnonzero(np.where(enough, ~follows, few & unexplained)):
            if self._motion.xx[j] < 1e-8 * self._motion.yy[j]:
                problem, remedy = (
                    "v stands still while q moves",
                    "log the velocity, or give its column",
                )
            elif self._motion.yy[j] < 1e-8 * self._motion.xx[j]:
                problem, remedy = (
                    "q stands still while v moves",
                    "log the position, or give its column",
                )
            elif enough[j] and abs(cosine[j]) < _LEAST_CORRELATION:
                problem = f"v does not follow dq/dt (correlation {cosine[j]:.2f})"
                remedy = "check that q and v name the joints in one order"
            else:
                problem = f"dq/dt is {ratio[j]:.4g} times v, expected 1"
                fits = [text for scale, text in _SCALES if abs(ratio[j] / scale - 1) < 0.2]
                remedy = fits[0] if fits else "check the units of q, v and t"
                if not enough[j]:  # sums of a short time, which may look like a scale
                    problem = f"v does not follow dq/dt: {problem}"
                    remedy += ", and that q and v name the joints in one order"
            raise self._error(chunk, None, "v", int(j), problem, remedy)

    @property
    def sign_evidence(self) -> SignEvidence:
        """What the log so far says of the signs of its drives."""
        return self._drives.evidence()

    def _judge_signs(self, chunk: Recording) -> None:
        found = self.sign_evidence
        wrong = found.contradicted()
        if self._accept_signs or not len(wrong):
            return
        is_torque = self._has_torque_only(chunk)  # which current_sign does not touch
        turn = "" if is_torque else "turn current_sign in the robot's file, or "
        problem = found.sentence(self._word(chunk), self._robot.joint_names)
        remedy = (
            f"its sign is wrong: {turn}set gain: -1 in a description; or the robot is not mounted "
            "upright; or take it as it is: --accept-signs"
        )
        raise self._error(chunk, None, "current", int(wrong[0]), problem, remedy)

    def _word(self, chunk: Recording) -> str:
        return "torque" if self._has_torque_only(chunk) else "current"

    def _judge_gravity(self, chunk: Recording) -> None:
        sums = self._gravity
        if sums.count[0] < _LEAST_GRAVITY_SAMPLES:
            return
        limit = self._robot.effort_limit
        word = self._word(chunk)
        least = np.where(np.isfinite(limit), _GRAVITY_SHARE * limit, 0.0)
        loaded = sums.gravity() > np.maximum(least, LEAST_GRAVITY)
        cosine = sums.cosine()
        dead = np.flatnonzero(loaded & (sums.yy < 1e-12 * sums.xx))
        if len(dead):
            j = int(dead[0])
            gravity = sums.gravity()[j]
            problem = f"the {word} is zero, but gravity alone takes {gravity:.3g} N m"
            raise self._error(
                chunk, None, "current", j, problem, f"log the motor {word}, or give its column"
            )
        self._judge_unit(chunk, loaded & (np.abs(cosine) > FOLLOWS))
        # Whatever friction does to the shape, gravity must be held up, and with no multiple of it.
        size = np.sqrt(sums.yy / np.where(sums.xx > 0.0, sums.xx, np.inf))
        smallest, largest = 1.0 / _ONE_MULTIPLE, _ONE_MULTIPLE
        if loaded.sum() > 1 and (size[loaded] < 1.0 / _COMMON_MULTIPLE).all():
            smallest = 1.0 / _COMMON_MULTIPLE
        if loaded.sum() > 1 and (size[loaded] > _COMMON_MULTIPLE).all():
            largest = _COMMON_MULTIPLE
        odd = np.flatnonzero(loaded & ((size < smallest) | (size > largest)))
        if len(odd):
            j = int(odd[0])
            unit = "the currents are amperes, not mA" if size[j] < 1 else "they are mA"
            remedy = f"if {unit}, set current: {{unit: ...}}; else check torque_per_ampere"
            if self._has_torque_only(chunk):
                remedy = "check the column and its unit: motor_torque: {unit: ...}"
            problem = (
                f"the motor torque is {size[j]:.3g} times the gravity torque, expected about 1"
            )
            raise self._error(chunk, None, "current", j, problem, remedy)

    def _judge_unit(self, chunk: Recording, telling: NDArray[np.bool_]) -> None:
        """Refuses torque that was given as current, and current that was given as torque.

        The ratio of motor to gravity torque is about 1 in the right unit. It is the torque per
        ampere K where torque was taken for a current, and 1 / K where a current was taken for
        torque. Each telling joint must say so: one alone may carry a load, or have a poor model.
        """
        gain = self._robot.torque_per_ampere
        ratio = np.abs(self._gravity.ratio())  # whatever its sign
        telling = telling & telling_joints(self._robot) & (ratio > 0.0)
        if not telling.any():
            return
        is_torque = self._has_torque_only(chunk)
        unit_ratio = 1.0 / gain if is_torque else gain  # if the unit is the other one
        other = np.abs(np.log(ratio[telling] / unit_ratio[telling]))
        if np.max(other) > np.log(_ALIKE):
            return
        if np.min(np.abs(np.log(ratio[telling]))) < np.log(FACTOR / _ALIKE):
            return
        j = int(np.flatnonzero(telling)[0])
        names = ", ".join(self._robot.joint_names[k] for k in np.flatnonzero(telling))
        found = ", ".join(f"{value:.3g}" for value in ratio[telling])
        if is_torque:
            problem = f"the torques look like currents in A: {found} of the gravity torque"
            remedy = "describe the columns as current (--log-format)"
        else:
            problem = f"the currents look like torques in N m: {found} times the gravity torque"
            remedy = "name the columns tau1.. (motor torque), or check torque_per_ampere"
        signal = "tau_J" if is_torque else "current"
        raise self._error(chunk, None, signal, j, f"{problem} (joints {names})", remedy)

    def _has_torque_only(self, chunk: Recording) -> bool:
        """Whether the currents of a chunk were made of its torques."""
        return chunk.tau_J is not None and (
            self._layout is None or self._layout.signal("current") is None
        )

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


def _first(wrong: NDArray[np.bool_]) -> tuple[int, int]:
    """Sample and joint of the first entry that is set; (-1, -1) if none is."""
    if not wrong.any():
        return -1, -1
    k, j = np.unravel_index(int(np.argmax(wrong)), wrong.shape)
    return int(k), int(j)
