"""Torque error model: sd of the external torque that an observer reads, joint by joint.

The reading without contact is neither white nor constant. The error of a sliding joint is small.
The error of a reversing joint lasts until its slip has reversed. A joint at rest carries any torque
within its stiction band, whatever the environment does. Per joint

    sd^2 = constant^2 + (speed v)^2 + (load L)^2 + (acceleration a)^2    fitted to held-out motion
         + unknown^2 + min(reversal turning, 2 largest level)^2          stiction
         + (drift tau_v)^2 + (beyond_speed e_v)^2 + (beyond_load e_L)^2  stated assumptions
         + s(q)^2 beyond the largest fitted      gravity (`models.identification.gravity_spread`)

    level   = C + S exp(-(v / v_s)^2) + l |L|       of the friction law: half the stiction band,
                                                    with S >= -C / 2, as logs hardly show a crawl
    unknown = LP(level sqrt(max(w, r) / 3 + m r (1 - r)))    uniform over the band, for a share w
    turning = LP(level (1 - z^2) (1 - max(w, r)))   between two directions

A law with the wrong direction errs by 2 level, and its low-pass by no more: a motion that hardly
reverses fits a `reversal` of 10 and beyond, which a slow reversal would turn into a band that no
friction fills. L is the torque that the gear transmitted at the tick before, and a = K_0 (v - LP
v). tau_v is the law's viscous torque. e_v and e_L are speed and load beyond the fitted range. LP is
the observer's low-pass K_0 / (s + K_0): a short error fades from the reading as slowly as a force
does. The state of the slip follows displacement, not speed:

    p_a <- clip(p_a, p - play, p + play)            moves by dp_a
    w   <- (1 - (1 - w) (1 - g + g exp(-2 dt / rest_time))) exp(-|dp_a| / reach)
    still = exp(-(dp_a / (CREEP_SPEED dt))^2)
    r   <- r' + still (1 - exp(-dt / forgetting)) (1 - r'),    r' = r exp(-|dp_a| / reach)
    z   <- clip(z + dp / reach, -1, 1)

so that w grows to 1 at rest and falls to 0 where the joint slides. With g = 1 a joint that creeps
keeps a share of about 2 reach / (rest_time |v|). With `resting_only` w grows only at rest, g =
exp(-(v rest_time / reach)^2), for joints that slide slowly all the time, as in machining. dp is the
displacement within the encoder's rounding (`models.friction.presliding_friction`). An encoder step
at rest therefore moves nothing, and everything is continuous in q and v.

**At rest** friction is any torque within +-level, whatever the law says for a velocity of zero: a
law without memory takes its sign from the noise of the velocity there. So the estimator subtracts

    tau_f = (1 - r) tau_law + r (offset + viscous v)

(`models.friction.slip_elements`), r being the share by which the joint is known to rest. Its error
has the mean square level^2 (r / 3 + r (1 - r)), for a joint whose friction has changed since it
moved with the probability r. A law with memory knows for about a second what the joint held when it
stopped: there m = 0 and `forgetting` is RELAXATION_TIME, elsewhere m = 1 and it is
RECOGNITION_TIME. (With RECOGNITION_TIME for both the reading of the UR10e's ptp_10_points errs by
3.7 N for 2.3 N after a stop.) The position p_a follows p with the play of a bearing, so that an
encoder that flickers and a noisy velocity move nothing. What friction can hide altogether is

    hidden = held level(0) LP(max((2 - r) max(still, r), w))

from the first sample without motion on: any torque of the band, less the law's that is still
subtracted. A joint that creeps to its stop hides the share w of its band: MuJoCo's solver, for one,
lets a joint creep under a part of its friction. `held` allows for what stiction has above the
sliding level, and for the level's drift: it is the largest share that a rest in the logs showed,
and MIN_HELD_RATIO at least. A contact counts beyond it (`models.detection.contact_statistic`). What
a joint holds that never rested in the logs is not known: once it is known to rest (r >
UNSEEN_REST), `hidden` is infinite, and a torque beyond MIN_HELD_RATIO times the level makes the
reading not valid (`torque_at_unseen_rest`). Before, as at a reversal, `held` is UNSEEN_HELD.

rest_time and reach are constants: the most likely ones of a grid (.1 to 2 s, .1 to .8 mrad) over
the UR10e's three runs. Each run was read causally by a model of the others. `unknown` has no fitted
factor: such a factor would be between .8 and 1.25 on all six joints. Those runs contain reversals
only, but the model also holds for longer rests. An encoder whose noise at rest exceeds the play,
MIN_PLAY or its resolution, would hide that the joint rests: its resolution must cover that noise.
The errors of two joints correlate by less than .1, except for joints 2 and 3 (.18).

The sds belong to one K_0. The smooth part of the error has the correlation time T, and passes a
low-pass with the share K_0 T / (1 + K_0 T) of its variance. This converts the sds to another K_0.

**Assumed, not measured,** and so stated in the model's file: `drift`, because viscous friction
differs by about 5 % between days of the same month (and by 35 % over a season: refresh the model).
Where the log that is read shows more drift of a joint, that is `drift_shown`;
`beyond_speed` and `beyond_load`, because no log covers them; `scale`, an error in proportion to
the reading (torque per ampere, load-dependent friction); `read_load`, the same joint by joint,
where the logs hold no change of load at all (`wrenchsight.models.machining.air_pass`).
"""

from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.friction.friction_law import FrictionLaw
from wrenchsight.models.friction.presliding_friction import RELAXATION_TIME
from wrenchsight.models.friction.sliding_friction import SlidingLaw
from wrenchsight.models.friction.slip_elements import (
    SLIDING_COLUMNS,
    bounded_cubic,
    held_stribeck,
    within_rounding,
)
from wrenchsight.models.identification.gravity_spread import (
    NUM_PARAMETERS,
    spread_beyond,
    spread_table,
)
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.numerics.kernel import NO_NEW_ARRAYS, kernel
from wrenchsight.models.rigid_body.serial_chain import SerialChain

VISCOUS_DRIFT = 0.05  # of the viscous torque
BEYOND_SPEED = 0.3  # of the viscous coefficient
BEYOND_LOAD = 0.05  # N m per N m
SCALE_ERROR = 0.05  # of what is read
REST_TIME = 0.5  # s
PRESLIDING_REACH = 3e-4  # rad (m)
MIN_PLAY = 1e-4  # rad (m), least play of the position that decides whether a joint rests
MIN_HELD_RATIO = 1.1  # level at rest over that of sliding, at least, where logs show rests
UNSEEN_HELD = 2.0  # the same where they show none, until the joint is known to rest
UNSEEN_REST = 0.5  # r, from which on it is
CREEP_SPEED = 1e-4  # rad/s (m/s), of a motion that a rest cannot be told from
RECOGNITION_TIME = 0.1  # s without motion, in which a joint is known to rest

# Columns of the table, a row a joint; symbols as above, s and rad (m for a joint that slides).
# First those of the sliding law, in the order of SlidingLaw's first fields.
(
    _C,  # C, N m
    _S,  # S, N m, as the level holds it (`held_stribeck`)
    _INVERSE_SPEED,  # 1 / v_s
    _LOAD,  # l
    _CUBIC,  # N m s^3/rad^3, of the law
    _SPEED_LIMIT,  # rad/s, up to which the cubic part is the law's
    _BEYOND,  # N m s/rad, its slope beyond
) = range(SLIDING_COLUMNS)
(
    VISCOUS,  # N m s/rad, of the law
    _HALF_STEP,  # rad, half an encoder's step
    _PERIOD,  # s, dt
    _POLE,  # exp(-K_0 dt), of LP
    _GAIN,  # 1/s, K_0
    _DECAY,  # exp(-2 dt / rest_time), what a period at rest leaves of 1 - w
    _INVERSE_REACH,  # 1 / reach
    _CONSTANT2,  # the terms' squares, for this K_0: constant^2
    _SPEED2,  # speed^2
    _LOAD2,  # load^2
    _ACCELERATION2,  # acceleration^2
    _REVERSAL2,  # reversal^2
    _DRIFT2,  # drift^2
    _BEYOND_SPEED2,  # (beyond_speed times the viscous coefficient)^2
    _FITTED_SPEED,  # rad/s, beyond which that counts; inf: nowhere
    _BEYOND_LOAD2,  # beyond_load^2
    _FITTED_LOAD,  # N m, beyond which that counts; inf: nowhere
    _INVERSE_REST_SPEED,  # rest_time / reach with `resting_only`, as of g; else 0
    OFFSET,  # N m, of the law
    _PLAY,  # rad, play
    _RECOGNISED,  # 1 - exp(-dt / forgetting); 0: no joint is known to rest
    _SUDDEN,  # m
    _INVERSE_CREEP,  # 1 / (CREEP_SPEED dt)
    _HELD,  # held
    _UNSEEN,  # 1 where the joint rested in no log, else 0
    _COLUMNS,
) = range(SLIDING_COLUMNS, SLIDING_COLUMNS + 26)

# Rows of the state.
(
    _POSITION,  # p, rad
    _UNKNOWN_SHARE,  # w
    _TURN,  # z
    _UNKNOWN,  # unknown, N m
    _TURNING,  # turning, N m
    _SLOW_SPEED,  # LP v, rad/s
    _TRANSMITTED,  # L of the sample before, N m
    _TAU_J,  # motor torque of the sample before, N m
    _PLAY_POSITION,  # p_a, rad
    REST_ROW,  # r
    HIDDEN_ROW,  # hidden over held level(0)
    _STILL,  # still
    _TAKEN,  # whether the last sample was taken, and whether it was the first
    TORQUE_ERROR_ROWS,
) = range(14)
_MOTION_ROWS = (_POSITION, _PLAY_POSITION, _UNKNOWN_SHARE, _TURN, REST_ROW, _STILL, _TAKEN)
_LOAD_ROWS = (_UNKNOWN, _TURNING, _SLOW_SPEED, _TRANSMITTED, _TAU_J, HIDDEN_ROW)
_LOST_STATUS, _FIRST_STATUS, _LATER_STATUS = 0.0, 1.0, 2.0  # of _TAKEN
UNKNOWN_SHARE_ROW, TRANSMITTED_ROW, TAU_J_ROW = _UNKNOWN_SHARE, _TRANSMITTED, _TAU_J
# w, and L and tau_J of the last sample
# Parts of the variance before their coefficients, the last of which has none: `variance_parts`.
(
    CONSTANT_PART,  # 1
    SPEED_PART,  # v^2
    LOAD_PART,  # L^2
    ACCELERATION_PART,  # (K_0 (v - LP v))^2
    REVERSAL_PART,  # turning^2
    STICTION_PART,  # unknown^2
    NUM_FEATURES,
) = range(7)


class Rest(NamedTuple):
    """Three constants of a TorqueErrorModel: `rest_time` s, `reach` rad and `resting_only`."""

    time: float = REST_TIME
    reach: float = PRESLIDING_REACH
    only: float = 0.0


@dataclass(frozen=True, eq=False)
class TorqueErrorModel:
    """The constants of this module for one model of one arm with n joints.

    `constant` tells n. A number in the place of another (n,) stands for all joints; the attribute
    is (n,).

    Attributes:
        constant: (n,) N m.
        speed: (n,) N m s/rad.
        load: (n,) N m per N m.
        acceleration: (n,) N m s^2/rad.
        reversal: (n,) share of the level.
        correlation: (n, n) between the joints' errors, constant.
        correlation_time: (n,) s, of the error's smooth part.
        lasting: (n,) share of its variance that no average over a log removes.
        fitted_speed: (n,) rad/s, largest magnitudes of the logs; zeros where nothing is known.
        fitted_load: (n,) N m, of L.
        K_0: (n,) 1/s, of the observer whose readings these are.
        resolution: (n,) rad, the step of the encoders; 0: none that counts.
        rest_time: s.
        reach: rad.
        drift: share of the viscous torque.
        beyond_speed: share of the viscous coefficient.
        beyond_load: N m per N m.
        scale: share of the wrench that is read; see `models.observers.lag`.
        read_load: N m per N m that is read, joint by joint; 0 where `load` covers what is carried.
        resting_only: 1 where w grows at rest alone, 0 where it does at any speed.
        drift_shown: (n,) share of the viscous torque, as `drift`, measured on a log for each joint.
        spread: (K, n, 5) directions in which gravity and offsets may be off; None: K = 0.
        fitted_spread: (n,) N m, the largest s(q) of the fitted logs.
        rests: (n,) how often each joint rested in the logs (`models.identification.rests`).
        held: (n,) level at rest over that of sliding, beyond which a torque is no friction.

    Raises:
        ValueError: shapes that disagree, a number that is negative or not finite, a correlation
            that is not positive definite with a diagonal of ones.
    """

    constant: Array
    speed: Array
    load: Array
    acceleration: Array
    reversal: Array
    correlation: Array
    correlation_time: Array
    lasting: Array
    fitted_speed: Array
    fitted_load: Array
    K_0: Array
    resolution: Array
    rest_time: float = field(default=REST_TIME)
    reach: float = field(default=PRESLIDING_REACH)
    drift: float = field(default=VISCOUS_DRIFT)
    beyond_speed: float = field(default=BEYOND_SPEED)
    beyond_load: float = field(default=BEYOND_LOAD)
    scale: float = field(default=SCALE_ERROR)
    read_load: float = field(default=0.0)
    resting_only: float = field(default=0.0)
    drift_shown: Array | float = field(default=0.0)
    spread: Array | None = field(default=None)
    fitted_spread: Array | float = field(default=0.0)
    rests: Array | float = field(default=0.0)
    held: Array | float = field(default=UNSEEN_HELD)

    law_holds_at_rest: ClassVar[bool] = False  # whether friction at rest is the law's, too

    def __post_init__(self) -> None:
        """Brings the parameters into their shapes; raises ValueError where one is out of range.

        Each becomes an array of its own, or a float where it is one number of the whole arm; only
        a correlation and a spread may be negative.
        """
        n = np.size(self.constant)
        if self.spread is None or np.size(self.spread) == 0:
            object.__setattr__(self, "spread", np.zeros((0, n, NUM_PARAMETERS)))
        num_directions = len(np.asarray(self.spread))  # K
        shapes = {"correlation": (n, n), "spread": (num_directions, n, NUM_PARAMETERS)}
        for attribute in fields(self):
            value = np.array(getattr(self, attribute.name), float)
            # A new attribute that is one number of the whole arm also goes into _NUMBERS.
            shape = () if attribute.name in _NUMBERS else shapes.get(attribute.name, (n,))
            if value.shape == () and shape == (n,):
                value = np.full(n, float(value))
            if value.shape != shape:
                raise ValueError(f"{attribute.name}: expected shape {shape}, found {value.shape}")
            if not np.isfinite(value).all():
                raise ValueError(f"{attribute.name}: expected finite numbers")
            if attribute.name not in shapes and (value < 0.0).any():
                raise ValueError(f"{attribute.name}: expected zero or more")
            object.__setattr__(self, attribute.name, float(value) if not shape else value)
        for key in ("rest_time", "reach"):
            if getattr(self, key) == 0.0:
                raise ValueError(f"{key}: expected a number above zero")
        for key in ("constant", "correlation_time", "K_0"):
            if not (getattr(self, key) > 0.0).all():
                raise ValueError(f"{key}: expected numbers above zero")
        R = self.correlation
        if not np.allclose(np.diag(R), 1.0) or not np.allclose(R, R.T):
            raise ValueError("correlation: expected a symmetric matrix with ones on its diagonal")
        if np.linalg.eigvalsh(R)[0] <= 0.0:
            raise ValueError("correlation: expected a positive definite matrix")

    @property
    def num_joints(self) -> int:
        """How many joints, n."""
        return int(self.constant.shape[0])

    @property
    def _directions(self) -> Array:
        return np.asarray(self.spread, float)

    def spread_table(self, chain: SerialChain) -> Array:
        """(n, 20 + 5 K), or (n, 0), columns that `table` has for a robot with this chain."""
        return spread_table(chain, self._directions, self.fitted_spread)

    def with_rests(self, count: Array, held: Array) -> Self:
        """Returns the model with what logs show of rests, (n,) each (`identification.rests`)."""
        level = np.where(count > 0.0, np.maximum(held, MIN_HELD_RATIO), UNSEEN_HELD)
        return replace(self, rests=count, held=level)

    def with_drift(self, drift: float) -> Self:
        """Returns the model with another `drift`, such as that of friction fitted today."""
        return replace(self, drift=drift, drift_shown=0.0)

    @property
    def drifts(self) -> Array:
        """(n,) share of the viscous torque by which friction may have drifted."""
        return np.asarray(np.maximum(self.drift, self.drift_shown))

    def table(
        self,
        friction: FrictionLaw | SlidingLaw,
        time_step: float,
        K_0: ArrayLike,
        resolution: ArrayLike | None = None,
        chain: SerialChain | None = None,
    ) -> Array:
        """(n, _COLUMNS + k) contiguous: a row a joint, the constants of this module's kernels.

        Columns: SLIDING_COLUMNS of the friction law, then VISCOUS to _UNSEEN; behind them the k of
        `spread_table`.

        Args:
            friction: the model's, or its numbers; its level is the stiction band.
            time_step: s.
            K_0: (n,) or () 1/s, of the observer, to whose readings the variances are converted.
            resolution: (n,) or () rad, of the encoders; None: that of the logs.
            chain: of the robot; None: gravity is taken as known in all postures (k = 0).
        """
        n = self.num_joints
        gain = np.broadcast_to(np.asarray(K_0, float), (n,))
        step = self.resolution if resolution is None else np.asarray(resolution, float)
        sliding = friction if isinstance(friction, SlidingLaw) else SlidingLaw.of(friction)
        table = np.zeros((n, _COLUMNS))
        table[:, _C] = sliding.coulomb
        table[:, _S] = held_stribeck(table[:, _C], np.asarray(sliding.stribeck))
        table[:, _INVERSE_SPEED] = sliding.inverse_speed
        table[:, _LOAD] = sliding.load
        table[:, _CUBIC] = sliding.cubic
        table[:, _SPEED_LIMIT] = sliding.speed_limit
        table[:, _BEYOND] = sliding.slope_beyond
        table[:, VISCOUS] = sliding.viscous
        table[:, OFFSET] = sliding.offset
        # Sampling and observer.
        table[:, _HALF_STEP] = 0.5 * np.broadcast_to(step, (n,))
        table[:, _PERIOD] = time_step
        table[:, _POLE] = np.exp(-gain * time_step)
        table[:, _GAIN] = gain
        self._write_variances(table, gain)
        self._write_rests(table, time_step, is_elastic=sliding.remembers > 0.0)
        return table if chain is None else np.hstack([table, self.spread_table(chain)])

    def _write_variances(self, table: Array, gain: Array) -> None:
        """Writes the columns of a variance's terms, _CONSTANT2 to _FITTED_LOAD.

        Args:
            table: (n, _COLUMNS), its column VISCOUS written.
            gain: (n,) 1/s, K_0 of the observer.
        """
        # The error's smooth part passes this K_0 and that of the fit with different shares.
        passed = gain / (1.0 + gain * self.correlation_time)
        passed_in_fit = self.K_0 / (1.0 + self.K_0 * self.correlation_time)
        by_K_0 = passed / passed_in_fit
        table[:, _CONSTANT2] = by_K_0 * self.constant**2
        table[:, _SPEED2] = by_K_0 * self.speed**2
        table[:, _LOAD2] = by_K_0 * self.load**2
        table[:, _ACCELERATION2] = by_K_0 * self.acceleration**2
        # Reversals, a drift, and what lies beyond the fitted range; without one there is no beyond.
        table[:, _REVERSAL2] = self.reversal**2
        table[:, _DRIFT2] = self.drifts**2
        has_speed, has_load = self.fitted_speed > 0.0, self.fitted_load > 0.0
        table[:, _FITTED_SPEED] = np.where(has_speed, self.fitted_speed, np.inf)
        table[:, _BEYOND_SPEED2] = (self.beyond_speed * np.abs(table[:, VISCOUS])) ** 2
        table[:, _FITTED_LOAD] = np.where(has_load, self.fitted_load, np.inf)
        table[:, _BEYOND_LOAD2] = self.beyond_load**2

    def _write_rests(self, table: Array, time_step: float, is_elastic: Flags) -> None:
        """Writes the columns of w, r and z: how soon a joint counts as resting, and its
        friction as unknown.

        Args:
            table: (n, _COLUMNS), its column _HALF_STEP written.
            time_step: s.
            is_elastic: (n,) whether the law remembers the torque with which the joint stopped.
        """
        table[:, _DECAY] = np.exp(-2.0 * time_step / self.rest_time)
        table[:, _INVERSE_REACH] = 1.0 / self.reach
        table[:, _INVERSE_REST_SPEED] = self.resting_only * self.rest_time / self.reach
        table[:, _PLAY] = np.maximum(2.0 * table[:, _HALF_STEP], MIN_PLAY)
        table[:, _INVERSE_CREEP] = 1.0 / (CREEP_SPEED * time_step)
        table[:, _HELD] = self.held
        table[:, _UNSEEN] = self.rests == 0.0
        table[:, _SUDDEN] = ~is_elastic  # m
        forgetting = np.where(is_elastic, RELAXATION_TIME, RECOGNITION_TIME)
        recognised_share = -np.expm1(-time_step / forgetting)  # of what is left, a period
        table[:, _RECOGNISED] = 0.0 if self.law_holds_at_rest else recognised_share

    def initial_state(self) -> Array:
        """Returns the (TORQUE_ERROR_ROWS, n) state before the first sample: nothing is known."""
        return initial_torque_error_state(self.num_joints)

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers and lists, by attribute."""
        return {
            attribute.name: np.asarray(getattr(self, attribute.name)).tolist()
            for attribute in fields(self)
        }


_NUMBERS = {
    "rest_time",
    "reach",
    "drift",
    "beyond_speed",
    "beyond_load",
    "scale",
    "read_load",
    "resting_only",
}
PLAIN: dict[str, Any] = {
    **dict.fromkeys(("speed", "load", "acceleration", "reversal", "lasting", "resolution"), 0.0),
    "fitted_speed": 0.0,
    "fitted_load": 0.0,
    "correlation_time": 1.0,
    "K_0": 1.0,
}
"""Attributes of an error that does not depend on motion, without its size and correlation."""


class ConstantTorqueError(TorqueErrorModel):
    """Torque error of constant covariance, for a model without a fitted torque error."""

    law_holds_at_rest = True

    @classmethod
    def of(
        cls, covariance: ArrayLike, fitted_speed: ArrayLike = 0.0, fitted_load: ArrayLike = 0.0
    ) -> Self:
        """Returns the error of a covariance (n, n) N^2 m^2.

        Args:
            covariance: symmetric, positive definite.
            fitted_speed, fitted_load: as the attributes; a number stands for all joints.

        Raises:
            ValueError: it is not a positive definite covariance.
        """
        Sigma = np.asarray(covariance, float)
        sd = np.sqrt(np.diag(Sigma))
        return cls(
            **PLAIN | {"fitted_speed": fitted_speed, "fitted_load": fitted_load},
            constant=sd,
            correlation=Sigma / np.outer(sd, sd),
            drift=0.0,
            beyond_speed=0.0,
            beyond_load=0.0,
            scale=0.0,
        )

    @property
    def covariance(self) -> Array:
        """(n, n) N^2 m^2."""
        return np.asarray(self.constant[:, None] * self.correlation * self.constant)

    def table(
        self,
        friction: FrictionLaw | SlidingLaw,
        time_step: float,
        K_0: ArrayLike,
        resolution: ArrayLike | None = None,
        chain: SerialChain | None = None,
    ) -> Array:
        """As `TorqueErrorModel`'s, without stiction, and the same behind any observer."""
        table = super().table(friction, time_step, K_0, resolution, chain)
        table[:, :SLIDING_COLUMNS] = 0.0
        table[:, _CONSTANT2] = self.constant**2
        return table


class LawHoldsAtRest(TorqueErrorModel):
    """A torque error for an observer that takes off the law's torque at rest as well.

    That is the article's method, whose friction is a function of velocity alone: where a joint
    stands, the sign of its velocity is that of noise, and so is that of its friction.
    """

    law_holds_at_rest = True

    @classmethod
    def of(cls, error: TorqueErrorModel) -> Self:
        """Returns the same error for such an observer."""
        return cls(**{field.name: getattr(error, field.name) for field in fields(error)})


def averaged_share(x: ArrayLike) -> Array:
    """Variance of the mean over x correlation times of a process of variance 1 and covariance
    exp(-|t| / T): 2 / x (1 - (1 - exp(-x)) / x); 1 for x = 0.
    """
    times = np.maximum(np.asarray(x, float), 1e-6)
    return np.asarray(2.0 / times * (1.0 + np.expm1(-times) / times))


def initial_torque_error_state(num_joints: int) -> Array:
    """Returns the (TORQUE_ERROR_ROWS, n) state before the first sample: nothing is known."""
    state = np.zeros((TORQUE_ERROR_ROWS, num_joints))
    state[[_POSITION, _PLAY_POSITION]] = np.nan
    state[[_UNKNOWN_SHARE, REST_ROW, HIDDEN_ROW]] = 1.0
    state[_TURN] = 1.0  # where nothing is known, nothing turns
    state[_TAU_J] = np.nan
    return state


@kernel(**NO_NEW_ARRAYS)
def rest_rows(table: Array, state: Array, q: Array, v: Array, rows: Array) -> None:
    """Follows the motion of N samples: which joints rest, which turn.

    None of it depends on a torque. So the friction that rests may take off is known before the
    torque error, which depends on the friction of the sample before.

    Args:
        table: `TorqueErrorModel.table`.
        state: (TORQUE_ERROR_ROWS, n) or more rows, those of the motion changed.
        q, v: (N, n) rad, rad/s.
        rows: (N, TORQUE_ERROR_ROWS, n), the same rows written after each sample.
    """
    for k in range(q.shape[0]):
        for i in range(q.shape[1]):
            _follow_motion(table, state, i, q[k, i], v[k, i])
            for row in _MOTION_ROWS:
                rows[k, row, i] = state[row, i]


@kernel(**NO_NEW_ARRAYS)
def torque_sd_rows(
    table: Array,
    state: Array,
    v: Array,
    tau_J: Array,
    tau_f: Array,
    rows: Array,
    sd: Array,
    stiction: Array,
    drift: Array,
) -> None:
    """Writes the sds of N samples, whose motion `rest_rows` has followed.

    The variance is a sum, each with its column of the table: constant, speed^2, load^2,
    acceleration^2 (K_0 times the speed less its low-pass), stiction and reversals, the viscous
    torque's drift, the posture's gravity, and what lies beyond the fitted speed and load.

    A joint whose q or v is not finite keeps its state; a v that is not finite counts as zero.

    Args:
        table: `TorqueErrorModel.table`.
        state: (TORQUE_ERROR_ROWS, n) or more rows, those of the torques changed.
        v, tau_J, tau_f: (N, n) rad/s and N m; the torques count for the sample after.
        rows: (N, TORQUE_ERROR_ROWS, n) of `rest_rows`; completed: the state after each sample, but
            with the torques of the one before.
        sd: (N, n) N m, written; holds the `posture_variance_rows` before.
        stiction: (N, n) N m, written: the part of it that is stiction.
        drift: (N, n) N m, written: sd of the viscous torque's drift, with that torque's sign.
    """
    for k in range(v.shape[0]):
        for i in range(v.shape[1]):
            row = table[i]
            # Moves the state's rows _UNKNOWN to _SLOW_SPEED and HIDDEN_ROW on to this sample.
            _low_pass(table, rows[k], state, i, v[k, i])
            speed = v[k, i] if np.isfinite(v[k, i]) else 0.0
            load = abs(state[_TRANSMITTED, i])  # of the sample before
            acceleration = row[_GAIN] * (speed - state[_SLOW_SPEED, i])
            viscous = row[VISCOUS] * speed + bounded_cubic(
                speed, row[_CUBIC], row[_SPEED_LIMIT], row[_BEYOND]
            )
            # Stiction: what friction at rest hides, and what a reversal leaves, which is at most
            # the whole step of friction from one direction to the other; a negative Stribeck part
            # makes the level largest at speed.
            largest_step = 2.0 * (breakaway(table, state, i) + max(-row[_S], 0.0))
            turned = min(row[_REVERSAL2] * state[_TURNING, i] ** 2, largest_step * largest_step)
            stuck = state[_UNKNOWN, i] ** 2 + turned
            # Variances, N^2 m^2; sd[k, i] still holds that of the posture's gravity.
            total = row[_CONSTANT2] + row[_SPEED2] * speed**2 + row[_LOAD2] * load**2
            total += (
                row[_ACCELERATION2] * acceleration**2 + stuck + row[_DRIFT2] * viscous**2 + sd[k, i]
            )
            if abs(speed) > row[_FITTED_SPEED]:
                total += row[_BEYOND_SPEED2] * (abs(speed) - row[_FITTED_SPEED]) ** 2
            if load > row[_FITTED_LOAD]:
                total += row[_BEYOND_LOAD2] * (load - row[_FITTED_LOAD]) ** 2
            sd[k, i] = np.sqrt(total)
            stiction[k, i] = np.sqrt(stuck)
            drift[k, i] = np.sqrt(row[_DRIFT2]) * viscous
            for load_row in _LOAD_ROWS:  # _TRANSMITTED and _TAU_J are still of the sample before
                rows[k, load_row, i] = state[load_row, i]
        take_transmitted(state, tau_J[k], tau_f[k])  # for the next sample


@kernel(**NO_NEW_ARRAYS)
def take_transmitted(state: Array, tau_J: Array, tau_f: Array) -> None:
    """Stores L = tau_J - tau_f and tau_J, (n,) N m, for the next sample, where they are finite."""
    for i in range(tau_J.shape[0]):
        transmitted = tau_J[i] - tau_f[i]
        if np.isfinite(transmitted):
            state[_TRANSMITTED, i] = transmitted
            state[_TAU_J, i] = tau_J[i]


@kernel
def _follow_motion(table: Array, state: Array, i: int, q: float, v: float) -> None:
    """Updates the rows of joint i's motion by a sample; without a finite pair they stay.

    Rows of the state, with the module's letters: the position with the encoder's rounding taken off
    (_POSITION, p), the same behind a play (_PLAY_POSITION, p_a), by which a joint that trembles
    stands still; how much it stands still in this period (_STILL), and rests (REST_ROW, r, 0 to 1);
    the share of its friction that is unknown (_UNKNOWN_SHARE, w); and how far it has moved to which
    side lately, in units of the reach, from -1 to 1 (_TURN, z).

    Args:
        table: (n, columns), `TorqueErrorModel.table`.
        state: (TORQUE_ERROR_ROWS, n), changed.
        i: index of the joint.
        q, v: rad and rad/s of the joint.
    """
    if not (np.isfinite(q) and np.isfinite(v)):
        state[_TAKEN, i] = _LOST_STATUS
        return
    row = table[i]
    previous = state[_POSITION, i]
    has_previous = np.isfinite(previous)
    p = within_rounding(previous, q, v, row[_HALF_STEP], row[_PERIOD])
    moved_reaches = (p - previous) * row[_INVERSE_REACH] if has_previous else 0.0
    # The position behind a play of row[_PLAY] to both sides: how much of a rest is left after the
    # way that it went, and whether it went as slowly as a creep.
    previous_a = state[_PLAY_POSITION, i] if has_previous else p
    p_a = min(max(previous_a, p - row[_PLAY]), p + row[_PLAY])
    rest_left = np.exp(-abs(p_a - previous_a) * row[_INVERSE_REACH])
    creep_ratio = (p_a - previous_a) * row[_INVERSE_CREEP]
    still = np.exp(-creep_ratio * creep_ratio) if has_previous else 0.0
    # What a period leaves known of the friction: 1 - g + g exp(-2 dt / rest_time); with
    # `resting_only` nothing is lost in motion.
    known_left = row[_DECAY]
    rest_speed_ratio = v * row[_INVERSE_REST_SPEED]
    if rest_speed_ratio != 0.0:
        known_left += (1.0 - known_left) * (1.0 - np.exp(-rest_speed_ratio * rest_speed_ratio))
    # _RECOGNISED is 0 of a law that itself holds at rest: no joint is known to rest, r stays 0.
    r = state[REST_ROW, i] * rest_left if row[_RECOGNISED] > 0.0 else 0.0
    state[_UNKNOWN_SHARE, i] = (1.0 - (1.0 - state[_UNKNOWN_SHARE, i]) * known_left) * rest_left
    state[REST_ROW, i] = r + still * row[_RECOGNISED] * (1.0 - r)
    state[_TURN, i] = min(max(state[_TURN, i] + moved_reaches, -1.0), 1.0)
    state[_POSITION, i], state[_PLAY_POSITION, i] = p, p_a
    state[_STILL, i] = still
    state[_TAKEN, i] = _LATER_STATUS if has_previous else _FIRST_STATUS


@kernel
def _low_pass(table: Array, motion: Array, state: Array, i: int, v: float) -> None:
    """Updates the low-passed rows of joint i; `motion` has its rows of the motion at the sample."""
    if motion[_TAKEN, i] == _LOST_STATUS:
        return
    row = table[i]
    x = v * row[_INVERSE_SPEED]
    level = row[_C] + row[_S] * np.exp(-x * x) + row[_LOAD] * abs(state[_TRANSMITTED, i])
    level = max(level, 0.0)
    w, r, z = motion[_UNKNOWN_SHARE, i], motion[REST_ROW, i], motion[_TURN, i]
    share = max(w, r)
    unknown = level * np.sqrt(share / 3.0 + row[_SUDDEN] * r * (1.0 - r))
    turning = level * (1.0 - z * z) * (1.0 - share)
    hidden = max((2.0 - r) * max(motion[_STILL, i], r), w)
    pole = 0.0 if motion[_TAKEN, i] == _FIRST_STATUS else row[_POLE]
    state[HIDDEN_ROW, i] = pole * state[HIDDEN_ROW, i] + (1.0 - pole) * hidden
    state[_UNKNOWN, i] = pole * state[_UNKNOWN, i] + (1.0 - pole) * unknown
    state[_TURNING, i] = pole * state[_TURNING, i] + (1.0 - pole) * turning
    state[_SLOW_SPEED, i] = pole * state[_SLOW_SPEED, i] + (1.0 - pole) * v


@kernel
def breakaway(table: Array, state: Array, i: int) -> float:
    """N m, level of joint i at rest, of the table and state of `torque_sd_rows`."""
    level: float = table[i, _C] + table[i, _S] + table[i, _LOAD] * abs(state[_TRANSMITTED, i])
    return max(level, 0.0)


@kernel
def hidden_torque(table: Array, state: Array, i: int) -> float:
    """N m, what friction of joint i may hide of tau_ext after this sample."""
    level = breakaway(table, state, i)
    if table[i, _UNSEEN] != 0.0 and state[REST_ROW, i] > UNSEEN_REST and level > 0.0:
        return np.inf
    return float(table[i, _HELD] * level * state[HIDDEN_ROW, i])


def may_rest_unseen(table: Array) -> bool:
    """Whether `torque_at_unseen_rest` can find anything with a `TorqueErrorModel.table`."""
    return bool(np.any((table[:, _UNSEEN] != 0.0) & (table[:, _RECOGNISED] > 0.0)))


@kernel
def torque_at_unseen_rest(table: Array, rows: Array, tau_ext: Array) -> Flags:
    """(N,) whether a joint that rested in no log rests with more than its sliding friction.

    Args:
        table: `TorqueErrorModel.table`.
        rows: (N, TORQUE_ERROR_ROWS, n) states after N samples.
        tau_ext: (N, n) N m.
    """
    is_beyond = np.zeros(len(tau_ext), np.bool_)
    for k in range(len(tau_ext)):
        for i in range(tau_ext.shape[1]):
            if table[i, _UNSEEN] != 0.0 and rows[k, REST_ROW, i] > UNSEEN_REST:
                level = breakaway(table, rows[k], i)
                is_beyond[k] = is_beyond[k] or abs(tau_ext[k, i]) > MIN_HELD_RATIO * level > 0.0
    return is_beyond


@kernel(nogil=True)
def posture_variance_rows(table: Array, q: Array, variance: Array) -> None:
    """Variance of the gravity torque beyond the fitted postures, of N samples.

    Args:
        table: `TorqueErrorModel.table` of an error with a spread.
        q: (N, n) rad.
        variance: (N, n) N^2 m^2, written.
    """
    for k in range(q.shape[0]):
        spread_beyond(table[:, _COLUMNS:], q[k], variance[k])


def has_spread(table: Array) -> bool:
    """Whether a `TorqueErrorModel.table` has directions in which gravity may be off."""
    return bool(table.shape[1] > _COLUMNS)


@kernel
def torque_error_features(
    table: Array, state: Array, q: Array, v: Array, transmitted: Array, features: Array
) -> None:
    """The terms of the variance along a log, before their constants; for the fit.

    Args:
        table, state: as `torque_sd_rows`.
        q, v, transmitted: (N, n).
        features: (N, n, NUM_FEATURES), written: of `variance_parts`.
    """
    for k in range(q.shape[0]):
        for i in range(q.shape[1]):
            _follow_motion(table, state, i, q[k, i], v[k, i])
            _low_pass(table, state, state, i, v[k, i])
            variance_parts(table, state, i, v[k, i], state[_TRANSMITTED, i], features[k, i])
            if np.isfinite(transmitted[k, i]):
                state[_TRANSMITTED, i] = transmitted[k, i]


@kernel
def variance_parts(table: Array, state: Array, i: int, v: float, load: float, parts: Array) -> None:
    """Single-sample kernel: the features (NUM_FEATURES,) of joint i once `state` has its sample.

    Args:
        table, state: as `torque_sd_rows`.
        i: joint.
        v: rad/s.
        load: L of the sample before, N m.
        parts: (NUM_FEATURES,), CONSTANT_PART to STICTION_PART, written.
    """
    speed = v if np.isfinite(v) else 0.0
    parts[CONSTANT_PART] = 1.0
    parts[SPEED_PART] = speed**2
    parts[LOAD_PART] = load**2
    parts[ACCELERATION_PART] = (table[i, _GAIN] * (speed - state[_SLOW_SPEED, i])) ** 2
    parts[REVERSAL_PART] = state[_TURNING, i] ** 2
    parts[STICTION_PART] = state[_UNKNOWN, i] ** 2
