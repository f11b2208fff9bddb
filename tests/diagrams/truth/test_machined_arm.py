"""The true arm at machining in one block: what no controller asks of it."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from wrenchsight.diagrams.robot_cell import make_robot_cell
from wrenchsight.diagrams.scenario import load_scenario
from wrenchsight.models.robot.robot import Robot


def test_drives_give_no_more_current_than_they_can_as_in_many_blocks():
    robot = Robot.load("sts_sre4_600")
    scenario = load_scenario("Polishing")
    limit = robot.effort_limit / robot.torque_per_ampere
    command = limit * [0.5, 2.0, -2.0, 1e6, -1e6, -0.5]
    found = {}
    for asked in (command, np.clip(command, -limit, limit)):
        for fused in (True, False):
            cell = make_robot_cell(scenario, robot, robot.home, fused=fused).diagram
            simulator = Simulator(cell)
            context = simulator.get_mutable_context()
            cell.GetInputPort("current_command").FixValue(context, asked)
            simulator.AdvanceTo(0.0035)
            assert cell.HasSubsystemNamed("machined_arm") is fused
            found[asked is command, fused] = {
                name: cell.GetOutputPort(name).Eval(context)
                for name in ("q", "v", "current", "tau_J_true")
            }
    for name, values in found[True, True].items():
        np.testing.assert_array_equal(values, found[True, False][name], err_msg=name)
        np.testing.assert_array_equal(values, found[False, True][name], err_msg=name)
    # After four ticks of a drive of 400 Hz nearly all of it.
    tau_J = np.abs(found[True, True]["tau_J_true"][1:5])
    assert tau_J == pytest.approx(robot.effort_limit[1:5], rel=0.05)
