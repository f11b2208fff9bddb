"""Readings of a known payload on a real arm, and their errors against its true force."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import spearmanr

from wrenchsight.analyses.methods.reference_sensor.judged_force import correlation
from wrenchsight.models.estimation.estimator import (
    EstimateBatch,
    WrenchEstimator,
    WrenchEstimatorConfig,
)
from wrenchsight.models.estimation.evidence_prior import evidence_prior
from wrenchsight.models.estimation.invalid_shares import invalid_pct
from wrenchsight.models.estimation.point_of_action import (
    find_point_of_action,
    jacobian_at,
)
from wrenchsight.models.estimation.wrench import (
    WrenchEstimate,
    WrenchReconstruction,
    WrenchReconstructionConfig,
)
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.recordings.resampling import resampled
from wrenchsight.models.rigid_body.spatial_vectors import AXES
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.signals.bands import SIGMA_68, SIGMA_95
from wrenchsight.models.signals.root_mean_square import rms, rms_length
from wrenchsight.models.signals.zero_phase import ZeroPhaseLowPass, derivative

PAYLOAD_MASS = 2.805  # kg, of the payload
TIME_STEP = 0.01  # s
K_0 = 15.0  # 1/s
REFERENCE_CUTOFF = 5.0  # Hz, zero-phase, of the kinematics behind the reference
LEARNING_TIME = 10.0  # s of the loaded run that the point of action is found from
END_MARGIN = 1.0  # s left out at both ends: the observer's start, the reference's filter
INNER_ROWS = slice(round(END_MARGIN / TIME_STEP), -round(END_MARGIN / TIME_STEP))
# Samples of them; the observer's band is far below their rate.
LEARNING_ROWS = slice(round(END_MARGIN / TIME_STEP), round(LEARNING_TIME / TIME_STEP), 5)
# Every method that is compared, with its settings. The other settings are alike; a prior, where a
# method needs one, is the log's by evidence.
METHODS: dict[str, WrenchReconstructionConfig] = {
    "bayesian": WrenchReconstructionConfig("bayesian"),
    "bayesian_live_prior": WrenchReconstructionConfig("bayesian"),
    "force_only": WrenchReconstructionConfig("force_only"),
    "inverse": WrenchReconstructionConfig("inverse"),
    "damped": WrenchReconstructionConfig("damped", damping=0.2),
    "truncated": WrenchReconstructionConfig("truncated", truncation=0.05),
    "truncated_1e_5": WrenchReconstructionConfig("truncated", truncation=1e-5),
}


def payload_metrics(estimate: WrenchEstimate, direction: Array) -> dict[str, Any]:
    """Errors of the force over all samples, and below `valid` over those that are flagged valid.

    Args:
        estimate: estimate of N samples.
        direction: (N, 3) m/s^2, as `payload_reference`: the true force is PAYLOAD_MASS times it.

    Returns:
        Lists are of x, y, z; `mass_kg` is the mass whose force along `direction` is nearest to the
        reading. None of fewer than two samples. The rank correlation is that of the error's size
        with the stated sd's, and with the condition number.
    """
    force = estimate.wrench[:, 3:]
    truth = PAYLOAD_MASS * direction
    deviation = estimate.standard_deviation[:, 3:]

    def errors(rows: Flags) -> dict[str, Any]:
        names = [f"rmse_f{axis}_n" for axis in AXES]
        if rows.sum() < 2:
            keys = (*names, "rmse_n", "max_error_n", "mass_kg", "correlation")
            return dict.fromkeys((*keys, "inside_68_pct", "inside_95_pct"))
        error, along = (force - truth)[rows], direction[rows]
        share = np.abs(error) / deviation[rows]
        pairs = zip(force[rows].T, truth[rows].T, strict=True)
        return {
            **dict(zip(names, rms(error).tolist(), strict=True)),
            "rmse_n": rms_length(error),
            "max_error_n": float(np.linalg.norm(error, axis=1).max()),
            "mass_kg": float(np.sum(force[rows] * along) / np.sum(along**2)),
            "correlation": [correlation(read, true) for read, true in pairs],
            "inside_68_pct": 100.0 * np.mean(share <= SIGMA_68, axis=0),
            "inside_95_pct": 100.0 * np.mean(share <= SIGMA_95, axis=0),
        }

    error_size = np.linalg.norm(force - truth, axis=1)
    ranked = {
        "stated_sd": np.linalg.norm(deviation, axis=1),
        "condition_number": estimate.condition_number,
    }
    return {
        **errors(np.ones(len(force), bool)),
        "share_valid_pct": 100.0 * float(estimate.valid.mean()),
        "invalid": invalid_pct(estimate.invalid),
        "valid": errors(estimate.valid),
        "rank_correlation_with_error": {
            key: float(spearmanr(measure, error_size).statistic) for key, measure in ranked.items()
        },
    }


def payload_reference(
    robot: Robot, recording: Recording, cutoff: float, p_EP: Array | None = None
) -> Array:
    """Force of a payload on the robot over its mass: (N, 3) g - a_E in axes of W, m/s^2.

    The recording is on a uniform grid.

    a_E is the second derivative of the position of the flange (or of a point P fixed to it),
    computed from positions that went through a zero-phase low-pass: no model, no current, no delay.
    """
    step = recording.time_step
    q = ZeroPhaseLowPass(cutoff, step)(recording.q)
    R_WE, p_WE = robot.chain.pose(q)
    if p_EP is not None:
        p_WE = p_WE + R_WE @ p_EP
    a_E = derivative(derivative(p_WE, step), step)
    return np.asarray(robot.gravity) - a_E


def force_of_load(
    robot: Robot, motion: Recording, J: Array, tau_ext: Array, Sigma_tau: Array, mass: float
) -> tuple[Array, Array]:
    """The point where a load acts, found from the first seconds of a run, and its force there.

    Args:
        motion: motion of N samples, TIME_STEP apart.
        J: (N, 6, n) of E.
        tau_ext: (N, n) N m, as read.
        Sigma_tau: (n, n) N^2 m^2, of its error.
        mass: kg.

    Returns:
        p_EP (3,) m in axes of E, and the force (N, 3) N in axes of W.
    """
    R_WE, _ = robot.chain.pose(motion.q)
    p_EP = find_point_of_action(
        J[LEARNING_ROWS], R_WE[LEARNING_ROWS], tau_ext[LEARNING_ROWS], Sigma_tau
    ).p_EP
    return p_EP, mass * payload_reference(robot, motion, REFERENCE_CUTOFF, p_EP)


def estimator_config() -> WrenchEstimatorConfig:
    """The estimator of this experiment; the log's current is a sampled continuous signal."""
    return WrenchEstimatorConfig(
        observer=MomentumObserverConfig(
            K_0=[K_0], time_step=TIME_STEP, torque_samples="trapezoidal"
        )
    )


@dataclass(frozen=True, eq=False)
class AtLoad:
    """Readings at the point where the load acts.

    Attributes:
        t: (N,) s, of the test part.
        bayesian: the reading.
        direction: (N, 3) m/s^2, `payload_reference` at that point.
        metrics: by method, the point found from the first part, and the priors.
    """

    t: Array
    bayesian: WrenchEstimate
    direction: Array
    metrics: dict[str, Any]


def read_at_load(
    robot: Robot,
    loaded: Recording,
    batch: EstimateBatch,
    Sigma_tau: Array,
    with_mean: bool,
    free_noise: bool,
) -> AtLoad:
    """Finds the point of action from the first seconds, and reads the later samples there.

    LEARNING_ROWS give the point with the noise's scale, and the prior of `bayesian` (mean and sds);
    all rows between their ends the zero-mean prior of the other two readings. The rows after them
    are read, all with the noise of that scale.

    Args:
        loaded: the run with the load.
        batch: what the estimator read along it, at E.
        Sigma_tau: (n, n) N^2 m^2, of the torque's error.
        with_mean, free_noise: as `find_point_of_action`: whether the force there has a mean, and
            the noise a scale of its own.

    Returns:
        What was read there after LEARNING_TIME, in the order of the samples, and its metrics:
        `bayesian` and `force_only` as found, `bayesian_zero_mean` with a prior about zero.
    """
    learnt = slice(LEARNING_ROWS.start, LEARNING_ROWS.stop)  # LEARNING_ROWS has every fifth
    test = slice(LEARNING_ROWS.stop, -LEARNING_ROWS.start)  # the same margin at both ends
    R_WE, _ = robot.chain.pose(loaded.q)
    point = find_point_of_action(
        batch.J[LEARNING_ROWS],
        R_WE[LEARNING_ROWS],
        batch.tau_ext[LEARNING_ROWS],
        Sigma_tau,
        with_mean=with_mean,
        free_noise=free_noise,
    )
    J = jacobian_at(batch.J, R_WE, point.p_EP)
    Sigma = point.noise_scale**2 * Sigma_tau
    about_mean = METHODS["bayesian"].with_prior(point.force_sd, point.moment_sd)
    zero_mean = evidence_prior(J[learnt], batch.tau_ext[learnt], Sigma)

    def read(config: WrenchReconstructionConfig, mean_force: Array) -> WrenchEstimate:
        """The mean force (3,) in W is taken off the torque before the reading, and added again."""
        expected = J[:, 3:].transpose(0, 2, 1) @ mean_force
        tau = batch.tau_ext - expected
        estimate = WrenchReconstruction(config, Sigma).reconstruct(J[test], tau[test])
        estimate.wrench[:, 3:] += mean_force
        return estimate

    no_force = np.zeros(3)
    readings = {
        "bayesian": read(about_mean, point.mean_force_W),
        "bayesian_zero_mean": read(METHODS["bayesian"].with_prior(*zero_mean), no_force),
        "force_only": read(METHODS["force_only"].with_prior(*zero_mean), no_force),
    }
    direction = payload_reference(robot, loaded, REFERENCE_CUTOFF, point.p_EP)[test]
    metrics = {
        **{name: payload_metrics(estimate, direction) for name, estimate in readings.items()},
        "point_m": point.p_EP,
        "mean_force_n": point.mean_force_W,
        "force_sd_n": point.force_sd,
        "moment_sd_nm": point.moment_sd,
        "noise_factor": point.noise_scale,
        "zero_mean_force_sd_n": zero_mean.force_sd,
        "zero_mean_moment_sd_nm": zero_mean.moment_sd,
    }
    return AtLoad(loaded.t[test] - loaded.t[0], readings["bayesian"], direction, metrics)


def estimate_run(
    log: Path, robot: Robot, model: IdentifiedModel
) -> tuple[Recording, EstimateBatch]:
    """Reads a log on a uniform grid; returns its recording and the estimates."""
    recording = resampled(read_recording(log, robot=robot), TIME_STEP)
    estimator = WrenchEstimator(robot, model, estimator_config())
    state = estimator.initial_state()
    return recording, estimator.run(state, recording.q, recording.v, recording.current)
