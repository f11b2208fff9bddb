"""The reading of tau_ext that takes the observer's error of each sample into account.

    sds of the torque error, J as the observer saw it (`torque_error_stage`) -+
    tau_ext ------------------------------------------------------------------+-> wrench, covariance
                                                                      + lag, scale; valid

Not valid is what no wrench at E explains (`wrenchsight.models.observers.explained_torque`). A model
that learnt no torque error is read the same way, with an error of one covariance and no more said
of lag and scale.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.estimation.torque_error_stage import TorqueError, torque_error_views
from wrenchsight.models.estimation.wrench import (
    WrenchEstimate,
    WrenchReconstruction,
    WrenchReconstructionConfig,
)
from wrenchsight.models.estimation.wrench_kernels import (
    WORK_ROWS,
    TorqueSample,
    WrenchOut,
    reconstruct_log,
    reconstruct_with,
)
from wrenchsight.models.identification.torque_error_model import (
    TAU_J_ROW,
    ConstantTorqueError,
    TorqueErrorModel,
)
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.numerics.views import borrowed, view_2d
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
from wrenchsight.models.observers.lag import lag_settings, lag_tick, lag_update

Tables = tuple[Array, Array, Array, Array, Array]  # of WrenchReading

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
        ValueError: as `WrenchReconstruction` and `lag_settings`.
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
        self.lag = lag_settings(rates, time_step, force_bandwidth_hz, error.scale)
        live = config.live_moment_sd, config.live_force_sd
        beyond = BEYOND if learnt else np.inf
        self.explained = explained_table(error.correlation, *live, error.scale, time_step, beyond)
        self.read_load = np.array([error.read_load])
        lines = np.eye(n) if torques is None else torques
        self.faults = fault_table(lines, rates, time_step, learnt)

    @property
    def tables(self) -> Tables:
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

    @property
    def parameters(self) -> dict[str, Array]:
        """What may be tuned while it runs, by name: the numeric parameters of its block.

        prior_sd (2,) N and N m, inf where nothing is known; of a constant error alone
        torque_covariance (n, n) N^2 m^2; damping (1,); truncation (1,).
        """
        config, error = self.config, self.error
        prior = config.prior_force_sd, config.prior_moment_sd
        values = {"prior_sd": np.array([np.inf if sd is None else sd for sd in prior])}
        if isinstance(error, ConstantTorqueError):
            values["torque_covariance"] = error.covariance
        own = {"damping": np.array([config.damping]), "truncation": np.array([config.truncation])}
        return values | own

    def with_parameters(self, values: dict[str, Array], K_0: ArrayLike | None) -> "WrenchReading":
        """Returns the reading with other `parameters`, behind an observer with this K_0."""
        force_sd, moment_sd = values["prior_sd"].tolist()
        config = replace(
            self.config,
            prior_force_sd=force_sd,
            prior_moment_sd=moment_sd,
            damping=values["damping"].item(),
            truncation=values["truncation"].item(),
        )
        error, covariance = self.error, values.get("torque_covariance")
        if isinstance(error, ConstantTorqueError) and covariance is not None:
            same = np.array_equal(covariance, error.covariance)
            error = error if same else ConstantTorqueError.of(covariance)
        return WrenchReading(
            error,
            config,
            K_0,
            self._time_step,
            self._force_bandwidth_hz,
            self._usual_sd,
            self._torques,
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
        own = TorqueSample(error.J_seen, tau_ext, sd, error.stiction)
        out = WrenchOut(np.empty((N, 6)), np.empty((N, 6, 6)), np.empty((N, 2)))
        reconstruct_log(self.reconstruction.table, J if conditions else J[:0], own, out)
        if observed.shape[1] > 0:
            out.wrench[:], out.covariance[:] = observed[:, :6], observed[:, 6:].reshape(N, 6, 6)
        D = unexplained_log(self.explained, error.J_seen, tau_ext, sd)
        marks = np.asarray(counts, bool), np.asarray(lost, bool)
        tables = self.lag, self.explained, self.faults
        _judge_log(tables, state, D, own, error.rows, *marks, out)
        return WrenchEstimate(
            out.wrench, out.covariance, out.quality[:, 0], out.quality[:, 1] == 1.0
        )


@kernel(forceinline=True)
def _judge_reading(
    tables: tuple[Array, Array, Array],
    state: Array,
    D: float,
    own: TorqueSample,
    tau_J: Array,
    counts: bool,
    lost: bool,
    out: WrenchOut,
    lateness: Array,
) -> None:
    """Single-sample kernel: adds lag and scale to a reading, and settles whether it is valid.

    Args:
        tables: lag, explained and faults of WrenchReading.
        state: of `initial_state`, changed.
        D: of `unexplained`.
        own: the sample.
        tau_J: (n,) N m, of the sample before.
        counts, lost: as `WrenchReading.run`, of this sample.
        out: changed.
        lateness: (6,), overwritten.
    """
    lag, explained, faults = tables
    at_E, state[_DOUBT] = is_explained(explained, state[_DOUBT], D)
    sound = is_believed(faults, state[_SIGNALS:], own.tau_ext, own.sd, tau_J, counts, lost)
    valid = counts and out.quality[1] == 1.0 and at_E and sound
    out.quality[1] = 1.0 if valid else 0.0
    lag_tick(lag, state[:6], out.wrench, out.covariance, lateness)
    lag_update(lag, state[:6], out.wrench, valid)


@kernel(forceinline=True)
def read_wrench(
    tables: Tables,
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
        error, J, tau_ext, counts, lost: of the sample.
        observed: (OBSERVED,) as `WrenchReading.run`, or (0,).
        reading: (READING,), written.
        work: (READING_WORK_ROWS, max(n, 6)), overwritten.
    """
    read_load, lag, explained, faults, wrench = tables
    n = J.shape[1]
    sd = work[_SD, :n]
    for j in range(n):
        sd[j] = error.sd[j]
        if read_load[0] > 0.0 and np.isfinite(tau_ext[j]):
            sd[j] = np.sqrt(sd[j] ** 2 + (read_load[0] * tau_ext[j]) ** 2)
    own = TorqueSample(error.J_seen, tau_ext, sd, error.stiction)
    out = WrenchOut(reading[:6], view_2d(reading, 6, 6, 6), reading[42:READING])
    reconstruct_with(wrench, J, own, out, work[:WORK_ROWS])
    for k in range(observed.shape[0]):
        reading[k] = observed[k]
    D, tau_J = unexplained(explained, error.J_seen, tau_ext, sd), error.rows[TAU_J_ROW]
    own_tables = lag, explained, faults
    _judge_reading(own_tables, state, D, own, tau_J, counts, lost, out, work[_LATENESS])


@kernel
def read_sample(
    tables: Tables,
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
    own: TorqueSample,
    rows: Array,
    counts: Flags,
    lost: Flags,
    out: WrenchOut,
) -> None:
    lateness = np.empty(6)
    lag, explained, faults = tables
    known = borrowed(lag), borrowed(explained), borrowed(faults)
    state, rows, J = borrowed(state), borrowed(rows), borrowed(own.J)
    tau_ext, sd, stiction = borrowed(own.tau_ext), borrowed(own.sd), borrowed(own.stiction)
    wrench, covariance = borrowed(out.wrench), borrowed(out.covariance)
    quality = borrowed(out.quality)
    for k in range(tau_ext.shape[0]):
        sample = TorqueSample(J[k], tau_ext[k], sd[k], stiction[k])
        one = WrenchOut(wrench[k], covariance[k], quality[k])
        tau_J = rows[k, TAU_J_ROW]
        _judge_reading(known, state, D[k], sample, tau_J, counts[k], lost[k], one, lateness)
