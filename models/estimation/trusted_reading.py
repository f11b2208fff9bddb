"""The reading of tau_ext that knows what the observer errs by, sample by sample.

    torque error's sds (`models.identification.torque_error_model`) -+
    J as the observer saw it (`models.observers.lag`) --------------+-> wrench, covariance, valid
    tau_ext ---------------------------------------------------------+   + lag and scale

For models that have a torque error; others read with one covariance for rest and motion alike.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from models.estimation.wrench import (
    WrenchReconstruction,
    WrenchReconstructionConfig,
    reconstruct_log,
)
from models.friction.friction_law import FrictionLaw
from models.identification.torque_error_model import (
    TORQUE_ERROR_ROWS,
    TorqueErrorModel,
    torque_sd_log,
)
from models.observers.lag import JACOBIAN_ROWS, LagModel, jacobian_seen_log, lag_log

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


class TrustedReading:
    """Reads samples one after another; its memory is `state_rows` rows of the estimator's state.

    Args:
        error: of the model.
        friction: of the model, as sampled.
        config: method and prior, and the live prior that `valid` rests on.
        K_0: (n,) 1/s of the observer; None for one without such a lag.
        time_step: s.
        resolution: (n,) rad of the encoders; None: that of the logs that were fitted.
        force_bandwidth_hz: see `models.observers.lag`.

    Raises:
        ValueError: as `WrenchReconstruction` and `LagModel`.
    """

    def __init__(
        self,
        error: TorqueErrorModel,
        friction: FrictionLaw,
        config: WrenchReconstructionConfig,
        K_0: ArrayLike | None,
        time_step: float,
        resolution: ArrayLike | None,
        force_bandwidth_hz: float,
    ) -> None:
        self.error = error
        self.num_joints = n = error.num_joints
        self.reconstruction = WrenchReconstruction(config, error.correlation)
        rates = error.K_0 if K_0 is None else K_0
        self._table = error.table(friction, time_step, rates, resolution)
        self._lag = LagModel.of(K_0, n, time_step, force_bandwidth_hz, error.scale)
        self._slow_rows = -(-6 // n)

    @property
    def state_rows(self) -> int:
        """Rows of the state."""
        return TORQUE_ERROR_ROWS + JACOBIAN_ROWS + self._slow_rows

    def initial_state(self) -> Array:
        """Returns the (state_rows, n) state before the first sample."""
        n = self.num_joints
        return np.vstack(
            [
                self.error.initial_state(),
                np.full((JACOBIAN_ROWS, n), np.nan),
                np.full((self._slow_rows, n), np.nan),
            ]
        )

    def run(
        self,
        state: Array,
        q: Array,
        v: Array,
        transmitted: Array,
        J: Array,
        tau_ext: Array,
        fresh: Flags,
        observed: Array | None = None,
    ) -> tuple[Array, Array, Array, Flags, Array]:
        """Reads N samples.

        Args:
            state: (state_rows, n), changed in place.
            q, v, transmitted: (N, n) as `TorqueErrorModel.along`.
            J: (N, 6, n) at E in axes of W.
            tau_ext: (N, n) N m.
            fresh: (N,) which of them count.
            observed: (N, 42) wrench and covariance that the observer reads itself, which then take
                the place of the reading's; (N, 0) or None: it does not.

        Returns:
            Wrench (N, 6), covariance (N, 6, 6), condition number (N,), valid (N,), and the torque
            error's sds (N, n) in N m.
        """
        N = len(q)
        own: Any = state[:TORQUE_ERROR_ROWS]
        seen_state = state[TORQUE_ERROR_ROWS : TORQUE_ERROR_ROWS + JACOBIAN_ROWS]
        slow = state[TORQUE_ERROR_ROWS + JACOBIAN_ROWS :].reshape(-1)
        sd, stiction = np.empty_like(tau_ext), np.empty_like(tau_ext)
        torque_sd_log(self._table, own, q, v, transmitted, sd, stiction)
        seen = J.copy()
        jacobian_seen_log(self._lag.poles, seen_state, seen)
        wrench, covariance, quality = np.empty((N, 6)), np.empty((N, 6, 6)), np.empty((N, 2))
        reconstruct_log(
            self.reconstruction.table,
            *(J, seen, tau_ext, sd, stiction, wrench, covariance, quality),
        )
        if observed is not None and observed.shape[1] > 0:
            wrench, covariance = observed[:, :6].copy(), observed[:, 6:].reshape(N, 6, 6).copy()
        valid = (quality[:, 1] == 1.0) & fresh
        lag_log(self._lag.settings, slow, wrench, valid, covariance)
        return wrench, covariance, quality[:, 0], valid, sd
