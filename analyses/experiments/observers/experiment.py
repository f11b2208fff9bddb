"""Experiment `observers`: every registered observer side by side, on real and simulated logs.

The UR10e's model is fitted on three unloaded runs and read on all its other logs: as they are (the
truth is zero), with pushes put in (`put_in_pushes`), and with a known load, read where it acts. The
simulated arm has the model of its own logs. Excitation 2, which it was not fitted on, is read, with
and without pushes. The torque error is learnt from excitation 1 with each joint mirrored within its
range: another motion, as fast as the one that is read; slow passes do not show this error. Each
observer has its default settings; the UR10e's currents are samples of a continuous signal.

The figures of each reading are its error, its mean error (`bias_n`), the shift in time at which it
fits the truth best (`delay_s`, where the truth changes), the part faster than NOISE_CUTOFF
(`noise_n`), and the share inside the stated 95 % band. They are those of `force_only`, whose band
holds the torque error alone; below `bayesian` the same with the live prior. `kalman-smoothed` is no
observer: it reads also the samples after each one (`models.estimation.smoothing`). Figure and notes
judge valid samples. Where no observer's reading of a log is valid, they judge all its samples, and
say so.

Not blind: the kalman observer's bandwidth and its share of white noise were settled on the three
fitted runs with pushes and slow forces put in. That stiction lasts as long as a joint rests was put
into the kalman observer after `ur-20_01_17-p1` had been seen. The torque error's law was settled
with p1 to p5 in sight. The kalman observer's rule for a changed force was settled on
`simulated-pushes` of seed 0, with the UR10e's logs in sight. The rule of smoothing was settled on
these pushes and `ur-20_02_10-20sec_7harm`, with and without.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from wrenchsight.analyses.experiments.observers.put_in_pushes import push_forces, pushed
from wrenchsight.analyses.experiments.setups.simulated_arm.arm_models import (
    identify_arm,
    read_contact_free,
)
from wrenchsight.analyses.experiments.setups.ur10e_recordings.log_figures import bar_rows
from wrenchsight.analyses.experiments.setups.ur10e_recordings.log_scenes import (
    TIME_STEP,
    Scene,
    loaded_scene,
)
from wrenchsight.analyses.experiments.setups.ur10e_recordings.ur10e_logs import (
    LOADS,
    log_file,
    presliding_arm,
)
from wrenchsight.analyses.methods.identify.torque_fit import rms
from wrenchsight.analyses.methods.simulate.simulated_logs import (
    PERIODS,
    ROBOT,
    simulate_excitation,
    stored_excitation,
)
from wrenchsight.analyses.study.experiment import (
    Drawing,
    Experiment,
    ExperimentContext,
    ExperimentResult,
)
from wrenchsight.models.estimation.estimator import (
    EstimateBatch,
    WrenchEstimator,
    WrenchEstimatorConfig,
)
from wrenchsight.models.estimation.smoothing import smoothed_estimate
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.identification.torque_error_fit import fit_torque_error
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.observers.kalman_observer import KalmanObserverConfig
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.observers.observer_kinds import OBSERVERS, kind_name
from wrenchsight.models.planning.excitation.fourier_trajectory import FourierTrajectory
from wrenchsight.models.recordings.position_resolution import position_resolution
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.recordings.resampling import resampled
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.signals.bands import SIGMA_95
from wrenchsight.models.signals.zero_phase import ZeroPhaseLowPass

PUSHED = ("ur-20_02_19_14harm50sec", "ur-20_02_19_15harm50sec", "ur-20_02_10-20sec_7harm")
PUSH, PUSH_TIME, PAUSE = 30.0, 0.5, 1.5  # N, s, s
LAW = "presliding"
MARGIN = 1.0  # s left out at both ends
NOISE_CUTOFF = 5.0  # Hz
DELAYS = np.arange(-0.05, 0.3005, 0.0025)  # s that are tried
METHODS = ("force_only", "bayesian")
SMOOTHED = "kalman-smoothed"


def run(context: ExperimentContext) -> ExperimentResult:
    """Reads every log by every observer."""
    scenes = {**_real_scenes(context), **_simulated_scenes(context)}
    kinds: dict[str, type] = {kind_name(kind): kind.Config for kind in OBSERVERS}
    kinds[SMOOTHED] = KalmanObserverConfig
    metrics: dict[str, Any] = {name: {} for name in kinds}
    for k, (log, scene) in enumerate(scenes.items()):
        context.progress(0.6 + 0.35 * k / len(scenes), log)
        for name, kind in kinds.items():
            result: dict[str, Any] = {}
            for method in METHODS:
                entry = _measured(scene, _read(scene, kind, method, name == SMOOTHED))
                result |= entry if method == METHODS[0] else {method: entry}
            metrics[name][log] = result
    context.progress(0.95, "figures")
    return ExperimentResult(
        metrics=metrics,
        figures=[_summary(metrics)],
        notes=_notes(metrics),
        configuration={"observers": {kind_name(kind): kind.Config() for kind in OBSERVERS}},
    )


def _real_scenes(context: ExperimentContext) -> dict[str, Scene]:
    robot, model = presliding_arm(context, 0.3)
    scenes = {}
    for name, mass in LOADS.items():
        log = log_file(context.data, name)
        if not log.is_file():
            continue
        recording = read_recording(log, robot=robot)
        if mass > 0.0:
            scenes[name] = loaded_scene(recording, mass, robot, model)
            continue
        uniform = resampled(recording, TIME_STEP)
        N, step = uniform.num_samples, position_resolution(recording.q)
        scenes[name] = Scene(uniform, np.zeros((N, 3)), robot, model, step)
        if name in PUSHED:
            rng = np.random.default_rng([context.seed, PUSHED.index(name)])
            forces = push_forces(N, TIME_STEP, PUSH, PUSH_TIME, PAUSE, rng)
            pushed_log = pushed(uniform, robot, forces)
            scenes[f"{name}-pushes"] = Scene(pushed_log, forces, robot, model, step)
    return scenes


def _simulated_scenes(context: ExperimentContext) -> dict[str, Scene]:
    robot = context.robot(ROBOT)
    models = identify_arm(robot, context.seed, context.quick, context.part(0.3, 0.55))
    recording = models.held_out[0]
    other = simulate_excitation(
        robot,
        mirrored(stored_excitation(robot, 1)),
        1 if context.quick else PERIODS,
        2 * context.seed,
        "excitation_1_mirrored",
        context.part(0.55, 0.6),
    ).recording
    model = _with_torque_error(models.models[LAW], robot, other)
    step = position_resolution(recording.q)
    N = recording.num_samples
    forces = push_forces(
        N, recording.time_step, PUSH, PUSH_TIME, PAUSE, np.random.default_rng(context.seed)
    )
    pushed_log = pushed(recording, robot, forces)
    return {
        "simulated": Scene(recording, np.zeros((N, 3)), robot, model, step, "held"),
        "simulated-pushes": Scene(pushed_log, forces, robot, model, step, "held"),
    }


def mirrored(trajectory: FourierTrajectory) -> FourierTrajectory:
    """The trajectory with every joint at the other end of the range that it has there."""
    q, _, _ = trajectory.sample(np.linspace(0.0, trajectory.period, 2000))
    return replace(
        trajectory,
        centre=q.max(axis=0) + q.min(axis=0) - trajectory.centre,
        sine=-trajectory.sine,
        cosine=-trajectory.cosine,
    )


def _with_torque_error(model: IdentifiedModel, robot: Robot, log: Recording) -> IdentifiedModel:
    """The model with the torque error that a contact-free log shows."""
    step = position_resolution(log.q)
    observer = MomentumObserverConfig(time_step=log.time_step)
    config = WrenchEstimatorConfig(observer, position_resolution=step.tolist())
    estimator = WrenchEstimator(robot, replace(model, torque_error=None), config)
    reading = read_contact_free(estimator, log, observer.K_0[0], log.t - log.t[0] > MARGIN)
    return replace(model, torque_error=fit_torque_error([reading]))


def _read(scene: Scene, kind: type, method: str, smoothed: bool) -> EstimateBatch:
    config = WrenchEstimatorConfig(
        kind(time_step=scene.recording.time_step, torque_samples=scene.torque_samples),
        WrenchReconstructionConfig(method),
        position_resolution=scene.resolution.tolist(),
    )
    estimator, log = WrenchEstimator(scene.robot, scene.model, config), scene.recording
    if smoothed:
        return smoothed_estimate(estimator, log.q, log.v, log.current)
    return estimator.run(estimator.initial_state(), log.q, log.v, log.current)


def _measured(scene: Scene, read: EstimateBatch) -> dict[str, Any]:
    force = read.wrench[:, 3:]
    step, N = scene.recording.time_step, scene.recording.num_samples
    margin = round(MARGIN / step)
    selected = ~scene.recording.dropout
    selected[:margin] = selected[-margin:] = False
    error = force - scene.truth
    noise = force - ZeroPhaseLowPass(NOISE_CUTOFF, step, 2)(force)
    inside = np.abs(error) <= SIGMA_95 * read.standard_deviation[:, 3:]
    valid = selected & read.valid
    changes = bool(np.ptp(scene.truth, axis=0).any())
    rows = np.flatnonzero(valid if valid.any() else selected)
    delay = _delay(scene.truth, force, rows, step) if changes else None
    return {
        "rmse_n": rms(error[selected]),
        "bias_n": error[selected].mean(axis=0),
        "delay_s": delay,
        "noise_n": rms(noise[selected]),
        "inside_95_pct": 100.0 * inside[selected].mean(axis=0),
        "share_valid_pct": 100.0 * float(valid.sum() / max(selected.sum(), 1)),
        "valid_rmse_n": rms(error[valid]) if valid.any() else None,
        "valid_inside_95_pct": 100.0 * inside[valid].mean(axis=0) if valid.any() else None,
        "num_samples": N,
    }


def _delay(truth: Array, force: Array, rows: Any, step: float) -> float | None:
    """The shift of the truth, s, at which a reading is nearest to it; None without samples."""
    if not len(rows):
        return None
    t = step * np.arange(len(truth))
    misses = []
    for delay in DELAYS:
        late = np.stack([np.interp(t[rows] - delay, t, axis) for axis in truth.T], axis=1)
        misses.append(float(np.mean((force[rows] - late) ** 2)))
    return float(DELAYS[int(np.argmin(misses))])


def total(metrics: Mapping[str, Any], key: str = "rmse_n") -> float:
    """Norm over the axes of a figure per axis."""
    return float(np.linalg.norm(metrics[key]))


def never_valid(metrics: Mapping[str, Any]) -> list[str]:
    """The logs of which no observer's reading is ever valid."""
    return [
        log
        for log in next(iter(metrics.values()))
        if all(entry[log]["valid_rmse_n"] is None for entry in metrics.values())
    ]


def _summary(metrics: Mapping[str, Any]) -> Drawing:
    logs, unread = list(next(iter(metrics.values()))), never_valid(metrics)

    def drawn(by_log: Mapping[str, Any], log: str, key: str) -> Any:
        value = by_log[log][key if log in unread else f"valid_{key}"]
        return [np.nan] * 3 if value is None else value

    rows = {
        "RMSE [N]": {
            name: [np.linalg.norm(drawn(by_log, log, "rmse_n")) for log in logs]
            for name, by_log in metrics.items()
        },
        "inside [%]": {
            name: [np.mean(drawn(by_log, log, "inside_95_pct")) for log in logs]
            for name, by_log in metrics.items()
        },
    }
    caption = (
        "Every observer on every log (force_only): error, and share inside, of the valid samples."
    )
    if unread:
        caption += f" (*): of all samples, as none is valid, on {', '.join(unread)}."
    marked = [f"{log} *" if log in unread else log for log in logs]
    return "observers", bar_rows(rows, marked), caption


def _notes(metrics: Mapping[str, Any]) -> list[str]:
    default, *others = metrics
    unread = never_valid(metrics)
    notes = []
    for name in others:
        errors = [
            (total(entry, "valid_rmse_n"), total(metrics[default][log], "valid_rmse_n"))
            for log, entry in metrics[name].items()
            if entry["valid_rmse_n"] is not None
            and metrics[default][log]["valid_rmse_n"] is not None
        ]
        better = sum(error < default_error for error, default_error in errors)
        notes.append(f"`{name}` errs less than `{default}` on {better} of {len(errors)} logs.")
    for name, entry in metrics.items():
        logs = [
            figures["valid_inside_95_pct"] for log, figures in entry.items() if log not in unread
        ]
        shares = [share for share in logs if share is not None]
        if shares:
            low, high = np.min(shares), np.max(shares)
            notes.append(f"The 95 % band of `{name}` holds {low:.0f} to {high:.0f} % by log, axis.")
    if unread:
        notes.append(f"No reading is valid of {', '.join(f'`{log}`' for log in unread)}.")
    return notes


EXPERIMENT = Experiment(
    name="observers",
    title="Observers compared: error and stated uncertainty",
    section="recordings of a UR10e",
    run=run,
    needs=("ur10e",),
    uses=("ur10e_more",),
    order=158,
    seconds=150,
)
