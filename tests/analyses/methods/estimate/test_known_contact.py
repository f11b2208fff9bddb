"""`estimate` with what a person knows: the direction of the contact, and the tool on the flange."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from wrenchsight.analyses.methods.estimate.estimate_config import EstimateConfig
from wrenchsight.analyses.methods.estimate.estimation import estimate_log
from wrenchsight.models.estimation.contact_filter import ContactConfig
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.fitted_robot import FittedRobot
from wrenchsight.models.identification.identified_model import IdentifiedModel, Provenance
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_writer import write_recording
from wrenchsight.models.robot.robot import Robot

_FORCE = 40.0  # N
_TOOL = {"mass": 3.0, "com": [0.0, 0.0, 0.1], "inertia": [0.02, 0.02, 0.01, 0.0, 0.0, 0.0]}


pytestmark = pytest.mark.usefixtures("no_figures")


@pytest.fixture(scope="module")
def robot_file(ur10e: Robot, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The UR10e with a tool of 3 kg, E at its end."""
    folder = tmp_path_factory.mktemp("robot")
    shutil.copy(ur10e.source.parent / "robot.urdf", folder)
    config = yaml.safe_load(ur10e.source.read_text())
    config |= {"tool": _TOOL, "tool_frame": {"xyz": [0.0, 0.0, 0.2]}}
    (folder / "robot.yaml").write_text(yaml.safe_dump(config))
    return folder / "robot.yaml"


@pytest.fixture(scope="module")
def model_file(ur10e: Robot, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The true arm without the tool, good to .2 N m a joint."""
    path = tmp_path_factory.mktemp("model") / "model.yaml"
    model = replace(
        IdentifiedModel.nominal(ur10e),
        residual_covariance=0.2**2 * np.eye(6),
        fitted_robot=FittedRobot.of(ur10e),
        provenance=Provenance(method="by hand"),
    )
    model.save(path)
    return path


@pytest.fixture(scope="module")
def log(robot_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A slow slide that presses with _FORCE along tool z, with the tool."""
    robot = Robot.load(robot_file)
    t = 0.002 * np.arange(1500)
    phase = t[:, None] * np.array([0.5, 0.7, 0.9, 1.1, 1.3, 1.5])
    q = np.array([0.2, -1.3, 1.6, -1.9, -1.5, 0.1]) + 0.1 * np.sin(phase)
    v = np.gradient(q, 0.002, axis=0)
    R_WE, _ = robot.chain.pose(q)
    external = np.einsum("kaj,ka->kj", robot.chain.jacobian(q)[:, 3:], -_FORCE * R_WE[:, :, 2])
    tau = robot.chain.inverse_dynamics(q, v, np.gradient(v, 0.002, axis=0)) - external
    path = tmp_path_factory.mktemp("log") / "log.csv"
    write_recording(
        Recording(t=t, q=q, v=v, current=robot.motor_current(tau), source="synthetic"), path
    )
    return path


def _pressed(log: Path, robot_file: Path, model: Path, out: Path, config: EstimateConfig) -> float:
    """N, mean force along tool z over the last second."""
    result = estimate_log(log, robot_file, model, out, config=config)
    table = np.genfromtxt(result.table, delimiter=",", names=True)
    rows = table["t"] > 2.0
    assert table["valid"][rows].all() and len(table) == 1500
    robot = Robot.load(robot_file)
    q = np.genfromtxt(log, delimiter=",", names=True)
    names = [name for name in q.dtype.names or () if name.startswith("q")][:6]
    R_WE, _ = robot.chain.pose(np.stack([q[name] for name in names], axis=1))
    force = np.stack([table[axis] for axis in ("fx", "fy", "fz")], axis=1)
    assert result.metrics()["contact_axis"] == (config.contact.axis or None)
    return float(-np.mean(np.sum(force * R_WE[:, :, 2], axis=1)[rows]))


def _known(**changes: object) -> EstimateConfig:
    contact = ContactConfig(axis="tool_z")
    return replace(EstimateConfig(contact=contact, tool=True, check=False), **changes)


def test_the_force_along_the_axis_is_read(log, robot_file, model_file, tmp_path):
    force = _pressed(log, robot_file, model_file, tmp_path / "out", _known())
    assert force == pytest.approx(_FORCE, abs=1.0)


def test_a_tool_that_the_model_has_not_is_refused(log, robot_file, model_file, tmp_path):
    with pytest.raises(InputError, match=r"a tool of 0 kg.*3 kg.*--tool"):
        estimate_log(
            log, robot_file, model_file, tmp_path / "out", config=EstimateConfig(check=False)
        )
    assert not (tmp_path / "out" / "wrench.csv").exists()
    # Read all the same, its weight is a force.
    other = _known(tool=False, other_robot=True)
    force = _pressed(log, robot_file, model_file, tmp_path / "other", other)
    assert abs(force - _FORCE) > 15.0


@pytest.mark.parametrize(
    ("config", "message"),
    [
        (_known(contact=ContactConfig(axis="up")), "--contact-axis"),
        (_known(contact=ContactConfig(axis="tool_z", force_rate=0.0)), "contact.force_rate"),
        (_known(smooth=True), "--smooth or --contact-axis"),
    ],
)
def test_an_invalid_contact_option_is_one_line(
    log, robot_file, model_file, tmp_path, config, message
):
    with pytest.raises(InputError, match=message):
        estimate_log(log, robot_file, model_file, tmp_path / "out", config=config)
