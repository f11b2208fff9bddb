"""Six tasks that can be done and six that cannot, on bundled and drafted arms.

The oracle of what is placed is a plain Drake plant of the arm's URDF: each posture is held against
the task there. The costs were also found by a program of that plant alone (`PositionConstraint`,
`OrientationConstraint`, SNOPT from random postures), which shares no code with the search.
"""

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable

import wrenchsight.models
from wrenchsight.analyses.methods.place.placement import place
from wrenchsight.analyses.methods.robot.robot_draft import draft_robot
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.planning.placement.placement_task import load_task
from wrenchsight.models.robot.robot import Robot

ROBOTS = Path(wrenchsight.models.__file__).parent / "robots"
_DOWN = {"tool_direction": [0.0, 0.0, -1.0]}
_TOLERANCE = 1e-6  # rad and m; the program's is 1e-7


def _link(name: str, mass: float, shape: str, x: float, rpy: str = "0 0 0") -> str:
    inertia = f'ixx="{mass / 100}" iyy="{mass / 100}" izz="{mass / 100}" ixy="0" ixz="0" iyz="0"'
    return (
        f'<link name="{name}"><inertial><mass value="{mass}"/><inertia {inertia}/></inertial>'
        f'<collision><origin xyz="{x} 0 0" rpy="{rpy}"/><geometry>{shape}</geometry></collision>'
        "</link>"
    )


def _joint(
    name: str, parent: str, child: str, xyz: str, axis: str, lower: float, upper: float,
    kind: str = "revolute",
) -> str:  # fmt: skip
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}"/><axis xyz="{axis}"/>'
        f'<limit lower="{lower}" upper="{upper}" effort="2000" velocity="2"/></joint>'
    )


def _cylinder(radius: float, length: float) -> str:
    return f'<cylinder radius="{radius}" length="{length}"/>'


def _arm(*, on_rail: bool) -> str:
    """An arm of six joints with a spherical wrist; on a rail of two metres it has seven."""
    along_x = "0 1.5707963267948966 0"
    carriage = '<box size="0.4 0.3 0.08"/>'
    parts = ['<link name="base"/>']
    if on_rail:
        parts += [
            _link("carriage", 40.0, carriage, 0.0),
            _joint("rail", "base", "carriage", "0 0 0.06", "0 1 0", -1.0, 1.0, "prismatic"),
        ]
    root = ("carriage", 0.25) if on_rail else ("base", 0.2)
    parts += [
        _link("l1", 20.0, _cylinder(0.1, 0.16), 0.0),
        _joint("j1", root[0], "l1", f"0 0 {root[1]}", "0 0 1", -2.9, 2.9),
        _link("l2", 15.0, _cylinder(0.07, 0.36), 0.26, along_x),
        _joint("j2", "l1", "l2", "0.05 0 0.2", "0 1 0", -3.3, 0.8),
        _link("l3", 10.0, _cylinder(0.06, 0.16), 0.03, along_x),
        _joint("j3", "l2", "l3", "0.46 0 0", "0 1 0", -2.1, 2.7),
        _link("l4", 5.0, _cylinder(0.045, 0.2), 0.12, along_x),
        _joint("j4", "l3", "l4", "0.15 0 0.03", "1 0 0", -3.2, 3.2),
        _link("l5", 3.0, _cylinder(0.04, 0.09), 0.0, "1.5707963267948966 0 0"),
        _joint("j5", "l4", "l5", "0.3 0 0", "0 1 0", -2.1, 2.1),
        _link("l6", 1.0, _cylinder(0.03, 0.05), 0.1, along_x),
        _joint("j6", "l5", "l6", "0 0 0", "1 0 0", -6.0, 6.0),
        '<link name="flange"/><joint name="f" type="fixed"><parent link="l6"/>'
        f'<child link="flange"/><origin xyz="0.14 0 0" rpy="{along_x}"/></joint>',
    ]
    return f'<robot name="drafted">{"".join(parts)}</robot>'


def _robot(name: str, folder: Path) -> tuple[Robot, Path]:
    """An arm, bundled or drafted, and its URDF."""
    if name not in {"six", "rail"}:
        return Robot.load(name), ROBOTS / name / "robot.urdf"
    urdf = folder / "arm.urdf"
    urdf.write_text(_arm(on_rail=name == "rail"))
    return draft_robot(urdf, folder / "robot.yaml").robot, urdf


FEASIBLE: dict[str, tuple[str, dict[str, Any], float]] = {
    "a line on a table": (
        "ur5e",
        {
            "path_length": 0.3,
            "midpoint_lower": [0.25, -0.4, 0.15],
            "midpoint_upper": [0.7, 0.4, 0.15],
            "tool_tilt_deg": 10.0,
            "path_direction": [0, 0, 1],
            "path_angle_lower_deg": 90.0,
            "path_angle_upper_deg": 90.0,
        }
        | _DOWN,
        7.1474,
    ),
    "a board over a table": (
        "ur10e",
        {
            "path_length": 0.5,
            "midpoint_lower": [-0.9, -0.9, 0.05],
            "midpoint_upper": [0.9, 0.9, 0.6],
            "path_in_surface": True,
            "tool_tilt_deg": 15.0,
            "clearance": {
                "distance": 0.01,
                "obstacles": [
                    {"name": "table", "size": [2, 2, 0.05], "pose": {"xyz": [0, 0, -0.03]}}
                ],
                "workpiece": {"size": [0.6, 0.3, 0.03]},
            },
        }
        | _DOWN,
        5.2123,
    ),
    "a board for seven joints": (
        "panda",
        {
            "path_length": 0.3,
            "num_segments": 12,
            "midpoint_lower": [0.3, -0.3, 0.1],
            "midpoint_upper": [0.6, 0.3, 0.5],
            "limit_margin_deg": 3.0,
            "path_in_surface": True,
            "tool_tilt_deg": 20.0,
            "clearance": {"distance": 0.005, "workpiece": {"size": [0.35, 0.1, 0.02]}},
        }
        | _DOWN,
        7.6972,
    ),
    "straight up a wall": (
        "ur10e",
        {
            "path_length": 0.4,
            "midpoint_lower": [0.5, -0.4, 0.3],
            "midpoint_upper": [0.8, 0.4, 0.8],
            "tool_direction": [1, 0, 0],
            "tool_tilt_deg": 5.0,
            "path_direction": [0, 0, 1],
            "path_angle_upper_deg": 0.0,
            "clearance": {
                "distance": 0.02,
                "obstacles": [{"name": "wall", "size": [0.1, 2, 2], "pose": {"xyz": [0.95, 0, 1]}}],
            },
        },
        5.3766,
    ),
    "a tool that may not lean": (
        "six",
        {
            "path_length": 0.35,
            "num_segments": 14,
            "midpoint_lower": [0.2, -0.5, 0.1],
            "midpoint_upper": [0.8, 0.5, 0.9],
            "path_in_surface": True,
            "angle_lower_deg": 30.0,
            "angle_upper_deg": 170.0,
            "tool_direction": [1, 0, -1],
            "limit_margin_deg": 2.0,
        },
        5.7933,
    ),
    "a board beside a rail": (
        "rail",
        {
            "path_length": 1.4,
            "midpoint_lower": [0.3, -0.6, 0.2],
            "midpoint_upper": [0.9, 0.6, 0.8],
            "path_in_surface": True,
            "tool_tilt_deg": 15.0,
            "clearance": {"distance": 0.02, "workpiece": {"size": [1.5, 0.2, 0.05]}},
        }
        | _DOWN,
        3.72,
    ),
}

INFEASIBLE: dict[str, tuple[str, dict[str, Any], str, str]] = {
    "out of reach": (
        "ur5e",
        {
            "path_length": 0.3,
            "midpoint_lower": [1.0, -0.2, 0.1],
            "midpoint_upper": [1.2, 0.2, 0.4],
            "tool_tilt_deg": 10.0,
        }
        | _DOWN,
        r"misses the path .* by \d+ mm",
        "with midpoint_lower, midpoint_upper loosened by 7. mm$",
    ),
    "cone against angle": (
        "ur10e",
        {
            "path_length": 0.4,
            "midpoint_lower": [0.3, -0.4, 0.2],
            "midpoint_upper": [0.9, 0.4, 0.8],
            "tool_tilt_deg": 20.0,
            "angle_upper_deg": 120.0,
        }
        | _DOWN,
        "angle_upper_deg, tool_direction: contradict each other",
        "by 160 degrees or more from W, angle_upper_deg allows 120",
    ),
    "the board in the way": (
        "ur10e",
        {
            "path_length": 0.5,
            "midpoint_lower": [0.35, -0.1, 0.15],
            "midpoint_upper": [0.5, 0.1, 0.3],
            "path_in_surface": True,
            "tool_tilt_deg": 10.0,
            "clearance": {"distance": 0.01, "workpiece": {"size": [1.6, 1.6, 0.03]}},
        }
        | _DOWN,
        r"clearance by \d+ mm \(\w+ and workpiece\)",
        "without clearance",
    ),
    "joint limits": (
        "panda",
        {
            "path_length": 0.3,
            "midpoint_lower": [0.3, -0.2, 0.3],
            "midpoint_upper": [0.6, 0.2, 0.6],
            "limit_margin_deg": 60.0,
            "tool_direction": [0, 0, 1],
            "tool_tilt_deg": 5.0,
        },
        r"misses tool_direction, tool_tilt_deg by 2\d\.\d degrees",
        r"with limit_margin_deg loosened by \d\.?\d* degrees",
    ),
    "a path below the table": (
        "ur10e",
        {
            "path_length": 0.5,
            "midpoint_lower": [0.5, -0.2, 0.1],
            "midpoint_upper": [0.8, 0.2, 0.3],
            "tool_tilt_deg": 5.0,
            "clearance": {
                "distance": 0.01,
                "obstacles": [
                    {"name": "table", "size": [1.2, 3, 0.04], "pose": {"xyz": [0.9, 0, 0.5]}}
                ],
            },
        }
        | _DOWN,
        r"clearance by \d+ mm \(\w+ and table\)",
        "without clearance$",
    ),
    "steps of the joints": (
        "six",
        {
            "path_length": 0.6,
            "num_segments": 10,
            "midpoint_lower": [0.2, -0.3, 0.1],
            "midpoint_upper": [0.8, 0.3, 0.9],
            "max_joint_step_deg": 2.0,
        },
        r"misses the path .* by \d+ mm",
        r"with max_joint_step_deg loosened by 2\.\d degrees or with path_length loosened by",
    ),
}


def _check(robot: Robot, urdf: Path, task: dict[str, Any], q: np.ndarray) -> float:
    """Holds postures against a task in a plant of the URDF; returns their mean condition number."""
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModels(str(urdf))
    base, tip = (plant.GetFrameByName(n) for n in (robot.config.base_link, robot.config.flange))
    plant.WeldFrames(plant.world_frame(), base)
    plant.Finalize()
    context = plant.CreateDefaultContext()
    lower, upper = plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits()
    R, p, condition = [], [], []
    for row in q:
        plant.SetPositions(context, row)
        X_WE = tip.CalcPose(context, base)
        R.append(X_WE.rotation().matrix())
        p.append(X_WE.translation())
        J = plant.CalcJacobianSpatialVelocity(
            context, JacobianWrtVariable.kV, tip, np.zeros(3), base, base
        )
        condition.append(np.linalg.cond(J))
    assert np.all(q > lower - _TOLERANCE)
    assert np.all(q < upper + _TOLERANCE)
    n_W = (p[-1] - p[0]) / task["path_length"]
    along = np.linspace(-0.5, 0.5, len(q))[:, np.newaxis] * task["path_length"] * n_W
    middle = 0.5 * (p[0] + p[-1])
    np.testing.assert_allclose(np.linalg.norm(n_W), 1.0, atol=_TOLERANCE)
    np.testing.assert_allclose(p, middle + along, atol=_TOLERANCE)
    np.testing.assert_allclose(R, np.broadcast_to(R[0], (len(q), 3, 3)), atol=_TOLERANCE)
    assert np.all(middle > np.array(task["midpoint_lower"]) - _TOLERANCE)
    assert np.all(middle < np.array(task["midpoint_upper"]) + _TOLERANCE)
    tool = np.array(task["tool_direction"]) / np.linalg.norm(task["tool_direction"])
    leaning = np.degrees(np.arctan2(np.linalg.norm(np.cross(R[0][:, 2], tool)), R[0][:, 2] @ tool))
    assert leaning < task.get("tool_tilt_deg", 0.0) + 1e-4
    if task.get("path_in_surface"):
        assert abs(n_W @ R[0][:, 2]) < _TOLERANCE
    if "path_direction" in task:
        turn = np.degrees(np.arccos(np.clip(n_W @ task["path_direction"], -1.0, 1.0)))
        assert task.get("path_angle_lower_deg", 0.0) - 1e-3 < turn
        assert turn < task["path_angle_upper_deg"] + 1e-3
    return float(np.mean(condition))


@pytest.mark.slow
@pytest.mark.parametrize("case", list(FEASIBLE))
def test_a_task_that_can_be_done_is_placed(tmp_path: Path, case: str) -> None:
    name, content, cost = FEASIBLE[case]
    robot, urdf = _robot(name, tmp_path)
    file = tmp_path / "task.yaml"
    file.write_text(yaml.safe_dump(content))
    task, source = load_task(file)
    began = time.process_time()
    result = place(task, source, robot)
    assert time.process_time() - began < 60.0
    found = _check(robot, urdf, content, result.best.placement.q)
    assert found == pytest.approx(result.metrics()["optimised"]["mean_jcn"], rel=1e-9)
    assert found < 1.001 * cost
    assert result.best.smallest_distance is not None
    assert result.best.smallest_distance >= content.get("clearance", {}).get("distance", 0.0)


@pytest.mark.long
@pytest.mark.parametrize("case", list(INFEASIBLE))
def test_a_task_that_cannot_be_done_is_explained(tmp_path: Path, case: str) -> None:
    name, content, missed, remedy = INFEASIBLE[case]
    robot, _ = _robot(name, tmp_path)
    file = tmp_path / "task.yaml"
    file.write_text(yaml.safe_dump(content))
    began = time.process_time()
    with pytest.raises(InputError, match=missed) as error:
        place(*load_task(file), robot)
    assert time.process_time() - began < 10.0
    error.match(remedy)
