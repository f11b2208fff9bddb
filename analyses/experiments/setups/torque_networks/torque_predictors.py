"""Three predictors of contact-free torque, and the force error that their torque error causes.

    model    inverse dynamics and friction law of an identified model
    network  the recurrent network alone
    hybrid   the model, and a network of its residual

All read the same zero-phase low-passed q and v, and are compared with torque that went through the
same low-pass. The force is F = (J S^-1 J^T)^-1 J S^-1 tau_ext of the error alone, without observer
or prior. J is that of a point contact; S is the covariance of the model's error for every
predictor. Postures in which such an error reads as more than READABLE are left out for all
predictors alike.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from wrenchsight.analyses.experiments.setups.torque_networks.recurrent_network import (
    Motion,
    NetworkConfig,
    TorqueNetwork,
)
from wrenchsight.analyses.methods.identify.identification_config import IdentificationConfig
from wrenchsight.analyses.methods.identify.low_passed_logs import low_pass_log
from wrenchsight.analyses.methods.identify.torque_fit import rms
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.signals.bands import SIGMA_95
from wrenchsight.models.signals.zero_phase import ZeroPhaseLowPass

METHODS: Final = ("model", "network", "hybrid")
HELD_OUT: Final = 0.15  # of each log, its end: what a predictor's band is learnt from
FILTER: Final = IdentificationConfig()
SHORTEST: Final = 5.0  # periods of the cutoff, of a log that is only read
READABLE: Final = 10.0  # N, sd of a force's component
# Settled by leaving each of the three fitted runs out in turn.
ALONE: Final = NetworkConfig(hidden=128, epochs=30.0, rate=5e-3, decay=0.1, blur=0.0)
ON_MODEL: Final = NetworkConfig(hidden=16, epochs=10.0, rate=2e-3, decay=1.0, blur=1.5)


@dataclass(frozen=True, eq=False)
class TorqueLog:
    """A low-passed log; N samples.

    Attributes:
        t: (N,) s.
        motion: with the torque that a contact-free arm spends; a known wrench's is taken off.
        model: (N, n) N m, the same as the model predicts it.
    """

    t: Array
    motion: Motion
    model: Array

    def less(self, torque: Array) -> "TorqueLog":
        """The same with a torque (N, n) N m taken off the measured and off the predicted one."""
        motion = replace(self.motion, torque=self.motion.torque - torque)
        return replace(self, motion=motion, model=self.model - torque)


def torque_log(
    recording: Recording,
    robot: Robot,
    model: IdentifiedModel,
    external: Array | None = None,
    loaded: bool = False,
) -> TorqueLog:
    """Low-passes a log and predicts its torque by a model.

    Args:
        recording: the log, without drop-outs; on a uniform grid where `external` is given.
        external: (T, n) N m at the recording's samples, torque of a known wrench.
        loaded: whether the torque that the gears transmit is the measured one, not the model's.
    """
    config = replace(FILTER, time_step=min(0.01, float(f"{recording.time_step:.3g}")))
    run = low_pass_log("", recording, robot, config, SHORTEST)
    rigid = np.asarray(model.chain(robot).inverse_dynamics(run.q, run.v, run.vdot))
    friction = model.friction.torque_along(run.q, run.v, rigid)
    tau = run.tau
    if loaded:
        friction = model.friction.torque_along(run.q, run.v, tau - friction)
    if external is not None:
        low_passed = ZeroPhaseLowPass(FILTER.cutoff, recording.time_step, FILTER.filter_order)(
            external
        )
        sample = np.searchsorted(recording.t, run.t - 1e-9)
        tau = tau + low_passed[np.minimum(sample, len(low_passed) - 1)]
    motion = Motion(run.q, run.v, tau, run.used, run.low_pass.time_step)
    return TorqueLog(run.t, motion, run.match(rigid + friction))


@dataclass(frozen=True, eq=False)
class Judged:
    """A log, the samples of it that are judged, and how they are read.

    Attributes:
        log: the log.
        rows: (N,).
        gain: (N, axes, n) force from joint torque.
        covariance: (n, n) (N m)^2, which decides what is readable.
    """

    log: TorqueLog
    rows: Flags
    gain: Array
    covariance: Array

    @classmethod
    def at_point(cls, log: TorqueLog, J: Array, covariance: Array) -> "Judged":
        """All of a log, read at a point with the Jacobian (N, 3, n) of its velocity."""
        weighted = J @ np.linalg.inv(covariance)
        gain = np.linalg.solve(weighted @ J.transpose(0, 2, 1), weighted)
        return cls(log, log.motion.used, np.asarray(gain), covariance)

    def narrowed(self, where: Flags) -> "Judged":
        """The same with fewer samples."""
        return replace(self, rows=self.rows & where)


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors of one predictor.

    Attributes:
        torque: (K, n) N m, predicted less measured.
        force: (M, axes) N, what that is read as, where it is readable.
        sd: (M, axes) N, as the band states it.
    """

    torque: Array
    force: Array
    sd: Array

    @classmethod
    def pooled(cls, parts: Sequence["Errors"]) -> "Errors":
        """The errors of several logs together."""
        return cls(
            torque=np.concatenate([part.torque for part in parts]),
            force=np.concatenate([part.force for part in parts]),
            sd=np.concatenate([part.sd for part in parts]),
        )

    def metrics(self) -> dict[str, Any]:
        """Lists per joint and axis, as written to metrics.json."""
        return {
            "torque_rmse_nm": rms(self.torque),
            "rmse_n": rms(self.force),
            "inside_95_pct": 100.0 * np.mean(np.abs(self.force) <= SIGMA_95 * self.sd, axis=0),
        }


class Predictors:
    """The three predictors, trained on the same logs.

    Attributes:
        covariance: (n, n) (N m)^2 by method, mean square of its error on the ends of these logs.
    """

    def __init__(
        self,
        logs: Sequence[TorqueLog],
        seed: int,
        share: float = 1.0,
        network_motions: Sequence[Motion] = (),
    ) -> None:
        """Args: `share` of the epochs are trained; `network_motions` are for the network alone."""
        alone, over, ends = [], [], []
        for log in logs:
            rows = np.flatnonzero(log.motion.used)
            early = np.arange(len(log.t)) < rows[int((1.0 - HELD_OUT) * len(rows))]
            alone.append(replace(log.motion, used=log.motion.used & early))
            over.append(replace(alone[-1], torque=log.motion.torque - log.model))
            ends.append(log.motion.used & ~early)
        self._alone, self._over = (
            TorqueNetwork(motions, replace(config, seed=seed, epochs=share * config.epochs))
            for motions, config in (([*alone, *network_motions], ALONE), (over, ON_MODEL))
        )
        self.covariance = {}
        for method in METHODS:
            error = np.concatenate(
                [self.error(method, log)[end] for log, end in zip(logs, ends, strict=True)]
            )
            self.covariance[method] = error.T @ error / len(error)

    def torque_alone(self, motion: Motion) -> Array:
        """(N, n) N m, the torque of a motion as the network alone predicts it."""
        return self._alone.torque(motion)

    def errors(self, judged: Judged) -> dict[str, Errors]:
        """By method."""
        G, S = judged.gain[judged.rows], judged.covariance
        clear = (np.einsum("kai,ij,kaj->ka", G, S, G) <= READABLE**2).all(axis=1)
        errors = {}
        for method in METHODS:
            torque = self.error(method, judged.log)[judged.rows]
            variance = np.einsum("kai,ij,kaj->ka", G, self.covariance[method], G)
            force = np.einsum("kaj,kj->ka", G, torque)
            errors[method] = Errors(torque, force[clear], np.sqrt(variance[clear]))
        return errors

    def error(self, method: str, log: TorqueLog) -> Array:
        """(N, n) N m, predicted less measured, by one of METHODS."""
        if method == "network":
            return self._alone.torque(log.motion) - log.motion.torque
        correction = self._over.torque(log.motion) if method == "hybrid" else 0.0
        return np.asarray(log.model + correction - log.motion.torque)
