"""The reading of tau_ext that takes the observer's error of each sample into account.

    sds of the torque error, J as the observer saw it (`torque_error_stage`) -+
    tau_ext ------------------------------------------------------------------+-> wrench, covariance
                                                                      + lag, scale; valid

Not valid is what no wrench at E explains (`wrenchsight.models.observers.explained_torque`). A model
that learnt no torque error is read the same way, with an error of one covariance and no more said
of lag and scale.
"""

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.arrays import Array, Flags
from wrenchsight.models.estimation.torque_error_stage import TorqueError, torque_error_views
from wrenchsight.models.estimation.wrench import (
    WrenchEstimate,
    WrenchReconstruction,
    WrenchReconstructionConfig,
)
from wrenchsight.models.estimation.wrench_kernels import (
    WORK_ROWS,
    reconstruct_log,
    reconstruct_with,
)
from wrenchsight.models.identification.torque_error_model import (
    TAU_J_ROW,
    ConstantTorqueError,
    TorqueErrorModel,
)
from wrenchsight.models.kernel import kernel
from wrenchsight.models.observers.explained_torque import (
    BEYOND,
    explained_table,
    is_explained,
    unexplained,
    unexplained_log,
)
from wrenchsight.models.observers.fault_signature import (
    FAULT_NUMBERS,
    FAULT_ROWS,
    fault_table,
    initial_fault_state,
    is_believed,
)
from wrenchsight.models.observers.lag import LagModel, lag_tick, lag_update
from wrenchsight.models.views import borrowed, view_2d

READING = 44  # entries of a reading: wrench, covariance, condition number, valid
OBSERVED = 42  # of a wrench that an observer reads itself, and its covariance

READING_WORK_ROWS = WORK_ROWS + 2  # rows of max(n, 6) in which a sample is read
_SD, _LATENESS = WORK_ROWS, WORK_ROWS + 1

_DOUBT, _SIGNALS = 6, 7  # of the state: a slow wrench, s of doubt, then that of `fault_signature`
READING_NUMBERS, READING_ROWS = _SIGNALS + FAULT_NUMBERS, FAULT_ROWS
# of the state: so many numbers, then so many rows of n


class WrenchReading:
    """The constants of this module for one model, read by one observer.

    Args:
        error: of the model.
        config: method and prior, and the live prior that `valid` rests on.
        K_0: (n,) 1/s of the observer; None for one without such a lag.
        time_step: s.
        force_bandwidth_hz: see `wrenchsight.models.observers.lag`.
        usual_sd: see `WrenchReconstruction`.
        torques: (n, n) N m on the joints, a row for one ampere in each motor; None: joint by joint.

    Raises:
        ValueError: as `WrenchReconstruction` and `LagModel`.
    """

    def __init__(
        self,
        error: TorqueErrorModel,
        config: WrenchReconstructionConfig,
        K_0: ArrayLike | None,
        time_step: float,
        force_bandwidth_hz: float,
        usual_sd: ArrayLike | None = None,
        torques: ArrayLike | None = None,
    ) -> None:
        learnt = not isinstance(error, ConstantTorqueError)
        self.error, self._usual_sd, self._torques = error, usual_sd, torques
        self._time_step, self._force_bandwidth_hz = time_step, force_bandwidth_hz
        self.config = config
        self.num_joints = n = error.num_joints
        self.reconstruction = WrenchReconstruction(config, error.correlation, usual_sd)
        rates = K_0 if learnt else None
        self.lag = LagModel.of(rates, n, time_step, force_bandwidth_hz, error.scale).settings
        live = config.live_moment_sd, config.live_force_sd
        beyond = BEYOND if learnt else np.inf
        self.explained = explained_table(error.correlation, *live, error.scale, time_step, beyond)
        self.read_load = np.array([error.read_load])
        lines = np.eye(n) if torques is None else torques
        self.faults = fault_table(lines, rates, time_step, learnt)

    @property
    def tables(self) -> tuple[Array, Array, Array, Array, Array]:
        """The constants of `read_wrench`."""
        return self.read_load, self.lag, self.explained, self.faults, self.reconstruction.table

    @classmethod
    def constant(
        cls, config: WrenchReconstructionConfig, torque_covariance: ArrayLike
    ) -> "WrenchReading":
        """Returns the reading of errors of one covariance (n, n) N^2 m^2, without a lag.

        Raises:
            ValueError: as `WrenchReconstruction`.
        """
        Sigma = WrenchReconstruction(config, torque_covariance).torque_covariance
        return cls(ConstantTorqueError.of(Sigma), config, None, 1.0, 0.0)

    def retuned(
        self,
        config: WrenchReconstructionConfig,
        K_0: ArrayLike | None,
        torque_covariance: Array | None = None,
    ) -> "WrenchReading":
        """Returns the reading with settings and an observer that were changed while they run.

        Args:
            config: as the constructor's.
            K_0: as the constructor's.
            torque_covariance: (n, n) N^2 m^2, of a constant error; None: as it was.
        """
        error = self.error
        if isinstance(error, ConstantTorqueError) and torque_covariance is not None:
            same = np.array_equal(torque_covariance, error.covariance)
            error = error if same else ConstantTorqueError.of(torque_covariance)
        return WrenchReading(
            *(error, config, K_0, self._time_step, self._force_bandwidth_hz),
            *(self._usual_sd, self._torques),
        )

    def initial_state(self) -> Array:
        """Returns the state before the first sample."""
        return np.concatenate([np.full(_SIGNALS, np.nan), initial_fault_state(self.num_joints)])

    def run(
        self,
        state: Array,
        error: TorqueError,
        J: Array,
        tau_ext: Array,
        counts: Flags,
        lost: Flags,
        observed: Array,
        conditions: bool = True,
    ) -> WrenchEstimate:
        """Reads N samples.

        Args:
            state: of `initial_state`, changed in place.
            error: of N samples.
            J: (N, 6, n) at E in axes of W.
            tau_ext: (N, n) N m.
            counts: (N,) whether tau_ext is of its sample, so that the reading may be valid.
            lost: (N,) whether the sample is one that cannot be.
            observed: (N, OBSERVED) wrench and covariance that the observer reads itself, which then
                take the place of the reading's; (N, 0): it does not.
            conditions: whether condition numbers are wanted; NaN where not.
        """
        N = len(tau_ext)
        sd = error.sd
        if self.error.read_load > 0.0:
            sd = np.sqrt(sd**2 + (self.error.read_load * np.nan_to_num(tau_ext)) ** 2)
        wrench, covariance, quality = np.empty((N, 6)), np.empty((N, 6, 6)), np.empty((N, 2))
        reconstruct_log(
            *(self.reconstruction.table, J if conditions else J[:0], error.J_seen),
            *(tau_ext, sd, error.stiction, wrench, covariance, quality),
        )
        if observed.shape[1] > 0:
            wrench, covariance = observed[:, :6].copy(), observed[:, 6:].reshape(N, 6, 6).copy()
        D = unexplained_log(self.explained, error.J_seen, tau_ext, sd)
        _judge_log(
            *((self.lag, self.explained, self.faults), state, D, tau_ext, sd),
            *(error.rows, np.asarray(counts, bool), np.asarray(lost, bool)),
            *(wrench, covariance, quality),
        )
        return WrenchEstimate(wrench, covariance, quality[:, 0], quality[:, 1] == 1.0)


@kernel(forceinline=True)
def judge_reading(
    tables: tuple[Array, Array, Array],
    state: Array,
    D: float,
    tau_ext: Array,
    sd: Array,
    tau_J: Array,
    counts: bool,
    lost: bool,
    wrench: Array,
    covariance: Array,
    quality: Array,
    lateness: Array,
) -> None:
    """Single-sample kernel: adds lag and scale to a reading, and settles whether it is valid.

    Args:
        tables: lag, explained and faults of WrenchReading.
        state: of `initial_state`, changed.
        D: of `unexplained`.
        tau_ext, sd: (n,) N m.
        tau_J: (n,) N m, of the sample before.
        counts: whether tau_ext is of this sample.
        lost: whether the sample is one that cannot be.
        wrench: (6,).
        covariance: (6, 6), changed.
        quality: (2,) condition number and valid, the latter changed.
        lateness: (6,), overwritten.
    """
    lag, explained, faults = tables
    at_E, state[_DOUBT] = is_explained(explained, state[_DOUBT], D)
    sound = is_believed(faults, state[_SIGNALS:], tau_ext, sd, tau_J, counts, lost)
    valid = counts and quality[1] == 1.0 and at_E and sound
    quality[1] = 1.0 if valid else 0.0
    lag_tick(lag, state[:6], wrench, covariance, lateness)
    lag_update(lag, state[:6], wrench, valid)


@kernel(forceinline=True)
def read_wrench(
    tables: tuple[Array, Array, Array, Array, Array],
    state: Array,
    error: TorqueError,
    J: Array,
    tau_ext: Array,
    counts: bool,
    lost: bool,
    observed: Array,
    reading: Array,
    work: Array,
) -> None:
    """Single-sample kernel of `WrenchReading.run`.

    Args:
        tables: of WrenchReading.
        state: of `initial_state`, changed.
        error: of the sample.
        J: (6, n).
        tau_ext: (n,).
        counts: whether tau_ext is of this sample, so that the reading may be valid.
        lost: whether the sample is one that cannot be.
        observed: (OBSERVED,) as `WrenchReading.run`, or (0,).
        reading: (READING,), written.
        work: (READING_WORK_ROWS, max(n, 6)), overwritten.
    """
    read_load, lag, explained, faults, wrench = tables
    n = J.shape[1]
    sd, covariance, quality = work[_SD, :n], view_2d(reading, 6, 6, 6), reading[42:READING]
    for j in range(n):
        sd[j] = error.sd[j]
        if read_load[0] > 0.0 and np.isfinite(tau_ext[j]):
            sd[j] = np.sqrt(sd[j] ** 2 + (read_load[0] * tau_ext[j]) ** 2)
    reconstruct_with(
        *(wrench, J, error.J_seen, tau_ext, sd, error.stiction),
        *(reading[:6], covariance, quality, work[:WORK_ROWS]),
    )
    for k in range(observed.shape[0]):
        reading[k] = observed[k]
    D = unexplained(explained, error.J_seen, tau_ext, sd)
    judge_reading(
        *((lag, explained, faults), state, D, tau_ext, sd, error.rows[TAU_J_ROW]),
        *(counts, lost, reading[:6], covariance, quality, work[_LATENESS]),
    )


@kernel
def read_sample(
    tables: tuple[Array, Array, Array, Array, Array],
    state: Array,
    error: Array,
    J: Array,
    tau_ext: Array,
    counts: bool,
    lost: bool,
    observed: Array,
    reading: Array,
    work: Array,
) -> None:
    """`read_wrench` with the torque error in (ERROR_ROWS n,) memory."""
    views = torque_error_views(error, J.shape[1])
    read_wrench(tables, state, views, J, tau_ext, counts, lost, observed, reading, work)


@kernel
def _judge_log(
    tables: tuple[Array, Array, Array],
    state: Array,
    D: Array,
    tau_ext: Array,
    sd: Array,
    rows: Array,
    counts: Flags,
    lost: Flags,
    wrench: Array,
    covariance: Array,
    quality: Array,
) -> None:
    lateness = np.empty(6)
    lag, explained, faults = tables
    own = borrowed(lag), borrowed(explained), borrowed(faults)
    state, tau_ext, sd = borrowed(state), borrowed(tau_ext), borrowed(sd)
    rows, wrench, covariance = borrowed(rows), borrowed(wrench), borrowed(covariance)
    quality = borrowed(quality)
    for k in range(tau_ext.shape[0]):
        judge_reading(
            *(own, state, D[k], tau_ext[k], sd[k], rows[k, TAU_J_ROW]),
            *(counts[k], lost[k], wrench[k], covariance[k], quality[k], lateness),
        )
