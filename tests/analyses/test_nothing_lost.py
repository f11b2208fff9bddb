"""No command overwrites or removes what it did not write itself, or what it reads."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from called_commands import invoke, refused
from sample_models import harmonic_motion

from wrenchsight.analyses.output.result_marker import MARKER
from wrenchsight.analyses.study import study
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_writer import write_recording
from wrenchsight.models.robot.robot import Robot

ROOT = Path(study.__file__).resolve().parents[2]
_BUNDLED = ROOT / "models" / "robots" / "sts_sre4_600"


def _files(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.fixture(scope="module")
def log(tmp_path_factory) -> Path:
    """Half a second of the bundled arm, free of contact."""
    robot = Robot.load("sts_sre4_600")
    t = 0.001 * np.arange(500)
    q, v, vdot = harmonic_motion(np.random.default_rng(1), t, [1.0, 3.0], 0.1)
    q += robot.home
    current = robot.motor_current(robot.chain.inverse_dynamics(q, v, vdot))
    path = tmp_path_factory.mktemp("log") / "log.csv"
    write_recording(Recording(t=t, q=q, v=v, current=current, source="synthetic"), path)
    return path


@pytest.fixture(scope="module")
def finished(log, tmp_path_factory) -> Path:
    """A folder of results of `estimate`."""
    out = tmp_path_factory.mktemp("finished") / "X"
    result = _estimate(log, out)
    assert result.exit_code == 0, result.output
    return out


def _estimate(log, out, *options):
    prior = ("--prior-force-sd", 20, "--prior-moment-sd", 2)
    return invoke("estimate", log, "--robot", "sts_sre4_600", *prior, "--out", out, *options)


@pytest.fixture
def X(finished, tmp_path) -> Path:
    shutil.copytree(finished, tmp_path / "X")
    return tmp_path / "X"


# ---- the commands by which data was lost ----


def test_study_does_not_delete_a_folder_of_the_name_of_an_experiment(tmp_path):
    X = tmp_path / "X"
    (X / "jcn-map").mkdir(parents=True)
    (X / "jcn-map" / "thesis.txt").write_text("mine")
    line = refused("study", "--quick", "jcn-map", "--out", X, "--data", tmp_path / "data")
    assert "jcn-map/thesis.txt, which is not as wrenchsight wrote it" in line
    assert _files(X) == {"jcn-map/thesis.txt": b"mine"}


def test_identify_does_not_overwrite_the_robot_that_it_loads(tmp_path, log):
    rr = tmp_path / "rr"
    shutil.copytree(_BUNDLED, rr)
    before = _files(rr)
    line = refused("identify", log, "--robot", rr, "--consistent", "--out", rr)
    assert f"{rr}: holds " in line
    assert _files(rr) == before
    Robot.load(rr / "robot.yaml")


@pytest.mark.parametrize(
    ("read", "words"),
    [
        ("wrench.csv", ("wrench.csv", "--robot", "sts_sre4_600", "--no-check")),
        ("config.yaml", ("LOG", "--robot", "sts_sre4_600", "--log-format", "config.yaml")),
        ("config.yaml", ("--config", "config.yaml")),
    ],
)
def test_estimate_does_not_overwrite_what_it_reads(X, log, read, words):
    before = _files(X)
    places = {"LOG": log, read: X / read}
    arguments = [places.get(word, word) for word in words]
    line = refused("estimate", *arguments, "--out", X)
    assert line.startswith(f"{X / read}: is read by this command")
    assert _files(X) == before


def test_simulate_does_not_overwrite_the_scenario_that_it_runs(tmp_path):
    out = tmp_path / "out"
    first = invoke("simulate", "--duration", 0.05, "--no-recording", "--out", out)
    assert first.exit_code == 0, first.output
    before = _files(out)
    line = refused("simulate", "--scenario", out / "scenario.yaml", "--out", out)
    assert "scenario.yaml: is read by this command" in line
    assert _files(out) == before


# ---- every command ----

_COMMANDS = {
    "study": ("jcn-map", "--quick", "--data", "nowhere"),
    "identify": ("nowhere.csv", "--robot", "sts_sre4_600"),
    "estimate": ("nowhere.csv", "--robot", "sts_sre4_600"),
    "simulate": (),
    "excite": ("--robot", "sts_sre4_600"),
    "jcn-map": ("--samples", "10"),
    "place": ("--task", "linear_path", "--quick"),
    "redundancy": ("--task", "blade_path"),
}


@pytest.mark.parametrize("command", _COMMANDS)
def test_a_folder_that_is_not_ours_is_refused_before_anything_else(command, tmp_path):
    (tmp_path / "metrics.json").write_text("mine")
    line = refused(command, *_COMMANDS[command], "--out", tmp_path)
    assert "metrics.json, which is not as wrenchsight wrote it" in line
    assert _files(tmp_path) == {"metrics.json": b"mine"}


@pytest.mark.parametrize("command", sorted(set(_COMMANDS) - {"estimate"}))
def test_the_results_of_another_command_arerefused(command, X):
    before = _files(X)
    line = refused(command, *_COMMANDS[command], "--out", X)
    assert f"holds the results of estimate, not of {command}" in line
    assert _files(X) == before


# ---- a folder of ours ----


def test_results_are_replaced_by_the_same_command(X, log):
    before = _files(X)
    assert _estimate(log, X).exit_code == 0
    assert _files(X) == before  # the same bytes, and nothing else
    assert MARKER in before


def test_a_configuration_runs_again(X, tmp_path):
    again = invoke("estimate", "--config", X / "config.yaml", "--out", tmp_path / "Y")
    assert again.exit_code == 0, again.output
    assert _files(tmp_path / "Y")["wrench.csv"] == _files(X)["wrench.csv"]


def test_a_picture_does_not_overwrite_what_is_not_one(tmp_path, log):
    log_copy = tmp_path / "log.csv"
    shutil.copy(log, log_copy)
    before = log_copy.read_bytes()
    refused("robot", "show", "sts_sre4_600", "--out", log_copy)
    assert log_copy.read_bytes() == before
    page = tmp_path / "arm.html"
    for _ in range(2):  # an earlier picture is replaced
        assert invoke("robot", "show", "sts_sre4_600", "--out", page).exit_code == 0
    assert "written by wrenchsight" in page.read_text()
