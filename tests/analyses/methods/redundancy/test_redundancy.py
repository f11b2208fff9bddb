"""How the free angle about a surface's normal is chosen, and what the command writes."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio
import pytest
from typer.testing import CliRunner

from wrenchsight.analyses.__main__ import app
from wrenchsight.analyses.methods.redundancy.free_redundancy import Surroundings
from wrenchsight.analyses.methods.redundancy.redundancy import find_redundancy
from wrenchsight.analyses.methods.redundancy.redundancy_task import (
    RedundancyClearance,
    RedundancyTask,
)
from wrenchsight.diagrams.distances.clearance import Clearance
from wrenchsight.diagrams.scenario import BladeConfig
from wrenchsight.models.files.bundled_files import task_file
from wrenchsight.models.files.configuration import load_configuration, save_configuration
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.planning.motion.posture_cost import ConditionNumber
from wrenchsight.models.planning.motion.redundancy import RedundancyProblem
from wrenchsight.models.planning.motion.surface_path import SurfacePath
from wrenchsight.models.planning.motion.workpieces import BladeShapeConfig
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.robot_config import PoseConfig


def pinocchio_jcn(robot: Robot, q: Array) -> Array:
    model = pinocchio.buildModelFromXML(robot.urdf_text)
    data, frame = model.createData(), model.getFrameId("E")
    return np.array(
        [
            np.linalg.cond(
                pinocchio.computeFrameJacobian(
                    model, data, row, frame, pinocchio.LOCAL_WORLD_ALIGNED
                )
            )
            for row in q
        ]
    )


def test_a_cam_file_gives_what_its_surface_gives(sts: Robot, tmp_path: Path) -> None:
    """The whole command, from a CSV of the blade's own points; checked with pinocchio."""
    blade = BladeShapeConfig().surface()
    path = SurfacePath.on_surface(blade, (0.75, 0.15), (0.75, 0.85), 31)
    with (tmp_path / "cam.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["x", "y", "z", "nx", "ny", "nz"])
        writer.writerows(np.column_stack([path.p_WS, path.n_W]).tolist())
    task = (
        "csv: cam.csv\nworkpiece: {xyz: [0.45, -0.25, 0.25]}\n"
        "tool_axis: [0.70710678, 0, 0.70710678]\ninitial_angle_deg: 60\n"
        "max_joint_step_deg: 20\nnum_angles: 36\n"
    )
    (tmp_path / "task.yaml").write_text(task)
    out = tmp_path / "out"
    result = CliRunner().invoke(
        app, ["redundancy", "--task", str(tmp_path / "task.yaml"), "--out", str(out)]
    )
    assert result.exit_code == 0, result.stderr
    rows = np.loadtxt(out / "trajectory.csv", delimiter=",", skiprows=1)
    with (out / "trajectory.csv").open() as file:
        header = file.readline().strip().split(",")
    columns = dict(zip(header, rows.T, strict=True))
    q = np.stack([columns[f"q{j}"] for j in range(1, 7)], axis=1)
    np.testing.assert_allclose(columns["jcn"], pinocchio_jcn(sts, q), rtol=1e-9)
    p = path.p_WS + np.array([0.45, -0.25, 0.25])
    np.testing.assert_allclose(sts.chain.pose(q)[1], p, rtol=0, atol=1e-6)
    metrics = json.loads((out / "metrics.json").read_text())
    # The optimum overlaps the arm itself: what is written is the best way without collision.
    assert metrics["free"]["mean_jcn"] == pytest.approx(np.mean(columns["jcn"]))
    assert metrics["initial"]["mean_jcn"] == pytest.approx(np.mean(columns["jcn_initial"]))
    assert "optimised" in result.stdout
    for name in ("measure", "poses", "joints"):
        assert (out / "figures" / f"{name}.png").is_file()
    assert (out / "recording.html").is_file() and (out / "config.yaml").is_file()


@pytest.mark.long
def test_a_task_without_an_initial_trajectory_is_solved_and_says_so(sts: Robot) -> None:
    blade = load_configuration(task_file("blade_path", "redundancy"), RedundancyTask)
    config = RedundancyTask(
        surface=blade.surface,
        workpiece=blade.workpiece,
        tool_axis=[0.0, 0.0, 1.0],
        num_angles=8,
    )
    result = find_redundancy(sts, config)
    metrics = result.metrics()
    # The tool's axis is joint 6's: every angle is as good, and the branch alone matters.
    spread = metrics["constant_angle"]
    assert spread["best_mean_jcn"] == pytest.approx(spread["worst_mean_jcn"], rel=1e-6)
    assert metrics["optimised"]["mean_jcn"] == pytest.approx(spread["best_mean_jcn"], rel=1e-3)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("num_angles: 8\n", ["one of surface and csv"]),
        ("csv: none.csv\n", ["none.csv", "no such file"]),
        ("csv: a.csv\nobjective: jnc\n", ["objective", '"jnc"']),
        ("csv: a.csv\ntool_axes: [0, 0, 1]\n", ["line 2", "tool_axis"]),
        ("csv: a.csv\ntool_axis: [0, 0, 0]\n", ["tool_axis"]),
        ("csv: a.csv\nlimit_margin_deg: 95\n", ["limit_margin_deg"]),
        ("csv: a.csv\nsmoothness: -1\n", ["smoothness"]),
        (
            "csv: a.csv\njoint_ranges_deg: {joint_9: [0, 1]}\n",
            ["joint_9", "no joint of this name", "joint_3"],
        ),
        ("csv: a.csv\njoint_ranges_deg: {joint_3: [1, 0]}\n", ["joint_3", "[lower, upper]"]),
        ("csv: a.csv\njoint_ranges_deg: {joint_3: [300, 310]}\n", ["joint_3", "no range"]),
        ("surface: {start: [0, 0], end: [1, 0]}\n", ["one of plate and blade"]),
        ("surface: {plate: {}, start: [0], end: [1, 0]}\n", ["surface.start"]),
        ("surface: {plate: {}, start: [0, 0], end: [2, 0]}\n", ["leaves the surface"]),
        (
            "surface: {plate: {}, start: [0, 0], end: [1, 0], num_samples: 1}\n",
            ["two or more"],
        ),
        (
            "surface: {plate: {}, start: [0, 0], end: [1, 0]}\nworkpiece: {xyz: [3, 0, 0]}\n",
            ["sample 0", "cannot reach"],
        ),
    ],
)
def test_bad_tasks_end_in_one_line(tmp_path: Path, text: str, words: list[str]) -> None:
    (tmp_path / "t.yaml").write_text(text)
    (tmp_path / "a.csv").write_text("x,y,z,nx,ny,nz\n.4,0,.3,0,0,1\n.4,.1,.3,0,0,1\n")
    result = CliRunner().invoke(
        app, ["redundancy", "--task", str(tmp_path / "t.yaml"), "--out", str(tmp_path / "out")]
    )
    assert result.exit_code == 2, result.stdout
    assert result.stderr.count("\n") == 1
    for word in words:
        assert word in result.stderr


def test_a_task_survives_being_written(tmp_path: Path) -> None:
    blade = load_configuration(task_file("blade_path", "redundancy"), RedundancyTask)
    save_configuration(blade, tmp_path / "task.yaml")
    assert "blade" in (tmp_path / "task.yaml").read_text()


def test_where_the_optimum_is_too_near_the_best_free_way_stands_beside_it(sts: Robot) -> None:
    """Against distances taken one by one, of every link but the tool."""
    blade = load_configuration(task_file("blade_path", "redundancy"), RedundancyTask)
    assert blade.surface is not None
    config = replace(
        blade,
        surface=replace(blade.surface, num_samples=25),
        workpiece=PoseConfig([0.62, 0.0, 0.22], [0.0, 0.0, np.pi / 2]),
        joint_ranges_deg={},
        num_angles=36,
        max_joint_step_deg=20.0,
        clearance=RedundancyClearance(distance=0.03),
    )
    result = find_redundancy(sts, config)
    assert result.free is not None
    beside = Clearance(sts, 0.03, None, BladeConfig(pose=config.workpiece))

    def slack_beside_the_piece(q: Array) -> float:
        pairs = [pair for row in q for pair in beside.slacks(row)]
        return min(pair.slack for pair in pairs if "workpiece" in (pair.first, pair.second))

    assert slack_beside_the_piece(result.optimised.q) < 0.0
    assert slack_beside_the_piece(result.free.q) >= 0.0
    metrics = result.metrics()
    assert metrics["free"]["mean_jcn"] >= metrics["optimised"]["mean_jcn"]
    assert metrics["free"]["mean_jcn"] < metrics["initial"]["mean_jcn"]
    assert metrics["clearance"]["optimised"]["slack_m"] < 0.0
    assert any("keeps less than 30 mm" in notice for notice in result.notices)


@pytest.mark.parametrize("clearance", ["{}", "null"])
def test_a_way_through_the_workpiece_is_refused(tmp_path: Path, clearance: str) -> None:
    """A wide plate between arm and path: the tool works on its far side."""
    (tmp_path / "t.yaml").write_text(
        "surface: {plate: {length: 0.8, width: 0.8}, start: [0.5, 0.4], end: [0.5, 0.6], "
        "num_samples: 5}\n"
        "workpiece: {xyz: [0.45, 0, 0.4], rpy: [0, 1.5708, 0]}\n"
        f"num_angles: 12\nmax_joint_step_deg: 40\nclearance: {clearance}\n"
    )
    words = ["redundancy", "--task", str(tmp_path / "t.yaml"), "--out", str(tmp_path / "out")]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 2, result.stdout
    assert "no collision-free trajectory" in result.stderr
    assert "workpiece overlap by" in result.stderr
    assert "move the workpiece" in result.stderr
    assert not (tmp_path / "out" / "trajectory.csv").exists()


def test_the_tool_comes_and_goes_along_the_normal_as_far_as_asked(sts: Robot) -> None:
    path = SurfacePath.on_surface(BladeShapeConfig().surface(), (0.75, 0.15), (0.75, 0.85), 3)
    q = np.array([0.0, -0.26, -0.567, 0.0, 0.827, 0.0]) + 0.1 * np.arange(3)[:, np.newaxis]
    measure = ConditionNumber(sts.chain)
    limits = sts.position_lower, sts.position_upper
    problem = RedundancyProblem(sts, path, np.array([0, 0, 1.0]), measure, *limits, np.ones(6))
    ways = Surroundings(sts, Clearance(sts), 0.03).with_ends(problem, q)
    np.testing.assert_array_equal(ways[4:-4], q)
    p = sts.chain.pose(ways)[1]
    off = 0.03 * np.array([1.0, 0.75, 0.5, 0.25])[:, np.newaxis]
    np.testing.assert_allclose(p[:4] - p[4], off * path.n_W[0], atol=1e-8)
    np.testing.assert_allclose(p[-4:] - p[-5], off[::-1] * path.n_W[-1], atol=1e-8)
