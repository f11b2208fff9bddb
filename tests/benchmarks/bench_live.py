"""How long a sample takes to become a reading, at 500 Hz, while Meshcat and a recorder run.

Run by `make bench`; alone: `python tests/benchmarks/bench_live.py [--seconds S]`. A controller of
ours in a process of its own plays a moving arm over loopback; the reading process reads it; Meshcat
and recorder run in this one. What was read and recorded is held against `estimate` on the same
samples.
"""

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from pyarrow import parquet
from sample_models import free_motion, knowing_model

from wrenchsight.analyses.methods.estimate.estimate_config import EstimateConfig
from wrenchsight.analyses.methods.estimate.estimation import estimate_log
from wrenchsight.analyses.methods.watch.meshcat_view import MeshcatView
from wrenchsight.analyses.methods.watch.recorder import Recorder
from wrenchsight.analyses.methods.watch.rtde_controller import RtdeController
from wrenchsight.analyses.methods.watch.session import live
from wrenchsight.analyses.methods.watch.watch_config import WatchConfig
from wrenchsight.analyses.methods.watch.watching import SinkThread
from wrenchsight.models.estimation.estimator import WrenchEstimatorConfig
from wrenchsight.models.estimation.wrench_bag import read_wrench_bag
from wrenchsight.models.identification.identified_model import FittedRobot
from wrenchsight.models.live.live_estimator import LiveConfig
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_writer import write_recording
from wrenchsight.models.rigid_body.spatial_vectors import WRENCH_AXES
from wrenchsight.models.robot.robot import Robot

SECONDS = 20.0
SETTLED = 2.0  # s, after which latency counts
H = 0.002
BEGIN = 10.0  # s, time of the first sample
ESTIMATOR = WrenchEstimatorConfig(
    observer=MomentumObserverConfig(time_step=H), position_resolution=[0.0] * 6
)
"""What stream and log are read with: step and encoders are stated."""


def moving_arm(robot: Robot, seconds: float) -> Recording:
    """A moving arm that carries its weight."""
    model = knowing_model(robot, 3.0, 5.0)
    t = H * np.arange(round(seconds / H))
    q, v, tau = free_motion(robot, model, t)
    return Recording(t=BEGIN + t, q=q, v=v, current=robot.motor_current(tau), source="")


def play(seconds: float) -> None:
    """The controller's process."""
    with RtdeController(iter([moving_arm(Robot.load("ur10e"), seconds)])) as controller:
        print(controller.port, flush=True)
        controller.ended.wait()
        time.sleep(0.5)


def controller(seconds: float) -> tuple["subprocess.Popen[str]", int]:
    process = subprocess.Popen(
        [sys.executable, __file__, "--play", "--seconds", str(seconds)],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    return process, int(process.stdout.readline())


def memory_of(process: int) -> float:
    """MB that it holds now; 0 where the system does not tell."""
    path = Path(f"/proc/{process}/status")
    words = path.read_text() if path.exists() else ""
    sizes = [line.split()[1] for line in words.splitlines() if "VmRSS" in line]
    return int(sizes[0]) / 1e3 if sizes else 0.0


def compare(folder: Path, robot: Robot, seconds: float, rows: Array) -> None:
    """Tells how far what was read and recorded is from `estimate` on the same samples."""
    write_recording(moving_arm(robot, seconds), folder / "log.npz")
    config = EstimateConfig(prior="live", check=False, table="parquet", estimator=ESTIMATOR)
    result = estimate_log(
        folder / "log.npz", robot.source, folder / "model.yaml", folder / "out", None, config
    )
    table = parquet.read_table(result.table)
    columns = [*WRENCH_AXES, *(f"sd_{axis}" for axis in WRENCH_AXES)]
    expected = np.stack([table[column].to_numpy() for column in columns], axis=1)
    places = np.round((rows[:, 0] - BEGIN) / H).astype(int)
    worst = np.abs(rows[:, 2:] - expected[places]).max()
    t, wrench = read_wrench_bag(folder / "rec")
    places = np.round((t - BEGIN) / H).astype(int)
    recorded = np.abs(wrench[:, [3, 4, 5, 0, 1, 2]] - expected[places, :6]).max()
    print(
        f"beside `estimate` of {len(expected)} samples: {len(rows)} read, largest difference "
        f"{worst:.1e}; {len(np.unique(places))} recorded, {recorded:.1e} N or N m"
    )


def main(seconds: float) -> None:
    robot = Robot.load("ur10e")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        model = replace(knowing_model(robot, 3.0, 5.0), fitted_robot=FittedRobot.of(robot))
        model.save(folder / "model.yaml")
        config = WatchConfig(live=LiveConfig(estimator=ESTIMATOR))
        process, port = controller(seconds)
        rows = np.full((round(seconds / H) + 1000, 14), np.nan)  # held from the start on
        count, bridged = 0, 0
        source = f"rtde://127.0.0.1:{port}"
        with live(source, robot.source, folder / "model.yaml", config) as session:
            sinks = [partial(Recorder, folder / "rec", robot), partial(MeshcatView, robot)]
            threads = [SinkThread(make, session.follow(), print) for make in sinks]
            for reading in session:
                rows[count, :2], rows[count, 2:] = (
                    (reading.t, reading.latency),
                    reading.force_first,
                )
                count, bridged = count + 1, bridged + (reading.dropout and not reading.fault)
                if reading.t > BEGIN + seconds - 0.1:
                    break
            size = memory_of(session._process.pid)
            for thread in threads:
                thread.finish()
            events = [event.text for event in session.events]
        process.wait()
        rows = rows[:count]
        since = rows[:, 0] - BEGIN
        steps = np.round(np.diff(since) / H)
        lost = sum(thread.reader.dropped for thread in threads)
        print(
            f"{count} readings, {int((steps - 1).sum())} missing, {bridged} bridged, "
            f"dropped {session.dropped} here, {lost} by recorder and Meshcat"
        )
        latency = 1e3 * rows[since > SETTLED, 1]
        p50, p99 = np.percentile(latency, [50, 99])
        print(
            f"sample in to reading out: p50 {p50:.3f} ms, p99 {p99:.3f} ms, "
            f"largest {latency.max():.1f} ms, {len(latency)} readings"
        )
        memory_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        print(f"memory: reading process {size:.0f} MB, this one {memory_kb / 1e3:.0f} MB")
        print(f"said last: {events[-8:]}")
        compare(folder, robot, seconds, rows)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=SECONDS)
    parser.add_argument("--play", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    (play if given.play else main)(given.seconds)
