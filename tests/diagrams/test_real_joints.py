"""The cell with joints as real ones are: what is seen of them, in free motion and in contact."""

import dataclasses

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from wrenchsight.diagrams.closed_loop import LogRequest, make_closed_loop
from wrenchsight.diagrams.robot_cell import make_robot_cell
from wrenchsight.diagrams.scenario import PlateConfig, Scenario
from wrenchsight.models.control.wrench_script import WrenchStep
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.robot_config import PoseConfig
from wrenchsight.models.robot.truth_config import MechanismsConfig, MotorConfig
from wrenchsight.models.truth.true_robot import plain_truth, with_truth_named


@pytest.fixture(scope="module")
def plain():
    return plain_truth(Robot.load("sts_sre4_600"))


@pytest.fixture(scope="module")
def robot():
    return with_truth_named(Robot.load("sts_sre4_600"), "hard")


def test_the_cell_has_the_ports_of_the_plain_one(plain, robot):
    ports = []
    for arm in (plain, robot):
        cell = make_robot_cell(Scenario(), arm, arm.home).diagram
        ports.append({cell.get_output_port(i).get_name() for i in range(cell.num_output_ports())})
    assert ports[0] == ports[1]


def test_encoders_start_at_the_posture_and_links_do_not(robot):
    cell = make_robot_cell(Scenario(), robot, robot.home)
    context = cell.diagram.CreateDefaultContext()
    np.testing.assert_allclose(
        cell.diagram.GetOutputPort("q").Eval(context),
        robot.home,
        atol=2e-6,  # the encoder's step
    )
    links = cell.diagram.GetOutputPort("state").Eval(context)[:6]
    assert np.abs(links - robot.home).max() > 5e-4


def test_a_motor_that_is_weaker_than_stated_needs_more_current(plain):
    """Held at rest under gravity, without dry friction: current = G / (factor K)."""
    truth = plain.config.simulated_truth
    friction = dataclasses.replace(truth.friction, stiction=[], coulomb=[], load_dependence=[],
                                   ripple_amplitude=[])  # fmt: skip
    arm = plain.with_truth(
        dataclasses.replace(
            truth, friction=friction, mechanisms=MechanismsConfig(motor=MotorConfig([0.9] * 6))
        )
    )
    scenario = Scenario(current_noise=False, duration=1.0)
    loop = make_closed_loop(scenario, arm, IdentifiedModel.nominal(arm), estimator=None)
    simulator = Simulator(loop.diagram)
    simulator.AdvanceTo(1.0)
    _, signals = loop.logged(simulator.get_context())
    G = arm.chain.gravity_torque(signals["q"][-1])
    np.testing.assert_allclose(
        signals["current"][-1] * arm.torque_per_ampere * 0.9,
        G,
        atol=2e-2,  # still settling
    )


def test_the_true_external_torque_is_felt_at_once_without_contact(robot):
    """A constant pull through the estimator with the nominal model is read in its direction."""
    pull = WrenchStep(start=0.2, duration=2.0, force=[0.0, 0.0, -80.0])
    scenario = Scenario(duration=1.5, wrench=[pull])
    loop = make_closed_loop(scenario, robot, IdentifiedModel.nominal(robot))
    simulator = Simulator(loop.diagram)
    simulator.AdvanceTo(1.5)
    _, signals = loop.logged(simulator.get_context())
    gained = signals["tau_ext_true"][-1] - signals["tau_ext_true"][0]
    read = signals["tau_ext"][-200:].mean(axis=0) - signals["tau_ext"][100:200].mean(axis=0)
    strong = np.argmax(np.abs(gained))
    # Dry friction may keep its stiction of it
    limit = 1.5 * robot.truth.stiction[strong]
    assert abs(read[strong] - gained[strong]) < limit < abs(gained[strong])


def test_pressed_on_a_plate_it_neither_rings_nor_runs_away(robot):
    """Contact forces come a tick late into the springs: what is pressed stays pressed, quietly."""
    _, p = robot.chain.pose(robot.home)
    plate = PlateConfig(pose=PoseConfig([p[0], p[1], p[2] - 0.0135], [0.0, 0.0, 0.0]))
    press = WrenchStep(start=0.2, duration=5.0, force=[0.0, 0.0, -30.0])
    scenario = Scenario(duration=1.2, workpiece=plate, wrench=[press])
    loop = make_closed_loop(
        scenario,
        robot,
        IdentifiedModel.nominal(robot),
        estimator=None,
        log=LogRequest(also=("state",)),
    )
    simulator = Simulator(loop.diagram)
    simulator.AdvanceTo(1.2)
    _, signals = loop.logged(simulator.get_context())
    late = signals["wrench_true"][-500:, 5] + 30.0  # N, the plate's part: hundreds by now
    assert np.isfinite(signals["state"]).all()
    assert late.min() > 50.0
    assert np.median(np.abs(np.diff(late))) < 1.0  # N a tick; single slips of the tip do more
    # Slips of the tip, no motion: ringing or running away would be rad/s.
    assert np.abs(signals["v"][-500:]).max() < 0.4
