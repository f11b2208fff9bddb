"""A base that is tilted while robot.yaml says that it stands upright: seen end to end."""

import json
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from typer.testing import CliRunner

from wrenchsight.analyses.__main__ import app
from wrenchsight.models.robot.robot import Robot

STEP = 0.004


def write_log(robot: Robot, gravity: np.ndarray, path: Path) -> None:
    """Twelve seconds of general motion: pinocchio's torque of the arm that stands like this."""
    t = np.arange(0.0, 12.0, STEP)
    rate = np.array([0.7, 0.5, 0.9, 1.3, 1.1, 1.7])
    angle = rate * t[:, None] + np.arange(6)
    q, v, vdot = (
        robot.home + 0.5 * np.sin(angle),
        0.5 * rate * np.cos(angle),
        -0.5 * rate**2 * np.sin(angle),
    )
    model = pin.buildModelFromXML(robot.urdf_text)
    model.gravity.linear = gravity
    model.armature = robot.reflected_inertia
    data = model.createData()
    tau = np.array([pin.rnea(model, data, *row) for row in zip(q, v, vdot, strict=True)])
    tau += 0.02 * robot.effort_limit * np.tanh(v / 0.02)  # friction
    current = tau / (robot.torque_per_ampere * robot.current_sign)
    names = [f"{key}{j}" for key in ("q", "v", "i") for j in range(1, 7)]
    table = np.hstack([t[:, None], q, v, current])
    np.savetxt(path, table, delimiter=",", header=",".join(["t", *names]), comments="")


def command(*words: object) -> str:
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert result.exit_code == 0, result.output + result.stderr
    return " ".join(result.output.split())


def rms_force(folder: Path) -> float:
    table = np.genfromtxt(folder / "wrench.csv", delimiter=",", names=True)
    return float(np.sqrt(np.mean(sum(table[name] ** 2 for name in ("fx", "fy", "fz")))))


@pytest.mark.long
def test_the_estimate_says_so_with_the_vector_to_write(sts, tmp_path):
    degrees = 10.0
    angle = np.radians(degrees)
    tilted = np.array([9.81 * np.sin(angle), 0.0, -9.81 * np.cos(angle)])
    before, after = tmp_path / "before.csv", tmp_path / "after.csv"
    write_log(sts, np.array([0.0, 0.0, -9.81]), before)
    write_log(sts, tilted, after)
    # Identified where the arm stood upright; then its base is tilted.
    command("identify", before, "--robot", sts.name, "--out", tmp_path / "model")
    model = ("--robot", sts.name, "--model", tmp_path / "model" / "model.yaml")
    assert "gravity" not in command("estimate", before, *model, "--out", tmp_path / "upright")
    output = command("estimate", after, *model, "--out", tmp_path / "tilted")
    tilt, _, remedy = output.partition("fit the robot: gravity ")[2].partition(" +- ")
    assert float(tilt) == pytest.approx(degrees, abs=0.5)
    gravity = [float(x) for x in remedy.partition("gravity: [")[2].partition("]")[0].split(",")]
    # Friction of each joint hides a little of it: to the least tilt that is told, 1.5 deg.
    np.testing.assert_allclose(gravity, tilted, atol=9.81 * np.radians(1.5))
    metrics = json.loads((tmp_path / "tilted" / "metrics.json").read_text())
    assert metrics["hypotheses"]["fault"] == "direction of gravity"
    assert metrics["hypotheses"]["values"]["tilt_deg"] == pytest.approx(float(tilt), abs=0.05)
    assert metrics["valid_pct"] == 0.0
    # What is said is done: the vector in robot.yaml, and a model identified anew.
    text = sts.source.read_text().replace("urdf: ", f"urdf: {sts.source.parent}/")
    assert "gravity:" not in text
    (tmp_path / "robot.yaml").write_text(f"{text}gravity: {gravity}\n")
    robot_option = ("--robot", tmp_path / "robot.yaml")
    command("identify", after, *robot_option, "--out", tmp_path / "anew")
    again = ("--model", tmp_path / "anew" / "model.yaml", "--out", tmp_path / "right")
    assert "do not fit the robot" not in command("estimate", after, *robot_option, *again)
    assert rms_force(tmp_path / "right") < 0.2 * rms_force(tmp_path / "tilted")
