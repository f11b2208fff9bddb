"""The estimation chain for a tick or a log: from motor current to the wrench and its covariance.

    current -> tau_J ----------------------------+
    q, v    -> tau_f (friction) -----------------+-> momentum observer -> tau_ext -> wrench at E
    q, v    -> momentum, CTv, G (model), J ------+                             +--- covariance

A tick is one call of one kernel. A log runs the same stages (`wrenchsight.models.estimation.tick`):
those without memory in parallel over its rows, the others row by row. Both give the same numbers. A
friction law with load dependence takes the motor torque of the previous tick
(`wrenchsight.models.friction.presliding_friction`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.estimation.estimator_arrays import (
    Packed,
    Parameters,
    State,
    packed,
    state_of,
    state_size,
    tick_sizes,
    workspace_size,
)
from wrenchsight.models.estimation.invalid import InvalidCodes, marked
from wrenchsight.models.estimation.kernel_choice import kernel_choice
from wrenchsight.models.estimation.tick import (
    OVERRIDE_CORRECTION,
    OVERRIDE_COUNTS,
    OVERRIDE_SD,
    OVERRIDE_TAU_F,
    TickLog,
    TickSample,
    estimate_tick,
    memory_log,
    terms_log,
)
from wrenchsight.models.estimation.torque_error_stage import (
    TorqueError,
    TorqueErrorStage,
)
from wrenchsight.models.estimation.wrench import (
    WrenchReconstruction,
    WrenchReconstructionConfig,
    live_prior,
    wrench_prior,
)
from wrenchsight.models.estimation.wrench_reading import (
    OBSERVED,
    READING,
    ReadingSample,
    WrenchReading,
)
from wrenchsight.models.friction.friction_law import FrictionLaw
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.identification.torque_error_model import (
    TORQUE_ERROR_ROWS,
    ConstantTorqueError,
    TorqueErrorModel,
)
from wrenchsight.models.numerics.arrays import Array, Flags, contiguous
from wrenchsight.models.observers.lag import JACOBIAN_ROWS
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.observers.observer import (
    DRIFT,
    MOMENTUM,
    NUM_SIGNALS,
    STICTION,
    TAU_F,
    TAU_J,
    TORQUE_SD,
    InformedObserver,
    ModelKnowledge,
    Observer,
    Q,
    V,
)
from wrenchsight.models.observers.observer_kinds import AnyObserverConfig, make_observer
from wrenchsight.models.observers.sample_check import Codes, SampleCheck
from wrenchsight.models.robot.arm import Arm
from wrenchsight.models.robot.motors import motor_gain

_PASS = 16384  # rows of a log taken at a time, which bounds the memory


@dataclass
class WrenchEstimatorConfig:
    """Configuration of the estimator: observer, prior of the wrench, check of samples."""

    observer: AnyObserverConfig = field(default_factory=MomentumObserverConfig)
    reconstruction: WrenchReconstructionConfig = field(default_factory=WrenchReconstructionConfig)
    force_bandwidth_hz: float = 3.0
    """Hz, up to which the band covers the observer's lag"""
    position_resolution: list[float] | None = None
    """rad, per joint; None: the value of robot.yaml for all joints, else the model's"""
    check_samples: bool = True
    """flag samples that no joint can have made"""


class Correction(NamedTuple):
    """Learnt correction of an air pass, for one sample or N; see `models.machining.air_pass`.

    Attributes:
        tau_correction: (..., n) N m, added to tau_ext.
        v_planned: (..., n) rad/s, at which friction without memory is evaluated, as on the air
            pass. So the sign of the measured speed does not matter for a joint that hardly moves.
            A law with memory follows the measured motion on both passes.
        counts: (...) 1 where a corrected reading may be valid, else 0.
        sd: (..., n) N m, of the correction, beyond the model's torque error; one number stands for
            all joints.
    """

    tau_correction: ArrayLike
    v_planned: ArrayLike
    counts: ArrayLike
    sd: ArrayLike = 0.0


class TickEstimate(NamedTuple):
    """The estimate right after one sample; fields as `EstimateBatch`, without its first axis."""

    tau_ext: Array
    wrench: Array
    covariance: Array
    condition_number: float
    invalid: int
    fault: int = 0

    @property
    def valid(self) -> bool:
        """Whether there is no reason against it."""
        return self.invalid == 0


class EstimateBatch(NamedTuple):
    """The estimates right after each of N samples.

    Attributes:
        tau_ext: (N, n) N m, positive along the motion it causes.
        wrench: (N, 6) F_E_W = [mx my mz fx fy fz] in N m and N: exerted by the environment on the
            robot, at E, in axes of W.
        covariance: (N, 6, 6) of the wrench.
        condition_number: (N,) of J in m and rad.
        invalid: (N,) the reasons why a reading is not valid, a sum of the codes of
            `models.estimation.invalid`; 0 where it is valid.
        J: (N, 6, n) rows [angular; linear] at E in axes of W.
        torque_sd: (N, n) N m, of tau_ext without contact.
        transmitted: (N, n) N m, torque that the gears transmit: motor torque less friction; empty
            where it is not stored, as are all further fields.
        fresh: (N,) whether tau_ext belongs to the sample, and its correction holds.
        fault: (N,) faults of q and v of the sample and of the previous current: a sum of BEYOND,
            DISAGREES and FROZEN of `models.observers.sample_check`, or 0. Such a sample is treated
            as one that is not finite.
        stiction, drift, J_seen, error_rows: of `torque_error`.
        v, momentum: (N, n) rad/s and kg m^2/s, as checked.
    """

    tau_ext: Array
    wrench: Array
    covariance: Array
    condition_number: Array
    invalid: InvalidCodes
    J: Array
    torque_sd: Array
    transmitted: Array = np.empty((0, 0))
    fresh: Flags = np.empty(0, np.bool_)
    fault: Codes = np.empty(0, np.int64)
    stiction: Array = np.empty((0, 0))
    drift: Array = np.empty((0, 0))
    J_seen: Array = np.empty((0, 0, 0))
    error_rows: Array = np.empty((0, 0, 0))
    v: Array = np.empty((0, 0))
    momentum: Array = np.empty((0, 0))

    @property
    def valid(self) -> Flags:
        """(N,) whether there is no reason against a reading."""
        return np.asarray(self.invalid == 0)

    def marked(self, reason: int, rows: Flags | bool) -> "EstimateBatch":
        """These readings, in some rows (N,) not valid for one more reason."""
        return self._replace(invalid=marked(self.invalid, reason, rows))

    @property
    def torque_error(self) -> TorqueError:
        """Uncertainty of the observer at each sample."""
        return TorqueError(self.torque_sd, self.stiction, self.drift, self.J_seen, self.error_rows)

    @property
    def standard_deviation(self) -> Array:
        """(N, 6) of the wrench, N m and N, rotation first."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1)))

    def rows(self, rows: slice | Flags) -> "EstimateBatch":
        """Some of the samples."""
        return EstimateBatch._make(column[rows] for column in self)

    @staticmethod
    def joined(batches: Sequence["EstimateBatch"]) -> "EstimateBatch":
        """Returns the batches, one after another, as one."""
        if len(batches) == 1:
            return batches[0]
        columns: Any = zip(*batches, strict=True)
        return EstimateBatch._make(np.concatenate(column) for column in columns)


class Observation(NamedTuple):
    """Torques of the observer and the friction law at N samples.

    Attributes:
        tau_ext: (N, n) N m.
        tau_J: (N, n) N m, motor torque on the joint side.
        tau_f: (N, n) N m, friction.
        fresh: (N,) see `wrenchsight.models.observers.observer`.
        J: (N, 6, n) rows [angular; linear] at E in axes of W.
        torque_error: uncertainty of the observer.
    """

    tau_ext: Array
    tau_J: Array
    tau_f: Array
    fresh: Flags
    J: Array
    torque_error: TorqueError

    @property
    def transmitted(self) -> Array:
        """(N, n) N m, torque that the gears transmit."""
        return np.asarray(self.tau_J - self.tau_f)


class WrenchEstimator:
    """From q, v and motor current to the wrench at E, with one model of one robot.

    For a model with a torque error the reading uses the sds of each sample, J as the observer saw
    it, and a band that holds lag and scale. For any other model Sigma_tau is the residual
    covariance, at rest and in motion alike (`wrench_reading`). A prior missing in the configuration
    is `live_prior` of the robot's payload; `with_prior` sets another.

    `step` and `run` change `state` in place and may be mixed freely; one estimator serves any
    number of states, from one thread.

    Attributes:
        error: stage of the torque error.
        reading: stage of the wrench.
        packed: the constants of `wrenchsight.models.estimation.tick`.

    Raises:
        InputError: the model belongs to another robot.
        ValueError: as MomentumObserver and WrenchReconstruction.
    """

    def __init__(
        self, robot: Arm, model: IdentifiedModel, config: WrenchEstimatorConfig | None = None
    ) -> None:
        config = config if config is not None else WrenchEstimatorConfig()
        self.robot = robot
        self.model = model
        reconstruction = config.reconstruction.with_prior(*live_prior(robot.payload))
        if reconstruction is not config.reconstruction:
            config = replace(config, reconstruction=reconstruction)
        self.config = config
        self.num_joints = n = robot.num_joints
        self.chain = model.chain(robot)
        self.observer = make_observer(self.config.observer, n)
        self.reconstruction = WrenchReconstruction(
            self.config.reconstruction, model.residual_covariance
        )
        self.resolution = resolution = self._position_resolution()
        T = self.observer.time_step
        self.friction = model.friction.sampled(T, resolution)
        self.learnt = model.torque_error is not None
        error = self._torque_error_model()
        reading_config = self.config.reconstruction.with_live(*live_prior(robot.payload))
        rates = self.observer.pole
        self.knowledge = ModelKnowledge(
            model.torque_error,
            np.sqrt(np.diag(self.reconstruction.torque_covariance)),
            np.broadcast_to(error.K_0 if rates is None else rates, (n,)),
            wrench_prior(reading_config),
        )
        if isinstance(self.observer, InformedObserver):
            self.observer = self.observer.informed(self.knowledge)
        self.error = TorqueErrorStage(
            error, self.friction, self.observer.pole, T, resolution, self.chain
        )
        self.reading = WrenchReading(
            error=error,
            config=reading_config if self.learnt else self.config.reconstruction,
            K_0=self.observer.pole,
            time_step=T,
            force_bandwidth_hz=self.config.force_bandwidth_hz,
            usual_sd=np.sqrt(np.diag(model.residual_covariance)) if self.learnt else None,
            torques=robot.joint_torque(np.eye(n)),
        )
        self.observed_size = 0 if self.observer.kernels.wrench is None else OBSERVED
        self.choice = kernel_choice(self.observer.kernels, self.friction.kernels)
        self.check: SampleCheck | None = None
        if self.config.check_samples:
            self.check = SampleCheck(robot, resolution)
        self.packed = self.packed_with(
            robot.torque_per_ampere, self.friction, self.observer, self.reading
        )
        observer_rows = len(self.observer.initial_state())
        self._state_shape = (state_size(n, observer_rows, self.friction.state_rows),)
        self._out_size = sum(tick_sizes(n).values())
        self._sample = np.empty((3, n))
        self._no_overrides = np.empty((0, n))
        self._scratch = np.empty(workspace_size(n))

    def _position_resolution(self) -> list[float] | None:
        """(n,) rad of the encoders: the configuration's, else the robot's, else None."""
        resolution = self.config.position_resolution
        if resolution is None and np.isfinite(self.robot.position_resolution).all():
            resolution = self.robot.position_resolution.tolist()
        return resolution

    def _torque_error_model(self) -> TorqueErrorModel:
        """The model's torque error; without one, the residual covariance at rest and in motion."""
        if self.model.torque_error is not None:
            return self.model.torque_error
        ranges = self.model.validity
        return ConstantTorqueError.of(
            self.reconstruction.torque_covariance, ranges.v_max or 0.0, ranges.tau_max or 0.0
        )

    def packed_with(
        self,
        torque_per_ampere: Array,
        friction: FrictionLaw,
        observer: Observer,
        reading: WrenchReading,
    ) -> Packed:
        """Returns the constants of this estimator with other parts.

        Args:
            torque_per_ampere: (n,) N m/A.
            friction, observer, reading: in place of the estimator's.
        """
        robot = self.robot
        period = self.observer.time_step
        error = TorqueErrorStage(
            reading.error, friction, observer.pole, period, self.resolution, self.chain
        )
        gain = motor_gain(torque_per_ampere, robot.current_sign)
        parameters = Parameters(
            chain=self.chain.table,
            drives=np.vstack([gain, *(robot.motor_rates if robot.is_coupled else ())]),
            friction=friction.velocity_law.table,
            slip=friction.slip_table,
            error=error.table,
            poles=error.poles,
            **reading.tables._asdict(),
            check=np.empty((0, self.num_joints)) if self.check is None else self.check.table,
            period=np.array([period]),
        )
        observer_rows = len(observer.initial_state())
        return packed(parameters, observer.table, observer_rows, friction.state_rows)

    def with_prior(self, force_sd: float, moment_sd: float) -> Self:
        """Returns an estimator with this prior (N, N m) in place of the configuration's."""
        reconstruction = replace(
            self.config.reconstruction, prior_force_sd=force_sd, prior_moment_sd=moment_sd
        )
        config = replace(self.config, reconstruction=reconstruction)
        return type(self)(self.robot, self.model, config)

    def initial_state(self) -> Array:
        """Returns the state before the first sample, flat: a `State`."""
        state = np.zeros(self._state_shape)
        parts = self.parts(state)
        parts.observer[:] = self.observer.initial_state()
        parts.friction[:] = self.friction.initial_state()
        parts.error[:] = self.error.initial_state()
        parts.reading[:] = self.reading.initial_state()
        if self.check is not None:
            parts.check[:] = self.check.initial_state()
        return state

    def parts(self, state: Array) -> State:
        """The parts of a state, as views of it."""
        return state_of(state, self.packed.layout, self.num_joints)

    def step(
        self,
        state: Array,
        q: ArrayLike,
        v: ArrayLike,
        current: ArrayLike,
        *,
        correction: Correction | None = None,
    ) -> TickEstimate:
        """Takes one sample.

        Args:
            state: of `initial_state`, changed in place.
            q, v: (n,) rad and rad/s (m and m/s).
            current: (n,) A, as the drives report it.
            correction: learnt correction of an air pass, for this sample.

        Raises:
            ValueError: shapes that disagree.
        """
        n, out = self.num_joints, np.empty(self._out_size)
        self._check_state(state)
        sample, overrides = self._sample, self._no_overrides
        sample[0], sample[1], sample[2] = q, v, current
        if correction is not None:
            overrides = self._overrides(correction, None, ())
        estimate_tick(self.choice, self.packed[:], state, sample, overrides, out, self._scratch)
        return TickEstimate(
            out[:n],
            out[n : n + 6],
            out[n + 6 : n + 42].reshape(6, 6),
            out.item(n + 42),
            int(out.item(n + READING - 1)),
            int(out.item(n + READING)),
        )

    def _check_state(self, state: Array) -> None:
        """Refuses a state whose shape or layout is not the one the kernels are compiled for."""
        if state.shape != self._state_shape or not state.flags.c_contiguous:
            raise ValueError(f"state must be {self._state_shape} contiguous, not {state.shape}")

    def run(
        self,
        state: Array,
        q: ArrayLike,
        v: ArrayLike,
        current: ArrayLike,
        *,
        correction: Correction | None = None,
        tau_f: ArrayLike | None = None,
        signals: Array | None = None,
        conditions: bool = True,
    ) -> EstimateBatch:
        """Takes a log, or the next chunk of one; the result does not depend on the chunks.

        Args:
            state: of `initial_state`, changed in place.
            q, v: (N, n) rad and rad/s (m and m/s), at the observer's time step.
            current: (N, n) A, as the drives report it.
            correction: learnt correction of an air pass, sample by sample. It corrects tau_ext;
                friction without memory is taken at planned speeds.
            tau_f: (N, n) N m, friction known from elsewhere, in place of the law's. It is
                subtracted from the motor torque, sample by sample.
            signals: (N, NUM_SIGNALS, n), written: the signals of the samples, rows as in
                `wrenchsight.models.observers.observer`.
            conditions: whether condition numbers are wanted; NaN where not.

        Raises:
            ValueError: shapes that disagree; correction and tau_f together.
        """
        n = self.num_joints
        q, v, current = contiguous(q, v, current)
        if not (q.ndim == 2 and q.shape == v.shape == current.shape and q.shape[1] == n):
            raise ValueError(
                f"q, v and current must be (N, {n}), not {q.shape}, {v.shape} and {current.shape}"
            )
        self._check_state(state)
        N = q.shape[0]
        overrides = np.empty((N, 0, n))
        if correction is not None or tau_f is not None:
            overrides = self._overrides(correction, tau_f, (N,))
        if N == 1 and tau_f is None and signals is None:
            return self._run_single_sample(state, q, v, current, overrides[0])
        fault = np.zeros(N, np.int64)
        if self.check is not None:
            memory, T = self.parts(state).check, self.observer.time_step
            checked, fault = self.check.run(memory, q, v, current, T)
            q, v, current = (np.asarray(part, float) for part in checked)
        if tau_f is not None:
            current = np.asarray(current - self._current_of(tau_f))
        samples = TickSample(q, v, current, overrides)
        return self._run_checked(state, samples, fault, signals, conditions)

    def _run_checked(
        self,
        state: Array,
        samples: TickSample,
        fault: Codes,
        signals: Array | None,
        conditions: bool,
    ) -> EstimateBatch:
        """`run` of N checked samples, _PASS rows at a time."""
        N, n = samples.q.shape
        reading_state = self.parts(state).reading
        batch = _empty_batch(N, n, fault)
        error = batch.torque_error
        signals_of_pass = np.empty((min(N, _PASS), NUM_SIGNALS, n))
        observed_of_pass = np.empty((min(N, _PASS), self.observed_size))
        fresh_of_pass, corrected_of_pass = np.empty((2, min(N, _PASS)), np.bool_)
        for start in range(0, N, _PASS):
            rows = slice(start, min(N, start + _PASS))
            count = rows.stop - start
            log = TickLog(
                signals=signals_of_pass[:count] if signals is None else signals[rows],
                J=batch.J[rows],
                error=error.part(rows),
                tau_ext=batch.tau_ext[rows],
                fresh=fresh_of_pass[:count],
                corrected=corrected_of_pass[:count],
                observed=observed_of_pass[:count],
            )
            samples_of_pass = TickSample(
                samples.q[rows],
                samples.v[rows],
                samples.current[rows],
                samples.overrides[rows],
            )
            terms_log(self.packed, samples_of_pass, log.signals, log.J)
            memory_log(self.choice, self.packed, state, samples_of_pass.overrides, log)
            batch.transmitted[rows] = log.signals[:, TAU_J] - log.signals[:, TAU_F]
            batch.momentum[rows], batch.v[rows] = log.signals[:, MOMENTUM], log.signals[:, V]
            batch.fresh[rows] = log.fresh & log.corrected
            is_finite = np.isfinite(log.signals[:, [Q, V]]).all(axis=(1, 2))
            reading_samples = ReadingSample(
                J=log.J,
                tau_ext=log.tau_ext,
                is_fresh=log.fresh,
                is_missing=~is_finite,
                is_corrected=log.corrected,
                fault=fault[rows],
                observed=log.observed,
            )
            reading = self.reading.run(reading_state, log.error, reading_samples, conditions)
            batch.wrench[rows] = reading.wrench
            batch.covariance[rows] = reading.covariance
            batch.condition_number[rows] = reading.condition_number
            batch.invalid[rows] = reading.invalid
        return batch

    def _run_single_sample(
        self, state: Array, q: Array, v: Array, current: Array, overrides: Array
    ) -> EstimateBatch:
        """`run` of one sample (1, n): one call of a kernel."""
        out, sample = np.empty(self._out_size), self._sample
        sample[0], sample[1], sample[2] = q[0], v[0], current[0]
        estimate_tick(self.choice, self.packed[:], state, sample, overrides, out, self._scratch)
        tick = self._tick_rows(out[None])
        signals, reading = tick.signals, tick.reading
        return EstimateBatch(
            tau_ext=tick.tau_ext,
            wrench=reading[:, :6],
            covariance=reading[:, 6:42].reshape(1, 6, 6),
            condition_number=reading[:, 42],
            invalid=reading[:, READING - 1].astype(np.int64),
            J=tick.J,
            torque_sd=signals[:, TORQUE_SD],
            transmitted=signals[:, TAU_J] - signals[:, TAU_F],
            fresh=reading[:, READING + 1] == 1.0,
            fault=reading[:, READING].astype(np.int64),
            stiction=signals[:, STICTION],
            drift=signals[:, DRIFT],
            J_seen=tick.error_rows[:, :JACOBIAN_ROWS],
            error_rows=tick.error_rows[:, JACOBIAN_ROWS:],
            v=signals[:, V],
            momentum=signals[:, MOMENTUM],
        )

    def _tick_rows(self, out: Array) -> "_TickRows":
        """The parts of the memory (1, size) of one tick, in the order of `tick_sizes`."""
        n = self.num_joints
        J = n + READING + 2
        signals = J + 6 * n
        error_rows = signals + NUM_SIGNALS * n
        end = error_rows + (JACOBIAN_ROWS + TORQUE_ERROR_ROWS) * n
        return _TickRows(
            tau_ext=out[:, :n],
            reading=out[:, n:],
            J=out[:, J:signals].reshape(1, 6, n),
            signals=out[:, signals:error_rows].reshape(1, NUM_SIGNALS, n),
            error_rows=out[:, error_rows:end].reshape(1, -1, n),
        )

    def observe(self, q: ArrayLike, v: ArrayLike, current: ArrayLike) -> Observation:
        """Runs a whole log up to tau_ext, from the initial state, without reading the wrench.

        Args:
            q, v, current: as `run`.
        """
        q, v, current = contiguous(q, v, current)
        N, n = q.shape
        samples = TickSample(q, v, current, np.empty((N, 0, n)))
        log = TickLog(
            signals=np.empty((N, NUM_SIGNALS, n)),
            J=np.empty((N, 6, n)),
            error=TorqueError.empty(N, n),
            tau_ext=np.empty((N, n)),
            fresh=np.empty(N, np.bool_),
            corrected=np.empty(N, np.bool_),
            observed=np.empty((N, 0)),
        )
        terms_log(self.packed, samples, log.signals, log.J)
        memory_log(self.choice, self.packed, self.initial_state(), samples.overrides, log)
        tau_J, tau_f = log.signals[:, TAU_J].copy(), log.signals[:, TAU_F].copy()
        fresh = log.fresh & log.corrected
        return Observation(log.tau_ext, tau_J, tau_f, fresh, log.J, log.error)

    def _current_of(self, tau_f: ArrayLike) -> Array:
        """The current (..., n) in A for a joint torque (..., n) in N m."""
        tau_f, robot = np.asarray(tau_f, float), self.robot
        tau_motor = tau_f @ robot.coupling if robot.is_coupled else tau_f
        gain = motor_gain(robot.torque_per_ampere, robot.current_sign)
        return np.asarray(tau_motor / gain)

    def _overrides(
        self, correction: Correction | None, tau_f: ArrayLike | None, leading: tuple[int, ...]
    ) -> Array:
        """The rows (*leading, 3 or 4, n) by which `models.estimation.tick` is overridden."""
        n = self.num_joints
        if correction is not None and tau_f is not None:
            raise ValueError(
                "an air pass determines the friction already; pass correction or tau_f"
            )
        if correction is not None and self.observed_size:
            raise ValueError(
                "an observer that reads the wrench itself takes no correction of an air pass"
            )
        follows_motion = correction is not None and self.friction.state_rows > 0
        num_rows = OVERRIDE_TAU_F if follows_motion else OVERRIDE_TAU_F + 1
        overrides = np.zeros((*leading, num_rows, n))
        overrides[..., OVERRIDE_COUNTS, :] = 1.0
        if correction is None:
            shape = np.asarray(tau_f, float).shape
            if shape != (*leading, n):
                raise ValueError(f"tau_f must be {(*leading, n)}, not {shape}")
            return overrides
        shapes = [
            np.shape(correction.tau_correction),
            np.shape(correction.v_planned),
            np.shape(correction.counts),
        ]
        if shapes != [(*leading, n), (*leading, n), leading]:
            raise ValueError(
                "tau_correction, v_planned and counts of an air pass must be "
                f"{(*leading, n)}, {(*leading, n)} and {leading}, not {shapes}"
            )
        if not follows_motion:
            friction = self.model.friction.feedforward
            overrides[..., OVERRIDE_TAU_F, :] = friction.torque(correction.v_planned)
        overrides[..., OVERRIDE_CORRECTION, :] = correction.tau_correction
        overrides[..., OVERRIDE_COUNTS, :] = np.asarray(correction.counts, float)[..., None]
        overrides[..., OVERRIDE_SD, :] = correction.sd
        return overrides


class _TickRows(NamedTuple):
    """Parts of a tick's memory, with a first axis of one sample.

    Attributes:
        tau_ext: (1, n).
        reading: (1, ...) the reading, then fault and whether tau_ext counts.
        J: (1, 6, n).
        signals: (1, NUM_SIGNALS, n).
        error_rows: (1, JACOBIAN_ROWS + TORQUE_ERROR_ROWS, n) J_seen and rows of the torque error.
    """

    tau_ext: Array
    reading: Array
    J: Array
    signals: Array
    error_rows: Array


def _empty_batch(N: int, n: int, fault: Codes) -> EstimateBatch:
    """Memory for the estimates of N samples of n joints."""
    error = TorqueError.empty(N, n)
    return EstimateBatch(
        tau_ext=np.empty((N, n)),
        wrench=np.empty((N, 6)),
        covariance=np.empty((N, 6, 6)),
        condition_number=np.empty(N),
        invalid=np.empty(N, np.int64),
        J=np.empty((N, 6, n)),
        torque_sd=error.sd,
        transmitted=np.empty((N, n)),
        fresh=np.empty(N, np.bool_),
        fault=fault,
        stiction=error.stiction,
        drift=error.drift,
        J_seen=error.J_seen,
        error_rows=error.rows,
        v=np.empty((N, n)),
        momentum=np.empty((N, n)),
    )
