"""The default scenario on arms that travel less, move slower or carry less than it asks."""

import numpy as np
import pytest

from wrenchsight.diagrams.fitted_scenario import fitted_to
from wrenchsight.diagrams.scenario import load_scenario, make_trajectory
from wrenchsight.models.robot.robot import Robot

DEFAULT = load_scenario("Default", None)


@pytest.mark.parametrize("name", ["ur10e", "sts_sre4_600"])
def test_an_arm_that_can_do_all_of_it_does_all_of_it(name):
    scenario, notices = fitted_to(DEFAULT, Robot.load(name))
    if name == "sts_sre4_600":  # 4 kg: 9.8 N are a quarter of its payload
        assert [notice[:9] for notice in notices] == ["the push "]
        scenario.wrench = DEFAULT.wrench
    assert scenario == DEFAULT or notices


def test_a_slide_swings_in_metres_within_its_travel_and_the_push_is_what_it_carries(serial_robot):
    joints = [("revolute", "0 0 1", "0 0 .3"), ("prismatic", "0 0 1", ".2 0 0")]
    robot = serial_robot(joints, limit=0.2, home=[0.1, -0.1], payload=0.2)
    scenario, notices = fitted_to(DEFAULT, robot)
    # 0.1 of room to the nearer limit, of which .8 may be used, of both joints.
    np.testing.assert_allclose(scenario.motion.amplitude, [0.08, 0.08])
    make_trajectory(scenario, robot)  # keeps within the limits
    (push,) = scenario.wrench
    assert push.force == pytest.approx([0.25 * 0.2 * 9.81] * 3)
    assert push.moment[0] / push.force[0] == pytest.approx(0.3 / 12.0)  # about the same point
    assert "j1 0.08 m" in notices[0]
    assert "0.49 N" in notices[1]


def test_a_slow_joint_swings_less(serial_robot):
    robot = serial_robot([("revolute", "0 0 1", "0 0 .3")], payload=10.0)
    robot.velocity_limit.setflags(write=True)
    robot.velocity_limit[0] = 0.1
    scenario, _ = fitted_to(DEFAULT, robot)
    peak = 2.0 * np.pi * 0.12 * scenario.motion.amplitude[0]
    assert peak == pytest.approx(0.05)
