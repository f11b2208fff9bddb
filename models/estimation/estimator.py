"""The whole chain for one tick or for a log: motor current in, wrench with its uncertainty out.

    current -> tau_J ----------------------------+
    q, v    -> tau_f (friction) -----------------+-> momentum observer -> tau_ext -> wrench at E
    q, v    -> momentum, CTv, G (model), J ------+                             +--- covariance

A tick is one call of one kernel, and a log runs the same kernels: the parts without memory in
parallel over its rows, observer and friction's memory one row after another. Both give the same
numbers. A friction law with load dependence takes the motor torque of the tick before
(`wrenchsight.models.friction.presliding_friction`).
"""

from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.arrays import Array, Flags
from wrenchsight.models.estimation.kernel_choice import kernel_choice
from wrenchsight.models.estimation.tick import (
    GAIN,
    KNOWN_CORRECTION,
    KNOWN_COUNTS,
    KNOWN_TAU_F,
    NUM_READING,
    estimate_tick,
    scratch_size,
    serial_log,
    terms_log,
    trusted_tick,
)
from wrenchsight.models.estimation.trusted_reading import TrustedReading
from wrenchsight.models.estimation.wrench import (
    WrenchReconstruction,
    WrenchReconstructionConfig,
    known_of_wrench,
    live_prior,
)
from wrenchsight.models.estimation.wrench_kernels import reconstruct_log
from wrenchsight.models.friction.friction_law import FrictionLaw
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.observers.observer import (
    NUM_SIGNALS,
    TAU_F,
    TAU_J,
    InformedObserver,
    ModelKnowledge,
    Observer,
)
from wrenchsight.models.observers.observer_kinds import AnyObserverConfig, make_observer
from wrenchsight.models.observers.sample_check import CHECK_ROWS, Codes, SampleCheck, check_sample
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
    check_samples: bool = True  # against what the joints can do: see `sample_check`


class Taught(NamedTuple):
    """What an air pass taught, for one sample or for N of them; see `models.machining.air_pass`.

    Attributes:
        tau_correction: (..., n) N m, added to what the observer reads.
        v_planned: (..., n) rad/s, at which friction without memory is evaluated, as on the air
            pass: the sign of the measured speed of a joint that hardly moves plays no part. A law
            with memory follows the measured motion, through rest and reversal, on both passes.
        counts: (...) 1 where a reading so corrected may be valid, else 0.
    """

    tau_correction: ArrayLike
    v_planned: ArrayLike
    counts: ArrayLike


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

    @property
    def standard_deviation(self) -> Array:
        """(N, 6) of the wrench, N m and N, rotation first."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1)))


class Observation(NamedTuple):
    """What the observer and the friction law see of each of N samples.

    Attributes:
        tau_ext: (N, n) N m.
        tau_J: (N, n) N m, motor torque on the joint side.
        tau_f: (N, n) N m, friction.
        fresh: (N,) see `wrenchsight.models.observers.observer`.
        J: (N, 6, n) rows [angular; linear] at E in axes of W.
    """

    tau_ext: Array
    tau_J: Array
    tau_f: Array
    fresh: Flags
    J: Array


class EstimatorTables(NamedTuple):
    """The constants that the kernels of `models.estimation.tick` read, in their order."""

    chain: Array
    drives: Array
    friction: Array
    slip: Array
    observer: Array
    wrench: Array


class WrenchEstimator:
    """From q, v and motor current to the wrench at E, with one model of one robot.

    A model with a torque error is read by `trusted_reading`: sds of each sample, J as the observer
    saw it, a band that holds lag and scale. Of another one Sigma_tau is the residual covariance,
    at rest and in motion alike. A prior that the configuration leaves open is `live_prior` of the
    robot's payload; `with_prior` puts in another.

    `step` and `run` change `state` in place and may be mixed freely; one estimator serves any
    number of states, from one thread.

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
        self.config = replace(
            config, reconstruction=config.reconstruction.with_prior(*live_prior(robot.payload))
        )
        self.num_joints = n = robot.num_joints
        self.chain = model.chain(robot)
        self.observer = make_observer(self.config.observer, n)
        self.reconstruction = WrenchReconstruction(
            self.config.reconstruction, model.residual_covariance
        )
        resolution = self.config.position_resolution
        if resolution is None and np.isfinite(robot.position_resolution).all():
            resolution = robot.position_resolution.tolist()
        self.friction = model.friction.sampled(self.observer.time_step, resolution)
        reading = self.config.reconstruction.with_live(*live_prior(robot.payload))
        self.knowledge = ModelKnowledge(
            model.torque_error,
            np.sqrt(np.diag(self.reconstruction.torque_covariance)),
            self.friction,
            resolution,
            known_of_wrench(reading),
        )
        if isinstance(self.observer, InformedObserver):
            self.observer = self.observer.informed(self.knowledge)
        self.observed_size = 0 if self.observer.kernels.wrench is None else 42
        self.choice = kernel_choice(self.observer.kernels, self.friction.kernels)
        self.tables = self.tables_of(
            robot.torque_per_ampere, self.friction, self.observer, self.reconstruction
        )
        self.observer_rows = len(self.observer.initial_state())
        self.tick_rows = self.observer_rows + self.friction.state_rows
        self.trusted: TrustedReading | None = None
        if model.torque_error is not None:
            self.trusted = TrustedReading(
                model.torque_error,
                self.friction,
                reading,
                getattr(self.observer, "K_0", None),
                self.observer.time_step,
                resolution,
                self.config.force_bandwidth_hz,
                np.sqrt(np.diag(model.residual_covariance)),
            )
        # What the kernel of `step` is given at each tick, put together once.
        self._constants: list[Any] = [self.choice, *self.tables, self.observer_rows]
        if self.trusted is not None:
            tables = (*self.tables[:-1], *self.trusted.tables)
            self._constants = [self.choice, *tables, self.observer_rows, self.tick_rows]
        more = 0 if self.trusted is None else self.trusted.state_rows
        self.check: SampleCheck | None = None
        if self.config.check_samples:
            self.check = SampleCheck(robot, resolution)
        self._check_from = self.tick_rows + more  # row of the state
        self._state_shape = (self._check_from + (CHECK_ROWS if self.check else 0), n)
        self._sample, self._given = np.empty((3, n)), np.empty((3, n))
        self._scratch = np.empty(scratch_size(n))

    def tables_of(
        self,
        torque_per_ampere: Array,
        friction: FrictionLaw,
        observer: Observer,
        reconstruction: WrenchReconstruction,
    ) -> EstimatorTables:
        """Returns the constants of this estimator with other parts, (n,) N m/A among them."""
        sd = np.sqrt(np.diag(reconstruction.torque_covariance))
        return EstimatorTables(
            np.ascontiguousarray(self.chain.table),
            np.vstack(
                [
                    motor_gain(torque_per_ampere, self.robot.current_sign),
                    sd,
                    *(self.robot.motor_rates if self.robot.is_coupled else ()),
                ]
            ),
            friction.velocity_law.table,
            friction.slip_table,
            observer.table,
            reconstruction.table,
        )

    def with_prior(self, force_sd: float, moment_sd: float) -> Self:
        """Returns an estimator with this prior (N, N m), whatever the configuration said."""
        reconstruction = replace(
            self.config.reconstruction, prior_force_sd=force_sd, prior_moment_sd=moment_sd
        )
        config = replace(self.config, reconstruction=reconstruction)
        return type(self)(self.robot, self.model, config)

    def initial_state(self) -> Array:
        """Returns the state before the first sample: the observer's rows, the friction law's,
        (tick_rows, n) together, then those of the reading that knows the torque error, if any, and
        of the check of samples.
        """
        parts = [self.observer.initial_state(), self.friction.initial_state()]
        if self.trusted is not None:
            parts.append(self.trusted.initial_state())
        if self.check is not None:
            parts.append(self.check.initial_state())
        return np.vstack(parts)

    def step(
        self,
        state: Array,
        q: ArrayLike,
        v: ArrayLike,
        current: ArrayLike,
        *,
        taught: Taught | None = None,
        tau_f: ArrayLike | None = None,
    ) -> TickEstimate:
        """Takes one sample.

        Args:
            state: of `initial_state`, changed in place.
            q, v: (n,) rad and rad/s (m and m/s).
            current: (n,) A, as the drives report it.
            taught, tau_f: as `run`, of this sample.

        Raises:
            ValueError: shapes that disagree.
        """
        n = self.num_joints
        # The kernel reads memory as it was compiled to: shape and layout are settled here.
        if state.shape != self._state_shape:
            raise ValueError(f"state must be {self._state_shape}, not {state.shape}")
        sample, given, fault = self._sample, self._given, 0
        given[0], given[1], given[2] = q, v, current
        if self.check is None:
            sample[:] = given
        else:
            own = state[self._check_from :]
            fault = check_sample(self.check.table, own, self.observer.time_step, given, sample)
        if taught is not None or tau_f is not None:
            known = self._known(taught, tau_f, ())
            sample = np.vstack([sample, known])
            if tau_f is not None:
                sample[2] -= self._current_of(tau_f)
        out = np.empty(n + NUM_READING)
        rest: list[Any] = [state[: self._check_from], sample, out, self._scratch]
        if self.trusted is None:
            estimate_tick(*self._constants, *rest)
        else:
            trusted_tick(*self._constants, *rest)
        return TickEstimate(
            out[:n],
            out[n : n + 6],
            out[n + 6 : n + 42].reshape(6, 6),
            out.item(n + 42),
            out.item(n + 43) == 1.0,
            fault,
        )

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
        q, v, current = (np.require(x, float, ("C", "W")) for x in (q, v, current))
        if not (q.ndim == 2 and q.shape == v.shape == current.shape and q.shape[1] == n):
            raise ValueError(
                f"q, v and current must be (N, {n}), not {q.shape}, {v.shape} and {current.shape}"
            )
        if state.shape != self._state_shape:
            raise ValueError(f"state must be {self._state_shape}, not {state.shape}")
        N = q.shape[0]
        fault = np.zeros(N, np.int64)
        if self.check is not None:
            own, T = state[self._check_from :], self.observer.time_step
            checked, fault = self.check.run(own, q, v, current, T)
            q, v, current = (np.asarray(part, float) for part in checked)
        known = np.empty((N, 0, n))
        if taught is not None or tau_f is not None:
            known = self._known(taught, tau_f, (N,))
            if tau_f is not None:
                current = np.asarray(current - self._current_of(tau_f))
        chain, drives, friction, slip, observer, wrench = self.tables
        tau_ext, J, F = np.empty((N, n)), np.empty((N, 6, n)), np.empty((N, 6))
        covariance, quality, counts = np.empty((N, 6, 6)), np.empty((N, 2)), np.empty(N, np.bool_)
        signals = np.empty((min(N, _PASS), NUM_SIGNALS, n))
        observed = np.empty((min(N, _PASS), self.observed_size))
        torque_sd = np.tile(np.sqrt(np.diag(self.reconstruction.torque_covariance)), (N, 1))
        transmitted = np.empty((N, n))
        for start in range(0, N, _PASS):
            rows = slice(start, min(N, start + _PASS))
            part = signals[: rows.stop - start] if seen is None else seen[rows]
            own = observed[: rows.stop - start]
            terms_log(
                chain,
                drives,
                friction,
                q[rows],
                v[rows],
                current[rows],
                known[rows],
                part,
                J[rows],
            )
            serial_log(
                self.choice,
                slip,
                observer,
                self.observer_rows,
                state[: self.tick_rows],
                known[rows],
                part,
                J[rows],
                tau_ext[rows],
                counts[rows],
                own,
            )
            transmitted[rows] = part[:, TAU_J] - part[:, TAU_F]
            if self.trusted is not None:
                (
                    F[rows],
                    covariance[rows],
                    quality[rows, 0],
                    quality[rows, 1],
                    torque_sd[rows],
                ) = self.trusted.run(
                    state[self.tick_rows : self._check_from],
                    q[rows],
                    v[rows],
                    transmitted[rows],
                    J[rows],
                    tau_ext[rows],
                    counts[rows],
                    own,
                    conditions,
                )
                continue
            ones = np.ones_like(tau_ext[rows])
            reconstruct_log(
                *(wrench, J[rows] if conditions else J[:0], J[rows]),
                *(tau_ext[rows], ones, np.zeros_like(ones)),
                *(F[rows], covariance[rows], quality[rows]),
            )
            if self.observed_size:
                F[rows], covariance[rows] = own[:, :6], own[:, 6:].reshape(-1, 6, 6)
        valid = (quality[:, 1] == 1.0) & counts
        return EstimateBatch(
            *(tau_ext, F, covariance, quality[:, 0], valid, J, torque_sd, transmitted, counts),
            fault,
        )

    def observe(self, q: ArrayLike, v: ArrayLike, current: ArrayLike) -> Observation:
        """The chain of a whole log up to tau_ext, from its start, without a reading of the wrench.

        Args:
            q, v, current: as `run`.
        """
        q, v, current = (np.require(x, float, ("C", "W")) for x in (q, v, current))
        N, n = q.shape
        chain, drives, friction, slip, observer, _ = self.tables
        known, signals = np.empty((N, 0, n)), np.empty((N, NUM_SIGNALS, n))
        J, tau_ext, fresh = np.empty((N, 6, n)), np.empty((N, n)), np.empty(N, np.bool_)
        terms_log(chain, drives, friction, q, v, current, known, signals, J)
        state = np.vstack([self.observer.initial_state(), self.friction.initial_state()])
        serial_log(
            *(self.choice, slip, observer, self.observer_rows, state, known, signals, J),
            *(tau_ext, fresh, np.empty((N, 0))),
        )
        return Observation(tau_ext, signals[:, TAU_J].copy(), signals[:, TAU_F].copy(), fresh, J)

    def _current_of(self, tau_f: ArrayLike) -> Array:
        """The current (..., n) in A that a torque (..., n) in N m on the joints takes."""
        tau_f, robot = np.asarray(tau_f, float), self.robot
        tau_motor = tau_f @ robot.coupling if robot.is_coupled else tau_f
        return np.asarray(tau_motor / self.tables.drives[GAIN])

    def _known(
        self, taught: Taught | None, tau_f: ArrayLike | None, lead: tuple[int, ...]
    ) -> Array:
        """(..., 2 or 3, n): what `models.estimation.tick` is told besides the sample."""
        n = self.num_joints
        if taught is not None and tau_f is not None:
            raise ValueError("taught says which friction is taken: tau_f has no place beside it")
        if taught is not None and self.observed_size:
            raise ValueError("an observer that reads the wrench itself has no use for an air pass")
        remembers = taught is not None and self.friction.state_rows > 0
        known = np.zeros((*lead, 2 if remembers else 3, n))
        known[..., KNOWN_COUNTS, :] = 1.0
        if taught is None:
            shape = np.asarray(tau_f, float).shape
            if shape != (*lead, n):
                raise ValueError(f"tau_f must be {(*lead, n)}, not {shape}")
            return known
        shapes = [np.shape(signal) for signal in taught]
        if shapes != [(*lead, n), (*lead, n), lead]:
            raise ValueError(f"what was taught must be {(*lead, n)} twice and {lead}, not {shapes}")
        if not remembers:
            known[..., KNOWN_TAU_F, :] = self.model.friction.feedforward.torque(taught.v_planned)
        known[..., KNOWN_CORRECTION, :] = taught.tau_correction
        known[..., KNOWN_COUNTS, :] = np.asarray(taught.counts, float)[..., None]
        return known
