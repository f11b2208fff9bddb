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
from numba import njit, prange
from numpy.typing import ArrayLike, NDArray

from models.estimation.momentum_observer import (
    STATE_ROWS,
    MomentumObserver,
    MomentumObserverConfig,
    observer_step,
)
from models.estimation.wrench import (
    WrenchReconstruction,
    WrenchReconstructionConfig,
    live_prior,
    reconstruct,
    reconstruct_log,
)
from models.friction.presliding_friction import add_slip_torque, initial_friction_state, update_slip
from models.friction.velocity_friction import friction_torque
from models.identification.identified_model import IdentifiedModel
from models.rigid_body.serial_chain import SCRATCH_COLUMNS, kernels_are_compiled, observer_terms
from models.robot.motors import motor_gain, motor_torque
from models.robot.robot import Robot

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_OBSERVER_ROWS = STATE_ROWS  # of the state; the friction law's follow
_BLOCK = 256  # rows a thread takes at a time
_PASS = 16384  # rows between two turns of the serial part: bounds the memory of a long log


@dataclass
class WrenchEstimatorConfig:
    """How the estimator filters and what it knows of the wrench beforehand."""

    observer: MomentumObserverConfig = field(default_factory=MomentumObserverConfig)
    reconstruction: WrenchReconstructionConfig = field(default_factory=WrenchReconstructionConfig)


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
        self.observer = MomentumObserver(self.config.observer, n)
        self.reconstruction = WrenchReconstruction(
            self.config.reconstruction, model.residual_covariance
        )
        self._tables = (
            np.ascontiguousarray(self.chain.table),
            motor_gain(robot.torque_per_ampere, robot.current_sign),
            model.friction.velocity_law.table,
            model.friction.slip_table,
            self.observer.table,
            self.reconstruction.table,
        )
        self._state_shape = (_OBSERVER_ROWS + model.friction.state_rows, n)
        self._sample = np.empty((3, n))
        self._scratch = (
            np.empty((5, n)),
            np.empty((6, n)),
            np.empty((4, 3)),
            np.empty((n, SCRATCH_COLUMNS)),
            self.reconstruction.scratch(),
        )

    def with_prior(self, force_sd: float, moment_sd: float) -> Self:
        """Returns an estimator with this prior (N, N m), whatever the configuration said."""
        reconstruction = replace(
            self.config.reconstruction, prior_force_sd=force_sd, prior_moment_sd=moment_sd
        )
        config = replace(self.config, reconstruction=reconstruction)
        return type(self)(self.robot, self.model, config)

    def initial_state(self) -> Array:
        """Returns the (3 + friction.state_rows, n) state before the first sample: the observer's
        three rows, then the friction law's.
        """
        return np.vstack(
            [self.observer.initial_state(), initial_friction_state(self.model.friction)]
        )

    def step(self, state: Array, q: ArrayLike, v: ArrayLike, current: ArrayLike) -> TickEstimate:
        """Takes one sample.

        Args:
            state: of `initial_state`, changed in place.
            q, v: (n,) rad and rad/s (m and m/s).
            current: (n,) A, as the drives report it.

        Raises:
            ValueError: shapes that disagree.
        """
        n = self.num_joints
        # The kernel reads memory as it was compiled to: shape and layout are settled here.
        sample = self._sample
        sample[0], sample[1], sample[2] = q, v, current
        if state.shape != self._state_shape:
            raise ValueError(f"state must be {self._state_shape}, not {state.shape}")
        out = np.empty(n + 44)
        estimate_tick(*self._tables, state, sample, out, *self._scratch)
        return TickEstimate(
            out[:n],
            out[n : n + 6],
            out[n + 6 : n + 42].reshape(6, 6),
            float(out[n + 42]),
            out[n + 43] == 1.0,
        )

    def run(self, state: Array, q: ArrayLike, v: ArrayLike, current: ArrayLike) -> EstimateBatch:
        """Takes a log, or the next part of one: chunk by chunk gives what one pass gives.

        Args:
            state: of `initial_state`, changed in place.
            q, v: (N, n) rad and rad/s (m and m/s), at the observer's time step.
            current: (N, n) A, as the drives report it.

        Raises:
            ValueError: shapes that disagree.
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
        chain, gain, friction, slip, observer, wrench = self._tables
        tau_ext, J, F = np.empty((N, n)), np.empty((N, 6, n)), np.empty((N, 6))
        covariance, quality, fresh = np.empty((N, 6, 6)), np.empty((N, 2)), np.empty(N, np.bool_)
        signals = np.empty((5, min(N, _PASS), n))
        for start in range(0, N, _PASS):
            rows = slice(start, min(N, start + _PASS))
            part = signals[:, : rows.stop - start]
            _terms_log(chain, gain, friction, q[rows], v[rows], current[rows], *part, J[rows])
            _serial_log(slip, observer, state, q[rows], v[rows], *part, tau_ext[rows], fresh[rows])
            reconstruct_log(
                wrench, J[rows], tau_ext[rows], F[rows], covariance[rows], quality[rows]
            )
        valid = (quality[:, 1] == 1.0) & fresh
        return EstimateBatch(tau_ext, F, covariance, quality[:, 0], valid, J)


def estimator_is_compiled() -> bool:
    """Whether the first estimate comes at once; False announces a wait of some seconds."""
    return kernels_are_compiled(estimate_tick, _terms_log, _serial_log, reconstruct_log)


@njit(cache=True, error_model="numpy")
def _signals(chain, gain, friction, q, v, current, momentum, CTv, G, tau_J, tau_f, J, X, scratch):  # type: ignore[no-untyped-def]
    """What one sample says without memory, before the observer: (n,) each, and J (6, n)."""
    observer_terms(chain, q, v, momentum, CTv, G, J, X[:3], X[3], scratch)
    motor_torque(gain, current, tau_J)
    friction_torque(friction, v, tau_f)


@njit(cache=True, error_model="numpy")
def _with_memory(  # type: ignore[no-untyped-def]
    slip, observer, state, q, v, momentum, CTv, G, tau_J, tau_f, tau_ext
):
    """The parts with memory for one sample; tau_f holds the velocity law's torque before.

    Returns:
        Whether tau_ext is fresh, see `observer_output`.
    """
    own = state[_OBSERVER_ROWS:]
    add_slip_torque(slip, own, q, v, tau_f)
    fresh = observer_step(observer, state[:_OBSERVER_ROWS], momentum, CTv, G, tau_J, tau_f, tau_ext)
    if own.shape[0] > 0:
        update_slip(slip, own, q, v, tau_J - tau_f)
    return fresh


@njit(cache=True, error_model="numpy")
def _serial_log(  # type: ignore[no-untyped-def]
    slip, observer, state, q, v, momentum, CTv, G, tau_J, tau_f, tau_ext, fresh
):
    for k in range(q.shape[0]):
        fresh[k] = _with_memory(
            slip,
            observer,
            state,
            q[k],
            v[k],
            momentum[k],
            CTv[k],
            G[k],
            tau_J[k],
            tau_f[k],
            tau_ext[k],
        )


@njit(cache=True, error_model="numpy")
def estimate_tick(  # type: ignore[no-untyped-def]
    chain,
    gain,
    friction,
    slip,
    observer,
    wrench,
    state,
    sample,
    out,
    signals,
    J,
    X,
    scratch,
    work,
):
    """The chain for one sample.

    Args:
        chain: SerialChain.table.
        gain: (n,) N m/A, signed.
        friction: table of the friction law's velocity_law.
        slip: FrictionLaw.slip_table.
        observer: MomentumObserver.table.
        wrench: WrenchReconstruction.table.
        state: (3, n), changed.
        sample: (3, n) q, v, current.
        out: (n + 44,), written: tau_ext, wrench, covariance, condition number, valid.
        signals: (5, n), scratch.
        J: (6, n), written.
        X: (4, 3), written: R_WE, p_WE.
        scratch, work: scratch of the chain and of the reconstruction.
    """
    n = sample.shape[1]
    q, v, current = sample[0], sample[1], sample[2]
    momentum, CTv, G, tau_J, tau_f = signals[0], signals[1], signals[2], signals[3], signals[4]
    _signals(chain, gain, friction, q, v, current, momentum, CTv, G, tau_J, tau_f, J, X, scratch)
    tau_ext, F = out[:n], out[n : n + 6]
    covariance, quality = out[n + 6 : n + 42].reshape(6, 6), out[n + 42 :]
    fresh = _with_memory(slip, observer, state, q, v, momentum, CTv, G, tau_J, tau_f, tau_ext)
    reconstruct(wrench, J, tau_ext, F, covariance, quality, work)
    if not fresh:
        quality[1] = 0.0


@njit(cache=True, error_model="numpy", parallel=True)
def _terms_log(chain, gain, friction, q, v, current, momentum, CTv, G, tau_J, tau_f, J):  # type: ignore[no-untyped-def]
    N, n = q.shape
    for block in prange((N + _BLOCK - 1) // _BLOCK):
        X = np.empty((4, 3))
        scratch = np.empty((n, SCRATCH_COLUMNS))
        for k in range(block * _BLOCK, min(N, (block + 1) * _BLOCK)):
            _signals(
                chain,
                gain,
                friction,
                q[k],
                v[k],
                current[k],
                momentum[k],
                CTv[k],
                G[k],
                tau_J[k],
                tau_f[k],
                J[k],
                X,
                scratch,
            )
