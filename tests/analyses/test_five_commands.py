"""From a URDF that nobody here wrote to a wrench, in five commands and without a look-up.

The motions that `excite` finds on the way are held against the packages' own meshes: every sample
of both trajectories, by pinocchio and coal, which know nothing of hulls.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from called_commands import succeeded
from package_meshes import PackageMeshes

from wrenchsight.analyses.methods.excite.excitation import RAMP_TIMES
from wrenchsight.models.robot.robot import Robot

pytestmark = pytest.mark.long  # from a URDF to a wrench

ARMS = {
    "z1": "z1_description/urdf/z1.urdf",
    "ur5": "ur_description/urdf/ur5_robot.urdf",
    "panda": "panda_description/urdf/panda.urdf",
    "kinova": "kinova_description/robots/kinova.urdf",
    "xarm7": "xarm_description/urdf/xarm7.urdf",
    "tiago": "tiago_description/robots/tiago.urdf",
    "talos": "talos_data/robots/talos_left_arm.urdf",
}
# Short and coarse: five seconds of a motion that the solver has hardly begun with.
SHORT = """
excitation:
  base_frequency: 0.2
  num_harmonics: 3
  num_starts: 2
  iterations: {iterations}
"""
# TIAGo's lift hardly moves in the first ten: too little to identify.
ITERATIONS = dict.fromkeys(ARMS, 10) | {"tiago": 40}
ORDINARY = ("z1",)  # the others take half a minute and more


@pytest.mark.parametrize(
    "arm",
    [arm if arm in ORDINARY else pytest.param(arm, marks=pytest.mark.slow) for arm in ARMS],
)
def test_from_a_urdf_to_a_wrench(arm: str, wheel_robots: Path, tmp_path: Path) -> None:
    robot_file, motion, log = (
        tmp_path / "robot.yaml",
        tmp_path / "excite" / "trajectory.yaml",
        tmp_path / "simulate" / "log.csv",
    )
    model, settings = tmp_path / "identify" / "model.yaml", tmp_path / "short.yaml"
    settings.write_text(SHORT.format(iterations=ITERATIONS[arm]))
    robot_option = ("--robot", robot_file)
    succeeded("robot", wheel_robots / ARMS[arm], "--out", robot_file)
    succeeded("excite", *robot_option, "--config", settings, "--no-record", "--out", motion.parent)
    simulated = ("--motion", motion, "--duration", "9", "--no-recording")
    succeeded("simulate", *robot_option, *simulated, "--out", log.parent)
    output = succeeded("identify", log, *robot_option, "--out", model.parent)
    assert "--friction best lets held-out logs choose" in " ".join(output.split())
    succeeded("estimate", log, *robot_option, "--model", model, "--out", tmp_path / "estimate")

    robot = Robot.load(robot_file)
    _nothing_is_hit(robot, tmp_path / "excite")
    # The arm followed the motion that was found, and nothing else.
    trajectory = np.loadtxt(tmp_path / "excite" / "trajectory.csv", delimiter=",", skiprows=1)
    ran = np.genfromtxt(log, delimiter=",", names=True)
    for j in range(robot.num_joints):
        planned = np.interp(ran["t"], trajectory[:, 0], trajectory[:, 1 + j])
        assert np.abs(ran[f"q{j + 1}"] - planned).max() < 0.05  # a servo's error, rad or m
    # Nothing touched it. The log has friction, noise and steps, the model is that of a short fit.
    metrics = json.loads((tmp_path / "estimate" / "metrics.json").read_text())
    table = np.genfromtxt(tmp_path / "estimate" / "wrench.csv", delimiter=",", names=True)
    valid = table["valid"] == 1
    assert valid.mean() > 0.2  # five seconds of a motion hardly begun with; two rests hide forces
    force = np.stack([table[name][valid] for name in ("fx", "fy", "fz")])
    # A valid reading's sd is at most a sixth of the payload's weight.
    assert np.sqrt(np.mean(force**2)) < 9.81 * robot.payload / 6.0
    assert metrics["valid_pct"] == pytest.approx(100.0 * valid.mean())


def _nothing_is_hit(robot: Robot, folder: Path) -> None:
    meshes = PackageMeshes(robot)
    for name in ("trajectory", "validation"):
        table = np.loadtxt(folder / f"{name}.csv", delimiter=",", skiprows=1)
        q = table[:, 1 : 1 + robot.num_joints]
        # 1 kHz; five seconds and one stop or two, as the limits leave room, of 1.5 s and a ramp.
        assert len(q) - 1 in {
            5000 + round(number * 1000 * (1.5 + ramp)) for number in (1, 2) for ramp in RAMP_TIMES
        }
        assert meshes.collisions(q) == {}
        if robot.floor is not None:
            assert meshes.lowest(q[::10]) > robot.floor  # 10 ms: a millimetre or two of way


def test_meshes_that_collide_are_seen(wheel_robots: Path, tmp_path: Path) -> None:
    """The judge itself: a folded arm hits itself, one that leans over reaches below the floor."""
    path = tmp_path / "robot.yaml"
    succeeded("robot", wheel_robots / ARMS["ur5"], "--out", path)
    meshes = PackageMeshes(Robot.load(path))
    assert meshes.by_construction == set()
    assert meshes.collisions(np.array([[0.0, -1.2, 3.0, 0.0, 0.0, 0.0]]))
    assert not meshes.collisions(np.array([[0.0, -1.5, 1.5, 0.0, 1.5, 0.0]]))
    assert meshes.lowest(np.array([[0.0, 1.0, 0.0, 0.0, 0.0, 0.0]])) < -0.3
    assert meshes.lowest(np.array([[0.0, -1.5, 1.5, 0.0, 1.5, 0.0]])) > 0.0
