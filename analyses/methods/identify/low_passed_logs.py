"""What an identification begins with: logs on a uniform grid, low-passed, and their regressors."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wrenchsight.analyses.methods.identify.identification_config import (
    IdentificationConfig,
    IdentifySettings,
)
from wrenchsight.analyses.methods.identify.torque_fit import TorqueFit
from wrenchsight.analyses.methods.reference_sensor.reference_config import reference_columns
from wrenchsight.analyses.output.result_marker import file_checksum
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.friction_law import FrictionLaw
from wrenchsight.models.identification.identified_model import LogSource
from wrenchsight.models.identification.torque_regression import RegressionRows
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.lerobot.data_set import file_of, root_of
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.recordings.resampling import ROUNDING, resampled
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.signals.zero_phase import ZeroPhaseLowPass, derivative

ProgressCallback = Callable[[float, str], None]

# A joint that moves less, or slower, than this shows neither its friction nor its inertia.
LEAST_TRAVEL, LEAST_SLIDE = 0.05, 0.02  # rad, and m of a joint that slides, peak to peak
LEAST_SPEED = 0.01  # rad/s or m/s
LARGEST_CUTOFF = 0.25  # of a log's rate
# In periods of the cutoff:
POINTS = 20.0  # grid points on which the regressor is built; its harmonics fold back beyond 10
TRIM = 2.5  # filter transients at both ends of a log
DROPOUT_WINDOW = 1.0  # stretch whose share of bridged samples is judged
SHORTEST_LOG = 25.0
DROPOUT_SHARE = 0.1  # of such a stretch; shorter bridges are what the low-pass would draw itself


@dataclass(frozen=True, eq=False)
class LowPassedLog:
    """One log, low-passed."""

    name: str
    log: LogSource
    t: Array  # (T,)
    q: Array  # (T, n), as the rest
    v: Array
    vdot: Array
    tau: Array
    used: NDArray[np.bool_]  # (T,) clear of filter transients and drop-outs
    low_pass: ZeroPhaseLowPass  # at the rate of these samples
    filter_regressor: bool

    def match(self, x: Array) -> Array:
        """Gives what is computed from the filtered signals the band of the filtered torque."""
        return self.low_pass(x) if self.filter_regressor else x

    def predict(self, chain: SerialChain, friction: FrictionLaw) -> TorqueFit:
        """Measured and predicted torque where samples are used; inertias of `chain`."""
        rigid = np.asarray(chain.inverse_dynamics(self.q, self.v, self.vdot))
        predicted = self.match(rigid + friction.torque_along(self.q, self.v, rigid))
        return TorqueFit(self.name, self.t[self.used], self.tau[self.used], predicted[self.used])


def check_recording(recording: Recording, robot: Robot) -> None:
    """Raises InputError for a log that has another number of joints than the robot."""
    if recording.num_joints != robot.num_joints:
        raise InputError(
            recording.source,
            "",
            f"the log has {recording.num_joints} joints, robot '{robot.name}' has "
            f"{robot.num_joints}",
            "name the log's own robot with --robot",
        )


def median_step(recordings: Sequence[Recording]) -> float:
    """The longest of the logs' median steps, to three digits: the others are jitter."""
    return float(f"{max(recording.time_step for recording in recordings):.3g}")


def long_enough(
    recordings: list[Recording], config: IdentificationConfig
) -> tuple[list[Recording], list[str]]:
    """The episodes of data sets that last as long as a fit needs, other logs, and a sentence on the
    rest. Where all are too short, all: `low_pass_log` refuses them.
    """
    least = SHORTEST_LOG / config.cutoff
    short = [
        one
        for one in recordings
        if missing_time(one, least) > 0.0 and root_of(Path(one.source)) is not None
    ]
    if not short or len(short) == len(recordings):
        return recordings, []
    sentence = (
        f"{len(short)} of {len(recordings)} episodes are left out: shorter than the {least:.3g} s "
        f"that a cutoff of {config.cutoff:g} Hz needs"
    )
    return [one for one in recordings if not any(one is own for own in short)], [sentence]


def missing_time(recording: Recording, needed: float) -> float:
    """By how many s a log, from its first sample to its last, is shorter than the `needed` s.

    0 where it is long enough; what times are rounded by (ROUNDING of a step) is not missing.
    """
    missing = needed - recording.duration
    return missing if missing > ROUNDING * recording.time_step else 0.0


def _refuse_short(recording: Recording, cutoff: float, periods: float) -> None:
    needed = periods / cutoff
    missing = missing_time(recording, needed)
    if missing == 0.0:
        return
    # Two digits of what is missing: so many decimals tell the length from the one that is needed.
    decimals = max(2, 1 - math.floor(math.log10(missing)))
    unit, grain = 10.0**decimals, 1e-6
    lasts = math.floor(recording.duration * unit + grain)
    needs = math.ceil(needed * unit - grain)
    length, least, short = (
        f"{count / unit:.{decimals}f}".rstrip("0").rstrip(".")
        for count in (lasts, needs, needs - lasts)
    )
    remedy = "record a longer log"
    if periods == SHORTEST_LOG and recording.duration > 0.0:  # else the cutoff is the model's
        higher = _rounded_up(periods / recording.duration)
        if recording.time_step * higher <= LARGEST_CUTOFF:
            remedy += f", or raise --cutoff-hz to {higher:g}"
    raise InputError(
        recording.source,
        "",
        f"the log lasts {length} s from its first sample to its last; at a cutoff of {cutoff:g} Hz "
        f"it must last {least} s ({periods:g} periods of the cutoff): {short} s more",
        remedy,
    )


def _rounded_up(x: float) -> float:
    """A positive number to three digits, no smaller than it is."""
    unit = 10.0 ** (math.floor(math.log10(x)) - 2)
    return float(f"{math.ceil(x / unit) * unit:.3g}")


def read_log(path: Path, settings: IdentifySettings, robot: Robot) -> Recording:
    """A log of `settings.logs`, read as they say.

    Raises:
        InputError: as `read_recording`.
    """
    return read_recording(
        path,
        settings.log_format,
        robot,
        settings.check,
        accept_signs=settings.accept_signs,
        joint_signals=True,
        further=reference_columns(settings.refreshing.reference),
    )


def log_names(recordings: Sequence[Recording]) -> list[str]:
    """Stems of the logs' file names; a repeated one gets a number."""
    names: list[str] = []
    for recording in recordings:
        stem = Path(recording.source).stem or "log"
        name, count = stem, 1
        while name in names:
            count += 1
            name = f"{stem}_{count}"
        names.append(name)
    return names


def low_pass_log(
    name: str,
    recording: Recording,
    robot: Robot,
    config: IdentificationConfig,
    shortest: float = SHORTEST_LOG,
) -> LowPassedLog:
    """Resamples and low-passes a log.

    Raises:
        InputError: a rate too low for the cutoff, less than `shortest` periods of it, or drop-outs
            everywhere.
    """
    step, cutoff = config.time_step, config.cutoff
    if step * cutoff > LARGEST_CUTOFF:
        raise InputError(
            recording.source,
            "",
            f"a cutoff of {cutoff:g} Hz needs {cutoff / LARGEST_CUTOFF:g} samples a second or "
            f"more, there are {1 / step:.4g}",
            f"add --cutoff-hz {LARGEST_CUTOFF / step:.2g}",
        )
    _refuse_short(recording, cutoff, shortest)
    uniform = resampled(recording, step)
    tau = uniform.tau_J
    if tau is None:
        tau = robot.joint_torque(uniform.current)
    low_pass = ZeroPhaseLowPass(cutoff, step, config.filter_order)
    q, v, tau = low_pass(uniform.q), low_pass(uniform.v), low_pass(tau)
    vdot = derivative(v, step)
    trim = int(np.ceil(TRIM / cutoff / step))
    window = max(1, round(DROPOUT_WINDOW / cutoff / step))
    bridged = np.convolve(uniform.dropout, np.full(window, 1.0 / window), "same")
    used = bridged <= DROPOUT_SHARE
    used[:trim] = used[len(used) - trim :] = False
    if not used.any():
        raise InputError(recording.source, "", "no stretch of the log is free of drop-outs")
    # The signals hold nothing above the cutoff any more: a coarser grid loses nothing.
    every = max(1, int(1.0 / (step * POINTS * cutoff)))
    path = file_of(Path(recording.source))
    rows = recording.row
    return LowPassedLog(
        name=name,
        log=LogSource(
            name=Path(recording.source).name,
            sha256=file_checksum(path) if path.is_file() else "",
            first_row=1 if rows is None else int(rows[0]),
            last_row=recording.num_samples if rows is None else int(rows[-1]),
            duration=round(recording.duration, 6),
        ),
        t=uniform.t[::every],
        q=q[::every].copy(),
        v=v[::every].copy(),
        vdot=vdot[::every].copy(),
        tau=tau[::every].copy(),
        used=used[::every],
        low_pass=replace(low_pass, time_step=step * every),
        filter_regressor=config.filter_regressor,
    )


def _check_motion(runs: Sequence[LowPassedLog], robot: Robot) -> None:
    used_q = np.vstack([run.q[run.used] for run in runs])
    travel = np.ptp(used_q, axis=0)
    speed = np.max([np.abs(run.v[run.used]).max(axis=0) for run in runs], axis=0)
    least = np.where(robot.chain.prismatic, LEAST_SLIDE, LEAST_TRAVEL)
    still = np.flatnonzero((travel < least) | (speed < LEAST_SPEED))
    if still.size:
        units = ["m" if prismatic else "rad" for prismatic in robot.chain.prismatic]
        result = ", ".join(
            f"{robot.joint_names[i]} ({travel[i]:.2g} {units[i]}, at most {speed[i]:.2g} "
            f"{units[i]}/s)"
            for i in still
        )
        raise InputError(
            ", ".join(run.log.name for run in runs),
            "",
            f"too little motion of {result}",
            f"log a motion in which each joint travels {LEAST_TRAVEL:g} rad ({LEAST_SLIDE:g} m) "
            "and more",
        )


def decimation(low_pass: ZeroPhaseLowPass) -> int:
    """Samples per row of the fit: about two rows a period of the cutoff hold all there is."""
    return max(1, int(0.5 / (low_pass.cutoff * low_pass.time_step)))


def low_pass_logs(
    recordings: Sequence[Recording],
    robot: Robot,
    validation: Sequence[Recording],
    config: IdentificationConfig,
    progress: ProgressCallback,
) -> tuple[tuple[LowPassedLog, ...], tuple[LowPassedLog, ...], tuple[RegressionRows, ...]]:
    """What all fits of the same logs begin with.

    Returns:
        The logs to be fitted and those to validate on, low-passed, and regressors of the former.
    """
    logs = [*recordings, *validation]
    steps = len(logs) + len(recordings) + 1
    runs = []
    for k, (name, recording) in enumerate(zip(log_names(logs), logs, strict=True)):
        progress(k / steps, f"filtering {name}")
        runs.append(low_pass_log(name, recording, robot, config))
    fitted, selected = tuple(runs[: len(recordings)]), tuple(runs[len(recordings) :])
    _check_motion(fitted, robot)
    every = decimation(fitted[0].low_pass)
    regressions = []
    for k, run in enumerate(fitted):
        progress((len(logs) + k) / steps, f"regressor of {run.name}")
        rows = np.flatnonzero(run.used)[::every]
        regressions.append(
            RegressionRows.of(robot.chain, run.q, run.v, run.vdot, run.tau, run.match, rows)
        )
    return fitted, selected, tuple(regressions)
