"""Uncertainty of the observer's torque at each sample, computed once for all its users.

    q, v, torque that the gears transmitted -> sds of tau_ext  (`identification.torque_error_model`)
    J                                       -> J as the observer saw it  (`observers.lag`)

Users are the reading, the contact detector and the Kalman observer.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.friction.friction_law import FrictionLaw
from wrenchsight.models.friction.sliding_friction import SlidingLaw
from wrenchsight.models.identification.torque_error_model import (
    REST_ROW,
    TORQUE_ERROR_ROWS,
    ConstantTorqueError,
    TorqueErrorModel,
    has_spread,
    may_rest_unseen,
    posture_variance_rows,
    rest_rows,
    torque_sd_rows,
)
from wrenchsight.models.numerics.arrays import Array, contiguous
from wrenchsight.models.numerics.row_blocks import in_row_blocks
from wrenchsight.models.observers.lag import JACOBIAN_ROWS, observer_poles, see_jacobian_rows
from wrenchsight.models.rigid_body.serial_chain import SerialChain

STAGE_ROWS = TORQUE_ERROR_ROWS + JACOBIAN_ROWS  # of the state, (STAGE_ROWS, n)
ERROR_ROWS = 3 + JACOBIAN_ROWS + TORQUE_ERROR_ROWS  # of a TorqueError of one sample, flat
_ERROR_STATE = 3 + JACOBIAN_ROWS  # first of its rows of the torque error's state
_BLOCK_ROWS = 4096  # rows a thread takes at a time


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

    @classmethod
    def of_flat(cls, flat: Array, n: int) -> "TorqueError":
        """The one sample, N = 1, of (ERROR_ROWS n,) memory, as of a port; views of it."""
        rows = flat.reshape(1, ERROR_ROWS, n)
        sd, stiction, drift = rows[:, 0], rows[:, 1], rows[:, 2]
        return cls(sd, stiction, drift, rows[:, 3:_ERROR_STATE], rows[:, _ERROR_STATE:])

    @property
    def flat(self) -> Array:
        """(ERROR_ROWS n,) of the only sample of this, as `of_flat` takes it."""
        rows = (self.sd, self.stiction, self.drift, self.J_seen[0], self.rows[0])
        return np.concatenate(rows).ravel()

    def part(self, rows: slice) -> "TorqueError":
        """Some of N samples."""
        return TorqueError(
            self.sd[rows], self.stiction[rows], self.drift[rows], self.J_seen[rows], self.rows[rows]
        )


def resting_shares(flat: Array, n: int) -> Array:
    """(1, n) by which the joints rest, of a `TorqueError.flat`; a view of it."""
    return flat.reshape(1, ERROR_ROWS, n)[:, _ERROR_STATE + REST_ROW]


class TorqueErrorStage:
    """The torque error of one model behind one observer.

    Args:
        error: torque error of the model.
        friction: law of the model, or its numbers.
        K_0: (n,) 1/s of the observer; None for one without such a lag.
        time_step: s.
        resolution: (n,) rad of the encoders; None: that of the logs that were fitted.
        chain: of the robot; None: the model's gravity torque is exact.

    Attributes:
        table: of `torque_sd_rows`.
        poles: (n,) of the observer, per tick. Negative for an observer without lag and for a model
            without a learnt error; then J is that of the sample itself.
        rates: (n,) 1/s, to which the sds belong.
        may_rest_unseen: whether a joint may rest that rested in no log of the model.
    """

    def __init__(
        self,
        error: TorqueErrorModel,
        friction: FrictionLaw | SlidingLaw,
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
        self.may_rest_unseen = may_rest_unseen(self.table)
        self._has_spread = has_spread(self.table)
        learnt = not isinstance(error, ConstantTorqueError)
        self.poles = observer_poles(K_0 if learnt else None, n, time_step)

    def retuned(
        self, friction: FrictionLaw | SlidingLaw, K_0: ArrayLike | None
    ) -> "TorqueErrorStage":
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
        error = TorqueError.empty(len(q), self.num_joints)
        self.follow(state, q, v, error)
        self.sds(state, q, v, load, np.zeros_like(load), J, error)
        return error

    def follow(self, state: Array, q: Array, v: Array, error: TorqueError) -> None:
        """Follows the motion of N samples: the first half of `run`, before friction is known.

        Args:
            state: (STAGE_ROWS, n), the rows of the motion are changed.
            q, v: (N, n) rad and rad/s, contiguous.
            error: of N samples, whose `rows` are written in part, for `sds`. Their REST_ROW is the
                share by which each joint rests.
        """
        rest_rows(self.table, state, q, v, error.rows)

    def sds(
        self,
        state: Array,
        q: Array,
        v: Array,
        tau_J: Array,
        tau_f: Array,
        J: Array,
        error: TorqueError,
    ) -> None:
        """States the uncertainty of N samples: the second half of `run`.

        Args:
            state: (STAGE_ROWS, n), the other rows are changed.
            q, v, tau_J, tau_f: (N, n) rad, rad/s, N m; the torques count for the sample after.
            J: (N, 6, n) at E in axes of W.
            error: as `follow` has left it; completed.
        """
        error.sd.fill(0.0)  # variance of the posture's gravity, where it has one
        if self._has_spread:
            in_row_blocks(
                lambda block: posture_variance_rows(self.table, q[block], error.sd[block]),
                len(q),
                _BLOCK_ROWS,
            )
        torque_sd_rows(
            self.table, state, v, tau_J, tau_f, error.rows, error.sd, error.stiction, error.drift
        )
        see_jacobian_rows(self.poles, state[TORQUE_ERROR_ROWS:], J, error.J_seen)
