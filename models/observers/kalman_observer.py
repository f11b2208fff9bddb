"""A Kalman filter of the momentum with wrench and torque error as states.

Momentum obeys d/dt p = u + tau, with u = tau_J - tau_f + CTv - G. The torque that the model does
not explain is tau = J^T F + e. The filter separates the wrench F from the torque error e by the
statistics of both. The states p and F are those of Wahrburg et al., "Motor-current-based estimation
of Cartesian contact forces and torques for robotic manipulators and its application to force
control", IEEE T-ASE 15(2), 2018. The error's states are those of the model's torque error:

    p_k+1 = p_k + T (u + J^T F + s x + b beta) + w,   y_k = p_k + r      n each, N m s
    F_k+1 = a F_k + ...                               first-order prior, see below
    x_k = a_x x_k-1 + ...                             error's smooth part, of sd 1
    beta                                              slow bias of sd 1, constant

The correlation time of x is T_c where a joint moves, and infinite while a joint rests:
a_x = exp(-g T / T_c) r, with g the share of s^2 that is not stiction. Where s changes by a factor,
x is renewed in part, r = min(s' / s, s / s'). Otherwise the filter would wrongly separate a
constant error of a joint at rest from a force, since s varies there by an encoder's step and a
constant does not.

The torque error model (`models.identification.torque_error_model`) states the sd of an observer's
output, with pole K_0, where nothing touches the arm. It is sd^2 = moving^2 + stiction^2 + slow^2,
sample by sample. A share WHITE_SHARE of moving^2 is white torque noise w, of density 2 / K_0 times
it. The remainder and stiction are smooth, s^2 = (1 - share) (1 + K_0 T_c) / (K_0 T_c) moving^2 +
stiction^2. Behind K_0 both together have the stated variance again. The slow part b is the drift of
the viscous friction plus `lasting`. It is a considered parameter (Schmidt, 1966): it is not
estimated, since a lasting force would be taken for it, but counts in gain and covariance:

    P   covariance of the error without it,     C   what beta = 1 adds to the error
    gain = (P + C C^T) H^T (H (P + C C^T) H^T + R)^-1,   Sigma_F = (P + C C^T) of F

An innovation contradicts the model if its square over its covariance occurs by chance in one sample
of a million. This happens where a large push begins or a fault of the drives ends. P then grows
until the innovation is just possible, by at most MOST_DOUBT. Earlier samples then count for less,
and the sd grows.

A force that begins or ends, such as a push, is not a random walk either. One innovation shows
little of it: the less, the shorter the period. Sums of innovations show it. With L L^T the
innovation's covariance, L^-1 (y - p) of the model is white, of covariance 1. For any time t the sum
s has the covariance 1 as well:

    s <- a s + sqrt(1 - a^2) L^-1 (y - p),   a = exp(-T / t),   t in CHANGE_TIMES

Each |s|^2 has a threshold that CHANGE_ODDS of the samples exceed by chance. Where one exceeds it, a
force of the live prior's size may have begun or ended (Willsky and Jones, "A generalized likelihood
ratio approach to the detection and estimation of jumps in linear systems", IEEE TAC 21(1), 1976).
Its variance is then added to that of F, and the sums start anew. Until the sums show the change,
the band does not contain the force. An error beyond the model triggers this, too: the reading then
has a larger sd and more noise.

After as many lost samples in a row as the filter needs to settle, it starts anew.

How fast a force may change does not depend on the prior of a log. Its variance grows by 4 pi f sd^2
a second, with the live prior's sd and f = `bandwidth_hz`, the corner of a force of that size. The
reading's prior states how large the force may be. a = exp(-2 pi f T) where that prior is the live
one. a is less where the log's prior is smaller, and 1 (a random walk) without a prior of the size.
Before the first sample F has the variance of the reading's prior; without one, of an sd that is
_START_SHARE times the live one. Where F may have changed, its variance grows by the lesser of that
and the live prior's.
The covariance includes how fast a force may change, so that the lag needs no further term.

u and y are those of `momentum_observer`: the model's part of u averaged over a period, the motor
torque held or averaged. J, s and b are those of the period's start. The measurement's noise r is
rounding's alone, of an sd that is _ROUNDING_SHARE of what the torque's sd adds to the momentum in a
period: what encoders add is in the torque error.
"""

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
from scipy.special import chdtri

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.observers.kalman_kernels import (
    BEFORE,
    CHANGED,
    DECAY_F,
    DECAY_SUM,
    GROSS,
    JOINTS,
    JUMP_F,
    LASTING,
    NOISE_F,
    NUM_NUMBERS,
    NUM_SUMS,
    PERIOD,
    RATE_X,
    ROUND,
    SETTLED,
    SIXES,
    SMOOTH,
    START_F,
    WHITE,
    KalmanState,
    KalmanTable,
    observe_wrench,
    state_places,
)
from wrenchsight.models.observers.observer import (
    TAU_EXT,
    ModelKnowledge,
    Observed,
    ObserverSamples,
    WrenchPrior,
)
from wrenchsight.models.observers.period_torque import checked_period, motor_share
from wrenchsight.models.observers.signals import signals_of

WHITE_SHARE = 0.6  # of a moving joint's error variance behind K_0: the UR10e's three fitted runs
SETTLING_TIME_CONSTANTS = 3.0  # 1 / K_0 of the error model
CHANGE_TIMES = (0.03, 0.1, 0.3)  # s, over which innovations are summed
CHANGE_ODDS = 1e-3  # of a sum of them that is still the model's
_ROUNDING_SHARE = 1e-3  # of the momentum that the torque's sd brings in a period
_START_SHARE = 30.0  # of the live prior's sd: an sd that stands for no prior
_GROSS_ODDS = 1e-6  # of a sample whose innovation is still the model's
_PLAIN_K_0, _PLAIN_TIME = 20.0, 0.3  # 1/s, s: of a model without a torque error


@dataclass
class KalmanObserverConfig:
    """Prior of a changing force, and sampling of the Kalman observer."""

    bandwidth_hz: float = 0.002
    """Hz, Kalman observer: corner of the prior of a large force"""
    time_step: float = 0.001
    """s between samples"""
    torque_samples: str = "held"
    """mean motor torque of a period: `held` or `trapezoidal`"""


class KalmanObserver:
    """The filter of this module for an arm with n joints; an `observer.Observer`.

    It reads the wrench itself, by the prior of the estimator's configuration: methods bayesian,
    force_only and inverse. `informed` gives it what the model and that configuration say; before,
    it takes a prior of 1 N and 1 N m.

    Raises:
        ValueError: bandwidth or time step that is not positive, unknown torque samples; a method
            of reading that has no prior.
    """

    Config: ClassVar[type] = KalmanObserverConfig
    reads_wrench: ClassVar[bool] = True
    pole: Array | None = None

    def __init__(
        self,
        config: KalmanObserverConfig,
        num_joints: int,
        knowledge: ModelKnowledge | None = None,
    ) -> None:
        T, f = checked_period(config.time_step, config.torque_samples), float(config.bandwidth_hz)
        if not (np.isfinite(f) and f > 0.0):
            raise ValueError(f"bandwidth_hz must be positive, not {f}")
        self.config = config
        self.num_joints = num_joints
        self.time_step = T
        self.reads_present_torque = config.torque_samples != "held"
        self._knowledge = knowledge
        self.table = self._table(knowledge)
        self.settling_time = float(self.table.numbers[SETTLED]) * T

    def informed(self, knowledge: ModelKnowledge) -> Self:
        """Returns the observer with the knowledge of a model and of a reading's configuration."""
        return type(self)(self.config, self.num_joints, knowledge)

    @property
    def parameters(self) -> dict[str, Array]:
        """bandwidth_hz (1,), Hz."""
        return {"bandwidth_hz": np.array([self.config.bandwidth_hz])}

    def with_parameters(self, values: dict[str, Array]) -> Self:
        """Returns the observer with another bandwidth."""
        config = replace(self.config, bandwidth_hz=float(values["bandwidth_hz"][0]))
        return type(self)(config, self.num_joints, self._knowledge)

    def initial_state(self) -> KalmanState:
        """Returns the state before the first sample."""
        n = self.num_joints
        N = state_places(n).slow  # what stands before the smoother's slow part
        P = np.zeros((N, N))
        P[range(n, N), range(n, N)] = np.concatenate([self.table.sixes[START_F], np.ones(n)])
        return KalmanState(
            x=np.zeros(N),
            gain=np.zeros((N, n)),
            P=P,
            C=np.zeros((N, n)),
            status=np.zeros(2),
            previous_smooth=np.zeros(n),
            sums=np.zeros((NUM_SUMS, n)),
        )

    def observe(self, state: KalmanState, samples: ObserverSamples) -> Observed:
        """Updates `state` with N samples; see `observer.Observer`."""
        N, signals = len(samples.v), signals_of(samples)
        is_fresh = np.empty(N, np.bool_)
        wrench, covariance = np.empty((N, 6)), np.empty((N, 6, 6))
        observe_wrench(self.table, state, signals, samples.J, is_fresh, wrench, covariance)
        return Observed(signals[:, TAU_EXT].copy(), is_fresh, wrench, covariance)

    def _table(self, knowledge: ModelKnowledge | None) -> KalmanTable:
        """The constants of the filter, from what is known of the arm (`knowledge`; None: nothing).

        What is not known is replaced: the error's correlation time by _PLAIN_TIME, its rate K_0 by
        _PLAIN_K_0, the sds of torque and prior by 1, the correlation by none.

        Raises:
            ValueError: the method of the reading has no prior.
        """
        n, T = self.num_joints, self.time_step
        K_0, correlation_time = np.full(n, _PLAIN_K_0), np.full(n, _PLAIN_TIME)
        torque_sd, lasting, mixing = np.ones(n), np.zeros(n), np.eye(n)  # N m; share of a variance
        prior: WrenchPrior | None = WrenchPrior(
            moment_sd=1.0, force_sd=1.0, live_moment_sd=1.0, live_force_sd=1.0
        )
        if knowledge is not None:
            torque_sd, prior = knowledge.torque_sd, knowledge.prior
            # The rates are those of an observer behind which a learnt error has its sds. Without
            # one the sd is that of the residual, behind no observer: _PLAIN_K_0 stays.
            if (error := knowledge.torque_error) is not None:
                K_0, correlation_time = knowledge.rates, error.correlation_time
                # The constant part of the sd is the least: the rounding is a share of it.
                torque_sd, lasting, mixing = error.constant, error.lasting, error.correlation
        if prior is None:
            raise ValueError("a Kalman observer reads by bayesian, force_only or inverse")
        numbers = np.zeros(NUM_NUMBERS)
        numbers[PERIOD] = T
        numbers[BEFORE] = motor_share(T, self.config.torque_samples)
        # The squares that chi^2 of n joints exceeds so seldom.
        numbers[GROSS] = chdtri(n, _GROSS_ODDS)
        numbers[CHANGED] = chdtri(n, CHANGE_ODDS)
        numbers[DECAY_SUM : DECAY_SUM + NUM_SUMS] = np.exp(-T / np.array(CHANGE_TIMES))
        numbers[SETTLED] = np.ceil(SETTLING_TIME_CONSTANTS / float(np.min(K_0)) / T)
        decay, noise, start = changing_wrench(prior, self.config.bandwidth_hz, T)
        live_variance = np.square([prior.live_moment_sd] * 3 + [prior.live_force_sd] * 3)
        sixes = np.zeros((SIXES, 6))
        sixes[DECAY_F], sixes[NOISE_F], sixes[START_F] = decay, noise, start
        # Of a force that may have changed no more is unknown than before the first sample.
        sixes[JUMP_F] = np.minimum(start, live_variance)
        # As `kalman_kernels` names these rows; the formulas are in the module's docstring.
        joints = np.zeros((JOINTS, n))
        joints[RATE_X] = 1.0 / correlation_time
        K_0_T_c = K_0 * correlation_time
        joints[SMOOTH] = (1.0 - WHITE_SHARE) * (1.0 + K_0_T_c) / K_0_T_c
        joints[WHITE] = WHITE_SHARE * 2.0 / K_0
        joints[LASTING] = np.sqrt(lasting)  # of a variance; the row is of an sd
        joints[ROUND] = (_ROUNDING_SHARE * T * np.asarray(torque_sd)) ** 2
        return KalmanTable(
            numbers=numbers,
            sixes=sixes,
            joints=joints,
            mixing=np.ascontiguousarray(mixing, float),
        )


def changing_wrench(
    prior: WrenchPrior, bandwidth_hz: float, time_step: float
) -> tuple[Array, Array, Array]:
    """The first-order prior of a changing wrench, moment first.

    Returns:
        (6,) decay over a period; (6,) variance that a period adds; (6,) variance at the start.
    """
    reading_sd, live_sd = np.array(prior[:2]), np.array(prior[2:])
    rate = 4.0 * np.pi * bandwidth_hz * live_sd**2  # of the variance
    start_sd = np.where(np.isinf(reading_sd), _START_SHARE * live_sd, reading_sd)
    is_walk = np.isinf(reading_sd) | (reading_sd == 0.0)
    decay = np.exp(-0.5 * rate * time_step / np.where(is_walk, np.inf, reading_sd) ** 2)
    size = np.where(is_walk, 0.0, reading_sd)
    steps = np.where(np.isinf(reading_sd), rate * time_step, (1.0 - decay**2) * size**2)
    return np.repeat(decay, 3), np.repeat(steps, 3), np.repeat(start_sd**2, 3)
