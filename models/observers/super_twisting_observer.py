"""A super-twisting observer of the momentum: second-order sliding mode.

With e = momentum - momentum_hat and u = tau_J - tau_f + CTv - G (Garofalo, Mansfeld, Jankowski and
Ott, "Sliding mode momentum observers for estimation of external torques and joint acceleration",
ICRA 2019):

    d/dt momentum_hat = u + k_1 sqrt(|e|) sign(e) + tau_ext_hat
    d/dt tau_ext_hat  = k_2 sign(e)

Where |d/dt tau_ext| <= L, e and the error of tau_ext_hat are zero after a finite time, without a
lag, for

    k_1 = 1.5 sqrt(L),    k_2 = 1.1 L        (Levant, Automatica 34(3), 1998)

so that L, the bound on the torque's rate, is the only number to choose: what acts faster is read
late, at k_2, and noise is followed up to the same rate.

Taken explicitly the sign chatters by k_2 T about the truth. Here it is taken implicitly (Brogliato,
Polyakov and Efimov, "The implicit discretization of the super-twisting sliding-mode control
algorithm", IEEE TAC 65(8), 2020): with b = momentum - (momentum_hat + T u + T tau_ext_hat), what a
period brings beyond what was foreseen,

    |b| <= T^2 k_2:  e = 0,  tau_ext_hat <- tau_ext_hat + b / T
    beyond:          sqrt(|e|) = (-T k_1 + sqrt(T^2 k_1^2 + 4 (|b| - T^2 k_2))) / 2,
                     tau_ext_hat <- tau_ext_hat + T k_2 sign(b)

a constant torque is then held exactly. What acts faster than L leaves an impulse e behind that has
not been read yet: beyond MISSED times the torque's sd the estimate counts as not fresh.

u is averaged over a period as in `momentum_observer`.
"""

from dataclasses import dataclass, field, replace
from typing import ClassVar, Self

import numpy as np

from wrenchsight.models.arrays import Array
from wrenchsight.models.kernel import kernel
from wrenchsight.models.observers.observer import (
    CTV,
    GRAVITY,
    TAU_EXT,
    TAU_F,
    TAU_J,
    ModelKnowledge,
    ObserverKernels,
)
from wrenchsight.models.observers.period_torque import (
    arrived_momentum,
    checked_period,
    motor_share,
    positive_per_joint,
)

RATE = 60.0  # 1/s, of the torque's own sd: L where none is stated; the UR10e's three fitted runs
MISSED = 3.0 / 20.0  # s: such an impulse, over the torque's sd, reads as three sds at K_0 = 20 /s
LEVANT_1, LEVANT_2 = 1.5, 1.1
_SETTLING = 20.0  # sds of torque that an observer may have to cover at its start

# Columns of the table.
_PERIOD, _BEFORE, _ROOT, _SLOPE, _MISSED = range(5)
# Rows of the state: momentum foreseen, tau_ext_hat, the last b's sign, 1 once e has been zero.
_FORESEEN, _TAU, _SIGN, _REACHED = range(4)


@dataclass
class SuperTwistingObserverConfig:
    """How fast an external torque is thought to change."""

    torque_rate: list[float] = field(default_factory=list)
    """N m/s: L, one for all joints, or each; empty: RATE times the torque error's sd."""
    time_step: float = 0.001  # s between samples
    torque_samples: str = "held"  # mean motor torque of a period: "held" or "trapezoidal"


@kernel
def _left(
    row: Array,
    b: float,
) -> float:
    """e after a sample."""
    bound = row[_PERIOD] * row[_PERIOD] * row[_SLOPE]
    if not abs(b) > bound:
        return 0.0
    a = row[_PERIOD] * row[_ROOT]
    root = 0.5 * (np.sqrt(a * a + 4.0 * (abs(b) - bound)) - a)
    left: float = np.copysign(root * root, b)
    return left


@kernel
def super_twisting_output(table: Array, state: Array, signals: Array, J: Array) -> bool:
    """Writes the estimate right after a sample; see `observer`."""
    fresh = True
    for i in range(table.shape[0]):
        row = table[i]
        b = arrived_momentum(0.5 * row[_PERIOD], row[_BEFORE], signals, i) - state[_FORESEEN, i]
        tau_ext = state[_TAU, i]
        if np.isfinite(b):
            step = b / row[_PERIOD]
            most = row[_PERIOD] * row[_SLOPE]
            tau_ext += min(max(step, -most), most)
            turned = state[_SIGN, i] * b < 0.0
            fresh = fresh and (state[_REACHED, i] == 1.0 or turned or abs(step) <= most)
            fresh = fresh and abs(_left(row, b)) <= row[_MISSED]
        else:
            fresh = False
        signals[TAU_EXT, i] = tau_ext
    return fresh


@kernel
def super_twisting_update(table: Array, state: Array, signals: Array, J: Array) -> None:
    """Takes a sample and its `super_twisting_output` into `state`, in place; see `observer`.

    A sample that is not finite loses the momentum; the next finite one starts it again.
    """
    for i in range(table.shape[0]):
        row = table[i]
        arrived = arrived_momentum(0.5 * row[_PERIOD], row[_BEFORE], signals, i)
        b = arrived - state[_FORESEEN, i]
        error = 0.0
        if np.isfinite(b):
            error = _left(row, b)
            if error == 0.0 or state[_SIGN, i] * b < 0.0:
                state[_REACHED, i] = 1.0
            state[_SIGN, i] = np.sign(b)
        u = signals[TAU_J, i] + signals[CTV, i] - signals[GRAVITY, i] - signals[TAU_F, i]
        foreseen = arrived - error + row[_PERIOD] * (u + signals[TAU_EXT, i])
        state[_FORESEEN, i] = foreseen if np.isfinite(foreseen) else np.nan
        state[_TAU, i] = signals[TAU_EXT, i]


class SuperTwistingObserver:
    """The observer of this module for an arm with n joints; an `observer.Observer`.

    Attributes:
        torque_rate: (n,) L, N m/s.

    Raises:
        ValueError: a rate or time step that is not positive, neither 1 nor n rates, unknown torque
            samples.
    """

    Config: ClassVar[type] = SuperTwistingObserverConfig
    kernels: ClassVar[ObserverKernels] = ObserverKernels(
        super_twisting_output, super_twisting_update
    )
    pole: Array | None = None

    def __init__(
        self, config: SuperTwistingObserverConfig, num_joints: int, torque_sd: Array | None = None
    ) -> None:
        T = checked_period(config.time_step, config.torque_samples)
        sd = np.ones(num_joints) if torque_sd is None else torque_sd
        rate = config.torque_rate if len(config.torque_rate) else RATE * sd
        self.config = config
        self.num_joints = num_joints
        self.time_step = T
        self.torque_rate = positive_per_joint("torque_rate", rate, num_joints)
        self.reads_present_torque = config.torque_samples != "held"
        self.settling_time = float(np.max(_SETTLING * sd / (LEVANT_2 * self.torque_rate)))
        self._torque_sd = torque_sd
        self.table = np.empty((num_joints, 5))
        self.table[:, _PERIOD] = T
        self.table[:, _BEFORE] = motor_share(T, config.torque_samples)
        self.table[:, _ROOT] = LEVANT_1 * np.sqrt(self.torque_rate)
        self.table[:, _SLOPE] = LEVANT_2 * self.torque_rate
        self.table[:, _MISSED] = MISSED * sd

    def informed(self, knowledge: ModelKnowledge) -> Self:
        """Returns the observer with the rates that a model's torque error suggests."""
        return type(self)(self.config, self.num_joints, knowledge.torque_sd)

    @property
    def parameters(self) -> dict[str, Array]:
        """torque_rate (n,) N m/s."""
        return {"torque_rate": self.torque_rate}

    def with_parameters(self, values: dict[str, Array]) -> Self:
        """Returns the observer with other rates."""
        config = replace(self.config, torque_rate=[float(x) for x in values["torque_rate"]])
        return type(self)(config, self.num_joints, self._torque_sd)

    def initial_state(self) -> Array:
        """Returns the (4, n) state before the first sample: tau_ext zero."""
        state = np.zeros((4, self.num_joints))
        state[_FORESEEN] = np.nan
        return state
