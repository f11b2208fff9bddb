"""The estimation chain over a log, or a tick of it: from motor current to wrench and covariance.

    check     faults of the sample                   `models.observers.sample_check`
    terms     M v, C^T v, G, J                       `models.rigid_body.serial_chain`
    torque    tau_J of the motors                    `models.robot.motors`
    rest      which joints rest                      `models.identification.torque_error_model`
    friction  tau_f                                  `models.friction`
    error     uncertainty of the observer's torque   `models.estimation.torque_error_stage`
    observer  tau_ext                                `models.observers`
    reading   wrench, covariance, invalid            `models.estimation.wrench_reading`

Each stage is a call that takes N samples and its own state: all rows of a log, those of a live
stream that have arrived, or one. So chunks, ticks and a whole log give the same numbers. Stages
without memory take blocks of rows by threads. What a stage needs of another's result for the same
sample comes before it; what it needs of the sample before is in its state. The friction takes the
torque that the gears transmitted at the sample before, and so does the torque error. Which joints
rest depends on the motion alone, and is known before both.
"""

import copy
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.estimation.invalid import InvalidCodes, marked
from wrenchsight.models.estimation.torque_error_stage import (
    TorqueError,
    TorqueErrorStage,
)
from wrenchsight.models.estimation.wrench import (
    WrenchEstimate,
    WrenchReconstructionConfig,
    observer_prior,
)
from wrenchsight.models.estimation.wrench_prior import live_prior
from wrenchsight.models.estimation.wrench_reading import (
    ReadingSamples,
    ReadingState,
    WrenchReading,
    with_unseen_rests,
)
from wrenchsight.models.friction.friction_law import FrictionLaw
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.identification.torque_error_model import (
    REST_ROW,
    ConstantTorqueError,
    TorqueErrorModel,
    take_transmitted,
)
from wrenchsight.models.numerics.arrays import Array, Flags, contiguous
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.observers.observer import (
    TAU_EXT,
    InformedObserver,
    ModelKnowledge,
    Observed,
    Observer,
    ObserverSamples,
)
from wrenchsight.models.observers.observer_kinds import AnyObserverConfig, make_observer
from wrenchsight.models.observers.sample_check import CheckedSamples, Codes, SampleCheck
from wrenchsight.models.observers.signals import signals_of
from wrenchsight.models.robot.arm import Arm
from wrenchsight.models.robot.motors import joint_torque, joint_torque_rows, motor_gain


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

    def with_time_step(self, time_step: float) -> "WrenchEstimatorConfig":
        """Returns a copy at this time step (s)."""
        return replace(self, observer=replace(self.observer, time_step=time_step))


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


class EstimatorState(NamedTuple):
    """What the stages remember of the samples before.

    Attributes:
        check: (CHECK_ROWS, n) of the check of samples; (0, n) without one.
        error: (STAGE_ROWS, n) of the torque error.
        friction: (state_rows, n) of the friction law.
        observer: of the observer.
        reading: of the reading.
    """

    check: Array
    error: Array
    friction: Array
    observer: Any
    reading: ReadingState


class StageMemory(NamedTuple):
    """Arrays that the stages up to the observer write for N samples.

    A log takes new ones. `WrenchEstimator.step` keeps those of its one sample from tick to tick: a
    third of what a tick takes is making arrays and records of them.

    Attributes:
        checked: of the check, q and v among them those of `samples`.
        samples: for the observer; sd, stiction and drift are those of `error`.
        error: of the torque error.
        is_corrected: (N,) ones, where no correction is made.
    """

    checked: CheckedSamples
    samples: ObserverSamples
    error: TorqueError
    is_corrected: Flags

    @classmethod
    def empty(cls, N: int, n: int) -> "StageMemory":
        """Memory for N samples of n joints."""
        checked, error = CheckedSamples.empty(N, n), TorqueError.empty(N, n)
        q, v, _ = checked.signals
        # Each by itself: a batch that keeps the momentum of a long log keeps no other with it.
        momentum, CTv, G, tau_J, tau_f = (np.empty((N, n)) for _ in range(5))
        samples = ObserverSamples(
            q=q,
            v=v,
            momentum=momentum,
            CTv=CTv,
            G=G,
            tau_J=tau_J,
            tau_f=tau_f,
            J=np.empty((N, 6, n)),
            sd=error.sd,
            stiction=error.stiction,
            drift=error.drift,
        )
        return cls(checked, samples, error, np.ones(N, np.bool_))


class TakenSamples(NamedTuple):
    """N samples as the stages up to the observer have left them.

    Attributes:
        samples: checked, with the model's terms and the torques.
        error: uncertainty of the observer's torque.
        observed: of the observer.
        tau_ext: (N, n) N m, with the correction of an air pass.
        is_corrected: (N,) whether that correction holds, or there is none.
        fault: (N,) codes of `models.observers.sample_check`.
    """

    samples: ObserverSamples
    error: TorqueError
    observed: Observed
    tau_ext: Array
    is_corrected: Flags
    fault: Codes

    @property
    def counts(self) -> Flags:
        """(N,) whether tau_ext belongs to its sample, and its correction holds."""
        return np.asarray(self.observed.is_fresh & self.is_corrected)


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
        friction: law, sampled.
        observer: of tau_ext.
        check: of samples; None: they are not checked.
        gain: (n,) N m/A, signed.

    Raises:
        InputError: the model belongs to another robot.
        ValueError: as MomentumObserver and WrenchReconstruction.
    """

    def __init__(
        self, robot: Arm, model: IdentifiedModel, config: WrenchEstimatorConfig | None = None
    ) -> None:
        """Builds the stages in the order in which a sample runs through them.

        The configuration is completed first: priors that it leaves out follow from the payload, the
        resolution of positions from robot.yaml. An observer that uses the model's errors (a Kalman
        observer) is informed of them before the stages that depend on its pole are made. Arguments
        as the class has them.
        """
        self.robot, self.model = robot, model
        self.num_joints = n = robot.num_joints
        self.config = _with_prior(config or WrenchEstimatorConfig(), robot)
        self.chain = model.chain(robot)
        self.resolution = self._position_resolution()
        self.learnt = model.torque_error is not None
        residual_sd = np.sqrt(np.diag(model.residual_covariance))
        error = self._torque_error_model()
        live_config = self.config.reconstruction.with_live(*live_prior(robot.payload))

        uninformed = make_observer(self.config.observer, n)
        T = uninformed.time_step
        self.friction = model.friction.sampled(T, self.resolution)
        # The live prior, whatever `valid` rests on: it says how fast a force may change.
        self.knowledge = ModelKnowledge(
            torque_error=model.torque_error,
            torque_sd=residual_sd,
            rates=np.broadcast_to(error.K_0 if uninformed.pole is None else uninformed.pole, (n,)),
            prior=observer_prior(live_config),
        )
        self.observer: Observer = uninformed
        if isinstance(uninformed, InformedObserver):
            self.observer = uninformed.informed(self.knowledge)
        self.error = TorqueErrorStage(
            error, self.friction, self.observer.pole, T, self.resolution, self.chain
        )
        self.reading = WrenchReading(
            error=error,
            # Only with a learnt torque error does `valid` rest on the live prior.
            config=live_config if self.learnt else self.config.reconstruction,
            K_0=self.observer.pole,
            time_step=T,
            force_bandwidth_hz=self.config.force_bandwidth_hz,
            usual_sd=residual_sd if self.learnt else None,
            torques=robot.joint_torque(np.eye(n)),  # of one ampere in each motor
        )
        self.check: SampleCheck | None = None
        if self.config.check_samples:
            self.check = SampleCheck(robot, self.resolution)
        self.gain = motor_gain(robot.torque_per_ampere, robot.current_sign)
        self._motor_rates = robot.motor_rates if robot.is_coupled else np.zeros((0, n))
        self._period = np.array([T])  # as the check takes it
        self._shapes = _shapes_of(self.initial_state())
        self._checked_state: EstimatorState | None = None  # whose shapes were looked at last
        self._tick = StageMemory.empty(1, n)

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
            self.model.residual_covariance, ranges.v_max or 0.0, ranges.tau_max or 0.0
        )

    def tuned(
        self,
        torque_per_ampere: Array,
        friction: FrictionLaw,
        observer: Observer,
        reading: WrenchReading,
    ) -> Self:
        """Returns the estimator with parts that were changed while it runs; states stay valid.

        The copy shares all other parts, also the `knowledge` that a Kalman observer was informed
        of. Its torque error's stage is made anew, since it depends on friction, observer and
        reading.

        Args:
            torque_per_ampere: (n,) N m/A.
            friction, observer, reading: of the same kinds as the estimator's, the friction sampled.

        Raises:
            ValueError: a gain that is not positive and finite.
        """
        other = copy.copy(self)
        other.gain = motor_gain(torque_per_ampere, self.robot.current_sign)
        other.friction, other.observer, other.reading = friction, observer, reading
        other.error = TorqueErrorStage(
            reading.error,
            friction,
            observer.pole,
            observer.time_step,
            self.resolution,
            self.chain,
        )
        other._tick = StageMemory.empty(1, self.num_joints)
        return other

    def with_prior(self, force_sd: float, moment_sd: float) -> Self:
        """Returns an estimator with this prior (N, N m) in place of the configuration's."""
        reconstruction = replace(
            self.config.reconstruction, prior_force_sd=force_sd, prior_moment_sd=moment_sd
        )
        config = replace(self.config, reconstruction=reconstruction)
        return type(self)(self.robot, self.model, config)

    def initial_state(self) -> EstimatorState:
        """Returns the state before the first sample."""
        no_check = np.empty((0, self.num_joints))
        return EstimatorState(
            check=no_check if self.check is None else self.check.initial_state(),
            error=self.error.initial_state(),
            friction=self.friction.initial_state(),
            observer=self.observer.initial_state(),
            reading=self.reading.initial_state(),
        )

    def step(
        self,
        state: EstimatorState,
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

        Returns:
            The estimate, in arrays of its own.

        Raises:
            ValueError: shapes that disagree.
        """
        signals = [signal[None] for signal in contiguous(q, v, current)]
        if correction is not None:
            correction = Correction(*(np.asarray(part, float)[None] for part in correction))
        self._check_shapes(state, signals, correction, None)
        taken = self._take(state, signals, self._tick, correction)
        reading = self.read(state.reading, taken)
        return TickEstimate(
            taken.tau_ext[0],
            reading.wrench[0],
            reading.covariance[0],
            reading.condition_number.item(),
            reading.invalid.item(),
            taken.fault.item(),
        )

    def run(
        self,
        state: EstimatorState,
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
        taken = self.take(state, q, v, current, correction=correction, tau_f=tau_f)
        reading = self.read(state.reading, taken, conditions)
        samples, error = taken.samples, taken.error
        if signals is not None:
            signals[:] = signals_of(samples)
            signals[:, TAU_EXT] = taken.observed.tau_ext  # without the correction of an air pass
        return EstimateBatch(
            tau_ext=taken.tau_ext,
            wrench=reading.wrench,
            covariance=reading.covariance,
            condition_number=reading.condition_number,
            invalid=reading.invalid,
            J=samples.J,
            torque_sd=error.sd,
            transmitted=samples.tau_J - samples.tau_f,
            fresh=taken.counts,
            fault=taken.fault,
            stiction=error.stiction,
            drift=error.drift,
            J_seen=error.J_seen,
            error_rows=error.rows,
            v=samples.v,
            momentum=samples.momentum,
        )

    def take(
        self,
        state: EstimatorState,
        q: ArrayLike,
        v: ArrayLike,
        current: ArrayLike,
        *,
        correction: Correction | None = None,
        tau_f: ArrayLike | None = None,
        check: bool = True,
    ) -> TakenSamples:
        """The stages of `run` up to the observer: check, model, friction, torque error, observer.

        Args:
            state: of `initial_state`; all but the reading's is changed in place.
            q, v, current: (N, n) rad, rad/s, A.
            correction, tau_f: as `run`, at most one of them.
            check: whether samples are checked, if the configuration says so.

        Returns:
            The observed torque with its error; tau_ext with the correction, where one is known.
        """
        signals = contiguous(q, v, current)
        self._check_shapes(state, signals, correction, tau_f)
        memory = StageMemory.empty(len(signals[0]), self.num_joints)
        known_friction = None if tau_f is None else np.asarray(tau_f, float)
        return self._take(state, signals, memory, correction, known_friction, check)

    def _take(
        self,
        state: EstimatorState,
        signals: Sequence[Array],
        memory: StageMemory,
        correction: Correction | None,
        known_friction: Array | None = None,
        check: bool = True,
    ) -> TakenSamples:
        """`take` of signals and state that have been looked at.

        Args:
            state, correction, check: as `take`.
            signals: q, v and current, (N, n) each, contiguous.
            memory: of N samples, written; the result are arrays of it, but for those that observer
                and correction make.
            known_friction: (N, n) N m, or None.
        """
        q, v, current = signals
        checked, samples = memory.checked, memory.samples
        if check and self.check is not None:
            # Writes `checked`, whose q and v are those of `samples`: NaN what is impossible.
            self.check.run(state.check, q, v, current, self._period, checked)
            current = checked.signals[2]  # behind q and v
        else:
            samples.q[:], samples.v[:] = q, v
            checked.fault.fill(0)
        joint_torque_rows(self.gain, self._motor_rates, current, samples.tau_J)
        return self._stages(
            state, memory, has_current=True, correction=correction, known_friction=known_friction
        )

    def take_motion(
        self, state: EstimatorState, q: Array, v: Array, correction: Correction | None = None
    ) -> TakenSamples:
        """As `take`, of one sample whose current is not known yet.

        For an observer that does not read the present torque: it finds the same tau_ext.

        Args:
            state: changed in place, but not to what it is after the sample: `take_current` makes
                that of it.
            q, v: (1, n) rad and rad/s (m and m/s), contiguous.
            correction: learnt correction of an air pass, for this sample.
        """
        memory = StageMemory.empty(1, self.num_joints)
        (signals, fault), samples = memory.checked, memory.samples
        if self.check is None:
            samples.q[:], samples.v[:], fault[0] = q, v, 0
        else:
            motion, period = signals[:2, 0], self.observer.time_step  # q and v, written
            fault[0] = self.check.motion(state.check, q[0], v[0], period, motion)
        return self._stages(state, memory, has_current=False, correction=correction)

    def take_current(
        self,
        state: EstimatorState,
        state_of_motion: EstimatorState,
        taken: TakenSamples,
        q: Array,
        v: Array,
        current: Array,
    ) -> Array:
        """Completes the sample of a `take_motion`, followed by `read` or not.

        Two states that were equal before the sample are passed: one that has not seen it, in which
        the stages that read the current run now, and the one that `take_motion` has changed, from
        which the other stages' memory is copied.

        Args:
            state: before the sample; changed in place to what it is after.
            state_of_motion: the other one, as `take_motion` and `read` have left it.
            taken: of `take_motion`.
            q, v, current: (1, n) rad and rad/s (m and m/s), A, contiguous; q and v as they were
                passed to `take_motion`.

        Returns:
            (1, n) N m, tau_J, NaN where the current is impossible.
        """
        samples, rows = taken.samples, taken.error.rows
        # The check begins before the sample: `take_motion` has taken q and v alone into the other
        # state's.
        if self.check is not None:
            checked, _ = self.check.run(state.check, q, v, current, self._period)
            current = checked[2]
        tau_J = joint_torque(self.gain, self._motor_rates, current)
        # What the motor torque changes: the memory of the friction, of the torque error's loads
        # and of the observer. Friction and tau_ext of the sample itself are those of `taken`.
        if self.friction.state_rows > 0:
            self.friction.run(state.friction, samples.q, samples.v, tau_J, self._rest(rows))
        state.error[:] = state_of_motion.error
        take_transmitted(state.error, tau_J[0], samples.tau_f[0])
        self.observer.observe(state.observer, samples._replace(tau_J=tau_J))
        for before, after in zip(state.reading, state_of_motion.reading, strict=True):
            before[:] = after
        return tau_J

    def _rest(self, rows: Array) -> Array | None:
        """(N, n) share by which each joint rests, of `TorqueErrorStage.follow`; None: not known."""
        return np.ascontiguousarray(rows[:, REST_ROW]) if self.learnt else None

    def _stages(
        self,
        state: EstimatorState,
        memory: StageMemory,
        *,
        has_current: bool,
        correction: Correction | None,
        known_friction: Array | None = None,
    ) -> TakenSamples:
        """The stages from the terms to the observer, of checked samples.

        Rest follows from the motion (`follow`) and comes before the friction, which depends on it;
        the torque error (`sds`) depends on both.

        Args:
            state: all but the check's and the reading's is changed.
            memory: q, v, with NaN where impossible, fault and, where it is known, tau_J are read;
                all else is written.
            has_current: False of one sample whose current is not known yet. It leaves the torques
                of the sample before in the torque error's state.
            correction: of an air pass, or None.
            known_friction: (N, n) N m, in place of the law's; None: the law's.
        """
        checked, samples, error, is_corrected = memory
        q, v, tau_J, tau_f = samples.q, samples.v, samples.tau_J, samples.tau_f
        self.chain.write_observer_terms(q, v, samples.momentum, samples.CTv, samples.G, samples.J)
        transmitted = tau_J
        if not has_current:
            # What the zeros do to the memory of friction and observer, `take_current` does anew;
            # NaN leaves the torque error's state as it is.
            tau_J.fill(0.0)
            transmitted = np.full_like(tau_J, np.nan)
        self.error.follow(state.error, q, v, error)
        if known_friction is None:
            rest = self._rest(error.rows)
            tau_f[:] = self._friction_torque(state.friction, q, v, tau_J, rest, correction)
        else:  # it is taken off the motor torque: the stages see an arm without friction
            tau_J -= known_friction
            tau_f.fill(0.0)
        # The torque error, which holds what a correction does not know.
        self.error.sds(state.error, q, v, transmitted, tau_f, samples.J, error)
        if correction is not None:
            error.sd[:] = np.sqrt(error.sd**2 + np.square(correction.sd))
        observed = self.observer.observe(state.observer, samples)
        # What an air pass has shown of the observed torque, where it is known.
        tau_ext = observed.tau_ext
        if correction is not None:
            added = np.asarray(correction.tau_correction, float)
            is_known = np.isfinite(added)
            tau_ext = tau_ext + np.where(is_known, added, 0.0)
            is_corrected = is_known.all(axis=1) & (np.asarray(correction.counts) == 1.0)
        return TakenSamples(samples, error, observed, tau_ext, is_corrected, checked.fault)

    def checked_torque(self, check_state: Array, current: Array) -> Array:
        """tau_J (N, n) of currents (N, n) in A, NaN where one is impossible; q and v are not read.

        Args:
            check_state: of EstimatorState; changed.
            current: successive samples.
        """
        if self.check is not None:
            unread, period = np.zeros_like(current), self.observer.time_step
            (_, _, current), _ = self.check.run(check_state, unread, unread, current, period)
        return joint_torque(self.gain, self._motor_rates, current)

    def read(
        self, state: ReadingState, taken: TakenSamples, conditions: bool = True
    ) -> WrenchEstimate:
        """The last stage of `run`: the wrench of samples that `take` has taken.

        It is not valid where a joint that rested in no log of the model rests beyond friction.
        """
        samples, observed = taken.samples, taken.observed
        reading_samples = ReadingSamples(
            J=samples.J,
            tau_ext=taken.tau_ext,
            is_fresh=observed.is_fresh,
            q=samples.q,
            v=samples.v,
            is_corrected=taken.is_corrected,
            fault=taken.fault,
            wrench=observed.wrench,
            covariance=observed.covariance,
        )
        reading = self.reading.run(state, taken.error, reading_samples, conditions)
        if not self.error.may_rest_unseen:
            return reading
        return with_unseen_rests(reading, self.error.table, taken.error.rows, taken.tau_ext)

    def _friction_torque(
        self,
        friction_state: Array,
        q: Array,
        v: Array,
        tau_J: Array,
        rest: Array | None,
        correction: Correction | None,
    ) -> Array:
        """tau_f (N, n) by the law, which is told what rests (`_rest`); its state is changed.

        A law without memory is taken at the planned speed where an air pass has a correction.
        """
        if correction is not None and self.friction.is_of_speed_alone:
            return self.friction.feedforward.torque(correction.v_planned)
        return self.friction.run(friction_state, q, v, tau_J, rest)

    def _check_shapes(
        self,
        state: EstimatorState,
        signals: Sequence[Array],
        correction: Correction | None,
        tau_f: ArrayLike | None,
    ) -> None:
        """Refuses what the kernels, which trust shapes, cannot take.

        Args:
            state, correction, tau_f: as `run`.
            signals: q, v and current.

        Raises:
            ValueError: shapes that disagree; a state of another estimator; correction and tau_f
                together; a correction beside an observer that reads the wrench itself.
        """
        n, (q, v, current) = self.num_joints, signals
        if not (q.ndim == 2 and q.shape == v.shape == current.shape and q.shape[1] == n):
            raise ValueError(
                f"q, v and current must be (N, {n}), not {q.shape}, {v.shape} and {current.shape}"
            )
        if state is not self._checked_state:  # a tick comes with the same one each time
            if _shapes_of(state) != self._shapes:
                raise ValueError("state must be of this estimator's initial_state")
            self._checked_state = state
        N = len(q)
        if correction is not None and tau_f is not None:
            raise ValueError(
                "an air pass determines the friction already; pass correction or tau_f"
            )
        if tau_f is not None and np.shape(tau_f) != (N, n):
            raise ValueError(f"tau_f must be {(N, n)}, not {np.shape(tau_f)}")
        if correction is None:
            return
        if self.observer.reads_wrench:
            raise ValueError(
                "an observer that reads the wrench itself takes no correction of an air pass"
            )
        # The sd is left out: it may be one number, and is broadcast.
        by_sample = (correction.tau_correction, correction.v_planned, correction.counts)
        shapes = [np.shape(part) for part in by_sample]
        if shapes != [(N, n), (N, n), (N,)]:
            raise ValueError(
                "tau_correction, v_planned and counts of an air pass must be "
                f"{(N, n)}, {(N, n)} and {(N,)}, not {shapes}"
            )

    def observe(self, q: ArrayLike, v: ArrayLike, current: ArrayLike) -> Observation:
        """Runs a whole log up to tau_ext, from the initial state, without check and reading.

        Args:
            q, v, current: as `run`.
        """
        taken = self.take(self.initial_state(), q, v, current, check=False)
        samples = taken.samples
        return Observation(
            taken.tau_ext, samples.tau_J, samples.tau_f, taken.counts, samples.J, taken.error
        )


def _with_prior(config: WrenchEstimatorConfig, robot: Arm) -> WrenchEstimatorConfig:
    """The configuration, with the prior of the robot's payload where it states none."""
    reconstruction = config.reconstruction.with_prior(*live_prior(robot.payload))
    if reconstruction is config.reconstruction:
        return config
    return replace(config, reconstruction=reconstruction)


def _shapes_of(state: EstimatorState) -> tuple[tuple[int, ...], ...]:
    """The shapes of the parts of a state that differ between estimators."""
    check, error, friction, observer, _ = state
    shapes = (check.shape, error.shape, friction.shape)
    if isinstance(observer, tuple):
        return *shapes, *(part.shape for part in observer)
    return *shapes, observer.shape
