"""Reads the wrench from tau_ext, with the observer's uncertainty at each sample.

    sds of the torque error, J as the observer saw it (`torque_error_stage`) -+
    tau_ext ------------------------------------------------------------------+-> wrench, covariance
                                                                      + lag, scale; valid

For a model without a learnt torque error the error has one covariance, and the band holds neither
lag nor scale.

The reasons why a reading is not valid are those of `models.estimation.invalid`.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.estimation.invalid import (
    LAGGING,
    UNSEEN_REST,
    Findings,
    InvalidCodes,
    invalid_reasons,
    marked,
)
from wrenchsight.models.estimation.torque_error_stage import TorqueError
from wrenchsight.models.estimation.wrench import (
    WrenchEstimate,
    WrenchReconstruction,
    WrenchReconstructionConfig,
)
from wrenchsight.models.estimation.wrench_kernels import (
    CONDITION,
    FORCE_SD,
    HAS_FULL_RANK,
    STICTION_FORCE,
)
from wrenchsight.models.estimation.wrench_methods import reconstruct_log
from wrenchsight.models.identification.torque_error_model import (
    TAU_J_ROW,
    TRANSMITTED_ROW,
    UNKNOWN_SHARE_ROW,
    ConstantTorqueError,
    TorqueErrorModel,
    torque_at_unseen_rest,
)
from wrenchsight.models.numerics.arrays import Array, Flags, Record, contiguous, record_of
from wrenchsight.models.numerics.kernel import NO_NEW_ARRAYS, kernel
from wrenchsight.models.observers.explained_torque import (
    ONSET_SDS,
    explained_constants,
    is_explained,
    unexplained_log,
)
from wrenchsight.models.observers.fault_signature import (
    FaultConstants,
    FaultNumbers,
    FaultState,
    fault_constants,
    initial_fault_state,
    is_believed,
)
from wrenchsight.models.observers.lag import (
    LagSettings,
    initial_lag_state,
    lag_settings,
    lag_tick,
    lag_update,
)
from wrenchsight.models.observers.sample_check import FAULT_BEYOND as BEYOND_LIMITS
from wrenchsight.models.observers.sample_check import Codes


class ReadingState(NamedTuple):
    """What a reading remembers.

    Attributes:
        lag: (1,) of LAG_STATE_TYPE of `models.observers.lag`.
        unexplained_time: (1,) s, of `models.observers.explained_torque`.
        times, means, torques: of `models.observers.fault_signature`.
    """

    lag: Record
    unexplained_time: Array
    times: Array
    means: Array
    torques: Array


class ReadingSamples(NamedTuple):
    """Input of the reading at N samples.

    Attributes:
        J: (N, 6, n) at E in axes of W.
        tau_ext: (N, n) N m.
        is_fresh: (N,) whether tau_ext belongs to its sample, neither held nor settling.
        q, v: (N, n) rad and rad/s; a sample with one that is not finite is missing.
        is_corrected: (N,) whether the correction of an air pass holds, or there is none.
        fault: (N,) codes of `models.observers.sample_check`.
        wrench, covariance: (N, 6) and (N, 6, 6) of an observer that reads the wrench itself, in the
            reading's place; None of one that does not.
    """

    J: Array
    tau_ext: Array
    q: Array
    v: Array
    is_fresh: Flags
    is_corrected: Flags
    fault: Codes
    wrench: Array | None = None
    covariance: Array | None = None


class JudgementNumbers(NamedTuple):
    """What `judge_rows` compares readings with.

    Attributes:
        max_force_sd, max_stiction_force: N, of a valid reading.
        period: s between samples.
        max_unexplained: bound of D, `ExplainedConstants.bound_squared`.
        lag: of `lag_settings`.
        faults: of `fault_constants`.
    """

    max_force_sd: float
    max_stiction_force: float
    period: float
    max_unexplained: float
    lag: LagSettings
    faults: FaultNumbers


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
        """Packs the constants of reading and judgement; arguments as the class has them.

        With a constant torque error (no model of it was learnt) lag, misfit and faults are not
        judged: what they would be compared with is not known.
        """
        is_learnt = not isinstance(error, ConstantTorqueError)
        self.error, self._usual_sd, self._torques = error, usual_sd, torques
        self._time_step, self._force_bandwidth_hz = time_step, force_bandwidth_hz
        self.config = config
        self.num_joints = n = error.num_joints
        self.reconstruction = WrenchReconstruction(config, error.correlation, usual_sd)
        # What is not judged has constants that find nothing: K_0 of None no lag, sds of inf no
        # torque without explanation, False no fault.
        judged_K_0 = K_0 if is_learnt else None
        self.lag = lag_settings(judged_K_0, time_step, force_bandwidth_hz, error.scale)
        max_sds = ONSET_SDS if is_learnt else np.inf
        self.explained = explained_constants(
            error.correlation,
            config.live_moment_sd,
            config.live_force_sd,
            error.scale,
            time_step,
            max_sds,
        )
        torque_of_motors = np.eye(n) if torques is None else torques
        self.faults = fault_constants(
            torque_of_motors, judged_K_0, time_step, is_learnt, error.correlation, error.scale
        )
        self._work = np.empty((2, 6))  # of `judge_rows`, which holds the interpreter's lock
        limits = self.reconstruction.limits
        self._judgement = record_of(
            JudgementNumbers(
                max_force_sd=limits.max_force_sd,
                max_stiction_force=limits.max_stiction_force,
                period=self.explained.period,
                max_unexplained=self.explained.bound_squared,
                lag=self.lag,
                faults=self.faults.numbers,
            )
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
        # Without a lag neither time step nor bandwidth counts.
        return cls(
            ConstantTorqueError.of(Sigma), config, K_0=None, time_step=1.0, force_bandwidth_hz=0.0
        )

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
        """Returns the reading with other `parameters`, behind an observer with this K_0.

        The live prior and the limits of `valid` stay.

        Args:
            values: as `parameters` gives them: prior_sd (2,) of force N and moment N m, damping and
                truncation (1,) each; torque_covariance (n, n) of a constant torque error, or none.
            K_0: (n,) or () 1/s; None: an observer without such a lag.
        """
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
            error = ConstantTorqueError.of(covariance, error.fitted_speed, error.fitted_load)
        return WrenchReading(
            error=error,
            config=config,
            K_0=K_0,
            time_step=self._time_step,
            force_bandwidth_hz=self._force_bandwidth_hz,
            usual_sd=self._usual_sd,
            torques=self._torques,
        )

    def initial_state(self) -> ReadingState:
        """Returns the state before the first sample."""
        faults = initial_fault_state(self.faults)
        return ReadingState(initial_lag_state(), np.array([np.nan]), *faults)

    def run(
        self,
        state: ReadingState,
        error: TorqueError,
        samples: ReadingSamples,
        conditions: bool = True,
    ) -> WrenchEstimate:
        """Reads N samples.

        Args:
            state: of `initial_state`, changed in place.
            error: of the torque, of N samples; it gains `read_load` of what is read.
            samples: N of them. Where they hold a wrench, an observer has read it: it stays, and
                only `invalid` is judged as usual.
            conditions: whether condition numbers are wanted; NaN where not.
        """
        tau_ext = samples.tau_ext
        sd = error.sd
        if self.error.read_load > 0.0:
            sd = np.empty_like(error.sd)
            load_sd_rows(self.error.read_load, error.sd, tau_ext, sd)
        J_now = samples.J if conditions else samples.J[:0]  # for the condition numbers alone
        reading = reconstruct_log(
            self.reconstruction.constants, J_now, error.J_seen, tau_ext, sd, error.stiction
        )
        if samples.wrench is not None and samples.covariance is not None:
            reading = reading._replace(wrench=samples.wrench, covariance=samples.covariance)
        invalid = np.empty(len(tau_ext), np.int64)
        # Writes `invalid`, and adds lag and scale to the covariance.
        judge_rows(
            self._judgement,
            self.faults.poles,
            self.faults.lines,
            self.faults.correlation,
            *state,  # lag, unexplained_time, times, means, torques
            tau_ext,
            sd,
            unexplained_log(self.explained, error.J_seen, tau_ext, sd),
            error.rows,
            samples.q,
            samples.v,
            samples.is_fresh,
            samples.is_corrected,
            samples.fault,
            *reading,  # wrench, covariance, quality
            invalid,
            self._work,
        )
        return WrenchEstimate(
            reading.wrench, reading.covariance, reading.quality[:, CONDITION], invalid
        )


def with_unseen_rests(
    reading: WrenchEstimate, table: Array, rows: Array, tau_ext: Array
) -> WrenchEstimate:
    """A reading, not valid where a joint that rested in no log of the model rests beyond friction.

    Args:
        reading: of N samples.
        table: of TorqueErrorStage.
        rows: (N, TORQUE_ERROR_ROWS, n) of TorqueError.
        tau_ext: (N, n) N m.
    """
    is_unseen = torque_at_unseen_rest(table, *contiguous(rows, tau_ext))
    if not is_unseen.any():
        return reading
    return reading._replace(invalid=marked(reading.invalid, UNSEEN_REST, is_unseen))


@kernel(**NO_NEW_ARRAYS)
def are_readable(
    bound: float,
    q: Array,
    J: Array,
    sd: Array,
    stiction: Array,
    drift: Array,
    J_seen: Array,
    rows: Array,
) -> bool:
    """Whether all that N readings start from is finite, and smaller than `bound` in magnitude.

    A block checks what its ports hold with it: a number that is not finite passes no comparison.

    Args:
        bound: of rad, m and N m alike.
        q: (N, n) rad.
        J: (N, 6, n) at E in axes of W.
        sd, stiction, drift, J_seen, rows: fields of TorqueError. Of the rows UNKNOWN_SHARE_ROW to
            TRANSMITTED_ROW are checked; position before and motor torque behind them are NaN before
            the first sample.
    """
    are_below = True
    for k in range(q.shape[0]):
        for i in range(q.shape[1]):
            are_below = are_below and abs(q[k, i]) < bound
            are_below = are_below and abs(sd[k, i]) < bound
            are_below = are_below and abs(stiction[k, i]) < bound
            are_below = are_below and abs(drift[k, i]) < bound
            for axis in range(6):
                are_below = are_below and abs(J[k, axis, i]) < bound
                are_below = are_below and abs(J_seen[k, axis, i]) < bound
            for row in range(UNKNOWN_SHARE_ROW, TRANSMITTED_ROW + 1):
                are_below = are_below and abs(rows[k, row, i]) < bound
    return are_below


@kernel(nogil=True)
def load_sd_rows(read_load: float, sd: Array, tau_ext: Array, with_load: Array) -> None:
    """Adds to sds what grows with the torque that is read.

    Args:
        read_load: N m per N m.
        sd, tau_ext: (N, n) N m; a torque that is NaN adds nothing.
        with_load: (N, n) N m, written.
    """
    for k in range(sd.shape[0]):
        for i in range(sd.shape[1]):
            load_sd = 0.0 if np.isnan(tau_ext[k, i]) else read_load * tau_ext[k, i]
            with_load[k, i] = np.sqrt(sd[k, i] * sd[k, i] + load_sd * load_sd)


@kernel(**NO_NEW_ARRAYS)
def judge_rows(
    constants: Record,
    poles: Array,
    lines: Array,
    correlation: Array,
    lag: Record,
    unexplained_time: Array,
    times: Array,
    means: Array,
    torques: Array,
    tau_ext: Array,
    sd: Array,
    unexplained: Array,
    error_rows: Array,
    q: Array,
    v: Array,
    is_fresh: Flags,
    is_corrected: Flags,
    fault: Codes,
    wrench: Array,
    covariance: Array,
    quality: Array,
    invalid: InvalidCodes,
    work: Array,
) -> None:
    """Says of N readings why they are not valid, and adds lag and scale to their covariances.

    Args:
        constants: of JudgementNumbers.
        poles, lines, correlation: of FaultConstants.
        lag, unexplained_time, times, means, torques: ReadingState of the sample before; changed to
            that after the last sample.
        tau_ext, sd: (N, n) N m, the sd with what grows with the torque that is read. Row by row in
            the order of their times, like all that follows.
        unexplained: (N,) of `unexplained_log`, how far tau_ext is from that of any wrench at E.
        error_rows: (N, TORQUE_ERROR_ROWS, n) of TorqueError, with the motor torque of the sample
            before.
        q, v, is_fresh, is_corrected, fault: as ReadingSamples.
        wrench, covariance, quality: the readings, as WrenchLog; the covariance is changed.
        invalid: (N,) written: the reasons, a sum; 0 of a valid reading.
        work: (2, 6) of `lag_tick`.
    """
    numbers = constants[0]
    signature = FaultConstants(numbers.faults, poles, lines, correlation)
    fault_memory = FaultState(times, means, torques)
    for k in range(wrench.shape[0]):
        # At the first sample, when no wrench has been low-passed (lag is NaN), no torque comes
        # before it, and none is missing.
        tau_J = error_rows[k, TAU_J_ROW]
        lacks_torque = np.isfinite(lag[0].fast[0]) and not np.isfinite(tau_J.sum())
        lacks_motion = not np.isfinite(q[k].sum() + v[k].sum())
        is_at_E, unexplained_time[0] = is_explained(
            numbers.period, numbers.max_unexplained, unexplained_time[0], unexplained[k]
        )
        is_sound = is_believed(
            signature,
            fault_memory,
            tau_ext[k],
            sd[k],
            tau_J,
            unexplained[k],
            is_fresh[k] and is_corrected[k],
            fault[k] & BEYOND_LIMITS != 0,
        )
        # Adds lag and scale to the covariance; the low-pass is that of the samples before.
        keeps_pace = lag_tick(numbers.lag, lag, wrench[k], covariance[k], work)
        invalid[k] = invalid_reasons(
            Findings(
                is_fresh=is_fresh[k],
                is_missing=lacks_torque or lacks_motion,
                fault=fault[k],
                is_corrected=is_corrected[k],
                has_reading=not np.isnan(quality[k, FORCE_SD]),
                has_full_rank=quality[k, HAS_FULL_RANK] == 1.0,
                force_sd=quality[k, FORCE_SD],
                stiction_force=quality[k, STICTION_FORCE],
                max_force_sd=numbers.max_force_sd,
                max_stiction_force=numbers.max_stiction_force,
                is_explained=is_at_E,
                is_believed=is_sound,
                keeps_pace=keeps_pace,
            )
        )
        # A reading that is only late is a force all the same: it goes on being low-passed.
        is_force = invalid[k] in (0, LAGGING)
        lag_update(numbers.lag, lag, wrench[k], is_force)
