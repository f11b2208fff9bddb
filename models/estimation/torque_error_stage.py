"""Uncertainty of the observer's torque at each sample, computed once for all its users.

    q, v, torque that the gears transmitted -> sds of tau_ext  (`identification.torque_error_model`)
    J                                       -> J as the observer saw it  (`observers.lag`)

Users are the reading, the contact detector and the Kalman observer.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.friction.friction_law import FrictionLaw
from wrenchsight.models.identification.torque_error_model import (
    TORQUE_ERROR_ROWS,
    ConstantTorqueError,
    TorqueErrorModel,
    posture_variance,
    take_transmitted,
    torque_sd_tick,
)
from wrenchsight.models.numerics.arrays import Array, contiguous
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.numerics.views import view_2d
from wrenchsight.models.observers.lag import (
    JACOBIAN_ROWS,
    observer_poles,
    see_jacobian,
    take_jacobian,
)
from wrenchsight.models.rigid_body.serial_chain import SerialChain

STAGE_ROWS = TORQUE_ERROR_ROWS + JACOBIAN_ROWS  # of the state, (STAGE_ROWS, n)
ERROR_ROWS = 3 + JACOBIAN_ROWS + TORQUE_ERROR_ROWS  # of `torque_error_views`


class TorqueError(NamedTuple):
    """Uncertainty of tau_ext at one sample; at N samples with a first axis.

    Attributes:
        sd: (n,) N m, of tau_ext where nothing touches the arm.
        stiction: (n,) N m, the part of it that is stiction.
        drift: (n,) N m, the part that is a drift of viscous friction, signed as the speed.
        J_seen: (6, n) rows [angular; linear] at E in axes of W, through the observer's poles.
        rows: (TORQUE_ERROR_ROWS, n) the torque error's state, with the previous sample's load.
    """

    sd: Array
    stiction: Array
    drift: Array
    J_seen: Array
    rows: Array

    @classmethod
    def empty(cls, N: int, n: int) -> "TorqueError":
        """Memory for N samples of n joints."""
        sd, stiction, drift = np.empty((3, N, n))
        J_seen, rows = np.empty((N, JACOBIAN_ROWS, n)), np.empty((N, TORQUE_ERROR_ROWS, n))
        return cls(sd, stiction, drift, J_seen, rows)

    def part(self, rows: slice) -> "TorqueError":
        """Some of N samples."""
        return TorqueError(
            self.sd[rows], self.stiction[rows], self.drift[rows], self.J_seen[rows], self.rows[rows]
        )


class _Motion(NamedTuple):
    """N samples of a motion, as `TorqueErrorStage.run` takes them."""

    q: Array
    v: Array
    transmitted: Array
    J: Array


class TorqueErrorStage:
    """The torque error of one model behind one observer.

    Args:
        error: torque error of the model.
        friction: law of the model, sampled.
        K_0: (n,) 1/s of the observer; None for one without such a lag.
        time_step: s.
        resolution: (n,) rad of the encoders; None: that of the logs that were fitted.
        chain: of the robot; None: the model's gravity torque is exact.

    Attributes:
        table: of `torque_sd_tick`.
        poles: (n,) of the observer, per tick. Negative for an observer without lag and for a model
            without a learnt error; then J is that of the sample itself.
        rates: (n,) 1/s, to which the sds belong.
    """

    def __init__(
        self,
        error: TorqueErrorModel,
        friction: FrictionLaw,
        K_0: ArrayLike | None,
        time_step: float,
        resolution: ArrayLike | None,
        chain: SerialChain | None = None,
    ) -> None:
        self.error = error
        self.num_joints = n = error.num_joints
        self._time_step, self._resolution, self._chain = time_step, resolution, chain
        self.rates = np.broadcast_to(np.asarray(error.K_0 if K_0 is None else K_0, float), (n,))
        self.table = error.table(friction, time_step, self.rates, resolution, chain)
        learnt = not isinstance(error, ConstantTorqueError)
        self.poles = observer_poles(K_0 if learnt else None, n, time_step)

    def retuned(self, friction: FrictionLaw, K_0: ArrayLike | None) -> "TorqueErrorStage":
        """Returns the stage with friction and an observer that were changed while they run."""
        return TorqueErrorStage(
            self.error, friction, K_0, self._time_step, self._resolution, self._chain
        )

    def initial_state(self) -> Array:
        """Returns the (STAGE_ROWS, n) state before the first sample."""
        jacobian = np.full((JACOBIAN_ROWS, self.num_joints), np.nan)
        return np.vstack([self.error.initial_state(), jacobian])

    def run(
        self, state: Array, q: ArrayLike, v: ArrayLike, transmitted: ArrayLike, J: ArrayLike
    ) -> TorqueError:
        """Takes N samples.

        Args:
            state: (STAGE_ROWS, n), changed in place.
            q, v: (N, n) rad and rad/s.
            transmitted: (N, n) N m, tau_J - tau_f; each counts for the next sample.
            J: (N, 6, n) at E in axes of W.
        """
        q, v, load, J = contiguous(q, v, transmitted, J)
        N, n = q.shape
        error = TorqueError.empty(N, n)
        _run(self.table, self.poles, state, _Motion(q, v, load, J), error)
        return error


@kernel(forceinline=True)
def torque_error_tick(
    table: Array,
    poles: Array,
    state: Array,
    q: Array,
    v: Array,
    J: Array,
    error: TorqueError,
) -> None:
    """Single-sample kernel: takes a motion into `state` and writes the uncertainty at it.

    Args:
        table, poles: of TorqueErrorStage.
        state: (STAGE_ROWS, n), changed; `take_transmitted` adds the transmitted torque.
        q, v: (n,) rad and rad/s.
        J: (6, n).
        error: written; on entry its sd holds `posture_variance`.
    """
    rows, jacobian = state[:TORQUE_ERROR_ROWS], state[TORQUE_ERROR_ROWS:]
    torque_sd_tick(table, rows, q, v, error.sd, error.stiction, error.drift)
    see_jacobian(poles, jacobian, J, error.J_seen)
    take_jacobian(poles, jacobian, J, error.J_seen)
    for i in range(TORQUE_ERROR_ROWS):
        for j in range(q.shape[0]):
            error.rows[i, j] = rows[i, j]


@kernel(forceinline=True)
def torque_error_views(flat: Array, n: int) -> TorqueError:
    """The parts of (ERROR_ROWS n,) memory."""
    end = (3 + JACOBIAN_ROWS) * n
    return TorqueError(
        flat[:n],
        flat[n : 2 * n],
        flat[2 * n : 3 * n],
        view_2d(flat, 3 * n, JACOBIAN_ROWS, n),
        view_2d(flat, end, TORQUE_ERROR_ROWS, n),
    )


@kernel
def torque_error_sample(
    table: Array, poles: Array, state: Array, q: Array, v: Array, J: Array, flat: Array
) -> None:
    """`torque_error_tick` into (ERROR_ROWS n,) memory, with the posture's variance."""
    error = torque_error_views(flat, q.shape[0])
    posture_variance(table, q, error.sd)
    torque_error_tick(table, poles, state, q, v, J, error)


@kernel
def _run(table: Array, poles: Array, state: Array, motion: _Motion, error: TorqueError) -> None:
    """`torque_error_tick` for N samples; `error` is written."""
    q, v, transmitted, J = motion
    sd, stiction, drift, J_seen, rows = error
    no_friction = np.zeros(q.shape[1])
    for k in range(q.shape[0]):
        sample_error = TorqueError(sd[k], stiction[k], drift[k], J_seen[k], rows[k])
        posture_variance(table, q[k], sample_error.sd)
        torque_error_tick(table, poles, state, q[k], v[k], J[k], sample_error)
        take_transmitted(state, transmitted[k], no_friction)
