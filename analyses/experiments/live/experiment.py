"""Supports docs/live.md, "`study live` measures its benefit on logs of a UR10e".

Experiment `live`: wrench error, rate and latency of a UR10e read by `watch --track`.

The model is fitted on the three unloaded runs. Two other contact-free logs of the same arm, and one
with a known load, are read as `watch replay://LOG?rate=0 --track` reads them,
sample by sample, with all its defaults. All samples from START_TIME on are judged, valid or not.
Below `valid` are those that a controller may use; below `untracked` the same without `--track`.
Where nothing touches the arm the truth is zero. A load's truth is its weight and inertia at its
point of action, found from the first 10 s of the untracked reading.

`replay` and `rtde` are one log at real time: from its file, and from a controller of ours on this
computer that plays it at 500 Hz. The process that `watch` starts reads them. Latency is the time
from a sample's arrival to its reading's departure. It depends on the computer and its load.
"""

import tempfile
from contextlib import closing
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from wrenchsight.analyses.experiments.setups.ur10e_recordings.known_payload import (
    force_of_load,
)
from wrenchsight.analyses.experiments.setups.ur10e_recordings.log_figures import (
    axes_of,
    bar_rows,
)
from wrenchsight.analyses.experiments.setups.ur10e_recordings.ur10e_logs import (
    LOAD_MASSES,
    log_file,
    presliding_arm,
)
from wrenchsight.analyses.methods.watch.reader_process import make_live, read_stream
from wrenchsight.analyses.methods.watch.rtde_controller import RtdeController
from wrenchsight.analyses.methods.watch.session import live
from wrenchsight.analyses.methods.watch.sources import open_source
from wrenchsight.analyses.methods.watch.start_checks import StartChecks
from wrenchsight.analyses.methods.watch.watch_config import (
    WatchConfig,
    WatchSettings,
    load_watched,
)
from wrenchsight.analyses.study.experiment import (
    ComparisonRow,
    Experiment,
    ExperimentContext,
    ExperimentResult,
)
from wrenchsight.models.estimation.invalid_shares import invalid_pct
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.live.live_estimator import LiveConfig
from wrenchsight.models.live.reading import Reading
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.numerics.kernel import one_thread
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.recordings.resampling import resampled
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.signals.bands import SIGMA_95
from wrenchsight.models.signals.root_mean_square import rms

START_TIME = 5.0  # s
END_MARGIN = 1.0  # s at the end, in which the reference's filter has an edge
QUICK_TIME = 12.0  # s of a log, in a shortened run
PLAYED_LOG = "ur-20_02_19_14harm50sec"
PLAYED_TIME, PLAYED_TIME_QUICK = 15.0, 6.0  # s of it
_FIT_SHARE, _LOGS_SHARE = 0.3, 0.9  # of the progress, at which the fit and the logs are done
CONTROLLER_PERIOD = 0.002  # s, of the controller
SETTLING_TIME = 2.0  # s, after which latency counts
LOGS = ("ur-20_02_19_15harm50sec", "ur-19_12_23_free", "ur-19_12_23_load")


def run(context: ExperimentContext) -> ExperimentResult:
    """Identifies, reads every log with and without tracking, and two sources at real time.

    A log's metrics are those of the tracked reading; below `untracked` are the other's. Both are
    held against the truth that is found from the untracked one. `replay` and `rtde` are the sources
    (`sources`).
    """
    robot, model = presliding_arm(context, _FIT_SHARE)
    masses = {name: LOAD_MASSES[name] for name in LOGS}  # kg; 0 of a contact-free log
    metrics: dict[str, Any] = {}
    seconds = QUICK_TIME if context.quick else np.inf  # of each log
    with tempfile.TemporaryDirectory() as folder:
        model_path = Path(folder) / "model.yaml"  # `watch` reads a file
        model.save(model_path)
        for k, (log, mass) in enumerate(masses.items()):
            context.progress(_FIT_SHARE + (_LOGS_SHARE - _FIT_SHARE) * k / len(masses), log)
            plain, tracked = (
                read_log(log_file(context.data, log), model_path, track, seconds)
                for track in (False, True)
            )
            truth = truth_of(plain, robot, model, mass)
            metrics[log] = {**judged(tracked, truth), "untracked": judged(plain, truth)}
        context.progress(_LOGS_SHARE, "at real time")
        played_seconds = PLAYED_TIME_QUICK if context.quick else PLAYED_TIME
        metrics |= sources(
            log_file(context.data, PLAYED_LOG), model_path, robot, seconds=played_seconds
        )
    shares = {
        "inside [%]": axes_of([metrics[log]["inside_95_pct"] for log in masses]),
        "inside, without --track [%]": axes_of(
            [metrics[log]["untracked"]["inside_95_pct"] for log in masses]
        ),
    }
    conditions = f"by log, as `watch --track` reads them after {START_TIME:g} s, and without."
    return ExperimentResult(
        metrics=metrics,
        figures=[
            ("live", bar_rows(shares, list(masses)), f"Share inside the 95 % band, {conditions}")
        ],
        comparison=_comparison(),
        notes=NOTES,
        configuration={"loads_kg": masses},
    )


def read_log(log: Path, model: Path, track: bool, seconds: float = np.inf) -> list[Reading]:
    """Reads a log's first seconds as `watch` does, without its processes and views.

    What the stream brings besides readings, such as contacts and notices, is left out. The checks
    of the stream's start run along, as in `watch`.

    Args:
        track: whether friction is followed (`--track`).
        seconds: of the log's time.
    """
    settings, robot, model_read = load_watched(
        WatchSettings(
            source=f"replay://{quote(str(log))}?rate=0",
            robot="ur10e",
            model=str(model),
            watch=WatchConfig(live=LiveConfig(track=track)),
        )
    )
    source = open_source(settings.source, robot)
    reader = make_live(settings, robot, model_read, source)
    readings: list[Reading] = []

    def go_on() -> bool:
        return not readings or readings[-1].t - readings[0].t < seconds

    # One thread, as the reading process has: samples come one by one.
    with one_thread(), closing(source):
        checks = StartChecks(robot, model_read, settings.watch)
        read_stream(
            source,
            reader,
            lambda item: readings.append(item) if isinstance(item, Reading) else None,
            checks,
            go_on,
        )
    return readings


def truth_of(readings: list[Reading], robot: Robot, model: IdentifiedModel, mass: float) -> Array:
    """(N, 3) N, the force at E in axes of W that a load of `mass` kg exerts; zero without one."""
    if mass == 0.0:
        return np.zeros((len(readings), 3))
    q, tau_ext = (np.array([getattr(r, name) for r in readings]) for name in ("q", "tau_ext"))
    t, none = np.array([r.t for r in readings]), np.zeros_like(q)
    motion = Recording(t=t, q=q, v=none, current=none, source="")
    J = robot.chain.jacobian(q)
    return force_of_load(robot, motion, J, tau_ext, model.residual_covariance, mass)[1]


def judged(readings: list[Reading], truth: Array) -> dict[str, Any]:
    """Coverage, RMSE and share of valid samples of the force, by axis.

    Judged are the readings from START_TIME to END_MARGIN before the end, drop-outs left out; below
    `valid` only those that are valid.

    Args:
        readings: N of them, of one log.
        truth: (N, 3) N, the true force.
    """
    t = np.array([reading.t for reading in readings])
    is_judged = (t >= t[0] + START_TIME) & (t <= t[-1] - END_MARGIN)
    is_judged &= np.array([not reading.dropout for reading in readings])
    invalid = np.array([int(reading.invalid) for reading in readings])
    valid = invalid == 0
    error = np.array([reading.wrench[3:] for reading in readings]) - truth  # wrench: moment first
    sd = np.array([reading.sd[3:] for reading in readings])

    def figures_of(rows: Flags) -> dict[str, Any]:
        if not rows.any():
            return {"inside_95_pct": [None] * 3, "rmse_n": [None] * 3}
        return {
            "inside_95_pct": 100.0 * np.mean(np.abs(error[rows]) <= SIGMA_95 * sd[rows], axis=0),
            "rmse_n": rms(error[rows]),
        }

    return {
        **figures_of(is_judged),
        "share_valid_pct": 100.0 * float(valid[is_judged].mean()),
        "invalid": invalid_pct(invalid[is_judged]),
        "valid": figures_of(is_judged & valid),
    }


def sources(log: Path, model: Path, robot: Robot, seconds: float) -> dict[str, Any]:
    """Rate, loss and latency of a log at real time, from its file and from a controller."""
    recording = read_recording(log, robot=robot)
    recording = recording[recording.t < recording.t[0] + seconds + 1.0]
    metrics = {"replay": source_metrics(f"replay://{quote(str(log))}", model, seconds)}
    uniform = resampled(recording, CONTROLLER_PERIOD)
    with RtdeController([uniform], port=0) as controller:
        url = f"rtde://127.0.0.1:{controller.port}"
        metrics["rtde"] = source_metrics(url, model, seconds)
    return metrics


def source_metrics(url: str, model: Path, seconds: float) -> dict[str, Any]:
    """Rate, loss and latency of a source within the first seconds of its clock.

    A bridged sample counts as lost.
    """
    times, latencies, bridged = [], [], 0
    with live(url, "ur10e", model) as session:
        for reading in session:
            times.append(reading.t)
            latencies.append(reading.latency)
            bridged += reading.dropout and not reading.fault
            if reading.t - times[0] > seconds:
                break
    t = np.array(times)
    steps = np.diff(t)
    step = float(np.median(steps))
    p50, p99 = 1e3 * np.percentile(np.array(latencies)[t > t[0] + SETTLING_TIME], [50, 99])
    return {
        "rate_hz": 1.0 / step,
        "lost": bridged + int(np.round(steps / step - 1.0).clip(0.0).sum()),
        "latency_p50_ms": float(p50),
        "latency_p99_ms": float(p99),
    }


def _comparison() -> list[ComparisonRow]:
    inside = (
        "Inside the stated 95 % band, x y z, read live with friction followed, "
        f"after {START_TIME:g} s"
    )
    rows = {
        "a week after the fit": "ur-20_02_19_15harm50sec.inside_95_pct",
        "seven weeks before it": "ur-19_12_23_free.inside_95_pct",
        "the same without following": "ur-19_12_23_free.untracked.inside_95_pct",
        "seven weeks before it, with a load of 1.069 kg": "ur-19_12_23_load.inside_95_pct",
    }
    return [ComparisonRow(f"{inside}, {words}", key) for words, key in rows.items()]


NOTES = (
    "Seven weeks before the fit, friction followed: RMSE <ur-19_12_23_free.rmse_n:.2f> N, without "
    "<ur-19_12_23_free.untracked.rmse_n:.2f> N, x y z.",
    "At real time, a sample's coming to its reading's going: a log from its file "
    "<replay.latency_p50_ms:.2f> ms (99 %: <replay.latency_p99_ms:.2f> ms), 500 Hz from a "
    "controller <rtde.latency_p50_ms:.2f> ms (99 %: <rtde.latency_p99_ms:.2f> ms), "
    "<rtde.lost:d> samples lost; they depend on the computer.",
)


EXPERIMENT = Experiment(
    name="live",
    title="Live reading: wrench error, rate and latency",
    section="recordings of a UR10e",
    run=run,
    needs=("ur10e", "ur10e_more"),
    order=157,
    seconds=90,
)
