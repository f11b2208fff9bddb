"""Experiment `ur10e-trust`: does the stated uncertainty hold on logs that nobody tuned to?

The model is fitted on the three unloaded runs; every other contact-free log of the same arm, from
seven weeks before to a week after, and two logs with a known load are read sample by sample as a
controller would. Where nothing touches the arm the truth is zero; a load's truth is its weight and
inertia, read at its point of action, which the first 10 s of the log tell.

The figures are those of `force_only`, whose band holds the torque error alone; below `bayesian` the
same with the live prior, which is right about a force that is zero and so holds it more often, and
below `refreshed` those of the model whose friction was found again from the log's first
REFRESH_SECONDS, over the rest of it; with a load, from those of the same motion's or day's log
without. Below `widened`, where `estimate` says of a log that its friction is not the model's, the
same with the drift, joint by joint, that it then allows for: the band of a whole log, which a
controller that has read no second of it cannot have. Below `tracked`, from TRACKED_FROM on, the
same as a controller reads it that follows friction (`wrenchsight.models.detection.
tracked_estimator`), and has read nothing but these seconds.

**Rest** is where no joint has moved faster than REST_SPEED for .3 s, **reversal** where a joint
turns round within .15 s, **sliding** all else.

Not blind: the drift of friction, an assumption, was settled with these logs in sight, and so were
the forms of the law and of the lag in the band. How long a joint takes to rest and how far its slip
reaches come from the three fitted runs.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from wrenchsight.analyses.experiments.setups.ur10e_recordings.known_payload import force_of_load
from wrenchsight.analyses.experiments.setups.ur10e_recordings.log_figures import (
    axes_of,
    bar_rows,
)
from wrenchsight.analyses.experiments.setups.ur10e_recordings.ur10e_logs import (
    FOLDER,
    LOADS,
    MORE,
    log_file,
    presliding_arm,
)
from wrenchsight.analyses.methods.estimate.engines import covariance_about
from wrenchsight.analyses.methods.estimate.friction_watch import FrictionWatch
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
from wrenchsight.models.estimation.point_of_action import jacobian_at
from wrenchsight.models.estimation.reading_gain import ReadingGain
from wrenchsight.models.estimation.wrench import WrenchEstimate, WrenchReconstructionConfig
from wrenchsight.models.estimation.wrench_reading import ReadingSample
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.recordings.position_resolution import position_resolution
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.recordings.resampling import resampled
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.signals.bands import SIGMA_95

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
MARGIN = 100  # samples left out at both ends
FEWEST = 30  # samples of a regime


def run(context: ExperimentContext) -> ExperimentResult:
    """Identifies, reads every log, and counts how often the band holds the truth."""
    robot, model = presliding_arm(context, 0.6)
    metrics: dict[str, Any] = {}
    renewed: dict[str, IdentifiedModel] = {}
    for k, (log, mass) in enumerate(LOADS.items()):
        context.progress(0.6 + 0.35 * k / len(LOADS), log)
        recording = read_recording(log_file(context.data, log), robot=robot)
        own = _log_metrics(recording, mass, robot, model, MARGIN)
        begin = MARGIN
        if mass == 0.0 and "sliding" in own:
            config = RefreshConfig(part=[0.0, REFRESH_SECONDS])
            renewed[log] = refresh_model(recording, robot, model, config).model
            begin += round(REFRESH_SECONDS / TIME_STEP)
            drift = _drift_told(recording, robot, model)
            if drift is not None and model.torque_error is not None:
                error = replace(model.torque_error, drift_shown=drift)
                wide = replace(model, torque_error=error)
                told = _log_metrics(recording, mass, robot, model, MARGIN, wide)
                own["widened"] = {"drift": drift, **told}
        if "sliding" in own:
            first = round(TRACKED_FROM / TIME_STEP)
            own["tracked"] = _log_metrics(recording, mass, robot, model, first, tracked=True)
        source = REFRESHED_BY.get(log, log)
        if source in renewed:
            own["refreshed"] = _log_metrics(recording, mass, robot, renewed[source], begin)
        metrics[log] = own
    context.progress(0.95, "figure")
    none = {"all": {"inside_95_pct": [np.nan] * 3}}
    cases = {"inside [%]": list(metrics.values())}
    for case in ("widened", "refreshed"):
        cases[f"inside, {case} [%]"] = [own.get(case, none) for own in metrics.values()]
    shares = {
        words: axes_of([own["all"]["inside_95_pct"] for own in case])
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


def _drift_told(recording: Recording, robot: Robot, model: IdentifiedModel) -> Array | None:
    """(n,) drift that `estimate` allows for in the band of a contact-free log; None: nothing."""
    uniform = resampled(recording, TIME_STEP)
    estimator = WrenchEstimator(robot, model, _config(recording))
    seen = estimator.observe(uniform.q, uniform.v, uniform.current)
    watch = FrictionWatch(model, estimator.chain, estimator.observer.pole, TIME_STEP)
    known = seen.fresh & ~uniform.dropout
    watch.add(uniform.t, uniform.q, uniform.v, seen.tau_ext, known, np.ones_like(known))
    return watch.drifts()


def _log_metrics(
    recording: Recording,
    mass: float,
    robot: Robot,
    model: IdentifiedModel,
    begin: int,
    wide: IdentifiedModel | None = None,
    tracked: bool = False,
) -> dict[str, Any]:
    """What `model` reads, with the band of `wide`, if given, or with friction that is followed."""
    uniform = resampled(recording, TIME_STEP)
    found: dict[str, Any] = {}
    for method in ("force_only", "bayesian"):
        config = _config(recording, method)
        estimator = WrenchEstimator(robot, model, config)
        if not estimator.learnt:
            raise ValueError("the model has no torque error")
        seen = estimator.observe(uniform.q, uniform.v, uniform.current)
        J, truth = seen.J, np.zeros((len(seen.J), 3))
        if mass > 0.0:
            Sigma_tau = model.residual_covariance
            point, truth = force_of_load(robot, uniform, J, seen.tau_ext, Sigma_tau, mass)
            J = jacobian_at(J, robot.chain.pose(uniform.q)[0], point)

        def read(own: WrenchEstimator, J: Array = J, seen: Observation = seen) -> WrenchEstimate:
            """The reading at the point of action."""
            log = uniform.q, uniform.v, seen.transmitted, J
            error = own.error.run(own.error.initial_state(), *log)
            lost, observed = np.zeros(len(J), bool), np.empty((len(J), 0))
            state = own.reading.initial_state()
            sample = ReadingSample(J, seen.tau_ext, seen.fresh, lost, observed)
            return own.reading.run(state, error, sample)

        variance = None
        if tracked:
            follower = TrackedEstimator(robot, model, config)
            estimator = follower.estimator
            batch, _ = follower.run(uniform.q, uniform.v, uniform.current)
            seen = seen._replace(tau_ext=batch.tau_ext)
            log = uniform.q, uniform.v, seen.transmitted, J
            error = estimator.error.run(estimator.error.initial_state(), *log)
            variance = batch.torque_sd**2 - error.sd**2
            at_point = batch._replace(J_seen=error.J_seen, torque_sd=error.sd)
            gain = ReadingGain(estimator).of(at_point)
        wrench, covariance, _, valid = read(estimator, J, seen)
        if variance is not None:
            covariance = covariance + (gain * variance[:, None, :]) @ gain.transpose(0, 2, 1)
        if wide is not None:
            mean, covariance, _, still = read(WrenchEstimator(robot, wide, config))
            covariance, valid = covariance_about(wrench, mean, covariance), valid & still
        sd = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))[:, 3:]
        kept = ~uniform.dropout
        kept[:begin] = kept[-MARGIN:] = False
        parts = {
            name: _counted(
                wrench[rows & kept, 3:] - truth[rows & kept], sd[rows & kept], valid[rows & kept]
            )
            for name, rows in regimes(uniform.v).items()
            if (rows & kept).sum() >= FEWEST
        }
        found |= parts if method == "force_only" else {method: parts}
    return found


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


def _counted(error: Array, sd: Array, valid: Flags) -> dict[str, Any]:
    return {
        "inside_95_pct": 100.0 * np.mean(np.abs(error) <= SIGMA_95 * sd, axis=0),
        "rmse_n": np.sqrt(np.mean(error**2, axis=0)),
        "share_valid_pct": 100.0 * float(valid.mean()),
        "largest_valid_n": np.abs(error[valid]).max(axis=0) if valid.any() else np.zeros(3),
    }


def _comparison() -> list[ComparisonRow]:
    inside, before = "Inside the stated 95 % band, x y z", "ur-19_12_23_free"
    rows = {
        "a week after the fit": "ur-20_02_19_15harm50sec",
        "seven weeks before it": before,
        "the same as `estimate` states it, by the drift that the log shows": f"{before}.widened",
        f"the same as a controller reads it after {TRACKED_FROM:g} s, friction followed": (
            f"{before}.tracked"
        ),
        f"the same with friction refreshed from {REFRESH_SECONDS:g} s": f"{before}.refreshed",
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
        logs = {name: own.get(case, {}) if case else own for name, own in metrics.items()}
        shares = "; ".join(
            f"`{name}` " + " ".join(f"{share:.0f}" for share in own["all"]["inside_95_pct"])
            for name, own in logs.items()
            if own
        )
        notes += [f"Inside the 95 % band, x y z, {words}: {shares} %."] if shares else []
    return notes


EXPERIMENT = Experiment(
    name="ur10e-trust",
    title="Coverage of the stated uncertainty on logs of other days",
    section="recordings of a UR10e",
    run=run,
    needs=(FOLDER, MORE),
    order=155,
    seconds=90,
    readme=(
        "ur-20_02_19_15harm50sec.all.inside_95_pct",
        "ur-19_12_23_free.all.inside_95_pct",
        "ur-19_12_23_free.widened.all.inside_95_pct",
        "ur-19_12_23_free.refreshed.all.inside_95_pct",
    ),
)
