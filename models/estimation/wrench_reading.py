"""Reads the wrench from tau_ext, with the observer's uncertainty at each sample.

    sds of the torque error, J as the observer saw it (`torque_error_stage`) -+
    tau_ext ------------------------------------------------------------------+-> wrench, covariance
                                                                      + lag, scale; valid

For a model without a learnt torque error the error has one covariance, and the band holds neither
lag nor scale.

The reasons why a reading is not valid are those of `models.estimation.invalid`.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.estimation.invalid import (
    LAGGING,
    Findings,
    InvalidCodes,
    invalid_reasons,
)
from wrenchsight.models.estimation.torque_error_stage import TorqueError, torque_error_views
from wrenchsight.models.estimation.wrench import (
    WrenchEstimate,
    WrenchReconstruction,
    WrenchReconstructionConfig,
)
from wrenchsight.models.estimation.wrench_kernels import (
    CONDITION,
    FORCE_SD,
    HAS_FULL_RANK,
    NUM_QUALITY,
    STICTION_FORCE,
    WORK_ROWS,
    TorqueSample,
    WrenchOut,
    quality_limits,
    reconstruct_log,
    reconstruct_with,
)
from wrenchsight.models.identification.torque_error_model import (
    TAU_J_ROW,
    ConstantTorqueError,
    TorqueErrorModel,
)
from wrenchsight.models.numerics.arrays import Array
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
from wrenchsight.models.observers.lag import (
    LAG_ROWS,
    initial_lag_state,
    lag_settings,
    lag_tick,
    lag_update,
)
from wrenchsight.models.observers.sample_check import BEYOND as BEYOND_LIMITS

READING = 45  # entries of a reading: wrench, covariance, condition number, valid, invalid
OBSERVED = 42  # entries of a wrench that an observer estimates itself, and of its covariance

READING_WORK_ROWS = WORK_ROWS + 3  # rows of max(n, 6), scratch of a sample
_SD, _LATENESS, _QUALITY = range(WORK_ROWS, READING_WORK_ROWS)
_CONDITION_AT, _VALID_AT, _INVALID_AT = range(42, READING)

# The state: that of the lag (LAG_ROWS, 6), the time s without an explanation, the state of
# `fault_signature`.
_UNEXPLAINED_TIME = 6 * LAG_ROWS
_SIGNALS = _UNEXPLAINED_TIME + 1
# Its size: so many numbers, then so many rows of n.
READING_NUMBERS, READING_ROWS = _SIGNALS + FAULT_NUMBERS, FAULT_ROWS


class ReadingTables(NamedTuple):
    """Constants of `read_wrench`.

    Attributes:
        read_load: (1,) share of |tau_ext| that adds to its sd.
        lag: of `lag_settings`.
        explained: of `explained_table`.
        faults: of `fault_table`.
        wrench: `WrenchReconstruction.table`.
    """

    read_load: Array
    lag: Array
    explained: Array
    faults: Array
    wrench: Array


class ReadingSample(NamedTuple):
    """Input of the reading at one sample; at N samples with a first axis.

    Attributes:
        J: (6, n) at E in axes of W.
        tau_ext: (n,) N m.
        is_fresh: bool; whether tau_ext belongs to its sample, neither held nor settling.
        is_missing: bool; whether q or v are not finite.
        is_corrected: bool; whether the correction of an air pass holds, or there is none.
        fault: int; codes of `models.observers.sample_check`.
        observed: (OBSERVED,) wrench and covariance that the observer estimates itself; they take
            the place of the reading's. (0,) of an observer that does not.
    """

    J: Array
    tau_ext: Array
    is_fresh: Any
    is_missing: Any
    is_corrected: Any
    fault: Any
    observed: Array


class _Judged(NamedTuple):
    """Input of a reading's validity at one sample; at N samples with a first axis.

    Attributes:
        D: of `unexplained`.
        torque: tau_ext and its uncertainty.
        tau_J: (n,) N m, of the previous sample.
        is_fresh, is_missing, is_corrected, fault: as ReadingSample.
        quality: (NUM_QUALITY,) as WrenchOut.
    """

    D: Any
    torque: TorqueSample
    tau_J: Array
    is_fresh: Any
    is_missing: Any
    is_corrected: Any
    fault: Any
    quality: Array


class WrenchReading:
    """The reading of one model behind one observer.

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
        beyond = BEYOND if learnt else np.inf
        self.explained = explained_table(
            error.correlation,
            config.live_moment_sd,
            config.live_force_sd,
            error.scale,
            time_step,
            beyond,
        )
        self.read_load = np.array([error.read_load])
        lines = np.eye(n) if torques is None else torques
        self.faults = fault_table(lines, rates, time_step, learnt)

    @property
    def tables(self) -> ReadingTables:
        """The constants of `read_wrench`."""
        return ReadingTables(
            self.read_load, self.lag, self.explained, self.faults, self.reconstruction.table
        )

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
        """Parameters that may be tuned while it runs, by name: those of its block.

        prior_sd (2,) N and N m, inf where nothing is known; of a constant error alone
        torque_covariance (n, n) N^2 m^2; damping (1,); truncation (1,).
        """
        config, error = self.config, self.error
        prior_sds = (config.prior_force_sd, config.prior_moment_sd)
        values = {"prior_sd": np.array([np.inf if sd is None else sd for sd in prior_sds])}
        if isinstance(error, ConstantTorqueError):
            values["torque_covariance"] = error.covariance
        values["damping"] = np.array([config.damping])
        values["truncation"] = np.array([config.truncation])
        return values

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
        if (
            isinstance(error, ConstantTorqueError)
            and covariance is not None
            and not np.array_equal(covariance, error.covariance)
        ):
            error = ConstantTorqueError.of(covariance)
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
        lag, faults = initial_lag_state().ravel(), initial_fault_state(self.num_joints)
        return np.concatenate([lag, [np.nan], faults])

    def run(
        self,
        state: Array,
        error: TorqueError,
        samples: ReadingSample,
        conditions: bool = True,
    ) -> WrenchEstimate:
        """Reads N samples.

        Args:
            state: of `initial_state`, changed in place.
            error: of N samples.
            samples: N of them; `observed` (N, OBSERVED) or (N, 0).
            conditions: whether condition numbers are wanted; NaN where not.
        """
        J, tau_ext, observed = samples.J, samples.tau_ext, samples.observed
        N = len(tau_ext)
        sd = error.sd
        if self.error.read_load > 0.0:
            sd = np.sqrt(sd**2 + (self.error.read_load * np.nan_to_num(tau_ext)) ** 2)
        torque = TorqueSample(error.J_seen, tau_ext, sd, error.stiction)
        out = WrenchOut(np.empty((N, 6)), np.empty((N, 6, 6)), np.empty((N, NUM_QUALITY)))
        reconstruct_log(self.reconstruction.table, J if conditions else J[:0], torque, out)
        if observed.shape[1] > 0:
            out.wrench[:], out.covariance[:] = observed[:, :6], observed[:, 6:].reshape(N, 6, 6)
        validity = _Judged(
            D=unexplained_log(self.explained, error.J_seen, tau_ext, sd),
            torque=torque,
            tau_J=np.ascontiguousarray(error.rows[:, TAU_J_ROW]),
            is_fresh=np.asarray(samples.is_fresh, bool),
            is_missing=np.asarray(samples.is_missing, bool),
            is_corrected=np.asarray(samples.is_corrected, bool),
            fault=np.asarray(samples.fault, np.int64),
            quality=out.quality,
        )
        invalid = np.empty(N, np.int64)
        _judge_log(self.tables, state, validity, out.wrench, out.covariance, invalid)
        return WrenchEstimate(out.wrench, out.covariance, out.quality[:, CONDITION], invalid)


@kernel(forceinline=True)
def _judge_reading(
    tables: ReadingTables,
    state: Array,
    validity: _Judged,
    wrench: Array,
    covariance: Array,
    lateness: Array,
) -> int:
    """Single-sample kernel: adds lag and scale to a reading; returns why it is not valid, or 0.

    Args:
        tables: of WrenchReading.
        state: of `initial_state`, changed.
        validity: of the sample.
        wrench: (6,).
        covariance: (6, 6), changed.
        lateness: (6,), overwritten.
    """
    torque, quality = validity.torque, validity.quality
    # Of the first sample there is no torque before it, and no wrench has been low-passed.
    lag_state = view_2d(state, 0, LAG_ROWS, 6)
    lacks_torque = np.isfinite(lag_state[0, 0]) and not np.isfinite(validity.tau_J.sum())
    is_at_E, state[_UNEXPLAINED_TIME] = is_explained(
        tables.explained, state[_UNEXPLAINED_TIME], validity.D
    )
    is_sound = is_believed(
        tables.faults,
        state[_SIGNALS:],
        torque.tau_ext,
        torque.sd,
        validity.tau_J,
        validity.is_fresh and validity.is_corrected,
        validity.fault & BEYOND_LIMITS != 0,
    )
    keeps_pace = lag_tick(tables.lag, lag_state, wrench, covariance, lateness)
    max_force_sd, max_stiction_force = quality_limits(tables.wrench)
    invalid = invalid_reasons(
        Findings(
            is_fresh=validity.is_fresh,
            is_missing=validity.is_missing or lacks_torque,
            fault=validity.fault,
            is_corrected=validity.is_corrected,
            has_reading=not np.isnan(quality[FORCE_SD]),
            has_full_rank=quality[HAS_FULL_RANK] == 1.0,
            force_sd=quality[FORCE_SD],
            stiction_force=quality[STICTION_FORCE],
            max_force_sd=max_force_sd,
            max_stiction_force=max_stiction_force,
            is_explained=is_at_E,
            is_believed=is_sound,
            keeps_pace=keeps_pace,
        )
    )
    is_force = invalid in (0, LAGGING)
    lag_update(tables.lag, lag_state, wrench, is_force)
    return invalid


@kernel(forceinline=True)
def read_wrench(
    tables: ReadingTables,
    state: Array,
    error: TorqueError,
    sample: ReadingSample,
    reading: Array,
    work: Array,
) -> None:
    """Single-sample kernel of `WrenchReading.run`.

    Args:
        tables: of WrenchReading.
        state: of `initial_state`, changed.
        error: of the sample.
        sample: `observed` (OBSERVED,) or (0,).
        reading: (READING,), written.
        work: (READING_WORK_ROWS, max(n, 6)), overwritten.
    """
    J, tau_ext, observed = sample.J, sample.tau_ext, sample.observed
    read_load = tables.read_load[0]
    n = J.shape[1]
    sd = work[_SD, :n]
    for j in range(n):
        sd[j] = error.sd[j]
        if read_load > 0.0 and np.isfinite(tau_ext[j]):
            sd[j] = np.sqrt(sd[j] ** 2 + (read_load * tau_ext[j]) ** 2)
    torque = TorqueSample(error.J_seen, tau_ext, sd, error.stiction)
    quality = work[_QUALITY]
    out = WrenchOut(reading[:6], view_2d(reading, 6, 6, 6), quality)
    reconstruct_with(tables.wrench, J, torque, out, work[:WORK_ROWS])
    for k in range(observed.shape[0]):
        reading[k] = observed[k]
    D = unexplained(tables.explained, error.J_seen, tau_ext, sd)
    validity = _Judged(
        D,
        torque,
        error.rows[TAU_J_ROW],
        sample.is_fresh,
        sample.is_missing,
        sample.is_corrected,
        sample.fault,
        quality,
    )
    invalid = _judge_reading(tables, state, validity, out.wrench, out.covariance, work[_LATENESS])
    reading[_CONDITION_AT] = quality[CONDITION]
    reading[_VALID_AT] = 1.0 if invalid == 0 else 0.0
    reading[_INVALID_AT] = invalid


@kernel
def read_sample(
    tables: ReadingTables,
    state: Array,
    error: Array,
    sample: ReadingSample,
    reading: Array,
    work: Array,
) -> None:
    """`read_wrench` with the torque error in (ERROR_ROWS n,) memory."""
    views = torque_error_views(error, sample.J.shape[1])
    read_wrench(tables, state, views, sample, reading, work)


@kernel
def _judge_log(
    tables: ReadingTables,
    state: Array,
    validity: _Judged,
    wrench: Array,
    covariance: Array,
    invalid: InvalidCodes,
) -> None:
    """`_judge_reading` for N samples; `state`, `covariance` and `invalid` are changed."""
    lateness = np.empty(6)
    borrowed_tables = ReadingTables(
        borrowed(tables.read_load),
        borrowed(tables.lag),
        borrowed(tables.explained),
        borrowed(tables.faults),
        borrowed(tables.wrench),
    )
    torque, state, tau_J = validity.torque, borrowed(state), borrowed(validity.tau_J)
    J, tau_ext = borrowed(torque.J), borrowed(torque.tau_ext)
    sd, stiction = borrowed(torque.sd), borrowed(torque.stiction)
    wrench, covariance = borrowed(wrench), borrowed(covariance)
    quality = borrowed(validity.quality)
    for k in range(tau_ext.shape[0]):
        sample_input = _Judged(
            validity.D[k],
            TorqueSample(J[k], tau_ext[k], sd[k], stiction[k]),
            tau_J[k],
            validity.is_fresh[k],
            validity.is_missing[k],
            validity.is_corrected[k],
            validity.fault[k],
            quality[k],
        )
        invalid[k] = _judge_reading(
            borrowed_tables, state, sample_input, wrench[k], covariance[k], lateness
        )
