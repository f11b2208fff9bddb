"""Logs on a uniform grid, low-passed, with their regressors: the start of an identification."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wrenchsight.analyses.methods.identify.identification_config import (
    IdentificationConfig,
    IdentifySettings,
)
from wrenchsight.analyses.methods.identify.torque_fit import TorqueFit
from wrenchsight.analyses.methods.reference_sensor.reference_config import reference_columns
from wrenchsight.analyses.output.distinct_names import distinct_names
from wrenchsight.analyses.output.progress import ProgressCallback
from wrenchsight.analyses.output.result_marker import file_checksum
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.friction_law import FrictionLaw
from wrenchsight.models.identification.identified_model import LogSource
from wrenchsight.models.identification.least_motion import LEAST_SLIDE, LEAST_TRAVEL, moves
from wrenchsight.models.identification.rests import arm_rests
from wrenchsight.models.identification.torque_regression import JointMotion, RegressionRows
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.recordings.lerobot.data_set import episode_paths, file_of, root_of
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.recordings.resampling import TIME_TOLERANCE, resampled
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.signals.zero_phase import ZeroPhaseLowPass, derivative

LARGEST_CUTOFF = 0.25  # of a log's rate
# In periods of the cutoff:
GRID_POINTS = 20.0  # grid points on which the regressor is built; its harmonics fold back beyond 10
TRIM_PERIODS = 2.5  # filter transients at both ends of a log
SHORTEST_LOG = 25.0
DROPOUT_WINDOW = 1.0  # stretch whose share of bridged samples is judged
DROPOUT_SHARE = 0.1  # of such a stretch; shorter bridges are what the low-pass would draw itself
_UNIT_ROUNDING = 1e-6  # of a time's last decimal that is printed


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
        prismatic = np.asarray(chain.prismatic, bool)
        rests = ~moves(self.q[self.used], self.v[self.used], prismatic)
        v = np.where(rests, 0.0, self.v)  # the sign of a resting joint's velocity is noise
        predicted = self.match(rigid + friction.torque_along(self.q, v, rigid))
        return TorqueFit(self.name, self.t[self.used], self.tau[self.used], predicted[self.used])


class LowPassedLogs(NamedTuple):
    """Low-passed logs, from which all fits of them begin.

    Attributes:
        fitted: logs to fit.
        validation: logs to predict, not fitted.
        regressions: rows of the regressor of each fitted log.
    """

    fitted: tuple[LowPassedLog, ...]
    validation: tuple[LowPassedLog, ...]
    regressions: tuple[RegressionRows, ...]


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
    """Leaves out the episodes of data sets that are too short for a fit.

    Where all are too short, all stay: `low_pass_log` refuses them. Logs that are no episodes stay.

    Returns:
        The logs that stay, and a sentence on those left out, if there are any.
    """
    least = SHORTEST_LOG / config.cutoff
    is_short = [
        missing_time(recording, least) > 0.0 and root_of(Path(recording.source)) is not None
        for recording in recordings
    ]
    if not any(is_short) or all(is_short):
        return recordings, []
    sentence = (
        f"{sum(is_short)} of {len(recordings)} episodes are left out: shorter than the "
        f"{least:.3g} s that a cutoff of {config.cutoff:g} Hz needs"
    )
    long = [log for log, short in zip(recordings, is_short, strict=True) if not short]
    return long, [sentence]


def missing_time(recording: Recording, needed: float) -> float:
    """Time in s that a log, from its first sample to its last, is shorter than `needed`.

    0 where it is long enough, up to the rounding of its times (TIME_TOLERANCE of a step).
    """
    missing = needed - recording.duration
    return missing if missing > TIME_TOLERANCE * recording.time_step else 0.0


def _refuse_short(recording: Recording, cutoff: float, periods: float) -> None:
    """Raises InputError for a log shorter than `periods` of the low-pass's cutoff in Hz.

    The message states length, needed length and difference in decimals that add up.
    """
    needed = periods / cutoff
    missing = missing_time(recording, needed)
    if missing == 0.0:
        return
    # Two digits of the missing time: with so many decimals length and needed length differ. The
    # length is rounded down and the needed one up, but for the last bits of their products.
    decimals = max(2, 1 - math.floor(math.log10(missing)))
    units_per_second = 10.0**decimals
    actual_units = math.floor(recording.duration * units_per_second + _UNIT_ROUNDING)
    needed_units = math.ceil(needed * units_per_second - _UNIT_ROUNDING)

    def seconds(units: int) -> str:
        return f"{units / units_per_second:.{decimals}f}".rstrip("0").rstrip(".")

    length, least = seconds(actual_units), seconds(needed_units)
    short = seconds(needed_units - actual_units)
    remedy = "record a longer log"
    if _is_free_cutoff(periods) and recording.duration > 0.0:
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
        joint_signals=True,
        further=reference_columns(settings.refreshing.reference),
    )


def read_episodes(
    paths: Sequence[Path], settings: IdentifySettings, robot: Robot
) -> list[Recording]:
    """Logs as `read_log`; of a data set each of its episodes."""
    return [read_log(episode, settings, robot) for path in paths for episode in episode_paths(path)]


def log_names(recordings: Sequence[Recording]) -> list[str]:
    """Stems of the logs' file names; a repeated one gets a number."""
    return distinct_names([Path(recording.source).stem or "log" for recording in recordings])


def _is_free_cutoff(periods: float) -> bool:
    """Whether the cutoff is an option's, by the periods of it that a log must last.

    Callers that need other than SHORTEST_LOG take a known model's, which no option changes.
    """
    return periods == SHORTEST_LOG


def _refuse_slow(recording: Recording, cutoff: float, step: float, periods: float) -> None:
    """Raises InputError for a time step in s that is too long for the cutoff in Hz.

    Args:
        periods: as `_refuse_short`.
    """
    if step * cutoff <= LARGEST_CUTOFF:
        return
    remedy = "record with a higher rate"
    if _is_free_cutoff(periods):
        remedy = f"add --cutoff-hz {LARGEST_CUTOFF / step:.2g}"
    raise InputError(
        recording.source,
        "",
        f"a cutoff of {cutoff:g} Hz needs {cutoff / LARGEST_CUTOFF:g} samples a second or more, "
        f"there are {1 / step:.4g}",
        remedy,
    )


def _clear_samples(dropout: Flags, step: float, cutoff: float) -> Flags:
    """(T,) samples clear of the filter's transients at both ends, and of drop-outs around them."""
    trim = int(np.ceil(TRIM_PERIODS / cutoff / step))  # samples, as the window
    window = max(1, round(DROPOUT_WINDOW / cutoff / step))
    missing_share = np.convolve(dropout, np.full(window, 1.0 / window), "same")
    clear = missing_share <= DROPOUT_SHARE
    clear[:trim] = False
    clear[len(clear) - trim :] = False
    return np.asarray(clear)


def low_pass_log(
    name: str,
    recording: Recording,
    robot: Robot,
    config: IdentificationConfig,
    shortest: float = SHORTEST_LOG,
) -> LowPassedLog:
    """Resamples and low-passes a log.

    Samples do not count (`used`) near the log's ends, where the filter has edges, nor where more
    than DROPOUT_SHARE of what the filter sees is missing.

    Args:
        config: with the time step of the grid.
        shortest: periods of the cutoff that a log must last.

    Raises:
        InputError: a rate too low for the cutoff, less than `shortest` periods of it, or drop-outs
            everywhere.
    """
    step, cutoff = config.time_step, config.cutoff
    _refuse_slow(recording, cutoff, step, shortest)
    _refuse_short(recording, cutoff, shortest)
    uniform = resampled(recording, step)
    tau = uniform.tau_J
    if tau is None:
        tau = robot.joint_torque(uniform.current)
    low_pass = ZeroPhaseLowPass(cutoff, step, config.filter_order)
    q, v, tau = low_pass(uniform.q), low_pass(uniform.v), low_pass(tau)
    vdot = derivative(v, step)
    used = _clear_samples(uniform.dropout, step, cutoff)
    if not used.any():
        raise InputError(recording.source, "", "no stretch of the log is free of drop-outs")
    # The signals hold nothing above the cutoff any more: a coarser grid loses nothing.
    # Copies below: a view would keep the fine grid in memory.
    decimated = slice(None, None, max(1, int(1.0 / (step * GRID_POINTS * cutoff))))
    path = file_of(Path(recording.source))
    rows = recording.row  # of the log's file, from 1; None: they are not known
    return LowPassedLog(
        name=name,
        log=LogSource(
            name=Path(recording.source).name,
            sha256=file_checksum(path) if path.is_file() else "",
            first_row=1 if rows is None else int(rows[0]),
            last_row=recording.num_samples if rows is None else int(rows[-1]),
            duration=round(recording.duration, 6),
        ),
        t=uniform.t[decimated],
        q=q[decimated].copy(),
        v=v[decimated].copy(),
        vdot=vdot[decimated].copy(),
        tau=tau[decimated].copy(),
        used=used[decimated],
        # For what is computed from these signals, at their rate.
        low_pass=replace(low_pass, time_step=step * decimated.step),
        filter_regressor=config.filter_regressor,
    )


def _check_motion(runs: Sequence[LowPassedLog], robot: Robot) -> None:
    used_q = np.vstack([run.q[run.used] for run in runs])
    used_v = np.vstack([run.v[run.used] for run in runs])
    still = np.flatnonzero(~moves(used_q, used_v, robot.chain.prismatic))
    if still.size:
        travel, speed = np.ptp(used_q, axis=0), np.abs(used_v).max(axis=0)
        units = ["m" if prismatic else "rad" for prismatic in robot.chain.prismatic]
        motions = ", ".join(
            f"{robot.joint_names[i]} ({travel[i]:.2g} {units[i]}, at most {speed[i]:.2g} "
            f"{units[i]}/s)"
            for i in still
        )
        raise InputError(
            ", ".join(run.log.name for run in runs),
            "",
            f"too little motion of {motions}",
            f"log a motion in which each joint travels {LEAST_TRAVEL:g} rad ({LEAST_SLIDE:g} m) "
            "and more",
        )


def _informative(log: LowPassedLog) -> NDArray[np.bool_]:
    """(T,) used samples, but for the arm's rests, where friction is anything in its band."""
    moving = log.used & ~arm_rests(log.v, log.low_pass.time_step)
    return moving if moving.any() else log.used


def resting_joints(logs: "LowPassedLogs", robot: Robot) -> list[NDArray[np.bool_]]:
    """(n,) for each fitted log the joints that rest throughout."""
    prismatic = np.asarray(robot.chain.prismatic, bool)
    return [~moves(log.q[log.used], log.v[log.used], prismatic) for log in logs.fitted]


def decimation(low_pass: ZeroPhaseLowPass) -> int:
    """Samples per row of the fit: about two rows a period of the cutoff carry all information."""
    return max(1, int(0.5 / (low_pass.cutoff * low_pass.time_step)))


def low_pass_logs(
    recordings: Sequence[Recording],
    robot: Robot,
    validation: Sequence[Recording],
    config: IdentificationConfig,
    progress: ProgressCallback,
) -> LowPassedLogs:
    """Low-passes all logs and builds the regressors of those to be fitted.

    Args:
        recordings: to be fitted.
        validation: to be predicted alone.
        config: with the time step of the grid.
        progress: called with the share of these steps done, 0 to 1.

    Returns:
        Logs in which the arm's rests do not count (`used`), unless there is nothing else.

    Raises:
        InputError: as `low_pass_log`; joints that hardly move.
    """
    logs = [*recordings, *validation]
    steps = len(logs) + len(recordings) + 1  # of the progress
    low_passed = []
    for k, (name, recording) in enumerate(zip(log_names(logs), logs, strict=True)):
        progress(k / steps, f"filtering {name}")
        log = low_pass_log(name, recording, robot, config)
        # At rest friction is anything in its band: neither a fit nor its error is judged there.
        low_passed.append(replace(log, used=_informative(log)))
    fitted, validated = low_passed[: len(recordings)], low_passed[len(recordings) :]
    _check_motion(fitted, robot)
    row_step = decimation(fitted[0].low_pass)  # all have one cutoff and grid
    regressions = []
    for k, log in enumerate(fitted):
        progress((len(logs) + k) / steps, f"regressor of {log.name}")
        rows = np.flatnonzero(log.used)[::row_step]
        motion = JointMotion(log.q, log.v, log.vdot)
        regressions.append(RegressionRows.of(robot.chain, motion, log.tau, log.match, rows))
    return LowPassedLogs(tuple(fitted), tuple(validated), tuple(regressions))
