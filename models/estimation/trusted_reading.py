"""The reading of tau_ext that takes the observer's error of each sample into account.

    torque error's sds (`wrenchsight.models.identification.torque_error_model`) -+
    J as the observer saw it (`models.observers.lag`) --------------+-> wrench, covariance, valid
    tau_ext ---------------------------------------------------------+   + lag and scale

Not valid is what no wrench at E explains (`wrenchsight.models.observers.explained_torque`).
For models that have a torque error; others read with one covariance for rest and motion alike.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.arrays import Array, Flags
from wrenchsight.models.estimation.wrench import WrenchReconstruction, WrenchReconstructionConfig
from wrenchsight.models.estimation.wrench_kernels import (
    WORK_ROWS,
    reconstruct_log,
    reconstruct_with,
)
from wrenchsight.models.friction.friction_law import FrictionLaw
from wrenchsight.models.identification.torque_error_model import (
    TORQUE_ERROR_ROWS,
    TRANSMITTED_ROW,
    TorqueErrorModel,
    add_read_load,
    add_read_load_log,
    torque_sd_log,
    torque_sd_tick,
)
from wrenchsight.models.kernel import kernel
from wrenchsight.models.observers.explained_torque import (
    explained_log,
    explained_table,
    is_explained,
    unexplained,
)
from wrenchsight.models.observers.lag import (
    JACOBIAN_ROWS,
    LAG_SETTINGS,
    LagModel,
    jacobian_seen_log,
    lag_log,
    lag_tick,
    lag_update,
    see_jacobian,
    take_jacobian,
)

READING = 44  # entries of a reading: wrench, covariance, condition number, valid

# Rows of the memory that a sample is read in, after the reconstruction's.
_SEEN = WORK_ROWS
_SD, _STICTION, _LATENESS, _SLOW = range(_SEEN + 6, _SEEN + 10)
OBSERVED = _SEEN + 10  # the observer's own wrench, and its covariance in six rows
TRUSTED_WORK_ROWS = OBSERVED + 8  # and one for the caller

_DOUBT, _SLOW_SIZE = 6, 7  # entry of s of doubt, after the slow wrench


class TrustedReading:
    """Reads samples one after another; its memory is `state_rows` rows of the estimator's state.

    Args:
        error: of the model.
        friction: of the model, as sampled.
        config: method and prior, and the live prior that `valid` rests on.
        K_0: (n,) 1/s of the observer; None for one without such a lag.
        time_step: s.
        resolution: (n,) rad of the encoders; None: that of the logs that were fitted.
        force_bandwidth_hz: see `wrenchsight.models.observers.lag`.
        usual_sd: see `WrenchReconstruction`.

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
        usual_sd: ArrayLike | None = None,
    ) -> None:
        self.error = error
        self.num_joints = n = error.num_joints
        self.reconstruction = WrenchReconstruction(config, error.correlation, usual_sd)
        rates = error.K_0 if K_0 is None else K_0
        self._table = error.table(friction, time_step, rates, resolution)
        self._lag = LagModel.of(K_0, n, time_step, force_bandwidth_hz, error.scale)
        self._slow_rows = -(-_SLOW_SIZE // n)
        live = config.live_moment_sd, config.live_force_sd
        self._explained = explained_table(error.correlation, *live, error.scale, time_step)
        self.tables = (  # of `trusted_reading_tick`
            self._table,
            np.concatenate([self._lag.poles, self._lag.settings, self._explained]),
            self.reconstruction.table,
        )
        self._nothing = np.full(n, np.nan)
        self._work = np.zeros((TRUSTED_WORK_ROWS, max(n, 6)))

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

    def tick(
        self,
        state: Array,
        q: Array,
        v: Array,
        J: Array,
        tau_ext: Array,
        counts: bool,
        reading: Array,
        observed: Array | None = None,
    ) -> None:
        """Reads one sample; what it transmitted is left for `transmit`.

        Args:
            state: (state_rows, n), changed in place.
            q, v, J, tau_ext: (n,), (6, n) for J, as `run`.
            counts: whether tau_ext is of this sample, so that the reading may be valid.
            reading: (READING,), written: wrench, covariance, condition number, valid.
            observed: (42,) as `run`.
        """
        if observed is not None:
            self._work[OBSERVED, :6] = observed[:6]
            self._work[OBSERVED + 1 : OBSERVED + 7, :6] = observed[6:].reshape(6, 6)
        J = np.require(J, float, ("C", "W"))
        trusted_reading_tick(
            *(*self.tables, state, q, v, self._nothing, J, tau_ext, counts),
            *(observed is not None, reading, self._work),
        )

    def transmit(self, state: Array, transmitted: Array) -> None:
        """Takes (n,) N m that the gears transmitted, for the sample after, into `state`."""
        known = np.isfinite(transmitted)
        state[TRANSMITTED_ROW, known] = transmitted[known]

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
        conditions: bool = True,
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
            conditions: whether condition numbers are wanted; NaN where not.

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
        add_read_load_log(self._table, tau_ext, sd)
        seen = J.copy()
        jacobian_seen_log(self._lag.poles, seen_state, seen)
        wrench, covariance, quality = np.empty((N, 6)), np.empty((N, 6, 6)), np.empty((N, 2))
        reconstruct_log(
            self.reconstruction.table,
            *(J if conditions else J[:0], seen, tau_ext, sd, stiction),
            *(wrench, covariance, quality),
        )
        if observed is not None and observed.shape[1] > 0:
            wrench, covariance = observed[:, :6].copy(), observed[:, 6:].reshape(N, 6, 6).copy()
        explained = np.empty(N, np.bool_)
        explained_log(self._explained, slow[_DOUBT:], seen, tau_ext, sd, explained)
        valid = (quality[:, 1] == 1.0) & fresh & explained
        lag_log(self._lag.settings, slow, wrench, valid, covariance)
        return wrench, covariance, quality[:, 0], valid, sd


@kernel
def trusted_reading_tick(
    error: Array,
    lag: Array,
    wrench: Array,
    state: Array,
    q: Array,
    v: Array,
    transmitted: Array,
    J: Array,
    tau_ext: Array,
    counts: bool,
    observes: bool,
    reading: Array,
    work: Array,
) -> None:
    """Single-sample kernel: one sample of `TrustedReading.run`.

    Args:
        error, lag, wrench: `TrustedReading.tables`: of the torque error, of the lag (its poles,
            then its settings) with that of `explained_torque` behind, of the reconstruction.
        state: (state_rows, n), changed.
        q, v, transmitted: (n,); what is not finite of `transmitted` leaves that of the state.
        J: (6, n).
        tau_ext: (n,).
        counts: whether tau_ext is of this sample, so that the reading may be valid.
        observes: whether the observer reads the wrench itself; it then stands in `work`, at
            OBSERVED.
        reading: (READING,), written.
        work: (TRUSTED_WORK_ROWS, max(n, 6)), overwritten.
    """
    n = J.shape[1]
    poles, settings, explained = lag[:n], lag[n : n + LAG_SETTINGS], lag[n + LAG_SETTINGS :]
    sd, stiction, slow = work[_SD, :n], work[_STICTION, :n], work[_SLOW, :6]
    seen = work[_SEEN : _SEEN + 6, :n]
    covariance, quality = reading[6:42].reshape(6, 6), reading[42:44]
    jacobian = state[TORQUE_ERROR_ROWS : TORQUE_ERROR_ROWS + JACOBIAN_ROWS]
    first = TORQUE_ERROR_ROWS + JACOBIAN_ROWS
    torque_sd_tick(error, state[:TORQUE_ERROR_ROWS], q, v, transmitted, sd, stiction)
    add_read_load(error, tau_ext, sd)
    see_jacobian(poles, jacobian, J, seen)
    take_jacobian(poles, jacobian, J, seen)
    reconstruct_with(
        wrench, J, seen, tau_ext, sd, stiction, reading[:6], covariance, quality, work[:WORK_ROWS]
    )
    if observes:
        for i in range(6):
            reading[i] = work[OBSERVED, i]
            for j in range(6):
                covariance[i, j] = work[OBSERVED + 1 + i, j]
    D = unexplained(explained, seen, tau_ext, sd)
    at_E, doubt = is_explained(explained, state[first + _DOUBT // n, _DOUBT % n], D)
    state[first + _DOUBT // n, _DOUBT % n] = doubt
    valid = counts and quality[1] == 1.0 and at_E
    quality[1] = 1.0 if valid else 0.0
    for k in range(6):
        slow[k] = state[first + k // n, k % n]
    lag_tick(settings, slow, reading[:6], covariance, work[_LATENESS])
    lag_update(settings, slow, reading[:6], valid)
    for k in range(6):
        state[first + k // n, k % n] = slow[k]
