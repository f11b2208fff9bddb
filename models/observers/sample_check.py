"""The plausibility check of samples: q, v and motor current against the limits of each joint.

An impossible sample counts as missing: its entries become NaN, which every observer and friction
law takes as a sample that never came. Checked are, joint by joint,

    position      its limits, LIMIT_MARGIN wider
    speed         SPEED_MARGIN times its limit
    current       TORQUE_MARGIN times the effort limit; a change from one sample to the next of
                  STEP_MARGIN times that limit
    acceleration  ACCELERATION_MARGIN times what the effort limit gives the rotor alone, with
                  VELOCITY_NOISE of MAX_DISAGREEMENT on top
    encoder step  r = (q - q_before) / dt - (v + v_before) / 2, the speed by which position and
                  velocity disagree: no larger than MAX_DISAGREEMENT of the speed limit, nor than
                  MAX_RISE times the largest of the last RISE_TIME, with the encoder's own step on
                  top
    drift         the sum of r dt over DRIFT_TIME, at most MAX_DRIFT times the speed limit: the
                  trace of a stuck encoder, or of another joint's velocity; once over, it is
                  forgotten within DRIFT_TIME ln DRIFT_CAP
    disorder      the sum of (|r| - |v| - SMOOTH_SHARE MAX_DISAGREEMENT) dt likewise: positions that
                  run to and fro further than their velocity goes, as of samples in a wrong order or
                  with wrong times. Of a joint that moves, |v| above SMOOTH_SHARE MAX_DISAGREEMENT:
                  at rest it is the encoder's noise
    life          a current that stays bit by bit the same for FROZEN_TIME while its joint moves was
                  not measured; one of exactly zero for ZERO_TIME, or from the sample on at which
                  it falls to zero from more than ZERO_FALL of the effort limit, at rest, too

A current of inf marks a sample that an earlier check has found impossible, before the samples were
put on a grid. The torque of a simulated arm (`Arm.current_is_measured`) acts whatever it is: there
any finite one is possible.

"before" is the last sample that was taken. After RESTART_TIME nothing is compared with it any
more, so that a position that jumped for good is then accepted.

The largest values in the logs of four real arms (three makers, 100 Hz to 1 kHz) are: 1.01 of the
speed limit. 1.14 of the effort limit, and .5 of it from one sample to the next. .09 of the rotor's
acceleration. r: .06 of the speed limit, .13 in a fast sweep after a rise. Drift: .0008 s. A current
that stays the same: .006 s. Exactly zero it is for .008 s at most, from less than .073 of the
effort limit before. Its size tells no spike: drives that start change their current by up to 1.5 of
the limit in 2 ms.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import NO_NEW_ARRAYS, kernel
from wrenchsight.models.robot.arm import Arm

Codes = NDArray[np.int64]

LIMIT_MARGIN = 0.2  # rad or m beyond a position limit: logs exceed soft limits a little
SPEED_MARGIN = 2.0
MAX_SPEED = 20.0  # rad/s or m/s, where the robot states no limit
MAX_POSITION = 1e4  # rad or m, where the robot states no limit
TORQUE_MARGIN = 2.0
STEP_MARGIN = 1.0
ACCELERATION_MARGIN = 0.5
VELOCITY_NOISE = 0.3
MAX_DISAGREEMENT, MAX_JITTER = 0.1, 3.0
MAX_RISE, RISE_TIME = 4.0, 1.0  # s
MAX_DRIFT, DRIFT_TIME = 0.01, 0.5  # s at the speed limit, s
DRIFT_CAP = 1.1  # of the bound
SMOOTH_SHARE = 0.5
FROZEN_TIME, ZERO_TIME = 0.5, 0.05  # s
ZERO_FALL = 0.1
MOVING_SHARE = 0.02  # of the speed limit, above which a joint moves
RESTART_TIME, RESTART_TICKS = 0.1, 3.5  # s, and at least as many periods
_BOUND_GROWTH = 1.25  # per refused sample, of the bound on a disagreement that lasts

# Codes of a fault, summed up: beyond a limit; drift or disorder; a current that does not change.
FAULT_BEYOND, FAULT_DISAGREES, FAULT_FROZEN = 1, 2, 4
# stands for the others beside a 1 for FAULT_BEYOND, where the samples are interpolated later
OTHER_FAULT_WEIGHT = 0.25

# Rows of SampleCheck.table, (n,) each; for a joint that slides m in the place of rad.
(
    _LOW,  # rad, least position
    _HIGH,  # rad, largest position
    _SPEED,  # rad/s, largest speed
    _CURRENT,  # A, largest current
    _CURRENT_STEP,  # A, largest change of it
    _ACCELERATION,  # rad/s^2, largest
    _SHARE,  # rad/s, largest disagreement r of a steady motion (MAX_DISAGREEMENT of the speed)
    _ENCODER,  # rad, an encoder's step
    _DRIFT,  # rad, largest drift and disorder
    _MOVING,  # rad/s, above which a joint moves
    _ZERO_FALL,  # A, from more than which a current does not fall to exactly zero
    _NUM_BOUNDS,
) = range(12)
# Rows of the state, (n,) each.
(
    _Q,  # rad, q of the last sample that was taken; NaN: none was
    _V,  # rad/s, v of it
    _I,  # A, current of the last one that was taken
    _AGE,  # s, since q and v were taken
    _I_AGE,  # s, since the current was
    _LARGEST,  # rad/s, largest |r| lately
    _SUM,  # rad, sum that tells a drift
    _DISORDER,  # rad, sum that tells disorder
    _SAME,  # s, for which the current has been the same while the joint moves
    _PREVIOUS_CODE,  # fault of the last current, which counts at the next sample
    CHECK_ROWS,
) = range(11)


class CheckedSamples(NamedTuple):
    """Signals of N samples after the check.

    Attributes:
        signals: (3, N, n) q, v and current, with NaN in place of impossible entries.
        fault: (N,) the faults of q and v of each sample and of the current of the one before: a sum
            of FAULT_BEYOND, FAULT_DISAGREES and FAULT_FROZEN, or 0.
    """

    signals: Array
    fault: Codes

    @classmethod
    def empty(cls, N: int, n: int) -> "CheckedSamples":
        """Memory for N samples of n joints."""
        return cls(np.empty((3, N, n)), np.empty(N, np.int64))


class SampleCheck:
    """The check of this module for one arm; its state is one (CHECK_ROWS, n) array.

    Args:
        robot: its limits count.
        resolution: (n,) rad or m, the encoders' step; None: not known, taken as 0.
        jitter: whether samples come at uneven times: the encoder step may then be wider off.

    Attributes:
        table: constants that the kernels read.
    """

    def __init__(
        self, robot: Arm, resolution: ArrayLike | None = None, jitter: bool = False
    ) -> None:
        self.num_joints = n = robot.num_joints
        speed = np.minimum(robot.velocity_limit, MAX_SPEED)
        current = robot.current_limit
        with np.errstate(divide="ignore"):
            acceleration = robot.effort_limit / robot.reflected_inertia
        self.table = np.zeros((_NUM_BOUNDS, n))
        for row, values in {
            _LOW: np.maximum(robot.position_lower - LIMIT_MARGIN, -MAX_POSITION),
            _HIGH: np.minimum(robot.position_upper + LIMIT_MARGIN, MAX_POSITION),
            _SPEED: SPEED_MARGIN * speed,
            _CURRENT: TORQUE_MARGIN * current,
            _CURRENT_STEP: STEP_MARGIN * current,
            _ACCELERATION: ACCELERATION_MARGIN * acceleration,
            _SHARE: (MAX_JITTER if jitter else 1.0) * MAX_DISAGREEMENT * speed,
            _ENCODER: 0.0 if resolution is None else np.asarray(resolution, float),
            _DRIFT: MAX_DRIFT * speed,
            _MOVING: MOVING_SHARE * speed,
            _ZERO_FALL: ZERO_FALL * current,
        }.items():
            self.table[row] = values
        if not robot.current_is_measured:
            largest = np.finfo(float).max
            self.table[[_CURRENT, _CURRENT_STEP, _ZERO_FALL]] = largest
            self.table[_MOVING] = np.inf  # no joint moves: no current counts as frozen

    def initial_state(self) -> Array:
        """Returns the (CHECK_ROWS, n) state before the first sample."""
        state = np.zeros((CHECK_ROWS, self.num_joints))
        state[_Q : _I + 1] = np.nan
        return state

    def run(
        self,
        state: Array,
        q: Array,
        v: Array,
        current: Array,
        period: ArrayLike,
        out: CheckedSamples | None = None,
    ) -> CheckedSamples:
        """Checks successive samples.

        Args:
            state: of `initial_state`, changed in place.
            q, v, current: (N, n), contiguous.
            period: (N,) s since the sample before; () or (1,): of all.
            out: of N samples, written and returned; None: new memory.
        """
        if out is None:
            out = CheckedSamples.empty(len(q), self.num_joints)
        periods = np.array(period, float, ndmin=1)
        check_rows(self.table, state, periods, q, v, current, out.signals, out.fault)
        return out

    def motion(self, state: Array, q: Array, v: Array, period: float, checked: Array) -> int:
        """Checks q and v of the sample that follows, as `run` would; `state` stays as it is.

        Args:
            state: of `initial_state`.
            q, v: (n,), contiguous.
            period: s since the sample before.
            checked: (2, n) written: q and v as `run` returns them.

        Returns:
            Their fault.
        """
        fault: int = _check_motion(self.table, state, period, q, v, checked)
        return fault

    def current(self, state: Array, current: Array, period: float, checked: Array) -> None:
        """Checks the current (n,) of the sample that follows, likewise, into `checked` (n,)."""
        _check_current(self.table, state, period, current, checked)

    def take(
        self,
        state: Array,
        q: Array,
        v: Array,
        current: Array,
        period: float,
        checked_motion: Array,
        checked_current: Array,
    ) -> None:
        """Takes a sample that `motion` and `current` have checked into `state`, as `run` would.

        Args:
            state: of `initial_state`, changed.
            q, v, current: (n,), contiguous.
            period: s since the sample before.
            checked_motion, checked_current: (2, n) and (n,), as those have written them.
        """
        _take_sample(self.table, state, period, q, v, current, checked_motion, checked_current)


class _Joint(NamedTuple):
    """One joint at a sample: `SampleCheck.table`, the state, the period and the joint's number."""

    table: Array
    state: Array
    period: float
    j: int


@kernel(**NO_NEW_ARRAYS)
def _check_motion(
    table: Array,
    state: Array,
    period: float,
    q: Array,
    v: Array,
    checked: Array,
) -> int:
    """Single-sample kernel: checks q and v of a sample; `state` stays as it is.

    Args:
        table, state: of SampleCheck, (rows, n).
        period: s since the sample before.
        q, v: (n,).
        checked: its first two rows are written: q and v, NaN where impossible.

    Returns:
        The faults of all joints, and of the current of the sample before: a sum of FAULT_ codes.
    """
    codes = 0
    fade_age = np.nan  # s since the last possible sample, of the joint before
    fade = np.nan  # share of a drift that is left after it
    for j in range(q.shape[0]):
        codes |= int(state[_PREVIOUS_CODE, j])
        checked[0, j], checked[1, j] = q[j], v[j]
        age = state[_AGE, j] + period
        if age != fade_age:  # most often all joints are of one age, and an exponential is dear
            fade_age, fade = age, np.exp(-age / DRIFT_TIME)
        code = _wrong_motion(_Joint(table, state, period, j), fade, q[j], v[j])
        if code != 0:
            checked[0, j], checked[1, j] = np.nan, np.nan
            codes |= code
    return codes


@kernel(**NO_NEW_ARRAYS)
def _check_current(
    table: Array,
    state: Array,
    period: float,
    current: Array,
    checked: Array,
) -> None:
    """Writes the current (n,) into `checked` (n,), as `_check_motion`.

    Its fault is reported with the next sample, as no reading of this one depends on it.
    """
    for j in range(current.shape[0]):
        code = _wrong_current(_Joint(table, state, period, j), current[j])
        checked[j] = current[j] if code == 0 else np.nan


@kernel(**NO_NEW_ARRAYS)
def _take_sample(
    table: Array,
    state: Array,
    period: float,
    q: Array,
    v: Array,
    current: Array,
    checked_motion: Array,
    checked_current: Array,
) -> None:
    """Single-sample kernel: updates `state` with a sample.

    The state of a joint holds the last sample that was possible (_Q, _V, _I) and the time since
    (_AGE of q and v, _I_AGE of the current), the largest disagreement of q and v lately (_LARGEST),
    the sums that tell a drift and disorder (_SUM, _DISORDER), how long the current has been the
    same (_SAME), and the fault of the current (_PREVIOUS_CODE), which counts at the next sample.

    Args:
        table, state: of SampleCheck, (rows, n).
        period: s since the sample before.
        q, v, current: (n,) as measured.
        checked_motion: (2, n) q and v as `_check_motion` wrote them: NaN where impossible.
        checked_current: (n,) the current as `_check_current` wrote it. Both checks come before, as
            they compare with the sample that is replaced here.
    """
    # The age of the joint before, and the shares of a rise and of a drift that are left after it.
    fade_age, rise_fade, fade = np.nan, np.nan, np.nan
    for j in range(q.shape[0]):
        joint = _Joint(table, state, period, j)
        age = state[_AGE, j] + period
        if age != fade_age:
            fade_age, rise_fade, fade = age, np.exp(-age / RISE_TIME), np.exp(-age / DRIFT_TIME)
        is_possible = np.isfinite(checked_motion[0, j]) and np.isfinite(checked_motion[1, j])
        _take_motion(joint, age, _Fades(rise_fade, fade), q[j], v[j], is_possible)
        _take_current(joint, v[j], current[j], np.isfinite(checked_current[j]))


class _Fades(NamedTuple):
    """The shares that are left, after the age of a sample, of a rise and of a drift."""

    rise: float
    drift: float


@kernel(**NO_NEW_ARRAYS)
def _take_motion(
    joint: _Joint, age: float, fades: _Fades, q: float, v: float, is_possible: bool
) -> None:
    """Updates the state of q and v of one joint: it takes the sample, or counts it as lost.

    Args:
        joint: of the state before the sample.
        age: s since the last sample that was taken.
        fades: after this age.
        q, v: as measured.
        is_possible: whether the check has left both.
    """
    table, state, period, j = joint
    # Whether it can be compared with a sample that was taken, and whether that one still counts.
    is_known = np.isfinite(state[_Q, j]) and np.isfinite(q) and np.isfinite(v)
    is_recent = is_known and age <= max(RESTART_TIME, RESTART_TICKS * period)
    # Of the samples that the check refused, those whose q and v disagree in sum (FAULT_DISAGREES)
    # are taken all the same: a drift is still summed, or it would never end.
    is_lost = not is_possible and (
        not is_known or _wrong_motion(joint, fades.drift, q, v) == FAULT_BEYOND
    )
    if is_lost:
        state[_AGE, j] = age
        r = abs(_disagreement(joint, age, q, v)) if is_recent else np.inf
        # A disagreement that lasts is not a spike: where it is no larger than a drift may be (in
        # rad), `_bound` grows by _BOUND_GROWTH a sample, until r is within it.
        if r * age <= table[_DRIFT, j] and abs(v) <= table[_SPEED, j]:
            raised = _BOUND_GROWTH * _bound(joint) / MAX_RISE
            state[_LARGEST, j] = max(state[_LARGEST, j], min(r, raised))
        return
    if is_recent:
        r = _disagreement(joint, age, q, v)
        state[_LARGEST, j] = max(abs(r), state[_LARGEST, j] * fades.rise)
        total, disorder = _drift(joint, age, fades.drift, r, v)
        # Capped, so that a drift that is over is forgotten soon.
        cap = DRIFT_CAP * table[_DRIFT, j]
        state[_SUM, j] = min(max(total, -cap), cap)
        state[_DISORDER, j] = min(disorder, cap)
    else:
        state[_SUM, j] = state[_DISORDER, j] = 0.0
    state[_Q, j], state[_V, j], state[_AGE, j] = q, v, 0.0


@kernel(**NO_NEW_ARRAYS)
def _take_current(joint: _Joint, v: float, current: float, is_possible: bool) -> None:
    """Updates the state of the current of one joint, A, at the measured velocity v."""
    table, state, period, j = joint
    state[_PREVIOUS_CODE, j] = _wrong_current(joint, current)
    if current != state[_I, j]:
        state[_SAME, j] = 0.0
    elif abs(v) > table[_MOVING, j]:
        state[_SAME, j] = min(state[_SAME, j] + period, 2.0 * FROZEN_TIME)
    state[_I_AGE, j] += period
    # One that stays the same is the last one, also where it counts as frozen.
    if is_possible or current == state[_I, j]:
        state[_I, j], state[_I_AGE, j] = current, 0.0


@kernel(**NO_NEW_ARRAYS)
def _wrong_motion(joint: _Joint, fade: float, q: float, v: float) -> int:
    """The fault code of q and v of one joint; `fade` as in `_drift`."""
    table, state, period, j = joint
    if not (np.isfinite(q) and np.isfinite(v)):
        return 0
    if not (table[_LOW, j] <= q <= table[_HIGH, j]) or abs(v) > table[_SPEED, j]:
        return FAULT_BEYOND
    age = state[_AGE, j] + period
    if not np.isfinite(state[_Q, j]) or age > max(RESTART_TIME, RESTART_TICKS * period):
        return 0
    r = _disagreement(joint, age, q, v)
    change = abs(v - state[_V, j]) - VELOCITY_NOISE * table[_SHARE, j]
    if abs(r) > _bound(joint) + table[_ENCODER, j] / age:
        return FAULT_BEYOND
    if change > table[_ACCELERATION, j] * age:
        return FAULT_BEYOND
    drift = table[_DRIFT, j] + 2.0 * table[_SHARE, j] * age
    if abs(r * age) > drift:  # in a single sample
        return FAULT_BEYOND
    total, disorder = _drift(joint, age, fade, r, v)
    return FAULT_DISAGREES if abs(total) > drift or disorder > drift else 0


@kernel(**NO_NEW_ARRAYS)
def _wrong_current(joint: _Joint, i: float) -> int:
    """The fault code of the current of one joint."""
    table, state, period, j = joint
    if np.isnan(i):
        return 0
    if abs(i) > table[_CURRENT, j]:
        return FAULT_BEYOND
    # Before the first sample it is NaN, which exceeds nothing.
    if i == 0.0 and (abs(state[_I, j]) > table[_ZERO_FALL, j] or state[_SAME, j] >= ZERO_TIME):
        return FAULT_FROZEN
    if state[_I_AGE, j] + period > max(RESTART_TIME, RESTART_TICKS * period):
        return 0
    if abs(i - state[_I, j]) > table[_CURRENT_STEP, j]:
        return FAULT_BEYOND
    return FAULT_FROZEN if i == state[_I, j] and state[_SAME, j] >= FROZEN_TIME else 0


@kernel(**NO_NEW_ARRAYS)
def _disagreement(joint: _Joint, age: float, q: float, v: float) -> float:
    """The disagreement r of one joint, rad/s (m/s)."""
    r: float = (q - joint.state[_Q, joint.j]) / age - 0.5 * (v + joint.state[_V, joint.j])
    return r


@kernel(**NO_NEW_ARRAYS)
def _drift(joint: _Joint, age: float, fade: float, r: float, v: float) -> tuple[float, float]:
    """Drift and disorder of one joint with a sample, rad (m); `fade` exp(-age / DRIFT_TIME)."""
    table, state, _, j = joint
    slow_speed = SMOOTH_SHARE * table[_SHARE, j]
    path_speed = abs(v) + slow_speed + table[_ENCODER, j] / age
    disorder = fade * state[_DISORDER, j]
    if abs(v) > slow_speed:
        disorder += (abs(r) - path_speed) * age
    return fade * state[_SUM, j] + r * age, max(disorder, 0.0)


@kernel(**NO_NEW_ARRAYS)
def _bound(joint: _Joint) -> float:
    """Largest |r| of one joint, rad/s (m/s)."""
    largest: float = max(joint.table[_SHARE, joint.j], MAX_RISE * joint.state[_LARGEST, joint.j])
    return largest


@kernel(**NO_NEW_ARRAYS)
def check_rows(
    table: Array,
    state: Array,
    periods: Array,
    q: Array,
    v: Array,
    current: Array,
    checked: Array,
    codes: Codes,
) -> None:
    """Checks N samples.

    A fault of the current counts at the sample after, since the motor torque does: what is read at
    a tick must not depend on the current of that tick.

    Args:
        table, state: of SampleCheck; the state is changed.
        periods: (N,) or (1,) s since the sample before.
        q, v, current: (N, n) rad, rad/s, A.
        checked: (3, N, n) the same, written, NaN where impossible.
        codes: (N,) written: the faults of q and v, and of the current of the sample before.
    """
    for k in range(q.shape[0]):
        motion, measured = checked[:2, k], checked[2, k]
        period = periods[min(k, len(periods) - 1)]
        # Both checks compare with the sample before, in whose place `_take_sample` puts this one.
        codes[k] = _check_motion(table, state, period, q[k], v[k], motion)
        _check_current(table, state, period, current[k], measured)
        _take_sample(table, state, period, q[k], v[k], current[k], motion, measured)
