from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, LogVectorOutput

from wrenchsight.diagrams.robot_cell import make_robot_cell
from wrenchsight.diagrams.scenario import PlateConfig, Scenario
from wrenchsight.models.control.wrench_script import WrenchStep
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.robot.robot_config import PoseConfig
from wrenchsight.models.truth.joint_kernels import RIGID_DAMPER
from wrenchsight.systems.force_torque_sensor import ForceTorqueSensorConfig

T = 1e-3
QUIET = Scenario(friction="none", current_noise=False)


class Run:
    """A cell with a constant current command, and logs of its ports."""

    def __init__(self, scenario, robot, q_0, torque, duration, v_0=None):
        self.cell = make_robot_cell(scenario, robot, q_0)
        builder = DiagramBuilder()
        builder.AddSystem(self.cell.diagram)
        current = np.asarray(torque) / (robot.torque_per_ampere * robot.current_sign)
        source = builder.AddSystem(ConstantVectorSource(current))
        builder.Connect(source.get_output_port(), self.cell.diagram.GetInputPort("current_command"))
        names = [
            self.cell.diagram.get_output_port(i).get_name()
            for i in range(self.cell.diagram.num_output_ports())
        ]
        logs = {
            name: LogVectorOutput(self.cell.diagram.GetOutputPort(name), builder, T)
            for name in names
            if name != "contact_results"  # an abstract value
        }
        simulator = Simulator(builder.Build())
        self.context = simulator.get_mutable_context()
        plant = self.cell.plant
        if v_0 is not None:
            plant.SetVelocities(plant.GetMyMutableContextFromRoot(self.context), v_0)
        simulator.AdvanceTo(duration)
        for name, log in logs.items():
            setattr(self, name, log.FindLog(self.context).data().T)


def test_ports(sts):
    scenario = Scenario(
        force_torque_sensor=ForceTorqueSensorConfig(), workpiece=PlateConfig(), floor=True
    )
    diagram = make_robot_cell(scenario, sts, sts.home).diagram
    outputs = {diagram.get_output_port(i).get_name() for i in range(diagram.num_output_ports())}
    truth = {"tau_J_true", "tau_f_true", "tau_ext_true", "wrench_true"}
    of_plant = {"state", "plant_state", "contact_results"}
    assert outputs == {"q", "v", "current", "ft_wrench"} | of_plant | truth
    assert diagram.num_input_ports() == 1
    assert diagram.GetInputPort("current_command").size() == 6
    # What a controller measures must not depend on what it commands at the same instant.
    for name in ("q", "v", "state", "ft_wrench"):
        port = diagram.GetOutputPort(name).get_index()
        assert not diagram.HasDirectFeedthrough(0, port)


def test_the_motion_obeys_the_equation_of_motion(sts):
    """M vdot + C v + G + tau_f = tau_J + tau_ext, tick by tick, with friction and a push."""
    scenario = replace(
        QUIET,
        friction="full",
        wrench=[WrenchStep(force=[5.0, -8.0, 6.0], moment=[0.3, 0.2, -0.4])],
    )
    G = sts.chain.gravity_torque(sts.home)
    torque = G + 1.6 * sts.truth.stiction * np.array([1.0, 1, -1, 1, 1, 1])
    run = Run(scenario, sts, sts.home, torque, 0.3)
    chain = sts.chain
    assert np.abs(run.v[-1]).min() > 0.05
    vdot = np.diff(run.v, axis=0) / T
    left = chain.inverse_dynamics(run.q[:-1], run.v[:-1], vdot) + run.tau_f_true[:-1]
    right = run.tau_J_true[:-1] + run.tau_ext_true[:-1]
    np.testing.assert_allclose(left, right, atol=2e-6)


def test_gravity_held_at_rest_without_friction(sts):
    G = sts.chain.gravity_torque(sts.home)
    run = Run(QUIET, sts, sts.home, G, 0.2)
    np.testing.assert_allclose(run.q[-1], sts.home, atol=1e-6)
    np.testing.assert_allclose(
        run.current[0] * sts.torque_per_ampere * sts.current_sign, G, atol=1e-9
    )


def test_stiction_holds_what_gravity_compensation_misses(sts):
    G = sts.chain.gravity_torque(sts.home)
    miss = 0.9 * sts.truth.stiction * [1, -1, 1, -1, 1, -1]
    scenario = replace(QUIET, friction="full")
    run = Run(scenario, sts, sts.home, G + miss, 0.5)
    # It creeps by torque / 1e5 N m s/rad; gravity changes by some ten N m times that angle.
    creep = 0.5 * np.abs(miss).max() / RIGID_DAMPER
    np.testing.assert_allclose(run.q[-1], sts.home, atol=1.05 * creep)
    np.testing.assert_allclose(run.tau_f_true[-1], miss, atol=50 * creep)


def test_energy_is_lost_to_friction_only(sts):
    scenario = replace(QUIET, friction="coulomb_viscous")
    none = Run(QUIET, sts, sts.home, np.zeros(6), 0.15)
    some = Run(scenario, sts, sts.home, np.zeros(6), 0.15, v_0=np.full(6, 0.4))

    def energy(run):
        momentum = sts.chain.momentum_terms(run.q, run.v)[0]
        height = [
            sum(m * 9.81 * p for m, p in zip(masses(sts), heights(sts, q), strict=True))
            for q in run.q
        ]
        return 0.5 * np.sum(momentum * run.v, axis=1) + np.array(height)

    # Semi-implicit Euler keeps the energy within about T/2 of its exchange rate, watts.
    free = energy(none)
    assert np.ptp(free) < 0.3
    work = np.cumsum(np.sum(some.tau_f_true * some.v, axis=1)) * T
    lost = energy(some)[0] - energy(some)
    assert lost[-1] > 0.5
    np.testing.assert_allclose(lost[1:], work[:-1], atol=0.3)


def masses(robot):
    return robot.chain.inertial_parameters[:, 0]


def heights(robot, q):
    """Of each moving body's centre of mass: through the chain's own frames."""
    chain = robot.chain
    R, p, result = np.eye(3), np.zeros(3), []
    for i in range(chain.num_joints):
        p = p + R @ chain.p_PJ[i]
        a = chain.axis[i]
        K = np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
        R = R @ chain.R_PJ[i] @ (np.eye(3) + np.sin(q[i]) * K + (1 - np.cos(q[i])) * K @ K)
        parameters = chain.inertial_parameters[i]
        result.append((p + R @ parameters[1:4] / parameters[0])[2])
    return result


def test_sensor_and_truth_agree_on_an_applied_wrench(sts):
    push = WrenchStep(force=[5.0, -8.0, 6.0], moment=[0.3, 0.2, -0.4])
    scenario = replace(QUIET, wrench=[push], force_torque_sensor=ForceTorqueSensorConfig())
    run = Run(scenario, sts, sts.home, np.zeros(6), 0.2)
    np.testing.assert_array_equal(run.wrench_true[:, 3:], np.tile(push.force, (201, 1)))
    np.testing.assert_allclose(run.ft_wrench[1:], run.wrench_true[:-1], atol=1e-8)
    np.testing.assert_allclose(
        run.tau_ext_true,
        np.einsum("tkj,tk->tj", sts.chain.jacobian(run.q), run.wrench_true),
        atol=1e-12,
    )


def test_a_plate_pushes_the_tool_out_and_truth_and_sensor_see_it(sts):
    _, p_home = sts.chain.pose(sts.home)
    # A wall that faces the tool, which looks along +x at home; the tool starts 1 mm before it.
    wall = PlateConfig(
        pose=PoseConfig([p_home[0] + 1e-3, 0.0, p_home[2]], [0.0, -np.pi / 2, 0.0]),
        size=[0.3, 0.3, 0.02],
    )
    scenario = replace(QUIET, workpiece=wall, force_torque_sensor=ForceTorqueSensorConfig())
    press = sts.chain.jacobian(sts.home)[3] * 20.0
    run = Run(scenario, sts, sts.home, sts.chain.gravity_torque(sts.home) + press, 0.06)
    assert run.wrench_true[0, 3] == 0
    assert run.wrench_true[-1, 3] < -10.0  # the wall pushes the robot back, along -x
    touching = run.wrench_true[:-1, 3] < -1.0
    np.testing.assert_allclose(
        run.ft_wrench[1:][touching], run.wrench_true[:-1][touching], atol=1e-6
    )
    np.testing.assert_allclose(
        run.tau_ext_true,
        np.einsum("tkj,tk->tj", sts.chain.jacobian(run.q), run.wrench_true),
        atol=1e-8,
    )


def test_drives_saturate(sts):
    run = Run(QUIET, sts, sts.home, 10 * sts.effort_limit, 0.01)
    np.testing.assert_allclose(run.tau_J_true[0], sts.effort_limit)
    np.testing.assert_allclose(np.abs(run.current[0]) * sts.torque_per_ampere, sts.effort_limit)


def test_current_noise_is_as_the_robot_file_says_and_repeats(sts):
    scenario = replace(QUIET, current_noise=True)
    G = sts.chain.gravity_torque(sts.home)
    runs = [Run(replace(scenario, seed=seed), sts, sts.home, G, 0.4) for seed in (1, 1, 2)]
    np.testing.assert_array_equal(runs[0].current, runs[1].current)
    assert not np.array_equal(runs[0].current, runs[2].current)
    sd = runs[0].current.std(axis=0)
    np.testing.assert_allclose(sd, sts.current_noise_sd, rtol=0.2)
    steps = runs[0].current / sts.current_resolution
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)


def test_a_sensor_needs_a_tool(ur10e):
    scenario = replace(QUIET, force_torque_sensor=ForceTorqueSensorConfig())
    with pytest.raises(InputError, match="needs a tool above it"):
        make_robot_cell(scenario, ur10e, ur10e.home)
    # Without the sensor it simulates, and the push acts at the flange.
    scenario = replace(QUIET, wrench=[WrenchStep(force=[0, 0, 10.0])])
    G = ur10e.chain.gravity_torque(ur10e.home)
    run = Run(scenario, ur10e, ur10e.home, G, 0.01)
    np.testing.assert_allclose(
        run.tau_ext_true[0], ur10e.chain.jacobian(ur10e.home)[5] * 10.0, atol=1e-12
    )
