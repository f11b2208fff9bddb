"""A robot read in a process of its own, from a controller of ours over loopback."""

import socket
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from called_commands import refused
from sample_models import free_motion, knowing_model

from wrenchsight.analyses.methods.watch.publishers import DATAGRAM, MAGIC, VALID_FLAG
from wrenchsight.analyses.methods.watch.rtde_controller import RtdeController
from wrenchsight.analyses.methods.watch.session import live
from wrenchsight.models.estimation.wrench_bag import read_wrench_bag
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import FittedRobot
from wrenchsight.models.live.samples import EventKind
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_writer import write_recording

pytestmark = pytest.mark.long  # streams run in real time, or whole

H = 0.002


@pytest.fixture(scope="module")
def model_file(ur10e, tmp_path_factory):
    path = tmp_path_factory.mktemp("model") / "model.yaml"
    replace(knowing_model(ur10e, 3.0, 5.0), fitted_robot=FittedRobot.of(ur10e)).save(path)
    return path


@pytest.fixture(scope="module")
def recording(ur10e):
    """Three seconds without contact, of the model that reads them."""
    model = knowing_model(ur10e, 3.0, 5.0)
    t = H * np.arange(1500)
    q, v, tau = free_motion(ur10e, model, t)
    return Recording(t=10.0 + t, q=q, v=v, current=ur10e.motor_current(tau), source="")


def test_a_loop_gets_each_reading_and_so_does_udp(ur10e, model_file, recording):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(5.0)
        to = f"udp://127.0.0.1:{receiver.getsockname()[1]}"
        with (
            RtdeController([recording], port=0) as controller,
            live(
                f"rtde://127.0.0.1:{controller.port}", ur10e.source, model_file, publish=(to,)
            ) as session,
        ):
            readings = []
            for reading in session:
                readings.append(reading)
                if len(readings) == 1400:
                    break
            packet = receiver.recv(1000)
        assert session.dropped == 0
    np.testing.assert_allclose(np.diff([r.t for r in readings]), H, rtol=1e-6)
    assert session.events[0].kind is EventKind.CONNECTED
    assert all(np.isfinite(r.wrench).all() for r in readings)
    assert readings[-1].latency > 0.0
    magic, flags, _, t, *numbers = DATAGRAM.unpack(packet)
    assert magic == MAGIC
    by_time = {reading.t: reading for reading in readings}
    assert numbers == by_time[t].force_first.tolist()
    assert bool(flags & VALID_FLAG) == by_time[t].valid


def test_a_missing_robot_or_source_is_one_line(ur10e, model_file, tmp_path):
    with pytest.raises(InputError, match="robot"):
        live("rtde://127.0.0.1", "", model_file)
    url = f"replay://{tmp_path}/none.csv"
    with (
        live(url, ur10e.source, model_file) as session,
        pytest.raises(InputError, match=r"none\.csv"),
    ):
        list(session)
    assert [event.kind for event in session.events] == [EventKind.FAILED]


def test_a_killed_starter_takes_the_reading_process_along(ur10e, model_file):
    text = (
        "import time\n"
        "from wrenchsight.analyses.methods.watch.session import live\n"
        f"session = live('rtde://127.0.0.1:1', {str(ur10e.source)!r}, {str(model_file)!r})\n"
        "print(session._process.pid, flush=True)\n"
        "time.sleep(60)\n"
    )
    starter = subprocess.Popen([sys.executable, "-c", text], stdout=subprocess.PIPE)
    assert starter.stdout is not None
    child = int(starter.stdout.readline())
    starter.kill()
    starter.wait()
    starter.stdout.close()
    end = time.monotonic() + 30.0
    while time.monotonic() < end and _runs(child):
        time.sleep(0.1)
    assert not _runs(child)


def _runs(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text("ascii").rsplit(")", 1)[1].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def test_the_command_prints_lines_and_records(ur10e, model_file, recording, tmp_path):
    log = tmp_path / "log.csv"
    write_recording(recording, log)
    command = [sys.executable, "-m", "wrenchsight", "watch", f"replay://{log}?rate=2"]
    command += ["--robot", str(ur10e.source), "--model", str(model_file)]
    command += ["--record", str(tmp_path / "rec")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    assert "1500 readings" in done.stdout
    assert "\x1b" not in done.stdout
    assert "fx" in done.stdout
    t, _ = read_wrench_bag(tmp_path / "rec")
    np.testing.assert_allclose(t, recording.t, atol=1e-6)
    assert f"replay://{log}" in (tmp_path / "rec/config.yaml").read_text()


def test_a_refused_source_is_said_once_and_its_folder_will_do_again(model_file, tmp_path):
    command = [sys.executable, "-m", "wrenchsight", "watch", f"replay://{tmp_path}/none.csv"]
    command += ["--robot", "ur10e", "--model", str(model_file), "--record", str(tmp_path / "rec")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 2
    assert "none.csv: no such file" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert done.stdout == ""
    assert list((tmp_path / "rec").iterdir()) == []


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["telepathy://x", "--robot", "ur10e"], "telepathy"),
        (["rtde://h", "--robot", "ur10e", "--view", "oracle"], "oracle"),
        (["rtde://h", "--robot", "ur10e", "--duration", "-1"], "duration"),
        (["rtde://h", "--robot", "ur10e", "--publish", "smoke://h"], "smoke"),
    ],
)
def test_a_wrong_option_is_one_line_and_code_2(words, expected):
    assert expected in refused("watch", *words)
