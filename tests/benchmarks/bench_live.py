"""How long a sample takes to become a reading, at 500 Hz, while Meshcat and a recorder run.

Run by `make bench`; alone: `python tests/benchmarks/bench_live.py [SECONDS]`. A controller of ours
in a process of its own plays a moving arm over loopback; the reading process reads it; Meshcat and
recorder run in this one. Beside it, what the official client's read loop gets of the same stream,
where `ur-rtde` is installed.
"""

import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from sample_models import harmonic_motion, knowing_model

from wrenchsight.analyses.methods.live.meshcat_view import MeshcatView
from wrenchsight.analyses.methods.live.recorder import Recorder
from wrenchsight.analyses.methods.live.rtde_controller import RtdeController
from wrenchsight.analyses.methods.live.session import live
from wrenchsight.analyses.methods.live.watching import SinkThread
from wrenchsight.models.identification.identified_model import FittedRobot
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot

SECONDS = 20.0
SETTLED = 2.0  # s, after which latency counts
H = 0.002

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


def recording(robot: Robot, seconds: float) -> Recording:
    """A moving arm that carries its weight."""
    model = knowing_model(robot, 3.0, 5.0)
    t = H * np.arange(round(seconds / H))
    q, v, vdot = harmonic_motion(np.random.default_rng(2), t, [0.7, 1.9], 0.3)
    q += robot.home
    tau = model.chain(robot).inverse_dynamics(q, v, vdot) + model.friction.feedforward.torque(v)
    return Recording(t=10.0 + t, q=q, v=v, current=robot.motor_current(tau), source="")


def play(port: int, seconds: float) -> None:
    """The controller's process."""
    with RtdeController([recording(Robot.load("ur10e"), seconds)], port=port) as controller:
        print(controller.port, flush=True)
        controller.ended.wait()
        time.sleep(0.5)


def controller(seconds: float, port: int = 0) -> tuple["subprocess.Popen[str]", int]:
    command = [sys.executable, __file__, "play", str(port), str(seconds)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    return process, int(process.stdout.readline())


def main(seconds: float) -> None:
    robot = Robot.load("ur10e")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        model = replace(knowing_model(robot, 3.0, 5.0), fitted_robot=FittedRobot.of(robot))
        model.save(folder / "model.yaml")
        process, port = controller(seconds)
        latencies, stamps = [], []
        with live(f"rtde://127.0.0.1:{port}", robot.source, folder / "model.yaml") as session:
            sinks = [partial(Recorder, folder / "rec", robot), partial(MeshcatView, robot)]
            threads = [SinkThread(make, session.follow(), print) for make in sinks]
            for reading in session:
                latencies.append(reading.latency)
                stamps.append(reading.t)
                if reading.t > 10.0 + seconds - 0.1:
                    break
            memory = Path(f"/proc/{session._process.pid}/status")
            words = memory.read_text() if memory.exists() else ""
            for thread in threads:
                thread.finish()
        process.wait()
        rest = np.array(latencies)[np.array(stamps) > 10.0 + SETTLED]
        steps = np.round(np.diff(stamps) / H)
        print(
            f"{len(stamps)} readings, {int((steps - 1).sum())} missing, dropped {session.dropped}"
        )
        p50, p99 = 1e3 * np.percentile(rest, [50, 99])
        print(f"sample in to reading out: p50 {p50:.3f} ms, p99 {p99:.3f} ms, {len(rest)} readings")
        (size,) = [line.split()[1] for line in words.splitlines() if "VmRSS" in line] or ["0"]
        own = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        print(f"memory: reading process {int(size) / 1e3:.0f} MB, this one {own / 1e3:.0f} MB")
    try:
        import rtde_receive  # noqa: F401
    except ImportError:
        print("official client: not installed")
        return
    process, _ = controller(5.0, 30004)
    command = [sys.executable, "-c", _PEER, "3"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    process.wait()
    lost, count = done.stdout.split()[-2:]
    print(f"official client, read at 1 kHz: {lost} of {count} samples never seen")


if __name__ == "__main__":
    if sys.argv[1:2] == ["play"]:
        play(int(sys.argv[2]), float(sys.argv[3]))
    else:
        main(float(sys.argv[1]) if len(sys.argv) > 1 else SECONDS)
