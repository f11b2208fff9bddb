"""How long a sample takes to become a reading, at 500 Hz, while Meshcat and a recorder run.

Run by `make bench`; alone: `python tests/benchmarks/bench_live.py [--seconds S] [LOG ...]`. A
controller of ours in a process of its own plays a moving arm over loopback, or UR10e logs one after
another, over and over, put on 500 Hz; the reading process reads it; Meshcat and recorder run in
this one. What was read and recorded is held against `estimate` on the same samples. Beside it, what
the official client's read loop gets of the same stream, where `ur-rtde` is installed.
"""

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import cycle
from pathlib import Path

import numpy as np
from pyarrow import parquet
from sample_models import free_motion, knowing_model

from wrenchsight.analyses.methods.live.meshcat_view import MeshcatView
from wrenchsight.analyses.methods.live.recorder import Recorder
from wrenchsight.analyses.methods.live.rtde_controller import RtdeController
from wrenchsight.analyses.methods.live.session import live
from wrenchsight.analyses.methods.live.watch_config import WatchConfig
from wrenchsight.analyses.methods.live.watching import SinkThread
from wrenchsight.analyses.methods.reading.estimate_config import EstimateConfig
from wrenchsight.analyses.methods.reading.estimation import estimate_log
from wrenchsight.models.arrays import Array
from wrenchsight.models.estimation.estimator import WrenchEstimatorConfig
from wrenchsight.models.estimation.wrench_bag import read_wrench_bag
from wrenchsight.models.identification.identified_model import FittedRobot
from wrenchsight.models.live.live_estimator import LiveConfig
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.recordings.recording_writer import write_recording
from wrenchsight.models.rigid_body.spatial_vectors import WRENCH_AXES
from wrenchsight.models.robot.robot import Robot

SECONDS = 20.0
SETTLED = 2.0  # s, after which latency counts
H = 0.002
BEGIN = 10.0  # s, time of the first sample
RESOLUTION = 1e-4  # rad, of the UR10e's encoders
PART = 600.0  # s, of which latency is told
LOOK = 60.0  # s between two looks at the memory

_PEER = """
import sys, time, rtde_receive
client = rtde_receive.RTDEReceiveInterface("127.0.0.1", 500.0, ["timestamp", "actual_q"])
seen, end = set(), time.monotonic() + float(sys.argv[1])
while time.monotonic() < end:
    seen.add(client.getTimestamp())
    time.sleep(0.001)
span = max(seen) - min(seen)
print(round(span / 0.002) + 1 - len(seen), round(span / 0.002) + 1)
"""


def moving_arm(robot: Robot, seconds: float) -> Recording:
    """A moving arm that carries its weight."""
    model = knowing_model(robot, 3.0, 5.0)
    t = H * np.arange(round(seconds / H))
    q, v, tau = free_motion(robot, model, t)
    return Recording(t=BEGIN + t, q=q, v=v, current=robot.motor_current(tau), source="")


def looped(robot: Robot, seconds: float, logs: list[Path]) -> Iterator[Recording]:
    """The logs one after another, as long as it lasts; where one ends, the arm jumps."""
    read = [read_recording(log, None, robot, check=False) for log in logs]
    number, last = 0, round(seconds / H)
    for log in cycle(read):
        t = np.arange(log.t[0], log.t[-1], H)[: last - number]

        def at(signal: Array, t: Array = t, log: Recording = log) -> Array:
            return np.stack([np.interp(t, log.t, x) for x in signal.T], axis=1)

        q = RESOLUTION * np.round(at(log.q) / RESOLUTION)
        numbers = number + np.arange(len(t))
        yield Recording(t=BEGIN + H * numbers, q=q, v=at(log.v), current=at(log.current), source="")
        number += len(t)
        if number >= last:
            return


def parts_of(robot: Robot, seconds: float, logs: list[Path]) -> Iterator[Recording]:
    """What is played."""
    return looped(robot, seconds, logs) if logs else iter([moving_arm(robot, seconds)])


def play(port: int, seconds: float, logs: list[Path]) -> None:
    """The controller's process."""
    with RtdeController(parts_of(Robot.load("ur10e"), seconds, logs), port=port) as controller:
        print(controller.port, flush=True)
        controller.ended.wait()
        time.sleep(0.5)


def controller(
    seconds: float, logs: list[Path], port: int = 0
) -> tuple["subprocess.Popen[str]", int]:
    words = ["--play", str(port), "--seconds", str(seconds), *map(str, logs)]
    process = subprocess.Popen(
        [sys.executable, __file__, *words], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    return process, int(process.stdout.readline())


def memory_of(process: int | str) -> float:
    """MB that it holds now; 0 where the system does not tell."""
    path = Path(f"/proc/{process}/status")
    words = path.read_text() if path.exists() else ""
    sizes = [line.split()[1] for line in words.splitlines() if "VmRSS" in line]
    return int(sizes[0]) / 1e3 if sizes else 0.0


def compare(folder: Path, robot: Robot, seconds: float, logs: list[Path], rows: Array) -> None:
    """Tells how far what was read and recorded is from `estimate` on the same samples."""
    parts = list(parts_of(robot, seconds, logs))
    signals = {k: np.concatenate([getattr(part, k) for part in parts]) for k in "tqv"}
    current = np.concatenate([part.current for part in parts])
    write_recording(Recording(**signals, current=current, source=""), folder / "log.npz")
    config = EstimateConfig(prior="live", check=False, table="parquet", estimator=estimator(logs))
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


def estimator(logs: list[Path]) -> WrenchEstimatorConfig:
    """What stream and log are read with: step and encoders are stated."""
    resolution = [RESOLUTION if logs else 0.0] * 6
    return WrenchEstimatorConfig(
        observer=MomentumObserverConfig(time_step=H), position_resolution=resolution
    )


def main(seconds: float, logs: list[Path]) -> None:
    robot = Robot.load("ur10e")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        model = replace(knowing_model(robot, 3.0, 5.0), fitted_robot=FittedRobot.of(robot))
        model.save(folder / "model.yaml")
        config = WatchConfig(live=LiveConfig(estimator=estimator(logs)))
        process, port = controller(seconds, logs)
        rows = np.full((round(seconds / H) + 1000, 14), np.nan)  # held from the start on
        count, bridged, look = 0, 0, LOOK
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
                if reading.t - BEGIN > look:
                    look += LOOK
                    sizes = f"{memory_of(session._process.pid):.1f} and {memory_of('self'):.1f} MB"
                    print(f"{reading.t - BEGIN:.0f} s: {count} readings, {sizes}", flush=True)
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
        for begin in np.arange(0.0, seconds, PART):
            inside = (since > max(begin, SETTLED)) & (since <= begin + PART)
            p50, p99 = 1e3 * np.percentile(rows[inside, 1], [50, 99])
            print(
                f"sample in to reading out, from {begin:.0f} s on: p50 {p50:.3f} ms, "
                f"p99 {p99:.3f} ms, largest {1e3 * rows[inside, 1].max():.1f} ms, "
                f"{inside.sum()} readings"
            )
        own = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        print(f"memory: reading process {size:.0f} MB, this one {own / 1e3:.0f} MB")
        print(f"said last: {events[-8:]}")
        compare(folder, robot, seconds, logs, rows)
    try:
        import rtde_receive  # noqa: F401
    except ImportError:
        print("official client: not installed")
        return
    process, _ = controller(5.0, [], 30004)
    command = [sys.executable, "-c", _PEER, "3"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    process.wait()
    lost, count = done.stdout.split()[-2:]
    print(f"official client, read at 1 kHz: {lost} of {count} samples never seen")


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=SECONDS)
    parser.add_argument("--play", type=int, help=argparse.SUPPRESS)
    parser.add_argument("logs", type=Path, nargs="*")
    given = parser.parse_args()
    if given.play is not None:
        play(given.play, given.seconds, given.logs)
    else:
        main(given.seconds, given.logs)
