"""Models of the simulated arm from its contact-free logs, one for each friction law.

One identification as the article's (excitation 1, Coulomb-viscous friction) and passes of opposite
direction in some postures give a model for each law:

    coulomb-viscous   the identified law
    semi-parametric   the article's: the same, with networks near zero velocity that were trained
                      on friction separated by reversal
    presliding        `models.friction.presliding_friction`, fitted with the inertias on these logs

**The stated covariance.** The residual of an identification is not the error of the observer in a
task. An excitation is fast, a task may be slow, and a friction law errs most near zero velocity. So
the torque error of each law is learnt as `identify` learns it, by the state of each joint
(`models.identification.torque_error_model`). It is learnt from the output of the causal observer
with the same K_0, along contact-free logs that no model was fitted on: excitation 2, and slow
passes in three postures. The postures differ in the signs of the joints' velocities. Friction has
the sign of the velocity: passes of one pattern would show that pattern as the correlation of the
errors. Friction also ripples over position: the error in one posture is not that of the arm.

Planning has no state yet. It takes one Sigma_tau over those samples of excitation 2 and of the
first posture that are slower than the task's planned motion:

    sd_j        = RMS of tau_ext_j where |v_j| <= speed, about zero: a correlated error counts
    Sigma_tau   = D R D,  D = diag(sd),  R = the outputs' correlations (about zero) over all samples

Nothing of it comes from a task's run. Eq. 4 takes the first cycle's torque in place of a model; for
its error see `wrenchsight.analyses.experiments.setups.path_runs.repetition_errors`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from wrenchsight.analyses.experiments.setups.simulated_arm.friction_reversal import (
    HOME_DEPARTURES,
    reversal_recordings,
    semi_parametric_model,
    separate_recordings,
)
from wrenchsight.analyses.experiments.setups.simulated_arm.simulated_identification import (
    CONFIG,
    identify_simulated_arm,
)
from wrenchsight.analyses.methods.identify.friction_training import TrainingConfig
from wrenchsight.analyses.methods.identify.identification import IdentificationResult, identify
from wrenchsight.analyses.output.progress import ProgressCallback
from wrenchsight.analyses.study.shared_results import shared
from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.identification.torque_error_fit import HeldOutReading, fit_torque_error
from wrenchsight.models.identification.torque_error_model import LawHoldsAtRest, TorqueErrorModel
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.recordings.position_resolution import position_resolution
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot

LAWS = ("coulomb-viscous", "semi-parametric", "presliding")
# Passes as slow as a task's joints, with more travel than the compliance of the drives takes up.
# Without them the networks lack the speeds of a task: trained on passes from 0.01 rad/s on with a
# period of 2 s alone, they halve neither error nor peak.
SLOW_SPEEDS = (0.003, 0.01, 0.03)  # rad/s
SLOW_PERIOD = 8.0  # s
# Dry friction jumps at zero velocity. The networks start with a jump as wide as v_crit /
# MAX_NETWORK_SLOPE, 0.2 mrad/s; with the 60 of a smooth network, friction at 10 mrad/s is half the
# true one.
MAX_NETWORK_SLOPE = 2000.0
# Passes that nothing is fitted on: departures from home, rad, and signs of the velocities.
HELD_OUT_POSTURES = ((0.3, 0.2, -0.25, 0.3, 0.25, -0.3), (-0.3, -0.2, 0.25, -0.3, -0.25, 0.3))
HELD_OUT_WAYS = ((1.0, 1.0, 1.0, 1.0, 1.0, 1.0), (1.0, 1.0, -1.0, -1.0, 1.0, 1.0))
# samples below the speed; with fewer the joint's sd is that of all its samples
MIN_SLOW_SAMPLES = 200


@dataclass(frozen=True, eq=False)
class ArmModels:
    """The models of an arm, and the contact-free logs that show their torque error.

    Attributes:
        models: by law, as in LAWS.
        held_out: contact-free logs that no model was fitted on.
        passes: further contact-free logs, which planning leaves out.
    """

    robot: Robot
    models: Mapping[str, IdentifiedModel]
    held_out: tuple[Recording, ...]
    passes: tuple[Recording, ...] = ()
    # By law and K_0: variants of one estimator share the observer and differ in what follows it
    _observed_by_law: dict[tuple[str, float], tuple[Array, TorqueErrorModel]] = field(
        default_factory=dict, repr=False
    )

    def estimator(
        self, law: str, speed: float, K_0: float, reconstruction: WrenchReconstructionConfig
    ) -> WrenchEstimator:
        """An estimator with a law's model and the covariance of its error in a task.

        Args:
            law: one of LAWS.
            speed: rad/s, the highest joint speed of the planned task.
            K_0: 1/s.
            reconstruction: method and prior.
        """
        tau_ext, error = self.observed(law, K_0)
        v = np.vstack([log.v[_settled(log, K_0)] for log in self.held_out])
        covariance = covariance_at_speed(tau_ext, v, speed)
        if reconstruction.method == "inverse":  # the article's, with its law at rest as well
            error = LawHoldsAtRest.of(error)
        model = replace(self.models[law], residual_covariance=covariance, torque_error=error)
        config = WrenchEstimatorConfig(MomentumObserverConfig([K_0]), reconstruction)
        return WrenchEstimator(self.robot, model, config)

    def observed(self, law: str, K_0: float) -> tuple[Array, TorqueErrorModel]:
        """Output of a law's observer along the held-out logs, and the torque error of the law.

        Args:
            law: one of LAWS.
            K_0: 1/s.

        Returns:
            tau_ext (N, n) N m of the settled samples, and the torque error that these logs and the
            passes show. Both are computed once for all experiments with this arm.
        """
        if (law, K_0) not in self._observed_by_law:
            arguments = self.robot, self.models[law], self.held_out, self.passes, K_0
            self._observed_by_law[law, K_0] = shared(
                "observed", arguments, lambda: self._observed(law, K_0)
            )
        return self._observed_by_law[law, K_0]

    def _observed(self, law: str, K_0: float) -> tuple[Array, TorqueErrorModel]:
        config = WrenchEstimatorConfig(MomentumObserverConfig([K_0]))
        plain = replace(self.models[law], torque_error=None)
        estimator = WrenchEstimator(self.robot, plain, config)
        logs = *self.held_out, *self.passes
        readings = [read_contact_free(estimator, log, K_0, _settled(log, K_0)) for log in logs]
        held_out = zip(readings, self.held_out, strict=False)  # the first of them
        tau_ext = np.vstack([reading.tau_ext[_settled(log, K_0)] for reading, log in held_out])
        return tau_ext, fit_torque_error(readings)


def read_contact_free(
    estimator: WrenchEstimator, log: Recording, K_0: float, used: Flags
) -> HeldOutReading:
    """Reads a contact-free log with an observer (K_0, 1/s); `used` (N,): the samples that count."""
    observation = estimator.observe(log.q, log.v, log.current)
    return HeldOutReading(
        tau_ext=observation.tau_ext,
        q=log.q,
        v=log.v,
        transmitted=observation.tau_J - observation.tau_f,
        used=observation.fresh & used,
        friction=estimator.friction,
        time_step=log.time_step,
        K_0=np.full(log.num_joints, K_0),
        resolution=position_resolution(log.q),
    )


def _settled(log: Recording, K_0: float) -> Flags:
    """(N,) samples at which the observer has forgotten its start."""
    return np.asarray(log.t - log.t[0] >= 3.0 / K_0)


def identify_arm(
    robot: Robot,
    seed: int = 0,
    quick: bool = False,
    progress: ProgressCallback = lambda fraction, action: None,
    contact_noise: bool = True,
) -> ArmModels:
    """Simulates the contact-free logs and identifies a model per law.

    Args:
        robot: with its simulated truth.
        quick: shorter logs, fewer postures.
        contact_noise: contact noise of `identify`; only contact detection reads it.
    """
    arguments = robot, seed, quick, contact_noise
    models, held_out, passes = shared(
        "identify_arm", arguments, lambda: _identify_arm(*arguments, progress)
    )
    progress(1.0, "models")
    return ArmModels(robot, models, held_out, passes)


def _identify_arm(
    robot: Robot, seed: int, quick: bool, contact_noise: bool, progress: ProgressCallback
) -> tuple[dict[str, IdentifiedModel], tuple[Recording, ...], tuple[Recording, ...]]:
    progress(0.0, "identification")
    result, (log, other) = identify_simulated_arm(robot, seed, quick, contact_noise=contact_noise)
    progress(0.2, "reversals")
    fast, slow = _reversals(robot, seed, quick)
    postures = np.asarray(robot.home) + np.asarray(HELD_OUT_POSTURES)
    passes = reversal_recordings(
        robot, postures, SLOW_SPEEDS[1:], seed + 200, SLOW_PERIOD, HELD_OUT_WAYS
    )
    progress(0.85, "friction laws")
    fitted = [*fast, *slow[:-1]]
    semi_parametric = _with_networks(robot, result, fitted, seed)
    config = replace(CONFIG, friction="presliding", cross_validate=False, seed=seed)
    progress(0.9, "presliding friction")
    presliding = identify([log.recording, *fitted], robot, [], config).model
    models = dict(zip(LAWS, (result.model, semi_parametric, presliding), strict=True))
    return models, (other.recording, slow[-1]), tuple(passes)


def _reversals(robot: Robot, seed: int, quick: bool) -> tuple[list[Recording], list[Recording]]:
    """Logs of fast passes, and of slow ones; of these the last is held out of every fit."""
    postures = np.asarray(robot.home) + np.asarray(HOME_DEPARTURES)
    fast = reversal_recordings(robot, postures[:1], seed=seed)
    slow_postures = postures[-2:] if quick else postures[1:]
    slow = reversal_recordings(
        robot,
        slow_postures,
        SLOW_SPEEDS[1:] if quick else SLOW_SPEEDS,
        seed + 100,
        SLOW_PERIOD,
    )
    return fast, slow


def _with_networks(
    robot: Robot, result: IdentificationResult, fitted: Sequence[Recording], seed: int
) -> IdentifiedModel:
    """The semi-parametric model, its networks trained on friction separated in these logs."""
    separated = separate_recordings(robot, fitted, result.model, CONFIG.cutoff)
    training = TrainingConfig(seed=seed, odd=True, steepest=MAX_NETWORK_SLOPE)
    return semi_parametric_model(robot, result, separated, training)[0]


def covariance_at_speed(tau_ext: Array, v: Array, speed: float) -> Array:
    """Sigma_tau (n, n) in (N m)^2 by the rule at the top of this file.

    Args:
        tau_ext: (N, n) N m, the observer's output where nothing touches the arm.
        v: (N, n) rad/s.
        speed: rad/s.
    """
    slow = np.abs(v) <= speed
    slow[:, slow.sum(axis=0) < MIN_SLOW_SAMPLES] = True
    sd = np.sqrt((tau_ext**2 * slow).sum(axis=0) / slow.sum(axis=0))
    moment = tau_ext.T @ tau_ext
    scale = np.sqrt(np.diag(moment))
    return np.asarray(np.outer(sd, sd) * moment / np.outer(scale, scale))
