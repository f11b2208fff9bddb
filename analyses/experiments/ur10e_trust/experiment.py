"""Supports README, "Coverage of the stated uncertainty on logs of other days".

Experiment `ur10e-trust`: coverage of the stated uncertainty on logs of other days.

The model is fitted on the three unloaded runs. Every other contact-free log of the same arm, from
seven weeks before to a week after, and two logs with a known load are read sample by sample as a
controller would. Where nothing touches the arm the truth is zero. A load's truth is its weight and
inertia at its point of action, found from the first 10 s of the log.

The figures are those of `force_only`, whose band holds the torque error alone. Further readings of
the same log stand below it:

    bayesian   with the live prior, which favours a force of zero and so covers it more often
    refreshed  with friction found again from the log's first REFRESH_SECONDS, over the rest of it;
               with a load, from the log without load of the same motion or day
    widened    where `estimate` warns of drifted friction: with the drift, joint by joint, that it
               then allows for; this needs the whole log, which no controller has
    tracked    from TRACKED_FROM on, as a controller that follows friction reads it
               (`wrenchsight.models.detection.tracked_estimator`), from these seconds alone

**Rest** is where no joint has moved faster than REST_SPEED for .3 s, **reversal** where a joint
turns round within .15 s, **sliding** all else.

Not blind: the drift of friction, an assumption, was settled with these logs in sight, and so were
the forms of the law and of the lag in the band. How long a joint takes to rest and how far its slip
reaches come from the three fitted runs.
"""

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from wrenchsight.analyses.experiments.setups.ur10e_recordings.known_payload import force_of_load
from wrenchsight.analyses.experiments.setups.ur10e_recordings.log_figures import (
    axes_of,
    bar_rows,
)
from wrenchsight.analyses.experiments.setups.ur10e_recordings.ur10e_logs import (
    LOAD_MASSES,
    log_file,
    presliding_arm,
)
from wrenchsight.analyses.methods.estimate.engines import covariance_about
from wrenchsight.analyses.methods.estimate.friction_monitor import FrictionMonitor
from wrenchsight.analyses.methods.identify.identification_config import (
    RefreshConfig,
)
from wrenchsight.analyses.methods.identify.known_model.friction_refreshing import refresh_model
from wrenchsight.analyses.study.experiment import (
    ComparisonRow,
    Experiment,
    ExperimentContext,
    ExperimentResult,
)
from wrenchsight.models.detection.tracked_estimator import TrackedEstimator
from wrenchsight.models.estimation.estimator import (
    Observation,
    WrenchEstimator,
    WrenchEstimatorConfig,
)
from wrenchsight.models.estimation.invalid import InvalidCodes
from wrenchsight.models.estimation.invalid_shares import invalid_pct
from wrenchsight.models.estimation.point_of_action import jacobian_at
from wrenchsight.models.estimation.reading_gain import ReadingGain
from wrenchsight.models.estimation.torque_error_stage import TorqueError
from wrenchsight.models.estimation.wrench import WrenchEstimate, WrenchReconstructionConfig
from wrenchsight.models.estimation.wrench_reading import ReadingSamples
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.recordings.position_resolution import position_resolution
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.recordings.resampling import resampled
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.signals.bands import SIGMA_95
from wrenchsight.models.signals.root_mean_square import rms

REFRESHED_BY = {  # the log without the load
    "ur-20_02_19_14harm50secLoad": "ur-20_02_19_14harm50sec",
    "ur-19_12_23_load": "ur-19_12_23_free",
}
REFRESH_SECONDS = 4.0
TIME_STEP = 0.01  # s
K_0 = 15.0  # 1/s, as in `ur10e-payload`; the logs' currents are samples of continuous signals
TRACKED_FROM = 5.0  # s
REST_SPEED = 0.01  # rad/s
REST_TIME = 0.3  # s
REVERSAL_TIME = 0.15  # s
END_MARGIN_SAMPLES = 100  # samples left out at both ends
MIN_REGIME_SAMPLES = 30  # samples of a regime


def run(context: ExperimentContext) -> ExperimentResult:
    """Identifies, reads every log, and counts how often the band holds the truth.

    A log's metrics are those of the identified model, by regime of motion. Below its keys are the
    same of other readings, where the log moves: `widened` by the drift that a log without load
    shows itself, `tracked` with friction followed, and `refreshed` by a model renewed from the
    first seconds of the log, or, of a log with a load, of the one without it (REFRESHED_BY).
    """
    robot, model = presliding_arm(context, 0.6)
    metrics: dict[str, Any] = {}
    renewed_models: dict[str, IdentifiedModel] = {}  # by the log that renewed it
    # Logs without a load stand before those that they renew a model for.
    for k, (log, mass) in enumerate(LOAD_MASSES.items()):
        context.progress(0.6 + 0.35 * k / len(LOAD_MASSES), log)
        recording = read_recording(log_file(context.data, log), robot=robot)
        log_metrics = _log_metrics(recording, mass, robot, _Reader(model), END_MARGIN_SAMPLES)
        moves = "sliding" in log_metrics
        renews = mass == 0.0 and moves  # a model, by its first seconds
        if renews:
            config = RefreshConfig(part=[0.0, REFRESH_SECONDS])
            renewed_models[log] = refresh_model(recording, robot, model, config).model
            drift = _shown_drift(recording, robot, model)
            if drift is not None and model.torque_error is not None:
                error = replace(model.torque_error, drift_shown=drift)
                reader = _Reader(model, replace(model, torque_error=error))
                widened = _log_metrics(recording, mass, robot, reader, END_MARGIN_SAMPLES)
                log_metrics["widened"] = {"drift": drift, **widened}
        if moves:
            tracked_from = round(TRACKED_FROM / TIME_STEP)
            reader = _Reader(model, is_tracked=True)
            log_metrics["tracked"] = _log_metrics(recording, mass, robot, reader, tracked_from)
        renewing_log = REFRESHED_BY.get(log, log)
        if renewing_log in renewed_models:
            reader = _Reader(renewed_models[renewing_log])
            # What renewed the model does not judge it.
            first = END_MARGIN_SAMPLES + (round(REFRESH_SECONDS / TIME_STEP) if renews else 0)
            log_metrics["refreshed"] = _log_metrics(recording, mass, robot, reader, first)
        metrics[log] = log_metrics
    context.progress(0.95, "figure")
    not_read = {"all": {"inside_95_pct": [np.nan] * 3}}
    cases = {"inside [%]": list(metrics.values())}
    for case in ("widened", "refreshed"):
        cases[f"inside, {case} [%]"] = [
            log_metrics.get(case, not_read) for log_metrics in metrics.values()
        ]
    shares = {
        words: axes_of([log_metrics["all"]["inside_95_pct"] for log_metrics in case])
        for words, case in cases.items()
    }
    return ExperimentResult(
        metrics=metrics,
        figures=[
            (
                "trust",
                bar_rows(shares, list(metrics)),
                "Share of the samples inside the stated 95 % band, log by log; also with the drift "
                "that `estimate` finds in the log and allows for, and of the model whose friction "
                f"was found again from {REFRESH_SECONDS:g} s without contact.",
            )
        ],
        comparison=_comparison(),
        notes=_notes(metrics),
    )


def _config(recording: Recording, method: str = "bayesian") -> WrenchEstimatorConfig:
    return WrenchEstimatorConfig(
        MomentumObserverConfig([K_0], TIME_STEP, "trapezoidal"),
        WrenchReconstructionConfig(method),
        position_resolution=position_resolution(recording.q).tolist(),
    )


def _shown_drift(recording: Recording, robot: Robot, model: IdentifiedModel) -> Array | None:
    """(n,) drift that `estimate` allows for in the band of a contact-free log; None: nothing."""
    uniform = resampled(recording, TIME_STEP)
    estimator = WrenchEstimator(robot, model, _config(recording))
    observation = estimator.observe(uniform.q, uniform.v, uniform.current)
    monitor = FrictionMonitor(model, estimator.chain, estimator.observer.pole, TIME_STEP)
    is_measured = observation.fresh & ~uniform.dropout
    monitor.add(
        uniform.t, uniform.q, uniform.v, observation.tau_ext, is_measured, np.ones_like(is_measured)
    )
    return monitor.drifts()


@dataclass(frozen=True, eq=False)
class _PointLog:
    """A log to be read at the point of action.

    Attributes:
        uniform: N samples on a uniform grid.
        observation: of an observer along it.
        J: (N, 6, n) at the point of action in axes of W.
    """

    uniform: Recording
    observation: Observation
    J: Array

    def error(self, estimator: WrenchEstimator) -> TorqueError:
        """The torque error that an estimator states along the log."""
        state = estimator.error.initial_state()
        uniform = self.uniform
        return estimator.error.run(
            state, uniform.q, uniform.v, self.observation.transmitted, self.J
        )

    def read(self, estimator: WrenchEstimator) -> WrenchEstimate:
        """The wrench at the point of action."""
        N = len(self.J)
        samples = ReadingSamples(
            J=self.J,
            tau_ext=self.observation.tau_ext,
            is_fresh=self.observation.fresh,
            q=self.uniform.q,
            v=self.uniform.v,
            is_corrected=np.ones(N, bool),
            fault=np.zeros(N, np.int64),
        )
        return estimator.reading.run(
            estimator.reading.initial_state(), self.error(estimator), samples
        )


@dataclass(frozen=True, eq=False)
class _Reader:
    """What a log is read by.

    Attributes:
        model: of the arm.
        model_with_drift: whose band is stated, about the reading of `model`; None: that of `model`.
        is_tracked: whether friction is followed along the log.
    """

    model: IdentifiedModel
    model_with_drift: IdentifiedModel | None = None
    is_tracked: bool = False


class _PointReading(NamedTuple):
    """A reading at the point of action.

    Attributes:
        wrench: (N, 6) rotation first, N m and N.
        covariance: (N, 6, 6).
        invalid: (N,) reasons.
    """

    wrench: Array
    covariance: Array
    invalid: InvalidCodes


def _read(
    log: _PointLog, robot: Robot, reader: _Reader, config: WrenchEstimatorConfig
) -> _PointReading:
    """Reads a log with an estimator of that configuration."""
    if reader.is_tracked:
        reading = _read_tracked(log, TrackedEstimator(robot, reader.model, config))
    else:
        estimate = log.read(WrenchEstimator(robot, reader.model, config))
        reading = _PointReading(estimate.wrench, estimate.covariance, estimate.invalid)
    if reader.model_with_drift is None:
        return reading
    with_drift = log.read(WrenchEstimator(robot, reader.model_with_drift, config))
    covariance = covariance_about(reading.wrench, with_drift.wrench, with_drift.covariance)
    return _PointReading(reading.wrench, covariance, reading.invalid | with_drift.invalid)


def _read_tracked(log: _PointLog, follower: TrackedEstimator) -> _PointReading:
    """The reading of a log whose friction is followed."""
    uniform, estimator = log.uniform, follower.estimator
    batch, _ = follower.run(uniform.q, uniform.v, uniform.current)
    followed = replace(log, observation=log.observation._replace(tau_ext=batch.tau_ext))
    error = followed.error(estimator)
    friction_variance = batch.torque_sd**2 - error.sd**2
    at_point = batch._replace(J_seen=error.J_seen, torque_sd=error.sd)
    gain = ReadingGain(estimator).of(at_point)
    estimate = followed.read(estimator)
    friction_part = (gain * friction_variance[:, None, :]) @ gain.transpose(0, 2, 1)
    return _PointReading(estimate.wrench, estimate.covariance + friction_part, estimate.invalid)


def _log_metrics(
    recording: Recording, mass: float, robot: Robot, reader: _Reader, begin: int
) -> dict[str, Any]:
    """The error and the stated band of a log, by method and regime of motion.

    The log is read at the point at which the load acts, so that the truth is a force alone; without
    a load at E. One observer's readings give the point, and are what both methods read.

    Args:
        recording: the log, at its own rate.
        mass: kg, that hangs on the arm; 0 for a log without contact, whose true force is zero.
        reader: its model must have a learnt torque error.
        begin: first sample, on the uniform grid, that is judged.

    Returns:
        Figures by regime (`regimes`) of force_only; below `bayesian` those of that method. A regime
        of fewer than MIN_REGIME_SAMPLES is left out.

    Raises:
        ValueError: the model has no torque error.
    """
    uniform = resampled(recording, TIME_STEP)
    is_judged = ~uniform.dropout
    is_judged[:begin] = False
    is_judged[-END_MARGIN_SAMPLES:] = False
    estimator = WrenchEstimator(robot, reader.model, _config(recording))
    if not estimator.learnt:
        raise ValueError("the model has no torque error")
    # The default method's configuration will do: what the observer reads is the same for every one.
    observation = estimator.observe(uniform.q, uniform.v, uniform.current)
    if mass == 0.0:
        J_at_point = observation.J  # at E
        true_force = np.zeros((len(observation.J), 3))
    else:
        point, true_force = force_of_load(
            robot,
            uniform,
            observation.J,
            observation.tau_ext,
            reader.model.residual_covariance,
            mass,
        )
        R_WE, _ = robot.chain.pose(uniform.q)
        J_at_point = jacobian_at(observation.J, R_WE, point)
    log = _PointLog(uniform, observation, J_at_point)
    metrics: dict[str, Any] = {}
    for method in ("force_only", "bayesian"):
        reading = _read(log, robot, reader, _config(recording, method))
        error = reading.wrench[:, 3:] - true_force
        sd = np.sqrt(np.diagonal(reading.covariance, axis1=1, axis2=2))[:, 3:]
        by_regime = {}
        for regime, is_in_regime in regimes(uniform.v).items():
            rows = is_in_regime & is_judged
            if rows.sum() >= MIN_REGIME_SAMPLES:
                by_regime[regime] = _counted(error[rows], sd[rows], reading.invalid[rows])
        metrics |= by_regime if method == "force_only" else {method: by_regime}
    return metrics


def regimes(v: Array) -> dict[str, Flags]:
    """Which of N samples are rest, reversal and sliding, for v (N, n) every TIME_STEP s."""
    N = len(v)
    moves = (np.abs(v) > REST_SPEED).any(axis=1)
    recent = np.convolve(moves, np.ones(round(REST_TIME / TIME_STEP)))[:N] > 0.0
    turning, reach = np.zeros(N, bool), round(REVERSAL_TIME / TIME_STEP)
    for j in range(v.shape[1]):
        moving = np.flatnonzero(np.abs(v[:, j]) > 0.1 * REST_SPEED)
        for k in np.flatnonzero(np.diff(np.sign(v[moving, j])) != 0.0):
            turning[max(0, moving[k] - reach) : moving[k + 1] + reach + 1] = True
    return {
        "all": np.ones(N, bool),
        "rest": ~recent,
        "reversal": recent & turning,
        "sliding": recent & ~turning,
    }


def _counted(error: Array, sd: Array, invalid: InvalidCodes) -> dict[str, Any]:
    valid = invalid == 0
    return {
        "inside_95_pct": 100.0 * np.mean(np.abs(error) <= SIGMA_95 * sd, axis=0),
        "rmse_n": rms(error),
        "share_valid_pct": 100.0 * float(valid.mean()),
        "invalid": invalid_pct(invalid),
        "largest_valid_n": np.abs(error[valid]).max(axis=0) if valid.any() else np.zeros(3),
    }


def _comparison() -> list[ComparisonRow]:
    inside, earlier = "Inside the stated 95 % band, x y z", "ur-19_12_23_free"
    rows = {
        "a week after the fit": "ur-20_02_19_15harm50sec",
        "seven weeks before it": earlier,
        "the same as `estimate` states it, by the drift that the log shows": f"{earlier}.widened",
        f"the same as a controller reads it after {TRACKED_FROM:g} s, friction followed": (
            f"{earlier}.tracked"
        ),
        f"the same with friction refreshed from {REFRESH_SECONDS:g} s": f"{earlier}.refreshed",
    }
    return [
        ComparisonRow(f"{inside}, {words}", f"{key}.all.inside_95_pct")
        for words, key in rows.items()
    ]


def _notes(metrics: dict[str, Any]) -> list[str]:
    cases = {
        "as identified": "",
        f"friction refreshed from {REFRESH_SECONDS:g} s": "refreshed",
        "with the drift that the log shows": "widened",
        f"friction followed, after {TRACKED_FROM:g} s": "tracked",
    }
    notes = []
    for words, case in cases.items():
        logs = {
            name: by_regime.get(case, {}) if case else by_regime
            for name, by_regime in metrics.items()
        }
        shares = "; ".join(
            f"`{name}` " + " ".join(f"{share:.0f}" for share in by_regime["all"]["inside_95_pct"])
            for name, by_regime in logs.items()
            if by_regime
        )
        notes += [f"Inside the 95 % band, x y z, {words}: {shares} %."] if shares else []
    return notes


EXPERIMENT = Experiment(
    name="ur10e-trust",
    title="Coverage of the stated uncertainty on logs of other days",
    section="recordings of a UR10e",
    run=run,
    needs=("ur10e", "ur10e_more"),
    order=155,
    seconds=90,
    readme=("ur-19_12_23_free.widened.all.inside_95_pct",),
)
