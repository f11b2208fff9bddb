"""Odds of links are odds: on touches drawn on the Panda's own shape, which the odds do not know.

The shape is the cylinders of its URDF, drawn on evenly by area and pressed within a cone; the odds
know the Jacobian alone. Forward kinematics are written out here.
"""

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wrenchsight.models.detection.link_odds import PlaceOdds, place_evidence
from wrenchsight.models.robot.robot import Robot

POSTURE = [0.062, 0.688, -0.079, -1.621, 0.028, 2.288, 0.847]  # rad
SD = np.array([0.1, 0.08, 0.09, 0.09, 0.055, 0.05, 0.05])  # N m, as real recordings show
LINKS = (2, 4, 5, 6, 7)  # of the recordings of touches
COUNT = 250


class Touched(NamedTuple):
    link: int
    bodies: np.ndarray


class Cylinder(NamedTuple):
    pose: np.ndarray
    radius: float
    length: float
    link: int


def numbers(text: str) -> np.ndarray:
    return np.array([float(word) for word in text.split()])


def pose_of(element: ET.Element | None) -> np.ndarray:
    pose = np.eye(4)
    if element is not None:
        pose[:3, 3] = numbers(element.get("xyz", "0 0 0"))
        rpy = numbers(element.get("rpy", "0 0 0"))
        pose[:3, :3] = Rotation.from_euler("xyz", rpy).as_matrix()
    return pose


def shape(urdf: Path) -> tuple[list[Cylinder], np.ndarray, np.ndarray]:
    """Cylinders in the base's frame, and the joints' axes and points (7, 3)."""
    root = ET.parse(urdf).getroot()
    poses, link, axes, points = {"panda_link0": np.eye(4)}, {"panda_link0": 0}, [], []
    for joint in root.findall("joint"):  # in their order along the arm
        parent, child = (joint.find(word).get("link") for word in ("parent", "child"))
        pose = poses[parent] @ pose_of(joint.find("origin"))
        link[child] = link[parent]
        if joint.get("type") == "revolute":
            axis = numbers(joint.find("axis").get("xyz"))
            axes.append(pose[:3, :3] @ axis)
            points.append(pose[:3, 3])
            turn = np.eye(4)
            turn[:3, :3] = Rotation.from_rotvec(POSTURE[len(axes) - 1] * axis).as_matrix()
            pose, link[child] = pose @ turn, len(axes)
        poses[child] = pose
    cylinders = []
    for entry in root.findall("link"):
        for collision in entry.findall("collision"):
            size = collision.find("geometry/cylinder")
            name = entry.get("name")
            if size is not None and name in poses:
                pose = poses[name] @ pose_of(collision.find("origin"))
                radius, length = float(size.get("radius")), float(size.get("length"))
                cylinders.append(Cylinder(pose, radius, length, link[name]))
    return cylinders, np.array(axes), np.array(points)


def drawn(cylinders: list[Cylinder], link: int, rng: np.random.Generator):
    """A point on the link's surface that no other cylinder covers, and its outward normal."""
    mine = [one for one in cylinders if one.link == link]
    area = np.array([one.radius * (one.length + one.radius) for one in mine])
    while True:
        pose, radius, length, _ = mine[rng.choice(len(mine), p=area / area.sum())]
        turn, side = rng.uniform(0.0, 2.0 * np.pi), rng.uniform() < length / (length + radius)
        across = np.array([np.cos(turn), np.sin(turn), 0.0])
        if side:
            point, normal = radius * across, across
            point[2] = rng.uniform(-0.5, 0.5) * length
        else:
            sign = rng.choice([-1.0, 1.0])
            point = radius * np.sqrt(rng.uniform()) * across + [0.0, 0.0, 0.5 * sign * length]
            normal = np.array([0.0, 0.0, sign])
        point, normal = pose[:3, :3] @ point + pose[:3, 3], pose[:3, :3] @ normal
        if not any(covers(one, point) for one in cylinders):
            return point, normal


def covers(one: Cylinder, point: np.ndarray) -> bool:
    local = one.pose[:3, :3].T @ (point - one.pose[:3, 3])
    within = np.hypot(local[0], local[1]) < one.radius - 0.003
    return bool(within and abs(local[2]) < 0.5 * one.length - 0.003)


@pytest.fixture(scope="module")
def touches() -> list[Touched]:
    robot = Robot.load("panda")
    J = robot.chain.jacobian(np.array(POSTURE))
    urdf = Path(robot.source).with_name("robot.urdf")
    cylinders, axes, points = shape(urdf)
    _, E = robot.chain.pose(np.array(POSTURE))
    for k in range(7):  # the kinematics written out agree with the Jacobian
        np.testing.assert_allclose(np.cross(axes[k], E - points[k]), J[3:, k], atol=1e-12)
    rng, result = np.random.default_rng(3), []
    while len(result) < COUNT:
        link = int(rng.choice(LINKS))
        point, normal = drawn(cylinders, link, rng)
        tangent = rng.normal(0.0, 0.3, 3)
        push = -normal + tangent - normal * (normal @ tangent)
        push *= rng.uniform(8.0, 30.0) / np.linalg.norm(push)
        tau = (J[3:].T + np.cross(J[:3].T, point - E)) @ push
        tau[link:] = 0.0
        tau += 0.03 * tau * rng.normal(size=7) + rng.normal(0.0, 0.02, 7)
        if (np.abs(tau) / SD).max() > 6.0:  # else it is not found
            evidence = place_evidence(J[None], tau[None], SD[None], loaded=1.5)
            result.append(Touched(link, PlaceOdds.of(evidence).bodies))
    return result


def test_stated_odds_match_the_rate_of_right_links(touches: list[Touched]) -> None:
    stated = np.array([one.bodies.max() for one in touches])
    right = np.array([np.argmax(one.bodies) + 1 == one.link for one in touches])
    for low, high in ((0.5, 0.7), (0.7, 0.85), (0.85, 1.01)):
        inside = (stated >= low) & (stated < high)
        # Two binomial sds, and 6 % for a shape that is not the arm's.
        error = 2.0 * np.sqrt(0.25 / inside.sum()) if high < 0.8 else 0.07
        assert abs(right[inside].mean() - stated[inside].mean()) < error + 0.06
    assert np.mean([one.bodies[one.link - 1] >= 0.1 for one in touches]) > 0.95


def test_a_touch_of_link_6_seldom_has_high_odds_for_link_7(touches: list[Touched]) -> None:
    called = np.array([one.bodies[6] > 0.9 for one in touches if one.link == 6])
    assert called.mean() < 0.1
    assert np.mean([one.bodies[6] for one in touches if one.link == 7]) > 0.75
