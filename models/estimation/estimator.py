"""The whole chain for one tick or for a log: motor current in, wrench with its uncertainty out.

    current -> tau_J ----------------------------+
    q, v    -> tau_f (friction) -----------------+-> momentum observer -> tau_ext -> wrench at E
    q, v    -> momentum, CTv, G (model), J ------+                             +--- covariance

A tick is one call of one kernel, and a log runs the same stages
(`wrenchsight.models.estimation.tick`): those without memory in parallel over its rows, the others
one row after another. Both give the same numbers. A friction law with load dependence takes the
motor torque of the tick before (`wrenchsight.models.friction.presliding_friction`).
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
from wrenchsight.models.estimation.kernel_choice import kernel_choice
from wrenchsight.models.estimation.tick import (
    KNOWN_CORRECTION,
    KNOWN_COUNTS,
    KNOWN_SD,
    KNOWN_TAU_F,
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
    known_of_wrench,
    live_prior,
)
from wrenchsight.models.estimation.wrench_reading import OBSERVED, READING, WrenchReading
from wrenchsight.models.friction.friction_law import FrictionLaw
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.identification.torque_error_model import (
    TORQUE_ERROR_ROWS,
    ConstantTorqueError,
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
    V,
)
from wrenchsight.models.observers.observer_kinds import AnyObserverConfig, make_observer
from wrenchsight.models.observers.sample_check import BEYOND, Codes, SampleCheck
from wrenchsight.models.robot.motors import motor_gain
from wrenchsight.models.robot.robot import Robot

_PASS = 16384  # rows between two turns of the serial part: bounds the memory of a long log


@dataclass
class WrenchEstimatorConfig:
    """How the estimator filters and what it knows of the wrench beforehand."""

    observer: AnyObserverConfig = field(default_factory=MomentumObserverConfig)
    reconstruction: WrenchReconstructionConfig = field(default_factory=WrenchReconstructionConfig)
    force_bandwidth_hz: float = 3.0  # Hz, up to which the band covers the observer's lag
    position_resolution: list[float] | None = None
    # rad, per joint; None: what robot.yaml says of all joints, else the model
    check_samples: bool = True  # flag samples that no joint can have done


class Taught(NamedTuple):
    """What an air pass taught, for one sample or for N of them; see `models.machining.air_pass`.

    Attributes:
        tau_correction: (..., n) N m, added to what the observer reads.
        v_planned: (..., n) rad/s, at which friction without memory is evaluated, as on the air
            pass: the sign of the measured speed of a joint that hardly moves plays no part. A law
            with memory follows the measured motion, through rest and reversal, on both passes.
        counts: (...) 1 where a reading so corrected may be valid, else 0.
        sd: (..., n) N m, of the correction, beyond the model's torque error; a number stands for
            all.
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
    valid: bool
    fault: int = 0


class EstimateBatch(NamedTuple):
    """The estimates right after each of N samples.

    Attributes:
        tau_ext: (N, n) N m, positive along the motion it causes.
        wrench: (N, 6) F_E_W = [mx my mz fx fy fz] in N m and N: exerted by the environment on the
            robot, at E, in axes of W.
        covariance: (N, 6, 6) of the wrench.
        condition_number: (N,) of J in m and rad.
        valid: (N,) as `models.estimation.wrench.WrenchEstimate`; also False where the sample or the
            one before it was not finite, so that tau_ext is held.
        J: (N, 6, n) rows [angular; linear] at E in axes of W.
        torque_sd: (N, n) N m, of tau_ext where nothing touches the arm.
        transmitted: (N, n) N m, what the gears transmit: motor torque less friction; empty where
            it is not kept.
        fresh: (N,) whether tau_ext is of the sample; empty where it is not kept.
        fault: (N,) what is wrong with q and v of the sample, and with the current of the one
            before: a sum of BEYOND, DISAGREES and FROZEN of `models.observers.sample_check`, or 0.
            Such a sample counts as one that is not finite. Empty where it is not kept.
        stiction, drift, J_seen, error_rows: of `torque_error`; empty where it is not kept.
        v, momentum: (N, n) rad/s and kg m^2/s, as checked; empty where they are not kept.
    """

    tau_ext: Array
    wrench: Array
    covariance: Array
    condition_number: Array
    valid: Flags
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
    def torque_error(self) -> TorqueError:
        """How far the observer may be off at each sample."""
        return TorqueError(self.torque_sd, self.stiction, self.drift, self.J_seen, self.error_rows)

    @property
    def standard_deviation(self) -> Array:
        """(N, 6) of the wrench, N m and N, rotation first."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1)))

    def rows(self, rows: slice | Flags) -> "EstimateBatch":
        """Some of the samples."""
        columns: Any = (column[rows] for column in self)
        return EstimateBatch(*columns)

    @staticmethod
    def joined(batches: Sequence["EstimateBatch"]) -> "EstimateBatch":
        """One after another."""
        if len(batches) == 1:
            return batches[0]
        columns: Any = zip(*batches, strict=True)
        return EstimateBatch(*(np.concatenate(column) for column in columns))


class Observation(NamedTuple):
    """What the observer and the friction law see of each of N samples.

    Attributes:
        tau_ext: (N, n) N m.
        tau_J: (N, n) N m, motor torque on the joint side.
        tau_f: (N, n) N m, friction.
        fresh: (N,) see `wrenchsight.models.observers.observer`.
        J: (N, 6, n) rows [angular; linear] at E in axes of W.
        torque_error: how far the observer may be off.
    """

    tau_ext: Array
    tau_J: Array
    tau_f: Array
    fresh: Flags
    J: Array
    torque_error: TorqueError

    @property
    def transmitted(self) -> Array:
        """(N, n) N m, what the gears transmit."""
        return np.asarray(self.tau_J - self.tau_f)


class WrenchEstimator:
    """From q, v and motor current to the wrench at E, with one model of one robot.

    A model with a torque error is read with sds of each sample, J as the observer saw it, and a
    band that holds lag and scale; Sigma_tau of another one is the residual covariance, at rest and
    in motion alike (`wrench_reading`). A prior that the configuration leaves open is `live_prior`
    of the robot's payload; `with_prior` puts in another.

    `step` and `run` change `state` in place and may be mixed freely; one estimator serves any
    number of states, from one thread.

    Attributes:
        error: of the torque, as a stage.
        reading: of the wrench.
        packed: the constants of `wrenchsight.models.estimation.tick`.

    Raises:
        InputError: the model belongs to another robot.
        ValueError: as MomentumObserver and WrenchReconstruction.
    """

    def __init__(
        self, robot: Robot, model: IdentifiedModel, config: WrenchEstimatorConfig | None = None
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
        resolution = self.config.position_resolution
        if resolution is None and np.isfinite(robot.position_resolution).all():
            resolution = robot.position_resolution.tolist()
        self.resolution = resolution
        T = self.observer.time_step
        self.friction = model.friction.sampled(T, resolution)
        self.learnt = model.torque_error is not None
        covariance, ranges = self.reconstruction.torque_covariance, model.validity
        error = model.torque_error or ConstantTorqueError.of(
            covariance, ranges.v_max or 0.0, ranges.tau_max or 0.0
        )
        reading = self.config.reconstruction.with_live(*live_prior(robot.payload))
        rates = self.observer.pole
        self.knowledge = ModelKnowledge(
            model.torque_error,
            np.sqrt(np.diag(covariance)),
            np.broadcast_to(error.K_0 if rates is None else rates, (n,)),
            known_of_wrench(reading),
        )
        if isinstance(self.observer, InformedObserver):
            self.observer = self.observer.informed(self.knowledge)
        own = self.friction, self.observer.pole, T, resolution, self.chain
        self.error = TorqueErrorStage(error, *own)
        self.reading = WrenchReading(
            error,
            reading if self.learnt else self.config.reconstruction,
            self.observer.pole,
            T,
            self.config.force_bandwidth_hz,
            np.sqrt(np.diag(model.residual_covariance)) if self.learnt else None,
            robot.joint_torque(np.eye(n)),
        )
        self.observed_size = 0 if self.observer.kernels.wrench is None else OBSERVED
        self.choice = kernel_choice(self.observer.kernels, self.friction.kernels)
        self.check: SampleCheck | None = None
        if self.config.check_samples:
            self.check = SampleCheck(robot, resolution)
        self.packed = self.packed_with(
            robot.torque_per_ampere, self.friction, self.observer, self.reading
        )
        rows = len(self.observer.initial_state()), self.friction.state_rows
        self._state_shape = (state_size(n, *rows),)
        self._out_size = sum(tick_sizes(n).values())
        J = n + READING + 2
        signals, seen = J + 6 * n, J + (6 + NUM_SIGNALS) * n
        end = seen + (JACOBIAN_ROWS + TORQUE_ERROR_ROWS) * n
        self._columns = slice(J, signals), slice(signals, seen), slice(seen, end)
        self._sample = np.empty((3, n))
        self._nothing = np.empty((0, n))
        self._scratch = np.empty(workspace_size(n))

    def packed_with(
        self,
        torque_per_ampere: Array,
        friction: FrictionLaw,
        observer: Observer,
        reading: WrenchReading,
    ) -> Packed:
        """Returns the constants of this estimator with other parts, (n,) N m/A among them."""
        robot = self.robot
        period = self.observer.time_step
        own = friction, observer.pole, period, self.resolution, self.chain
        error = TorqueErrorStage(reading.error, *own)
        gain = motor_gain(torque_per_ampere, robot.current_sign)
        parameters = Parameters(
            chain=self.chain.table,
            drives=np.vstack([gain, *(robot.motor_rates if robot.is_coupled else ())]),
            friction=friction.velocity_law.table,
            slip=friction.slip_table,
            error=error.table,
            poles=error.poles,
            **dict(
                zip(
                    ("read_load", "lag", "explained", "faults", "wrench"),
                    reading.tables,
                    strict=True,
                )
            ),
            check=np.empty((0, self.num_joints)) if self.check is None else self.check.table,
            period=np.array([period]),
        )
        rows = len(observer.initial_state()), friction.state_rows
        return packed(parameters, observer.table, *rows)

    def with_prior(self, force_sd: float, moment_sd: float) -> Self:
        """Returns an estimator with this prior (N, N m), whatever the configuration said."""
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
        taught: Taught | None = None,
    ) -> TickEstimate:
        """Takes one sample.

        Args:
            state: of `initial_state`, changed in place.
            q, v: (n,) rad and rad/s (m and m/s).
            current: (n,) A, as the drives report it.
            taught: as `run`, of this sample.

        Raises:
            ValueError: shapes that disagree.
        """
        n, out = self.num_joints, np.empty(self._out_size)
        self._check_state(state)
        sample, known = self._sample, self._nothing
        sample[0], sample[1], sample[2] = q, v, current
        if taught is not None:
            known = self._known(taught, None, ())
        estimate_tick(self.choice, *self.packed, state, sample, known, out, self._scratch)
        return TickEstimate(
            out[:n],
            out[n : n + 6],
            out[n + 6 : n + 42].reshape(6, 6),
            out.item(n + 42),
            out.item(n + 43) == 1.0,
            int(out.item(n + READING)),
        )

    def _check_state(self, state: Array) -> None:
        """A kernel reads memory as it was compiled to: shape and layout are settled here."""
        if state.shape != self._state_shape or not state.flags.c_contiguous:
            raise ValueError(f"state must be {self._state_shape} contiguous, not {state.shape}")

    def run(
        self,
        state: Array,
        q: ArrayLike,
        v: ArrayLike,
        current: ArrayLike,
        *,
        taught: Taught | None = None,
        tau_f: ArrayLike | None = None,
        seen: Array | None = None,
        conditions: bool = True,
    ) -> EstimateBatch:
        """Takes a log, or the next part of one: chunk by chunk gives what one pass gives.

        Args:
            state: of `initial_state`, changed in place.
            q, v: (N, n) rad and rad/s (m and m/s), at the observer's time step.
            current: (N, n) A, as the drives report it.
            taught: by an air pass, sample by sample: tau_ext is corrected, and friction without
                memory is taken at planned speeds.
            tau_f: (N, n) N m, friction known from elsewhere, in the place of the law's: it is taken
                off the motor torque, sample by sample.
            seen: (N, NUM_SIGNALS, n), written: the signals of the samples, rows as in
                `wrenchsight.models.observers.observer`.
            conditions: whether condition numbers are wanted; NaN where not.

        Raises:
            ValueError: shapes that disagree; taught and tau_f together.
        """
        n = self.num_joints
        q, v, current = contiguous(q, v, current)
        if not (q.ndim == 2 and q.shape == v.shape == current.shape and q.shape[1] == n):
            raise ValueError(
                f"q, v and current must be (N, {n}), not {q.shape}, {v.shape} and {current.shape}"
            )
        self._check_state(state)
        N = q.shape[0]
        known = np.empty((N, 0, n))
        if taught is not None or tau_f is not None:
            known = self._known(taught, tau_f, (N,))
        if N == 1 and tau_f is None and seen is None:
            return self._run_one(state, q, v, current, known[0])
        parts = self.parts(state)
        fault = np.zeros(N, np.int64)
        if self.check is not None:
            checked, fault = self.check.run(parts.check, q, v, current, self.observer.time_step)
            q, v, current = (np.asarray(part, float) for part in checked)
        if tau_f is not None:
            current = np.asarray(current - self._current_of(tau_f))
        tau_ext, J, F = np.empty((N, n)), np.empty((N, 6, n)), np.empty((N, 6))
        covariance, condition = np.empty((N, 6, 6)), np.empty(N)
        valid, counts = np.empty(N, np.bool_), np.empty(N, np.bool_)
        transmitted, momentum, speed = np.empty((3, N, n))
        error = TorqueError.empty(N, n)
        signals = np.empty((min(N, _PASS), NUM_SIGNALS, n))
        observed = np.empty((min(N, _PASS), self.observed_size))
        for start in range(0, N, _PASS):
            rows = slice(start, min(N, start + _PASS))
            part = signals[: rows.stop - start] if seen is None else seen[rows]
            own = observed[: rows.stop - start]
            now = TorqueError(*(x[rows] for x in error))
            terms_log(self.packed, q[rows], v[rows], current[rows], known[rows], part, J[rows])
            memory_log(
                self.choice,
                self.packed,
                state,
                known[rows],
                part,
                J[rows],
                now,
                tau_ext[rows],
                counts[rows],
                own,
            )
            transmitted[rows] = part[:, TAU_J] - part[:, TAU_F]
            momentum[rows], speed[rows] = part[:, MOMENTUM], part[:, V]
            F[rows], covariance[rows], condition[rows], valid[rows] = self.reading.run(
                parts.reading,
                now,
                J[rows],
                tau_ext[rows],
                counts[rows],
                fault[rows] & BEYOND != 0,
                own,
                conditions,
            )
        return EstimateBatch(
            tau_ext,
            F,
            covariance,
            condition,
            valid,
            J,
            error.sd,
            transmitted,
            counts,
            fault,
            *error[1:],
            speed,
            momentum,
        )

    def _run_one(
        self, state: Array, q: Array, v: Array, current: Array, known: Array
    ) -> EstimateBatch:
        """`run` of one sample (1, n): one call of a kernel."""
        n, out, sample = self.num_joints, np.empty(self._out_size), self._sample
        sample[0], sample[1], sample[2] = q[0], v[0], current[0]
        estimate_tick(self.choice, *self.packed, state, sample, known, out, self._scratch)
        own, (J, signals, rest) = out[None], self._columns
        rows = own[:, signals].reshape(1, NUM_SIGNALS, n)
        reading = own[:, n:]
        seen = own[:, rest].reshape(1, -1, n)
        return EstimateBatch(
            tau_ext=own[:, :n],
            wrench=reading[:, :6],
            covariance=reading[:, 6:42].reshape(1, 6, 6),
            condition_number=reading[:, 42],
            valid=reading[:, 43] == 1.0,
            J=own[:, J].reshape(1, 6, n),
            torque_sd=rows[:, TORQUE_SD],
            transmitted=rows[:, TAU_J] - rows[:, TAU_F],
            fresh=reading[:, READING + 1] == 1.0,
            fault=reading[:, READING].astype(np.int64),
            stiction=rows[:, STICTION],
            drift=rows[:, DRIFT],
            J_seen=seen[:, :JACOBIAN_ROWS],
            error_rows=seen[:, JACOBIAN_ROWS:],
            v=rows[:, V],
            momentum=rows[:, MOMENTUM],
        )

    def observe(self, q: ArrayLike, v: ArrayLike, current: ArrayLike) -> Observation:
        """The chain of a whole log up to tau_ext, from its start, without a reading of the wrench.

        Args:
            q, v, current: as `run`.
        """
        q, v, current = contiguous(q, v, current)
        N, n = q.shape
        known, signals = np.empty((N, 0, n)), np.empty((N, NUM_SIGNALS, n))
        J, tau_ext, fresh = np.empty((N, 6, n)), np.empty((N, n)), np.empty(N, np.bool_)
        error = TorqueError.empty(N, n)
        terms_log(self.packed, q, v, current, known, signals, J)
        memory_log(
            self.choice,
            self.packed,
            self.initial_state(),
            known,
            signals,
            J,
            error,
            tau_ext,
            fresh,
            np.empty((N, 0)),
        )
        tau_J, tau_f = signals[:, TAU_J].copy(), signals[:, TAU_F].copy()
        return Observation(tau_ext, tau_J, tau_f, fresh, J, error)

    def _current_of(self, tau_f: ArrayLike) -> Array:
        """The current (..., n) in A that a torque (..., n) in N m on the joints takes."""
        tau_f, robot = np.asarray(tau_f, float), self.robot
        tau_motor = tau_f @ robot.coupling if robot.is_coupled else tau_f
        gain = motor_gain(robot.torque_per_ampere, robot.current_sign)
        return np.asarray(tau_motor / gain)

    def _known(
        self, taught: Taught | None, tau_f: ArrayLike | None, lead: tuple[int, ...]
    ) -> Array:
        """(..., 3 or 4, n): what `models.estimation.tick` is told besides the sample."""
        n = self.num_joints
        if taught is not None and tau_f is not None:
            raise ValueError("taught says which friction is taken: tau_f has no place beside it")
        if taught is not None and self.observed_size:
            raise ValueError("an observer that reads the wrench itself has no use for an air pass")
        remembers = taught is not None and self.friction.state_rows > 0
        known = np.zeros((*lead, KNOWN_TAU_F if remembers else KNOWN_TAU_F + 1, n))
        known[..., KNOWN_COUNTS, :] = 1.0
        if taught is None:
            shape = np.asarray(tau_f, float).shape
            if shape != (*lead, n):
                raise ValueError(f"tau_f must be {(*lead, n)}, not {shape}")
            return known
        shapes = [np.shape(signal) for signal in taught[:3]]
        if shapes != [(*lead, n), (*lead, n), lead]:
            raise ValueError(f"what was taught must be {(*lead, n)} twice and {lead}, not {shapes}")
        if not remembers:
            known[..., KNOWN_TAU_F, :] = self.model.friction.feedforward.torque(taught.v_planned)
        known[..., KNOWN_CORRECTION, :] = taught.tau_correction
        known[..., KNOWN_COUNTS, :] = np.asarray(taught.counts, float)[..., None]
        known[..., KNOWN_SD, :] = taught.sd
        return known
