"""The whole chain for one tick or for a log: motor current in, wrench with its uncertainty out.

    current -> tau_J ----------------------------+
    q, v    -> tau_f (friction) -----------------+-> momentum observer -> tau_ext -> wrench at E
    q, v    -> momentum, CTv, G (model), J ------+                             +--- covariance

A tick is one call of one kernel, and a log runs the same kernels: the parts without memory in
parallel over its rows, observer and friction's memory one row after another. Both give the same
numbers. A friction law with load dependence takes the motor torque of the tick before
(`models.friction.presliding_friction`).
"""

from dataclasses import dataclass, field, replace
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from models.estimation.kernel_choice import kernel_choice
from models.estimation.momentum_observer import MomentumObserverConfig
from models.estimation.observer import NUM_SIGNALS, Observer
from models.estimation.observers import AnyObserverConfig, make_observer
from models.estimation.tick import NUM_READING, estimate_tick, scratch_size, serial_log, terms_log
from models.estimation.wrench import (
    WrenchReconstruction,
    WrenchReconstructionConfig,
    live_prior,
    reconstruct_log,
)
from models.friction.friction_law import FrictionLaw
from models.identification.identified_model import IdentifiedModel
from models.rigid_body.serial_chain import kernels_are_compiled
from models.robot.motors import motor_gain
from models.robot.robot import Robot

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_PASS = 16384  # rows between two turns of the serial part: bounds the memory of a long log


@dataclass
class WrenchEstimatorConfig:
    """How the estimator filters and what it knows of the wrench beforehand."""

    observer: AnyObserverConfig = field(default_factory=MomentumObserverConfig)
    reconstruction: WrenchReconstructionConfig = field(default_factory=WrenchReconstructionConfig)


class Taught(NamedTuple):
    """What an air pass taught, for one sample or for N of them; see `models.machining.air_pass`.

    Attributes:
        tau_correction: (..., n) N m, added to what the observer reads.
        v_planned: (..., n) rad/s, at which friction is taken, as on the air pass, whatever sign the
            speed of a joint has that all but rests.
        counts: (...) 1 where what is so corrected is to be believed, else 0.
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
    """

    tau_ext: Array
    wrench: Array
    covariance: Array
    condition_number: Array
    valid: Flags
    J: Array

    @property
    def standard_deviation(self) -> Array:
        """(N, 6) of the wrench, N m and N, rotation first."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1)))


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

    Sigma_tau is the model's residual covariance. A prior that the configuration leaves open is
    `live_prior` of the robot's payload; `with_prior` puts in another.

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
        self.choice = kernel_choice(self.observer.kernels, model.friction.kernels)
        self.tables = self.tables_of(
            robot.torque_per_ampere, model.friction, self.observer, self.reconstruction
        )
        self.observer_rows = len(self.observer.initial_state())
        self._state_shape = (self.observer_rows + model.friction.state_rows, n)
        self._sample = np.empty((3, n))
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
            np.stack([motor_gain(torque_per_ampere, self.robot.current_sign), sd]),
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
        """Returns the state before the first sample: the observer's rows, then the friction
        law's, (observer_rows + friction.state_rows, n).
        """
        return np.vstack([self.observer.initial_state(), self.model.friction.initial_state()])

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
        sample = self._sample
        sample[0], sample[1], sample[2] = q, v, current
        if taught is not None or tau_f is not None:
            sample = np.vstack([sample, self._known(taught, tau_f, ())])
        if state.shape != self._state_shape:
            raise ValueError(f"state must be {self._state_shape}, not {state.shape}")
        out = np.empty(n + NUM_READING)
        estimate_tick(
            self.choice,
            *self.tables,
            self.observer_rows,
            state,
            sample,
            out,
            self._scratch,
        )
        return TickEstimate(
            out[:n],
            out[n : n + 6],
            out[n + 6 : n + 42].reshape(6, 6),
            out.item(n + 42),
            out.item(n + 43) == 1.0,
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
    ) -> EstimateBatch:
        """Takes a log, or the next part of one: chunk by chunk gives what one pass gives.

        Args:
            state: of `initial_state`, changed in place.
            q, v: (N, n) rad and rad/s (m and m/s), at the observer's time step.
            current: (N, n) A, as the drives report it.
            taught: by an air pass, sample by sample: friction is then the law's `feedforward` at
                planned speeds, without memory, and tau_ext is corrected.
            tau_f: (N, n) N m, friction known from elsewhere, in the place of the law's.

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
        known = np.empty((N, 0, n))
        if taught is not None or tau_f is not None:
            known = self._known(taught, tau_f, (N,))
        chain, drives, friction, slip, observer, wrench = self.tables
        tau_ext, J, F = np.empty((N, n)), np.empty((N, 6, n)), np.empty((N, 6))
        covariance, quality, counts = np.empty((N, 6, 6)), np.empty((N, 2)), np.empty(N, np.bool_)
        signals = np.empty((min(N, _PASS), NUM_SIGNALS, n))
        for start in range(0, N, _PASS):
            rows = slice(start, min(N, start + _PASS))
            part = signals[: rows.stop - start]
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
                state,
                known[rows],
                part,
                J[rows],
                tau_ext[rows],
                counts[rows],
            )
            reconstruct_log(
                wrench, J[rows], tau_ext[rows], F[rows], covariance[rows], quality[rows]
            )
        valid = (quality[:, 1] == 1.0) & counts
        return EstimateBatch(tau_ext, F, covariance, quality[:, 0], valid, J)

    def _known(
        self, taught: Taught | None, tau_f: ArrayLike | None, lead: tuple[int, ...]
    ) -> Array:
        """(..., 3, n): what `models.estimation.tick` takes in the place of the friction law."""
        n = self.num_joints
        if taught is not None and tau_f is not None:
            raise ValueError("taught says which friction is taken: tau_f has no place beside it")
        correction, counts = np.zeros((*lead, n)), np.ones(lead)
        if taught is not None:
            tau_f = self.model.friction.feedforward.torque(taught.v_planned)
            correction = np.asarray(taught.tau_correction, float)
            counts = np.asarray(taught.counts, float)
        tau_f = np.asarray(tau_f, float)
        if not tau_f.shape == correction.shape == (*lead, n) or counts.shape != lead:
            raise ValueError(
                f"friction and correction must be {(*lead, n)}, counts {lead}, not {tau_f.shape}, "
                f"{correction.shape} and {counts.shape}"
            )
        return np.stack([tau_f, correction, np.repeat(counts[..., None], n, axis=-1)], axis=-2)


def estimator_is_compiled() -> bool:
    """Whether the first estimate comes at once; False announces a wait of some seconds."""
    return kernels_are_compiled(estimate_tick, terms_log, serial_log, reconstruct_log)
