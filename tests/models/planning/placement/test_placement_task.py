import math
from pathlib import Path

import numpy as np
import pytest
import yaml

from wrenchsight.models.files.bundled_files import bundled_files
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.planning.placement.placement_task import check_task, load_task, reach_ball
from wrenchsight.models.robot.robot import Robot

GOOD = {
    "path_length": 1.0,
    "midpoint_lower": [-0.6, -0.6, 0.0],
    "midpoint_upper": [0.6, 0.6, 0.9],
}
GUESS = {
    "direction": [0.0, 2.0, 0.0],
    "midpoint": [0.5, 0.0, 0.45],
    "rotation": [[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]],
}


def write(folder: Path, changes: dict) -> Path:
    path = folder / "task.yaml"
    path.write_text(yaml.safe_dump(GOOD | changes))
    return path


def test_the_bundled_tasks_suit_the_bundled_arm(sts: Robot) -> None:
    assert list(bundled_files("tasks/placement")) == ["linear_path", "linear_path_table"]
    for name in bundled_files("tasks/placement"):
        task, source = load_task(name)
        check_task(task, source, sts)
        path = task.initial_path()
        assert path is not None
        assert (path.path_length, path.num_segments) == (1.0, 20)


def test_bounds_are_those_of_the_file_less_the_margin(sts: Robot, tmp_path: Path) -> None:
    changes = {
        "limit_margin_deg": 3.0,
        "angle_lower_deg": 10.0,
        "tool_direction": [0.0, 3.0, -4.0],
        "tool_tilt_deg": 30.0,
        "initial": GUESS,
    }
    task, _ = load_task(write(tmp_path, changes))
    bounds = task.bounds(sts)
    np.testing.assert_allclose(bounds.q_lower, sts.position_lower + math.radians(3.0))
    np.testing.assert_allclose(bounds.q_upper, sts.position_upper - math.radians(3.0))
    np.testing.assert_allclose(bounds.tool_direction, [0.0, 0.6, -0.8])
    assert bounds.tool_tilt == pytest.approx(math.radians(30.0))
    assert bounds.angle_lower == pytest.approx(math.radians(10.0))
    assert bounds.p_upper.tolist() == [0.6, 0.6, 0.9]
    path = task.initial_path()
    assert path is not None
    np.testing.assert_allclose(path.n_W, [0.0, 1.0, 0.0])


BAD_FILES = {
    "unknown key": ({"path_lenth": 1.0}, 'unknown key "path_lenth"'),
    "no length": ({"path_length": 0.0}, "path_length: 0, expected m above 0"),
    "one point": ({"num_segments": 1}, "num_segments: 1, expected 2 to 500"),
    "two numbers": ({"midpoint_lower": [0.0, 1.0]}, "midpoint_lower: 2 numbers, expected 3"),
    "crossed box": (
        {"midpoint_lower": [0.0, 0.7, 0.0]},
        "y from 0.7 to 0.6, expected the lower end first",
    ),
    "crossed angles": (
        {"angle_lower_deg": 90.0, "angle_upper_deg": 80.0},
        "from 90 to 80, expected a range within 0 to 180",
    ),
    "negative margin": ({"limit_margin_deg": -1.0}, "limit_margin_deg: -1, expected >= 0"),
    "no direction": ({"tool_direction": [0.0, 0.0, 0.0]}, "has no direction"),
    "no cone": (
        {"tool_direction": [0.0, 0.0, 1.0], "tool_tilt_deg": -1.0},
        "tool_tilt_deg: -1, expected 0 to 180",
    ),
    "no rotation": (
        {"initial": GUESS | {"rotation": [[1.0, 0.0, 0.0]] * 3}},
        "initial: path: R_WE: is no rotation matrix",
    ),
    "flat obstacle": (
        {"clearance": {"obstacles": [{"name": "t", "size": [1.0, 0.0, 1.0]}]}},
        "clearance.obstacles[0].size: expected 3 sides above 0",
    ),
    "same name": (
        {"clearance": {"obstacles": [{"name": "t", "size": [1, 1, 1]}] * 2}},
        '"t" is taken',
    ),
    "named as the floor": (
        {"clearance": {"obstacles": [{"name": "floor", "size": [1, 1, 1]}]}},
        'clearance.obstacles[0]: the name "floor" is taken',
    ),
    "named as the workpiece": (
        {"clearance": {"obstacles": [{"name": "workpiece", "size": [1, 1, 1]}]}},
        'clearance.obstacles[0]: the name "workpiece" is taken',
    ),
    "cone against angle": (
        {
            "tool_direction": [0.0, 0.0, -1.0],
            "tool_tilt_deg": 10.0,
            "angle_upper_deg": 90.0,
        },
        "in the cone the tool is turned by 170 degrees or more from W, angle_upper_deg allows 90",
    ),
    "surface against direction": (
        {
            "path_in_surface": True,
            "tool_direction": [0.0, 0.0, -1.0],
            "tool_tilt_deg": 10.0,
            "path_direction": [0.0, 0.0, 1.0],
            "path_angle_upper_deg": 45.0,
        },
        "is at 80 to 100 degrees from path_direction, 0 to 45 are allowed",
    ),
    "angle of the path from nowhere": (
        {"path_angle_upper_deg": 45.0},
        "path_direction: is missing; from what is the path at 0 to 45 degrees?",
    ),
    "crossed angles of the path": (
        {"path_direction": [0, 0, 1], "path_angle_lower_deg": 9.0, "path_angle_upper_deg": 0.0},
        "from 9 to 0, expected a range within 0 to 180",
    ),
    "workpiece without surface": (
        {"clearance": {"workpiece": {"size": [1.0, 0.2, 0.02]}}},
        "path_in_surface: the path runs along the workpiece's face",
    ),
}


@pytest.mark.parametrize("case", list(BAD_FILES))
def test_contradictions_in_the_file_are_named(tmp_path: Path, case: str) -> None:
    changes, expected = BAD_FILES[case]
    path = write(tmp_path, changes)
    with pytest.raises(InputError) as error:
        load_task(path)
    assert str(error.value).startswith(f"{path}: ")
    assert expected in str(error.value)
    assert "\n" not in str(error.value)


BAD_FOR_THE_ARM = {
    "too long": ({"path_length": 1.7}, "path_length: 1.7 m; all that sts_sre4_600 reaches lies"),
    "box out of reach": (
        {"midpoint_lower": [2.0, -0.6, 0.0], "midpoint_upper": [2.6, 0.6, 0.9]},
        "the box excludes the workspace: its point nearest to sts_sre4_600 is (2.00, 0.00, 0.38)",
    ),
    "too long for the box": (
        {"midpoint_lower": [0.7, 0.0, 0.3], "midpoint_upper": [0.8, 0.1, 0.5]},
        "a path of 1 m fits nowhere in the box; at most 0.8",
    ),
    "below the floor": (
        {"midpoint_lower": [0.2, 0.0, -0.4], "midpoint_upper": [0.4, 0.1, -0.1]},
        "z up to -0.1 m; the floor of sts_sre4_600 is at 0 m",
    ),
    "margin": ({"limit_margin_deg": 170.0}, "leaves joint_2 no range"),
    "posture": (
        {"initial": GUESS | {"posture": [0.0, 1.0]}},
        "initial.posture: 2 positions, sts_sre4_600 has 6 joints",
    ),
}


@pytest.mark.parametrize("case", list(BAD_FOR_THE_ARM))
def test_an_impossible_task_is_refused_before_any_search(
    sts: Robot, tmp_path: Path, case: str
) -> None:
    changes, expected = BAD_FOR_THE_ARM[case]
    task, source = load_task(write(tmp_path, changes))
    with pytest.raises(InputError) as error:
        check_task(task, source, sts)
    assert expected in str(error.value)


KEPT = {
    "the least rotation of the cone": {"angle_upper_deg": 171.0},
    "half a turn of any cone": {"angle_lower_deg": 179.0},
    "exactly in the direction": {"tool_tilt_deg": 0.0},
    "exactly along a direction": {"path_direction": [0.0, 1.0, 0.0], "path_angle_upper_deg": 0.0},
    "across the direction": {
        "path_in_surface": True,
        "path_direction": [0.0, 0.0, 1.0],
        "path_angle_lower_deg": 81.0,
        "path_angle_upper_deg": 99.0,
    },
}


@pytest.mark.parametrize("case", list(KEPT))
def test_angles_that_can_be_kept_are_no_contradiction(tmp_path: Path, case: str) -> None:
    down = {"tool_direction": [0.0, 0.0, -1.0], "tool_tilt_deg": 10.0}
    load_task(write(tmp_path, down | KEPT[case]))


@pytest.mark.parametrize("name", ["sts_sre4_600", "ur10e"])
def test_no_posture_leaves_the_ball_of_reach(name: str) -> None:
    robot = Robot.load(name)
    centre, radius = reach_ball(robot)
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (20_000, robot.num_joints))
    _, p = robot.chain.pose(q)
    distance = np.linalg.norm(p - centre, axis=1)
    assert np.max(distance) <= radius
    assert np.max(distance) > 0.75 * radius  # and it is not far too large
